"""The inverse of hysteresis and creep in closed form, see flexbeams.plant.actuator.operators.

Inverse thresholds are images of the thresholds, inverse weights differences of reciprocal slopes (Kuhnen 2003).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexbeams.plant.actuator.operators import (
    Operators,
    Reals,
    creep_shares,
    dead_zone_gains,
    one_sided,
    through_dead_zones,
)


@dataclass(frozen=True, kw_only=True)
class Inverse:
    """Parameters of the inverse operators of all channels, (channels, operators)."""

    play_threshold: Reals  # r'_i = sum_{j <= i} w_j (r_i - r_j), V
    play_weight: Reals  # w'_0 = 1 / W_0, w'_i = 1 / W_i - 1 / W_{i-1}, with W_i = w_0 + ... + w_i
    dead_zone_threshold: Reals  # the image of each threshold, V
    dead_zone_slope: Reals  # 1 / S_j - 1 / S_{j-1}, with S_j = 1 + s_1 + ... + s_j on each side


def invert(operators: Operators) -> Inverse:
    """The inverse of operators that break no rule."""
    w, r = operators.play_weight, operators.play_threshold
    sums = np.cumsum(w, axis=1)
    slopes = np.zeros_like(operators.dead_zone_slope)
    for k, j, gain in dead_zone_gains(operators):
        slopes[k, j] = 1.0 / gain - 1.0 / (gain - operators.dead_zone_slope[k, j])
    images = [through_dead_zones(operators, column) for column in operators.dead_zone_threshold.T]
    return Inverse(
        play_threshold=sums * r - np.cumsum(w * r, axis=1),
        play_weight=np.diff(1.0 / sums, axis=1, prepend=0.0),
        dead_zone_threshold=np.stack(images, axis=1),
        dead_zone_slope=slopes,
    )


def voltage_for(operators: Operators, inverse: Inverse, plays: Reals, h: Reals) -> Reals:
    """Voltages (channels,) that bring the hysteresis from the states `plays` to h (channels,), V."""
    zones = one_sided(inverse.dead_zone_threshold, h[:, None])
    z = h + np.sum(inverse.dead_zone_slope * zones, axis=1)
    w = operators.play_weight
    outer = np.sum(w * plays, axis=1)[:, None] - np.cumsum(w * plays, axis=1)
    states = np.cumsum(w, axis=1) * plays + outer  # of the inverse plays: sum_{j <= i} w_j p_i + sum_{j > i} w_j p_j
    moved = np.maximum(z[:, None] - inverse.play_threshold, np.minimum(z[:, None] + inverse.play_threshold, states))
    voltage: Reals = np.sum(inverse.play_weight * moved, axis=1)
    return voltage


def hysteresis_for(operators: Operators, creeps: Reals, u_eff: Reals, step: float) -> Reals:
    """h (channels,) that, held for a step (s), gives u_eff (channels,) at its end: the discrete inverse of creep."""
    shares = creep_shares(operators, step)
    a = operators.creep_weight
    h: Reals = (u_eff - np.sum(a * (1.0 - shares) * creeps, axis=1)) / (1.0 + np.sum(a * shares, axis=1))
    return h
