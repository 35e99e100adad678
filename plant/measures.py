"""Measures of a response: overshoot, settling and decay, defined as for the comparison with the paper."""

import numpy as np

from flexbeams.plant.basis import Array


def overshoots(y: Array, end: Array) -> Array:
    """Largest deviation of y (k, p) beyond `end` (p,) in the direction of motion from zero, in units of y; (p,)."""
    beyond: Array = np.max((y - end) * np.sign(end), axis=0)
    return np.maximum(beyond, 0.0)


def last_time_outside(time: Array, deviation: Array, band: Array | float) -> float:
    """Last time at which any |deviation| (k, p) exceeds `band`; -inf where none does; NaN counts as outside."""
    outside = np.flatnonzero(~np.all(np.abs(deviation) <= band, axis=1))
    return float(time[outside[-1]]) if outside.size else -np.inf


def settling_time(time: Array, y: Array, end: Array, start: float, tolerance: float = 0.02) -> float:
    """Seconds from `start` to the last time that a y_i deviates by more than `tolerance` of its own |end_i|."""
    return max(0.0, last_time_outside(time, y - end, tolerance * np.abs(end)) - start)


def motion_settling_time(time: Array, y: Array, end: Array, start: float, tolerance: float = 0.02) -> float:
    """Seconds from `start` to the last deviation of any y_i by more than `tolerance` of the largest |end_i|."""
    return max(0.0, last_time_outside(time, y - end, tolerance * float(np.max(np.abs(end)))) - start)


def decay_time(time: Array, y: Array, before: Array, start: float, peak: float, tolerance: float = 0.02) -> float:
    """Seconds from `start` to the last deviation of any y_i from `before` by more than `tolerance` of `peak`."""
    return max(0.0, last_time_outside(time, y - before, tolerance * peak) - start)
