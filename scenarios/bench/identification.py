"""What an identification costs: processor time of fits to noisy steps of known parameters, from a start 20 % off."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import hadamard

from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.method import identify
from flexbeams.plant.identification.sensitivity import drive_of, modal_system, predict
from flexbeams.plant.identification.space import parameter_space
from flexbeams.plant.structure import find_structure, read_structure

EXPERIMENTS, STEP, ONSET = 4, 1e-3, 0.2  # number, s, s
VOLTAGE, NOISE, OFF = 800.0, 0.005, 0.2  # V; share of each sensor's largest value; of the start
CLOSE = 0.02  # a parameter within it counts as found


@dataclass(frozen=True, kw_only=True)
class Case:
    """A structure and what is known of it."""

    structure: str
    seconds: float  # of each experiment
    known: tuple[str, ...] = ("beam[1].tip_mass",)


CASES = (
    Case(structure="kiel", seconds=5.0),
    Case(structure="kiel", seconds=10.0),
    Case(structure="five_beams", seconds=5.0),
)


def measure_identification(
    cases: Sequence[Case] = CASES, progress: Callable[[int, int], None] = lambda done, parts: None
) -> dict[str, Any]:
    """For each case the processor time of its fit, s, and how many parameters it finds."""
    figures = []
    for number, case in enumerate(cases):
        progress(number, len(cases))
        figures.append(_measured(case))
    progress(len(cases), len(cases))
    return {"fits": figures}


def _measured(case: Case) -> dict[str, Any]:
    structure = read_structure(find_structure(case.structure))
    truth, rng = structure.parameters(), np.random.default_rng(1)
    data = _recorded(beam_model(structure), truth, round(case.seconds / STEP), rng)
    rng = np.random.default_rng(2)
    changed = {n: v * (1 + OFF * rng.choice([-1, 1])) for n, v in truth.items() if n not in case.known}
    start = structure.with_parameters(changed)
    space = parameter_space(start, known={name: truth[name] for name in case.known})
    begin = time.process_time()
    result = identify(start, data, space)
    seconds = time.process_time() - begin
    return {
        "structure": case.structure,
        "parameters": len(truth),
        "rows": sum(experiment.rows for experiment in data),
        "cpu_s": seconds,
        "evaluations": result.estimate.evaluations,
        "found": sum(abs(p.value / truth[p.name] - 1) < CLOSE for p in result.parameters),
    }


def _recorded(model: BeamModel, truth: dict[str, float], rows: int, rng: np.random.Generator) -> list[Experiment]:
    """Steps of all pairs with signs by a Hadamard matrix, and noise."""
    pairs, sensors = len(model.structure.patch), len(model.deflection) + len(model.strain)
    signs = np.tile(hadamard(EXPERIMENTS), -(-pairs // EXPERIMENTS))[:, :pairs]
    form, _ = modal_system(model, truth, [])
    found = []
    for row in signs:
        voltages = np.zeros((rows, pairs))
        voltages[round(ONSET / STEP) :] = VOLTAGE * row
        silent = Experiment(
            name="step", step=STEP, voltages=voltages, outputs=np.zeros((rows, sensors)), sensors=tuple(range(sensors))
        )
        outputs = predict(form, [], drive_of(silent, model)).outputs.T
        noise = NOISE * np.max(np.abs(outputs), axis=0) * rng.standard_normal(outputs.shape)
        found.append(replace(silent, outputs=outputs + noise))
    return found
