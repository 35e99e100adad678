"""Stability margins of the closed loop: gain, phase and delay of each patch pair, and disk margins.

A factor f on the voltage of a pair turns its loop L = 1 / S - 1, the others closed, into f L. The disk margin alpha
(Seiler, Packard and Gahinet 2020, skew 0) admits every complex f = (1 + delta / 2) / (1 - delta / 2) with
|delta| < alpha: gains from (2 - alpha) / (2 + alpha) to its inverse and phases within 2 arctan(alpha / 2), at any
frequency. For one pair alpha = 1 / max |S - 1/2|; for all at once, independent of each other,
alpha = 1 / max mu(S - I / 2).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from flexbeams.controller.frequency import Complex
from flexbeams.controller.loop import Loop
from flexbeams.controller.structured_value import osborne_bounds, structured_bound
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError

_INTEGRATED = 1e-5  # |S| at rest below which the loop integrates: zero but for rounding


@dataclass(frozen=True, kw_only=True)
class DiskMargin:
    """Largest alpha for which the loop stays stable, and the frequency where it would be lost."""

    alpha: float
    frequency: float  # rad/s

    @property
    def gain(self) -> float:
        """Factor up to which, and down to whose inverse, gains may change; inf for alpha >= 2."""
        return (2 + self.alpha) / (2 - self.alpha) if self.alpha < 2 else np.inf

    @property
    def phase(self) -> float:
        """Phase that may be lost or gained, degrees."""
        return float(np.degrees(2 * np.arctan(self.alpha / 2)))


@dataclass(frozen=True, kw_only=True)
class ChannelMargins:
    """Margins of one pair with the loops of the others closed."""

    gain_reduction: float  # smallest factor on the gain that keeps the loop stable, 0 where any does
    gain_increase: float  # largest such factor, inf where any does
    phase: float  # degrees lost or gained, 180 where any is tolerated
    delay: float  # s, inf where any is tolerated
    disk: DiskMargin

    def texts(self) -> tuple[str, str, str, str]:
        """Gain, phase, delay and disk margin for a table."""
        gain = "any" if np.isinf(self.gain_increase) else f"× {self.gain_increase:.2f}"
        if self.gain_reduction > 0:
            gain = f"× {self.gain_reduction:.2g} … {gain.removeprefix('× ')}"
        phase = "any" if self.phase >= 180 else f"{self.phase:.1f}°"
        delay = "any" if np.isinf(self.delay) else f"{1e3 * self.delay:.3g} ms"
        return gain, phase, delay, f"{self.disk.alpha:.3f}"


@dataclass(frozen=True, kw_only=True)
class Margins:
    """Margins of every pair, and of all pairs at once."""

    channels: tuple[ChannelMargins, ...]
    disk: DiskMargin

    def figures(self) -> dict[str, Any]:
        """For the summary, in JSON's types; null stands for a margin without end."""
        return {
            "disk": {"alpha": self.disk.alpha, "frequency": self.disk.frequency},
            "channels": [
                {
                    "gain_reduction": c.gain_reduction,
                    "gain_increase": _finite(c.gain_increase),
                    "phase": c.phase,
                    "delay": _finite(c.delay),
                    "disk": c.disk.alpha,
                    "disk_frequency": c.disk.frequency,
                }
                for c in self.channels
            ],
        }


def loop_margins(loop: Loop) -> Margins:
    """Margins of a loop; DesignError where it is unstable."""
    if (pole := loop.poles()[0]).real >= 0:
        raise DesignError(f"margins need a stable loop, got a pole at {pole.real:.4g}{pole.imag:+.4g}j 1/s")
    omega = loop.frequencies()
    S = loop.input_sensitivity(omega)
    channels = tuple(_channel(loop, omega, S, k) for k in range(S.shape[1]))
    return Margins(channels=channels, disk=all_channels(loop, omega, S))


