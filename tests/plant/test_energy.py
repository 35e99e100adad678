"""The energy form and the exact discretisation."""

import numpy as np
import pytest
from scipy.linalg import cholesky

from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.energy import EnergyForm, discretise, energy_form
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.statespace import state_matrices
from flexbeams.plant.structure import Structure, find_structure, read_structure
from tests.oracles.accuracy import response
from tests.oracles.examples import five_beams, single_beam, three_beams
from tests.oracles.high_precision import exponential

KIEL = read_structure(find_structure("kiel"))
STEP = 2e-4
CASES: list[tuple[Structure, BasisName, int]] = [
    (single_beam(), "clamped_free", 3),
    (three_beams(), "clamped_free", 10),
    (three_beams(), "segment", 5),
    (five_beams(), "segment", 4),
]


def energy_of(system: SecondOrderSystem) -> EnergyForm:
    """The energy form under voltages, then tip forces."""
    return energy_form(system.M, system.D, system.K, np.hstack([system.L, system.F]))


def assembled(A: Array, B: Array, step: float) -> tuple[Array, Array]:
    """A_d and B_d from the augmented exponential in 40 digits."""
    n, m = B.shape
    exact = exponential(step * np.block([[A, B], [np.zeros((m, n + m))]]))
    return exact[:n, :n], exact[:n, n:]


@pytest.mark.parametrize("step", [STEP, 0.05])
def test_discretisation_in_high_precision(step: float) -> None:
    generator = np.random.default_rng(2)
    A, B = generator.normal(size=(5, 5)) * 10, generator.normal(size=(5, 2))
    for found, exact in zip(discretise(A, B, step), assembled(A, B, step), strict=True):
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-14 * np.abs(exact).max())


@pytest.mark.parametrize("step", [STEP, 2e-3])
def test_discretisation_of_a_beam_in_high_precision(step: float) -> None:
    form = energy_of(beam_model(single_beam(), "clamped_free", 4).assemble())
    for found, exact in zip(discretise(form.A, form.B, step), assembled(form.A, form.B, step), strict=True):
        assert found.shape == exact.shape
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-13 * np.abs(exact).max())


def test_discretisation_of_an_integrator() -> None:
    """A = 0 is no special case: A_d = 1, B_d = B step."""
    A_d, B_d = discretise(np.zeros((3, 3)), np.arange(6.0).reshape(3, 2), 0.25)
    np.testing.assert_array_equal(A_d, np.eye(3))
    np.testing.assert_allclose(B_d, np.arange(6.0).reshape(3, 2) * 0.25, rtol=1e-15)


@pytest.mark.parametrize("parts", [1, 2, 5, 7])
@pytest.mark.parametrize(("basis", "order"), [("clamped_free", 10), ("segment", 9)])
def test_a_step_is_the_sum_of_its_parts(basis: BasisName, order: int, parts: int) -> None:
    form = energy_of(beam_model(KIEL, basis, order).assemble())
    whole_A, whole_B = discretise(form.A, form.B, STEP)
    part_A, part_B = discretise(form.A, form.B, STEP / parts)
    A, B = np.eye(len(form.A)), np.zeros_like(form.B)
    for _ in range(parts):
        A, B = part_A @ A, part_A @ B + part_B
    assert np.linalg.norm(A - whole_A, 2) < 1e-12
    column = np.linalg.norm(whole_B, axis=0)
    assert np.all(np.linalg.norm(B - whole_B, axis=0) < 1e-12 * column)


@pytest.mark.parametrize(("structure", "basis", "order"), [*CASES, (KIEL, "segment", 9)])
def test_a_step_does_not_create_energy(structure: Structure, basis: BasisName, order: int) -> None:
    form = energy_of(beam_model(structure, basis, order).assemble())
    for step in (STEP, 1e-2):
        assert np.linalg.norm(discretise(form.A, form.B, step)[0], 2) <= 1 + 1e-12


