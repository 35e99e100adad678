"""Measures of a response: overshoot, settling and decay, as the comparison with the paper defines them."""

import numpy as np

from flexbeams.plant.basis import Array


def overshoots(y: Array, end: Array) -> Array:
    """Largest deviation of y (k, p) beyond `end` (p,) in the direction of motion from zero, in units of y; (p,)."""
    beyond: Array = np.max((y - end) * np.sign(end), axis=0)
    return np.maximum(beyond, 0.0)


def last_time_outside(time: Array, deviation: Array, band: Array | float) -> float:
    """Last time at which any |deviation| (k, p) exceeds `band`; -inf where none ever does; NaN is outside."""
    outside = np.flatnonzero(~np.all(np.abs(deviation) <= band, axis=1))
    return float(time[outside[-1]]) if outside.size else -np.inf


def settling_time(time: Array, y: Array, end: Array, start: float, share: float = 0.02) -> float:
    """Seconds from `start` to the last time that a y_i deviates by more than `share` of its own |end_i|."""
    return max(0.0, last_time_outside(time, y - end, share * np.abs(end)) - start)


def motion_settling_time(time: Array, y: Array, end: Array, start: float, share: float = 0.02) -> float:
    """Seconds from `start` to the last deviation of any y_i by more than `share` of the largest |end_i|."""
    return max(0.0, last_time_outside(time, y - end, share * float(np.max(np.abs(end)))) - start)


def decay_time(time: Array, y: Array, before: Array, start: float, peak: float, share: float = 0.02) -> float:
    """Seconds from `start` to the last deviation of any y_i from `before` by more than `share` of `peak`."""
    return max(0.0, last_time_outside(time, y - before, share * peak) - start)
