"""Recording of a run: chosen signals at every step, or at every n-th."""

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from decimal import Decimal
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.dimensions import Conversion
from flexbeams.scenarios.definition.signals import TIME_TOLERANCE
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.frames import Frames
from flexbeams.scenarios.simulation.row_file import RowFile

BLOCK_BYTES = 2**24  # of rows of a file that are in memory together


@dataclass(kw_only=True)
class Recording:
    """Recorded signals: row k holds the values at time[k]; the last step is recorded whatever `decimate` is.

    The rows of a long recording are in a file: `time` and `values` are read from it where they are used. What looks at
    all rows goes through `blocks`, so that it needs little memory however long the recording is.
    """

    time: Array  # (rows,), s
    columns: list[str]  # <instance>.<variable>
    values: Array  # (rows, len(columns))
    wall_seconds: float  # of the stepping loop alone
    steps: int = 0  # done
    decimate: int = 1  # steps from row to row
    failure: UnitFailure | None = None
    interrupted: bool = False
    units: Mapping[str, str] = field(default_factory=dict)  # of measurement, by column, as far as they are known
    units_row: bool = False  # whether results.csv has them in its second row
    ended: str = ""  # which unit ended the run before its stop time, a regular end
    frames: Frames | None = None  # of the animation, if it was recorded
    deflection_columns: list[str] = field(default_factory=list)  # <instance>.w[beam,station], not among the columns
    deflections: Array | None = None  # their values (rows, len(deflection_columns)), m
    lateness: Array | None = None  # s, of each step of a paced run against the wall clock
    file: RowFile | None = None  # of the rows, if they are not in memory

    @property
    def complete(self) -> bool:
        """Whether the run reached its stop time, or the time at which a unit ended it."""
        return self.failure is None and not self.interrupted

    def blocks(self, first: int = 0, stop: int | None = None, rows: int | None = None) -> Iterator[tuple[Array, Array]]:
        """Time (k,) and values (k, columns) of the rows first ... stop - 1, in order; all at once if in memory.

        `rows` is their number in each block of a file, by default one that fits into BLOCK_BYTES.
        """
        for begin, end in self._spans(first, stop, rows):
            if self.file is None:
                yield self.time[begin:end], self.values[begin:end]
            else:
                block = self.file.read(begin, end)
                yield block[:, 0], block[:, 1:]

    def rows_before(self, time: float, *, equal: bool = False) -> int:
        """Number of rows with times < `time`, or with `equal` those <= `time`."""
        if self.file is None:
            return int(np.searchsorted(self.time, time, side="right" if equal else "left"))
        search, file = (bisect_right if equal else bisect_left), self.file
        return search(range(file.count), time, key=lambda k: float(file.read(k, k + 1)[0, 0]))

    def rows_between(self, start: float, stop: float) -> tuple[int, int]:
        """First row at or after `start` s, and the one behind the last at or before `stop` s, but for rounding."""
        return self.rows_before(start - TIME_TOLERANCE), self.rows_before(stop + TIME_TOLERANCE, equal=True)

    def change(self, function: Callable[[Array, Array, bool], None]) -> None:
        """Changes the values in place, block by block: function(time, values, whether it is the last block)."""
        for begin, end in self._spans(0, None, None):
            last = end == len(self.time)
            if self.file is None:
                function(self.time, self.values, last)
            else:
                block = self.file.read(begin, end)
                function(block[:, 0], block[:, 1:], last)
                self.file.write(begin, block)

    def _spans(self, first: int, stop: int | None, rows: int | None) -> Iterator[tuple[int, int]]:
        """First and end row of each block."""
        last = len(self.time) if stop is None else min(stop, len(self.time))
        if self.file is None:
            size = max(last - first, 1)
        else:
            size = rows or max(1, BLOCK_BYTES // (8 * self.file.width))
        for begin in range(first, last, size):
            yield begin, min(begin + size, last)

    def release(self) -> None:
        """Removes the file of the rows, which are gone then."""
        if self.file is not None:
            self.time, self.values = np.empty(0), np.empty((0, len(self.columns)))
            self.file.close()
            self.file = None


def step_times(numbers: NDArray[np.int64], step: float) -> Array:
    """numbers * step, s, rounded to the decimals of the step: 3 * 2e-4 is 0.0006, not 0.0006000000000000001."""
    per_step, scale = decimal_ticks(step)
    ticks = numbers * per_step
    if scale > 10**15 or np.max(np.abs(ticks), initial=0) > 2**53:
        return np.asarray(numbers * step, dtype=np.float64)
    exact: Array = ticks / scale
    return exact


def decimal_ticks(step: float) -> tuple[int, int]:
    """Whole numbers whose ratio is the step: 2 and 10000 for 2e-4."""
    decimals = -int(Decimal(repr(float(step))).as_tuple().exponent)
    scale = 10 ** max(decimals, 0)
    return round(step * scale), scale


class Rows:
    """Rows of a recording in the making, which steppers fill: row ceil(n / decimate) is of step n.

    With a file, only the latest rows are in memory. `converted` are columns of inputs that take other units.
    """

    def __init__(
        self,
        signals: Array,
        recorded: NDArray[np.int64],
        steps: int,
        decimate: int,
        *,
        step: float,
        start_time: float = 0.0,
        converted: Mapping[int, Conversion] = MappingProxyType({}),
        file: RowFile | None = None,
    ) -> None:
        self._signals, self._recorded, self.decimate = signals, recorded, decimate
        self._step, self._start_time, self._converted, self._file = step, start_time, converted, file
        self._first = 0  # row of the recording that is the first one in memory
        room = self.count(steps)
        if file is not None:
            room = min(room, max(2, BLOCK_BYTES // (8 * file.width)))
        self.values = np.empty((room, len(recorded)))

    def count(self, done: int) -> int:
        """Number of rows after `done` steps."""
        return -(-done // self.decimate) + 1

    @property
    def first(self) -> int:
        """Row of the recording that `values` begin with."""
        return self._first

    def room(self, number: int, count: int) -> int:
        """How many of `count` steps from step `number` on `values` have rows for, at least one."""
        if self.count(number + count - 1) - self._first > len(self.values):
            row = self.count(number) - 1
            self._put(row, row * self.decimate)
        return min(count, (self._first + len(self.values) - 1) * self.decimate - number + 1)

    def take(self, done: int) -> None:
        """The signals as they are after `done` steps."""
        self.room(done, 1)
        np.take(self._signals, self._recorded, out=self.values[self.count(done) - 1 - self._first])

    def copy(self, done: int) -> "Rows":
        """Rows of their own, of the first `done` steps; of a recording in memory."""
        copied = copy(self)
        copied.values = self.values[: self.count(done)].copy()
        return copied

    def recording(
        self, columns: Sequence[str], done: int, wall_seconds: float, deflections: Sequence[str] = ()
    ) -> Recording:
        """The recording of the first `done` steps; `deflections` follow the columns in each row, without a file."""
        count = self.count(done)
        if self._file is None:
            time, values = self._converted_rows(count, done)
        else:
            self._put(count, done)
            mapped = self._file.mapped()
            time, values = mapped[:, 0], mapped[:, 1:]
        return Recording(
            time=time,
            columns=list(columns),
            values=np.ascontiguousarray(values[:, : len(columns)]) if deflections else values,
            wall_seconds=wall_seconds,
            steps=done,
            decimate=self.decimate,
            file=self._file,
            deflection_columns=list(deflections),
            deflections=values[:, len(columns) :] if deflections else None,
        )

    def _converted_rows(self, stop: int, done: int) -> tuple[Array, Array]:
        """Times and values of the rows in memory up to row `stop`, none later than step `done`."""
        values = self.values[: stop - self._first]
        for column, conversion in self._converted.items():
            values[:, column] *= conversion.factor
            values[:, column] += conversion.offset
        numbers = np.minimum(np.arange(self._first, stop) * self.decimate, done)
        return step_times(numbers, self._step) + self._start_time, values

    def _put(self, stop: int, done: int) -> None:
        """Moves the rows before row `stop` into the file."""
        assert self._file is not None
        time, values = self._converted_rows(stop, done)
        self._file.append(np.column_stack([time, values]))
        self._first = stop
