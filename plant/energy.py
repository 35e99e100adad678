"""The energy form of a second-order system and its exact discretisation, on plain arrays."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError


@dataclass(frozen=True, kw_only=True)
class EnergyForm:
    """The system in coordinates where half the squared norm of the state is the mechanical energy.

    x = (R_K' q, R_M' q') with K = R_K R_K', M = R_M R_M' (lower Cholesky factors). A is skew-symmetric less
    the damping, so its exponential is a contraction, and discretisation stays accurate for stiff bases too.
    """

    A: Array  # (2n, 2n), 1/s
    B: Array  # (2n, m)
    position: Array  # (n, n): q = position x[:n]

    def outputs(self, rows: Array) -> Array:
        """Output matrix (k, 2n) for y = rows q, rows (k, n)."""
        return np.hstack([rows @ self.position, np.zeros_like(rows)])


def cholesky_factors(M: Array, K: Array) -> tuple[Array, Array]:
    """Lower Cholesky factors R_M and R_K (n, n). Raises DesignError where M or K is not positive definite."""
    factors = []
    for name, matrix in (("mass", M), ("stiffness", K)):
        try:
            factors.append(cholesky(matrix, lower=True))
        except (np.linalg.LinAlgError, ValueError):
            raise DesignError(f"the {name} matrix is not positive definite: check the structure's parameters") from None
    return factors[0], factors[1]


def energy_form(M: Array, D: Array, K: Array, inputs: Array) -> EnergyForm:
    """The energy form of M q'' + D q' + K q = inputs v, with M, D, K (n, n) and inputs (n, m).

    Raises DesignError where M or K is not positive definite.
    """
    n = len(M)
    mass, stiffness = cholesky_factors(M, K)
    coupling = solve_triangular(mass, stiffness, lower=True)  # R_M^-1 R_K
    half = solve_triangular(mass, D, lower=True)
    damping = solve_triangular(mass, half.T, lower=True)  # R_M^-1 D R_M^-T
    A = np.block([[np.zeros((n, n)), coupling.T], [-coupling, -(damping + damping.T) / 2]])
    B = solve_triangular(mass, inputs, lower=True)
    position: Array = solve_triangular(stiffness, np.eye(n), lower=True).T
    return EnergyForm(A=A, B=np.vstack([np.zeros_like(B), B]), position=position)


def discretise(A: Array, B: Array, step: float) -> tuple[Array, Array]:
    """Exact A_d, B_d (41) for inputs held over `step` seconds, by one augmented matrix exponential."""
    n, m = B.shape
    augmented = np.zeros((n + m, n + m))
    augmented[:n, :n], augmented[:n, n:] = A * step, B * step
    growth = _exponential_less_one(augmented)
    return np.eye(n) + growth[:n, :n], growth[:n, n:].copy()


def _exponential_less_one(A: Array) -> Array:
    """exp(A) - 1 (n, n), by its series for A / 2^s and s squarings of 1 + Y, Y <- 2 Y + Y Y.

    Squaring exp itself, whose entries are near those of the identity, loses digits with every doubling, four of them
    for a stiff basis.
    """
    norm = float(np.linalg.norm(A, 1))
    doublings = max(0, int(np.ceil(np.log2(max(norm, 1e-300)))) + 1)
    X = A / 2.0**doublings  # norm <= 1/2: 16 terms reach rounding
    Y, power = X.copy(), X
    for k in range(2, 17):
        power = power @ X / k
        Y += power
    for _ in range(doublings):
        Y = 2 * Y + Y @ Y
    return Y
