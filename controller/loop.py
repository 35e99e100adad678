"""Frequency responses, poles and noise of the loop that is closed: the sampled controller on a full plant."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from flexbeams.controller.closed_loop import SampledController, SampledPlant, closed_loop_matrix, poles_of
from flexbeams.controller.frequency import Complex, ModalForm, Resolvent, resolvent
from flexbeams.plant.basis import Array

LOWEST_FREQUENCY = 0.1  # rad/s
_POINTS_PER_DECADE = 60
_AROUND_A_POLE = (-3.0, -1.5, -0.7, 0.0, 0.7, 1.5, 3.0)  # half widths of the resonance
_SEEN = 1e-3  # height of a resonance in S, and of the plant's modes the loop gain, below which a grid may miss it
_DISTINCT = 0.5  # damping ratio below which a pole is a resonance


@dataclass(frozen=True, kw_only=True)
class LoopResponse:
    """Frequency responses at the plant's input, negative feedback: S = (I - K P)^-1, T = I - S, KS = S K.

    P is the plant from voltages to strains, K the controller from strains to voltages; k frequencies.
    """

    omega: Array  # (k,), rad/s
    S: Complex  # (k, n_u, n_u): from a voltage added at the plant's input to the voltage there
    T: Complex  # (k, n_u, n_u): to the voltage of the controller, negative
    KS: Complex  # (k, n_u, n_pm), V: from strain noise to voltages


@dataclass(frozen=True)
class Loop:
    """The loop of a controller and a plant with the same sample time."""

    controller: SampledController
    plant: SampledPlant

    def poles(self) -> Complex:
        """Poles in 1/s, log(z) / step, the least stable first."""
        return poles_of(self._resolvent.poles, self.plant.step)

    @cached_property
    def _inputs(self) -> tuple[Array, Array]:
        """Effect of voltages added at the plant's input (n, n_u) and of strain noise (n, n_pm) on the loop's state."""
        P, K = self.plant, self.controller
        voltages = np.vstack([P.B, K.B @ P.D_pm])
        return voltages, np.vstack([np.zeros((len(P.A), K.B.shape[1])), K.B])

    @cached_property
    def _output(self) -> Array:
        """Voltages of the controller from the loop's state."""
        return np.hstack([np.zeros((len(self.controller.C), len(self.plant.A))), self.controller.C])

    @cached_property
    def _resolvent(self) -> Resolvent:
        """From voltages added at the plant's input and strain noise to the controller's voltages."""
        return resolvent(closed_loop_matrix(self.controller, self.plant), np.hstack(self._inputs), self._output)

    def sensitivity(self, omega: Array) -> LoopResponse:
        """S, T and KS at frequencies omega (k,), rad/s, up to that of Nyquist."""
        n_u, frequencies = self.plant.B.shape[1], np.asarray(omega, dtype=np.float64)
        G = self._resolvent.at(self._points(frequencies))
        return LoopResponse(omega=frequencies, S=np.eye(n_u) + G[:, :, :n_u], T=-G[:, :, :n_u], KS=G[:, :, n_u:])

    def input_sensitivity(self, omega: Array) -> Complex:
        """S (k, n_u, n_u) alone."""
        n_u = self.plant.B.shape[1]
        G = self._resolvent.part(slice(None), slice(n_u)).at(self._points(omega))
        return np.asarray(np.eye(n_u) + G, dtype=np.complex128)

    def channel_sensitivity(self, k: int) -> Callable[[Array], Complex]:
        """Entry k, k of S as a function of frequencies, (j,) for (j,): of the loop of pair k, the others closed."""
        entry = self._resolvent.part(slice(k, k + 1), slice(k, k + 1))

        def at(frequencies: Array) -> Complex:
            return np.asarray(1 + entry.at(self._points(frequencies))[:, 0, 0], dtype=np.complex128)

        return at

    def _points(self, omega: Array) -> Complex:
        return np.asarray(np.exp(1j * self.plant.step * omega), dtype=np.complex128)

    def frequencies(self) -> Array:
        """A grid (k,) in rad/s up to Nyquist that resolves resonances of the loop and of the plant alone."""
        nyquist = np.pi / self.plant.step
        count = int(np.ceil(_POINTS_PER_DECADE * np.log10(nyquist / LOWEST_FREQUENCY)))
        poles = np.log(self._seen_poles()) / self.plant.step
        poles = poles[(poles.imag > LOWEST_FREQUENCY) & (np.abs(poles.real) < _DISTINCT * np.abs(poles))]
        peaks = (poles.imag[:, None] + np.outer(np.abs(poles.real), _AROUND_A_POLE)).ravel()
        grid = np.concatenate([np.geomspace(LOWEST_FREQUENCY, nyquist, count), peaks])
        return np.unique(grid[(grid >= LOWEST_FREQUENCY) & (grid <= nyquist)])

    def _seen_poles(self) -> Complex:
        """Poles z with positive imaginary parts, of the loop and of the plant alone, of modes that S has to do with.

        A mode of the loop has the height of its resonance in S; one of the plant is moved by the controller by that
        part of its distance from the unit circle. The modes of thousands of states are mostly far beyond both.
        """
        form, n_u, plant = self._resolvent, self.plant.B.shape[1], self.plant.poles()
        loop, plant = form.poles[form.poles.imag > 0], plant[plant.imag > 0]
        if not isinstance(form, ModalForm) or not len(loop) or not len(plant):
            return np.concatenate([plant, loop])
        heights = np.linalg.norm(form.C, axis=0) * np.linalg.norm(form.B[:, :n_u], axis=1)
        moved = np.min(np.abs(plant[:, None] - loop), axis=1)
        return np.concatenate(
            [
                plant[moved > _SEEN * np.abs(1 - np.abs(plant))],
                loop[heights[form.poles.imag > 0] > _SEEN * np.abs(1 - np.abs(loop))],
            ]
        )

    def noise_gain(self) -> Array:
        """Rms voltage of each pair (n_u,), V, for white strain noise of 1 m/m rms a sample on every gauge."""
        form, n_u = self._resolvent, self.plant.B.shape[1]
        if isinstance(form, ModalForm):
            noise = form.B[:, n_u:]
            covariance = noise @ noise.conj().T / (1 - np.outer(form.poles, form.poles.conj()))
            variance = np.sum((form.C @ covariance) * form.C.conj(), axis=1).real
        else:
            A, B = closed_loop_matrix(self.controller, self.plant), self._inputs[1]
            covariance = solve_discrete_lyapunov(A, B @ B.T, method="bilinear")
            variance = np.sum((self._output @ covariance) * self._output, axis=1)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)
