"""The arithmetic of the units as recursions in numpy."""

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.controller.flat_output import FlatParameterisation
from flexbeams.controller.transition import Transition
from flexbeams.plant.basis import Array
from flexbeams.scenarios.bench.arithmetic import Matrices, TransitionSequence


class NumpyLoops:
    """Plant, feedforward and controller, each from rest at zero, step by step."""

    def __init__(self, design: Design, matrices: Matrices, transitions: TransitionSequence | None = None) -> None:
        self._m, self._transitions, self._step = matrices, transitions, design.options.sample_time
        a = design.arrays
        exponent, norm = a["transition_constants"]
        self._theta = Transition(exponent=float(exponent), norm=float(norm), table=a["transition_table"])
        self._flat = FlatParameterisation.of(a)
        voltages = len(a["feedback_gain"])
        self.x, self.y = np.zeros(len(matrices.transition)), np.zeros(len(matrices.outputs))
        self.x_est, self.u, self.integral = np.zeros(len(a["A"])), np.zeros(voltages), np.zeros(voltages)
        self.u_ff, self.x_ref, self.offset = np.zeros(voltages), np.zeros(len(a["A"])), np.zeros(voltages)
        self.y_est, self.y_ref = np.zeros(len(a["H_pi"])), np.zeros(len(a["H_pi"]))
        self._begun = self._ended = 0

    def plant_step(self, inputs: Array) -> None:
        """One step under voltages and forces (inputs,)."""
        self.x = self._m.transition @ np.concatenate((self.x, inputs))
        self.y = self._m.outputs @ self.x[: len(self.x) // 2]

    def controller_step(self, u_ff: Array, x_ref: Array, y_pm: Array) -> None:
        """One tick."""
        m = self._m
        self.x_est = m.filter @ np.concatenate((self.x_est, self.u, y_pm))
        error = m.regulator @ np.concatenate((x_ref - self.x_est, u_ff - self.u))
        demand, growth = u_ff + error[: len(u_ff)] + self.integral, m.gain * error[len(u_ff) :]
        self.integral = self.integral + np.where((np.abs(demand) > m.limit) & (demand * growth > 0), 0.0, growth)
        self.u = np.clip(demand, -m.limit, m.limit)
        self.y_est = m.estimates @ np.concatenate((self.x_est, self.u))

    def feedforward_step(self, number: int) -> None:
        """Outputs at the end of step `number`; unchanged at rest."""
        transitions = self._transitions
        assert transitions is not None
        time = number * self._step + self._step + transitions.preview
        while self._begun < len(transitions.begins) and transitions.begins[self._begun] <= number:
            self._begun += 1
        if self._ended == self._begun:
            return
        while self._ended < self._begun and time >= self._end(self._ended):
            self.offset = self.offset + transitions.changes[self._ended]
            self._ended += 1
        flat, self.u_ff, amplitudes = self._flat, self.offset.copy(), self._flat.complex_inputs @ self.offset
        for k in range(self._ended, self._begun):
            duration, change = float(transitions.durations[k]), transitions.changes[k]
            terms = flat.terms(self._theta, (time - transitions.begins[k] * self._step) / duration, duration)
            self.u_ff += np.sum(terms) * change
            amplitudes += flat.amplitudes(terms, change)
        self.x_ref = flat.state(amplitudes)
        self.y_ref = self._m.estimates @ np.concatenate((self.x_ref, self.u_ff))

    def _end(self, k: int) -> float:
        assert self._transitions is not None
        return float(self._transitions.begins[k] * self._step + self._transitions.durations[k])

    def closed_step(self, number: int) -> None:
        """One step of the closed loop, Jacobi coupling."""
        forces = self._m.transition.shape[1] - len(self.x) - len(self.u)
        held = np.concatenate((self.u, np.zeros(forces)))
        self.controller_step(self.u_ff, self.x_ref, self.y[len(self.y_est) :])
        self.feedforward_step(number)
        self.plant_step(held)
