"""Voltages of a compensator made of a patch pair for a wanted course of effective voltages."""

import numpy as np

from flexbeams.plant.actuator.inverse import hysteresis_for, invert, voltage_for
from flexbeams.plant.actuator.operators import hysteresis, move_plays, relax
from flexbeams.plant.actuator.parameters import PatchPairActuator, operators
from flexbeams.plant.basis import Array


def commands_for(pair: PatchPairActuator, wanted: Array, step: float) -> Array:
    """Voltages (n,) of a compensator for wanted effective voltages (n,), one each step (s), from rest at 0 V on."""
    numbers = operators([pair])
    inverse = invert(numbers)
    plays, creeps = np.zeros_like(numbers.play_weight), np.zeros_like(numbers.creep_weight)
    commands = np.empty(len(wanted))
    for k in range(len(wanted)):
        h = hysteresis_for(numbers, creeps, wanted[k : k + 1], step)
        voltage = voltage_for(numbers, inverse, plays, h)
        move_plays(numbers, plays, voltage)
        relax(numbers, creeps, hysteresis(numbers, plays), step)
        commands[k] = voltage[0]
    return commands
