"""TrackingController in Python: Kalman filter (42), regulator (44) and integral action (45)."""

from __future__ import annotations

import sys

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.voltage_limits import VoltageLimits
from flexbeams.fmus.python.kernel import UnitError
from flexbeams.fmus.python.slave import Unit

MOST_REJECTED = 2**31 - 1  # largest Integer of FMI
DEPENDENT = 1e-8  # square of what is left of a unit vector that others imply


class TrackingController(Unit):
    """Runs on its own clock of `sample_time`; after a tick at t_k its output is the voltage for t_{k+1}."""

    def setup(self) -> None:
        """Views, and all linear maps of a tick as two matrices that act on the unit's variables side by side."""
        self._y_pm, self._u_ff, self._x_ref = self.view("y_pm"), self.view("u_ff"), self.view("x_ref")
        self._u, self._y_est, self._x_est = self.view("u"), self.view("y_est"), self.view("x_est")
        self._feedback, self._integral_gain = self.view("feedback"), self.view("integral_gain")
        self._saturated, self._share = self.view("saturated"), self.view("saturation_share")
        self._limits = self.values[self.span("voltage_limit").start : self.span("voltage_max").stop]
        n_u, m, states = len(self._u), len(self._x_est), len(self.data["filter"])
        first = self.span("x_est").start
        self._estimate = self.values[first : first + states]  # x_est, then the offsets of the offset-free observer
        self._offsets = self._estimate[m:]
        self._signals = self.values[self.span("y_pm").start : first + states]
        by_estimate, by_voltage, gauges = np.split(self.data["filter"], (states, states + n_u), axis=1)
        self._predict = self._side_by_side(x_est=by_estimate, u=by_voltage, y_pm=gauges)
        # rows for w - z = u_ff + K (x_ref - x_est), then rows for the growth of z by k_I
        errors, voltages = np.split(self.data["regulator"], (states,), axis=1)
        through = np.vstack([np.eye(n_u), np.zeros((n_u, n_u))])
        self._regulate = self._side_by_side(x_ref=errors[:, :m], x_est=-errors, u_ff=through + voltages, u=-voltages)
        self._estimates, self._strains = self.data["estimates"], self.data["strains"]
        self._strain_limit, self._rejected_limit = self.view("strain_limit"), self.view("rejected_limit")
        self._rejected_samples = self.view("rejected_samples")
        self._integral = self.state_array("integral", n_u)  # V
        self._tick = self.state_array("tick", 1, np.int64)  # ticks run since the start
        self._in_a_row = self.state_array("rejected_in_a_row", len(self._y_pm))  # strain samples that were left out
        self._lowest, self._highest = self.state_array("lowest", n_u), self.state_array("highest", n_u)  # V, in force
        self._saturated_ticks = self.state_array("saturated_ticks", 1)
        self._integral_range = self.data["integral_range"]
        self._settled = b""  # the limits' parameters, once those in force have followed

    def _side_by_side(self, **parts: NDArray[np.float64]) -> NDArray[np.float64]:
        """The matrix that applies each part to the unit's signals, from the variable of its name on."""
        matrix = np.zeros((len(next(iter(parts.values()))), len(self._signals)))
        first = self.span("y_pm").start
        for name, part in parts.items():
            begin = self.span(name).start - first
            matrix[:, begin : begin + part.shape[1]] = part
        return matrix

    def initialise(self) -> None:
        """The estimate starts on the reference, the voltages on the feedforward's."""
        self._x_est[:] = self._x_ref
        self._offsets[:] = 0.0
        self._integral[:] = 0.0
        self._tick[0] = 0
        self._in_a_row[:] = self._rejected_samples[0] = 0.0
        limits = self._wanted_limits()
        self._lowest[:], self._highest[:] = limits.lowest, limits.highest
        self._settled = b""
        self._saturated_ticks[0] = self._share[0] = 0.0
        self._write_outputs(self._u_ff)

    def restore(self) -> None:
        """Check what an absurd state would spoil: counts that keep the next step busy for ever, limits, the share."""
        self._settled = b""
        tick, in_a_row, saturated = int(self._tick[0]), self._in_a_row, float(self._saturated_ticks[0])
        behind = self.clock.elapsed / self.meta["sample_time"] - tick
        counts = ((in_a_row >= 0) & (in_a_row <= MOST_REJECTED) & (in_a_row == np.floor(in_a_row))).all()
        limits = np.concatenate((-self._lowest, self._highest))
        limited = ((limits >= 0) & (limits < np.inf)).all() and 0 <= saturated <= tick and saturated.is_integer()
        if not (abs(behind) <= 2 + 4 * sys.float_info.epsilon * tick and counts and limited):
            self._refuse_state()

    def advance(self, time: float, step: float) -> None:
        """Every tick inside [time, time + step), s since the start, with the inputs held; an integer counts them."""
        end, tick = time + step, self.meta["sample_time"]
        last = (end - self.clock.tolerance(end, tick)) / tick
        while self._tick[0] < last:
            self._run_tick()
            self._tick[0] += 1

    def _run_tick(self) -> None:
        y_pm = self._y_pm
        low = -(limit := self._strain_limit[0])
        if y_pm.min() >= low and y_pm.max() <= limit:  # NaN is not
            self._in_a_row[:] = 0.0
            self._estimate[:] = self._predict @ self._signals
        else:
            measured = y_pm.copy()
            self._screen_samples(~(np.abs(y_pm) <= limit))
            self._estimate[:] = self._predict @ self._signals
            y_pm[:] = measured
        self._follow_limits()
        if self._feedback[0]:
            self._regulate_voltages()
        else:
            self._offsets[:] = 0.0
            self._integral[:] = 0.0
            self._write_outputs(self._u_ff)
        self._saturated_ticks[0] += self._saturated[0]
        self._share[0] = self._saturated_ticks[0] / (self._tick[0] + 1)

    def _wanted_limits(self) -> VoltageLimits:
        limit, (minimum, maximum) = float(self._limits[0]), self._limits[1:].reshape(2, -1)
        return VoltageLimits.joined(limit, minimum, maximum)

    def _follow_limits(self) -> None:
        """The limits in force follow the parameters: narrower ones at once, wider ones by so much in a sample."""
        if (parameters := self._limits.tobytes()) == self._settled:
            return
        wanted, widening = self._wanted_limits(), self.meta["widening"]
        self._lowest[:] = np.maximum(wanted.lowest, self._lowest - widening)
        self._highest[:] = np.minimum(wanted.highest, self._highest + widening)
        if (self._lowest == wanted.lowest).all() and (self._highest == wanted.highest).all():
            self._settled = parameters

    def _regulate_voltages(self) -> None:
        proportional, growth = (self._regulate @ self._signals).reshape(2, -1)
        growth *= self._integral_gain[0]
        voltages = proportional + self._integral
        if self._write_outputs(voltages):
            self._hold_windup(voltages, growth)
        self._integral += growth

    def _hold_windup(self, voltages: NDArray[np.float64], growth: NDArray[np.float64]) -> None:
        """Leave in the integral's growth what drives no voltage further into its limit.

        It becomes the nearest within the range of G_0^+ that leaves the integrals of these voltages as they are. What
        left that range no deviation would ever take back. The first voltage that winds up is held, then the first of
        those that still or now do.
        """
        above, below = voltages > self._highest, voltages < self._lowest
        held, directions = np.zeros(len(growth), dtype=bool), np.zeros((0, len(growth)))
        while (winding := ~held & ((above & (growth > 0)) | (below & (growth < 0)))).any():
            k = int(np.argmax(winding))
            direction = self._integral_range[k].copy()
            for other in directions:
                direction -= (other @ direction) * other
            square = float(direction @ direction)
            if square > DEPENDENT:
                growth -= (direction @ growth) / square * direction
                directions = np.vstack([directions, direction / np.sqrt(square)])
            growth[k] = 0.0
            held[k] = True

    def _screen_samples(self, beyond: NDArray[np.bool_]) -> None:
        """Put what estimate and voltages predict in place of strain samples: it leaves the estimate as it is."""
        tick, limit = self.meta["sample_time"], float(self._strain_limit[0])
        self._in_a_row[~beyond] = 0.0
        for k in np.flatnonzero(beyond).tolist():
            name, sample = f"y_pm[{k + 1}]", float(self._y_pm[k])
            if self._rejected_samples[0] == 0:
                self.warn(
                    f"{name} at {self.clock.start + self._tick[0] * tick:.6g} s is left out of the estimate, as any "
                    f"sample beyond strain_limit {limit!r}, got {sample!r}"
                )
            self._rejected_samples[0] = min(self._rejected_samples[0] + 1, MOST_REJECTED)
            self._in_a_row[k] += 1
            if self._in_a_row[k] >= self._rejected_limit[0]:
                raise UnitError(
                    f"{name} has been beyond strain_limit {limit!r} for {int(self._in_a_row[k])} samples in a row "
                    f"(rejected_limit), got {sample!r}"
                )
        predicted = self._strains @ np.concatenate((self._estimate, self._u))
        self._y_pm[beyond] = predicted[beyond]

    def _write_outputs(self, voltages: NDArray[np.float64]) -> bool:
        """Voltages within the limits in force, and the deflections estimated with them; True where one is reduced."""
        np.minimum(np.maximum(voltages, self._lowest), self._highest, out=self._u)
        saturated = bool((self._u != voltages).any())
        self._saturated[0] = saturated
        self._y_est[:] = self._estimates @ np.concatenate((self._estimate, self._u))
        return saturated
