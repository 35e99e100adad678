"""Weights over nine decades, rates from 500 Hz to 50 kHz, and 200 uncertain plants.

Short here, with seeds. FLEXBEAMS_ROBUSTNESS=full takes the whole grid of weights, all rates and all plants: minutes.
"""

import os
from itertools import product

import numpy as np
import pytest

from flexbeams.controller.closed_loop import closed_loop_poles, sampled_controller, sampled_plant
from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.modal_loop import DisturbedPlant, ModalLoop
from flexbeams.controller.options import DesignOptions, Weights
from flexbeams.controller.static_error import random_parameters
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError
from flexbeams.plant.measures import decay_time
from flexbeams.plant.structure import Structure, find_structure, read_structure
from tests.helpers import design_of
from tests.oracles.monolithic import plant_matrices, recursion_matrix

FULL = os.environ.get("FLEXBEAMS_ROBUSTNESS") == "full"
SAMPLE = 2e-4
DECADES = range(-3, 7)
RUN = 100_000  # samples: 20 s
PEAK = 0.0319  # m, of the open loop in the scenario disturbance


def grid(structure: str) -> list[tuple[int, int]]:
    """Decades on the totals of filter and regulator."""
    if FULL:
        return list(product(DECADES, DECADES))
    random = np.random.default_rng(len(structure))
    return [(int(a), int(b)) for a, b in random.choice(DECADES, size=(7 if structure == "kiel" else 3, 2))]


def scaled(kalman: int, lqr: int) -> Weights:
    """The published weights with their totals times powers of ten."""
    published = Weights()
    return Weights(
        kalman_q_total=10.0**kalman * published.kalman_q_total, lqr_q_total=10.0**lqr * published.lqr_q_total
    )


def unverified(structure: Structure, options: DesignOptions) -> Design:
    """A design that no verification refuses."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("flexbeams.controller.verification.VerifiedLoop.stable", property(lambda self: True))
        return compute_design(structure, options)


def recursions(made: Design) -> list[tuple[Array, Array]]:
    """The oracle's recursion and its output y_pi on the design's own plant and on the exact one."""
    result = []
    for basis in ("clamped_free", "segment"):
        plant = plant_matrices(made.model(basis), SAMPLE)  # type: ignore[arg-type]
        matrix = recursion_matrix(made, plant, made.integral_gain)
        result.append((matrix, np.hstack([plant.y_pi, np.zeros((len(plant.y_pi), len(matrix) - len(plant.A)))])))
    return result


def run_of(matrix: Array, output: Array, steps: int, stride: int = 50) -> Array:
    """Deflections (rows, n_pi) at every `stride`-th sample from a plant that is bent at first."""
    state = np.zeros(len(matrix))
    state[: len(matrix) // 2] = output[:, : len(matrix) // 2].sum(axis=0)
    power, rows = np.linalg.matrix_power(matrix, stride), []
    for _ in range(steps // stride + 1):
        rows.append(output @ state)
        state = power @ state
    return np.array(rows)


@pytest.mark.slow
@pytest.mark.timeout(1800 if FULL else 180)
@pytest.mark.parametrize("structure", ["kiel", "five_beams"])
def test_accepted_designs_are_stable_and_refused_ones_are_not(structure: str) -> None:
    """Accepted: deflections die out in a run of 20 s on both plants. Refused: a pole outside the circle on one."""
    described, verdicts = read_structure(find_structure(structure)), []
    for kalman, lqr in grid(structure):
        options = DesignOptions(weights=scaled(kalman, lqr))
        try:
            made, refused = compute_design(described, options), False
        except DesignError as error:
            assert "the sampled loop is unstable on" in str(error)  # noqa: PT017
            made, refused = unverified(described, options), True
        verdicts.append(refused)
        loops = recursions(made)
        if refused:
            assert max(np.abs(np.linalg.eigvals(matrix)).max() for matrix, _ in loops) > 1 + 1e-10, (kalman, lqr)
            continue
        for matrix, output in loops:
            y = np.abs(run_of(matrix, output, RUN)).max(axis=1)
            assert y[-200:].max() < 0.5 * y[:200].max(), (kalman, lqr)
    assert any(verdicts)
    assert not all(verdicts)


@pytest.mark.parametrize("rate", [500.0, 1e3, 2e3, 1e4, 2e4, 5e4] if FULL else [500.0, 5e4])
def test_the_hammer_blow_decays_alike_at_every_rate(rate: float) -> None:
    """Decay of the scenario disturbance within 10 % of that at 5 kHz, the blow of 0.0358 N s spread over 5 ms."""
    reference = decay_of(design_of())
    assert reference == pytest.approx(2.87, abs=0.02)
    made = compute_design(read_structure(find_structure("kiel")), DesignOptions(sample_time=1 / rate))
    assert decay_of(made) == pytest.approx(reference, rel=0.1)


def decay_of(made: Design) -> float:
    step = made.options.sample_time
    count = max(1, round(5e-3 / step))
    forces = np.zeros((count + 1, 3))
    shape = np.sin(np.pi * (np.arange(count) + 0.5) / count)
    forces[:count, 1] = 0.0358 / step * shape / shape.sum()
    loop = ModalLoop(DisturbedPlant.of(made.model(), step), sampled_controller(made.arrays, made.integral_gain))
    response = loop.response(forces, 8.0)
    return decay_time(response.time, response.y, np.zeros(4), 0.0, PEAK)


@pytest.mark.parametrize("static_maps", ["basis", "segment"])
def test_offset_free_loops_on_uncertain_plants_are_stable(static_maps: str) -> None:
    """All 37 values +-10 %: N = 10 on N = 10 with its own statics, and on the exact plant with exact statics."""
    options = DesignOptions(observer="offset_free", static_maps=static_maps, verify="design")
    made = compute_design(read_structure(find_structure("kiel")), options)
    controller, values = sampled_controller(made.arrays, made.integral_gain), made.structure.parameters()
    model = made.model("segment") if static_maps == "segment" else made.model()
    for parameters in random_parameters(values, dict.fromkeys(values, 0.1), 200 if FULL else 12, seed=7):
        assert closed_loop_poles(controller, sampled_plant(model, SAMPLE, parameters))[0].real < -0.1
