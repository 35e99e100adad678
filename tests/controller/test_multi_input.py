"""Transitions of several inputs: rest to rest, smooth, short for any number of beams, quiet on the unreduced plant."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from flexbeams.controller.computation import reduced_with
from flexbeams.controller.design import Design
from flexbeams.controller.multi_input import RingingPlant, least_change, tabulate_spline_transitions
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.planner import PendingTransitions, plan_transition
from flexbeams.controller.reduction import ReducedModel
from flexbeams.controller.spline_transitions import (
    DEGREE,
    SPANS,
    SplineCourse,
    SplineTransitions,
    phi_functions,
    span_weights,
    spline_voltages,
)
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.statespace import state_matrices
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import computed_once
from tests.oracles.chains import chain_of_beams

OPTIONS = DesignOptions(planner="multi_input", verify="design")


@cache
def chain(beams: int) -> tuple[BeamModel, ReducedModel]:
    model = beam_model(chain_of_beams(beams), OPTIONS.basis, OPTIONS.basis_order)
    return model, reduced_with(model, model.assemble(), OPTIONS, OPTIONS.reduced_modes)


def ringing(model: BeamModel) -> tuple[Array, Array, Array]:
    A, B = state_matrices(model.assemble())
    return A, B, np.hstack([model.deflection, np.zeros_like(model.deflection)])


@cache
def kiel() -> Design:
    return computed_once(read_structure(find_structure("kiel")), DesignOptions(planner="multi_input"))


def tables() -> SplineTransitions:
    return SplineTransitions.of(kiel().arrays)


def end_of(A: Array, B: Array, course: Array, time: float, parts: int) -> Array:
    """State after a transition with voltages (k + 1, n_u) at the ends of `parts` equal steps, taken as linear there."""
    step = time / parts
    n, m = B.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m], block[n : n + m, n + m :] = A * step, B * step, np.eye(m)
    power = expm(block)
    x = np.zeros(n)
    for before, after in pairwise(course):
        x = power[:n] @ np.concatenate([x, before, after - before])
    return x


def test_phi_functions() -> None:
    """phi_k as entries of the exponential of a matrix: [[z, 1, 0, ...], [0, 0, 1, ...], ...]."""
    z = np.array([0.0, 1e-8j, 0.3 - 0.2j, -0.99999, -1.00001, -3 + 2j, -0.1 + 30j, -40.0])
    found = phi_functions(z)
    for k, value in enumerate(z):
        matrix = np.diag(np.ones(6, dtype=complex), 1)
        matrix[0, 0] = value
        np.testing.assert_allclose(found[:, k], expm(matrix)[0], rtol=1e-11, atol=1e-15)


def test_spline() -> None:
    """Weights sum to one, and are those of de Boor's recursion."""
    from scipy.interpolate import BSpline

    fractions = np.linspace(0, 1, 7)
    np.testing.assert_allclose(span_weights(fractions).sum(axis=1), 1, rtol=1e-14)
    points = np.random.default_rng(1).normal(size=(SPANS + DEGREE, 3))
    tau = np.linspace(0, 1, 200)
    spline = BSpline(np.arange(-DEGREE, SPANS + DEGREE + 1) / SPANS, points, DEGREE)
    np.testing.assert_allclose(spline_voltages(points, tau), spline(tau), rtol=1e-12, atol=1e-13)


@pytest.mark.parametrize("beams", [1, 3, 5, 10])
def test_short_for_any_number_of_beams(beams: int) -> None:
    """0.5 s and less at no more than 1.1 times the voltage at rest; ripple on the unreduced plant below 1e-3."""
    model, reduced = chain(beams)
    A, B, outputs = ringing(model)
    table = tabulate_spline_transitions(reduced, RingingPlant.of(A, B, outputs), 0.9)
    short = np.flatnonzero((table.transitions.times <= 0.5) & (table.ripples < 1e-3))
    assert len(short) > 0
    assert table.peaks[short].max() <= 1.1
    assert table.transitions.times[short[0]] < 0.3
    change = np.random.default_rng(beams).normal(size=B.shape[1])
    for time in table.transitions.times[[short[0], -1]]:
        course = SplineCourse(table.transitions, time, change)
        rest = -np.linalg.solve(reduced.A, reduced.B @ change)
        end = table.transitions.state(course.at(1.0)[1])
        assert np.abs(end - rest).max() < 1e-12 * np.abs(rest).max()


