"""The modal form against the dense exponential; its condition near critical damping."""

import numpy as np
import pytest
from scipy.linalg import block_diag

from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.modal_form import modal_form
from tests.oracles.examples import five_beams, single_beam, three_beams


def modal_step(A: Array, B: Array, step: float) -> tuple[Array, Array]:
    """A_d and B_d through the modal form."""
    form = modal_form(A)
    growth, hold = form.step_functions(step)
    A_d = np.eye(len(A)) + ((form.V * growth) @ form.W).real
    return A_d, ((form.V * hold) @ (form.W @ B)).real


@pytest.mark.parametrize("step", [1e-6, 2e-4, 0.05])
@pytest.mark.parametrize(("basis", "order"), [("clamped_free", 8), ("segment", 5)])
def test_a_structure_as_by_its_exponential(basis: BasisName, order: int, step: float) -> None:
    for structure in (single_beam(), three_beams(), five_beams()):
        system = beam_model(structure, basis, order).assemble()
        form = energy_form(system.M, system.D, system.K, np.hstack([system.L, system.F]))
        for found, exact in zip(modal_step(form.A, form.B, step), discretise(form.A, form.B, step), strict=True):
            np.testing.assert_allclose(found, exact, rtol=0, atol=2e-12 * np.abs(exact).max())


def test_eigenvalues_that_coincide() -> None:
    generator = np.random.default_rng(3)
    one = np.array([[0.0, 30.0], [-30.0, -0.4]])
    rotation = np.linalg.qr(generator.standard_normal((8, 8)))[0]
    A = rotation @ block_diag(one, one, one, one) @ rotation.T
    B = generator.standard_normal((8, 3))
    assert modal_form(A).condition < 30
    for found, exact in zip(modal_step(A, B, 0.01), discretise(A, B, 0.01), strict=True):
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-12)


@pytest.mark.parametrize("distance", [0.1, 1e-2, 1e-3, 1e-6, 0.0, -1e-2])
def test_the_condition_tells_how_near_critical_damping_is(distance: float) -> None:
    """1 / sqrt(2 |distance|) for a damping ratio of 1 - distance."""
    ratio, frequency = 1.0 - distance, 20.0
    condition = modal_form(np.array([[0.0, frequency], [-frequency, -2 * ratio * frequency]])).condition
    if distance:
        assert condition == pytest.approx(1 / np.sqrt(2 * abs(distance)), rel=0.1)
    else:
        assert condition > 1e7


def test_an_eigenvalue_of_0_integrates() -> None:
    A, B = np.diag([0.0, -2.0]), np.array([[3.0], [1.0]])
    A_d, B_d = modal_step(A, B, 0.5)
    np.testing.assert_allclose(A_d, np.diag([1.0, np.exp(-1.0)]), rtol=1e-15, atol=1e-16)
    np.testing.assert_allclose(B_d, [[1.5], [(1 - np.exp(-1.0)) / 2]], rtol=1e-15)
