"""Transitions as uniform quintic B-splines, and the exact state of a reduced model under such voltages.

A transition of T s has SPANS spans of h = T / SPANS s and SPANS + DEGREE control points for each pair: the first DEGREE
are zero, the last DEGREE the change, FREE lie between. Voltages and their first four derivatives are thus continuous,
also with the rest before and after.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexbeams.plant.basis import Array

SPANS = 45
DEGREE = 5
FREE = SPANS - DEGREE
SAMPLES = 3  # of a span, where the planner looks at the voltages; it adds the parabola through three neighbours
PLANNED_EXCESS = 1e-3  # of the limits, by which a planned voltage may exceed them: shapes overshoot by about as much
_TERMS = 14  # of the series of phi_6 for |z| < 1
# row k: the k-th derivative at the start of a span, by control points, spans as the unit of time
DERIVATIVES = np.array(
    [
        [1 / 120, 26 / 120, 66 / 120, 26 / 120, 1 / 120, 0.0],
        [-1 / 24, -10 / 24, 0.0, 10 / 24, 1 / 24, 0.0],
        [1 / 6, 2 / 6, -6 / 6, 2 / 6, 1 / 6, 0.0],
        [-1 / 2, 1.0, 0.0, -1.0, 1 / 2, 0.0],
        [1.0, -4.0, 6.0, -4.0, 1.0, 0.0],
        [-1.0, 5.0, -10.0, 10.0, -5.0, 1.0],
    ]
)
_FACTORIALS = np.array([1.0, 1.0, 2.0, 6.0, 24.0, 120.0, 720.0])


def span_weights(fraction: Array) -> Array:
    """Weights (l, DEGREE + 1) of a span's control points at fractions (l,) of it."""
    powers = fraction[:, None] ** np.arange(DEGREE + 1) / _FACTORIALS[:-1]
    weights: Array = powers @ DERIVATIVES
    return weights


def phi_functions(z: Array) -> Array:
    """phi_k(z) = integral over [0, 1] of e^((1 - s) z) s^(k-1) / (k-1)!, k = 1 ... 6, phi_0 = e^z; (7, l) of complex z.

    phi_k = z phi_(k+1) + 1/k!, upwards for |z| >= 1, else downwards from the series of phi_6: either way errors shrink.
    """
    z = z.astype(complex)
    small = np.abs(z) < 1.0
    values = np.empty((7, len(z)), dtype=complex)
    series = np.zeros(len(z), dtype=complex)
    for n in range(_TERMS - 1, -1, -1):
        series = 1.0 + series * z / (n + 7)
    values[6] = series / 720.0
    for k in range(5, -1, -1):
        values[k] = z * values[k + 1] + 1 / _FACTORIALS[k]
    large = z[~small]
    above = np.exp(large)
    values[0, ~small] = above
    for k in range(6):
        above = (above - 1 / _FACTORIALS[k]) / large
        values[k + 1, ~small] = above
    return values


