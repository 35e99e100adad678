"""Signals that drive inputs from outside the units."""

import numpy as np

from plant.basis import Array
from plant.errors import InputError
from scenarios.schema import Input


def width(signal: Input) -> int:
    """How many elements the signal has by itself; 1 for a number, which may be spread."""
    if signal.targets:
        sizes = {len(t.value) for t in signal.targets}
        if len(sizes) != 1:
            raise InputError("targets", "must all have the same number of values", sorted(sizes))
        return sizes.pop()
    value = signal.step.value if signal.step else signal.constant
    return len(value) if isinstance(value, list) else 1


def sample(signal: Input, time: Array) -> Array:
    """Values at `time` (k,), shape (k, width); piecewise constant signals are continuous from the right.

    A time counts as reached from 1e-9 s before on, so that rounding of k * step cannot shift an edge by a step.
    """
    now = time + 1e-9
    if signal.constant is not None:
        return np.tile(np.atleast_1d(np.asarray(signal.constant, dtype=float)), (len(time), 1))
    if signal.step:
        value = np.atleast_1d(np.asarray(signal.step.value, dtype=float))
        return np.outer(now >= signal.step.time, value)
    if signal.pulse:
        pulse = signal.pulse
        phase = (time - pulse.time) / pulse.duration
        inside = (now >= pulse.time) & (phase < 1)
        return np.where(inside, np.sin(np.pi * phase) * np.pi * pulse.impulse / (2 * pulse.duration), 0.0)[:, None]
    targets = signal.targets or []
    values = np.array([np.zeros(len(targets[0].value)), *[t.value for t in targets]])
    index = np.searchsorted([t.time for t in targets], now, side="right")
    return values[index]
