"""A unit of the tests in Python: y = gain weights u."""

from __future__ import annotations

from flexbeams.fmus.python.slave import Unit


class Gain(Unit):
    def initialise(self) -> None:
        self.view("y")[:] = self.view("gain") * (self.data["weights"] * self.view("u"))

    def advance(self, time: float, step: float) -> None:
        self.initialise()