@pytest.mark.parametrize(("structure", "basis", "order"), CASES)
def test_energy_balance(structure: Structure, basis: BasisName, order: int) -> None:
    """|x|^2 / 2 is the energy, and d/dt energy = -q'' D q' + q'' (L u + F f), q'' the transposed velocity."""
    model = beam_model(structure, basis, order)
    system = model.assemble()
    form, n = energy_of(system), model.size
    generator = np.random.default_rng(3)
    x = generator.normal(size=2 * n)
    inputs = np.concatenate(
        [generator.normal(size=len(structure.patch)) * 1e3, generator.normal(size=len(structure.beam))]
    )
    q, velocity = form.position @ x[:n], np.linalg.solve(cholesky(system.M, lower=True).T, x[n:])
    energy = velocity @ system.M @ velocity / 2 + q @ system.K @ q / 2
    assert x @ x / 2 == pytest.approx(energy, rel=1e-9)
    power = velocity @ np.hstack([system.L, system.F]) @ inputs
    loss = velocity @ system.D @ velocity
    rate = x @ (form.A @ x + form.B @ inputs)
    assert rate == pytest.approx(power - loss, abs=1e-10 * (abs(power) + loss))
    # kinematics: the position's rate is the velocity
    rates = form.A @ x
    np.testing.assert_allclose(form.position @ rates[:n], velocity, rtol=0, atol=1e-9 * np.abs(velocity).max())


@pytest.mark.parametrize(("structure", "basis", "order"), CASES)
@pytest.mark.parametrize("s", [0.0, 15.0j, 2.0 + 300.0j])
def test_forms_have_the_transfer_function_of_the_second_order_system(
    structure: Structure, basis: BasisName, order: int, s: complex
) -> None:
    model = beam_model(structure, basis, order)
    system, rows = model.assemble(), np.vstack([model.deflection, model.strain])
    patches = len(structure.patch)
    exact = np.vstack(response(model, s))
    form = energy_of(system)
    identity = np.eye(2 * model.size)
    by_energy = form.outputs(rows) @ np.linalg.solve(s * identity - form.A, form.B)
    A, B = state_matrices(system)
    by_state = rows @ np.linalg.solve(s * identity - A, B)[: model.size]
    assert by_energy.shape == exact.shape
    scale = np.abs(exact).max(axis=1, keepdims=True)
    np.testing.assert_allclose(by_energy / scale, exact / scale, rtol=0, atol=1e-9)
    np.testing.assert_allclose(by_state / scale, exact[:, :patches] / scale, rtol=0, atol=1e-8)


def test_both_forms_step_alike() -> None:
    model = beam_model(three_beams(), "clamped_free", 10)
    system, n = model.assemble(), model.size
    u = np.array([817.0, -770.0, -807.0, 781.0])
    A, B = state_matrices(system)
    form = energy_of(system)
    A_d, B_d = discretise(A, B, 2e-3)
    A_e, B_e = discretise(form.A, form.B[:, :4], 2e-3)
    C, C_e = np.hstack([model.deflection, np.zeros_like(model.deflection)]), form.outputs(model.deflection)
    x, z, by_state, by_energy = np.zeros(2 * n), np.zeros(2 * n), [], []
    for _ in range(500):
        x, z = A_d @ x + B_d @ u, A_e @ z + B_e @ u
        by_state.append(C @ x)
        by_energy.append(C_e @ z)
    assert np.abs(by_energy).max() > 1e-3
    np.testing.assert_allclose(by_state, by_energy, rtol=0, atol=1e-9 * np.abs(by_energy).max())


@pytest.mark.parametrize(("structure", "basis", "order"), [*CASES, (KIEL, "clamped_free", 10), (KIEL, "segment", 9)])
def test_the_plant_is_stable(structure: Structure, basis: BasisName, order: int) -> None:
    form = energy_of(beam_model(structure, basis, order).assemble())
    assert np.linalg.eigvals(form.A).real.max() < 0
    np.testing.assert_array_equal(form.A[: len(form.A) // 2, : len(form.A) // 2], 0)


@pytest.mark.parametrize(("part", "name"), [("density", "mass"), ("youngs_modulus", "stiffness")])
def test_a_structure_without_mass_or_stiffness_is_refused(part: str, name: str) -> None:
    model = beam_model(single_beam(), "clamped_free", 5)
    with pytest.raises(DesignError, match=f"the {name} matrix is not positive definite"):
        energy_of(model.assemble({f"beam[1].{part}": 0.0, f"patch[1].{part}": 0.0}))
