"""TrackingController in Python: Kalman filter (42), regulator (44) and integral action (45)."""

from __future__ import annotations

import numpy as np

from fmus.python.slave import Unit


class TrackingController(Unit):
    """Runs on its own clock of `sample_time`; after a tick at t_k its output is the voltage for t_{k+1}."""

    def setup(self) -> None:
        """Views and the filter with its three inputs side by side."""
        data = self.data
        self._y_pm, self._u_ff, self._x_ref = self.view("y_pm"), self.view("u_ff"), self.view("x_ref")
        self._u, self._y_est, self._x_est = self.view("u"), self.view("y_est"), self.view("x_est")
        gain = data["estimator_gain"]
        self._filter = np.hstack([data["A_d"] - gain @ data["H_pm"], data["B_d"] - gain @ data["D_pm"], gain])
        self._gain, self._H_pi, self._D_pi = data["feedback_gain"], data["H_pi"], data["D_pi"]
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
        self._x_est[:] = self._filter @ np.concatenate([self._x_est, self._u, self._y_pm])
        if not self.view("feedback")[0]:
            self._integral[:] = 0.0
            self._put_out(self._u_ff)
            return
        error = self._x_ref - self._x_est
        wanted = self._u_ff + self._gain @ error + self._integral
        # (45) with the DC gain's pseudo-inverse: that gain is negative, a positive scalar would destabilise
        deviation = self._H_pi @ error + self._D_pi @ (self._u_ff - self._u)
        growth = self.view("integral_gain")[0] * (self.data["static_inverse"] @ deviation)
        limit = self.view("voltage_limit")[0]
        winding_up = (np.abs(wanted) > limit) & (wanted * growth > 0)
        self._integral += np.where(winding_up, 0.0, growth)
        self._put_out(wanted)

    def _put_out(self, wanted: np.ndarray) -> None:  # type: ignore[type-arg]
        limit = self.view("voltage_limit")[0]
        self._u[:] = np.minimum(np.maximum(wanted, -limit), limit)
        self.view("saturated")[0] = bool((np.abs(wanted) > limit).any())
        self._y_est[:] = self._H_pi @ self._x_est + self._D_pi @ self._u
