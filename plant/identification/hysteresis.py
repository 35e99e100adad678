"""Hysteresis and creep of a patch pair from measured loops: plays by nonnegative least squares, dead zones and creep.

With z = sum_i w_i p_i, h = S(z) and u_eff = h + creep as in flexbeams.plant.actuator.operators, the response is
offset + gain u_eff. Weights w >= 0, slopes of S > 0 and creep weights a >= 0 are each a linear least-squares problem
while the other two stay; they are solved in turn. Creep is exact for voltages that are joined by lines.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear, nnls
from scipy.signal import lfilter

from flexbeams.plant.actuator.operators import Operators, move_plays
from flexbeams.plant.actuator.parameters import PatchPairActuator
from flexbeams.plant.basis import Array
from flexbeams.plant.identification.compensation import commands_for
from flexbeams.plant.identification.loops import Loops

MOST_PLAYS = 12
DEAD_ZONES = 9
ROUNDS = 12  # of the three problems in turn
TRIAL_ROUNDS = 4  # of the cross-validation
TRIAL_ROWS = 1500  # that a trial fits
BLOCKS, FOLDS = 12, 4  # of the cross-validation: contiguous blocks, each held back once
GOOD_ENOUGH = 1.1  # a smaller number of operators is taken where its error is within this factor of the smallest
LEAST_SLOPE = 0.05  # of S, relative to 1
SIGNIFICANT = 1e-4  # weights below this, relative to 1, are left out


@dataclass(frozen=True, kw_only=True)
class HysteresisFit:
    """A fitted patch pair; errors are shares of the stroke."""

    loops: Loops
    pair: PatchPairActuator
    gain: float  # response per volt of u_eff
    offset: float  # response at u_eff = 0
    model: Array  # (n,) response of the model
    trials: dict[int, float]  # rms error on held-back blocks by number of play operators
    line: float  # largest deviation of the response from a straight line over the voltage

    @property
    def residual(self) -> Array:
        """Measured less modelled, rows that count, shares of the stroke."""
        first = self.loops.first_counted
        left: Array = (self.loops.response[first:] - self.model[first:]) / self.loops.stroke
        return left

    @property
    def largest(self) -> float:
        """Largest residual."""
        return float(np.max(np.abs(self.residual)))

    @property
    def rms(self) -> float:
        """Root of the mean square of the residual."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def explained(self) -> float:
        """Share of the response's variance."""
        y = self.loops.response[self.loops.first_counted :] / self.loops.stroke
        return 1.0 - float(np.mean(self.residual**2) / np.var(y))

    @cached_property
    def commands(self) -> Array:
        """Voltages (n,) that a compensator made of the fit would have commanded for the measured response."""
        return commands_for(self.pair, (self.loops.response - self.offset) / self.gain, self.loops.step)

    @property
    def remaining(self) -> Array:
        """Those voltages less the applied ones over their range, rows that count.

        This is near the share of the stroke by which the response would miss.
        """
        left: Array = (self.commands - self.loops.voltage)[self.loops.first_counted :] / np.ptp(self.loops.voltage)
        return left

    @property
    def largest_remaining(self) -> float:
        """Largest error that a compensator would leave."""
        return float(np.max(np.abs(self.remaining)))

    @property
    def rms_remaining(self) -> float:
        """Root of the mean square of what a compensator would leave."""
        return float(np.sqrt(np.mean(self.remaining**2)))


def fit_hysteresis(
    loops: Loops, plays: int | None = None, progress: Callable[[int, float], None] = lambda plays, error: None
) -> HysteresisFit:
    """The patch pair that explains the loops; the number of play operators by cross-validation where none is given."""
    high, low = int(np.argmax(loops.voltage)), int(np.argmin(loops.voltage))
    gain = float((loops.response[high] - loops.response[low]) / np.ptp(loops.voltage))
    target = loops.response / gain
    trials: dict[int, float] = {}
    if plays is None:
        for count in range(2, MOST_PLAYS + 1, 2):
            trials[count] = _held_back_error(loops, target, count)
            progress(count, trials[count])
        least = min(trials.values())
        plays = next(count for count, error in trials.items() if error <= GOOD_ENOUGH * least)
    rows = np.arange(loops.first_counted, len(target))
    solution = _solve(loops, target, plays, rows, ROUNDS)
    first = loops.first_counted
    ends = np.polyfit(loops.voltage[first:], loops.response[first:], 1)
    deviation = loops.response[first:] - np.polyval(ends, loops.voltage[first:])
    return HysteresisFit(
        loops=loops,
        pair=solution.pair(),
        gain=gain,
        offset=gain * solution.offset,
        model=gain * solution.values,
        trials=trials,
        line=float(np.max(np.abs(deviation))) / loops.stroke,
    )


