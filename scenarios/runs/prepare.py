"""A run before its units are built: every name, size and value of a scenario is looked at here first."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from os.path import isfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.fmus.units.catalogue import require_kind
from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import BeamModel
from flexbeams.scenarios.definition.declaration import InstanceDeclaration
from flexbeams.scenarios.definition.schema import Scenario, find_scenario, read_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.signals import require_sampled
from flexbeams.scenarios.importing.fmu import unit_description
from flexbeams.scenarios.results.checks import Measurement
from flexbeams.scenarios.results.curves import figure_curve
from flexbeams.scenarios.runs.start_values import require_open, start_values
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.wiring import Wiring, WiringBuilder

LARGEST = 2**30  # bytes of recorded values; files of results take a multiple of it while they are written


@dataclass(frozen=True, kw_only=True)
class PreparedRun:
    """What is settled before units are built."""

    step: float  # s
    steps: int
    models: dict[str, BeamModel]  # of the instances whose units are built
    starts: dict[str, dict[str, float | bool]]
    wiring: Wiring
    instances: dict[str, InstanceDeclaration]


def prepare_run(
    path: Path, scenario: Scenario, design: Design, settings: Settings, notify: Callable[[str], None]
) -> tuple[Scenario, PreparedRun]:
    """The wiring of a run, and the scenario without the checks that a shorter --stop-time does not reach.

    Raises InputError for whatever the scenario or the command line asks for and cannot have.
    """
    source = str(path)
    step = scenario.step or design.options.sample_time
    steps = whole_steps(scenario.stop_time, step, settings, source)
    for k, drive in enumerate(scenario.input, 1):
        try:
            require_sampled(drive, step)
        except InputError as error:
            raise error.at(source, f"input[{k}].") from None
    models = unit_models(path, scenario, design, settings)
    instances = {name: _declared(name, path, scenario, design, models) for name in scenario.instance}
    require_one_design(instances, source)
    starts = start_values(scenario, instances, settings.overrides, source)
    wiring = WiringBuilder(scenario, instances, source, starts).build()
    require_open(wiring, settings.overrides)
    require_room(wiring, steps, scenario.stop_time, settings, source)
    scenario = _reached(scenario, settings, source, notify)
    blank = _blank(scenario, wiring.columns)
    Measurement(scenario, source, blank, blank).outcomes()
    require_figures(scenario, wiring.columns, None, source)
    return scenario, PreparedRun(
        step=step, steps=steps, models=models, starts=starts, wiring=wiring, instances=instances
    )


def whole_steps(stop_time: float, step: float, settings: Settings, source: str) -> int:
    """Number of steps up to the stop time; InputError where it is none."""
    ratio = stop_time / step
    steps = round(ratio) if math.isfinite(ratio) else 0
    if steps < 1 or abs(steps * step - stop_time) > 1e-6 * step:
        raise InputError(
            "stop_time",
            f"must be a whole number of steps of {step:g} s",
            stop_time,
            source="--stop-time" if settings.stop_time else source,
        )
    return steps


def require_room(wiring: Wiring, steps: int, stop_time: float, settings: Settings, source: str) -> None:
    """InputError for a recording that would not fit into memory."""
    size = 8 * (len(wiring.columns) + 1) * (-(-steps // settings.decimate) + 1)
    if size > LARGEST:
        raise InputError(
            "stop_time",
            f"must leave at most {LARGEST / 1e9:.2g} GB of recorded values, {steps:.3g} "
            f"steps make {size / 1e9:.3g} GB; record less of them with --decimate",
            stop_time,
            source="--stop-time" if settings.stop_time else source,
        )


def require_figures(scenario: Scenario, columns: list[str], open_loop: list[str] | None, source: str) -> None:
    """InputError for a figure of signals that are not recorded; None: what the open loop records is not known yet."""
    recording, other = _blank(scenario, columns), None if open_loop is None else _blank(scenario, open_loop)
    for k, figure in enumerate(scenario.figure, 1):
        for name in (n for row in figure.rows for n in row):
            if name.startswith("open_loop.") and scenario.open_loop is not None and other is None:
                continue
            try:
                curve = figure_curve(name, recording, other, figure.points, f"figure[{k}]")
            except InputError as error:
                raise error.at(source) from None
            if not curve.columns:
                raise InputError(f"figure[{k}].points", f"must have one within {name}", figure.points, source=source)


def with_open_loop(scenario: Scenario, path: Path) -> Scenario:
    """The scenario with open_loop as a path that can be found from anywhere; InputError where there is none."""
    if scenario.open_loop is None:
        return scenario
    beside = path.parent / scenario.open_loop
    try:
        other = beside if isfile(beside) else find_scenario(scenario.open_loop)
    except InputError as error:
        raise InputError("open_loop", error.rule, source=str(path)) from None
    if read_scenario(other).open_loop is not None:
        raise InputError(
            "open_loop", "must be a scenario without an open_loop of its own", scenario.open_loop, source=str(path)
        )
    return replace(scenario, open_loop=str(other))


def unit_models(path: Path, scenario: Scenario, design: Design, settings: Settings) -> dict[str, BeamModel]:
    """The plant's model for each instance whose unit is built, each computed once."""
    models: dict[tuple[Any, Any], BeamModel] = {}
    chosen = {}
    for name, instance in scenario.instance.items():
        if instance.unit is None:
            continue
        key = (None if settings.basis else instance.basis, instance.order)
        try:
            chosen[name] = models[key] = models.get(key) or design.model(*key)
        except InputError as error:
            raise error.at(str(path), f"instance.{name}.") from None
    return chosen


