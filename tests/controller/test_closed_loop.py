"""The loop that is closed: its matrix against a simulation, and its poles."""

from functools import cache

import numpy as np
import pytest

from flexbeams.controller.closed_loop import (
    SampledPlant,
    closed_loop_matrix,
    closed_loop_poles,
    sampled_controller,
    sampled_plant,
)
from flexbeams.controller.plant_modes import PlantModes
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import beam_model
from tests.helpers import design_of
from tests.oracles.examples import single_beam
from tests.oracles.monolithic import largest_difference, plant_matrices, recursion_matrix, simulate

SAMPLE = 2e-4


@cache
def plant(basis: BasisName, structure: str = "kiel") -> SampledPlant:
    return sampled_plant(design_of(structure).model(basis), SAMPLE)


def oracle_poles(structure: str, basis: BasisName, integral_gain: float) -> Array:
    """Poles of the oracle's recursion, written apart: state (plant, x_est, integral, u)."""
    made = design_of(structure)
    matrix = recursion_matrix(made, plant_matrices(made.model(basis), SAMPLE), integral_gain)
    return np.asarray(np.log(np.linalg.eigvals(matrix).astype(complex)) / SAMPLE)


@pytest.mark.parametrize("value", [-1e12, np.nan])
@pytest.mark.parametrize(
    ("parameter", "matrix"), [("beam[1].density", "mass"), ("beam[1].youngs_modulus", "stiffness")]
)
def test_parameters_that_no_plant_has_are_refused(parameter: str, matrix: str, value: float) -> None:
    with pytest.raises(DesignError, match=f"the {matrix} matrix is not positive definite"):
        sampled_plant(beam_model(single_beam(), "segment", 5), SAMPLE, {parameter: value})


@pytest.mark.parametrize("damping", [0.02, 30.0])
def test_a_plant_is_sampled_as_by_its_exponential(damping: float) -> None:
    """From its damped modes, and where some are overdamped."""
    model = beam_model(single_beam(viscous_damping=damping), "segment", 5)
    system, here = model.assemble(), sampled_plant(model, SAMPLE)
    assert (here.eigenvalues is None) == (damping == 30.0)
    form = energy_form(system.M, system.D, system.K, system.L)
    A, B = discretise(form.A, form.B, SAMPLE)
    np.testing.assert_allclose(np.poly(here.poles()), np.poly(np.linalg.eigvals(A)), rtol=0, atol=1e-9)
    for count in (0, 1, 20, 3000):
        for rows, outputs in ((model.deflection, here.H_pi), (model.strain, here.H_pm)):
            expected = form.outputs(rows) @ np.linalg.matrix_power(A, count) @ B
            found = outputs @ np.linalg.matrix_power(here.A, count) @ here.B
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
@pytest.mark.parametrize("extra_delay", [0, 3])
def test_the_matrix_is_the_recursion(basis: BasisName, extra_delay: int) -> None:
    """Powers of the loop's matrix against 1500 samples of the simulated loop, from a plant bent by voltages."""
    made, here = design_of(), plant(basis)
    bent = np.array([300.0, -200.0, 100.0, -50.0])
    x = np.linalg.solve(np.eye(len(here.A)) - here.A, here.B @ bent)
    controller = sampled_controller(made.arrays, 4e-4)
    loop = closed_loop_matrix(controller, here, extra_delay)
    state = np.zeros(len(loop))
    state[: len(x)] = x
    y = np.zeros((1501, len(here.H_pi)))
    for k in range(1501):
        y[k] = here.H_pi @ state[: len(x)]
        state = loop @ state
    if extra_delay == 0:
        run = simulate(made, made.model(basis), steps=1500, rest_voltage=bent, integral_gain=4e-4, controller_limit=1e9)
        assert largest_difference(y, run["plant.y_pi"]) < 1e-9
        return
    delayed, x_c, queue = np.zeros_like(y), np.zeros(len(controller.A)), [np.zeros(4)] * extra_delay
    for k in range(1501):
        delayed[k] = here.H_pi @ x
        queue.append(controller.C @ x_c)
        x_c = controller.A @ x_c + controller.B @ (here.H_pm @ x)
        x = here.A @ x + here.B @ queue.pop(0)
    assert largest_difference(y, delayed) < 1e-10


