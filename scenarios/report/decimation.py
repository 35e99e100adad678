"""Decimation for plots: every stretch of a curve keeps its minimum and maximum, so that no peak is lost."""

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array


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
