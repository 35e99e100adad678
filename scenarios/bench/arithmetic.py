"""Matrices and transitions that the bare loops compute with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.design import Design
from flexbeams.controller.observer import tick_matrices
from flexbeams.plant.basis import Array
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.galerkin import BeamModel


@dataclass(frozen=True, kw_only=True)
class Matrices:
    """Matrices of the loops of plant and controller."""

    transition: Array  # (n, n + inputs): [A_d, B_d] of the plant in energy coordinates
    outputs: Array  # (points + gauges, n / 2)
    filter: Array  # (states, states + voltages + gauges)
    regulator: Array  # (2 voltages, states + voltages)
    estimates: Array  # (points, states + voltages)
    gain: float  # of the integral, a sample
    limit: float  # V


def matrices_of(design: Design, model: BeamModel) -> Matrices:
    """The matrices of a design and its plant over a step of the design's sample time."""
    system = model.assemble()
    form = energy_form(system.M, system.D, system.K, np.hstack([system.L, system.F]))
    tick = tick_matrices(design.arrays)
    return Matrices(
        transition=np.hstack(discretise(form.A, form.B, design.options.sample_time)),
        outputs=np.vstack([model.deflection, model.strain]) @ form.position,
        filter=tick.filter,
        regulator=tick.regulator,
        estimates=tick.estimates,
        gain=design.integral_gain,
        limit=design.options.voltage_limit,
    )


@dataclass(frozen=True, kw_only=True)
class TransitionSequence:
    """Transitions of the flat output that are known from the start, in the order in which they begin and end."""

    begins: NDArray[np.int64]  # (count,), number of the step that each begins with
    durations: Array  # (count,), s
    changes: Array  # (count, voltages), V
    preview: float  # s
