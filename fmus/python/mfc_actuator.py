"""MfcActuator in Python: amplifier, hysteresis and creep."""

from __future__ import annotations

from flexbeams.fmus.python.mfc_channels import MfcChannels
from flexbeams.fmus.python.slave import Unit
from flexbeams.plant.actuator.amplifier import Channel, commanded
from flexbeams.plant.actuator.operators import Operators, hysteresis, move_plays, relax, with_creep


class MfcActuator(MfcChannels, Unit):
    """Channels without lag and slew rate advance together, others one by one."""

    def setup(self) -> None:
        super().setup()
        self._u, self._u_eff, self._voltage = self.view("u"), self.view("u_eff"), self.view("voltage")
        self._lag, self._slew_rate, self._resolution = self.view("lag"), self.view("slew_rate"), self.view("resolution")

    def initialise(self) -> None:
        """At rest under the last voltage of the history."""
        self._voltage[:] = self._start()
        self._write_outputs()

    def advance(self, time: float, step: float) -> None:
        """Hold the commands for `step` s."""
        self._count_saturated(self._u, time)
        commands = commanded(self._u, self._limits, self._resolution)
        if not self._lag.any() and not self._slew_rate.any():
            self._voltage[:] = commands
            move_plays(self._operators, self._plays, commands)
            relax(self._operators, self._creeps, hysteresis(self._operators, self._plays), step)
        else:
            for k, command in enumerate(commands.tolist()):
                self._follow(k, command, step)
        self._write_outputs()

    def _follow(self, k: int, command: float, step: float) -> None:
        o, row = self._operators, slice(k, k + 1)
        channel = Channel(
            operators=Operators(
                play_threshold=o.play_threshold[row],
                play_weight=o.play_weight[row],
                dead_zone_threshold=o.dead_zone_threshold[row],
                dead_zone_slope=o.dead_zone_slope[row],
                creep_time=o.creep_time[row],
                creep_weight=o.creep_weight[row],
            ),
            plays=self._plays[row],
            creeps=self._creeps[row],
            voltage=float(self._voltage[k]),
        )
        channel.follow(command, float(self._lag[k]), float(self._slew_rate[k]), step)
        self._voltage[k] = channel.voltage

    def _write_outputs(self) -> None:
        self._u_eff[:] = with_creep(self._operators, self._creeps, hysteresis(self._operators, self._plays))
