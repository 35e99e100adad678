"""Flat output and the parameterisation of input and state by its derivatives, (31)-(36)."""

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.flat_output import FlatParameterisation
from flexbeams.controller.planner import InputShapes, sample_grid
from flexbeams.controller.reduction import ReducedModel
from flexbeams.controller.transition import Transition
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError

TABULATED_TIMES, TABULATED_INTERVALS = 64, 512
MAX_OVERDRIVE = 20.0  # largest planned voltage relative to the one at rest
MAX_CANCELLATION = 1e6  # largest loss of digits planned with, see cancellation_ratio
_PROMINENT = 0.55  # of the largest magnitude: the first input above it is the one that a mode is scaled by
_MARGIN = 32  # tabulated times from the shortest transition on, at least
_MOST_TIMES = 288


def flat_parameterisation(model: ReducedModel) -> FlatParameterisation:
    """The parameterisation of a reduced model in its spectral form (31), (34).

    Raises DesignError where eigenvectors are too dependent (a multiple eigenvalue) for the spectral form.
    """
    eigenvalues, vectors = np.linalg.eig(model.A)
    require_independent(vectors)
    inputs = np.linalg.solve(vectors, model.B.astype(complex))
    # The small factors first, pairs kept together; s in units of a mean eigenvalue keeps the coefficients in range
    order = sorted(range(len(eigenvalues)), key=lambda k: (-abs(eigenvalues[k]), eigenvalues[k].imag))
    unit = float(np.exp(np.mean(np.log(np.abs(eigenvalues)))))
    factors = unit / eigenvalues[order]
    vectors, inputs = vectors[:, order], inputs[order]
    c = _products(factors, np.full(1, -1, dtype=np.intp))[0].real
    modes = np.flatnonzero(eigenvalues[order].imag >= 0)
    weights = np.where(eigenvalues[order][modes].imag > 0, 2.0, 1.0)
    reach = -inputs[modes] / eigenvalues[order][modes, None]  # (l, n_u): (34b) at rest
    lead = leading_entries(reach)
    shapes = vectors[:, modes] * (weights * lead)
    return FlatParameterisation(
        ratios=np.arange(1, len(c)) * c[1:] / c[:-1] / unit,
        mode_series=_stacked(_products(factors, modes)[:, :-1] / c[:-1]),
        mode_inputs=_stacked(reach / lead[:, None]),
        mode_states=np.hstack([shapes.real, -shapes.imag]),
    )


def _products(factors: Array, omitted: NDArray[np.intp]) -> Array:
    """Coefficients, ascending, of prod_j(1 - factors[j] s), each row without the factor that it omits; (k, m + 1)."""
    products = np.zeros((len(omitted), len(factors) + 1), dtype=complex)
    products[:, 0] = 1.0
    for index, factor in enumerate(factors):
        products[:, 1:] -= np.where(omitted == index, 0.0, factor)[:, None] * products[:, :-1]
    return products


def require_independent(vectors: Array) -> None:
    """DesignError where eigenvectors (m, m) are too dependent to be coordinates."""
    if np.linalg.cond(vectors) > 1e10:
        raise DesignError(
            "the reduced model has (nearly) multiple eigenvalues, for which the spectral form (31) "
            "does not exist; change reduced_modes or the structure"
        )


def leading_entries(inputs: Array) -> Array:
    """Of each mode the first prominent entry of its inputs (l, n_u), by which it is scaled; 1 where there is none."""
    sizes = np.abs(inputs)
    first = np.argmax(sizes >= _PROMINENT * sizes.max(axis=1, keepdims=True), axis=1)
    entries = inputs[np.arange(len(inputs)), first]
    lead: Array = np.where(entries == 0, 1.0, entries)
    return lead


def _stacked(rows: Array) -> Array:
    return np.vstack([rows.real, rows.imag])


def transition_terms(flat: FlatParameterisation, transition: Transition, tau: Array, transition_time: float) -> Array:
    """c_i Theta^(i) at each tau (k,) of a transition of `transition_time` s; shape (k, m + 1), see `terms`."""
    return np.array([flat.terms(transition, float(t), transition_time) for t in tau])


class _Shapes:
    """D_u(d/dt) Theta on the planner's grid, of which the series are computed once for all transition times."""

    def __init__(self, flat: FlatParameterisation, transition: Transition) -> None:
        series = [transition.series(float(t), flat.degree) for t in sample_grid(TABULATED_INTERVALS)]
        self._ratios = flat.ratios
        self._units = np.array([s.unit for s in series])
        self._coefficients = np.array([s.coefficients for s in series])

    def tabulate(self, times: Array) -> tuple[Array, Array]:
        """The shape for each transition time (k,), (k, n + 1), inf where it leaves the range of doubles; which fit."""
        values, fitting = np.empty((len(times), len(self._units))), np.zeros(len(times), dtype=bool)
        for k, time in enumerate(times):
            terms = self._coefficients.copy()
            terms[:, 1:] *= np.cumprod(self._ratios / (time * self._units[:, None]), axis=1)
            shape = np.sum(terms, axis=1)
            values[k] = np.where(np.isfinite(shape), shape, np.inf)
            peak = np.max(np.abs(values[k]))
            fitting[k] = peak <= MAX_OVERDRIVE and _cancellation(terms) <= MAX_CANCELLATION
        return values, fitting


def tabulate_input_shapes(flat: FlatParameterisation, transition: Transition, slowest_frequency: float) -> InputShapes:
    """The planner's table, for transition times up to 16 periods of the slowest mode (rad/s), or longer.

    It starts at half a period or where the shape exceeds MAX_OVERDRIVE, since shorter ones have spikes between grid
    points, or where its terms cancel by more than MAX_CANCELLATION. Where that is near the end the table goes on to
    about six times as long. Raises DesignError where no length fits.
    """
    period = 2 * np.pi / slowest_frequency
    times = period * np.geomspace(0.5, 16, TABULATED_TIMES)
    with np.errstate(all="ignore"):
        shapes = _Shapes(flat, transition)
        values, fitting = shapes.tabulate(times)
        while len(times) < _MOST_TIMES and not fitting[-_MARGIN:].all():
            more = times[-1] / times[0] * times[1 : _MARGIN + 1]
            longer = shapes.tabulate(more)
            times, values, fitting = (
                np.append(times, more),
                np.vstack([values, longer[0]]),
                np.append(fitting, longer[1]),
            )
    if not fitting[-2:].all():
        raise DesignError(
            f"a transition of {times[-1]:.3g} s still needs {np.max(np.abs(values[-1])):.3g} times the "
            "voltage at rest; use a smaller gevrey_order or a smaller reduced_modes"
        )
    first = len(times) - int(np.argmin(fitting[::-1])) if not fitting.all() else 0
    return InputShapes(times=times[first:], values=values[first:])


def cancellation_ratio(flat: FlatParameterisation, transition: Transition, transition_time: float) -> float:
    """Largest sum of the terms' magnitudes over the largest sum along one transition (loss of digits)."""
    return _cancellation(transition_terms(flat, transition, np.linspace(0, 1, 201), transition_time))


def _cancellation(terms: Array) -> float:
    """The ratio for terms (k, m + 1) at k places."""
    return float(np.max(np.sum(np.abs(terms), axis=1)) / np.max(np.abs(np.sum(terms, axis=1))))
