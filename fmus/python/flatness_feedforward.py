"""FlatnessFeedforward in Python: superposed transitions of the flat output, evaluated at any time."""

from __future__ import annotations

import math
import sys

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.motion_model import motion_model
from flexbeams.controller.planner import OFF_REACH, PLANNING_TICKS, PendingTransitions, TransitionPlan, plan_at_tick
from flexbeams.controller.voltage_limits import Violation, VoltageLimits
from flexbeams.fmus.python.kernel import UnitError
from flexbeams.fmus.python.slave import Unit

LONGEST_DURATION = 1e12  # s, of a transition in a saved state
ROUNDING = 1e-12  # m: a host that interpolates a constant target moves it by less
NO_PLAN = -1


class FlatnessFeedforward(Unit):
    """Voltages and states of transitions that add up, planned at the ticks of the sample time.

    The C kernel plans in portions. What comes out at the tick at which a plan takes effect depends on the motion at the
    one that sees the target alone, so here it is planned there at once.
    """

    def setup(self) -> None:
        """Views, tables and the slots of the transitions under way."""
        self._target, self._moving = self.view("y_target"), self.view("moving")
        self._u, self._x, self._y = self.view("u_ff"), self.view("x_ref"), self.view("y_ref")
        self._n_u = len(self._u)
        self._model = motion_model(self.data)
        self._slots = int(self.meta["slots"])  # transitions in progress at once
        self._count = self.state_array("count", 1, np.int64)
        self._tick = self.state_array("tick", 1, np.int64)  # ticks done
        self._due = self.state_array("due", 1, np.int64)  # tick at which a plan takes effect
        self._handled = self.state_array("handled_target", len(self._target))
        self._offset = self.state_array("offset", self._n_u)
        # behind those under way the transition that is planned
        self._starts = self.state_array("starts", self._slots)
        self._durations = self.state_array("durations", self._slots)
        self._changes = self.state_array("changes", (self._slots, self._n_u))
        self._planned = self.state_array("planned", 6)  # see _keep
        self._preview = self.view("preview")
        self._at_rest = False  # the outputs are those of the offset alone

    def initialise(self) -> None:
        """At rest at the first target."""
        self._count[0] = self._tick[0] = 0
        self._due[0] = NO_PLAN
        self._handled[:] = self._target
        if (point := self._unreachable_point()) is not None:
            raise UnitError(f"y_target is out of reach: {self._nearest(point)}")
        self._offset[:] = self.data["static_inverse"] @ self._target
        violation = self._limits().furthest_beyond(self._offset, self._offset)
        if violation.excess > 0:
            name, limit, voltage = self._broken_limit(violation)
            raise UnitError(f"y_target is out of reach: it takes {voltage:.1f} V at rest, {name} is {limit:.1f} V")
        self.view("planned_peak")[0] = np.max(np.abs(self._offset))
        self._at_rest = False
        self._evaluate(self._preview[0])

    def restore(self) -> None:
        """Check the clocks and the transitions: their number is an index, splines have tabulated durations."""
        count, tick, due = int(self._count[0]), int(self._tick[0]), int(self._due[0])
        behind = self.clock.elapsed / self.meta["sample_time"] - tick
        clocks = abs(behind) <= 2 + 4 * sys.float_info.epsilon * tick and (
            due == NO_PLAN or (tick <= due <= tick + PLANNING_TICKS and count < self._slots)
        )
        if not (clocks and 0 <= count <= self._slots):
            self._refuse_state()
        k = count + (due != NO_PLAN and self._planned[0] > 0)
        starts, durations = self._starts[:k], self._durations[:k]
        known = np.isfinite(starts).all() and (durations > 0).all() and (durations < LONGEST_DURATION).all()
        if self.meta["planner"] == "multi_input":
            known = known and bool(np.isin(durations, self.data["spline_times"]).all())
        if not (known and 0 <= self._planned[3] < self._n_u):
            self._refuse_state()
        self._at_rest = False

    def advance(self, time: float, step: float) -> None:
        """Every tick inside [time, time + step): targets are seen and transitions start there.

        Outputs are those of time + step + preview.
        """
        end, sample = time + step, self.meta["sample_time"]
        last = (end - self.clock.tolerance(end, sample)) / sample
        while self._tick[0] < last:
            if self._due[0] == NO_PLAN and not self._is_new_target():
                self._tick[0] = math.ceil(last)
                break
            self._run_tick(int(self._tick[0]))
            self._tick[0] += 1
        if self._count[0] or not self._at_rest:
            self._evaluate(end + self._preview[0])

    def _is_new_target(self) -> bool:
        return bool((np.abs(self._target - self._handled) > ROUNDING).any())

    def _run_tick(self, tick: int) -> None:
        if self._due[0] != NO_PLAN:
            if tick < self._due[0]:
                return
            self._follow(self._kept(), tick - PLANNING_TICKS)
        if not self._is_new_target():
            return
        self._retire(tick * self.meta["sample_time"] + self._preview[0])
        if self._count[0] < self._slots:
            self._plan(tick)

    def _motion(self) -> PendingTransitions:
        k = int(self._count[0])
        return PendingTransitions(
            offset=self._offset, starts=self._starts[:k], durations=self._durations[:k], changes=self._changes[:k]
        )

    def _missed(self) -> NDArray[np.float64]:
        """The part of the target that no voltages reach, m."""
        missed: NDArray[np.float64] = self.data["unreachable"] @ self._target
        return missed

    def _unreachable_point(self) -> int | None:
        """The point of interest whose target is furthest from the nearest reachable one; None where that is close."""
        missed = np.abs(self._missed())
        point = int(missed.argmax())
        return point if missed[point] > OFF_REACH * np.abs(self._target).max() else None

    def _nearest(self, point: int) -> str:
        target = self._target[point]
        return (
            f"no voltages reach it, the nearest reachable target has y_target[{point + 1}] = "
            f"{target - self._missed()[point]:.6g} m in place of {target:.6g} m"
        )

    def _limits(self) -> VoltageLimits:
        return VoltageLimits.joined(
            float(self.view("voltage_limit")[0]), self.view("voltage_min"), self.view("voltage_max")
        )

    def _broken_limit(self, violation: Violation) -> tuple[str, float, float]:
        """The parameter that a voltage is beyond, its value, and the voltage: for voltage_limit, its magnitude."""
        name, symmetric = "voltage_min" if violation.is_below else "voltage_max", float(self.view("voltage_limit")[0])
        own = float(self.view(name)[violation.pair])
        if abs(own) < symmetric:
            return f"{name}[{violation.pair + 1}]", own, violation.voltage
        return "voltage_limit", symmetric, abs(violation.voltage)

    def _plan(self, tick: int) -> None:
        """Begin the transition to a target that a tick sees: at once from rest where the first duration fits."""
        time = tick * self.meta["sample_time"]
        self._handled[:] = self._target
        if (point := self._unreachable_point()) is not None:
            self.view("target_refused")[0] = True
            self.warn(
                f"y_target at {self.clock.start + time:.6g} s is refused: {self._nearest(point)}; the target before is "
                "held"
            )
            return
        motion = self._motion()
        goal = self.data["static_inverse"] @ self._target
        change = goal - motion.offset - motion.changes.sum(axis=0)
        wanted, slot = float(self.view("transition_time")[0]), int(self._count[0])
        start, plan = plan_at_tick(
            motion,
            self._model.curves,
            tick=tick,
            sample_time=self.meta["sample_time"],
            change=change,
            requested=wanted,
            limit=self._limits(),
        )
        self._starts[slot], self._durations[slot], self._changes[slot] = (
            start * self.meta["sample_time"],
            plan.duration,
            change,
        )
        if start == tick:
            self._follow(plan, tick)
            return
        self._due[0] = start
        self._planned[:] = (
            plan.duration,
            plan.peak,
            plan.violation.excess,
            plan.violation.pair,
            plan.violation.voltage,
            plan.violation.is_below,
        )

    def _kept(self) -> TransitionPlan:
        """The plan that takes effect now."""
        duration, peak, excess, pair, voltage, is_below = self._planned.tolist()
        violation = Violation(excess=excess, pair=int(pair), voltage=voltage, is_below=bool(is_below))
        return TransitionPlan(
            duration=duration, peak=peak, peak_at_rest=peak, at_rest=False, as_requested=False, violation=violation
        )

    def _follow(self, plan: TransitionPlan, seen: int) -> None:
        """The plan takes effect: a transition starts, or the target is refused; `seen` is the tick that saw it."""
        wanted = float(self.view("transition_time")[0])
        name, limit, voltage = self._broken_limit(plan.violation)
        self._due[0] = NO_PLAN
        self.view("target_refused")[0] = plan.duration == 0
        self.view("planned_peak")[0] = plan.peak
        if plan.duration == 0:
            place = "at rest" if plan.at_rest else "on the way"
            self.warn(
                f"y_target at {self.clock.start + seen * self.meta['sample_time']:.6g} s is refused: it takes "
                f"{voltage:.1f} V {place}, {name} is {limit:.1f} V; the target before is held"
            )
            return
        if plan.duration > wanted * (1 + 1e-9):
            start = f"the transition at {self.clock.start + float(self._starts[self._count[0]]):.6g} s"
            named = "" if name == "voltage_limit" else f"{name} = "
            if self.meta["planner"] == "multi_input" and plan.violation.excess <= 0:
                self.note(f"{start} takes {plan.duration:.4g} s, the next longer time of the design to {wanted:.4g} s")
            else:
                self.note(
                    f"{start} is stretched from {wanted:.4g} s to {plan.duration:.4g} s to stay within "
                    f"{named}{limit:.1f} V"
                )
        self.view("planned_time")[0] = plan.duration
        self._count[0] += 1

    def _evaluate(self, time: float) -> None:
        self._retire(time)
        self._u[:], self._x[:] = self._model.references(self._motion(), time)
        self._y[:] = self.data["reference_outputs"] @ np.concatenate((self._x, self._u))
        k = int(self._count[0])
        self._moving[0] = bool((self._reached(time) < self._starts[:k] + self._durations[:k]).any())
        self._at_rest = k == 0 and not self._moving[0]

    def _reached(self, time: float) -> float:
        return time + self.clock.tolerance(time, self.meta["sample_time"])

    def _retire(self, time: float) -> None:
        """Transitions that have ended, those before them too, go into the offset; the others move up.

        None does while a plan is under way, which looks at them. So the motion is the same whenever it is looked at.
        """
        if self._due[0] != NO_PLAN:
            return
        k, reached, ended = int(self._count[0]), self._reached(time), 0
        while ended < k and reached >= self._starts[ended] + self._durations[ended]:
            self._offset += self._changes[ended]
            ended += 1
        if ended == 0:
            return
        for array in (self._starts, self._durations, self._changes):
            array[: k - ended] = array[ended:k].copy()
            array[k - ended :] = 0.0
        self._count[0] = k - ended