@pytest.mark.parametrize("row", [1, 5])
def test_independent_integration(row: int) -> None:
    """The course of the reduced model, and the bound of the ripple on the full one, by matrix exponentials."""
    design, change = kiel(), np.array([1.0, -0.4, 0.7, 0.2])
    time = float(tables().times[row])
    parts = 40 * SPANS
    tau = np.arange(parts + 1) / parts
    voltages = tables().voltages(time, change, tau)
    A, B = design.arrays["A"], design.arrays["B"]
    half = end_of(A, B, voltages[: parts // 2 + 1], time / 2, parts // 2)
    u, amplitudes = SplineCourse(tables(), time, change).at(0.5)
    np.testing.assert_allclose(u, voltages[parts // 2], rtol=1e-12)
    found = tables().state(amplitudes)
    assert np.abs(found - half).max() < 1e-5 * np.abs(half).max()  # linear pieces: second order
    A, B, outputs = ringing(design.model())
    plant = RingingPlant.of(A, B, outputs)
    for pair in range(4):
        course = tables().voltages(time, np.eye(4)[pair], tau)
        end = end_of(A, B, course, time, parts) + np.linalg.solve(A, B[:, pair])
        power, largest = expm(A * 1e-3), 0.0
        for _ in range(300):
            largest = max(largest, float(np.abs(outputs @ end).max()))
            end = power @ end
        assert largest <= 1.01 * plant.ripple(tables().points[row], time) * np.abs(plant.gain[:, pair]).max() + 1e-13


def test_the_ripple_at_the_requested_time_is_small() -> None:
    """For kiel at 0.9 s 3e-5 of the deflection; figures of the summary are those of the table."""
    s = kiel().summary
    k = s["transition_times"].index(0.9)
    assert s["transition_ripples"][k] < 1e-4
    assert s["transition_peaks"][k] < 1.001
    assert s["transition_times"] == tables().times.tolist()


def test_least_change_is_least() -> None:
    """Any other points that meet the conditions have larger differences: a step along their null space adds to them."""
    t = tables()
    time = float(t.times[4])
    points, residual = least_change(t.rates, t.inputs, time, 1)
    assert residual < 1e-13
    steps = np.exp(t.rates * time / SPANS)
    count = points.shape[1]
    conditions = (steps[:, None] ** np.arange(count - 1, -1, -1))[:, :, None] * t.inputs[:, None, :]
    rows = np.vstack([conditions.reshape(len(steps), -1).real, conditions.reshape(len(steps), -1).imag])
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    random = np.random.default_rng(4).normal(size=count * 4)
    along = random - np.linalg.pinv(rows, rcond=1e-12) @ (rows @ random)

    def differences(free: Array) -> Array:
        whole = np.vstack([np.zeros(4), free, np.eye(4)[1]])
        return np.diff(whole, axis=0).ravel()

    here, step = differences(points[1]), differences(points[1] + along.reshape(count, 4)) - differences(points[1])
    assert abs(here @ step) < 1e-9 * np.linalg.norm(here) * np.linalg.norm(step)


def test_stretching_within_the_limit() -> None:
    """To and fro at the limit: the plan is the first tabulated time that keeps it, to 0.1 %."""
    goal = kiel().arrays["static_inverse"] @ np.array([-8e-3, 1e-3, 4e-3, -6e-3]) * 1.2
    first = PendingTransitions(
        offset=np.zeros(4), starts=np.array([0.0]), durations=np.array([0.9]), changes=goal[None]
    )
    limit = float(np.abs(goal).max())
    plan = plan_transition(first, tables(), now=0.3, change=-2 * goal, requested=0.3, limit=limit)
    assert plan.duration > 0.3
    time = 0.3 + np.linspace(0, 2.5, 5001)
    peaks = [
        np.abs(first.with_transition(0.3, duration, -2 * goal).voltage(tables(), time)).max()
        for duration in tables().times
    ]
    k = tables().times.tolist().index(plan.duration)
    assert peaks[k] <= 1.0011 * limit
    assert peaks[k - 1] > limit
    assert plan.peak == pytest.approx(peaks[k], rel=1e-3)


def test_the_table_reaches_long_enough_and_starts_where_voltages_fit() -> None:
    """From a request that no voltages allow: the table starts above it, and ends past four periods."""
    model, reduced = chain(3)
    times = tabulate_spline_transitions(reduced, RingingPlant.of(*ringing(model)), 1e-3).transitions.times
    assert times[0] > 0.1
    assert times[-1] >= 4 * 2 * np.pi / np.min(np.abs(np.linalg.eigvals(reduced.A)))
