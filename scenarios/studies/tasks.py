"""What a worker does: runs of one assignment, in instances that it makes once.

An assignment and the files that it needs are known by their SHA-256. A worker that lacks some of them answers with
their names, and the request comes again with their contents: so units reach workers on any machine, each once.
"""

import hashlib
import pickle
import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from multiprocessing.util import Finalize
from pathlib import Path
from time import thread_time

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import FlexbeamsError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.settings import StartValues
from flexbeams.scenarios.results.checks import Measurement
from flexbeams.scenarios.runs.prepare import PreparedRun
from flexbeams.scenarios.runs.repeated import RepeatedRun
from flexbeams.scenarios.simulation.batch_kernel import Batch
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.studies.axes import Target
from flexbeams.scenarios.studies.batch import BatchPlan


@dataclass(frozen=True, kw_only=True)
class Loop:
    """A run to repeat, and its units by the SHA-256 of their files."""

    prepared: PreparedRun
    units: Mapping[str, str]  # by instance
    library: str  # the stepping loop; empty without native units


@dataclass(frozen=True, kw_only=True)
class Assignment:
    """What the runs of one controller have in common."""

    loop: Loop  # with the measures as checks of its scenario
    open_loop: Loop | None  # that runs are compared with
    targets: tuple[tuple[Target, ...], ...]  # of each axis
    source: str  # the study's file
    signals: tuple[str, ...]  # columns that are kept
    every: int  # how many steps apart
    batch: BatchPlan | None = None  # the same runs through the batch kernel
    libraries: Mapping[str, str] = field(default_factory=dict)  # SHA-256 of the batch kernel by variant
    checked: frozenset[int] = frozenset()  # runs that go through the units as well

    def starts(self, values: Array, instances: Sequence[str]) -> dict[str, StartValues]:
        """Start values by instance for the values of all axes."""
        starts: dict[str, StartValues] = {}
        for targets, value in zip(self.targets, values, strict=True):
            for target in targets:
                if target.instance in instances:
                    starts.setdefault(target.instance, {})[target.variable] = float(value) * target.factor
        return starts


@dataclass(frozen=True, kw_only=True)
class Request:
    """Runs to do, and what the worker needs for them."""

    assignment: str  # SHA-256
    needs: tuple[str, ...]  # SHA-256 of the assignment and of all files
    numbers: NDArray[np.int64]  # (k,) of the runs
    values: Array  # (k, axes)
    contents: Mapping[str, bytes] = field(default_factory=dict)  # by SHA-256, what the worker said is missing


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Results of the runs of a request, or what is missing for them."""

    missing: tuple[str, ...] = ()
    numbers: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    measures: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (k, measures), NaN where a run failed
    failures: tuple[str, ...] = ()  # reasons, empty where a run is complete
    signals: Array | None = None  # (k, rows, columns)
    differences: Array = field(default_factory=lambda: np.zeros(0))  # (k,) from the units, NaN of runs not checked
    seconds: float = 0.0  # CPU time of the thread


def digest(content: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def answer(request: Request) -> Answer:
    """Does the runs of a request in this process."""
    missing = _store.missing(request)
    if missing:
        return Answer(missing=missing)
    begin = thread_time()
    runs = _own_runs(request).results(request.numbers, request.values)
    signals = [run.signals for run in runs if run.signals is not None]
    return Answer(
        numbers=request.numbers,
        measures=np.stack([run.measures for run in runs]),
        failures=tuple(run.failure for run in runs),
        signals=np.stack(signals) if signals else None,
        differences=np.array([run.difference for run in runs]),
        seconds=thread_time() - begin,
    )


def difference(measures: Array, others: Array, scales: Array) -> float:
    """The largest difference of two sets of measures relative to their scales; 0 where a scale is 0."""
    gaps = np.abs(measures - others)
    return float(np.max(np.divide(gaps, scales, out=np.zeros_like(gaps), where=scales > 0)))


@dataclass(frozen=True, kw_only=True)
class _Result:
    measures: Array
    failure: str
    signals: Array | None
    difference: float = np.nan


class _Store:
    """Contents that this process has received, by SHA-256; files are in a temporary folder."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._stack = ExitStack()
        self._folder: Path | None = None
        self._known: set[str] = set()

    def missing(self, request: Request) -> tuple[str, ...]:
        """Takes what the request brings, and returns what is still missing for it."""
        with self._lock:
            if self._folder is None:
                self._folder = self._stack.enter_context(temporary_folder())
                Finalize(self, self._stack.close, exitpriority=10)
            for name, content in request.contents.items():
                if name not in self._known:
                    if digest(content) != name:
                        raise FlexbeamsError("a file reached a worker damaged")
                    self.path(name).write_bytes(content)
                    self._known.add(name)
            return tuple(name for name in request.needs if name not in self._known)

    def path(self, name: str) -> Path:
        """The file of a content."""
        assert self._folder is not None
        return self._folder / f"{name}.fmu"


