"""Decimation for plots: every stretch of a curve keeps its minimum and maximum, so that no peak is lost."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.scenarios.simulation.recording import BLOCK_BYTES, Recording

_STRETCHES = 2000  # of a recording whose rows are in a file
_THINNED_BYTES = 2**27  # of the rows that are kept of it, at most


def thinned(recording: Recording, start: float = -np.inf, stop: float = np.inf) -> Recording:
    """A recording in memory that is drawn as this one from `start` to `stop` s.

    If its rows are in a file, it has those with the minimum and maximum of any column in each of many stretches.
    """
    if recording.file is None:
        return recording
    first, last = recording.rows_between(start, stop)
    count, width = last - first, recording.file.width
    if 8 * count * width <= _THINNED_BYTES // 4:
        stretch = 1
    else:
        stretch = -(-count // min(_STRETCHES, max(1, _THINNED_BYTES // (16 * width * len(recording.columns)))))
    size = max(1, BLOCK_BYTES // (8 * width * stretch)) * stretch
    time, values = [np.empty(0)], [np.empty((0, len(recording.columns)))]
    for part, rows in recording.blocks(first, last, size):
        kept = _extremes(rows, stretch) if stretch > 1 else np.arange(len(rows))
        time.append(part[kept])
        values.append(rows[kept])
    return replace(recording, time=np.concatenate(time), values=np.concatenate(values), file=None)


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
    padding = -rows % stretch
    first = np.arange((rows + padding) // stretch)[:, None] * stretch
    extremes = []
    for absent, index in ((np.inf, np.argmin), (-np.inf, np.argmax)):
        filled = np.pad(np.where(np.isnan(values), absent, values), ((0, padding), (0, 0)), constant_values=absent)
        extremes.append((first + index(filled.reshape(-1, stretch, curves), axis=1)).ravel())
    return np.unique(np.minimum(np.concatenate([*extremes, [0, rows - 1]]), rows - 1))
