"""A small unit for the tests: two first-order lags with three inputs, advanced tick by tick.

x <- a x + B u per tick; x, a (2,), B (2, 3), u (3,); y = gain x + trim. `sluggish` halves a, `substeps` is
the number of ticks in a step. It fails on purpose: with u[3] > 1e6 by a refusal, with u[3] < -1e6 by a fault
of its own, and at initialisation with the label "broken".
"""

from __future__ import annotations

import numpy as np

from flexbeams.fmus.python.kernel import UnitError
from flexbeams.fmus.python.slave import Unit


class Lag(Unit):
    def setup(self) -> None:
        self.u = self.view("u")
        self.y = self.view("y")
        self.gain = self.view("gain")
        self.x = self.state_array("x", 2)
        self.ticks = self.state_array("ticks", (1,), np.int64)
        self.note(f"scale {self.meta['scale']}")

    def initialise(self) -> None:
        if self.text("label") == "broken":
            raise UnitError("label must not be broken")
        self.x[:] = self.view("x_start") * self.meta["scale"]
        self.ticks[:] = 0
        self.restore()
        self._output()

    def restore(self) -> None:
        self.a = self.data["a"] * (0.5 if self.view("sluggish")[0] else 1.0)

    def advance(self, time: float, step: float) -> None:
        if self.u[1] > 1e6:
            self.warn("u[2] is large")
        if self.u[2] > 1e6:
            self.warn("u[3] is large")
            raise UnitError(f"u[3] must be <= 1e6, got {self.u[2].item()!r}")
        if self.u[2] < -1e6:
            raise ZeroDivisionError("kernel\nfault \ud800")
        for _ in range(int(self.view("substeps")[0])):
            self.x[:] = self.a * self.x + self.data["b"] @ self.u
            self.ticks += 1
        self._output()

    def _output(self) -> None:
        self.y[:] = self.gain * self.x + self.view("trim")
        self.view("w")[:] = np.outer(self.x, self.u).ravel()
        self.view("ticks")[:] = self.ticks
        self.view("positive")[:] = self.x[0] > 0.0
