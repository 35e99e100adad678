"""Which inputs explain a measure: Sobol's indices of inputs, or of groups of inputs, with intervals.

From a Saltelli design first-order and total indices, by the estimators of Saltelli et al. 2010 (table 2 b, f); their
intervals are percentiles of a bootstrap over base points. From any other independent samples first-order indices: for
one input by its ranks (Chatterjee; Gamboa, Gremaud, Klein and Lagnoux 2022), for a group by nearest neighbours in
its space (Broto, Bachoc and Depecker 2020):

    S = (1/n sum_i y_i y_N(i) - mean^2) / variance,  N(i) the neighbour of i in the inputs concerned.

Their intervals are from random halves of the samples, since a bootstrap would make each sample its own neighbour.
Runs that failed are left out before anything is estimated: one NaN would spoil all indices.
"""

from collections.abc import Mapping, Sequence
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


def sensitivities(plan: StudyPlan, results: Results, columns: Sequence[int]) -> list[Sensitivity]:
    """The indices of some measures."""
    groups, complete = plan.samples.groups, results.complete
    measures = results.measures[:, columns]
    if plan.samples.method == "saltelli":
        outputs = np.full((plan.samples.runs, len(columns)), np.nan)
        outputs[results.numbers[complete]] = measures[complete]
        blocks = outputs.reshape(-1, len(groups) + 2, len(columns))
        whole = blocks[np.all(np.isfinite(blocks), axis=(1, 2))]
        found = [saltelli_indices(whole[:, :, k]) for k in range(len(columns))]
        used, estimator = len(whole) * (len(groups) + 2), "saltelli"
    else:
        members = [[k for k, axis in enumerate(plan.axes) if axis.group == group] for group in groups]
        found = rank_indices(results.inputs[complete], measures[complete], members)
        used, estimator = int(np.count_nonzero(complete)), "ranks"
    return [
        Sensitivity(
            estimator=estimator if indices else "none",
            runs=used,
            left_out=len(results.numbers) - used,
            indices=_ordered(dict(zip(groups, indices, strict=True)) if indices else {}),
        )
        for indices in found
    ]


def _ordered(indices: Mapping[str, Index]) -> dict[str, Index]:
    return {group: indices[group] for group in sorted(indices, key=lambda group: -indices[group].importance)}


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


def rank_indices(inputs: Array, outputs: Array, groups: list[list[int]]) -> list[list[Index]]:
    """First-order indices of groups of columns of independent inputs (n, d), for each column of outputs (n, m).

    Empty where nothing varies. Neighbours are searched once for all outputs, and that is what takes the time.
    """
    n, m = outputs.shape
    varies = np.ptp(outputs, axis=0) > 0 if n >= LEAST else np.zeros(m, dtype=bool)
    found: list[list[Index]] = [[] for _ in range(m)]
    if not varies.any():
        return found
    generator = np.random.default_rng(SEED)
    halves = [generator.permutation(n)[: n // 2] for _ in range(min(RESAMPLES, 100))]
    width = float(norm.ppf((1 + CONFIDENCE) / 2))
    for columns in groups:
        values = _by_neighbours(inputs[:, columns], outputs)
        resampled = [_by_neighbours(inputs[half][:, columns], outputs[half]) for half in halves]
        # The variance of half the samples, drawn without replacement, about the estimate from all is that of all
        reach = width * np.std(resampled, axis=0)
        for k in np.flatnonzero(varies).tolist():
            value = float(values[k])
            found[k].append(Index(first=value, first_low=value - float(reach[k]), first_high=value + float(reach[k])))
    return found


def _by_neighbours(inputs: Array, outputs: Array) -> Array:
    """The estimate for each output; 0 where it does not vary."""
    centred = outputs - outputs.mean(axis=0)
    variance = np.mean(centred**2, axis=0)
    shared = np.mean(centred * centred[_neighbours(inputs)], axis=0)
    return np.asarray(np.divide(shared, variance, out=np.zeros_like(shared), where=variance > 0))


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
