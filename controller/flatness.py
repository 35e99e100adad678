"""Flat output and the parameterisation of input and state by its derivatives, (31)-(36)."""

from dataclasses import dataclass

import numpy as np

from flexbeams.controller.planner import InputShapes, sample_grid
from flexbeams.controller.reduction import ReducedModel
from flexbeams.controller.transition import Transition, derivative_scales
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError

TABULATED_TIMES, TABULATED_INTERVALS = 64, 512
MAX_OVERDRIVE = 20.0  # largest planned voltage relative to the one at rest


@dataclass(frozen=True, kw_only=True)
class FlatParameterisation:
    """u = sum_i input[i] xi^(i), x_r = sum_i state[:, i] xi^(i); the flat output xi has one entry an input.

    D_u(s) = prod(1 - s/lambda_i) is scalar: `input` (m + 1,) with m = 2 r N_r, all positive. `state`
    (m, m, n_u) stacks the matrices that multiply xi, xi', ... xi^(m-1).
    """

    input: Array  # (m + 1,), s^i
    state: Array  # (m, m, n_u): state, order of the derivative, input

    @property
    def degree(self) -> int:
        """Highest derivative of the flat output needed, m."""
        return len(self.input) - 1


def flat_parameterisation(model: ReducedModel) -> FlatParameterisation:
    """The parameterisation of a reduced model in its spectral form (31), (34).

    Raises DesignError where eigenvectors are too dependent (a multiple eigenvalue) for the spectral form.
    """
    eigenvalues, vectors = np.linalg.eig(model.A)
    inputs = np.linalg.solve(vectors, model.B.astype(complex))
    m, n_u = model.B.shape
    if np.linalg.cond(vectors) > 1e10:
        raise DesignError(
            "the reduced model has (nearly) multiple eigenvalues, for which the spectral form (31) "
            "does not exist; change reduced_modes or the structure"
        )
    D_u = _product(eigenvalues)
    state = np.zeros((m, m, n_u), dtype=complex)
    for index, eigenvalue in enumerate(eigenvalues):
        D_z = _product(np.delete(eigenvalues, index))  # (34b): all factors but one
        z = -np.outer(D_z, inputs[index]) / eigenvalue  # (m, n_u)
        state += vectors[:, index, None, None] * z
    return FlatParameterisation(input=D_u.real.copy(), state=state.real.copy())


def _product(eigenvalues: Array) -> Array:
    """Coefficients, ascending, of prod(1 - s/lambda); the small factors first, pairs kept together."""
    product = np.ones(1, dtype=complex)
    for eigenvalue in sorted(eigenvalues, key=lambda v: (-abs(v), v.imag)):
        product = np.convolve(product, [1.0, -1 / eigenvalue])
    return product


def transition_series(transition: Transition, degree: int, tau: Array) -> Array:
    """Taylor coefficients of Theta at each tau (k,); shape (k, degree + 1)."""
    return np.array([transition.series(float(t), degree) for t in tau])


def input_shape(flat: FlatParameterisation, series: Array, transition_time: float) -> Array:
    """D_u(d/dt) Theta at the points of `series` (k, m + 1), for one transition time; shape (k,)."""
    shape: Array = series @ (flat.input * derivative_scales(flat.degree, transition_time))
    return shape


def tabulate_input_shapes(flat: FlatParameterisation, transition: Transition, slowest_frequency: float) -> InputShapes:
    """The planner's table, for transition times up to 16 periods of the slowest mode (rad/s).

    It starts at half a period or where the shape exceeds MAX_OVERDRIVE: shorter ones have spikes between grid points.
    Raises DesignError where every entry has, and where derivatives of this degree exceed the range of doubles.
    """
    period = 2 * np.pi / slowest_frequency
    times = period * np.geomspace(0.5, 16, TABULATED_TIMES)
    with np.errstate(over="ignore", invalid="ignore"):
        series = transition_series(transition, flat.degree, sample_grid(TABULATED_INTERVALS))
        values = np.array([input_shape(flat, series, float(T)) for T in times])
    if not (np.isfinite(series).all() and np.isfinite(values[-1]).all()):
        raise DesignError(
            f"derivatives of the flat output up to degree {flat.degree} exceed the range of doubles; "
            "use a smaller reduced_modes"
        )
    fitting = np.max(np.abs(values), axis=1) <= MAX_OVERDRIVE
    if not fitting[-2:].all():
        raise DesignError(
            f"a transition of {times[-1]:.3g} s still needs {np.max(np.abs(values[-1])):.3g} times the "
            "voltage at rest; use a smaller reduced_modes or a gevrey_order nearer to 1.5"
        )
    first = len(times) - int(np.argmin(fitting[::-1])) if not fitting.all() else 0
    return InputShapes(times=times[first:], values=values[first:])


def cancellation_ratio(flat: FlatParameterisation, transition: Transition, transition_time: float) -> float:
    """Largest sum of the terms' magnitudes over the largest sum along one transition (loss of digits)."""
    terms = (
        transition_series(transition, flat.degree, np.linspace(0, 1, 201))
        * flat.input
        * derivative_scales(flat.degree, transition_time)
    )
    return float(np.max(np.sum(np.abs(terms), axis=1)) / np.max(np.abs(np.sum(terms, axis=1))))
