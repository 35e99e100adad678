"""The data set of a study: a folder of Parquet files, to which batches of runs are added as they are done.

study.json says what the runs depend on; data/*.parquet has a row for each run, keyed by the hash of its inputs. Files
are written whole or not at all, so that a study which was killed goes on with the runs that are missing.
"""

import io
import json
import os
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.archive import write_whole
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.locks import Lock
from flexbeams.scenarios.studies.planning import StudyPlan
from flexbeams.scenarios.studies.tasks import Answer

HEADER = "study.json"
DATA = "data"
BATCH_ROWS, BATCH_SECONDS = 2000, 10.0  # of a file: whichever comes first


def require_parquet() -> None:
    """InputError where the package that reads and writes data sets is not installed."""
    if find_spec("pyarrow") is None:
        raise InputError("", "studies need the package pyarrow (pip install 'flexbeams[study]')")


@dataclass(frozen=True, kw_only=True)
class Results:
    """The runs of a plan that are done, in the order of the plan."""

    numbers: NDArray[np.int64]  # (done,) of the runs, ascending
    inputs: Array  # (done, axes)
    measures: Array  # (done, measures), NaN where a run failed
    failures: list[str]  # reasons, empty where a run is complete
    differences: Array  # (done,) of the batch kernel from the units, relative; NaN of runs that were not checked

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Which runs have measures."""
        return np.array([not text for text in self.failures], dtype=bool)


class DataSet:
    """The data set of a plan in a folder, locked; a context manager that writes what is left and releases it.

    `part` is k of n where several processes share the folder. Raises InputError for a folder that holds another study,
    or that another process writes to.
    """

    def __init__(self, plan: StudyPlan, folder: Path, part: tuple[int, int] = (1, 1)) -> None:
        require_parquet()
        self._plan, self.folder, self._part = plan, folder, part
        self._rows: dict[bytes, int] = {}  # the first run of each key
        self._same = np.array([self._rows.setdefault(key, k) for k, key in enumerate(plan.keys)], dtype=np.int64)
        self._answers: list[Answer] = []
        self._since = -BATCH_SECONDS  # the first answer is written at once
        self._lock = self._claimed()
        try:
            self._require_same_study()
            self._done = self._read_done()
        except InputError:
            self.__exit__(None, None, None)
            raise

    def _claimed(self) -> Lock | None:
        data = self.folder / DATA
        try:
            data.mkdir(parents=True, exist_ok=True)
            claim = data / f".part-{self._part[0]}-of-{self._part[1]}"
            claim.touch()
        except OSError as error:
            rule = f"cannot be made a folder for results: {error.strerror}"
            raise InputError("", rule, source=str(self.folder)) from None
        lock: Lock | None = None
        with suppress(OSError):  # a file system without locks
            lock = Lock(claim)
        if lock is not None and not lock.held:
            raise InputError("", "is in use by another study; wait for it, or use --out", source=str(self.folder))
        return lock

    def _require_same_study(self) -> None:
        path, header = self.folder / HEADER, self._plan.header()
        try:
            earlier = json.loads(path.read_bytes())
        except FileNotFoundError:
            earlier = None
        except (OSError, ValueError, RecursionError):
            earlier = {}
        if earlier is not None:
            if not isinstance(earlier, dict) or "fingerprint" not in earlier:
                raise InputError("", "is in the way and not that of a study; use --out", source=str(path))
            if earlier.get("flexbeams") != header["flexbeams"]:
                rule = f"holds results of flexbeams {earlier.get('flexbeams')}, not {header['flexbeams']}; use --out"
                raise InputError("", rule, source=str(path))
            if earlier["fingerprint"] != header["fingerprint"]:
                rule = "holds results of another study, or of other units; use --out"
                raise InputError("", rule, source=str(path))
        if earlier != header:
            write_whole(path, (json.dumps(header, indent=2) + "\n").encode())

    def _read_done(self) -> NDArray[np.bool_]:
        """Which runs are in the data set, of those that are the first with their inputs."""
        done = np.zeros(len(self._plan.keys), dtype=bool)
        for file in self.files():
            for key in _read(file, ["key"]).column("key").to_pylist():
                if (k := self._rows.get(key)) is not None:
                    done[k] = True
        return done

    @property
    def done(self) -> NDArray[np.bool_]:
        """Which runs of the plan are done."""
        done: NDArray[np.bool_] = self._done[self._same]
        return done

    @property
    def missing(self) -> NDArray[np.bool_]:
        """Which runs are to do; of runs with equal inputs the first."""
        return np.asarray(~self._done & (self._same == np.arange(len(self._same))), dtype=bool)

    def files(self) -> list[Path]:
        """The files of the data set."""
        return sorted((self.folder / DATA).glob("*.parquet"))

    def add(self, answer: Answer) -> None:
        """Adds runs; they are written with others after a while."""
        self._answers.append(answer)
        self._done[answer.numbers] = True
        rows = sum(len(a.numbers) for a in self._answers)
        if rows >= BATCH_ROWS or time.monotonic() - self._since > BATCH_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Writes what was added."""
        answers, self._answers, self._since = self._answers, [], time.monotonic()
        if not answers:
            return
        numbers = np.concatenate([a.numbers for a in answers])
        table = _table(self._plan, answers, numbers)
        # Numbers of the first and the last run, and of the process: no two writers choose one name
        name = f"runs-{numbers.min():07d}-{numbers.max():07d}-{len(self.files()):05d}-{os.getpid()}.parquet"
        write_whole(self.folder / DATA / name, _parquet(table))

    def results(self) -> Results:
        """All runs of the plan that are done."""
        self.flush()
        plan = self._plan
        measures = np.full((plan.samples.runs, len(plan.checks)), np.nan)
        failures = [""] * plan.samples.runs
        differences = np.full(plan.samples.runs, np.nan)
        for file in self.files():
            table = _read(file, ["key", "failure", "difference", *(c.name for c in plan.checks)])
            found = np.array([self._rows.get(key, -1) for key in table.column("key").to_pylist()], dtype=np.int64)
            values = np.column_stack([_numbers(table.column(c.name)) for c in plan.checks])
            measures[found[found >= 0]] = values[found >= 0]
            differences[found[found >= 0]] = _numbers(table.column("difference"))[found >= 0]
            for k, reason in zip(found.tolist(), table.column("failure").to_pylist(), strict=True):
                if k >= 0:
                    failures[k] = reason
        numbers = np.flatnonzero(self.done)
        same = self._same[numbers]
        return Results(
            numbers=numbers,
            inputs=plan.samples.values[numbers],
            measures=measures[same],
            failures=[failures[k] for k in same.tolist()],
            differences=differences[same],
        )

    def __enter__(self) -> "DataSet":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.flush()
        finally:
            if self._lock is not None:
                self._lock.release()


