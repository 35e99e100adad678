"""Hysteresis and creep of piezoelectric patches, by channel.

K. Kuhnen, Modeling, identification and compensation of complex hysteretic nonlinearities: a modified Prandtl-Ishlinskii
approach, European Journal of Control 9 (2003) 407-418.

z = sum_i w_i p_i is a superposition of play operators, the first of which is the linear part with the threshold 0,
h = z + sum_j s_j D_j(z) one of one-sided dead zones, and u_eff = h + sum_i a_i c_i adds creep,
c_i' = (h - c_i) / tau_i. All arrays are (channels, operators), all states are changed in place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Operators:
    """Parameters of all channels."""

    play_threshold: Reals  # V, ascending from 0, that of the linear part
    play_weight: Reals  # 1, that of the linear part > 0, others >= 0
    dead_zone_threshold: Reals  # V, ascending; those below 0 act below, others above
    dead_zone_slope: Reals  # 1
    creep_time: Reals  # s
    creep_weight: Reals  # 1


def with_linear_part(first: Reals | float, rows: Reals) -> Reals:
    """Thresholds or weights (channels, n) of play operators behind those of the linear part (channels,)."""
    column = np.broadcast_to(np.asarray(first, dtype=np.float64), len(rows))
    return np.column_stack([column, rows])


def move_plays(operators: Operators, plays: Reals, voltage: Reals) -> None:
    """Plays p_i = max(v - r_i, min(v + r_i, p_i)) under voltages (channels,) that changed monotonically."""
    v = voltage[:, None]
    np.maximum(v - operators.play_threshold, np.minimum(v + operators.play_threshold, plays), out=plays)


def superposition(operators: Operators, plays: Reals) -> Reals:
    """z (channels,), V."""
    z: Reals = np.sum(operators.play_weight * plays, axis=1)
    return z


def through_dead_zones(operators: Operators, z: Reals) -> Reals:
    """h (channels,) for z (channels,), V."""
    h: Reals = z + np.sum(operators.dead_zone_slope * one_sided(operators.dead_zone_threshold, z[:, None]), axis=1)
    return h


def one_sided(threshold: Reals, z: Reals) -> Reals:
    """D_j(z): what exceeds a threshold >= 0 from above or one < 0 from below, 0 between."""
    beyond: Reals = np.where(threshold >= 0.0, np.maximum(z - threshold, 0.0), np.minimum(z - threshold, 0.0))
    return beyond


def hysteresis(operators: Operators, plays: Reals) -> Reals:
    """h (channels,), V, of the present plays."""
    return through_dead_zones(operators, superposition(operators, plays))


def creep_shares(operators: Operators, step: float) -> Reals:
    """1 - exp(-step / tau_i): the part of its way that each creep operator goes in a step (s)."""
    shares: Reals = -np.expm1(-step / operators.creep_time)
    return shares


def relax(operators: Operators, creeps: Reals, h: Reals, step: float) -> None:
    """Creep over a step (s) during which h (channels,) holds."""
    creeps += (h[:, None] - creeps) * creep_shares(operators, step)


def with_creep(operators: Operators, creeps: Reals, h: Reals) -> Reals:
    """u_eff (channels,), V."""
    u_eff: Reals = h + np.sum(operators.creep_weight * creeps, axis=1)
    return u_eff


def start_from(operators: Operators, history: Reals, plays: Reals, creeps: Reals) -> Reals:
    """States after the voltages `history` (channels, k) from the demagnetised state on, at rest under the last one.

    Returns that one (channels,), V.
    """
    plays[:] = 0.0
    for voltage in history.T:
        move_plays(operators, plays, voltage)
    creeps[:] = hysteresis(operators, plays)[:, None]
    last: Reals = history[:, -1].copy()
    return last


def broken_rule(operators: Operators, name: Callable[[str, int, int], str]) -> str | None:
    """The rule that a parameter breaks and that the inverse needs, in a line; None where there is none.

    `name` gives the name of a parameter of a channel and an operator, both from 0, without the linear part.
    """
    for key, thresholds in (
        ("play_threshold", operators.play_threshold[:, 1:]),
        ("dead_zone_threshold", operators.dead_zone_threshold),
    ):
        for k, j in zip(*np.nonzero(np.diff(thresholds, axis=1) < 0), strict=True):
            before, value = float(thresholds[k, j]), float(thresholds[k, j + 1])
            return f"{name(key, k, j + 1)} must be >= {before!r}, the threshold before, got {value!r}"
    for k, j, slope in dead_zone_gains(operators):
        if not slope > 0.0:
            rule = "must leave the sum of slopes 1 + ... beyond its threshold > 0, else there is no inverse"
            return f"{name('dead_zone_slope', k, j)} {rule}, got a sum of {slope!r}"
    return None


def dead_zone_gains(operators: Operators) -> list[tuple[int, int, float]]:
    """Channel, dead zone and the slope of h over z beyond its threshold, from the inner zones to the outer ones."""
    gains = []
    for k, (thresholds, slopes) in enumerate(
        zip(operators.dead_zone_threshold.tolist(), operators.dead_zone_slope.tolist(), strict=True)
    ):
        sides = (
            [j for j, threshold in enumerate(thresholds) if threshold >= 0.0],
            [j for j, threshold in reversed(list(enumerate(thresholds))) if threshold < 0.0],
        )
        for side in sides:
            gain = 1.0
            for j in side:
                gain += slopes[j]
                gains.append((k, j, gain))
    return gains
