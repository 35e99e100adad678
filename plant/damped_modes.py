"""The damped modes of a second-order system, by iteration from its undamped ones.

Light damping turns undamped modes only a little. An iteration then takes a few products of matrices, a third of the
time of a QR iteration for a thousand modes, and keeps the digits of small eigenvalues beside large ones.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array

ComplexArray = NDArray[np.complex128]
_SWEEPS, _CORRECTIONS = 10, 8
_STANDS = 1e-14  # change in a sweep below which a mode stands
_SQUARED = 1e-8  # change by a correction below which the next one is at rounding


@dataclass(frozen=True, kw_only=True)
class DampedModes:
    """Solutions exp(a t) z of eta'' + damping eta' + diag(frequencies^2) eta = 0; the conjugate ones are the others."""

    frequencies: Array  # (n,), rad/s
    eigenvalues: ComplexArray  # a (n,), 1/s, imaginary parts > 0, in the order of the undamped modes
    shapes: ComplexArray  # columns z (n, n), 1 at their own undamped mode

    def state_vectors(self) -> ComplexArray:
        """Eigenvectors (2 n, n) of the state (diag(frequencies) eta, eta')."""
        states = np.vstack([self.frequencies[:, None] * self.shapes, self.eigenvalues * self.shapes])
        return np.asarray(states / self.frequencies, dtype=np.complex128)


def damped_modes(frequencies: Array, damping: Array) -> DampedModes | None:
    """All modes of undamped frequencies (n,), rad/s, with a symmetric damping matrix (n, n), 1/s.

    None where a mode is overdamped or where damping couples the modes too strongly for the iteration.
    """
    modes = _Iteration(frequencies, damping)
    with np.errstate(all="ignore"):
        left = np.arange(len(frequencies))
        for step, tolerance in [(modes.sweep, _STANDS)] * _SWEEPS + [(modes.correct, _SQUARED)] * _CORRECTIONS:
            if len(left):
                left = left[~(step(left) <= tolerance)]
        turned = np.abs(modes.shapes - np.eye(len(frequencies)))
        # in the spectral norm less than 1 from the identity: no two columns are the same mode
        distance = np.sqrt(np.max(turned.sum(axis=0)) * np.max(turned.sum(axis=1)))
        oscillating = modes.eigenvalues.imag > _SQUARED * np.abs(modes.eigenvalues)
    if len(left) or not distance < 1 or not oscillating.all():
        return None
    return DampedModes(frequencies=frequencies, eigenvalues=modes.eigenvalues, shapes=modes.shapes)


def damped_eigenvalues(frequencies: Array, damping: Array) -> tuple[ComplexArray, Array]:
    """Eigenvalues, 1/s, the slowest first: of each pair the one with the positive imaginary part, and the real ones."""
    modes = damped_modes(frequencies, damping)
    values = _by_qr_iteration(frequencies, damping) if modes is None else modes.eigenvalues
    oscillating = values[values.imag > 0]
    return oscillating[np.argsort(np.abs(oscillating))], np.sort(values[values.imag == 0].real)[::-1]


def modal_matrix(frequencies: Array, damping: Array) -> Array:
    """A (2 n, 2 n) of the state (diag(frequencies) eta, eta')."""
    rates = np.diag(frequencies)
    return np.block([[np.zeros_like(rates), rates], [-rates, -damping]])


def _by_qr_iteration(frequencies: Array, damping: Array) -> ComplexArray:
    """All eigenvalues of any damping; fast modes first, in which order small eigenvalues keep their digits."""
    order = np.argsort(-np.tile(frequencies, 2), kind="stable")
    return np.linalg.eigvals(modal_matrix(frequencies, damping)[np.ix_(order, order)]).astype(np.complex128)