@dataclass(kw_only=True)
class _Solution:
    """Unknowns of the three problems, in V of u_eff."""

    thresholds: Array  # (plays + 1,), the first 0
    weights: Array
    knots: Array  # (dead zones,) of S, in z
    slopes: Array  # (dead zones + 1,) of S between them
    times: Array
    creep: Array
    offset: float
    values: Array  # (n,) offset + u_eff

    def pair(self) -> PatchPairActuator:
        """As in a structure file: S has the slope 1 at z = 0, which the weights take over."""
        middle = int(np.searchsorted(self.knots, 0.0))
        scale = self.slopes[middle]
        steps = np.diff(self.slopes) / scale * np.where(self.knots < 0.0, -1.0, 1.0)
        kept = [i for i in range(1, len(self.weights)) if self.weights[i] * scale > SIGNIFICANT]
        zones = [j for j in range(len(self.knots)) if abs(steps[j]) > SIGNIFICANT]
        creeping = [i for i in range(len(self.times)) if self.creep[i] > SIGNIFICANT]
        return PatchPairActuator(
            linear_weight=_digits(self.weights[0] * scale),
            play_thresholds=[_digits(self.thresholds[i]) for i in kept],
            play_weights=[_digits(self.weights[i] * scale) for i in kept],
            dead_zone_thresholds=[_digits(self.knots[j] * scale) for j in zones],
            dead_zone_slopes=[_digits(steps[j]) for j in zones],
            creep_times=[_digits(self.times[i]) for i in creeping],
            creep_weights=[_digits(self.creep[i]) for i in creeping],
        )


def _digits(value: float) -> float:
    return float(f"{value:.6g}")


def _held_back_error(loops: Loops, target: Array, plays: int) -> float:
    """Rms error of a number of plays on blocks of rows that the fit does not see, as a share of the stroke."""
    rows = np.arange(loops.first_counted, len(target))
    rows = rows[:: max(1, -(-len(rows) // TRIAL_ROWS))]
    block = np.arange(len(rows)) * BLOCKS // len(rows)
    squares = 0.0
    for fold in range(FOLDS):
        held = rows[block % FOLDS == fold]
        solution = _solve(loops, target, plays, rows[block % FOLDS != fold], TRIAL_ROUNDS)
        squares += float(np.sum((target[held] - solution.values[held]) ** 2))
    return float(np.sqrt(squares / len(rows)) / np.ptp(target[loops.first_counted :]))


def play_outputs(voltage: Array, thresholds: Array) -> Array:
    """Play operators (n, plays) from the demagnetised state on."""
    one = np.ones((1, len(thresholds)))
    plain = np.zeros((1, 1))
    operators = Operators(
        play_threshold=thresholds[None, :],
        play_weight=one,
        dead_zone_threshold=plain,
        dead_zone_slope=plain,
        creep_time=plain + 1.0,
        creep_weight=plain,
    )
    state = np.zeros_like(one)
    rows = np.empty((len(voltage), len(thresholds)))
    for k in range(len(voltage)):
        move_plays(operators, state, voltage[k : k + 1])
        rows[k] = state[0]
    return rows


def crept(signal: Array, time: float, step: float) -> Array:
    """The creep operator of a signal (n, ...) that is joined by lines, at rest in the first row."""
    decay = np.exp(-step / time)
    share = 1.0 - time / step * -np.expm1(-step / time)
    first = signal[:1] * (1.0 - share)
    out, _ = lfilter([share, 1.0 - decay - share], [1.0, -decay], signal, axis=0, zi=first)
    result: Array = out
    return result


def _solve(loops: Loops, target: Array, plays: int, rows: NDArray[np.intp], rounds: int) -> _Solution:
    """The three problems in turn, on some rows."""
    voltage, step = loops.voltage, loops.step
    thresholds = np.ptp(voltage) / 2 * np.arange(plays + 1) / (plays + 1)
    outputs = play_outputs(voltage, thresholds)
    knots = np.linspace(voltage.min(), voltage.max(), DEAD_ZONES + 2)[1:-1]
    duration = step * len(voltage)
    times = np.array([10.0**k for k in range(-6, 7) if 10 * step <= 10.0**k <= duration])
    creep, slopes, offset = np.zeros(len(times)), np.ones(DEAD_ZONES + 1), 0.0
    weights = np.zeros(plays + 1)
    weights[0] = 1.0

    def with_creep(signal: Array) -> Array:
        return signal + sum((a * crept(signal, t, step) for a, t in zip(creep, times, strict=True) if a > 0), start=0.0)

    for _ in range(rounds):
        z = outputs @ weights
        tangent = slopes[np.searchsorted(knots, z)]
        columns = with_creep(tangent[:, None] * outputs)
        rest = with_creep(_segments(z, knots) @ slopes - tangent * z)
        one = np.ones((len(z), 1))
        weights = nnls(np.hstack([columns, one, -one])[rows], (target - rest)[rows])[0][:-2]
        weights[0] = max(weights[0], LEAST_SLOPE)
        segments = _segments(outputs @ weights, knots)
        lower = [*[LEAST_SLOPE] * len(slopes), -np.inf]
        solved = lsq_linear(np.hstack([with_creep(segments), one])[rows], target[rows], bounds=(lower, np.inf)).x
        slopes, offset = solved[:-1], float(solved[-1])
        h = segments @ slopes
        operators = np.column_stack([crept(h, t, step) for t in times]) if len(times) else np.zeros((len(h), 0))
        if len(times):
            creep = nnls(operators[rows], (target - offset - h)[rows])[0]
    return _Solution(
        thresholds=thresholds,
        weights=weights,
        knots=knots,
        slopes=slopes,
        times=times,
        creep=creep,
        offset=offset,
        values=offset + h + operators @ creep,
    )


def _segments(z: Array, knots: Array) -> Array:
    """(n, knots + 1): the part of the way from 0 to z within each interval between knots, the outer ones open."""
    edges = np.concatenate([[-np.inf], knots, [np.inf]])
    inside = np.clip(z[:, None], edges[:-1], edges[1:])
    from_zero: Array = inside - np.clip(0.0, edges[:-1], edges[1:])
    return from_zero