def _declared(
    name: str, path: Path, scenario: Scenario, design: Design, models: dict[str, BeamModel]
) -> InstanceDeclaration:
    instance = scenario.instance[name]
    if instance.unit is not None:
        variables = {
            v.name: SimpleNamespace(
                name=v.name,
                type=v.type,
                causality=v.causality,
                start=v.start,
                min=v.minimum,
                max=v.maximum,
                unit=v.unit,
                nominal=v.nominal,
            )
            for v in require_kind(instance.unit, f"instance.{name}.unit").declare(design, models[name])
        }
        return InstanceDeclaration(description=SimpleNamespace(modelName=instance.unit), variables=variables)
    key, file = f"instance.{name}.fmu", path.parent / str(instance.fmu)
    if not isfile(file):
        raise InputError(key, "must be a file", str(file), source=str(path))
    description = unit_description(file, key, str(path))
    return InstanceDeclaration(description=description, variables={v.name: v for v in description.modelVariables})


def require_one_design(instances: Mapping[str, InstanceDeclaration], source: str) -> None:
    """InputError for units that were not designed together."""
    designs = {name: str(i.variables["design_id"].start) for name, i in instances.items() if "design_id" in i.variables}
    if len(set(designs.values())) > 1:
        listed = ", ".join(f"{name} has {value[:12]}" for name, value in designs.items())
        raise InputError(
            "instance", f"units must be of one design (design_id): {listed}; build them together", source=source
        )


def _reached(scenario: Scenario, settings: Settings, source: str, notify: Callable[[str], None]) -> Scenario:
    """The scenario with the checks whose window lies within the run; others are left out only under --stop-time."""
    kept = []
    for k, check in enumerate(scenario.check, 1):
        if check.before is not None and check.before < check.after:
            raise InputError(f"check[{k}].before", f"must be >= after ({check.after:g} s)", check.before, source=source)
        key, last = ("after", check.after) if check.before is None else ("before", check.before)
        if last <= scenario.stop_time + 1e-9:
            kept.append(check)
        elif settings.stop_time:
            notify(f"check {check.name!r} looks at {last:g} s and is left out")
        else:
            raise InputError(
                f"check[{k}].{key}", f"must be within the run of {scenario.stop_time:g} s", last, source=source
            )
    return replace(scenario, check=kept)


def _blank(scenario: Scenario, columns: list[str]) -> Recording:
    """A recording of zeros, with rows at the ends of the run and of each check's window."""
    ends = [t for c in scenario.check for t in (c.after, c.before) if t is not None]
    time = np.unique([0.0, scenario.stop_time, *ends])
    return Recording(time=time, columns=columns, values=np.zeros((len(time), len(columns))), wall_seconds=0.0)
