"""First-order form, natural frequencies, static gains and frequency responses."""

import numpy as np
import pytest
from scipy.linalg import eigh

from flexbeams.plant.choices import BasisName
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.statespace import frequency_responses, state_matrices, static_gains, undamped_frequencies
from flexbeams.plant.structure import find_structure, read_structure
from tests.oracles.boundary_value import StaticSolution
from tests.oracles.chains import chain_of_beams
from tests.oracles.examples import three_beams
from tests.oracles.high_precision import frequency_response

KIEL = read_structure(find_structure("kiel"))


def test_state_matrices() -> None:
    system = beam_model(three_beams(), "clamped_free", 4).assemble()
    A, B = state_matrices(system)
    n = 12
    assert A.shape == (2 * n, 2 * n)
    assert B.shape == (2 * n, 4)
    np.testing.assert_array_equal(A[:n], np.hstack([np.zeros((n, n)), np.eye(n)]))
    np.testing.assert_array_equal(B[:n], 0)
    residual = system.M @ np.hstack([A[n:], B[n:]]) - np.hstack([-system.K, -system.D, system.L])
    assert np.abs(residual).max() < 1e-12 * np.abs(system.K).max()


def test_undamped_frequencies_are_generalised_eigenvalues() -> None:
    system = beam_model(three_beams(), "clamped_free", 6).assemble()
    exact = np.sqrt(eigh(system.K, system.M, eigvals_only=True))
    found = undamped_frequencies(system)
    assert found.shape == (18,)
    np.testing.assert_allclose(found, exact, rtol=1e-10)


def test_static_gains_are_exact_on_segments() -> None:
    structure = three_beams()
    model = beam_model(structure, "segment")
    to_deflection, to_strain = static_gains(model, model.assemble())
    exact = StaticSolution(structure)
    assert to_deflection.shape == (5, 4)
    assert to_strain.shape == (6, 4)
    np.testing.assert_allclose(to_deflection, exact.deflection()[:, :4], rtol=1e-9)
    strain = exact.strain()[:, :4]
    np.testing.assert_allclose(to_strain, strain, rtol=0, atol=1e-9 * np.abs(strain).max())


@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
def test_positive_voltage_deflects_its_beams_tip_to_the_negative(basis: BasisName) -> None:
    model = beam_model(KIEL, basis)
    gain, _ = static_gains(model, model.assemble())
    for k, patch in enumerate(KIEL.patch):
        tip = max(
            (i for i, p in enumerate(KIEL.point_of_interest) if p.beam == patch.beam),
            key=lambda i: KIEL.point_of_interest[i].position,
        )
        assert gain[tip, k] < 0


def test_frequency_responses_keep_small_entries() -> None:
    """From end to end of a chain, 1e-24 of the largest entry, beside elimination with 40 digits."""
    model = beam_model(chain_of_beams(5), "clamped_free", 4)
    system, rows = model.assemble(), np.vstack([model.deflection, model.strain])
    omega = np.array([14.0, 9e3])
    found = frequency_responses(system, rows, omega)
    for k, w in enumerate(omega):
        expected = frequency_response(system.M, system.D, system.K, rows, system.L, w)
        np.testing.assert_allclose(found[k], expected, rtol=1e-10)
    assert np.min(np.abs(found[1])) < 1e-24 * np.max(np.abs(found[1]))
