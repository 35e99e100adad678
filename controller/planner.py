"""Superposed transitions and the shortest duration of a new one within the voltage limit (Remarks 4 and 5)."""

from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array

OFF_REACH = 1e-3  # of the largest target: one this far from what voltages reach is refused
LONGEST_FACTOR = 8.0  # longest transition tried, as a multiple of the longest one tabulated or under way


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
    peak: float  # largest |u| of the whole motion with this duration, V
    peak_at_rest: float  # largest |u| at the target, V


def plan_transition(
    motion: PendingTransitions, shapes: InputShapes, *, now: float, change: Array, requested: float, limit: float
) -> TransitionPlan:
    """The shortest transition of at least `requested` s that keeps the whole motion within +-limit (V).

    `change` (n_u,) is the change of the flat output. The limit holds to about 0.1 %, the resolution of the table. Where
    the voltages already exceed it, because it was lowered, the transition may start there and go no further.
    """
    goal = float(np.max(np.abs(motion.offset + motion.changes.sum(axis=0) + change)))
    if goal > limit * (1 + 1e-9):
        return TransitionPlan(duration=0.0, peak=goal, peak_at_rest=goal)
    present = float(np.max(np.abs(motion.voltage(shapes, np.array([now])))))
    tolerated = max(limit, present) * (1 + 1e-9)
    tau = sample_grid(shapes.values.shape[1] - 1)
    pending = [time[time > now] for time in motion.starts[:, None] + np.outer(motion.durations, tau)]
    longest = max(shapes.times[-1], *motion.durations, requested) * LONGEST_FACTOR
    duration, peak = max(requested, float(shapes.times[0])), goal
    growth = float(shapes.times[1] / shapes.times[0])
    while duration <= longest:
        extended = motion.with_transition(now, duration, change)
        peak = max(_peak(extended.voltage(shapes, time)) for time in [now + duration * tau, *pending])
        if peak <= tolerated:
            return TransitionPlan(duration=duration, peak=peak, peak_at_rest=goal)
        duration *= growth
    return TransitionPlan(duration=0.0, peak=peak, peak_at_rest=goal)


def _peak(u: Array) -> float:
    """Largest magnitude of u (k, n_u), between its rows too: at the vertex of the parabola through three neighbours."""
    if len(u) < 3:
        return float(np.max(np.abs(u), initial=0.0))
    before, here, after = u[:-2], u[1:-1], u[2:]
    bend, turns = before - 2 * here + after, (here - before) * (after - here) < 0
    vertex = here - np.where(turns, (after - before) ** 2 / (8 * np.where(turns, bend, 1.0)), 0.0)
    return float(max(np.max(np.abs(u)), np.max(np.abs(vertex))))
