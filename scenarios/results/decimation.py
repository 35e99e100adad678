"""Decimation for plots: every stretch of a curve keeps its minimum and maximum, so that no peak is lost."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.scenarios.simulation.recording import Recording

_STRETCHES = 2000  # of a recording whose rows are in a file
_THINNED_BYTES = 2**27  # of the rows that are kept of it, at most


class Thinning:
    """Few rows of a long table that is given block by block: those with the minimum and maximum of any column in each
    of many stretches; all rows of a short one.
    """

    def __init__(self, count: int, columns: int) -> None:
        """`count` rows of a time and so many columns are to come."""
        width = 1 + columns
        if 8 * count * width <= _THINNED_BYTES // 4:
            self._stretch = 1
        else:
            self._stretch = -(-count // min(_STRETCHES, max(1, _THINNED_BYTES // (16 * width * columns))))
        self._rest = (np.empty(0), np.empty((0, columns)))
        self._kept = [self._rest]

    def add(self, time: Array, values: Array) -> None:
        """Takes the next rows (k,), (k, columns)."""
        if len(self._rest[0]):
            time, values = np.concatenate([self._rest[0], time]), np.concatenate([self._rest[1], values])
        whole = len(time) // self._stretch * self._stretch
        self._keep(time[:whole], values[:whole])
        self._rest = (time[whole:].copy(), values[whole:].copy())

    def taken(self) -> tuple[Array, Array]:
        """The rows that are kept of all."""
        self._keep(*self._rest)
        time, values = zip(*self._kept, strict=True)
        return np.concatenate(time), np.concatenate(values)

    def _keep(self, time: Array, values: Array) -> None:
        if len(time):
            rows = _extremes(values, self._stretch) if self._stretch > 1 else slice(None)
            self._kept.append((time[rows].copy(), values[rows].copy()))


def thinned(recording: Recording, start: float = -np.inf, stop: float = np.inf) -> Recording:
    """A recording in memory that is drawn as this one from `start` to `stop` s: itself, or the rows of a Thinning."""
    if recording.file is None:
        return recording
    first, last = recording.rows_between(start, stop)
    thinning = Thinning(last - first, len(recording.columns))
    for time, values in recording.blocks(first, last):
        thinning.add(time, values)
    time, values = thinning.taken()
    return replace(recording, time=time, values=values, file=None)


def plotted_rows(values: Array, limit: int) -> NDArray[np.intp]:
    """Indices of the rows of values (rows, curves) to plot, ascending, at most about `limit`.

    The rows are cut into stretches. Each keeps the rows of every curve's minimum and maximum; the first and the last
    row are kept too. Stretches are doubled until the limit holds. NaN is ignored.
    """
    rows = len(values)
    if rows <= limit:
        return np.arange(rows)
    stretch = int(np.ceil(2 * rows / limit))
    while True:
        selected = _extremes(values, stretch)
        if len(selected) <= limit or stretch >= rows:
            return selected
        stretch *= 2


def decimated(time: Array, values: Array, limit: int) -> tuple[Array, Array]:
    """One curve (rows,) with the rows of `plotted_rows`."""
    rows = plotted_rows(values[:, None], limit)
    return time[rows], values[rows]


def _extremes(values: Array, stretch: int) -> NDArray[np.intp]:
    rows, curves = values.shape
    columns = np.ascontiguousarray(values.T)  # searched along the rows, which are beside each other then
    whole = rows // stretch * stretch
    missing = np.isnan(columns) if np.isnan(columns.sum()) else None
    first = np.arange(0, whole, stretch)
    found = [np.array([0, rows - 1])]
    for absent, index in ((np.inf, np.argmin), (-np.inf, np.argmax)):
        filled = columns if missing is None else np.where(missing, absent, columns)
        found.append((first + index(filled[:, :whole].reshape(curves, -1, stretch), axis=2)).ravel())
        if whole < rows:
            found.append(whole + index(filled[:, whole:], axis=1))
    return np.unique(np.concatenate(found))
