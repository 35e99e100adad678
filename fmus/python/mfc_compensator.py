"""MfcCompensator in Python: the inverse of hysteresis and creep."""

from __future__ import annotations

import numpy as np

from flexbeams.fmus.python.mfc_channels import MfcChannels
from flexbeams.fmus.python.slave import Unit
from flexbeams.plant.actuator.inverse import hysteresis_for, invert, voltage_for
from flexbeams.plant.actuator.operators import hysteresis, move_plays, relax


class MfcCompensator(MfcChannels, Unit):
    """Keeps the states that its commands leave in the patches."""

    def setup(self) -> None:
        super().setup()
        self._u, self._wanted = self.view("u"), self.view("u_eff")

    def initialise(self) -> None:
        """At rest under the last voltage of the history."""
        self._u[:] = self._start()
        self._inverse = invert(self._operators)

    def restore(self) -> None:
        """And the inverse."""
        super().restore()
        self._inverse = invert(self._operators)

    def advance(self, time: float, step: float) -> None:
        """The last commands held for `step` s; the next ones, for another step of this size."""
        relax(self._operators, self._creeps, hysteresis(self._operators, self._plays), step)
        h = hysteresis_for(self._operators, self._creeps, self._wanted, step)
        asked = voltage_for(self._operators, self._inverse, self._plays, h)
        self._count_saturated(asked, time + step)
        self._u[:] = np.minimum(np.maximum(asked, -self._limits), self._limits)
        move_plays(self._operators, self._plays, self._u)
