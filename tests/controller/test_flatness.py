"""The flat output's parameterisation of input and state."""

from dataclasses import fields
from functools import cache

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.flatness import (
    MAX_OVERDRIVE,
    FlatParameterisation,
    cancellation_ratio,
    flat_parameterisation,
    input_shape,
    tabulate_input_shapes,
    transition_series,
)
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.planner import sample_grid
from flexbeams.controller.reduction import ReducedModel
from flexbeams.controller.transition import Transition, derivative_scales, transition_of_order
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.errors import DesignError
from flexbeams.plant.structure import Structure, find_structure, read_structure
from tests.oracles.examples import beam, five_beams, gauge, patch, point, single_beam, three_beams

KIEL = read_structure(find_structure("kiel"))
STRUCTURES = {"kiel": KIEL, "single": single_beam(), "three": three_beams(), "five": five_beams()}
TRANSITION = transition_of_order(1.9)


def model_of(A: Array, B: Array) -> ReducedModel:
    """A reduced model of which only A and B matter."""
    return ReducedModel(**{**{f.name: np.zeros(0) for f in fields(ReducedModel)}, "A": A, "B": B})  # type: ignore


@cache
def design(name: str, basis: BasisName = "clamped_free") -> Design:
    """The design of a structure with default options."""
    return compute_design(STRUCTURES[name], DesignOptions(basis=basis))


def parameterisation(made: Design) -> FlatParameterisation:
    """What the design carries."""
    return FlatParameterisation(input=made.arrays["input_series"], state=made.arrays["state_series"])


@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
@pytest.mark.parametrize("name", STRUCTURES)
def test_state_and_input_satisfy_the_differential_equation(name: str, basis: BasisName) -> None:
    """x' = A x + B u for every xi: X_{i-1} = A X_i + B c_i, i = 0 ... m, with X_{-1} = X_m = 0."""
    made = design(name, basis)
    A, B = made.arrays["A"], made.arrays["B"]
    flat = parameterisation(made)
    m, n_u = B.shape
    assert flat.degree == m
    assert flat.state.shape == (m, m, n_u)
    X = np.concatenate([np.zeros((m, 1, n_u)), flat.state, np.zeros((m, 1, n_u))], axis=1)
    for i in range(m + 1):
        terms = A @ X[:, i + 1], B * flat.input[i], X[:, i]
        size = max(np.linalg.norm(t) for t in terms)
        assert np.linalg.norm(terms[0] + terms[1] - terms[2]) < 1e-9 * size


@pytest.mark.parametrize("name", ["kiel", "five"])
def test_transfer_function(name: str) -> None:
    """sum X_i s^i = (s - A)^-1 B D_u(s) and D_u(s) = det(1 - s A^-1), at points off the spectrum."""
    made = design(name)
    A, B = made.arrays["A"], made.arrays["B"]
    flat = parameterisation(made)
    for s in (2.0, -7 + 30j, 150j, 900 - 400j, 3000.0):
        powers = s ** np.arange(len(A) + 1)
        D_u = powers @ flat.input
        assert D_u == pytest.approx(np.linalg.det(np.eye(len(A)) - s * np.linalg.inv(A)), rel=1e-9)
        expected = np.linalg.solve(s * np.eye(len(A)) - A, B * D_u)
        np.testing.assert_allclose(
            flat.state.transpose(0, 2, 1) @ powers[:-1], expected, rtol=0, atol=1e-9 * np.abs(expected).max()
        )


def test_coefficients_are_positive_and_start_at_rest() -> None:
    flat, arrays = parameterisation(design("kiel")), design("kiel").arrays
    assert flat.input[0] == 1.0
    assert np.all(flat.input > 0)
    np.testing.assert_allclose(
        flat.state[:, 0],
        -np.linalg.solve(arrays["A"], arrays["B"]),
        rtol=0,
        atol=1e-12 * np.abs(flat.state[:, 0]).max(),
    )


