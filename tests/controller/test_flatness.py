"""The flat output's parameterisation of input and state."""

import os
from dataclasses import fields
from functools import cache

import numpy as np
import pytest
from scipy.linalg import block_diag, expm

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.flat_output import FlatParameterisation
from flexbeams.controller.flatness import (
    MAX_CANCELLATION,
    MAX_OVERDRIVE,
    cancellation_ratio,
    flat_parameterisation,
    tabulate_input_shapes,
)
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.planner import sample_grid
from flexbeams.controller.reduction import ReducedModel, reduce
from flexbeams.controller.transition import Transition, TransitionSeries, transition_of_order
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.structure import Structure, find_structure, read_structure
from tests.oracles.chains import chain_of_beams
from tests.oracles.examples import beam, five_beams, gauge, patch, point, single_beam, three_beams
from tests.oracles.flat_series import flat_series

KIEL = read_structure(find_structure("kiel"))
STRUCTURES = {"kiel": KIEL, "single": single_beam(), "three": three_beams(), "five": five_beams()}
TRANSITION = transition_of_order(1.9)
CHAINS = [int(count) for count in os.environ.get("FLEXBEAMS_BEAMS", "1,5").split(",")]


def model_of(A: Array, B: Array) -> ReducedModel:
    """A reduced model of which only A and B matter."""
    return ReducedModel(**{**{f.name: np.zeros(0) for f in fields(ReducedModel)}, "A": A, "B": B})  # type: ignore


@cache
def design(name: str, basis: BasisName = "clamped_free") -> Design:
    """The design of a structure with default options."""
    return compute_design(STRUCTURES[name], DesignOptions(basis=basis))


def parameterisation(made: Design) -> FlatParameterisation:
    """What the design carries."""
    return FlatParameterisation.of(made.arrays)


@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
@pytest.mark.parametrize("name", STRUCTURES)
def test_coefficients_are_those_of_the_polynomials(name: str, basis: BasisName) -> None:
    """c_i by their ratios, all positive, and X_i by the modes' amplitudes, of products in doubles.

    X satisfies x' = A x + B u for every xi: X_{i-1} = A X_i + B c_i, i = 0 ... m, with X_{-1} = X_m = 0.
    """
    made = design(name, basis)
    A, B = made.arrays["A"], made.arrays["B"]
    flat = parameterisation(made)
    m, n_u = B.shape
    assert flat.degree == m
    c, X = coefficients(flat)
    assert np.all(c > 0)
    expected_c, expected_X = flat_series(A, B)
    np.testing.assert_allclose(c, expected_c, rtol=1e-12)
    size = np.abs(expected_X).max(axis=(0, 2), keepdims=True)
    assert np.max(np.abs(X - expected_X) / size) < 1e-9
    X = np.concatenate([np.zeros((m, 1, n_u)), X, np.zeros((m, 1, n_u))], axis=1)
    for i in range(m + 1):
        terms = A @ X[:, i + 1], B * c[i], X[:, i]
        largest = max(np.linalg.norm(t) for t in terms)
        assert np.linalg.norm(terms[0] + terms[1] - terms[2]) < 1e-9 * largest


def coefficients(flat: FlatParameterisation) -> tuple[Array, Array]:
    """c (m + 1,) and X (m, m, n_u) of a parameterisation of low degree."""
    m, n_u = flat.degree, flat.mode_inputs.shape[1]
    c = np.cumprod(np.concatenate([[1.0], flat.ratios / np.arange(1, m + 1)]))
    X = np.array([[flat.state(flat.amplitudes(c[i] * np.eye(m + 1)[i], u)) for u in np.eye(n_u)] for i in range(m)])
    return c, X.transpose(2, 0, 1)


@pytest.mark.parametrize("name", ["kiel", "five"])
def test_transfer_function(name: str) -> None:
    """sum X_i s^i = (s - A)^-1 B D_u(s) and D_u(s) = det(1 - s A^-1), at points off the spectrum."""
    made = design(name)
    A, B = made.arrays["A"], made.arrays["B"]
    c, X = coefficients(parameterisation(made))
    for s in (2.0, -7 + 30j, 150j, 900 - 400j, 3000.0):
        powers = s ** np.arange(len(A) + 1)
        D_u = powers @ c
        assert D_u == pytest.approx(np.linalg.det(np.eye(len(A)) - s * np.linalg.inv(A)), rel=1e-9)
        expected = np.linalg.solve(s * np.eye(len(A)) - A, B * D_u)
        np.testing.assert_allclose(
            X.transpose(0, 2, 1) @ powers[:-1], expected, rtol=0, atol=1e-9 * np.abs(expected).max()
        )


