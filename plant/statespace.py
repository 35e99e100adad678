"""First-order form, natural frequencies, static gains and frequency responses of the second-order system."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import bandwidth, cho_factor, cho_solve, solve_banded, solve_triangular, svd, svdvals

from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.damped_modes import ComplexArray, damped_eigenvalues
from flexbeams.plant.energy import cholesky_factors
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
    low frequencies of a stiff basis. Raises DesignError where M or K is not positive definite.
    """
    mass, stiffness = cholesky_factors(system.M, system.K)
    frequencies: Array = svdvals(solve_triangular(mass, stiffness, lower=True))[::-1].copy()
    return frequencies


@dataclass(frozen=True, kw_only=True)
class Spectrum:
    """Eigenvalues of a system, the slowest first."""

    frequencies: Array  # (n,), rad/s, without damping
    oscillating: ComplexArray  # (k,), 1/s, of each pair the one with the positive imaginary part
    real: Array  # (2 n - 2 k,), 1/s


@dataclass(frozen=True, kw_only=True)
class UndampedModes:
    """Modes eta of a system without damping, from the fastest to the slowest: q = shapes eta."""

    frequencies: Array  # (n,), rad/s
    shapes: Array  # (n, n), mass-normalised, in columns
    positions: Array  # (n, n): shapes / frequencies, with the digits that statics need

    def damping(self, system: SecondOrderSystem) -> Array:
        """Damping matrix (n, n), 1/s, of the modes."""
        return np.asarray(self.shapes.T @ system.D @ self.shapes, dtype=np.float64)


def undamped_modes(system: SecondOrderSystem) -> UndampedModes:
    """By U, Omega, V' = R_M^-1 R_K: shapes R_M^-T U and positions R_K^-T V.

    Raises DesignError where M or K is not positive definite.
    """
    mass, stiffness = cholesky_factors(system.M, system.K)
    left, frequencies, right = svd(solve_triangular(mass, stiffness, lower=True))
    return UndampedModes(
        frequencies=frequencies,
        shapes=solve_triangular(mass, left, lower=True, trans="T"),
        positions=solve_triangular(stiffness, right.T, lower=True, trans="T"),
    )


def spectrum_of(system: SecondOrderSystem) -> Spectrum:
    """The spectrum with and without damping."""
    undamped = undamped_modes(system)
    oscillating, real = damped_eigenvalues(undamped.frequencies, undamped.damping(system))
    return Spectrum(frequencies=undamped.frequencies[::-1].copy(), oscillating=oscillating, real=real)


def static_gains(model: BeamModel, system: SecondOrderSystem) -> tuple[Array, Array]:
    """DC gains from u: G_pi (n_pi, n_u) in m/V and G_pm (n_pm, n_u) in 1/V."""
    rest = cho_solve(cho_factor(system.K, lower=True), system.L)
    return model.deflection @ rest, model.strain @ rest


def frequency_responses(system: SecondOrderSystem, rows: Array, omega: Array) -> NDArray[np.complex128]:
    """rows (K + j w D - w^2 M)^-1 L (k, p, n_u) at frequencies omega (k,), rad/s, rows (p, n).

    By elimination within the band of the matrices, which is narrow for a chain of beams: small entries, such as those
    from one end of a chain to the other, keep their digits.
    """
    lower, upper = bandwidth(np.abs(system.M) + np.abs(system.D) + np.abs(system.K))
    bands = [_diagonals(matrix, lower, upper) for matrix in (system.K, system.D, system.M)]
    responses = np.empty((len(omega), len(rows), system.L.shape[1]), dtype=np.complex128)
    for k, w in enumerate(omega):
        stiffness = bands[0] + 1j * w * bands[1] - w**2 * bands[2]
        responses[k] = rows @ solve_banded((lower, upper), stiffness, system.L.astype(np.complex128))
    return responses


def _diagonals(matrix: Array, lower: int, upper: int) -> Array:
    """The diagonals of a matrix (n, n) as rows (lower + upper + 1, n), as solve_banded expects them."""
    n, rows = len(matrix), np.zeros((lower + upper + 1, len(matrix)))
    for d in range(-lower, upper + 1):
        rows[upper - d, max(d, 0) : n + min(d, 0)] = np.diagonal(matrix, d)
    return rows
