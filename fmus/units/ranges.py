"""Plausible ranges of inputs: a value beyond is a fault of whoever sets it, and refused.

They are wide, far beyond what the linear model of the beams is good for.
"""

import math

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.plant.galerkin import BeamModel

VOLTAGE_FACTOR = 10.0  # of the design's voltage limit
STATE_FACTOR = 100.0  # of the reduced states that rest under the voltage limit
FORCE_FACTOR = 100.0  # of the force that bends a beam by its length

Range = dict[str, float]  # minimum and maximum, arguments of Variable


def voltage_range(design: Design) -> Range:
    """Of voltages, V."""
    return _symmetric(VOLTAGE_FACTOR * design.options.voltage_limit)


def state_range(design: Design) -> Range:
    """Of references of reduced states, a power of ten."""
    A, B = design.arrays["A_d"], design.arrays["B_d"]
    at_rest = np.linalg.solve(np.eye(len(A)) - A, B) * design.options.voltage_limit
    return _symmetric(_power_of_ten(STATE_FACTOR * float(np.abs(at_rest).sum(axis=1).max())))


def force_range(model: BeamModel) -> Range:
    """Of forces on the tips, N, a power of ten."""
    compliance = np.einsum("jn,nj->j", model.tips, np.linalg.solve(model.assemble().K, model.tips.T))
    forces = [beam.length / c for beam, c in zip(model.structure.beam, compliance.tolist(), strict=True)]
    return _symmetric(_power_of_ten(FORCE_FACTOR * max(forces)))


def target_range(design: Design) -> Range:
    """Of target deflections, m: the length of the longest beam."""
    return _symmetric(max(beam.length for beam in design.structure.beam))


def _symmetric(largest: float) -> Range:
    return {"minimum": -largest, "maximum": largest}


def _power_of_ten(value: float) -> float:
    """The smallest one that is not below the value."""
    return float(f"1e{math.ceil(math.log10(value))}")