_store = _Store()
_own = threading.local()  # each thread has instances of its own


def _own_runs(request: Request) -> "_Runs":
    """The instances of this thread, those of another assignment are freed."""
    current: _Runs | None = getattr(_own, "runs", None)
    if current is None or current.name != request.assignment:
        if current is not None:
            current.close()
        current = _own.runs = _Runs(request.assignment)
    return current


class _Runs:
    """Repeated runs of an assignment."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._assignment: Assignment = pickle.loads(_store.path(name).read_bytes())
        self._loop = self._repeated(self._assignment.loop)
        compared = self._assignment.open_loop
        self._open_loop = None if compared is None else self._repeated(compared)
        self._compared: tuple[dict[str, StartValues], Recording] | None = None  # last run of the open loop
        self._batch: Batch | None = None
        if self._assignment.batch is not None:
            libraries = {variant: _store.path(name) for variant, name in self._assignment.libraries.items()}
            self._batch = Batch(self._assignment.batch.task, libraries)

    @staticmethod
    def _repeated(loop: Loop) -> RepeatedRun:
        files = {name: _store.path(unit) for name, unit in loop.units.items()}
        return RepeatedRun(loop.prepared, files, _store.path(loop.library) if loop.library else None)

    def results(self, numbers: NDArray[np.int64], values: Array) -> list[_Result]:
        """The runs of these numbers: through the batch kernel where that applies, else one by one."""
        plan = self._assignment.batch
        if plan is None or self._batch is None:
            return [self.result(row) for row in values]
        figures, covered = self._batch.run(plan.values(values))
        measures, scales = plan.measured(figures), plan.scales(figures)
        found = []
        for k, (number, row) in enumerate(zip(numbers.tolist(), values, strict=True)):
            own, is_covered = measures[k], covered[k]
            if not is_covered or not np.all(np.isfinite(own)):
                found.append(self.result(row))
                continue
            gap = np.nan
            if number in self._assignment.checked:
                other = self.result(row)
                gap = np.inf if other.failure else difference(own, other.measures, scales[k])
            found.append(_Result(measures=own, failure="", signals=None, difference=gap))
        return found

    def result(self, values: Array) -> _Result:
        """Measures of one run; its failure is one line."""
        assignment = self._assignment
        prepared = assignment.loop.prepared
        try:
            recording = self._loop.run(assignment.starts(values, list(assignment.loop.units)))
            if recording.failure is not None:
                raise recording.failure
            measurement = Measurement(prepared.scenario, assignment.source, recording, self._open(values))
            measures = np.array([o.value for o in measurement.outcomes()])
            for check, value in zip(prepared.scenario.check, measures, strict=True):
                if not np.isfinite(value):
                    raise FlexbeamsError(f"{check.name} is {value:g}")
        except FlexbeamsError as error:
            return self._failed(str(error))
        return _Result(measures=measures, failure="", signals=self._kept(recording))

    def _failed(self, reason: str) -> _Result:
        prepared = self._assignment.loop.prepared
        signals = None
        if self._assignment.signals:
            rows = prepared.steps // self._assignment.every + 1
            signals = np.full((rows, len(self._assignment.signals)), np.nan)
        return _Result(measures=np.full(len(prepared.scenario.check), np.nan), failure=reason, signals=signals)

    def _kept(self, recording: Recording) -> Array | None:
        if not self._assignment.signals:
            return None
        columns = [recording.columns.index(name) for name in self._assignment.signals]
        rows = self._assignment.loop.prepared.steps // self._assignment.every + 1
        kept = np.full((rows, len(columns)), np.nan)  # behind the end of a run that a unit ended
        part = recording.values[:: self._assignment.every, columns][:rows]
        kept[: len(part)] = part
        return kept

    def _open(self, values: Array) -> Recording | None:
        """The open loop's run; the last one where it does not depend on what changed."""
        if self._open_loop is None or self._assignment.open_loop is None:
            return None
        starts = self._assignment.starts(values, list(self._assignment.open_loop.units))
        if self._compared is None or self._compared[0] != starts:
            recording = self._open_loop.run(starts)
            if recording.failure is not None:
                raise recording.failure
            self._compared = starts, recording
        return self._compared[1]

    def close(self) -> None:
        """Frees the instances."""
        self._loop.close()
        if self._batch is not None:
            self._batch.close()
        if self._open_loop is not None:
            self._open_loop.close()


def reduced(prepared: PreparedRun, columns: Sequence[str]) -> PreparedRun:
    """The run with only these columns recorded."""
    wiring = prepared.wiring
    chosen = [k for k, name in enumerate(wiring.columns) if name in columns]
    converted = {n: wiring.converted_columns[k] for n, k in enumerate(chosen) if k in wiring.converted_columns}
    return replace(
        prepared,
        wiring=replace(
            wiring,
            columns=[wiring.columns[k] for k in chosen],
            recorded=[wiring.recorded[k] for k in chosen],
            converted_columns=converted,
            deflections=[],
        ),
    )
