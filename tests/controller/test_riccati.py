"""Riccati equation, Kalman filter and regulator against python-control, and what is refused."""

from functools import cache

import control
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.kalman import hankel_weights, predictor_gain, steady_kalman_gain
from flexbeams.controller.lqr import lqr_gain
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.riccati import require_stable, residual, solve_riccati
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError
from flexbeams.plant.structure import find_structure, read_structure
from tests.oracles.examples import five_beams, single_beam

STRUCTURES = {"kiel": read_structure(find_structure("kiel")), "single": single_beam(), "five": five_beams()}


@cache
def design(name: str) -> Design:
    """The design of a structure with default options."""
    return compute_design(STRUCTURES[name], DesignOptions())


def weights(made: Design) -> tuple[Array, Array, Array, Array]:
    """Q_o, R_o, Q_c, R_c of (46), (47), written out."""
    kept, w = len(made.arrays["A"]) // 2, made.options.weights
    zeta_p, zeta_v = (np.array(made.summary[f"hankel_{kind}"][:kept]) for kind in ("position", "velocity"))
    q_o = w.kalman_q_total * np.append(
        w.kalman_q_position / zeta_p.sum() * zeta_p, w.kalman_q_velocity / zeta_v.sum() * zeta_v
    )
    q_c = w.lqr_q_total * np.append(w.lqr_q_position / zeta_p.sum() * zeta_p, w.lqr_q_velocity / zeta_v.sum() * zeta_v)
    n_u, n_pm = made.arrays["B"].shape[1], len(made.arrays["H_pm"])
    return np.diag(q_o), w.kalman_measurement * np.eye(n_pm), np.diag(q_c), w.lqr_input * np.eye(n_u)


def plant(seed: int, n: int = 7, m: int = 2, p: int = 3) -> tuple[Array, Array, Array]:
    """A random discrete-time system, some of whose eigenvalues are outside the unit circle."""
    generator = np.random.default_rng(seed)
    A = generator.normal(size=(n, n))
    return A * 1.3 / np.max(np.abs(np.linalg.eigvals(A))), generator.normal(size=(n, m)), generator.normal(size=(p, n))


def positive(seed: int, size: int) -> Array:
    """A random positive definite matrix."""
    root = np.random.default_rng(seed).normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def schur_solution(A: Array, B: Array, Q: Array, R: Array) -> Array:
    """S by scipy's Schur method, which the solver needs in a few cases only, and two Newton steps on the equation."""
    S = solve_discrete_are(A, B, Q, R)
    for _ in range(2):
        K = np.linalg.solve(R + B.T @ S @ B, B.T @ S @ A)
        S = solve_discrete_lyapunov((A - B @ K).T, Q + K.T @ R @ K)
    return np.asarray(S, dtype=np.float64)


@pytest.mark.parametrize("name", STRUCTURES)
def test_gains_of_a_design_against_python_control(name: str) -> None:
    """Entry by entry; dlqe returns the predictor's gain A L, so it is compared with that.

    Not by slycot, which python-control prefers where it is installed: it is off by up to 7e-5 here.
    """
    made = design(name)
    A, B, H = (made.arrays[k] for k in ("A_d", "B_d", "H_pm"))
    Q_o, R_o, Q_c, R_c = weights(made)
    K, _, _ = control.dlqr(A, B, Q_c, R_c, method="scipy")
    np.testing.assert_allclose(made.arrays["feedback_gain"], K, rtol=0, atol=1e-8 * np.abs(K).max())
    L, P, _ = control.dlqe(A, np.eye(len(A)), H, Q_o, R_o, method="scipy")
    np.testing.assert_allclose(made.arrays["estimator_gain"], L, rtol=0, atol=1e-8 * np.abs(L).max())
    current = P @ H.T @ np.linalg.inv(H @ P @ H.T + R_o)
    np.testing.assert_allclose(steady_kalman_gain(A, H, Q_o, R_o), current, rtol=0, atol=1e-8 * np.abs(current).max())


