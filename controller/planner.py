"""Superposed transitions and the shortest duration of a new one within the voltage limits (Remarks 4 and 5)."""

from dataclasses import dataclass

import numpy as np

from flexbeams.controller.voltage_limits import Violation, VoltageLimits
from flexbeams.plant.basis import Array

OFF_REACH = 1e-3  # of the largest target: one this far from what voltages reach is refused
LONGEST_FACTOR = 8.0  # longest transition tried, as a multiple of the longest one tabulated or under way
LIMIT_ROUNDING = 1e-9  # of the largest limit: a voltage this far beyond its own is within


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

    def at(self, duration: float, tau: Array) -> Array:
        """The curve of a transition of `duration` s at tau, linear between tabulated curves and grid points."""
        row = float(np.interp(duration, self.times, np.arange(len(self.times))))
        low = min(int(row), len(self.times) - 2)
        fraction = row - low
        curve = (1 - fraction) * self.values[low] + fraction * self.values[low + 1]
        values: Array = np.interp(tau, sample_grid(len(curve) - 1), curve)
        return values


@dataclass(frozen=True, kw_only=True)
class PendingTransitions:
    """Transitions under way: u_j(t) = offset_j + sum_k changes_kj shape((t - starts_k) / durations_k)."""

    offset: Array  # (n_u,), V: flat output that earlier transitions have reached
    starts: Array  # (k,), s
    durations: Array  # (k,), s
    changes: Array  # (k, n_u), V

    def voltage(self, shapes: InputShapes, time: Array) -> Array:
        """Planned voltages at `time` (l,); shape (l, n_u)."""
        u = np.tile(self.offset, (len(time), 1))
        for start, duration, change in zip(self.starts, self.durations, self.changes, strict=True):
            u += np.outer(shapes.at(duration, np.clip((time - start) / duration, 0, 1)), change)
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
    violation: Violation  # why it is refused, or why it takes longer than asked


def plan_transition(
    motion: PendingTransitions,
    shapes: InputShapes,
    *,
    now: float,
    change: Array,
    requested: float,
    limit: float | VoltageLimits,
) -> TransitionPlan:
    """The shortest transition of at least `requested` s that keeps the whole motion within the limits.

    `change` (n_u,) is the change of the flat output; a number as `limit` is one of all magnitudes (V). The limits hold
    to about 0.1 %, the resolution of the table. Where a voltage already exceeds one, because it was narrowed, the
    transition may start there and go no further.
    """
    limits = limit if isinstance(limit, VoltageLimits) else VoltageLimits.symmetric(limit, len(change))
    goal = motion.offset + motion.changes.sum(axis=0) + change
    peak_at_rest = float(np.max(np.abs(goal)))
    violation = limits.furthest_beyond(goal, goal)

    def plan(duration: float, peak: float, violation: Violation, *, at_rest: bool = False) -> TransitionPlan:
        return TransitionPlan(
            duration=duration, peak=peak, peak_at_rest=peak_at_rest, at_rest=at_rest, violation=violation
        )

    if not violation.excess <= LIMIT_ROUNDING * limits.largest:
        return plan(0.0, peak_at_rest, violation, at_rest=True)
    tolerated = limits.containing(motion.voltage(shapes, np.array([now]))[0])
    tau = sample_grid(shapes.values.shape[1] - 1)
    pending = [time[time > now] for time in motion.starts[:, None] + np.outer(motion.durations, tau)]
    longest = max(shapes.times[-1], *motion.durations, requested) * LONGEST_FACTOR
    duration, peak = max(requested, float(shapes.times[0])), peak_at_rest
    growth = float(shapes.times[1] / shapes.times[0])
    while duration <= longest:
        extended = motion.with_transition(now, duration, change)
        extremes = [_extremes(extended.voltage(shapes, time)) for time in [now + duration * tau, *pending] if len(time)]
        lowest, highest = np.min([e[0] for e in extremes], axis=0), np.max([e[1] for e in extremes], axis=0)
        peak = float(max(np.max(np.abs(lowest)), np.max(np.abs(highest))))
        beyond = tolerated.furthest_beyond(lowest, highest)
        if beyond.excess <= LIMIT_ROUNDING * tolerated.largest:
            return plan(duration, peak, violation)
        duration, violation = duration * growth, beyond
    return plan(0.0, peak, violation)


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
