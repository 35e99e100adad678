"""Where a study looks: the inputs of each run, by quasi-Monte Carlo methods of scipy.stats.qmc or on a grid.

A Saltelli design (Saltelli et al. 2010, table 2) has for each of N base points A_k, B_k and, for each group g of axes,
A_k with the columns of g from B_k: N (groups + 2) runs, block after block, so that every whole block can be evaluated.
"""

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import Method
from flexbeams.scenarios.studies.axes import Axis

_EDGE = 2.0**-53  # uniform numbers keep this distance from 0 and 1, where quantiles may be infinite


@dataclass(frozen=True, kw_only=True)
class SamplePlan:
    """The inputs of all runs."""

    method: Method
    seed: int
    values: Array  # (runs, axes)
    groups: tuple[str, ...]  # of axes, each an input of the sensitivity

    @property
    def runs(self) -> int:
        """Number of runs."""
        return len(self.values)


def plan_samples(axes: list[Axis], method: Method, runs: int, seed: int, source: str) -> SamplePlan:
    """`runs` samples; of a Saltelli design the whole blocks of a power of two among them, of a grid all its points.

    Raises InputError for a Saltelli design of fewer runs than two blocks, and for a grid of an axis without levels.
    """
    groups = tuple(dict.fromkeys(axis.group for axis in axes))
    if method == "grid":
        values = _grid(axes, source)
    elif method == "saltelli":
        values = _saltelli(axes, groups, runs, seed, source)
    else:
        values = _quantiles(axes, _uniform(method, len(axes), runs, seed))
    return SamplePlan(method=method, seed=seed, values=values, groups=groups)


def saltelli_blocks(groups: int, runs: int) -> int:
    """Base points N, a power of two, of at most `runs` runs; 0 where they are too few for one."""
    blocks = runs // (groups + 2)
    return 1 << (blocks.bit_length() - 1) if blocks else 0


def _uniform(method: str, dimensions: int, runs: int, seed: int) -> Array:
    """(runs, dimensions) numbers within (0, 1)."""
    generator = np.random.default_rng(seed)
    sampler = qmc.LatinHypercube(dimensions, seed=generator) if method == "lhs" else _sobol(dimensions, generator)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # numbers of runs that are no power of two
        numbers = np.asarray(sampler.random(runs), dtype=float)
    return np.asarray(np.clip(numbers, _EDGE, 1 - _EDGE), dtype=float)


def _sobol(dimensions: int, generator: np.random.Generator) -> qmc.Sobol:
    return qmc.Sobol(dimensions, seed=generator)


def _quantiles(axes: list[Axis], uniform: Array) -> Array:
    return np.stack([axis.quantiles(uniform[:, k]) for k, axis in enumerate(axes)], axis=1)


def _saltelli(axes: list[Axis], groups: tuple[str, ...], runs: int, seed: int, source: str) -> Array:
    d, blocks = len(axes), saltelli_blocks(len(groups), runs)
    if blocks < 2:
        least = 2 * (len(groups) + 2)
        rule = f"must be at least {least} for a Saltelli design of {len(groups)} inputs or groups"
        raise InputError("runs", rule, runs, source=source)
    uniform = _uniform("sobol", 2 * d, blocks, seed)
    A, B = _quantiles(axes, uniform[:, :d]), _quantiles(axes, uniform[:, d:])
    values = np.empty((blocks, len(groups) + 2, d))
    values[:, 0], values[:, 1] = A, B
    for g, group in enumerate(groups):
        of_group = np.array([axis.group == group for axis in axes])
        values[:, 2 + g] = np.where(of_group, B, A)
    return values.reshape(-1, d)


def _grid(axes: list[Axis], source: str) -> Array:
    levels = []
    for axis in axes:
        if axis.levels is None:
            rule = "needs values or levels of each parameter on a grid"
            raise InputError("method", f"grid {rule}, {axis.name} has none", source=source)
        levels.append(axis.levels)
    return np.stack([part.ravel() for part in np.meshgrid(*levels, indexing="ij")], axis=1)
