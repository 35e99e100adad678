"""First-order form, natural frequencies and static gains of the second-order system."""

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular, svdvals

from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel


def state_matrices(system: SecondOrderSystem) -> tuple[Array, Array]:
    """A (2n, 2n) and B (2n, n_u) of (17), state (q, q')."""
    n = system.M.shape[0]
    factor = cho_factor(system.M, lower=True)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-cho_solve(factor, system.K), -cho_solve(factor, system.D)]])
    B = np.vstack([np.zeros_like(system.L), cho_solve(factor, system.L)])
    return A, B


def undamped_frequencies(system: SecondOrderSystem) -> Array:
    """Natural frequencies in rad/s, ascending, shape (n,).

    Singular values of R_M^-1 R_K: squaring, as the eigenvalues of K and M would, loses half the digits of the
    low frequencies of a stiff basis.
    """
    mass, stiffness = cholesky(system.M, lower=True), cholesky(system.K, lower=True)
    frequencies: Array = svdvals(solve_triangular(mass, stiffness, lower=True))[::-1].copy()
    return frequencies


def static_gains(model: BeamModel, system: SecondOrderSystem) -> tuple[Array, Array]:
    """DC gains from u: G_pi (n_pi, n_u) in m/V and G_pm (n_pm, n_u) in 1/V."""
    rest = cho_solve(cho_factor(system.K, lower=True), system.L)
    return model.deflection @ rest, model.strain @ rest
