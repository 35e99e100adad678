"""What MfcActuator and MfcCompensator share in Python: parameters, states and the count of saturated steps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.python.kernel import UnitError
from flexbeams.fmus.python.slave import Unit
from flexbeams.plant.actuator.amplifier import voltage_limit
from flexbeams.plant.actuator.operators import Operators, broken_rule, start_from, with_linear_part

MOST_STEPS_COUNTED = 2**31 - 1  # largest Integer of FMI


class MfcChannels(Unit):
    """Channels with states `plays` and `creeps` (channels, operators)."""

    def setup(self) -> None:
        """Views of the parameters and of the states."""
        self._take_parameters()
        self._history = self._matrix("history")
        self._plays = self.state_array("plays", self._operators.play_weight.shape)
        self._creeps = self.state_array("creeps", self._operators.creep_weight.shape)
        self._saturated, self._saturated_steps = self.view("saturated"), self.view("saturated_steps")

    def _take_parameters(self) -> None:
        """Operators and limits, which keep their values from the end of the initialisation on."""
        self._operators = Operators(
            play_threshold=with_linear_part(0.0, self._matrix("play_threshold")),
            play_weight=with_linear_part(self.view("linear_weight"), self._matrix("play_weight")),
            dead_zone_threshold=self._matrix("dead_zone_threshold"),
            dead_zone_slope=self._matrix("dead_zone_slope"),
            creep_time=self._matrix("creep_time"),
            creep_weight=self._matrix("creep_weight"),
        )
        self._limits = voltage_limit(self.view("face_minimum"), self.view("face_maximum"), self.view("supply"))

    def _matrix(self, name: str) -> NDArray[np.float64]:
        """A parameter as (channels, operators), not a copy."""
        return self.view(name).reshape(len(self.view("u")), -1)

    def restore(self) -> None:
        """Operators and limits of the saved parameters."""
        self._take_parameters()
        self._require_rules()
        if not (np.isfinite(self._plays).all() and np.isfinite(self._creeps).all()):
            self._refuse_state()

    def _require_rules(self) -> None:
        """UnitError where the parameters break a rule."""
        if rule := broken_rule(self._operators, lambda key, k, j: f"{key}[{k + 1},{j + 1}]"):
            raise UnitError(rule)
        for k, limit in enumerate(self._limits.tolist()):
            if not limit > 0.0:
                supply, low, high = (float(self.view(name)[k]) for name in ("supply", "face_minimum", "face_maximum"))
                raise UnitError(
                    f"supply[{k + 1}] must be between the faces' limits {low!r} and {high!r}, got {supply!r}"
                )

    def _start(self) -> NDArray[np.float64]:
        """The states after the history; returns its last voltages, under which the patches rest."""
        self._take_parameters()
        self._require_rules()
        limits = self._limits
        last = start_from(self._operators, self._history, self._plays, self._creeps)
        for k, (voltage, limit) in enumerate(zip(last.tolist(), limits.tolist(), strict=True)):
            if abs(voltage) > limit:
                name = f"history[{k + 1},{self._history.shape[1]}]"
                raise UnitError(f"{name} must be within the amplifier's limit {limit!r}, got {voltage!r}")
        self._saturated[0] = self._saturated_steps[0] = 0.0
        return last

    def _count_saturated(self, asked: NDArray[np.float64], time: float) -> None:
        """Count a step with a voltage asked for at `time` (s since the start) beyond the limit, once with a line."""
        limits = self._limits
        beyond = np.abs(asked) > limits
        self._saturated[0] = beyond.any()
        if not beyond.any():
            return
        if self._saturated_steps[0] == 0:
            k = int(np.argmax(beyond))
            self.warn(
                f"u[{k + 1}] at {self.clock.start + time:.6g} s is held at the amplifier's limit "
                f"{float(limits[k])!r}, asked for {float(asked[k])!r}"
            )
        self._saturated_steps[0] = min(self._saturated_steps[0] + 1, MOST_STEPS_COUNTED)