def test_at_rest_the_state_is_that_of_the_voltages() -> None:
    flat, arrays = parameterisation(design("kiel")), design("kiel").arrays
    rest = np.eye(flat.degree + 1)[0]
    found = np.array([flat.state(flat.amplitudes(rest, u)) for u in np.eye(4)]).T
    expected = -np.linalg.solve(arrays["A"], arrays["B"])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def flat_motion(
    flat: FlatParameterisation, time: Array, starts: list[float], durations: list[float], steps: Array
) -> tuple[Array, Array]:
    """u* (k, n_u) and x* (k, m) at time (k,) for superposed transitions, steps (l, n_u), from rest at zero."""
    u, x = np.zeros((len(time), steps.shape[1])), np.zeros((len(time), len(flat.mode_states)))
    for start, duration, step in zip(starts, durations, steps, strict=True):
        for k, t in enumerate(np.clip((time - start) / duration, 0, 1).tolist()):
            terms = flat.terms(TRANSITION, t, duration)
            u[k] += np.sum(terms) * step
            x[k] += flat.state(flat.amplitudes(terms, step))
    return u, x


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
    np.testing.assert_allclose(coefficients(flat)[0], np.convolve(np.convolve([1, 1 / 3], [1, 2]), pair), rtol=1e-13)


def shape(flat: FlatParameterisation, tau: Array, duration: float) -> Array:
    """D_u(d/dt) Theta of one transition."""
    return np.array([np.sum(flat.terms(TRANSITION, t, duration)) for t in tau.tolist()])


def test_input_shape_starts_at_0_and_ends_at_1() -> None:
    np.testing.assert_array_equal(shape(parameterisation(design("kiel")), np.array([0.0, 1.0]), 0.7), [0.0, 1.0])


def test_table_of_input_shapes() -> None:
    """Curves at their places; it begins where a curve passes MAX_OVERDRIVE, as the next shorter one would."""
    flat = parameterisation(design("kiel"))
    slowest = float(np.min(np.abs(np.linalg.eigvals(design("kiel").arrays["A"]))))
    table = tabulate_input_shapes(flat, TRANSITION, slowest)
    tau = sample_grid(table.values.shape[1] - 1)
    for index in (0, 10, -1):
        np.testing.assert_allclose(table.values[index], shape(flat, tau, float(table.times[index])), rtol=0, atol=1e-13)
    shorter = float(table.times[0] ** 2 / table.times[1])
    assert np.max(np.abs(table.values)) <= MAX_OVERDRIVE < np.max(np.abs(shape(flat, tau, shorter)))
    assert table.times[-1] == pytest.approx(16 * 2 * np.pi / slowest)
    theta = [TRANSITION.series(t, 1).coefficients[0] for t in tau.tolist()]
    np.testing.assert_allclose(table.values[-1], theta, atol=5e-3)


def test_a_slow_system_is_tabulated_from_half_a_period() -> None:
    flat = flat_parameterisation(model_of(np.array([[-0.1, 2.0], [-2.0, -0.1]]), np.eye(2)))
    assert tabulate_input_shapes(flat, TRANSITION, 2.0).times[0] == pytest.approx(np.pi / 2)


def test_voltages_that_stay_too_large_at_any_duration_are_refused() -> None:
    flat = flat_of_ratios(np.array([1e9, 1e-9, 1e9]))
    with pytest.raises(DesignError, match=r"a transition of .* s still needs .* use a smaller gevrey_order or"):
        tabulate_input_shapes(flat, TRANSITION, 2.0)


def flat_of_ratios(ratios: Array) -> FlatParameterisation:
    """A parameterisation of which only the input matters."""
    empty = np.zeros((0, 0))
    return FlatParameterisation(ratios=ratios, mode_series=empty, mode_inputs=empty, mode_states=empty)


@pytest.mark.parametrize("beams", [13, 20])
@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
def test_many_beams_with_default_options(beams: int, basis: BasisName) -> None:
    """Finite voltages within MAX_OVERDRIVE, terms that cancel within bounds, and rest at both ends: degree 10 r."""
    structure = chain_of_beams(beams)
    reduced = reduced_model(structure, basis)
    flat = flat_parameterisation(reduced)
    assert flat.degree == 10 * beams
    assert all(np.all(np.isfinite(a)) for a in (flat.ratios, flat.mode_series, flat.mode_inputs, flat.mode_states))
    assert np.all(flat.ratios > 0)
    table = tabulate_input_shapes(flat, TRANSITION, float(np.min(np.abs(np.linalg.eigvals(reduced.A)))))
    assert np.max(np.abs(table.values)) <= MAX_OVERDRIVE
    np.testing.assert_array_equal(table.values[:, [0, -1]], [[0.0, 1.0]] * len(table.times))
    assert cancellation_ratio(flat, TRANSITION, float(table.times[0])) <= MAX_CANCELLATION * 1.01
    rest = np.eye(flat.degree + 1)[0]
    voltages = np.cos(np.arange(reduced.B.shape[1]))
    expected = -np.linalg.solve(reduced.A, reduced.B @ voltages)
    found = flat.state(flat.amplitudes(rest, voltages))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    # its own derivative by the same series: x' = A x + B u, half way through the shortest transition
    duration, gap = float(table.times[0]), 1e-5
    before, here, after = (flat.terms(TRANSITION, 0.37 + k * gap, duration) for k in (-1, 0, 1))
    rate = (flat.state(flat.amplitudes(after - before, voltages))) / (2 * gap * duration)
    wanted = reduced.A @ flat.state(flat.amplitudes(here, voltages)) + reduced.B @ voltages * np.sum(here)
    assert np.max(np.abs(rate - wanted)) < 1e-4 * np.max(np.abs(reduced.A @ expected))


