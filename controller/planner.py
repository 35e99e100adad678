"""Superposed transitions and the shortest duration of a new one within the voltage limits (Remarks 4 and 5)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from flexbeams.controller.voltage_limits import Violation, VoltageLimits
from flexbeams.plant.basis import Array

OFF_REACH = 1e-3  # of the largest target: one this far from what voltages reach is refused
LONGEST_FACTOR = 8.0  # longest transition tried, as a multiple of the longest one tabulated or under way
PLANNING_TICKS = 125  # sample times that a plan takes: each does an equal part of it, so that no step takes long
MOST_CANDIDATES = 128  # transition times tried from the requested one to the longest
LIMIT_ROUNDING = 1e-9  # of the largest limit: a voltage this far beyond its own is within


class Curves(Protocol):
    """Voltages over a transition for each of its possible durations."""

    @property
    def grid(self) -> Array:
        """Where a plan is checked: tau (n + 1,) from 0 to 1."""

    @property
    def excess(self) -> float:
        """Part of the largest limit by which a plan may exceed a limit."""

    def candidates(self, requested: float, longest: float) -> Array:
        """Durations (k,) to choose from, ascending: from `requested` s on; `longest` is that of those under way."""

    def voltages(self, duration: float, change: Array, tau: Array) -> Array:
        """Voltages (l, n_u) at tau (l,) of a transition by `change` (n_u,), V."""


def sample_grid(intervals: int) -> Array:
    """Grid on which a curve over the transition is tabulated: tau (n + 1,) from 0 to 1, denser towards the ends."""
    tau: Array = (1 - np.cos(np.pi * np.arange(intervals + 1) / intervals)) / 2
    return tau


@dataclass(frozen=True, kw_only=True)
class InputShapes:
    """D_u(d/dt) Theta over the transition, tabulated for a range of transition times.

    One curve serves every input and target, since D_u is scalar. A transition longer than the table uses the last
    curve, which hardly differs from Theta itself.
    """

    times: Array  # (k,), s, ascending
    values: Array  # (k, n + 1), at sample_grid(n)

    excess = 0.0

    @cached_property
    def grid(self) -> Array:
        """The grid of the table."""
        return sample_grid(self.values.shape[1] - 1)

    def candidates(self, requested: float, longest: float) -> Array:
        """Durations in the table's geometric progression, coarser where these were more than MOST_CANDIDATES."""
        first = max(requested, float(self.times[0]))
        last = max(float(self.times[-1]), longest, requested) * LONGEST_FACTOR
        growth = float(self.times[1] / self.times[0])
        count = int(np.log(last / first) / np.log(growth)) + 1
        if count > MOST_CANDIDATES:
            count, growth = MOST_CANDIDATES, (last / first) ** (1 / (MOST_CANDIDATES - 1))
        durations: Array = first * growth ** np.arange(count, dtype=np.float64)
        return durations

    def voltages(self, duration: float, change: Array, tau: Array) -> Array:
        """The curve times the change."""
        return np.outer(self.at(duration, tau), change)

    def at(self, duration: float, tau: Array) -> Array:
        """The curve of a transition of `duration` s at tau, linear between tabulated curves and grid points."""
        row = float(np.interp(duration, self.times, np.arange(len(self.times))))
        low = min(int(row), len(self.times) - 2)
        fraction = row - low
        curve = (1 - fraction) * self.values[low] + fraction * self.values[low + 1]
        values: Array = np.interp(tau, self.grid, curve)
        return values


@dataclass(frozen=True, kw_only=True)
class PendingTransitions:
    """Transitions under way, which add up."""

    offset: Array  # (n_u,), V: voltages at rest that earlier transitions have reached
    starts: Array  # (k,), s
    durations: Array  # (k,), s
    changes: Array  # (k, n_u), V

    def voltage(self, curves: Curves, time: Array) -> Array:
        """Planned voltages at `time` (l,); shape (l, n_u)."""
        u = np.tile(self.offset, (len(time), 1))
        for start, duration, change in zip(self.starts, self.durations, self.changes, strict=True):
            u += curves.voltages(duration, change, np.clip((time - start) / duration, 0, 1))
        return u

    def with_transition(self, start: float, duration: float, change: Array) -> "PendingTransitions":
        """The motion with one more transition."""
        return PendingTransitions(
            offset=self.offset,
            starts=np.append(self.starts, start),
            durations=np.append(self.durations, duration),
            changes=np.vstack([self.changes, change[None, :]]),
        )


@dataclass(frozen=True, kw_only=True)
class TransitionPlan:
    """The transition to a new target; duration 0 means that the target is refused."""

    duration: float  # s
    peak: float  # largest |u| of the whole motion with this duration, V; refused at rest, at the target
    peak_at_rest: float  # largest |u| at the target, V
    at_rest: bool  # refused for the voltages at the target
    as_requested: bool  # the first duration that was tried
    violation: Violation  # why it is refused, or why it takes longer than asked


