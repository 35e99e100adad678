"""TrackingController in Python: Kalman filter (42), regulator (44) and integral action (45)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fmus.python.slave import Unit


class TrackingController(Unit):
    """Runs on its own clock of `sample_time`; after a tick at t_k its output is the voltage for t_{k+1}."""

    def setup(self) -> None:
        """Views; the filter with its three inputs side by side, the regulator above the deflection's rows."""
        data = self.data
        self._y_pm, self._u_ff, self._x_ref = self.view("y_pm"), self.view("u_ff"), self.view("x_ref")
        self._u, self._y_est, self._x_est = self.view("u"), self.view("y_est"), self.view("x_est")
        self._feedback, self._integral_gain = self.view("feedback"), self.view("integral_gain")
        self._limit, self._saturated = self.view("voltage_limit"), self.view("saturated")
        gain = data["estimator_gain"]
        self._filter = np.hstack([data["A_d"] - gain @ data["H_pm"], data["B_d"] - gain @ data["D_pm"], gain])
        self._gain, self._H_pi, self._D_pi = data["feedback_gain"], data["H_pi"], data["D_pi"]
        # (45) with the DC gain's pseudo-inverse: that gain is negative, a positive scalar would destabilise
        self._growth_of_state = data["static_inverse"] @ self._H_pi
        self._growth_of_input = data["static_inverse"] @ self._D_pi
        self._integral = self.state_array("integral", len(self._u))      # V
        self._tick = self.state_array("tick", 1, np.int64)               # ticks run since the start
        self._start = self.state_array("start", 1)                       # s

    def initialise(self) -> None:
        """The estimate starts on the reference, the voltages on the feedforward's."""
        self._x_est[:] = self._x_ref
        self._integral[:] = 0.0
        self._tick[0] = 0
        self._start[0] = self.values[0]
        self._put_out(self._u_ff)

    def advance(self, time: float, step: float) -> None:
        """Every tick inside [time, time + step), with the inputs held; an integer counts them."""
        last = (time + step - self._start[0]) / self.meta["sample_time"] - 1e-6
        while self._tick[0] < last:
            self._run_tick()
            self._tick[0] += 1

    def _run_tick(self) -> None:
        self._x_est[:] = self._filter @ np.concatenate((self._x_est, self._u, self._y_pm))
        if not self._feedback[0]:
            self._integral[:] = 0.0
            self._put_out(self._u_ff)
            return
        error = self._x_ref - self._x_est
        wanted = self._u_ff + self._gain @ error + self._integral
        growth = self._integral_gain[0] * (self._growth_of_state @ error
                                           + self._growth_of_input @ (self._u_ff - self._u))
        if self._put_out(wanted):  # anti-windup: a voltage at its limit does not integrate further out
            growth[(np.abs(wanted) > self._limit[0]) & (wanted * growth > 0)] = 0.0
        self._integral += growth

    def _put_out(self, wanted: NDArray[np.float64]) -> bool:
        """Voltages within the limit, and the deflections estimated with them; True where the limit holds one."""
        limit = self._limit[0]
        saturated = bool((np.abs(wanted) > limit).any())
        self._u[:] = np.clip(wanted, -limit, limit) if saturated else wanted
        self._saturated[0] = saturated
        self._y_est[:] = self._H_pi @ self._x_est + self._D_pi @ self._u
        return saturated
