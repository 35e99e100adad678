"""Sampled plants of the undamped modes that matter to a controller, the others at their statics.

A loop is stable on a plant P = P_1 + E where it is on P_1 and the gain of K S_1 E stays below 1 (small gain). Fast
modes of a fine basis, which sensors hardly see and a controller hardly moves, thus need no part in its eigenvalues.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from flexbeams.controller.closed_loop import SampledController, SampledPlant
from flexbeams.controller.frequency import resolvent
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.statespace import static_gains

_LEAST_LOOP_GAIN = 1e-4  # of a mode alone at its resonance, below which it is taken to be at rest


@dataclass(frozen=True, kw_only=True)
class PlantModes:
    """The undamped modes of a model."""

    model: BeamModel
    system: SecondOrderSystem
    inverse_squares: Array  # (n,), s^2, ascending: the slowest mode last
    shapes: Array  # (n, n), columns of unit stiffness

    @classmethod
    def of(cls, model: BeamModel) -> "PlantModes":
        """Those of the structure's parameters."""
        system = model.assemble()
        inverse_squares, shapes = eigh(system.M, system.K)
        return cls(model=model, system=system, inverse_squares=inverse_squares, shapes=shapes)

    def slow(self, step: float, frequency: float) -> SampledPlant:
        """The modes below `frequency`, rad/s, and at least one."""
        return self._sampled(step, self.inverse_squares > min(frequency**-2, 0.99 * self.inverse_squares[-1]))

    def moved_by(self, controller: SampledController, step: float) -> SampledPlant:
        """The modes that a controller moves: those whose loop gain at resonance alone is above 1e-4."""
        kept = self.loop_gains(controller, step) > _LEAST_LOOP_GAIN
        kept[-1] = True
        return self._sampled(step, kept)

    def loop_gains(self, controller: SampledController, step: float) -> Array:
        """Largest gain (n,) of the loop of each mode alone, at its resonance, its damping taken as proportional."""
        mass = self.shapes / np.sqrt(self.inverse_squares)  # columns of unit mass
        decay = np.einsum("ij,ij->j", mass, self.system.D @ mass) / 2
        poles = -decay + np.sqrt((decay**2 - 1 / self.inverse_squares).astype(np.complex128))
        z = np.exp(poles * step)
        on_circle = z / np.maximum(np.abs(z), 1e-300)
        strains, inputs = self.model.strain @ mass, mass.T @ self.system.L
        form = resolvent(controller.A, controller.B @ strains, controller.C)
        gains = np.linalg.norm(form.at_each(on_circle), axis=1) * np.linalg.norm(inputs, axis=1)
        other = np.where(poles.imag == 0, -2 * decay - poles, poles.conj())
        residues = np.abs((z - 1) / np.maximum(np.abs(poles * (poles - other)), 1e-300))
        return np.asarray(2 * gains * residues / np.maximum(1 - np.abs(z), 1e-300), dtype=np.float64)

    def _sampled(self, step: float, kept: NDArray[np.bool_]) -> SampledPlant:
        """The modes `kept` (n,), the statics of the others in D_pi and D_pm."""
        model, system, shapes = self.model, self.system, self.shapes[:, kept]
        M, D, K = (shapes.T @ matrix @ shapes for matrix in (system.M, system.D, system.K))
        form = energy_form(M, D, K, shapes.T @ system.L)
        A, B = discretise(form.A, form.B, step)
        H_pi, H_pm = form.outputs(model.deflection @ shapes), form.outputs(model.strain @ shapes)
        rest = -np.linalg.solve(form.A, form.B)
        full_pi, full_pm = static_gains(model, system)
        return SampledPlant(
            A=A, B=B, H_pi=H_pi, H_pm=H_pm, D_pi=full_pi - H_pi @ rest, D_pm=full_pm - H_pm @ rest, step=step
        )
