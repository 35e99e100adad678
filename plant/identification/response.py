"""Responses of single modes to the inputs of an experiment: the functions of time of all outputs and derivatives.

z' = lambda z + v with v held over each step, and the derivatives of z, are sampled exactly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, factorial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from flexbeams.plant.basis import Array
from flexbeams.plant.identification.modal import ComplexArray, ModalForm

_SERIES = 0.3  # |x| below which the phi functions are summed as series
_TERMS = 14  # reach rounding there


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One function of time and the input direction that it drives.

    Before the first row the structure is in equilibrium under `rest`; an `impulse` acts at the first row.
    """

    direction: Array  # (m,): share of each voltage and tip force
    signal: Array  # (rows,), held over each step
    rest: float = 0.0
    impulse: float = 0.0  # integral over time


@dataclass(frozen=True, kw_only=True)
class ModeResponses:
    """z and its derivatives for modes k and channels c at the samples less a delay."""

    z: ComplexArray  # (k, c, rows)
    signals: Array  # (c, rows)
    slope: ComplexArray  # (k, c, rows): dz/dlambda; (0, c, rows) where slopes are not asked for
    pairs: ComplexArray  # (pairs, c, rows): response of one mode of a near pair to the other; as slope

    def every(self, first: int, stride: int) -> "ModeResponses":
        """Every `stride`-th row from `first` on."""
        return ModeResponses(
            z=self.z[..., first::stride],
            signals=self.signals[..., first::stride],
            slope=self.slope[..., first::stride],
            pairs=self.pairs[..., first::stride],
        )


def mode_responses(
    form: ModalForm, channels: list[Channel], step: float, delay: float = 0.0, *, slopes: bool = True
) -> ModeResponses:
    """The responses of the kept modes, each column taken `delay` >= 0 seconds earlier than its row.

    Without `slopes`, only z and the signals.
    """
    poles, pairs = form.poles, form.pairs if slopes else ()
    rows = len(channels[0].signal)
    z = np.empty((len(poles), len(channels), rows), dtype=complex)
    slope = np.empty_like(z) if slopes else np.empty((0, *z.shape[1:]), dtype=complex)
    coupled = np.empty((len(pairs), len(channels), rows), dtype=complex)
    growth, gain, bend = np.exp(poles * step), step * phi(poles * step), step**2 * phi_slope(poles * step)
    for c, channel in enumerate(channels):
        held = channel.signal[:-1]
        for k, pole in enumerate(poles):
            z[k, c] = _recursion(growth[k], channel.impulse - channel.rest / pole, gain[k] * held)
            if slopes:
                forcing = step * growth[k] * z[k, c, :-1] + bend[k] * held
                slope[k, c] = _recursion(growth[k], channel.rest / pole**2, forcing)
        for p, (i, j) in enumerate(pairs):
            across, along = _pair_gains(poles[i], poles[j], step)
            start = channel.rest / (poles[i] * poles[j])
            coupled[p, c] = _recursion(growth[i], start, across * z[j, c, :-1] + along * held)
    signals = np.stack([channel.signal for channel in channels])
    responses = ModeResponses(z=z, signals=signals, slope=slope, pairs=coupled)
    return responses if delay == 0 else _delayed(responses, form, channels, step, delay)


def _recursion(growth: complex, start: complex, forcing: ComplexArray) -> ComplexArray:
    """x_0 = start, x_{t+1} = growth x_t + forcing_t."""
    filtered: ComplexArray = lfilter([1.0], [1.0, -growth], np.concatenate([[start], forcing]))
    return filtered


def _pair_gains(first: complex, second: complex, step: float) -> tuple[complex, complex]:
    """Divided differences at two near eigenvalues of exp(x step) and of step phi(x step)."""
    mean = np.array([(first + second) / 2 * step])
    across = step * np.exp(second * step) * phi(np.array([(first - second) * step]))[0]
    return complex(across), complex(step**2 * phi_slope(mean)[0])


def _delayed(
    responses: ModeResponses, form: ModalForm, channels: list[Channel], step: float, delay: float
) -> ModeResponses:
    """The responses `delay` seconds earlier: whole samples by shifting, the rest by a shorter exact step."""
    samples = ceil(delay / step - 1e-9)
    ahead = samples * step - delay
    poles, signals = form.poles[:, None, None], responses.signals
    growth, gain, bend = np.exp(poles * ahead), ahead * phi(poles * ahead), ahead**2 * phi_slope(poles * ahead)
    z = growth * responses.z + gain * signals
    slope = responses.slope
    if len(slope):
        slope = growth * slope + ahead * growth * responses.z + bend * signals
    coupled = np.empty_like(responses.pairs)
    pairs = form.pairs[: len(coupled)]
    for p, (i, j) in enumerate(pairs):
        across, along = _pair_gains(form.poles[i], form.poles[j], ahead)
        coupled[p] = growth[i] * responses.pairs[p] + across * responses.z[j] + along * signals
    rest = np.array([channel.rest for channel in channels])[None, :]
    product = np.array([form.poles[i] * form.poles[j] for i, j in pairs])
    return ModeResponses(
        z=_shifted(z, -rest / form.poles[:, None], samples),
        signals=_shifted(signals, rest[0], samples),
        slope=_shifted(slope, (rest / form.poles[:, None] ** 2)[: len(slope)], samples),
        pairs=_shifted(coupled, rest / product[:, None], samples),
    )


def _shifted(values: NDArray[Any], before: ComplexArray | Array, samples: int) -> NDArray[Any]:
    """Values (..., rows) moved back by so many samples, filled with `before` (...)."""
    if samples == 0:
        return values
    shifted = np.empty_like(values)
    shifted[..., :samples] = before[..., None]
    shifted[..., samples:] = values[..., :-samples]
    return shifted


def phi(x: ComplexArray) -> ComplexArray:
    """(e^x - 1) / x, 1 at 0."""
    return _by_series(x, lambda k: 1 / factorial(k + 1), lambda y: np.expm1(y) / y)


def phi_slope(x: ComplexArray) -> ComplexArray:
    """Derivative of phi, (e^x - phi(x)) / x, 1/2 at 0."""
    return _by_series(x, lambda k: (k + 1) / factorial(k + 2), lambda y: (np.exp(y) - np.expm1(y) / y) / y)


def _by_series(
    x: ComplexArray, coefficient: Callable[[int], float], closed: Callable[[ComplexArray], ComplexArray]
) -> ComplexArray:
    small = np.abs(x) < _SERIES
    y = np.where(small, x, 0)
    series = np.zeros_like(y)
    for k in range(_TERMS, -1, -1):
        series = series * y + coefficient(k)
    value: ComplexArray = np.where(small, series, closed(np.where(small, 1.0, x)))
    return value
