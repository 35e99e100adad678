"""Input and state of a reduced model in terms of its flat output (31)-(36)."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexbeams.controller.transition import Transition
from flexbeams.plant.basis import Array


@dataclass(frozen=True, kw_only=True)
class FlatParameterisation:
    """u = sum_i c_i xi^(i), x_r = Re sum_l v_l y_l; the flat output xi has one entry an input.

    D_u(s) = prod(1 - s/lambda_i) = sum_i c_i s^i is scalar, of degree m = 2 r N_r, all c_i positive; D_l is D_u without
    the factor of mode l, one of a real eigenvalue or a pair. With the terms g_i = c_i Theta^(i) of a transition by
    `change` the voltages move by change sum_i g_i, and the amplitudes y_l by (inputs_l change) sum_i (D_l,i / c_i) g_i.
    Coefficients occur as ratios only: c_i itself leaves the range of doubles from m of about 100 on.
    """

    ratios: Array  # (m,): (i + 1) c_(i+1) / c_i, s
    mode_series: Array  # (2 l, m): D_l,i / c_i, real parts of all modes before the imaginary ones
    mode_inputs: Array  # (2 l, n_u): amplitudes for a voltage at rest, 1/V, likewise; one entry of each mode is 1
    mode_states: Array  # (m, 2 l): Re(v_l), then -Im(v_l)

    @classmethod
    def of(cls, arrays: Mapping[str, Array]) -> "FlatParameterisation":
        """The parameterisation in a design's or a unit's arrays."""
        return cls(
            ratios=arrays["flat_ratios"],
            mode_series=arrays["mode_series"],
            mode_inputs=arrays["mode_inputs"],
            mode_states=arrays["mode_states"],
        )

    @property
    def degree(self) -> int:
        """Highest derivative of the flat output needed, m."""
        return len(self.ratios)

    @cached_property
    def complex_series(self) -> Array:
        """D_l,i / c_i, (l, m)."""
        return _joined(self.mode_series)

    @cached_property
    def complex_inputs(self) -> Array:
        """Amplitudes of the modes for a voltage at rest, (l, n_u), 1/V."""
        return _joined(self.mode_inputs)

    def terms(self, transition: Transition, tau: float, transition_time: float) -> Array:
        """c_i Theta^(i)(t), i = 0 ... m, at t = tau T, T = `transition_time` (s): shape (m + 1,).

        inf or NaN where T is so short that the terms leave the range of doubles, as the voltage does.
        """
        series = transition.series(tau, self.degree)
        scales = np.cumprod(self.ratios / (transition_time * series.unit))
        terms = series.coefficients
        terms[1:] *= scales
        return terms

    def amplitudes(self, terms: Array, change: Array) -> Array:
        """Complex amplitudes y (l,) of the modes in a transition by `change` (n_u,), V."""
        amplitudes: Array = (self.complex_inputs @ change) * (self.complex_series @ terms[:-1])
        return amplitudes

    def state(self, amplitudes: Array) -> Array:
        """x_r (m,) of the amplitudes (l,)."""
        state: Array = self.mode_states @ np.concatenate([amplitudes.real, amplitudes.imag])
        return state


def _joined(rows: Array) -> Array:
    """Complex rows of those with real and imaginary parts."""
    half = len(rows) // 2
    joined: Array = rows[:half] + 1j * rows[half:]
    return joined
