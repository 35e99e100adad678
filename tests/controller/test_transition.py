"""Theta and its derivatives by power series."""

import numpy as np
import pytest

from flexbeams.controller.transition import LOWEST_ORDER, NODES, Transition, transition_of_order
from flexbeams.plant.basis import Array
from tests.oracles.gevrey import taylor_coefficients, taylor_coefficients_at

DEGREE = 30
ORDERS = [1.9, 1 + 1 / 1.9, 1.3, 1.99]  # (37) read in two ways, and near both bounds


def taylor(transition: Transition, tau: float, degree: int) -> Array:
    """Theta^(i)(tau) / i!, i = 0 ... degree."""
    series = transition.series(tau, degree)
    return series.coefficients / series.unit ** np.arange(degree + 1)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.slow
def test_derivatives_against_50_digits(order: float) -> None:
    """1e-9 of the derivative's maximum everywhere; 1e-9 of the value itself away from its zeros and ends."""
    tau = np.concatenate([[0.01, 0.0201, 0.05], np.linspace(0.1, 0.9, 9), [0.97, 0.99]])
    exact = np.stack([taylor_coefficients(order, float(t), DEGREE + 1) for t in tau])
    transition = transition_of_order(order)
    error = np.abs(np.stack([taylor(transition, float(t), DEGREE) for t in tau]) - exact[:, :-1])
    assert np.all(error <= 1e-9 * np.abs(exact[:, :-1]).max(axis=0))
    here, neighbours = np.abs(exact[:, 1:-1]), np.sqrt(np.abs(exact[:, :-2])) * np.sqrt(np.abs(exact[:, 2:]))
    away = (here > 1e-3 * neighbours) & (here > 1e-100 * here.max(axis=0))
    assert away.mean() > 0.3
    assert np.all(error[:, 1:][away] <= 1e-9 * here[away])


@pytest.mark.parametrize("order", [1.9, LOWEST_ORDER])
def test_all_along_the_transition(order: float) -> None:
    tau = np.linspace(0, 1, 1501)
    transition = transition_of_order(order)
    found = np.stack([taylor(transition, float(t), DEGREE) for t in tau])
    expected = taylor_coefficients_at(order, tau, DEGREE)
    assert np.all(np.abs(found - expected) <= 1e-11 * np.abs(expected).max(axis=0))


@pytest.mark.parametrize("order", ORDERS)
def test_symmetry(order: float) -> None:
    """Theta(tau) + Theta(1 - tau) = 1, so that derivatives of odd order agree and those of even order are opposite."""
    transition = transition_of_order(order)
    signs = -((-1.0) ** np.arange(DEGREE + 1))
    for tau in (0.03, 0.125, 0.31, 0.4999):
        left, right = taylor(transition, tau, DEGREE), taylor(transition, 1 - tau, DEGREE) * signs
        assert left[0] - right[0] == pytest.approx(1, abs=1e-15)
        np.testing.assert_allclose(left[1:], right[1:], rtol=0, atol=1e-11 * np.abs(left[1:]).max())


def test_ends_are_flat() -> None:
    transition = transition_of_order(1.9)
    for edge in (0.0, 5e-324, 1e-300, 1e-12, 1e-4):
        np.testing.assert_array_equal(taylor(transition, edge, DEGREE), np.zeros(DEGREE + 1))
    for edge in (1.0, 1 - 1e-12, 1 - 1e-4):
        np.testing.assert_array_equal(taylor(transition, edge, DEGREE), np.eye(DEGREE + 1)[0])


@pytest.mark.parametrize("order", ORDERS)
def test_rises_without_a_jump_where_nodes_or_ends_meet(order: float) -> None:
    """Within a rounding error or two across a node's domain, and where the negligible part begins."""
    transition = transition_of_order(order)
    edge = (4**transition.exponent + 600) ** (-1 / transition.exponent)
    meeting = [(i + 0.5) / NODES for i in range(NODES)]
    start = (1 - np.sqrt(1 - 4 * edge)) / 2
    for place in [*meeting, start, 1 - start]:
        below, above = (taylor(transition, place + gap, DEGREE) for gap in (-1e-15, 1e-15))
        assert abs(above[0] - below[0]) <= 3e-15 * below[1] + 1e-15
    values = np.array([taylor(transition, float(t), 1)[0] for t in np.linspace(0, 1, 5001)])
    assert np.all(np.diff(values) >= -1e-16)


@pytest.mark.parametrize("order", [1, 2, 5])
def test_few_derivatives_cost_no_accuracy(order: int) -> None:
    """1e-13 of each derivative's largest value."""
    transition, places = transition_of_order(1.3), np.linspace(0.05, 0.95, 301).tolist()
    few = np.array([taylor(transition, tau, order) for tau in places])
    many = np.array([taylor(transition, tau, 30)[: order + 1] for tau in places])
    assert np.all(np.abs(few - many) <= 1e-13 * np.abs(many).max(axis=0))


@pytest.mark.parametrize("order", [1.9, 1.5, LOWEST_ORDER])
@pytest.mark.parametrize("degree", [130, 400])
def test_high_degrees_stay_in_range(order: float, degree: int) -> None:
    """Along the whole transition, and equal to those of fewer terms: in units in which both are given."""
    transition = transition_of_order(order)
    for tau in np.linspace(1e-3, 0.5, 101):
        found, few = transition.series(float(tau), degree), transition.series(float(tau), DEGREE)
        assert np.all(np.isfinite(found.coefficients))
        assert 0 < few.unit <= found.unit <= 1
        scaled = found.coefficients[: DEGREE + 1] * (few.unit / found.unit) ** np.arange(DEGREE + 1)
        np.testing.assert_allclose(
            scaled, few.coefficients, rtol=0, atol=1e-12 * np.abs(few.coefficients[1:]).max() + 1e-15
        )


@pytest.mark.parametrize("order", [1.0, 0.5, 1.19, 2.0, 2.5, np.inf, np.nan, -1.0])
def test_orders_refused(order: float) -> None:
    with pytest.raises(ValueError, match=r"gevrey_order must be >= 1.2 and < 2, got"):
        transition_of_order(order)
