"""An amplifier in front of a patch pair: limits, resolution, slew rate and first-order lag, exact for a held command.

While the command holds, the voltage v approaches it without turning: at the slew rate as long as the lag would be
faster, then by v' = (command - v) / lag. Hysteresis is piecewise linear in v, so that creep has a closed form between
the voltages at which its slope changes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexbeams.plant.actuator.operators import (
    Operators,
    Reals,
    creep_shares,
    hysteresis,
    move_plays,
    relax,
    superposition,
)

SAME = 1e-12  # voltages nearer than this, relative to the largest involved, are one


def voltage_limit(face_minimum: Reals, face_maximum: Reals, supply: Reals) -> Reals:
    """Largest differential voltage (channels,), V: supply + u on one face and supply - u on the other stay in range."""
    limit: Reals = np.minimum(face_maximum - supply, supply - face_minimum)
    return limit


def commanded(u: Reals, limit: Reals, resolution: Reals) -> Reals:
    """The command that the amplifier follows: u (channels,) rounded to its resolution (0: any), within the limit."""
    step = np.where(resolution > 0.0, resolution, 1.0)
    rounded = np.where(resolution > 0.0, step * np.floor(u / step + 0.5), u)
    within: Reals = np.minimum(np.maximum(rounded, -limit), limit)
    return within


@dataclass(kw_only=True)
class Channel:
    """One channel: its operators (1, n), its states as views (1, n), and the voltage behind the amplifier."""

    operators: Operators
    plays: Reals
    creeps: Reals
    voltage: float  # V

    def follow(self, command: float, lag: float, slew_rate: float, step: float) -> None:
        """Voltage and operators after a step (s) under a held command (V); lag (s) and slew rate (V/s) may be 0."""
        left = step
        if slew_rate > 0.0 and abs(command - self.voltage) > slew_rate * lag:
            duration = (abs(command - self.voltage) - slew_rate * lag) / slew_rate
            rate = math.copysign(slew_rate, command - self.voltage)
            if duration < left:
                self._ramp(command - rate * lag, rate, duration)
                left -= duration
            else:
                self._ramp(self.voltage + rate * left, rate, left)
                return
        if lag > 0.0 and self.voltage != command:
            self._approach(command, lag, left)
        else:
            self._move(command)
            relax(self.operators, self.creeps, hysteresis(self.operators, self.plays), left)

    def _ramp(self, end: float, rate: float, duration: float) -> None:
        """To the voltage `end` at a constant rate (V/s)."""
        while duration > 0.0:
            bend, slope = self._next_bend(math.copysign(1.0, rate))
            last = (end - bend) * rate <= 0.0
            time = duration if last else min((bend - self.voltage) / rate, duration)
            h = hysteresis(self.operators, self.plays)[:, None]
            shares, tau = creep_shares(self.operators, time), self.operators.creep_time
            self.creeps += (h - self.creeps) * shares + slope * rate * (time - tau * shares)
            self._move(end if last else bend)
            duration = 0.0 if last else duration - time

    def _approach(self, command: float, lag: float, duration: float) -> None:
        """Exponentially towards the command."""
        end = command + (self.voltage - command) * math.exp(-duration / lag)
        while duration > 0.0:
            away = self.voltage - command
            bend, slope = self._next_bend(-math.copysign(1.0, away))
            last = (end - bend) * away >= 0.0 or away == 0.0
            time = duration if last else min(lag * math.log(away / (bend - command)), duration)
            h = hysteresis(self.operators, self.plays)[:, None]
            shares = creep_shares(self.operators, time)
            self.creeps += (h - slope * away - self.creeps) * shares
            self.creeps += slope * away * _lagged(time / self.operators.creep_time, time / lag)
            self._move(end if last else bend)
            duration = 0.0 if last else duration - time

    def _move(self, voltage: float) -> None:
        self.voltage = voltage
        move_plays(self.operators, self.plays, np.array([voltage]))

    def _next_bend(self, direction: float) -> tuple[float, float]:
        """The voltage at which the slope of h over v changes next in a direction, and the slope up to there."""
        o, v = self.operators, self.voltage
        z = float(superposition(o, self.plays)[0])
        size = float(np.sum(o.play_weight[0] * np.abs(self.plays[0])))  # of the terms of z, which may cancel
        contact = self.plays[0] + direction * o.play_threshold[0]
        apart = direction * (contact - v) > SAME * (np.abs(contact) + abs(v))
        gain = float(np.sum(o.play_weight[0][~apart]))
        threshold = o.dead_zone_threshold[0]
        ahead = direction * (threshold - z) > SAME * (np.abs(threshold) + size)
        acting = ahead != ((threshold >= 0.0) == (direction > 0.0))
        bends = [*contact[apart].tolist(), *(v + (threshold[ahead] - z) / gain).tolist()]
        nearest = min(bends, key=lambda bend: abs(bend - v), default=direction * math.inf)
        return nearest, gain * (1.0 + float(np.sum(o.dead_zone_slope[0][acting])))


def _lagged(x: Reals, y: float) -> Reals:
    """x (exp(-y) - exp(-x)) / (x - y): what a creep operator takes from an exponential, x time / tau, y time / lag."""
    difference = x - y
    size = np.abs(difference)
    ratio = np.where(size > 0.0, -np.expm1(-size) / np.where(size > 0.0, size, 1.0), 1.0)
    part: Reals = x * np.exp(-np.minimum(x, y)) * ratio
    return part
