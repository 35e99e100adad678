"""A finished run and its summary."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.declaration import InstanceDeclaration, split_owner
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.results.checks import Outcome, standard_metrics
from flexbeams.scenarios.simulation.recording import Recording

Kind = Literal["scenario", "package"]


@dataclass(frozen=True, kw_only=True)
class Run:
    """A finished run of a scenario or of an SSP package."""

    name: str
    description: str  # the scenario's first comment, or the package's description
    scenario: Scenario  # with the settings applied
    settings: Settings
    design: Design | None  # None for a package, whose units are built
    recording: Recording
    open_loop: Recording | None = None  # of the scenario that this one is compared with
    outcomes: list[Outcome]
    summary: dict[str, Any]  # content of summary.json

    @property
    def kind(self) -> Kind:
        """What was run."""
        return "package" if self.design is None else "scenario"

    @property
    def passed(self) -> bool:
        """Whether the run is complete and all checks hold."""
        return self.recording.complete and all(o.passed for o in self.outcomes)


def run_summary(
    name: str,
    scenario: Scenario,
    design_id: str,
    settings: Settings,
    recording: Recording,
    outcomes: list[Outcome],
    *,
    step: float,
    changed: dict[str, Any],
    declarations: Mapping[str, InstanceDeclaration],
    kind: Kind = "scenario",
) -> dict[str, Any]:
    """Content of summary.json; `design_id` is empty for units without a design, `step` in s, `changed` as from
    changed_settings."""
    summary: dict[str, Any] = {
        "kind": kind,
        "scenario": name,
        "title": scenario.title,
        "design_id": design_id,
        "coupling": scenario.coupling,
        "backend": settings.backend,
        "structure": settings.structure or scenario.structure,
        "step": step,
        "stop_time": scenario.stop_time,
        "settings": changed,
        "complete": recording.complete,
        "decimate": recording.decimate,
        "set": settings.overrides,
        "checks": [o.record() for o in outcomes],
        "metrics": {**{o.name: o.value for o in outcomes}, **standard_metrics(recording)},
        "timing": _timing(recording, settings.real_time_factor),
    }
    if scenario.sensor:
        summary["sensors"] = [asdict(sensor) for sensor in scenario.sensor]
    if recording.ended:
        summary["ended"] = recording.ended
    summary["signals"] = signal_table(recording.columns, declarations)
    if recording.failure is not None:
        summary["error"] = str(recording.failure)
    return summary


def signal_table(columns: Sequence[str], declarations: Mapping[str, InstanceDeclaration]) -> dict[str, dict[str, str]]:
    """Unit of measurement and description of each column, from the declaration of its unit."""
    table = {}
    for column in columns:
        owner, name = split_owner(column, declarations)
        variable = declarations[owner].variables[name]
        table[column] = {"unit": variable.unit or "", "description": variable.description or ""}
    return table


def _timing(recording: Recording, pace: float | None) -> dict[str, Any]:
    """Steps, time of the stepping loop, and lateness of a run at `pace` simulated seconds for each second."""
    simulated = float(recording.time[-1] - recording.time[0])
    timing: dict[str, Any] = {
        "steps": recording.steps,
        "wall_s": recording.wall_seconds,
        "real_time_factor": simulated / recording.wall_seconds if recording.wall_seconds else None,
    }
    if recording.lateness is not None and pace is not None and recording.steps > 1:
        timing["lateness"] = lateness_figures(recording.lateness, simulated / recording.steps / pace)
    return timing


def lateness_figures(lateness: Array, period: float) -> dict[str, float]:
    """How closely a paced run followed the clock: delays of the steps, s, and how many exceed `period`, s.

    `rate_error` is the relative excess of the time from the first step to the last.
    """
    quantiles = np.quantile(lateness, [0.5, 0.99, 0.9999])
    return {
        "median": float(quantiles[0]),
        "p99": float(quantiles[1]),
        "p99.99": float(quantiles[2]),
        "max": float(lateness.max()),
        "overruns": int(np.count_nonzero(lateness > period)),
        "rate_error": float(lateness[-1] - lateness[0]) / (period * (len(lateness) - 1)),
    }
