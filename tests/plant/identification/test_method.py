"""Identification on synthetic data whose parameters are known."""

import os
from dataclasses import replace
from functools import cache

import numpy as np
import pandas
import pytest
from nfoursid.nfoursid import NFourSID

from flexbeams.plant.errors import InputError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.method import Identification, identify
from flexbeams.plant.identification.modal import modal_form
from flexbeams.plant.identification.space import parameter_space
from flexbeams.plant.statespace import static_gains
from flexbeams.plant.structure import find_structure, read_structure
from tests.plant.identification.data import (
    HELD_BACK,
    PATTERNS,
    TIP_MASS,
    changed_start,
    kiel,
    measured,
    responses,
    rms,
    space_of,
    steps,
)

pytestmark = pytest.mark.slow

# Seeds of the noise; 200 for the full measurement (one to two seconds each)
SEEDS = int(os.environ.get("FLEXBEAMS_IDENTIFICATION_SEEDS", "4"))
TARGET = np.array([-8e-3, 1e-3, 4e-3, -6e-3])  # m


@cache
def identified(seed: int, share: float = 0.2, rows: int = 1000, step: float = 5e-3) -> Identification:
    structure, model = kiel()
    data = measured(model, structure.parameters(), steps(PATTERNS, 10, rows=rows, step=step), 0.005, seed)
    start = changed_start(structure, share, seed)
    return identify(start, data, space_of(start))


@pytest.mark.parametrize(("share", "rows", "step"), [(0.2, 5000, 1e-3), (0.4, 2500, 2e-3)])
def test_the_same_basis_gives_the_parameters_back(share: float, rows: int, step: float) -> None:
    structure, model = kiel()
    truth = structure.parameters()
    result = identified(1, share=share, rows=rows, step=step)
    assert sum(abs(p.value / truth[p.name] - 1) < 0.02 for p in result.parameters) >= 24
    wanted = responses(model, truth, steps(HELD_BACK, 10))[0]
    got = responses(model, result.structure.parameters(), steps(HELD_BACK, 10))[0]
    assert np.all(rms(got - wanted) < 0.0015 * rms(wanted))


def test_viscous_dampings_of_patches_are_undetermined_and_keep_their_start() -> None:
    result = identified(2)
    assumed = {p.name: p for p in result.parameters if p.status == "assumed"}
    assert {"patch[1].viscous_damping", "patch[2].viscous_damping", "patch[4].viscous_damping"} <= set(assumed)
    assert all(p.value == p.start for p in assumed.values())
    named = {name for direction in result.joint.directions for name in direction.shares}
    assert {"patch[2].viscous_damping", "patch[4].viscous_damping"} <= named
    assert all(p.deviation < 0.15 for p in result.fitted)


def test_known_parameters_stay() -> None:
    result = identified(2)
    known = [p for p in result.parameters if p.status == "known"]
    assert [(p.name, p.value, p.deviation) for p in known] == [(TIP_MASS, kiel()[0].beam[0].tip_mass, 0.0)]


def test_intervals_cover_the_truth() -> None:
    truth = kiel()[0].parameters()
    inside = []
    for seed in range(SEEDS):
        result = identified(seed)
        inside += [abs(np.log(p.value / truth[p.name])) < 1.96 * p.deviation for p in result.fitted]
    spread = 4 * np.sqrt(0.95 * 0.05 / len(inside)) if SEEDS < 200 else 0.0
    assert 0.92 - spread < np.mean(inside) < 0.98 + spread


def test_the_exact_plant_is_met_by_ten_modes() -> None:
    """Data of the exact plant: a controller designed on the identified ten modes lands on target."""
    structure, exact = kiel("segment")
    truth = structure.parameters()
    data = measured(exact, truth, steps(PATTERNS, 10, rows=2500, step=2e-3), 0.005, 1)
    start = changed_start(structure, 0.2, 3)
    result = identify(start, data, space_of(start))
    gain = static_gains(exact, exact.assemble())[0]

    def end_error(values: dict[str, float]) -> np.ndarray:
        model = kiel()[1]
        own, _ = static_gains(model, model.assemble(values))
        return np.asarray(gain @ np.linalg.solve(own, TARGET) - TARGET)

    assert np.max(np.abs(end_error(truth))) > 0.5e-3  # the published values on the exact plant
    after = np.abs(end_error(result.structure.parameters()))
    assert np.max(after) < 0.02e-3
    assert np.max(after) < 0.005 * np.max(np.abs(TARGET))
    # strains of ten modes are off; their residuals are no noise, and so they keep a small weight
    assert np.all(result.estimate.weights[:4] == 1)
    assert np.all(result.estimate.weights[4:] == 0.1)