def plan_transition(
    motion: PendingTransitions,
    curves: Curves,
    *,
    now: float,
    change: Array,
    requested: float,
    limit: float | VoltageLimits,
) -> TransitionPlan:
    """A short transition of at least `requested` s that keeps the whole motion within the limits.

    `change` (n_u,) is the change of the voltages at rest; a number as `limit` is one of all magnitudes (V). The limits
    hold to about 0.1 %, the resolution of the curves. Where a voltage already exceeds one, because it was narrowed, the
    transition may start there and go no further. Where the requested duration does not fit, others are bisected: the
    next shorter candidate then does not fit.
    """
    limits = limit if isinstance(limit, VoltageLimits) else VoltageLimits.symmetric(limit, len(change))
    goal = motion.offset + motion.changes.sum(axis=0) + change
    peak_at_rest = float(np.max(np.abs(goal)))
    beyond = limits.furthest_beyond(goal, goal)

    def plan(
        duration: float, peak: float, violation: Violation, *, at_rest: bool = False, as_requested: bool = False
    ) -> TransitionPlan:
        return TransitionPlan(
            duration=duration,
            peak=peak,
            peak_at_rest=peak_at_rest,
            at_rest=at_rest,
            as_requested=as_requested,
            violation=violation,
        )

    if not beyond.excess <= LIMIT_ROUNDING * limits.largest:
        return plan(0.0, peak_at_rest, beyond, at_rest=True)
    search = _Search(motion, curves, now, change, limits)
    candidates = curves.candidates(requested, float(np.max(motion.durations, initial=0.0)))
    violation, peak = search.violation(float(candidates[0]))
    if violation is None:
        return plan(float(candidates[0]), peak, beyond, as_requested=True)
    low, high, beyond, best = 0, len(candidates), violation, peak
    while high - low > 1:
        index = len(candidates) - 1 if high == len(candidates) else (low + high) // 2
        violation, peak = search.violation(float(candidates[index]))
        if violation is None:
            high, best = index, peak
        elif index == len(candidates) - 1:
            return plan(0.0, peak, violation)
        else:
            low, beyond = index, violation
    return plan(float(candidates[high]), best, beyond) if high < len(candidates) else plan(0.0, best, beyond)


def plan_at_tick(
    motion: PendingTransitions,
    curves: Curves,
    *,
    tick: int,
    sample_time: float,
    change: Array,
    requested: float,
    limit: float | VoltageLimits,
) -> tuple[int, TransitionPlan]:
    """The plan for a target that is seen at a tick, and the tick at which it takes effect.

    That is the same one where the target is refused for its voltages at rest, or where there is no motion and the first
    duration fits; else it is PLANNING_TICKS later, since a search takes them.
    """
    for start in (tick, tick + PLANNING_TICKS):
        plan = plan_transition(motion, curves, now=start * sample_time, change=change, requested=requested, limit=limit)
        if plan.at_rest or (len(motion.starts) == 0 and plan.as_requested):
            break
    return start, plan


class _Search:
    """Whether the motion with a new transition keeps within the limits, for each duration."""

    def __init__(
        self, motion: PendingTransitions, curves: Curves, now: float, change: Array, limits: VoltageLimits
    ) -> None:
        self._motion, self._curves, self._now, self._change = motion, curves, now, change
        self._tolerated = limits.containing(motion.voltage(curves, np.array([now]))[0])
        self._excess = (LIMIT_ROUNDING + curves.excess) * self._tolerated.largest
        times = motion.starts[:, None] + np.outer(motion.durations, curves.grid)
        self._pending = [time[time > now] for time in times]

    def violation(self, duration: float) -> tuple[Violation | None, float]:
        """What breaks a limit furthest with a duration, None where nothing does; largest |u|, V."""
        extended = self._motion.with_transition(self._now, duration, self._change)
        extremes = [
            _extremes(extended.voltage(self._curves, time))
            for time in [*self._pending, self._now + duration * self._curves.grid]
            if len(time)
        ]
        lowest, highest = np.min([e[0] for e in extremes], axis=0), np.max([e[1] for e in extremes], axis=0)
        beyond = self._tolerated.furthest_beyond(lowest, highest)
        peak = float(max(np.max(np.abs(lowest)), np.max(np.abs(highest))))
        return (None if beyond.excess <= self._excess else beyond), peak


def _extremes(u: Array) -> tuple[Array, Array]:
    """Lowest and highest of each column of u (k, n_u), between its rows too: at the vertex of the parabola through
    three neighbours."""
    lowest, highest = u.min(axis=0), u.max(axis=0)
    if len(u) < 3:
        return lowest, highest
    before, here, after = u[:-2], u[1:-1], u[2:]
    bend, turns = before - 2 * here + after, (here - before) * (after - here) < 0
    vertex = here - np.where(turns, (after - before) ** 2 / (8 * np.where(turns, bend, 1.0)), 0.0)
    return np.minimum(lowest, vertex.min(axis=0)), np.maximum(highest, vertex.max(axis=0))