def _table(plan: StudyPlan, answers: Sequence[Answer], numbers: NDArray[np.int64]) -> Any:
    """A row for each run: run, inputs, measures, failure, key, and the signals that are kept."""
    import pyarrow as pa

    order = np.argsort(numbers, kind="stable")
    numbers = numbers[order]
    measures = np.concatenate([a.measures for a in answers])[order]
    failures = [text for a in answers for text in a.failures]
    fields, columns = [pa.field("run", pa.int64())], [_column(numbers, pa.int64())]

    def add(name: str, column: Any, unit: str = "") -> None:
        fields.append(pa.field(name, column.type, metadata={"unit": unit} if unit else None))
        columns.append(column)

    for k, axis in enumerate(plan.axes):
        add(axis.name, _column(plan.samples.values[numbers, k], pa.float64()), axis.unit)
    for k, check in enumerate(plan.checks):
        add(check.name, _column(measures[:, k], pa.float64()), check.unit)
    gaps = np.concatenate([a.differences if len(a.differences) else np.full(len(a.numbers), np.nan) for a in answers])
    add("difference", _column(gaps[order], pa.float64()))
    add("failure", _texts([failures[k] for k in order.tolist()]))
    add("key", _column(np.array([plan.keys[k] for k in numbers.tolist()], dtype="S16"), pa.binary(16)))
    kept = [a.signals for a in answers if a.signals is not None]
    if kept:
        signals = np.concatenate(kept)[order]
        for k, name in enumerate(plan.signals):
            values = _column(signals[:, :, k].ravel(), pa.float64())
            add(name, pa.FixedSizeListArray.from_arrays(values, signals.shape[1]))
    return pa.table(columns, schema=pa.schema(fields, metadata={"flexbeams": json.dumps(plan.header())}))


def _column(values: NDArray[Any], kind: Any) -> Any:
    """A column from the bytes of its values: pyarrow.array and to_numpy would import pandas, to ask about its types."""
    import pyarrow as pa

    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(np.ascontiguousarray(values))])


def _texts(texts: Sequence[str]) -> Any:
    """A column of texts from their bytes and where each of them begins."""
    import pyarrow as pa

    contents = [text.encode() for text in texts]
    begins = np.cumsum([0, *map(len, contents)], dtype=np.int32)
    buffers = [None, pa.py_buffer(begins), pa.py_buffer(b"".join(contents))]
    return pa.Array.from_buffers(pa.string(), len(contents), buffers)


def _parquet(table: Any) -> bytes:
    import pyarrow.parquet

    buffer = io.BytesIO()
    pyarrow.parquet.write_table(table, buffer)
    return buffer.getvalue()


def _read(file: Path, columns: Sequence[str]) -> Any:
    import pyarrow
    import pyarrow.parquet

    try:
        with pyarrow.parquet.ParquetFile(file) as opened:
            return opened.read(columns=list(columns)).select(list(columns))
    except (OSError, pyarrow.ArrowException, KeyError) as error:
        rule = f"is not a readable part of the data set: {' '.join(str(error).split())[:80]}; remove it to run again"
        raise InputError("", rule, source=str(file)) from None


def _numbers(column: Any) -> Array:
    """The doubles of a column without gaps."""
    parts = [np.frombuffer(c.buffers()[1], np.float64, len(c), 8 * c.offset) for c in column.chunks]
    return np.concatenate(parts or [np.zeros(0)])


def read_header(folder: Path) -> Mapping[str, Any]:
    """What study.json says; InputError where it cannot be read."""
    try:
        header = json.loads((folder / HEADER).read_bytes())
    except (OSError, ValueError) as error:
        raise InputError("", f"is not the folder of a study: {error}", source=str(folder)) from None
    return dict(header)
