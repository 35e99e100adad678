"""FlatnessFeedforward in Python: superposed transitions of the flat output, evaluated at any time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.flat_output import FlatParameterisation
from flexbeams.controller.planner import OFF_REACH, InputShapes, PendingTransitions, plan_transition
from flexbeams.controller.transition import Transition
from flexbeams.controller.voltage_limits import Violation, VoltageLimits
from flexbeams.fmus.python.kernel import UnitError
from flexbeams.fmus.python.slave import Unit

LONGEST_DURATION = 1e12  # s, of a transition in a saved state
ROUNDING = 1e-12  # m: a host that interpolates a constant target moves it by less


class FlatnessFeedforward(Unit):
    """Voltages and states from the flat output xi = offset + sum_k changes_k Theta((t - starts_k)/T_k)."""

    def setup(self) -> None:
        """Views, tables and the slots of the transitions under way."""
        self._target, self._moving = self.view("y_target"), self.view("moving")
        self._u, self._x, self._y = self.view("u_ff"), self.view("x_ref"), self.view("y_ref")
        data = self.data
        self._n_u = len(self._u)
        self._flat = FlatParameterisation.of(data)
        exponent, norm = data["transition_constants"]
        self._transition = Transition(exponent=float(exponent), norm=float(norm), table=data["transition_table"])
        self._shapes = InputShapes(times=data["shape_times"], values=data["shape_values"])
        self._slots = int(self.meta["slots"])  # transitions in progress at once
        self._count = self.state_array("count", 1, np.int64)
        self._handled = self.state_array("handled_target", len(self._target))
        self._offset = self.state_array("offset", self._n_u)
        self._starts = self.state_array("starts", self._slots)
        self._durations = self.state_array("durations", self._slots)
        self._changes = self.state_array("changes", (self._slots, self._n_u))
        self._preview = self.view("preview")
        self._at_rest = False  # the outputs are those of the offset alone

    def initialise(self) -> None:
        """At rest at the first target."""
        self._count[0] = 0
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
        """Check the transitions: their number is an index, the planner tries durations up to a multiple of theirs."""
        count = int(self._count[0])
        starts, durations = self._starts[:count], self._durations[:count]
        known = np.isfinite(starts).all() and (durations > 0).all() and (durations < LONGEST_DURATION).all()
        if not (0 <= count <= self._slots and known):
            self._refuse_state()
        self._at_rest = False

    def advance(self, time: float, step: float) -> None:
        """A changed target starts a transition at `time`; outputs are those of time + step + preview."""
        if self._count[0] < self._slots and (np.abs(self._target - self._handled) > ROUNDING).any():
            self._plan(time)
        if self._count[0] or not self._at_rest:
            self._evaluate(time + step + self._preview[0])

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

    def _plan(self, time: float) -> None:
        if (point := self._unreachable_point()) is not None:
            self._handled[:] = self._target
            self.view("target_refused")[0] = True
            self.warn(
                f"y_target at {self.clock.start + time:.6g} s is refused: {self._nearest(point)}; the target before is "
                "held"
            )
            return
        motion = self._motion()
        goal = self.data["static_inverse"] @ self._target
        change = goal - motion.offset - motion.changes.sum(axis=0)
        wanted = float(self.view("transition_time")[0])
        plan = plan_transition(motion, self._shapes, now=time, change=change, requested=wanted, limit=self._limits())
        name, limit, voltage = self._broken_limit(plan.violation)
        self._handled[:] = self._target
        self.view("target_refused")[0] = plan.duration == 0
        self.view("planned_peak")[0] = plan.peak
        if plan.duration == 0:
            place = "at rest" if plan.at_rest else "on the way"
            self.warn(
                f"y_target at {self.clock.start + time:.6g} s is refused: it takes {voltage:.1f} V {place}, "
                f"{name} is {limit:.1f} V; the target before is held"
            )
            return
        if plan.duration > wanted:
            named = "" if name == "voltage_limit" else f"{name} = "
            self.note(
                f"the transition at {self.clock.start + time:.6g} s is stretched from {wanted:.4g} s to "
                f"{plan.duration:.4g} s to stay within {named}{limit:.1f} V"
            )
        self.view("planned_time")[0] = plan.duration
        slot = int(self._count[0])
        self._starts[slot], self._durations[slot], self._changes[slot] = time, plan.duration, change
        self._count[0] += 1

    def _evaluate(self, time: float) -> None:
        self._retire(time)
        voltages, amplitudes = self._offset.copy(), self._flat.complex_inputs @ self._offset
        for k in range(int(self._count[0])):
            duration, change = float(self._durations[k]), self._changes[k]
            tau = min(max((time - self._starts[k]) / duration, 0.0), 1.0)
            terms = self._flat.terms(self._transition, tau, duration)
            voltages += np.sum(terms) * change
            amplitudes += self._flat.amplitudes(terms, change)
        self._u[:], self._x[:] = voltages, self._flat.state(amplitudes)
        self._y[:] = self.data["reference_outputs"] @ np.concatenate((self._x, self._u))
        self._moving[0] = self._count[0] > 0
        self._at_rest = not self._moving[0]

    def _retire(self, time: float) -> None:
        """Transitions that have ended go into the offset; the others move up, in their order."""
        k = int(self._count[0])
        reached = time + self.clock.tolerance(time, self.meta["sample_time"])
        ended = reached >= self._starts[:k] + self._durations[:k]
        if not ended.any():
            return
        self._offset += self._changes[:k][ended].sum(axis=0)
        left = int(np.count_nonzero(~ended))
        for array in (self._starts, self._durations, self._changes):
            array[:left] = array[:k][~ended]
            array[left:] = 0.0
        self._count[0] = left
