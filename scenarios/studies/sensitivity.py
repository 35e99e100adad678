"""Which inputs explain a measure: Sobol's indices of inputs, or of groups of inputs, with intervals.

From a Saltelli design first-order and total indices, by the estimators of Saltelli et al. 2010 (table 2 b, f); their
intervals are percentiles of a bootstrap over base points. From any other independent samples first-order indices: for
one input by its ranks (Chatterjee; Gamboa, Gremaud, Klein and Lagnoux 2022), for a group by nearest neighbours in
its space (Broto, Bachoc and Depecker 2020):

    S = (1/n sum_i y_i y_N(i) - mean^2) / variance,  N(i) the neighbour of i in the inputs concerned.

Their intervals are from random halves of the samples, since a bootstrap would make each sample its own neighbour.
Runs that failed are left out before anything is estimated: one NaN would spoil all indices.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import norm, rankdata

from flexbeams.plant.basis import Array
from flexbeams.scenarios.studies.dataset import Results
from flexbeams.scenarios.studies.planning import StudyPlan

CONFIDENCE = 0.95
RESAMPLES = 400
LEAST = 16  # samples, or base points, for an estimate
SEED = 1  # of the resampling


@dataclass(frozen=True, kw_only=True)
class Index:
    """Shares of a measure's variance that an input explains, each with a 95 % interval."""

    first: float  # alone
    first_low: float
    first_high: float
    total: float | None = None  # with all interactions
    total_low: float | None = None
    total_high: float | None = None

    @property
    def importance(self) -> float:
        """By which inputs are ordered: the total index where it is known."""
        return self.first if self.total is None else self.total


@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """Indices by group of inputs, the most important first."""

    estimator: str  # saltelli, ranks, or none where there are too few samples or nothing varies
    runs: int  # that were used
    left_out: int  # failed ones, and those of a Saltelli block with a failed one
    indices: Mapping[str, Index]


def sensitivity(plan: StudyPlan, results: Results, column: int) -> Sensitivity:
    """The indices of one measure."""
    groups, complete = plan.samples.groups, results.complete
    if plan.samples.method == "saltelli":
        y = np.full(plan.samples.runs, np.nan)
        y[results.numbers[complete]] = results.measures[complete, column]
        blocks = y.reshape(-1, len(groups) + 2)
        whole = blocks[np.all(np.isfinite(blocks), axis=1)]
        found = saltelli_indices(whole)
        used = whole.size
        estimator = "saltelli"
    else:
        values, y = results.inputs[complete], results.measures[complete, column]
        columns = [[k for k, axis in enumerate(plan.axes) if axis.group == group] for group in groups]
        found = rank_indices(values, y, columns)
        used, estimator = len(y), "ranks"
    named = dict(zip(groups, found, strict=True)) if found else {}
    ordered = sorted(named, key=lambda group: -named[group].importance)
    return Sensitivity(
        estimator=estimator if found else "none",
        runs=used,
        left_out=len(results.numbers) - used,
        indices={group: named[group] for group in ordered},
    )


def saltelli_indices(blocks: Array) -> list[Index]:
    """Indices of groups from outputs (N, groups + 2) in the order of a Saltelli design; empty where nothing varies."""
    n = len(blocks)
    if n < LEAST or np.ptp(blocks[:, :2]) == 0:
        return []
    generator = np.random.default_rng(SEED)
    first, total = _saltelli(blocks)
    resampled = [_saltelli(blocks[generator.integers(n, size=n)]) for _ in range(RESAMPLES)]
    firsts, totals = (np.stack([sample[k] for sample in resampled]) for k in (0, 1))
    ends = [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]
    first_ends, total_ends = np.quantile(firsts, ends, axis=0), np.quantile(totals, ends, axis=0)
    return [
        Index(
            first=float(first[g]),
            first_low=float(first_ends[0, g]),
            first_high=float(first_ends[1, g]),
            total=float(total[g]),
            total_low=float(total_ends[0, g]),
            total_high=float(total_ends[1, g]),
        )
        for g in range(len(first))
    ]


def _saltelli(blocks: Array) -> tuple[Array, Array]:
    """First-order and total indices: mean(B (AB - A)) / V and mean((A - AB)^2) / (2 V), with the mean taken off."""
    centred = blocks - blocks[:, :2].mean()
    A, B, AB = centred[:, :1], centred[:, 1:2], centred[:, 2:]
    variance = float(np.mean(centred[:, :2] ** 2)) or 1.0
    first: Array = np.mean(B * (AB - A), axis=0) / variance
    total: Array = np.mean((A - AB) ** 2, axis=0) / (2 * variance)
    return first, total


def rank_indices(inputs: Array, y: Array, groups: list[list[int]]) -> list[Index]:
    """First-order indices of groups of columns of independent inputs (n, d); empty where nothing varies."""
    n = len(y)
    if n < LEAST or np.ptp(y) == 0:
        return []
    generator = np.random.default_rng(SEED)
    halves = [generator.permutation(n)[: n // 2] for _ in range(min(RESAMPLES, 100))]
    width = float(norm.ppf((1 + CONFIDENCE) / 2))
    found = []
    for columns in groups:
        value = _by_neighbours(inputs[:, columns], y)
        spread = float(np.std([_by_neighbours(inputs[half][:, columns], y[half]) for half in halves]))
        # The variance of half the samples, drawn without replacement, about the estimate from all is that of all
        found.append(Index(first=value, first_low=value - width * spread, first_high=value + width * spread))
    return found


def _by_neighbours(inputs: Array, y: Array) -> float:
    centred = y - y.mean()
    variance = float(np.mean(centred**2))
    if variance == 0:
        return 0.0
    return float(np.mean(centred * centred[_neighbours(inputs)]) / variance)


def _neighbours(inputs: Array) -> NDArray[np.int64]:
    """For each sample another one near it: the next in rank of one input, the last one's is the first."""
    n, d = inputs.shape
    if d == 1:
        order = np.argsort(inputs[:, 0], kind="stable")
        neighbours = np.empty(n, dtype=np.int64)
        neighbours[order] = np.roll(order, -1)
        return neighbours
    ranks = rankdata(inputs, axis=0) / n
    _, found = cKDTree(ranks).query(ranks, k=2)
    own = found[:, 0] == np.arange(n)
    return np.asarray(np.where(own, found[:, 1], found[:, 0]), dtype=np.int64)
