"""Damped modes by iteration: they solve their equation, are all modes, and are refused where the iteration fails."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import block_diag

from flexbeams.plant.basis import Array
from flexbeams.plant.damped_modes import damped_eigenvalues, damped_modes
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.statespace import spectrum_of, state_matrices, undamped_frequencies
from flexbeams.plant.structure import Structure
from tests.oracles.chains import chain_of_beams
from tests.oracles.examples import five_beams, single_beam


def residual(frequencies: Array, damping: Array) -> float:
    """Of the equation of all modes, each relative to the square of its eigenvalue."""
    modes = damped_modes(frequencies, damping)
    assert modes is not None
    a, z = modes.eigenvalues, modes.shapes
    rows = z * a**2 + (damping @ z) * a + frequencies[:, None] ** 2 * z
    np.testing.assert_array_equal(np.diag(z), 1)
    return float(np.max(np.abs(rows) / np.abs(a) ** 2))


def first_order(frequencies: Array, damping: Array) -> Array:
    """The matrix of the state (diag(frequencies) eta, eta')."""
    rates = np.diag(frequencies)
    return np.block([[np.zeros_like(rates), rates], [-rates, -damping]])


@pytest.mark.parametrize("make", [single_beam, five_beams, lambda: chain_of_beams(8)])
def test_the_spectrum_of_structures(make: Callable[[], Structure]) -> None:
    system = beam_model(make(), "clamped_free", 8).assemble()
    spectrum = spectrum_of(system)
    n = len(system.M)
    np.testing.assert_allclose(spectrum.frequencies, undamped_frequencies(system), rtol=1e-12)
    assert spectrum.oscillating.shape == (n,)
    assert spectrum.real.shape == (0,)
    A, _ = state_matrices(system)
    exact = np.linalg.eigvals(A)
    exact = exact[exact.imag > 0]
    exact = exact[np.argsort(np.abs(exact))]
    np.testing.assert_allclose(spectrum.oscillating, exact, rtol=1e-9)


def test_modes_closer_together_than_damping_couples_them() -> None:
    """Of this pair sweeps alone would need a thousand steps."""
    frequencies = np.array([300.0, 100.0, 100.0 + 0.3])
    damping = np.array([[4.0, 0.5, 0.2], [0.5, 2.0, 0.25], [0.2, 0.25, 1.0]])
    assert residual(frequencies, damping) < 1e-14
    found, real = damped_eigenvalues(frequencies, damping)
    exact = np.linalg.eigvals(first_order(frequencies, damping))
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(exact[exact.imag > 0]), rtol=1e-12)
    assert real.shape == (0,)


def test_equal_beams_that_nothing_joins_keep_their_own_modes() -> None:
    frequencies = np.array([500.0, 90.0])
    damping = np.array([[3.0, 0.4], [0.4, 1.0]])
    assert residual(np.tile(frequencies, 3), block_diag(damping, damping, damping)) < 1e-14


@pytest.mark.parametrize(
    ("frequencies", "damping", "oscillating"),
    [
        pytest.param([50.0, 10.0], [[1.0, 0.1], [0.1, 25.0]], 1, id="overdamped"),
        pytest.param([10.0, 10.0], [[2.0, 1.0], [1.0, 3.0]], 2, id="one frequency, coupled"),
        pytest.param([40.0, 30.0, 10.0], [[8.0, 9.0, 3.0], [9.0, 12.0, 7.0], [3.0, 7.0, 9.0]], 3, id="strong coupling"),
    ],
)
def test_others_by_qr(frequencies: list[float], damping: list[list[float]], oscillating: int) -> None:
    omega, matrix = np.array(frequencies), np.array(damping)
    pairs, real = damped_eigenvalues(omega, matrix)
    assert pairs.shape == (oscillating,)
    assert np.all(np.diff(np.abs(pairs)) >= 0)
    assert np.all(np.diff(real) <= 0)
    exact = np.linalg.eigvals(first_order(omega, matrix))
    found = np.concatenate([pairs, pairs.conj(), real])
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(exact), rtol=1e-12)


def test_refused_where_no_mode_belongs_to_each_undamped_one() -> None:
    assert damped_modes(np.array([50.0, 10.0]), np.array([[1.0, 0.1], [0.1, 25.0]])) is None
    assert damped_modes(np.array([40.0, 30.0, 29.0]), np.full((3, 3), 20.0)) is None