def all_channels(loop: Loop, omega: Array, S: Complex) -> DiskMargin:
    """Disk margin of all pairs at once from S (k, n_u, n_u) on a grid omega (k,) that resolves the resonances."""
    shift = np.eye(S.shape[1]) / 2

    def bound(frequency: float) -> float:
        M = loop.input_sensitivity(np.array([frequency])) - shift
        return structured_bound(M[0], osborne_bounds(M)[1][0])

    sizes = np.abs(S - shift)
    rows, columns = np.max(np.sum(sizes, axis=2), axis=1), np.max(np.sum(sizes, axis=1), axis=1)
    single = np.max(np.diagonal(sizes, axis1=1, axis2=2))  # mu is at least that, and at most sqrt(rows columns)
    candidates = np.flatnonzero(np.sqrt(rows * columns) >= single)
    upper, logs = osborne_bounds(S[candidates] - shift)
    peak, at = 0.0, 0
    for k in np.argsort(-upper):  # Osborne's scaling bounds mu: below the best value so far, no more can come
        if upper[k] <= peak:
            break
        value = structured_bound(S[candidates[k]] - shift, logs[k])
        peak, at = max((peak, at), (value, int(candidates[k])))
    frequency, peak = _refined(bound, omega, at, peak)
    return DiskMargin(alpha=1 / peak, frequency=frequency)


def _refined(function: Callable[[float], float], omega: Array, at: int, peak: float) -> tuple[float, float]:
    """The maximum of a function between the neighbours of a grid point that is its largest on the grid."""
    low, high = omega[max(at - 1, 0)], omega[min(at + 1, len(omega) - 1)]
    found = minimize_scalar(lambda w: -function(w), bounds=(low, high), method="bounded", options={"xatol": 1e-4 * low})
    return (float(found.x), float(-found.fun)) if -found.fun > peak else (float(omega[at]), peak)


def _channel(loop: Loop, omega: Array, S: Complex, k: int) -> ChannelMargins:
    response = loop.channel_sensitivity(k)

    def sensitivity(frequency: float) -> complex:
        return complex(response(np.array([frequency]))[0])

    def open_loop(frequency: float) -> complex:
        return 1 / sensitivity(frequency) - 1

    L = 1 / S[:, k, k] - 1
    at_crossings = [open_loop(w).real for w in _crossings(lambda w: open_loop(w).imag, omega, L.imag)]
    # where L is real at the ends of the frequency range, a gain may reach -1 there
    factors = [-1 / r for r in (*at_crossings, _constant(sensitivity(0.0)), float(L[-1].real)) if r < 0]
    crossovers = list(_crossings(lambda w: abs(open_loop(w)) - 1, omega, np.abs(L) - 1))
    phases = [(w, np.angle(open_loop(w)) % (2 * np.pi)) for w in crossovers]  # distance to -pi: phase + pi
    losses = [(w, (phase + np.pi) % (2 * np.pi)) for w, phase in phases]  # phase that may be lost, rad
    smallest = min((min(loss, 2 * np.pi - loss) for _, loss in losses), default=np.pi)
    distance = np.abs(S[:, k, k] - 0.5)
    at = int(np.argmax(distance))
    frequency, peak = _refined(lambda w: abs(sensitivity(w) - 0.5), omega, at, float(distance[at]))
    return ChannelMargins(
        gain_reduction=max((f for f in factors if f < 1), default=0.0),
        gain_increase=min((f for f in factors if f > 1), default=np.inf),
        phase=float(np.degrees(smallest)),
        delay=min((loss / w for w, loss in losses), default=np.inf),
        disk=DiskMargin(alpha=1 / peak, frequency=frequency),
    )


def _constant(sensitivity: complex) -> float:
    """L of a pair at rest from S there; inf with integral action."""
    return float((1 / sensitivity - 1).real) if abs(sensitivity) > _INTEGRATED else np.inf


def _crossings(function: Callable[[float], float], omega: Array, values: Array) -> Iterator[float]:
    """Zeros of a function with known values on a grid; poles, where the sign changes at infinity, are left out."""
    function = cache(function)  # the search begins with both ends again
    for i in np.flatnonzero(values[:-1] * values[1:] < 0):
        low, high = float(omega[i]), float(omega[i + 1])
        if function(low) * function(high) >= 0:  # zero but for rounding at one of them
            yield low if abs(values[i]) < abs(values[i + 1]) else high
            continue
        zero = float(brentq(function, low, high, xtol=1e-12 * high, rtol=1e-10))
        if abs(function(zero)) <= min(abs(values[i]), abs(values[i + 1])):
            yield zero


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
