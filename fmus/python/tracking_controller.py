"""TrackingController in Python: Kalman filter (42), regulator (44) and integral action (45)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.python.slave import Unit


class TrackingController(Unit):
    """Runs on its own clock of `sample_time`; after a tick at t_k its output is the voltage for t_{k+1}."""

    def setup(self) -> None:
        """Views, and all linear maps of a tick as two matrices that act on the unit's variables side by side."""
        self._y_pm, self._u_ff, self._x_ref = self.view("y_pm"), self.view("u_ff"), self.view("x_ref")
        self._u, self._y_est, self._x_est = self.view("u"), self.view("y_est"), self.view("x_est")
        self._feedback, self._integral_gain = self.view("feedback"), self.view("integral_gain")
        self._limit, self._saturated = self.view("voltage_limit"), self.view("saturated")
        self._signals = self.values[self.span("y_pm").start : self.span("x_est").stop]
        data, n_u = self.data, len(self._u)
        A_d, B_d, H_pm, D_pm = data["A_d"], data["B_d"], data["H_pm"], data["D_pm"]
        self._H_pi, self._D_pi = data["H_pi"], data["D_pi"]
        L, K = data["estimator_gain"], data["feedback_gain"]
        # (45) with the DC gain's pseudo-inverse: that gain is negative, a positive scalar would destabilise
        G = data["static_inverse"]
        self._predict = self._side_by_side(x_est=A_d - L @ H_pm, u=B_d - L @ D_pm, y_pm=L)
        self._regulate = np.vstack(
            [
                self._side_by_side(x_ref=K, x_est=-K, u_ff=np.eye(n_u)),
                self._side_by_side(x_ref=G @ self._H_pi, x_est=-G @ self._H_pi, u_ff=G @ self._D_pi, u=-G @ self._D_pi),
            ]
        )
        self._integral = self.state_array("integral", n_u)  # V
        self._tick = self.state_array("tick", 1, np.int64)  # ticks run since the start
        self._start = self.state_array("start", 1)  # s

    def _side_by_side(self, **parts: NDArray[np.float64]) -> NDArray[np.float64]:
        """The matrix that applies each part to the variable of its name among the unit's signals."""
        matrix = np.zeros((len(next(iter(parts.values()))), len(self._signals)))
        first = self.span("y_pm").start
        for name, part in parts.items():
            span = self.span(name)
            matrix[:, span.start - first : span.stop - first] = part
        return matrix

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
        self._x_est[:] = self._predict @ self._signals
        if not self._feedback[0]:
            self._integral[:] = 0.0
            self._put_out(self._u_ff)
            return
        proportional, growth = (self._regulate @ self._signals).reshape(2, -1)
        growth *= self._integral_gain[0]
        wanted = proportional + self._integral
        if self._put_out(wanted):  # anti-windup: a voltage at its limit does not integrate further out
            growth[(np.abs(wanted) > self._limit[0]) & (wanted * growth > 0)] = 0.0
        self._integral += growth

    def _put_out(self, wanted: NDArray[np.float64]) -> bool:
        """Voltages within the limit, and the deflections estimated with them; True where the limit holds one."""
        limit = self._limit[0]
        saturated = bool(wanted.max() > limit or wanted.min() < -limit)
        self._u[:] = np.clip(wanted, -limit, limit) if saturated else wanted
        self._saturated[0] = saturated
        self._y_est[:] = self._H_pi @ self._x_est + self._D_pi @ self._u
        return saturated