@pytest.mark.parametrize("structure", ["kiel", "five_beams", "single_beam"])
@pytest.mark.parametrize("integral_gain", [0.0, 1e-4, 3e-3])
def test_poles_against_the_oracle(structure: str, integral_gain: float) -> None:
    """All but those at z = 1 of an integral that never moves, of more voltages than points or of a gain of 0."""
    poles = closed_loop_poles(
        sampled_controller(design_of(structure).arrays, integral_gain), plant("segment", structure)
    )
    expected = oracle_poles(structure, "segment", integral_gain)
    expected = expected[np.abs(expected) > 1e-6]
    assert poles[0].real == pytest.approx(expected.real.max(), abs=1e-6)
    slow = [np.sort_complex(p[np.abs(p) < 200.0]) for p in (poles, expected)]
    np.testing.assert_allclose(slow[0], slow[1], rtol=0, atol=1e-4)


def test_slow_modes_alone_have_the_slow_poles() -> None:
    """Modes below 500 rad/s with the statics of the others: poles below 60 rad/s to 1e-3."""
    made = design_of()
    controller = sampled_controller(made.arrays, 8e-4)
    full = closed_loop_poles(controller, plant("segment"))
    slow = closed_loop_poles(controller, PlantModes.of(made.model("segment")).slow(SAMPLE, 500.0))
    for pole in full[np.abs(full) < 60.0]:
        assert np.min(np.abs(slow - pole)) < 2e-3 * abs(pole)
    here = PlantModes.of(made.model("segment")).slow(SAMPLE, 500.0)
    gains = [
        (
            p.H_pi @ np.linalg.solve(np.eye(len(p.A)) - p.A, p.B) + p.D_pi,
            p.H_pm @ np.linalg.solve(np.eye(len(p.A)) - p.A, p.B) + p.D_pm,
        )
        for p in (here, plant("segment"))
    ]
    for found, expected in zip(*gains, strict=True):
        assert largest_difference(found, expected) < 1e-9


@pytest.mark.parametrize("structure", ["kiel", "five_beams"])
@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
def test_modes_that_the_controller_moves_have_all_poles_that_it_moves(structure: str, basis: BasisName) -> None:
    """Half the modes of the exact plant; every pole of the full loop is one of theirs or of the plant alone."""
    made, here = design_of(structure), plant(basis, structure)
    controller = sampled_controller(made.arrays, 1e-4)
    kept = PlantModes.of(made.model(basis)).moved_by(controller, SAMPLE)
    assert len(kept.A) < (0.6 if basis == "segment" else 0.95) * len(here.A)
    full, found = closed_loop_poles(controller, here), closed_loop_poles(controller, kept)
    alone = np.log(np.linalg.eigvals(here.A).astype(np.complex128)) / SAMPLE
    for pole in full[full.real > -2000]:
        nearest = min(np.min(np.abs(found - pole)), np.min(np.abs(alone - pole)))
        assert nearest < 2e-4 * abs(pole)
    assert found[0].real == pytest.approx(full[0].real, rel=2e-6)
    gains = [p.H_pm @ np.linalg.solve(np.eye(len(p.A)) - p.A, p.B) + p.D_pm for p in (kept, here)]
    assert largest_difference(*gains) < 1e-9


def test_delay_is_harmless_for_the_published_loop() -> None:
    poles = closed_loop_poles(sampled_controller(design_of().arrays, 1e-4), plant("clamped_free"), extra_delay=10)
    assert poles[0].real < -0.4
