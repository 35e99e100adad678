"""The exported scenario under this project's runner and under third-party masters: times and deviations."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.choices import Coupling
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.ssp import export_ssp
from flexbeams.scenarios.masters.catalogue import MASTERS, RUNNER, installed_version
from flexbeams.scenarios.masters.isolation import MasterError, run_cycles
from flexbeams.scenarios.masters.tasks import read_task
from flexbeams.scenarios.masters.trace import Master, Task, Trace, deviation
from flexbeams.scenarios.runs.package import run_package
from flexbeams.scenarios.simulation.recording import Recording

SCENARIO, STEP = "tracking", 2e-4
ROUNDS = 3
REPEATED_BELOW = 2.0  # s; masters that take longer run once


@dataclass(frozen=True, kw_only=True)
class Times:
    """Least seconds of a master."""

    recorded: float  # of the steps, with signals recorded
    silent: float  # of the steps, without
    loading: float | None


def measure_masters(
    steps: int, compiler: str, build_folder: Path, notify: Callable[[str], None], progress: Callable[[int, int], None]
) -> dict[str, Any]:
    """Times of each master and its deviation from the runner's result, in JSON's types.

    Each runs in a process of its own on one core, the runner before each of them. Keys: `scenario`, `steps`, `step_s`,
    `platform`, `signals` (recorded at every step), `masters` (rows of figures), `missing` (not installed or failed).
    """
    with temporary_folder() as folder:
        file = folder / f"{SCENARIO}.ssp"
        settings = Settings(record_animation=False, compiler=compiler, build_folder=build_folder)
        export_ssp(SCENARIO, file, replace(settings, stop_time=steps * STEP), notify=notify)

        @cache
        def reference(coupling: Coupling) -> Recording:
            return run_package(file, replace(settings, coupling=coupling)).recording

        outputs = read_task(file).signals
        recorded = [c for c in reference("jacobi").columns if c in outputs]
        tasks = tuple(replace(read_task(file, signals=signals), compiler=compiler) for signals in (recorded, ()))
        rows = _measure_all(tasks, reference, notify, progress)
    names = {row["name"] for row in rows}
    return {
        "scenario": SCENARIO,
        "steps": steps,
        "step_s": STEP,
        "platform": sys.platform,
        "signals": len(recorded),
        "masters": rows,
        "missing": [n for n in MASTERS if n not in names],
    }


def _measure_all(
    tasks: Sequence[Task],
    reference: Callable[[Coupling], Recording],
    notify: Callable[[str], None],
    progress: Callable[[int, int], None],
) -> list[dict[str, Any]]:
    """A row for the runner and for each master that is installed and does not fail."""
    results: list[tuple[Master, Times, float]] = []
    runner_times: list[Times] = []
    for done, master in enumerate(MASTERS.values()):
        progress(done, len(MASTERS))
        runner_times.append(_measure(RUNNER, tasks)[0])
        if installed_version(master) is None:
            continue
        try:
            times, trace = _measure(master, tasks)
        except MasterError as error:
            notify(str(error))
            continue
        results.append((master, times, deviation(trace, reference(master.coupling))))
    runner = Times(
        recorded=min(t.recorded for t in runner_times),
        silent=min(t.silent for t in runner_times),
        loading=min(t.loading or 0.0 for t in runner_times),
    )
    rows = [_row(master, times, runner, error) for master, times, error in results]
    return [_row(RUNNER, runner, runner, None), *rows]


def _measure(master: Master, tasks: Sequence[Task]) -> tuple[Times, Trace]:
    """Least times over the runs, and a trace with the signals."""
    once = run_cycles(master.name, tasks)
    stepping = list(once.stepping)
    if sum(stepping[0]) < REPEATED_BELOW:
        stepping += run_cycles(master.name, tasks, ROUNDS).stepping
    recorded, silent = (min(times) for times in zip(*stepping, strict=True))
    return Times(recorded=recorded, silent=silent, loading=once.traces[1].loading), once.traces[0]


def _row(master: Master, times: Times, runner: Times, error: float | None) -> dict[str, Any]:
    """A master's figures; ratios are to the runner's."""
    return {
        "name": master.name,
        "version": installed_version(master),
        "coupling": master.coupling,
        "deviation": error,
        "loading_s": times.loading,
        "recorded_s": times.recorded,
        "recorded_ratio": times.recorded / runner.recorded,
        "silent_s": times.silent,
        "silent_ratio": times.silent / runner.silent,
    }
