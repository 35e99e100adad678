"""Transitions that use every input of its own, on the reduced model: their length does not grow with the beams.

The paper's scalar D_u moves all voltages alike, so that the shortest transition grows with the degree 2 r N_r. Here the
voltages of all pairs are free splines: 2 r N_r conditions bring the modes from rest to rest, what is left is used for
voltages that change as little as possible.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.flatness import leading_entries, require_independent
from flexbeams.controller.reduction import ReducedModel
from flexbeams.controller.spline_transitions import DEGREE, FREE, SPANS, SplineTransitions, spline_voltages
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError

GROWTH = 2 ** (1 / 3)  # of the tabulated transition times
LONGEST_PERIODS = 4.0  # of the slowest mode, and LONGEST_REQUEST times the requested time: the table reaches both
LONGEST_REQUEST = 2.0
MOST_SHORTER = 15  # entries of the table below the requested time
ORDERS = (1, 2, 3)  # of the differences that are kept small; one suits short transitions, another long ones
NEARBY = (1.0, 1.04, 0.96)  # factors of a time that may take its place
GOOD_OVERDRIVE = 1.02  # a time of which the voltages are no larger is not replaced
MAX_OVERDRIVE = 1.1  # largest voltage of a tabulated transition relative to that at rest
MAX_RESIDUAL = 1e-9  # of the state at rest, that a tabulated transition may miss


@dataclass(frozen=True, kw_only=True)
class RingingPlant:
    """The unreduced plant in modes y' = lambda y + beta u, deflections Re C y: what it does after a transition."""

    rates: Array  # (l,), complex, 1/s
    inputs: Array  # (l, n_u), complex
    outputs: Array  # (n_pi, l), complex, m
    gain: Array  # (n_pi, n_u): deflections at rest, m/V

    @classmethod
    def of(cls, A: Array, B: Array, outputs: Array) -> "RingingPlant":
        """The plant x' = A x + B u, deflections `outputs` x (n_pi, n)."""
        rates, vectors = np.linalg.eig(A)
        inputs = np.linalg.solve(vectors, B.astype(complex))
        modes = rates.imag >= 0
        weights = np.where(rates[modes].imag > 0, 2.0, 1.0)
        return cls(
            rates=rates[modes],
            inputs=inputs[modes],
            outputs=(outputs @ vectors[:, modes]) * weights,
            gain=-outputs @ np.linalg.solve(A, B),
        )

    def ripple(self, points: Array, time: float) -> float:
        """Largest vibration after a transition of `time` s at one pair, as a part of the largest deflection it makes.

        points (n_u, FREE, n_u). The amplitudes of all modes are added up: a bound of the deflection from then on.
        """
        span = self.rates * (time / SPANS)
        steps = np.exp(span)
        reached = steps[:, None] ** np.arange(FREE - 1, -1, -1)
        summed = np.sum((reached @ points) * self.inputs, axis=2)  # (n_u, l)
        missed = summed.T - self.inputs / (1 - steps)[:, None]
        response = time / SPANS * ((steps - 1) / span) ** (DEGREE + 1)  # to one control point, at the end of its spline
        vibration = np.abs(self.outputs) @ np.abs(response[:, None] * missed)
        largest = np.max(np.abs(self.gain), axis=0)
        moving = largest > 1e-3 * np.max(largest)
        return float(np.max(np.max(vibration, axis=0)[moving] / largest[moving]))


@dataclass(frozen=True, kw_only=True)
class TabulatedTransitions:
    """The transitions of a design and what they are worth."""

    transitions: SplineTransitions
    peaks: Array  # (k,): largest voltage of a change at one pair, relative to that at rest
    ripples: Array  # (k,): see RingingPlant.ripple

    def figures(self) -> dict[str, Any]:
        """For the summary, in JSON's types."""
        return {
            "transition_times": self.transitions.times.tolist(),
            "transition_peaks": self.peaks.tolist(),
            "transition_ripples": self.ripples.tolist(),
        }


def tabulate_spline_transitions(
    model: ReducedModel, plant: RingingPlant, transition_time: float
) -> TabulatedTransitions:
    """The transitions of a reduced model, of `transition_time` (s) and of times in about geometric progression with it.

    Where the voltages of one are too large, another one nearby takes its place. The table starts where a change at one
    pair takes no more than MAX_OVERDRIVE times its voltage at rest anywhere. Raises DesignError where eigenvectors are
    too dependent for modes, or where no transition fits.
    """
    values, vectors = np.linalg.eig(model.A)
    require_independent(vectors)
    inputs = np.linalg.solve(vectors, model.B.astype(complex))
    modes = np.flatnonzero(values.imag >= 0)
    modes = modes[np.lexsort((values[modes].imag, np.abs(values[modes])))]
    rates, inputs = values[modes], inputs[modes]
    lead = leading_entries(inputs)  # scaled by which modes are the same on every machine
    shapes, inputs = vectors[:, modes] * np.where(rates.imag > 0, 2.0, 1.0) * lead, inputs / lead[:, None]
    rows = _rows(rates, inputs, plant, transition_time)
    return TabulatedTransitions(
        transitions=SplineTransitions(
            times=np.array([row.time for row in rows]),
            points=np.array([row.points for row in rows]),
            eigenvalues=np.concatenate([rates.real, rates.imag]),
            mode_inputs=np.vstack([inputs.real, inputs.imag]),
            mode_states=np.hstack([shapes.real, -shapes.imag]),
        ),
        peaks=np.array([row.peak for row in rows]),
        ripples=np.array([row.ripple for row in rows]),
    )