@pytest.mark.parametrize("name", STRUCTURES)
def test_solutions_of_a_design_against_the_schur_method(name: str) -> None:
    made = design(name)
    Q_o, R_o, Q_c, R_c = weights(made)
    A, B, H = (made.arrays[k] for k in ("A_d", "B_d", "H_pm"))
    for parts in ((A, B, Q_c, R_c), (A.T, H.T, Q_o, R_o)):
        expected = schur_solution(*parts)
        np.testing.assert_allclose(solve_riccati(*parts, ""), expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("name", STRUCTURES)
def test_residual_of_a_design(name: str) -> None:
    """1e-9 in the symmetric (Joseph) form of the equation, which is written apart from the solver's."""
    made = design(name)
    Q_o, R_o, Q_c, R_c = weights(made)
    A, B, H = (made.arrays[k] for k in ("A_d", "B_d", "H_pm"))
    for A_, B_, Q, R in ((A, B, Q_c, R_c), (A.T, H.T, Q_o, R_o)):
        S = solve_riccati(A_, B_, Q, R, "")
        K = np.linalg.inv(R + B_.T @ S @ B_) @ B_.T @ S @ A_
        joseph = (A_ - B_ @ K).T @ S @ (A_ - B_ @ K) + K.T @ R @ K + Q
        assert np.linalg.norm(joseph - S) < 1e-9 * np.linalg.norm(S)
        assert np.min(np.linalg.eigvalsh(S)) > -1e-9 * np.linalg.norm(S)


@pytest.mark.parametrize("seed", range(5))
def test_random_systems(seed: int) -> None:
    """Unstable ones, weights that are not diagonal, n != m != p."""
    A, B, C = plant(seed)
    Q, R_c, R_o = positive(seed, 7), positive(seed + 10, 2), positive(seed + 20, 3)
    K, S, _ = control.dlqr(A, B, Q, R_c)
    np.testing.assert_allclose(solve_riccati(A, B, Q, R_c, ""), S, rtol=1e-8, atol=1e-8 * np.abs(S).max())
    np.testing.assert_allclose(lqr_gain(A, B, Q, R_c), K, rtol=0, atol=1e-8 * np.abs(K).max())
    L, _, _ = control.dlqe(A, np.eye(7), C, Q, R_o)
    np.testing.assert_allclose(predictor_gain(A, C, Q, R_o), L, rtol=0, atol=1e-8 * np.abs(L).max())
    np.testing.assert_allclose(A @ steady_kalman_gain(A, C, Q, R_o), L, rtol=0, atol=1e-8 * np.abs(L).max())
    assert np.max(np.abs(np.linalg.eigvals(A - B @ lqr_gain(A, B, Q, R_c)))) < 1
    assert residual(A, B, Q, R_c, S) < 1e-9


def test_scalar_equation_in_closed_form() -> None:
    """S = a^2 S - a^2 S^2/(1 + S) + q: the positive root of S^2 + (1 - a^2 - q) S - q."""
    a, q = 1.4, 0.3
    exact = (q + a**2 - 1 + np.sqrt((q + a**2 - 1) ** 2 + 4 * q)) / 2
    one = np.eye(1)
    assert solve_riccati(a * one, one, q * one, one, "")[0, 0] == pytest.approx(exact, rel=1e-13)


@pytest.mark.parametrize(("volts", "strains"), [(1e3, 1e-6), (1e-6, 1e6), (1e5, 1e-9)])
def test_units_of_inputs_and_outputs_do_not_matter(volts: float, strains: float) -> None:
    A, B, C = plant(3)
    Q, R_c, R_o = positive(1, 7), positive(2, 2), positive(3, 3)
    gain = lqr_gain(A, B / volts, Q, R_c / volts**2)
    np.testing.assert_allclose(gain / volts, lqr_gain(A, B, Q, R_c), rtol=1e-9)
    gain = predictor_gain(A, C * strains, Q, R_o * strains**2)
    np.testing.assert_allclose(gain * strains, predictor_gain(A, C, Q, R_o), rtol=1e-9)


@pytest.mark.parametrize("spread", [1e3, 1e6])
def test_units_of_states_do_not_matter(spread: float) -> None:
    """Some states in units a thousand or a million times as large as others."""
    A, B, _ = plant(4)
    Q, R = positive(1, 7), positive(2, 2)
    scale = spread ** np.linspace(-0.5, 0.5, 7)
    gain = lqr_gain(A * scale[:, None] / scale, B * scale[:, None], Q / np.outer(scale, scale), R)
    expected = lqr_gain(A, B, Q, R)
    np.testing.assert_allclose(gain * scale, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def test_process_noise() -> None:
    """(46): each kind of state shares its weight in proportion to its singular values."""
    q = hankel_weights(np.array([3.0, 1.0]), np.array([1.0, 1.0]), total=50.0, position=5e3, velocity=10.0)
    np.testing.assert_allclose(q, [50 * 3750, 50 * 1250, 250, 250], rtol=1e-15)


def hidden(eigenvalue: float) -> tuple[Array, Array]:
    """A with one more eigenvalue, and an input matrix that does not reach it."""
    A, B, _ = plant(6, n=4)
    A = np.block([[A, np.zeros((4, 1))], [np.zeros((1, 4)), np.full((1, 1), eigenvalue)]])
    return A, np.vstack([B, np.zeros((1, 2))])


@pytest.mark.parametrize("eigenvalue", [1.05, 1.0, 2.0, -1.0])
def test_what_cannot_be_stabilised_or_detected_is_refused(eigenvalue: float) -> None:
    A, B = hidden(eigenvalue)
    with pytest.raises(DesignError, match="LQR"):
        lqr_gain(A, B, np.eye(5), np.eye(2))
    with pytest.raises(DesignError, match="Kalman filter"):
        steady_kalman_gain(A.T, B.T, np.eye(5), np.eye(2))
    with pytest.raises(DesignError, match="Kalman filter"):
        predictor_gain(A.T, B.T, np.eye(5), np.eye(2))


def test_hidden_states_that_decay_are_accepted() -> None:
    A, B = hidden(0.97)
    assert np.max(np.abs(np.linalg.eigvals(A - B @ lqr_gain(A, B, np.eye(5), np.eye(2))))) == pytest.approx(0.97)


def test_an_oscillator_without_damping_or_weight_is_refused() -> None:
    """On the unit circle and not in the cost: no gain moves it inside."""
    turn = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    with pytest.raises(DesignError, match="the state feedback loop is not stable: an eigenvalue has magnitude 1;"):
        lqr_gain(turn, np.array([[0.0], [1.0]]), np.zeros((2, 2)), np.eye(1))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_values_that_are_not_finite_are_refused(bad: float) -> None:
    A, B, _ = plant(1)
    A[0, 0] = bad
    with pytest.raises(DesignError, match="LQR: the Riccati equation has no stabilising solution"):
        lqr_gain(A, B, np.eye(7), np.eye(2))


def test_nothing_to_weigh_takes_no_gain() -> None:
    np.testing.assert_array_equal(lqr_gain(np.diag([0.9, 0.5]), np.ones((2, 1)), np.zeros((2, 2)), np.eye(1)), 0.0)


def test_require_stable_names_the_magnitude() -> None:
    require_stable(np.diag([0.9, -0.999]), "this")
    with pytest.raises(DesignError, match=r"the loop is not stable: an eigenvalue has magnitude 1\.25; it must be < 1"):
        require_stable(np.diag([0.9, -1.25]), "the loop")
