"""Failure boundaries: how the share of runs that break a limit depends on each input alone."""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.scenarios.report.charts import axis, chart

BANDS = 10  # of equally many runs, over an input
LEAST = 5  # runs of a band
SHOWN = 6  # inputs whose charts are drawn


class Varied(Protocol):
    """An input: see PageInput."""

    @property
    def name(self) -> str: ...
    @property
    def nominal(self) -> float: ...
    @property
    def values(self) -> Array: ...


class Limited(Protocol):
    """A measure: see PageMeasure."""

    @property
    def name(self) -> str: ...
    @property
    def values(self) -> Array: ...
    @property
    def limited(self) -> bool: ...
    @property
    def outside(self) -> NDArray[np.bool_]: ...


def _broken(measures: Sequence[Limited]) -> NDArray[np.bool_]:
    """Which runs break any limit, or have failed."""
    failed = np.any([~np.isfinite(m.values) for m in measures], axis=0)
    return np.asarray(np.any([m.outside for m in measures if m.limited] + [failed], axis=0), dtype=bool)


def _bands(values: Array) -> list[NDArray[np.int64]]:
    """Runs in order of an input, in bands of equally many; of few distinct values a band each."""
    distinct, index = np.unique(values, return_inverse=True)
    if len(distinct) <= BANDS:
        return [np.flatnonzero(index == k) for k in range(len(distinct))]
    count = min(BANDS, max(1, len(values) // LEAST))
    return [np.asarray(band) for band in np.array_split(np.argsort(values, kind="stable"), count)]


def _scale(item: Varied) -> tuple[float, str]:
    """A factor of an input for display, and what it is then: relative to the scenario's own value if that is not 0."""
    return (1 / item.nominal, "of its own value") if item.nominal else (1.0, "")


def boundary_rows(inputs: Sequence[Varied], measures: Sequence[Limited]) -> list[dict[str, Any]]:
    """For each input the share of runs beyond a limit at its low end, in the middle and at its high end.

    The inputs with the largest differences come first; empty where no run breaks a limit or all do.
    """
    if not measures or not any(m.limited for m in measures):
        return []
    broken = _broken(measures)
    if not broken.any() or broken.all():
        return []
    rows = []
    for item in inputs:
        bands = _bands(item.values)
        shares = [float(np.mean(broken[band])) for band in bands]
        factor, _ = _scale(item)
        gaps = np.abs(item.values[broken] - item.nominal)
        nearest = float(item.values[broken][np.argmin(gaps)]) * factor
        middle = shares[(len(shares) - 1) // 2 : len(shares) // 2 + 1]
        texts = [f"{100 * share:.0f} %" for share in (shares[0], float(np.mean(middle)), shares[-1])]
        rows.append(
            {"name": item.name, "cells": texts, "nearest": f"{nearest:.4g}", "spread": max(shares) - min(shares)}
        )
    return sorted(rows, key=lambda row: -float(row["spread"]))


def boundary_charts(inputs: Sequence[Varied], measures: Sequence[Limited]) -> list[dict[str, Any]]:
    """The share of runs beyond each limit over the inputs on which it depends most."""
    order = [row["name"] for row in boundary_rows(inputs, measures)[:SHOWN]]
    by_name = {item.name: item for item in inputs}
    return [_chart(by_name[name], [m for m in measures if m.limited]) for name in order]


def _chart(item: Varied, measures: Sequence[Limited]) -> dict[str, Any]:
    bands = _bands(item.values)
    factor, note = _scale(item)
    x = np.array([factor * float(np.median(item.values[band])) for band in bands])
    order = np.argsort(x, kind="stable")
    curves = {
        m.name: 100 * np.array([np.mean(m.outside[band] | ~np.isfinite(m.values[band])) for band in bands])[order]
        for m in measures
    }
    return chart(item.name, ({**axis(note or "value"), "short": "at"}, x[order]), axis("% outside", unit="%"), curves)