@pytest.mark.parametrize("beams", CHAINS)
@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
def test_the_feedforward_is_exact_on_the_reduced_model_of_a_chain(beams: int, basis: BasisName) -> None:
    """Deflections to 1e-9 of the target at ten places on the way and at its end, in the shortest default transition.

    The model's modes are integrated by Gauss quadrature over panels of 5 ms. FLEXBEAMS_BEAMS=1,3,5,10,12,13,20,40
    takes all chains: with --timeout=0, some minutes.
    """
    reduced = reduced_model(chain_of_beams(beams), basis)
    flat = flat_parameterisation(reduced)
    table = tabulate_input_shapes(flat, TRANSITION, float(np.min(np.abs(np.linalg.eigvals(reduced.A)))))
    duration = max(DesignOptions().transition_time, float(table.times[0]))
    voltages = 300 * np.cos(np.arange(reduced.B.shape[1]))
    poles, vectors = np.linalg.eig(reduced.A)
    inputs = np.linalg.solve(vectors, (reduced.B @ voltages).astype(complex))
    count = 10 * int(np.ceil(duration / 0.05))
    panel = duration / count
    points, weights = np.polynomial.legendre.leggauss(24)
    places = panel * (points + 1) / 2
    onward = np.exp(np.outer(poles, panel - places)) * weights * panel / 2
    modes, worst = np.zeros(len(poles), dtype=complex), 0.0
    target = (reduced.static_gain()[0] + reduced.D_pi) @ voltages
    for k in range(1, count + 1):
        taus = (panel * (k - 1) + places) / duration
        shape = np.array([np.sum(flat.terms(TRANSITION, float(tau), duration)) for tau in taus])
        modes = np.exp(poles * panel) * modes + inputs * (onward @ shape)
        if k % (count // 10) == 0:
            terms = flat.terms(TRANSITION, k / count, duration)
            y = reduced.H_pi @ (vectors @ modes).real
            wanted = reduced.H_pi @ flat.state(flat.amplitudes(terms, voltages))
            worst = max(worst, float(np.max(np.abs(y - wanted))))
    print(f"{beams} beams, {basis}: {worst / np.max(np.abs(target)):.1e} of the target in {duration:.2f} s")
    assert worst < 1e-9 * np.max(np.abs(target))
    np.testing.assert_allclose(y + reduced.D_pi @ voltages, target, rtol=0, atol=1e-9 * np.max(np.abs(target)))


def reduced_model(structure: Structure, basis: BasisName) -> ReducedModel:
    """With default options."""
    options = DesignOptions(basis=basis)
    model = beam_model(structure, basis, options.basis_order)
    return reduce(
        model,
        model.assemble(),
        position_states=options.reduced_modes * len(structure.beam),
        output_weight=options.balanced_norm,
    )


def test_cancellation_counts_lost_digits() -> None:
    """1 where all terms have one sign; the terms' magnitudes over their sum otherwise."""
    flat = parameterisation(design("kiel"))
    assert 1 <= cancellation_ratio(flat, TRANSITION, 0.9) < 1.5
    assert design("kiel").summary["flatness_cancellation"] == cancellation_ratio(flat, TRANSITION, 0.9)

    class Step(Transition):
        """Series 1, -2, 0 everywhere."""

        def series(self, tau: float, order: int) -> TransitionSeries:
            return TransitionSeries(coefficients=np.array([1.0, -2.0, 0.0][: order + 1]), unit=1.0)

    line = flat_of_ratios(np.array([1.0]))
    assert cancellation_ratio(line, Step(exponent=1.0, norm=1.0, table=np.zeros(1)), 1.0) == pytest.approx(3.0)


def test_cancellation_is_reported_where_transitions_can_be_planned() -> None:
    """Not at the time asked for where that is shorter than any."""
    made = compute_design(five_beams(), DesignOptions(transition_time=0.3))
    shortest = float(made.arrays["shape_times"][0])
    assert shortest > 0.3
    assert made.summary["flatness_cancellation"] == cancellation_ratio(parameterisation(made), TRANSITION, shortest)