@dataclass(frozen=True, kw_only=True)
class SplineTransitions:
    """The tabulated transitions of a design, and the modes y' = lambda y + beta u of its reduced model, x = Re V y.

    Complex numbers are stored as real parts of all l modes before the imaginary ones.
    """

    times: Array  # (k,), s, ascending
    points: Array  # (k, n_u, FREE, n_u): free control points of all pairs for 1 V more at one pair
    eigenvalues: Array  # (2 l,), 1/s
    mode_inputs: Array  # (2 l, n_u): beta, 1/(V s)
    mode_states: Array  # (m, 2 l): Re V, then -Im V; V doubled for pairs

    @classmethod
    def of(cls, arrays: Mapping[str, Array]) -> "SplineTransitions":
        """The transitions in a design's or a unit's arrays."""
        return cls(
            times=arrays["spline_times"],
            points=arrays["spline_points"],
            eigenvalues=arrays["spline_eigenvalues"],
            mode_inputs=arrays["spline_inputs"],
            mode_states=arrays["spline_states"],
        )

    def arrays(self) -> dict[str, Array]:
        """The arrays of a design."""
        return {
            "spline_times": self.times,
            "spline_points": self.points,
            "spline_eigenvalues": self.eigenvalues,
            "spline_inputs": self.mode_inputs,
            "spline_states": self.mode_states,
        }

    @cached_property
    def rates(self) -> Array:
        """lambda (l,), complex."""
        half = len(self.eigenvalues) // 2
        rates: Array = self.eigenvalues[:half] + 1j * self.eigenvalues[half:]
        return rates

    @cached_property
    def inputs(self) -> Array:
        """beta (l, n_u), complex."""
        half = len(self.mode_inputs) // 2
        inputs: Array = self.mode_inputs[:half] + 1j * self.mode_inputs[half:]
        return inputs

    @property
    def grid(self) -> Array:
        """Where the planner looks at a transition: tau (SAMPLES SPANS + 1,) from 0 to 1."""
        return sample_points()

    @property
    def excess(self) -> float:
        """Part of a limit by which a plan may exceed it."""
        return PLANNED_EXCESS

    def candidates(self, requested: float, longest: float) -> Array:
        """The transition times (k,) that the planner chooses from: those tabulated from `requested` s on."""
        first = min(int(np.searchsorted(self.times, requested * (1 - 1e-9))), len(self.times) - 1)
        return self.times[first:]

    def index(self, duration: float) -> int:
        """The table's row for a tabulated duration."""
        return int(np.argmin(np.abs(self.times - duration)))

    def control_points(self, duration: float, change: Array) -> Array:
        """All control points of a transition by `change` (n_u,), V: (SPANS + DEGREE, n_u)."""
        free = np.tensordot(change, self.points[self.index(duration)], axes=1)
        zeros, ends = np.zeros((DEGREE, len(change))), np.tile(change, (DEGREE, 1))
        return np.vstack([zeros, free, ends])

    def voltages(self, duration: float, change: Array, tau: Array) -> Array:
        """Voltages of a transition by `change` (n_u,) at tau (l,) within [0, 1]: (l, n_u), V."""
        return spline_voltages(self.control_points(duration, change), tau)

    def amplitudes_at_rest(self, voltages: Array) -> Array:
        """Complex amplitudes (l,) of the modes at rest under voltages (n_u,)."""
        amplitudes: Array = -(self.inputs @ voltages) / self.rates
        return amplitudes

    def state(self, amplitudes: Array) -> Array:
        """x_r (m,) of complex amplitudes (l,)."""
        state: Array = self.mode_states @ np.concatenate([amplitudes.real, amplitudes.imag])
        return state


def sample_points() -> Array:
    """tau (SAMPLES SPANS + 1,) from 0 to 1, at which the planner looks at a transition."""
    tau: Array = np.arange(SAMPLES * SPANS + 1) / (SAMPLES * SPANS)
    return tau


def spline_voltages(points: Array, tau: Array) -> Array:
    """Voltages (l, n_u) of control points (SPANS + DEGREE, n_u) at tau (l,) within [0, 1]."""
    span = np.minimum(np.floor(tau * SPANS), SPANS - 1).astype(np.intp)
    weights = span_weights(tau * SPANS - span)
    around = points[span[:, None] + np.arange(DEGREE + 1)]
    voltages: Array = np.einsum("lq,lqu->lu", weights, around)
    return voltages


class SplineCourse:
    """One transition: voltages and amplitudes of the modes at any time of it.

    Within a span the voltages are a polynomial in s = t / h with derivatives U_k at its start, and the mode's equation
    has the exact solution y(s) = e^(z s) y(0) + h sum_k beta U_k s^(k+1) phi_(k+1)(z s), z = lambda h.
    """

    def __init__(self, tables: SplineTransitions, duration: float, change: Array) -> None:
        self._tables, self._points, self._length = tables, tables.control_points(duration, change), duration / SPANS
        projected = self._points @ tables.inputs.T  # (SPANS + DEGREE, l)
        around = projected[np.arange(SPANS)[:, None] + np.arange(DEGREE + 1)]
        self._derivatives = np.einsum("kq,iql->ikl", DERIVATIVES, around)  # of each span
        self._knots = np.zeros((SPANS + 1, projected.shape[1]), dtype=complex)  # amplitudes at the spans' starts
        phi = phi_functions(tables.rates * self._length)
        for i in range(SPANS):
            forced = self._length * np.sum(self._derivatives[i] * phi[1:], axis=0)
            self._knots[i + 1] = phi[0] * self._knots[i] + forced

    def at(self, tau: float) -> tuple[Array, Array]:
        """Voltages (n_u,) and complex amplitudes (l,) at tau within [0, 1]."""
        span = min(int(tau * SPANS), SPANS - 1)
        fraction = tau * SPANS - span
        voltages = span_weights(np.array([fraction]))[0] @ self._points[span : span + DEGREE + 1]
        phi = phi_functions(self._tables.rates * (self._length * fraction))
        powers = self._length * fraction ** np.arange(1, DEGREE + 2)
        amplitudes = phi[0] * self._knots[span] + np.sum(powers[:, None] * self._derivatives[span] * phi[1:], axis=0)
        return voltages, amplitudes
