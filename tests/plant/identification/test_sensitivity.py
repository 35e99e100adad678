"""Outputs and derivatives of the modal form against matrix exponentials and complex steps, to 1e-8 and better."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.sensitivity import Prediction, drive_of, modal_system, predict
from flexbeams.plant.structure import Structure
from tests.oracles import complex_step
from tests.oracles.examples import beam, gauge, patch, point, single_beam, three_beams

ROWS, STEP = 120, 2e-3
Real = NDArray[np.float64]


def experiment(structure: Structure, sensors: tuple[int, ...], **changes: object) -> Experiment:
    """Voltage steps and a tip force, from rest under other voltages."""
    rng = np.random.default_rng(4)
    pairs, tips = len(structure.patch), len(structure.beam)
    voltages = np.repeat(rng.normal(size=(4, pairs)) * 500, ROWS // 4, axis=0)
    forces = np.zeros((ROWS, tips))
    forces[40:44, tips - 1] = 3.0
    standard = Experiment(
        name="steps",
        step=STEP,
        voltages=voltages,
        forces=forces,
        rest_voltages=rng.normal(size=pairs) * 200,
        outputs=np.zeros((ROWS, len(sensors))),
        sensors=sensors,
    )
    return replace(standard, **changes)  # type: ignore[arg-type]


def prediction(model: BeamModel, data: Experiment, values: dict[str, float], **more: Real) -> Prediction:
    form, derivatives = modal_system(model, values, list(values))
    return predict(form, derivatives, drive_of(data, model), **more)


def deviation(got: Real, wanted: Real) -> float:
    """Largest difference of two arrays (n_s, rows), of each sensor over its largest value."""
    size = np.max(np.abs(wanted), axis=1)
    return float(np.max(np.max(np.abs(got - wanted), axis=1) / np.where(size > 0, size, 1.0)))


def check_all(model: BeamModel, data: Experiment, values: dict[str, float], tolerance: float = 1e-8) -> None:
    got = prediction(model, data, values)
    wanted = complex_step.response(model, data, {**values})
    assert deviation(got.outputs, wanted.real) < 1e-9
    for k, name in enumerate(values):
        h = complex_step.STEP
        stepped = complex_step.response(model, data, {**values, name: values[name] + 1j * h})
        assert deviation(got.parameters[k], stepped.imag / h) < tolerance, name


@pytest.mark.parametrize(("basis", "order"), [("clamped_free", 4), ("segment", 4)])
def test_all_parameters_of_three_beams(basis: str, order: int) -> None:
    structure = three_beams()
    model = beam_model(structure, basis, order)  # type: ignore[arg-type]
    check_all(model, experiment(structure, (0, 3, 5, 8)), structure.parameters())


def test_ten_modes_a_beam() -> None:
    structure = single_beam()
    model = beam_model(structure, "clamped_free", 10)
    check_all(model, experiment(structure, (0, 1, 2, 3, 4)), structure.parameters())


def test_overdamped_modes_are_real_eigenvalues() -> None:
    structure = single_beam(structural_damping=0.9)
    model = beam_model(structure, "clamped_free", 5)
    form, _ = modal_system(model, structure.parameters(), [])
    assert np.sum(form.poles.imag == 0) >= 4
    check_all(model, experiment(structure, (1, 3)), structure.parameters())


def test_identical_beams_without_springs_have_equal_eigenvalues() -> None:
    twin = beam(1)
    structure = Structure(
        beam=[twin, twin, twin],
        patch=[patch(1, on, 0.02) for on in (1, 2, 3)],
        point_of_interest=[point(1, 0.3), point(2, 0.3)],
        strain_gauge=[gauge(1, 0.06), gauge(3, 0.2)],
    )
    model = beam_model(structure, "clamped_free", 4)
    form, _ = modal_system(model, structure.parameters(), [])
    assert len(form.pairs) == 3 * 4
    check_all(model, experiment(structure, (0, 1, 2, 3)), structure.parameters())


def test_nearly_identical_beams() -> None:
    """Eigenvalues 1e-7 apart, on both sides of the limit at which pairs get responses of their own."""
    first = beam(1)
    for difference in (1e-3, 1e-7):
        second = replace(first, youngs_modulus=first.youngs_modulus * (1 + difference))
        structure = Structure(
            beam=[first, second],
            patch=[patch(1, 1, 0.02), patch(1, 2, 0.02)],
            spring=[],
            point_of_interest=[point(1, 0.3), point(2, 0.3)],
            strain_gauge=[gauge(1, 0.06)],
        )
        model = beam_model(structure, "clamped_free", 3)
        check_all(model, experiment(structure, (0, 1, 2)), structure.parameters())


@pytest.mark.parametrize("delay", [0.0, 0.7e-3, 2e-3, 5.3e-3])
def test_delays_of_sensors(delay: float) -> None:
    structure = three_beams()
    model = beam_model(structure, "clamped_free", 3)
    data, values = experiment(structure, (2, 6)), structure.parameters()
    got = prediction(model, data, values, delays=np.array([delay, 3.1e-3]))
    for sensor, late in enumerate((delay, 3.1e-3)):
        wanted = complex_step.response(model, data, {**values}, delay=complex(late))[sensor]
        assert np.max(np.abs(got.outputs[sensor] - wanted.real)) < 1e-9 * np.max(np.abs(wanted))
        for name in ("beam[2].density", "patch[1].structural_damping", "spring[2].stiffness"):
            h = complex_step.STEP
            stepped = complex_step.response(model, data, {**values, name: values[name] + 1j * h}, delay=complex(late))
            wanted = stepped[sensor].imag / h
            difference = got.parameters[list(values).index(name), sensor] - wanted
            assert np.max(np.abs(difference)) < 1e-8 * np.max(np.abs(wanted)), name


def test_the_derivative_with_respect_to_a_delay() -> None:
    structure = single_beam()
    model = beam_model(structure, "clamped_free", 3)
    data, values, delay = experiment(structure, (1, 2)), structure.parameters(), 3.3e-3
    got = prediction(model, data, values, delays=np.full(2, delay))
    h = complex_step.STEP
    wanted = complex_step.response(model, data, {**values}, delay=delay + 1j * h).imag / h
    assert deviation(got.delay, wanted) < 1e-8


def test_a_free_start_is_linear_in_its_loads() -> None:
    structure = three_beams()
    model = beam_model(structure, "clamped_free", 3)
    data, values = experiment(structure, (0, 4, 7), start="free"), structure.parameters()
    loads = np.array([0.5, -0.2, 0.1, 0.02, 0.01, -0.03])
    got = prediction(model, data, values, start=loads)
    wanted = complex_step.response(model, data, {**values}, loads=loads.astype(complex))
    assert deviation(got.outputs, wanted.real) < 1e-9
    h = complex_step.STEP
    for k in range(6):
        changed = loads.astype(complex)
        changed[k] += 1j * h
        wanted = complex_step.response(model, data, {**values}, loads=changed)
        assert deviation(got.start[k], wanted.imag / h) < 1e-8
    for name in ("beam[1].tip_mass", "spring[1].stiffness"):
        stepped = complex_step.response(
            model, data, {**values, name: values[name] + 1j * h}, loads=loads.astype(complex)
        )
        assert deviation(got.parameters[list(values).index(name)], stepped.imag / h) < 1e-8


def test_thinned_rows_are_rows_of_the_whole() -> None:
    structure = single_beam()
    model = beam_model(structure, "clamped_free", 3)
    data = replace(experiment(structure, (0, 2)), first_counted=7)
    form, derivatives = modal_system(model, structure.parameters(), ["beam[1].density"])
    whole = predict(form, derivatives, drive_of(replace(data, first_counted=0), model))
    thinned = predict(form, derivatives, drive_of(data, model), stride=5)
    assert np.array_equal(thinned.outputs, whole.outputs[:, 7::5])
    assert np.array_equal(thinned.parameters, whole.parameters[..., 7::5])


def test_proportional_inputs_are_one_channel() -> None:
    structure = three_beams()
    model = beam_model(structure, "clamped_free", 3)
    step = np.outer(np.arange(ROWS) > 10, [800.0, -700.0, 300.0, 500.0])
    data = replace(experiment(structure, (0,)), voltages=step, forces=None, rest_voltages=None)
    assert len(drive_of(data, model).channels) == 1
    assert len(drive_of(experiment(structure, (0,)), model).channels) == 5
