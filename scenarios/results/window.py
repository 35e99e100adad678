"""A window of a recording: some columns between two times, looked at in parts that fit into memory."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.simulation.recording import Recording


@dataclass(frozen=True, kw_only=True)
class Window:
    """Rows first ... stop - 1 of some columns."""

    recording: Recording
    columns: list[int]
    first: int
    stop: int

    @classmethod
    def between(cls, recording: Recording, columns: list[int], after: float, before: float | None) -> "Window":
        """The rows from `after` to `before` s, without it to the end; there may be none."""
        last = recording.time[-1] if before is None else before
        first, stop = recording.rows_between(after, last)
        return cls(recording=recording, columns=columns, first=first, stop=stop)

    def __len__(self) -> int:
        return max(0, self.stop - self.first)

    @property
    def begin(self) -> Array:
        """The first row (columns,)."""
        return self._row(self.first)

    @property
    def end(self) -> Array:
        """The last row (columns,)."""
        return self._row(self.stop - 1)

    def parts(self) -> Iterator[tuple[Array, Array]]:
        """Time (k,) and values (k, columns), in order."""
        for time, values in self.recording.blocks(self.first, self.stop):
            yield time, values[:, self.columns]

    def largest(self, measure: Callable[[Array, Array], float | Array]) -> Array:
        """The largest values of a measure of time and values over all parts; NaN is larger than any number."""
        found: Array = np.max(np.array([measure(time, y) for time, y in self.parts()]), axis=0)
        return found

    def largest_change(self) -> float:
        """The largest |change| of any column from row to row; needs two rows."""
        largest, before = 0.0, None
        for _, y in self.parts():
            rows = y if before is None else np.concatenate([before, y])
            largest = float(np.max(np.abs(np.diff(rows, axis=0)), initial=largest))
            before = y[-1:]
        return largest

    def share(self, condition: Callable[[Array], Array]) -> float:
        """Share of the rows for which a condition of values (k, columns) holds."""
        return sum(int(np.count_nonzero(condition(y))) for _, y in self.parts()) / len(self)

    def _row(self, number: int) -> Array:
        return np.array(next(self.recording.blocks(number, number + 1))[1][0, self.columns])