def flat_motion(
    flat: FlatParameterisation, time: Array, starts: list[float], durations: list[float], steps: Array
) -> tuple[Array, Array]:
    """u* (k, n_u) and x* (k, m) at time (k,) for superposed transitions, steps (l, n_u), from rest at zero."""
    xi = np.zeros((len(time), flat.degree + 1, steps.shape[1]))
    for start, duration, step in zip(starts, durations, steps, strict=True):
        series = transition_series(TRANSITION, flat.degree, np.clip((time - start) / duration, 0, 1))
        xi += (series * derivative_scales(flat.degree, duration))[:, :, None] * step
    return np.einsum("i,kij->kj", flat.input, xi), np.einsum("aij,kij->ka", flat.state, xi[:, :-1])


def follows(made: Design, starts: list[float], durations: list[float], steps: Array) -> float:
    """Largest |x - x*| over the largest |x*|, x from x' = A x + B u*, by Gauss quadrature with exponentials of A."""
    A, B, panel = made.arrays["A"], made.arrays["B"], 1e-3
    points, weights = np.polynomial.legendre.leggauss(10)
    places = panel * (points + 1) / 2
    count = round((max(s + d for s, d in zip(starts, durations, strict=True)) + 0.1) / panel)
    begins = panel * np.arange(count)
    flat = parameterisation(made)
    u, _ = flat_motion(flat, (begins[:, None] + places).ravel(), starts, durations, steps)
    _, wanted = flat_motion(flat, np.append(begins, panel * count), starts, durations, steps)
    onward = np.stack([expm(A * (panel - p)) @ B * w * panel / 2 for p, w in zip(places, weights, strict=True)])
    free = expm(A * panel)
    x, worst = wanted[0], 0.0
    for k, inputs in enumerate(u.reshape(count, len(places), -1)):
        x = free @ x + np.einsum("jab,jb->a", onward, inputs)
        worst = max(worst, float(np.max(np.abs(x - wanted[k + 1]) / np.max(np.abs(wanted), axis=0))))
    return worst


@pytest.mark.parametrize(("name", "duration"), [("kiel", 0.9), ("kiel", 0.5), ("five", 1.2), ("single", 0.4)])
@pytest.mark.slow
def test_the_reduced_model_driven_by_u_follows_x(name: str, duration: float) -> None:
    """1e-6 of each state's own maximum, for any target."""
    made = design(name)
    goal = np.random.default_rng(3).uniform(-900, 900, (1, made.arrays["B"].shape[1]))
    assert follows(made, [0.03], [duration], goal) < 1e-6


@pytest.mark.slow
def test_the_reduced_model_follows_superposed_transitions() -> None:
    steps = np.random.default_rng(4).uniform(-900, 900, (3, 4))
    assert follows(design("kiel"), [0.02, 0.3, 0.31], [0.9, 0.5, 0.75], steps) < 1e-6


def test_equal_beams_that_are_not_coupled() -> None:
    """Twofold eigenvalues with two eigenvectors each are no obstacle."""
    first = beam(1)
    twins = Structure(
        beam=[first, first],
        patch=[patch(1, 1, 0.02), patch(1, 2, 0.02)],
        point_of_interest=[point(1, 0.3), point(2, 0.3)],
        strain_gauge=[gauge(1, 0.06), gauge(2, 0.06)],
    )
    made = compute_design(twins, DesignOptions(reduced_modes=3))
    values = np.linalg.eigvals(made.arrays["A"])
    values = np.sort(values[values.imag > 0])
    np.testing.assert_allclose(values[::2], values[1::2], rtol=1e-9)
    assert follows(made, [0.0], [0.5], np.array([[400.0, -100.0]])) < 1e-6


def test_multiple_eigenvalues_without_eigenvectors_are_refused() -> None:
    oscillator = np.array([[-0.3, 20.0], [-20.0, -0.3]])
    chain = block_diag(oscillator, oscillator)
    chain[:2, 2:] = np.eye(2)
    with pytest.raises(DesignError, match=r"\(nearly\) multiple eigenvalues.*change reduced_modes or the structure"):
        flat_parameterisation(model_of(chain, np.ones((4, 1))))


