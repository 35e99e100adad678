"""Fewer rows for a plot: every stretch of a curve keeps its least and its largest value, so no peak is lost."""

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array


def kept_rows(values: Array, limit: int) -> NDArray[np.intp]:
    """Rows of values (rows, curves) that a plot of all the curves needs, ascending: at most about `limit`.

    The rows are cut into stretches; of each the rows of every curve's least and largest value stay, and the first
    and the last row of all. Stretches widen until the limit holds. NaN counts as absent.
    """
    rows = len(values)
    if rows <= limit:
        return np.arange(rows)
    stretch = int(np.ceil(2 * rows / limit))
    while True:
        kept = _extremes(values, stretch)
        if len(kept) <= limit or stretch >= rows:
            return kept
        stretch *= 2


def decimated(time: Array, values: Array, limit: int) -> tuple[Array, Array]:
    """One curve (rows,) by `kept_rows`."""
    kept = kept_rows(values[:, None], limit)
    return time[kept], values[kept]


def _extremes(values: Array, stretch: int) -> NDArray[np.intp]:
    rows, curves = values.shape
    padding = -rows % stretch
    first = np.arange((rows + padding) // stretch)[:, None] * stretch
    found = []
    for absent, place in ((np.inf, np.argmin), (-np.inf, np.argmax)):
        filled = np.pad(np.where(np.isnan(values), absent, values), ((0, padding), (0, 0)), constant_values=absent)
        found.append((first + place(filled.reshape(-1, stretch, curves), axis=1)).ravel())
    return np.unique(np.minimum(np.concatenate([*found, [0, rows - 1]]), rows - 1))
