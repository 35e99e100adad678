"""Synthetic measurements: the shipped three-beam structure, voltage steps, white noise."""

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.choices import BasisName
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.identification.experiment import Experiment
from flexbeams.plant.identification.sensitivity import drive_of, modal_system, predict
from flexbeams.plant.identification.space import ParameterSpace, parameter_space
from flexbeams.plant.structure import Structure, find_structure, read_structure

Real = NDArray[np.float64]
# Steps on all pairs at once; no two are proportional
PATTERNS = 800.0 * np.array([[1, 1, 1, 1], [1, -1, 1, -1], [1, 1, -1, -1], [1, -1, -1, 1]])
HELD_BACK = np.array([[817.0, -770.0, -807.0, 781.0]])  # (48)
TIP_MASS = "beam[1].tip_mass"


@cache
def kiel(basis: BasisName = "clamped_free") -> tuple[Structure, BeamModel]:
    structure = read_structure(find_structure("kiel"))
    return structure, beam_model(structure, basis)


def steps(patterns: Real, sensors: int, *, rows: int = 700, step: float = 5e-3, at: float = 0.2) -> list[Experiment]:
    """An experiment for each pattern of voltages, applied from `at` seconds on."""
    experiments = []
    for k, pattern in enumerate(patterns, 1):
        voltages = np.zeros((rows, len(pattern)))
        voltages[round(at / step) :] = pattern
        experiments.append(
            Experiment(
                name=f"step {k}",
                step=step,
                voltages=voltages,
                outputs=np.zeros((rows, sensors)),
                sensors=tuple(range(sensors)),
            )
        )
    return experiments


def responses(model: BeamModel, values: dict[str, float], experiments: list[Experiment]) -> list[Real]:
    """The outputs (rows, n_s) of each experiment."""
    form, _ = modal_system(model, values, [])
    return [predict(form, [], drive_of(e, model)).outputs.T for e in experiments]


def measured(
    model: BeamModel, values: dict[str, float], experiments: list[Experiment], noise: float, seed: int
) -> list[Experiment]:
    """The experiments with outputs and white noise of a share of each sensor's largest value over all of them."""
    rng = np.random.default_rng(seed)
    outputs = responses(model, values, experiments)
    size = np.max([np.max(np.abs(y), axis=0) for y in outputs], axis=0)
    return [
        replace(e, outputs=y + noise * size * rng.standard_normal(y.shape))
        for e, y in zip(experiments, outputs, strict=True)
    ]


def changed_start(structure: Structure, share: float, seed: int) -> Structure:
    """Every parameter but TIP_MASS larger or smaller by `share`."""
    rng = np.random.default_rng(seed)
    signs = {name: rng.choice([-1, 1]) for name in structure.parameters()}
    return structure.with_parameters(
        {name: v * (1 + share * signs[name]) for name, v in structure.parameters().items() if name != TIP_MASS}
    )


def space_of(start: Structure) -> ParameterSpace:
    """All parameters free but the weighed tip mass."""
    return parameter_space(start, known={TIP_MASS: start.parameters()[TIP_MASS]})


def rms(values: Real) -> Real:
    """Root mean square over the rows (rows, n)."""
    root: Real = np.sqrt(np.mean(values**2, axis=0))
    return root
