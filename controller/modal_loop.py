"""The closed loop in modal form: poles, noise, sensitivities and responses in milliseconds, for searches."""

from dataclasses import dataclass

import numpy as np

from flexbeams.controller.closed_loop import SampledController, SampledPlant, closed_loop_matrix
from flexbeams.controller.frequency import Complex
from flexbeams.controller.structured_value import osborne_bounds
from flexbeams.plant.basis import Array
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.galerkin import BeamModel

DIRECT_TIME = 0.2  # s after the last force for which every sample is computed
COARSE_STEP = 2e-3  # s between the instants from then on
NEGLIGIBLE = 1e-7  # of the largest value: modes that are smaller after DIRECT_TIME are left out
_PER_DECADE = 80
_HIGHEST = 5e3  # rad/s: sensitivities are close to I beyond


@dataclass(frozen=True, kw_only=True)
class DisturbedPlant:
    """A sampled plant, and the effect of forces on the beams' tips that are held over a sample."""

    plant: SampledPlant
    force: Array  # (n, r), 1/N

    @classmethod
    def of(cls, model: BeamModel, step: float, parameters: dict[str, float] | None = None) -> "DisturbedPlant":
        """The full plant of a model; `parameters` in place of the structure's."""
        system = model.assemble(parameters)
        n_u = system.L.shape[1]
        form = energy_form(system.M, system.D, system.K, np.hstack([system.L, model.tips.T]))
        A, B = discretise(form.A, form.B, step)
        H_pi, H_pm = form.outputs(model.deflection), form.outputs(model.strain)
        none = np.zeros((len(H_pi), n_u)), np.zeros((len(H_pm), n_u))
        plant = SampledPlant(A=A, B=B[:, :n_u], H_pi=H_pi, H_pm=H_pm, D_pi=none[0], D_pm=none[1], step=step)
        return cls(plant=plant, force=B[:, n_u:])


@dataclass(frozen=True, kw_only=True)
class Response:
    """Deflections and voltages after forces; every sample at first, then coarser."""

    time: Array  # (k,), s
    y: Array  # (k, n_pi), m
    u: Array  # (k, n_u), V; empty without a controller


class ModalLoop:
    """Eigenvectors of the loop's matrix, or of the plant's alone where there is no controller."""

    def __init__(self, disturbed: DisturbedPlant, controller: SampledController | None) -> None:
        P = disturbed.plant
        self._disturbed = disturbed
        self._matrix = P.A if controller is None else closed_loop_matrix(controller, P)
        size, n = len(self._matrix), len(P.A)
        self.values, self._vectors = np.linalg.eig(self._matrix)
        self._inverse = np.linalg.inv(self._vectors)
        self._deflection = np.hstack([P.H_pi, np.zeros((len(P.H_pi), size - n))])
        self._force = np.vstack([disturbed.force, np.zeros((size - n, disturbed.force.shape[1]))])
        self._voltage = np.zeros((0, size))
        self._inputs = np.zeros((size, 0)), np.zeros((size, 0))  # voltages added at the plant's input, strain noise
        if controller is not None:
            self._voltage = np.hstack([np.zeros((len(controller.C), n)), controller.C])
            self._inputs = (
                np.vstack([P.B, controller.B @ P.D_pm]),
                np.vstack([np.zeros((n, controller.B.shape[1])), controller.B]),
            )

    @property
    def growth(self) -> float:
        """Largest real part of the poles, 1/s."""
        return float(np.log(np.max(np.abs(self.values))) / self._disturbed.plant.step)

    def noise_gain(self) -> Array:
        """Rms voltage of each pair (n_u,) for white strain noise of 1 m/m rms a sample."""
        b, c = self._inverse @ self._inputs[1], self._voltage @ self._vectors
        covariance = (b @ b.conj().T) / (1 - np.outer(self.values, self.values.conj()))
        variance = np.einsum("ij,jk,ik->i", c, covariance, c.conj()).real
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)

    def disk_margin(self) -> float:
        """Disk margin of all pairs at once, from Osborne's bound on a grid: a little smaller than that of `margins`."""
        step = self._disturbed.plant.step
        poles = np.log(self.values[np.abs(self.values) > 1e-9].astype(np.complex128)) / step
        resonances = poles[(poles.imag > 0.1) & (np.abs(poles) < _HIGHEST)]
        highest = min(_HIGHEST, np.pi / step)
        grid = np.geomspace(0.1, highest, int(_PER_DECADE * np.log10(highest / 0.1)))
        omega = np.concatenate([grid, *(resonances.imag + f * resonances.real for f in (-1.0, 0.0, 1.0))])
        z = np.exp(1j * step * omega[omega > 0])
        b, c = self._inverse @ self._inputs[0], self._voltage @ self._vectors
        G: Complex = np.einsum("in,kn,nj->kij", c, 1 / (z[:, None] - self.values), b, optimize=True)
        return float(1 / np.max(osborne_bounds(G + np.eye(len(c)) / 2)[0]))

    def response(self, forces: Array, stop: float) -> Response:
        """Response from rest to forces (k, r), N, held over a sample each, until `stop` s."""
        step = self._disturbed.plant.step
        acting = np.flatnonzero(np.any(forces != 0, axis=1))
        first, last = (int(acting[0]), int(acting[-1])) if len(acting) else (0, 0)
        direct = last + 1 + int(np.ceil(DIRECT_TIME / step))
        outputs = np.vstack([self._deflection, self._voltage])
        states = np.zeros((direct - first + 1, len(self._matrix)))
        for k in range(first, direct):
            force = self._force @ forces[k] if k <= last else 0.0
            states[k - first + 1] = self._matrix @ states[k - first] + force
        stride = max(1, round(COARSE_STEP / step))
        later = np.arange(direct + stride, int(stop / step) + 1, stride)
        head = states @ outputs.T
        amplitudes = (outputs @ self._vectors) * (self._inverse @ states[-1])  # (outputs, modes) at the end of the head
        largest = np.max(np.abs(amplitudes) / np.maximum(np.max(np.abs(head), axis=0), 1e-300)[:, None], axis=0)
        slow = (self.values.imag >= 0) & (largest > NEGLIGIBLE) & (np.abs(self.values) > 1e-12)
        twice = np.where(self.values[slow].imag > 0, 2.0, 1.0)
        powers = np.exp(np.outer(later - direct, np.log(self.values[slow].astype(np.complex128))))
        tail = (powers @ (amplitudes[:, slow] * twice).T).real
        values = np.vstack([head, tail])
        points = len(self._deflection)
        samples = np.concatenate([np.arange(first, direct + 1), later])
        return Response(time=step * samples, y=values[:, :points], u=values[:, points:])
