"""Assembly of M, D, K and L: a sum of physical parameters times constant matrices of the geometry.

It depends on numpy alone, so that the kernel of the plant in Python shares it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexbeams.plant.basis import Array

MatrixName = Literal["M", "D", "K", "L"]


@dataclass(frozen=True, kw_only=True)
class Term:
    """One parameter's part: parameter x block, added to `matrix` at rows (and columns) from `start` on."""

    parameter: str  # such as beam[1].density
    matrix: MatrixName
    start: int  # first generalised coordinate of the block
    column: int  # patch pair counted from 0 where matrix is L, else 0
    block: Array  # (m, m), or (m, 1) where matrix is L


@dataclass(frozen=True, kw_only=True)
class SecondOrderSystem:
    """M, D, K (n, n) symmetric, L (n, n_u) in N/V and F (n, r) in N/N of one parameter set."""

    M: Array
    D: Array
    K: Array
    L: Array
    F: Array


def assemble(terms: Iterable[Term], values: Mapping[str, float], tips: Array, inputs: int) -> SecondOrderSystem:
    """The matrices for parameters by name; tips (r, n) are the deflections of the tips, `inputs` is n_u."""
    n = tips.shape[1]
    matrices = {"M": np.zeros((n, n)), "D": np.zeros((n, n)), "K": np.zeros((n, n)), "L": np.zeros((n, inputs))}
    for term in terms:
        rows = slice(term.start, term.start + len(term.block))
        columns = slice(term.column, term.column + 1) if term.matrix == "L" else rows
        matrices[term.matrix][rows, columns] += values[term.parameter] * term.block
    return SecondOrderSystem(**matrices, F=tips.T.copy())