class _Iteration:
    """Approximate modes, of which each step improves some."""

    def __init__(self, frequencies: Array, damping: Array) -> None:
        self._squares, self._decay = frequencies**2, np.diag(damping).copy()
        self._coupling = damping - np.diag(self._decay)
        self.shapes = np.eye(len(frequencies), dtype=np.complex128)
        self.eigenvalues = self._of_decay(np.arange(len(frequencies)), self._decay)
        self._norms: ComplexArray | None = None  # z' P'(a) z of each mode

    def sweep(self, modes: NDArray[np.intp]) -> Array:
        """Each row of the equation solved for its own undamped mode; the change of each of the modes.

        a^2 + a (damping z)_j + frequency_j^2 = 0 gives a, and z_k = -a (coupling z)_k / (a^2 + a damping_kk +
        frequency_k^2) the shape.
        """
        shapes = np.take(self.shapes, modes, axis=1)
        forces = _product(self._coupling, shapes)
        own = np.arange(len(modes))
        values = self._of_decay(modes, self._decay[modes] + forces[modes, own])
        stiffness = values**2 + np.multiply.outer(self._decay, values) + self._squares[:, None]
        stiffness[modes, own] = 1.0
        shapes = np.divide(-values * forces, stiffness, out=np.zeros_like(forces), where=forces != 0)
        shapes[modes, own] = 1.0
        return self._replace(modes, values, shapes)

    def correct(self, modes: NDArray[np.intp]) -> Array:
        """A Newton step with the inverse of the equation's matrix P(a) as the sum over all modes.

        P(a)^-1 = sum of z z' / ((a - b) z' P'(b) z) over the eigenvalues b, as the matrices are symmetric. It converges
        where sweeps hardly do: modes whose frequencies lie closer together than damping couples them.
        """
        if self._norms is None:  # approximate ones suffice
            damped = _product(self._coupling, self.shapes) + self._decay[:, None] * self.shapes
            self._norms = np.einsum("ij,ij->j", self.shapes, 2 * self.eigenvalues * self.shapes + damped)
        all_shapes, norms, own = self.shapes, self._norms, np.arange(len(modes))
        values, shapes = self.eigenvalues[modes], np.take(all_shapes, modes, axis=1)
        residuals = (values**2 + np.multiply.outer(self._decay, values) + self._squares[:, None]) * shapes
        residuals += values * _product(self._coupling, shapes)
        distances = norms[:, None] * (values - self.eigenvalues[:, None])
        distances[modes, own] = np.inf
        mirrored = norms.conj()[:, None] * (values - self.eigenvalues.conj()[:, None])
        along = all_shapes.T @ residuals
        shapes = shapes - all_shapes @ np.divide(along, distances, out=np.zeros_like(along), where=along != 0)
        shapes -= (all_shapes @ ((all_shapes.T @ residuals.conj()) / mirrored.conj())).conj()
        shapes /= shapes[modes, own]
        decay = self._decay[modes] + np.einsum("ji,ij->j", self._coupling[modes], shapes)
        return self._replace(modes, self._of_decay(modes, decay), shapes)

    def _of_decay(self, modes: NDArray[np.intp], decay: NDArray[np.generic]) -> ComplexArray:
        """Roots of a^2 + decay a + frequency^2 = 0 with the larger imaginary parts."""
        half = np.asarray(decay, dtype=np.complex128) / 2
        return np.asarray(-half + 1j * np.sqrt(self._squares[modes] - half**2), dtype=np.complex128)

    def _replace(self, modes: NDArray[np.intp], values: ComplexArray, shapes: ComplexArray) -> Array:
        turned = np.linalg.norm(shapes - self.shapes[:, modes], axis=0)
        shifted = np.abs(values - self.eigenvalues[modes]) / np.abs(values)
        self.eigenvalues[modes], self.shapes[:, modes] = values, shapes
        return np.asarray(np.maximum(turned, shifted), dtype=np.float64)


def _product(matrix: Array, columns: ComplexArray) -> ComplexArray:
    """A real matrix times complex columns in C order."""
    return np.asarray((matrix @ columns.view(np.float64)).view(np.complex128), dtype=np.complex128)
