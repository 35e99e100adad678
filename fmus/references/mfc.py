"""Reference results of MfcActuator and MfcCompensator, by other ways than the kernels'.

A play operator is evaluated from all voltages since the demagnetised state; creep is the sum over all earlier steps of
what each has left; the compensator is the root of the actuator's response, found by bisection.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.fmus.references.experiments import Experiment, Series, digits, names_of
from flexbeams.plant.actuator.parameters import PatchPairActuator
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel

STEPS = 60


@dataclass
class PatchPair:
    """One channel from rest, advanced by steps of one size (s)."""

    parameters: PatchPairActuator
    step: float
    voltages: list[float] = field(default_factory=list)  # since the demagnetised state
    held: list[float] = field(default_factory=list)  # h of each step

    def __post_init__(self) -> None:
        self.voltages = list(self.parameters.history) or [0.0]
        self.rest = self.hysteresis(self.voltages[-1])

    def hysteresis(self, voltage: float) -> float:
        """h after a further voltage."""
        p = self.parameters
        path = [*self.voltages, voltage]
        z = p.linear_weight * voltage
        z += sum(w * last_play(path, r) for r, w in zip(p.play_thresholds, p.play_weights, strict=True))
        h = z
        for threshold, slope in zip(p.dead_zone_thresholds, p.dead_zone_slopes, strict=True):
            h += slope * (max(z - threshold, 0.0) if threshold >= 0.0 else min(z - threshold, 0.0))
        return h

    def effective(self, voltage: float) -> float:
        """u_eff at the end of a step under a further voltage."""
        held = np.array([*self.held, self.hysteresis(voltage)])
        age = self.step * np.arange(len(held), 0.0, -1.0)  # of the begin of each step
        u_eff = held[-1]
        for tau, weight in zip(self.parameters.creep_times, self.parameters.creep_weights, strict=True):
            left = np.exp(-(age - self.step) / tau) - np.exp(-age / tau)
            u_eff += weight * (self.rest * np.exp(-age[0] / tau) + float(held @ left))
        return float(u_eff)

    def apply(self, voltage: float) -> float:
        """A step under a voltage; returns u_eff at its end."""
        u_eff = self.effective(voltage)
        self.held.append(self.hysteresis(voltage))
        self.voltages.append(voltage)
        return u_eff

    def at_rest(self) -> float:
        """u_eff before the first step."""
        return self.rest * (1.0 + sum(self.parameters.creep_weights))


def last_play(path: list[float], threshold: float) -> float:
    """A play operator at the end of a path of voltages that begins at 0."""
    value = 0.0
    for voltage in path:
        if voltage - value > threshold:
            value = voltage - threshold
        elif voltage - value < -threshold:
            value = voltage + threshold
    return value


def voltage_by_bisection(response: Callable[[float], float], wanted: float, limit: float) -> float:
    """The voltage within the limit whose response, a growing function, is the wanted one or nearest to it."""
    low, high = -limit, limit
    if response(low) >= wanted:
        return low
    if response(high) <= wanted:
        return high
    while (middle := (low + high) / 2) not in (low, high):
        low, high = (middle, high) if response(middle) < wanted else (low, middle)
    return middle


def mfc_actuator_experiments(design: Design, model: BeamModel) -> list[Experiment]:
    """Loops of falling and rising amplitude, and one beyond the amplifier's limit."""
    pairs, limit, step, inputs = _setting(design, model)
    rows = [[*(pair.at_rest() for pair in pairs), 0.0]]
    for row in inputs[:-1]:
        within = np.clip(row, -limit, limit).tolist()
        beyond = bool(np.any(np.abs(row) > limit))
        rows.append([*(pair.apply(v) for pair, v in zip(pairs, within, strict=True)), float(beyond)])
    return [_experiment("loops", "Loops, at last beyond the amplifier's limit", step, "u", inputs, "u_eff", rows)]


def mfc_compensator_experiments(design: Design, model: BeamModel) -> list[Experiment]:
    """Commands for wanted loops, some of them out of reach."""
    pairs, limit, step, inputs = _setting(design, model)
    given = [pair.voltages[-1] for pair in pairs]
    rows = [[*given, 0.0]]
    for row in inputs[:-1]:
        for pair, voltage in zip(pairs, given, strict=True):
            pair.apply(voltage)
        given = [
            voltage_by_bisection(pair.effective, wanted, limit)
            for pair, wanted in zip(pairs, row.tolist(), strict=True)
        ]
        beyond = any(abs(voltage) == limit for voltage in given)
        rows.append([*given, float(beyond)])
    return [_experiment("loops", "Wanted loops, at last out of reach", step, "u_eff", inputs, "u", rows)]


def _setting(design: Design, model: BeamModel) -> tuple[list[PatchPair], float, float, Array]:
    """Channels, limit of the amplifier (V), step (s), and voltages (steps + 1, channels)."""
    actuator = model.structure.actuator
    assert actuator is not None
    step = design.options.sample_time
    limit = min(actuator.face_maximum - actuator.supply, actuator.supply - actuator.face_minimum)
    k, channel = np.arange(STEPS + 1.0)[:, None], np.arange(len(actuator.pair))
    amplitude = np.where(k < STEPS // 2, 0.9 - k / STEPS, 0.4 + 1.2 * (k - STEPS // 2) / STEPS)
    inputs = digits(limit * amplitude * np.sin(2 * np.pi * k / (9 + 2 * channel)), 4)
    inputs[-8:] *= 1.25
    return [PatchPair(parameters=pair, step=step) for pair in actuator.pair], limit, step, inputs


def _experiment(
    name: str, description: str, step: float, driven: str, inputs: Array, observed: str, rows: list[list[float]]
) -> Experiment:
    channels = inputs.shape[1]
    time: Array = step * np.arange(float(len(inputs)))
    return Experiment(
        name=name,
        description=description,
        step=step,
        steps=len(inputs) - 1,
        stimuli=Series(names=tuple(names_of(driven, channels)), time=time, values=inputs),
        references=Series(names=(*names_of(observed, channels), "saturated"), time=time, values=np.array(rows)),
    )
