"""Assignments of a study: for each controller the prepared run, small enough to send, with its units built."""

import pickle
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.results.checks import column_indices
from flexbeams.scenarios.runs.prepare import PreparedScenario
from flexbeams.scenarios.runs.repeated import lean
from flexbeams.scenarios.runs.scenario import unit_files
from flexbeams.scenarios.simulation.batch_kernel import batch_libraries
from flexbeams.scenarios.simulation.native_stepper import stepper_library
from flexbeams.scenarios.studies.batch import BatchPlan, batch_plan
from flexbeams.scenarios.studies.loop_wires import standard_loop
from flexbeams.scenarios.studies.planning import StudyPlan, prepare_study
from flexbeams.scenarios.studies.tasks import Assignment, Loop, Request, digest, reduced

CHECKED = 8  # runs of the batch kernel for each controller that go through the units as well


@dataclass(frozen=True, kw_only=True)
class Work:
    """Runs of one controller."""

    numbers: NDArray[np.int64]
    assignment: str  # SHA-256; empty where there is no such controller
    contents: Mapping[str, bytes | Path]  # by SHA-256
    failure: str = ""  # why there is no such controller

    def request(self, plan: StudyPlan, numbers: NDArray[np.int64], missing: tuple[str, ...] = ()) -> Request:
        """The request for some of the runs, with the contents that a worker said are missing."""
        sent = {}
        for name in missing:
            content = self.contents[name]
            sent[name] = content if isinstance(content, bytes) else content.read_bytes()
        return Request(
            assignment=self.assignment,
            needs=tuple(self.contents),
            numbers=numbers,
            values=plan.samples.values[numbers],
            contents=sent,
        )


def works(plan: StudyPlan, wanted: NDArray[np.bool_], notify: Callable[[str], None]) -> Iterator[Work]:
    """The work of each controller that has runs among the wanted ones; its units are built when it is asked for."""
    for options, numbers in plan.designs():
        numbers = numbers[wanted[numbers]]
        if not len(numbers):
            continue
        if isinstance(options, FlexbeamsError):
            yield Work(numbers=numbers, assignment="", contents={}, failure=str(options))
            continue
        own = options == plan.file.scenario.scenario.design
        try:
            prepared = plan.prepared if own else prepare_study(plan.file, plan.settings, options)
            yield _work(plan, prepared, numbers, notify)
        except FlexbeamsError as error:
            if own:
                raise
            yield Work(numbers=numbers, assignment="", contents={}, failure=str(error))


def _work(
    plan: StudyPlan, prepared: PreparedScenario, numbers: NDArray[np.int64], notify: Callable[[str], None]
) -> Work:
    contents: dict[str, bytes | Path] = {}
    columns = prepared.wiring.columns
    measured = {columns[k] for check in plan.checks for k in column_indices(columns, check.of)}
    loop = _loop(prepared, {*measured, *plan.signals}, contents, notify)
    with_measures = replace(loop.prepared, scenario=replace(loop.prepared.scenario, check=plan.checks))
    compared = prepared.open_loop
    if not any(check.measure in ("decay_time", "decay_ratio", "open_loop_peak") for check in plan.checks):
        compared = None
    batch, libraries = _batch(plan, prepared, contents, notify)
    assignment = Assignment(
        loop=replace(loop, prepared=with_measures),
        open_loop=None if compared is None else _loop(compared, measured, contents, notify),
        targets=tuple(axis.targets for axis in plan.axes),
        source=plan.source,
        signals=plan.signals,
        every=plan.every,
        batch=batch,
        libraries=libraries,
        checked=frozenset(numbers[np.linspace(0, len(numbers) - 1, min(CHECKED, len(numbers))).astype(int)].tolist()),
    )
    pickled = pickle.dumps(assignment)
    name = digest(pickled)
    return Work(numbers=numbers, assignment=name, contents={name: pickled, **contents})


def _batch(
    plan: StudyPlan, prepared: PreparedScenario, contents: dict[str, bytes | Path], notify: Callable[[str], None]
) -> tuple[BatchPlan | None, dict[str, str]]:
    """The plan for the batch kernel, None where it does not apply, and its libraries, which join the contents."""
    if not plan.batch or plan.signals or standard_loop(prepared) is None:
        return None, {}
    settings = prepared.settings
    library = stepper_library(settings.build_folder, settings.compiler)
    batch = batch_plan(prepared, plan.axes, plan.checks, unit_files(prepared, notify), library)
    libraries = {}
    for variant, file in (batch_libraries(settings.build_folder, settings.compiler) if batch else {}).items():
        libraries[variant] = digest(file.read_bytes())
        contents[libraries[variant]] = file
    return batch, libraries


def _loop(
    prepared: PreparedScenario, columns: set[str], contents: dict[str, bytes | Path], notify: Callable[[str], None]
) -> Loop:
    """The loop with only some columns recorded; its units are built, and added to the contents."""
    units = {}
    for name, file in unit_files(prepared, notify).items():
        units[name] = digest(file.read_bytes())
        contents[units[name]] = file
    library = ""
    if prepared.settings.backend == "native":
        built = stepper_library(prepared.settings.build_folder, prepared.settings.compiler)
        library = digest(built.read_bytes())
        contents[library] = built
    return Loop(prepared=reduced(lean(prepared), sorted(columns)), units=units, library=library)