def test_real_and_complex_eigenvalues_together() -> None:
    A = block_diag(np.array([[-3.0]]), np.array([[-1.0, 40.0], [-40.0, -1.0]]), np.array([[-0.5]]))
    flat = flat_parameterisation(model_of(A, np.arange(8.0).reshape(4, 2) + 1))
    pair = [1.0, 2 / 1601, 1 / 1601]
    np.testing.assert_allclose(flat.input, np.convolve(np.convolve([1, 1 / 3], [1, 2]), pair), rtol=1e-13)


def test_input_shape_starts_at_0_and_ends_at_1() -> None:
    flat = parameterisation(design("kiel"))
    series = transition_series(TRANSITION, flat.degree, np.array([0.0, 1.0]))
    np.testing.assert_array_equal(input_shape(flat, series, 0.7), [0.0, 1.0])


def test_table_of_input_shapes() -> None:
    """Curves at their places; it begins where a curve passes MAX_OVERDRIVE, as the next shorter one would."""
    flat = parameterisation(design("kiel"))
    slowest = float(np.min(np.abs(np.linalg.eigvals(design("kiel").arrays["A"]))))
    table = tabulate_input_shapes(flat, TRANSITION, slowest)
    tau = sample_grid(table.values.shape[1] - 1)
    series = transition_series(TRANSITION, flat.degree, tau)
    for index in (0, 10, -1):
        np.testing.assert_array_equal(table.values[index], input_shape(flat, series, float(table.times[index])))
    shorter = float(table.times[0] ** 2 / table.times[1])
    assert np.max(np.abs(table.values)) <= MAX_OVERDRIVE < np.max(np.abs(input_shape(flat, series, shorter)))
    assert table.times[-1] == pytest.approx(16 * 2 * np.pi / slowest)
    np.testing.assert_allclose(table.values[-1], series[:, 0], atol=5e-3)


def test_a_slow_system_is_tabulated_from_half_a_period() -> None:
    flat = flat_parameterisation(model_of(np.array([[-0.1, 2.0], [-2.0, -0.1]]), np.eye(2)))
    assert tabulate_input_shapes(flat, TRANSITION, 2.0).times[0] == pytest.approx(np.pi / 2)


def test_voltages_that_stay_too_large_at_any_duration_are_refused() -> None:
    flat = FlatParameterisation(input=np.array([1.0, 0.0, 0.0, 1e9]), state=np.zeros((3, 3, 1)))
    with pytest.raises(DesignError, match=r"a transition of 50.3 s still needs .* times the voltage at rest"):
        tabulate_input_shapes(flat, TRANSITION, 2.0)


@pytest.mark.parametrize("degree", [200, 400])
def test_a_degree_beyond_the_range_of_doubles_is_refused(degree: int) -> None:
    flat = FlatParameterisation(input=np.ones(degree + 1), state=np.zeros((degree, degree, 1)))
    with pytest.raises(DesignError, match=f"up to degree {degree} exceed the range of doubles; use a smaller"):
        tabulate_input_shapes(flat, TRANSITION, 20.0)


def test_cancellation_counts_lost_digits() -> None:
    """1 where all terms have one sign; the terms' magnitudes over their sum otherwise."""
    flat = parameterisation(design("kiel"))
    assert 1 <= cancellation_ratio(flat, TRANSITION, 0.9) < 1.5
    assert design("kiel").summary["flatness_cancellation"] == cancellation_ratio(flat, TRANSITION, 0.9)

    class Step(Transition):
        """Series 1, -2, 0 everywhere."""

        def series(self, tau: float, order: int) -> Array:
            return np.array([1.0, -2.0, 0.0][: order + 1])

    line = FlatParameterisation(input=np.array([1.0, 1.0]), state=np.zeros((1, 1, 1)))
    assert cancellation_ratio(line, Step(exponent=1.0, norm=1.0, table=np.zeros(1)), 1.0) == pytest.approx(3.0)