@dataclass(frozen=True, kw_only=True)
class _Row:
    time: float
    points: Array
    residual: float
    peak: float
    ripple: float


def _rows(rates: Array, inputs: Array, plant: RingingPlant, requested: float) -> list[_Row]:
    """The table in ascending times."""
    longest = max(LONGEST_REQUEST * requested, LONGEST_PERIODS * 2 * np.pi / float(np.min(np.abs(rates))))
    last = int(np.ceil(np.log(longest / requested) / np.log(GROWTH)))
    rows: list[_Row] = []
    for step in range(last, -MOST_SHORTER - 1, -1):
        time = requested * GROWTH**step
        row = _best_row(rates, inputs, plant, time, good=MAX_OVERDRIVE if step == 0 else GOOD_OVERDRIVE)
        if row is not None:
            rows.append(row)
        elif step < 0:
            break
    if len(rows) < 2:
        raise DesignError(
            f'planner = "multi_input" finds no transition up to {longest:.3g} s; use a larger transition_time or a '
            "smaller reduced_modes"
        )
    return rows[::-1]


def _best_row(rates: Array, inputs: Array, plant: RingingPlant, time: float, good: float) -> _Row | None:
    """The transition of about `time` s, exactly so where its voltages are `good`; None where none fits.

    Where the control points follow one another as fast as a mode oscillates, or twice as fast, they act on it alike:
    such a time takes large voltages, one nearby does not. Of the orders the one of least ripple is taken.
    """
    best = None
    for factor in NEARBY:
        candidates = [_row(rates, inputs, plant, time * factor, order) for order in ORDERS]
        fitting = [row for row in candidates if row.residual <= MAX_RESIDUAL and row.peak <= MAX_OVERDRIVE]
        if fitting:
            row = min(fitting, key=lambda row: row.ripple)
            best = row if best is None or row.peak < best.peak else best
        if best is not None and best.peak <= good:
            break
    return best


def _row(rates: Array, inputs: Array, plant: RingingPlant, time: float, order: int) -> _Row:
    points, residual = least_change(rates, inputs, time, order)
    return _Row(time=time, points=points, residual=residual, peak=overdrive(points), ripple=plant.ripple(points, time))


def least_change(rates: Array, inputs: Array, time: float, order: int) -> tuple[Array, float]:
    """Free control points (n_u, FREE, n_u) of a transition of `time` s by 1 V at each pair, and the largest residual.

    A mode answers every control point alike, one span later: with z = e^(lambda h) the sums
    w_(i+1) = z w_i + beta c_i over control points c_i determine its motion, and it rests under c from the last free
    point on if w = beta c / (1 - z) there. Of all points that do so for all modes these have the least sum of squared
    differences of this order, over all pairs. The residual is relative to the state at rest.
    """
    n_u = inputs.shape[1]
    steps = np.exp(rates * (time / SPANS))
    reached = steps[:, None] ** np.arange(FREE - 1, -1, -1)
    conditions = reached[:, :, None] * inputs[:, None, :]  # (l, FREE, n_u)
    rest = inputs / (1 - steps)[:, None]
    sizes = np.linalg.norm(rest, axis=1)
    scale = np.where(sizes > 0, sizes, 1.0)
    pairs = rates.imag > 0
    conditions = _real_rows(conditions / scale[:, None, None], pairs)
    rest = _real_rows(rest / scale[:, None], pairs)
    # free = smooth + root q has the differences of the unconditional optimum and, orthogonal to them, q
    differences = np.diff(np.eye(FREE + 2 * order), order, axis=0)
    inner, end = differences[:, order:-order], np.sum(differences[:, -order:], axis=1)
    smooth = -np.linalg.lstsq(inner, end, rcond=None)[0]
    root = np.linalg.inv(np.linalg.cholesky(inner.T @ inner)).T
    whitened = (root.T @ conditions).reshape(len(conditions), -1)
    missing = rest - smooth @ conditions
    corrections = np.linalg.lstsq(whitened, missing, rcond=1e-14)[0].T.reshape(n_u, FREE, n_u)
    points = root @ corrections
    points[np.arange(n_u), :, np.arange(n_u)] += smooth
    residual = conditions.reshape(len(conditions), -1) @ points.reshape(n_u, -1).T - rest
    return points, float(np.max(np.abs(residual)))


def overdrive(points: Array) -> float:
    """Largest voltage of transitions by 1 V at each pair, anywhere; points (n_u, FREE, n_u)."""
    n_u, tau = len(points), np.linspace(0, 1, 8 * SPANS + 1)
    peaks = []
    for change, free in zip(np.eye(n_u), points, strict=True):
        whole = np.vstack([np.zeros((DEGREE, n_u)), free, np.tile(change, (DEGREE, 1))])
        peaks.append(float(np.max(np.abs(spline_voltages(whole, tau)))))
    return max(peaks)


def _real_rows(rows: Array, pairs: NDArray[np.bool_]) -> Array:
    """Complex rows as real ones: the real parts, then the imaginary parts of pairs."""
    return np.concatenate([rows.real, rows.imag[pairs]])
