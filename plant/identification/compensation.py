"""What a compensator made of a fit would leave: its voltages for the measured response, beside those applied."""

import numpy as np

from flexbeams.plant.actuator.inverse import hysteresis_for, invert, voltage_for
from flexbeams.plant.actuator.operators import hysteresis, move_plays, relax
from flexbeams.plant.actuator.parameters import PatchPairActuator, operators
from flexbeams.plant.basis import Array
from flexbeams.plant.identification.hysteresis import HysteresisFit


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


def remaining_error(fit: HysteresisFit) -> tuple[Array, float, float]:
    """Voltages that the compensator would have commanded for the measured response, (n,), and their error.

    The error is that of the voltage over its range, largest and rms over the rows that count: near the share of the
    stroke by which the response would miss.
    """
    loops = fit.loops
    commands = commands_for(fit.pair, (loops.response - fit.offset) / fit.gain, loops.step)
    error = (commands - loops.voltage)[loops.first_counted :] / np.ptp(loops.voltage)
    return commands, float(np.max(np.abs(error))), float(np.sqrt(np.mean(error**2)))