def test_white_residuals_give_gauges_their_full_weight() -> None:
    assert np.all(identified(0).estimate.weights == 1)


def subspace_modes(experiment: Experiment, near: np.ndarray) -> np.ndarray:
    """(frequency, damping ratio) nearest to given frequencies by N4SID of the package nfoursid; (settings, 3, 2)."""
    drive = experiment.voltages[:, :1] / np.max(np.abs(experiment.voltages))
    found = []
    for stride in (5, 6, 7, 8):
        for rank in (12, 14, 16):
            signals = np.hstack([drive, 1e3 * experiment.outputs[:, :4]])[::stride]
            names = ["u", "a", "b", "c", "d"]
            method = NFourSID(
                pandas.DataFrame(signals, columns=names),
                output_columns=names[1:],
                input_columns=["u"],
                num_block_rows=12,
            )
            method.subspace_identification()
            system, _ = method.system_identification(rank=rank)
            poles = np.log(np.linalg.eigvals(system.a).astype(complex)) / (stride * experiment.step)
            poles = poles[(poles.imag > 5) & (-poles.real < 0.1 * np.abs(poles))]
            poles = poles[[int(np.argmin(np.abs(np.abs(poles) - frequency))) for frequency in near]]
            found.append(np.column_stack([np.abs(poles), -poles.real / np.abs(poles)]))
    return np.array(found)


def test_an_independent_subspace_identification_agrees() -> None:
    """Frequencies and dampings of the identified model, within the spread that N4SID's own settings leave."""
    structure, model = kiel()
    data = measured(model, structure.parameters(), steps(PATTERNS, 10), 0.0005, 1)
    start = changed_start(structure, 0.2, 4)
    poles = modal_form(model, identify(start, data, space_of(start)).structure.parameters()).poles[:3]
    ours = np.column_stack([np.abs(poles), -poles.real / np.abs(poles)])
    theirs = subspace_modes(data[2], ours[:, 0])
    centre, spread = np.median(theirs, axis=0), 3 * np.median(np.abs(theirs - np.median(theirs, axis=0)), axis=0)
    assert np.all(spread[:, 0] < 0.01 * centre[:, 0])
    assert np.all(spread[:, 1] < 0.8 * centre[:, 1])
    assert np.all(np.abs(ours - centre) < spread)


def test_an_open_scale_asks_for_a_known_mass() -> None:
    structure, model = kiel()
    data = measured(model, structure.parameters(), steps(PATTERNS[:1], 10, rows=200), 0.005, 1)
    with pytest.raises(InputError, match=r"beams 1, 2, 3 .* common factor .* --known beam\[1\]\.tip_mass=0\.0202"):
        identify(structure, data, parameter_space(structure))


def test_far_starts_come_from_measured_frequencies() -> None:
    structure, model = kiel()
    truth = structure.parameters()
    data = measured(model, truth, steps(PATTERNS, 10), 0.005, 1)
    masses = {f"beam[{k}].tip_mass": 3 * truth[f"beam[{k}].tip_mass"] for k in (2, 3)}
    start = structure.with_parameters({**masses, "spring[1].stiffness": 3 * truth["spring[1].stiffness"]})
    result = identify(start, data, space_of(start))
    assert "fitted to measured frequencies" in result.start.method
    assert sum(abs(p.value / truth[p.name] - 1) < 0.02 for p in result.parameters) >= 24


def test_segment_basis_on_its_own_data() -> None:
    structure, _ = kiel()
    model = beam_model(structure, "segment", 4)
    truth = structure.parameters()
    data = measured(model, truth, steps(PATTERNS[:2], 10, rows=500), 0.002, 1)
    start = changed_start(structure, 0.1, 5)
    result = identify(start, data, space_of(start), basis="segment", order=4)
    assert sum(abs(p.value / truth[p.name] - 1) < 0.02 for p in result.parameters) >= 20


def test_one_parameter_from_a_smooth_record_without_noise() -> None:
    """The first rows say nothing of the modulus; a search that stays near zero must not end there."""
    structure = read_structure(find_structure("single_beam"))
    model, name = beam_model(structure, "clamped_free"), "beam[1].youngs_modulus"
    truth = {**structure.parameters(), name: 1.05 * structure.parameters()[name]}
    rise = np.clip(np.arange(3000) * 2e-3 - 1, 0, 1)
    record = replace(steps(np.array([[300.0]]), 3, rows=3000, step=2e-3)[0], voltages=300 * rise[:, None] ** 8)
    result = identify(structure, measured(model, truth, [record], 0.0, 1), parameter_space(structure, free=[name]))
    assert result.structure.parameters()[name] == pytest.approx(truth[name], rel=1e-6)
