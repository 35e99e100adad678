"""The monolithic recursion itself: its equations row by row, a matrix power, and what the closed loop does."""

from functools import cache

import numpy as np
import pytest

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.planner import PLANNING_TICKS
from flexbeams.controller.transition import Transition
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.measures import decay_time, motion_settling_time
from flexbeams.plant.structure import find_structure, read_structure
from tests.oracles.examples import five_beams, single_beam
from tests.oracles.flat_series import derivatives, flat_series
from tests.oracles.monolithic import Coupling, feedforward, largest_difference, plant_matrices, simulate

pytestmark = pytest.mark.native

STRUCTURES = {"kiel": read_structure(find_structure("kiel")), "single": single_beam(), "five": five_beams()}
SAMPLE = 2e-4
TARGET = (-8e-3, 1e-3, 4e-3, -6e-3)
COUPLINGS: list[Coupling] = ["jacobi", "gauss-seidel"]


@cache
def design(name: str = "kiel", **options: object) -> Design:
    """The design of a structure."""
    return compute_design(STRUCTURES[name], DesignOptions(**options))  # type: ignore[arg-type]


@cache
def model(name: str = "kiel", basis: BasisName = "clamped_free", order: int | None = None) -> BeamModel:
    """The plant's model."""
    return design(name).model(basis, order)


@cache
def tracking(coupling: Coupling) -> dict[str, Array]:
    """Rest to rest in 0.9 s from t = 0.2 s, with feedback, until 3 s."""
    return simulate(design(), model(), steps=15000, coupling=coupling, targets=[(0.2, TARGET)])


def hammer(steps: int, beam: int = 1, peak: float = 1.0, start: int = 100) -> Array:
    """Half a sine of 5 ms on one tip, N; (steps + 1, 3)."""
    force = np.zeros((steps + 1, 3))
    force[start : start + 25, beam] = peak * np.sin(np.pi * np.arange(25) / 25)
    return force


@pytest.mark.parametrize(
    ("name", "basis", "order"), [("kiel", "clamped_free", None), ("five", "clamped_free", 4), ("single", "segment", 5)]
)
def test_plant_agrees_with_the_energy_form(name: str, basis: BasisName, order: int | None) -> None:
    """Two ways to the same sampled plant, under random voltages and forces."""
    beams = model(name, basis, order)
    steps, generator = 600, np.random.default_rng(2)
    system = beams.assemble()
    r, n_u = system.F.shape[1], system.L.shape[1]
    force, voltage = generator.normal(size=(steps + 1, r)), generator.normal(size=(steps + 1, n_u)) * 300
    rest = 200 * generator.normal(size=(n_u,))
    run = simulate(design(name), beams, steps=steps, voltage=voltage, force=force, rest_voltage=rest)
    form = energy_form(system.M, system.D, system.K, np.hstack([system.L, system.F]))
    A, B = discretise(form.A, form.B, SAMPLE)
    x = np.zeros((steps + 1, len(A)))
    x[0] = -np.linalg.solve(form.A, form.B[:, :n_u] @ rest)
    for k in range(steps):
        x[k + 1] = A @ x[k] + B @ np.concatenate([voltage[k], force[k]])
    looks = {"y_pi": beams.deflection, "y_pm": beams.strain, "w": beams.stations.reshape(-1, beams.size)}
    for output, rows in looks.items():
        assert largest_difference(run[f"plant.{output}"], x @ form.outputs(rows).T) < 1e-11
    assert largest_difference(run["plant.energy"], 0.5 * np.sum(x**2, axis=1, keepdims=True)) < 1e-11
    np.testing.assert_array_equal(run["plant.u"], voltage)


def test_a_long_step_of_the_plant_is_exact() -> None:
    voltage = np.random.default_rng(1).normal(size=(41, 4)) * 300
    long = simulate(design(), model(), steps=40, step=7 * SAMPLE, voltage=voltage)
    short = simulate(design(), model(), steps=280, voltage=np.repeat(voltage, 7, axis=0)[:281])
    for name in ("plant.y_pi", "plant.y_pm", "plant.energy"):
        assert largest_difference(long[name], short[name][::7]) < 1e-11


@pytest.mark.parametrize("preview", [0.0, 3 * SAMPLE])
def test_feedforward_agrees_with_the_series(preview: float) -> None:
    """The controller package's recurrences instead of closed forms, with transitions that overlap."""
    arrays = design().arrays
    targets = [(0.1, TARGET), (0.5, (-4e-3, 2e-3, 6e-3, -3e-3))]
    found = feedforward(design(), steps=8000, step=SAMPLE, targets=targets, preview=preview)
    np.testing.assert_array_equal(found.durations, [0.9, 0.9])
    np.testing.assert_allclose(found.starts, [0.1, 0.5 + PLANNING_TICKS * SAMPLE], rtol=1e-12)
    exponent, norm = arrays["transition_constants"]
    transition = Transition(exponent=float(exponent), norm=float(norm), table=arrays["transition_table"])
    rows = np.arange(0, 8001, 37)
    xi, before = np.zeros((len(rows), 31, 4)), np.zeros(4)
    for at, (_, y) in zip(found.starts, targets, strict=True):
        offset = arrays["static_inverse"] @ np.array(y)
        tau = np.where(rows * SAMPLE > at + 1e-9, (rows * SAMPLE + preview - at) / 0.9, 0.0)
        series = derivatives(transition, np.clip(tau, 0, 1), 30, 0.9)
        xi += series[:, :, None] * (offset - before)
        before = offset
    c, X = flat_series(arrays["A"], arrays["B"])
    u_ff, x_ref = np.einsum("i,kij->kj", c, xi), np.einsum("aij,kij->ka", X, xi[:, :-1])
    assert largest_difference(found.u_ff[rows], u_ff) < 1e-12
    assert largest_difference(found.x_ref[rows], x_ref) < 1e-12
    assert largest_difference(found.y_ref[rows], x_ref @ arrays["H_pi"].T + u_ff @ arrays["D_pi"].T) < 1e-12
    assert not found.moving[:501].any()
    assert found.moving[501:7000].all()
    assert not found.moving[7102 + PLANNING_TICKS :].any()


def test_preview_is_a_shift() -> None:
    """But for the first samples of a transition, which nobody knows of before."""
    plain = feedforward(design(), steps=6000, step=SAMPLE, targets=[(0.1, TARGET)])
    early = feedforward(design(), steps=6000, step=SAMPLE, targets=[(0.1, TARGET)], preview=5 * SAMPLE)
    assert largest_difference(early.u_ff[:-5], plain.u_ff[5:]) < 1e-12
    assert largest_difference(early.x_ref[:-5], plain.x_ref[5:]) < 1e-12


def test_targets_that_are_given_at_the_start_refused_or_stretched() -> None:
    """A first target is a rest position; one out of reach is skipped; a hurried one takes what the planner says."""
    found = feedforward(
        design(),
        steps=6000,
        step=SAMPLE,
        transition_time=0.5,
        targets=[(0.0, TARGET), (0.2, tuple(1.5 * y for y in TARGET)), (0.4, tuple(-y for y in TARGET))],
    )
    first = design().arrays["static_inverse"] @ TARGET
    np.testing.assert_allclose(found.u_ff[:2001], np.tile(first, (2001, 1)), rtol=1e-12)
    assert len(found.durations) == 1
    assert found.durations[0] > 0.5
    np.testing.assert_allclose(found.starts, [0.4 + PLANNING_TICKS * SAMPLE], rtol=1e-12)
    assert np.max(np.abs(found.u_ff)) <= 1000 * (1 + 2e-3)
    given = feedforward(design(), steps=6000, step=SAMPLE, durations=[0.7], targets=[(0.1, TARGET)])
    np.testing.assert_array_equal(given.durations, [0.7])


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_free_response_is_a_power_of_one_matrix(coupling: Coupling) -> None:
    """z = (x, x_est, integral, u); the matrix is built here from the energy form. After 1, 2, 64 and 512 samples."""
    a = design().arrays
    system = model().assemble()
    form = energy_form(system.M, system.D, system.K, np.hstack([system.L, system.F]))
    A, B = discretise(form.A, form.B, SAMPLE)
    B, F = B[:, :4], B[:, 4:]
    C = form.outputs(model().strain)
    L, K, G = a["estimator_gain"], a["feedback_gain"], 1e-4 * a["static_inverse"]
    n, m = len(A), 30
    slices = {
        "x": slice(0, n),
        "x_est": slice(n, n + m),
        "integral": slice(n + m, n + m + 4),
        "u": slice(n + m + 4, None),
    }
    z = np.eye(n + m + 8)
    x, x_est, integral, u = (z[slices[name]] for name in slices)
    x_est_next = a["A_d"] @ x_est + a["B_d"] @ u + L @ (C @ x - a["H_pm"] @ x_est - a["D_pm"] @ u)
    u_next = integral - K @ x_est_next
    integral_next = integral - G @ (a["H_pi"] @ x_est_next + a["D_pi"] @ u)
    x_next = A @ x + B @ (u_next if coupling == "gauss-seidel" else u)
    matrix = np.vstack([x_next, x_est_next, integral_next, u_next])
    assert np.max(np.abs(np.linalg.eigvals(matrix))) < 1
    force = np.zeros((520, 3))
    force[0] = [1.0, -2.0, 0.5]
    run = simulate(design(), model(), steps=519, coupling=coupling, force=force)
    first = np.concatenate([F @ force[0], np.zeros(m + 8)])
    for k in (1, 2, 64, 512):
        z_k = np.linalg.matrix_power(matrix, k) @ first
        for name, expected in (
            ("controller.x_est", z_k[slices["x_est"]]),
            ("controller.u", z_k[slices["u"]]),
            ("controller.integral", z_k[slices["integral"]]),
            ("plant.y_pi", form.outputs(model().deflection) @ z_k[slices["x"]]),
        ):
            scale = np.max(np.abs(run[name]))
            np.testing.assert_allclose(run[name][k + 1], expected, rtol=0, atol=1e-10 * scale)


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_every_row_satisfies_the_equations_in_saturation_too(coupling: Coupling) -> None:
    """(42c), (44), (45) with clip and anti-windup, recomputed from the recorded rows; half of them at the limit."""
    a, limit, k_I, now = design().arrays, 350.0, 1e-3, 0 if coupling == "jacobi" else 1
    run = simulate(
        design(),
        model(),
        steps=6000,
        coupling=coupling,
        targets=[(0.05, TARGET)],
        controller_limit=limit,
        integral_gain=k_I,
        force=hammer(6000, peak=20.0),
    )
    u, x_est, integral = run["controller.u"], run["controller.x_est"], run["controller.integral"]
    u_ff, x_ref = (run[f"feedforward.{name}"][now : len(u) - 1 + now] for name in ("u_ff", "x_ref"))
    innovation = run["plant.y_pm"] - x_est @ a["H_pm"].T - u @ a["D_pm"].T
    predicted = x_est @ a["A_d"].T + u @ a["B_d"].T + innovation @ a["estimator_gain"].T
    assert largest_difference(x_est[1:], predicted[:-1]) < 1e-12
    error = x_ref - x_est[1:]
    wanted = u_ff + error @ a["feedback_gain"].T + integral[:-1]
    assert largest_difference(u[1:], np.clip(wanted, -limit, limit)) < 1e-12
    growth = k_I * (error @ a["H_pi"].T + (u_ff - u[:-1]) @ a["D_pi"].T) @ a["static_inverse"].T
    stopped = (np.abs(wanted) > limit) & (wanted * growth > 0)
    assert largest_difference(np.diff(integral, axis=0), np.where(stopped, 0.0, growth)) < 1e-9
    assert stopped.mean() > 0.05
    np.testing.assert_array_equal(run["controller.saturated"][1:, 0], np.any(np.abs(wanted) > limit, axis=1))
    assert 0.2 < run["controller.saturated"].mean() < 1
    assert largest_difference(run["controller.y_est"], x_est @ a["H_pi"].T + u @ a["D_pi"].T) < 1e-12
    held = u[1:] if now else u[:-1]
    plant = simulate(design(), model(), steps=6000, voltage=np.vstack([held, held[-1:]]), force=run["plant.force"])
    assert largest_difference(plant["plant.y_pi"], run["plant.y_pi"]) < 1e-10


def test_controller_runs_on_its_own_clock() -> None:
    """In a step of 2.5 samples 3 and 2 ticks take turns, with inputs held; without feedback u is u_ff."""
    run = simulate(
        design(),
        model(),
        steps=200,
        step=2.5 * SAMPLE,
        targets=[(0.01, TARGET)],
        transition_time=0.5,
        force=hammer(200, start=5),
    )
    a = design().arrays
    for k in (40, 41):
        x_est, u, integral = (run[f"controller.{name}"][k] for name in ("x_est", "u", "integral"))
        for _ in range(3 if k % 2 == 0 else 2):
            innovation = run["plant.y_pm"][k] - a["H_pm"] @ x_est - a["D_pm"] @ u
            x_est = a["A_d"] @ x_est + a["B_d"] @ u + a["estimator_gain"] @ innovation
            error = run["feedforward.x_ref"][k] - x_est
            wanted = run["feedforward.u_ff"][k] + a["feedback_gain"] @ error + integral
            deviation = a["H_pi"] @ error + a["D_pi"] @ (run["feedforward.u_ff"][k] - u)
            integral, u = integral + 1e-4 * a["static_inverse"] @ deviation, wanted
        np.testing.assert_allclose(run["controller.u"][k + 1], u, rtol=1e-10)
        np.testing.assert_allclose(run["controller.x_est"][k + 1], x_est, rtol=1e-9, atol=1e-15)
    off = simulate(design(), model(), steps=200, targets=[(0.0, TARGET)], feedback=False, force=hammer(200))
    np.testing.assert_array_equal(off["controller.u"], off["feedforward.u_ff"])
    assert not off["controller.integral"].any()


def test_rest_stays_rest() -> None:
    """At rest under the voltages of the first target nothing moves."""
    voltage = design().arrays["static_inverse"] @ TARGET
    run = simulate(design(), model(), steps=500, targets=[(0.0, TARGET)], rest_voltage=voltage)
    np.testing.assert_allclose(run["plant.y_pi"], np.tile(TARGET, (501, 1)), rtol=1e-9)
    np.testing.assert_allclose(run["controller.y_est"], np.tile(TARGET, (501, 1)), rtol=1e-9)
    assert np.ptp(run["controller.u"], axis=0).max() < 1e-6


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_feedforward_alone_meets_its_target(coupling: Coupling) -> None:
    """Within 0.01 mm at the end, ripple after T below 0.5 % of the largest target."""
    run = simulate(design(), model(), steps=15000, coupling=coupling, targets=[(0.2, TARGET)], use_controller=False)
    y = run["plant.y_pi"]
    assert np.max(np.abs(y[-1] - TARGET)) < 1e-5
    assert np.max(np.abs(y[run["time"] >= 1.1] - y[-1])) < 0.005 * 8e-3
    assert motion_settling_time(run["time"], y, np.array(TARGET), 0.2) < 0.9
    delay = 0 if coupling == "jacobi" else 1
    plant = plant_matrices(model(), SAMPLE)
    x = plant.F @ np.zeros(3)
    for k in range(700):
        x = plant.A @ x + plant.B @ run["plant.u"][k + delay]
    np.testing.assert_allclose(plant.y_pi @ x, y[700], rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("coupling", COUPLINGS)
def test_tracking_meets_its_target(coupling: Coupling) -> None:
    """Within 0.02 mm from T on, 0.005 mm at the end, within +-1000 V."""
    run = tracking(coupling)
    error = np.abs(run["plant.y_pi"] - TARGET)
    assert np.max(error[run["time"] >= 1.1]) < 2e-5
    assert np.max(error[-1]) < 5e-6
    assert np.max(np.abs(run["controller.u"])) <= 1000
    assert not run["controller.saturated"].any()
    np.testing.assert_array_equal(run["plant.u"], run["controller.u"])


def test_couplings_differ_by_a_sample_or_two() -> None:
    """And by no more: the motion at 0.5 m/s at most in 0.2 ms, and the same end."""
    first, second = (tracking(c) for c in COUPLINGS)
    difference = np.max(np.abs(first["plant.y_pi"] - second["plant.y_pi"]))
    speed = np.max(np.abs(np.diff(first["plant.y_pi"], axis=0)))
    assert 0.1 * speed < difference < 3 * speed
    assert np.max(np.abs(first["plant.y_pi"][-1] - second["plant.y_pi"][-1])) < 1e-7


@pytest.mark.parametrize("static_gain", ["full", "reduced"])
def test_without_static_correction_the_filter_pulls_off_target(static_gain: str) -> None:
    """The paper's offset: 0.3 to 1.5 mm at T, and for good where the integral is off."""
    plain = design(static_correction=False, static_gain=static_gain)
    run = simulate(plain, model(), steps=5500, targets=[(0.2, TARGET)])
    assert 3e-4 < np.max(np.abs(run["plant.y_pi"][5500] - TARGET)) < 1.5e-3
    run = simulate(plain, model(), steps=9000, targets=[(0.2, TARGET)], integral_gain=0.0)
    assert 3e-4 < np.max(np.abs(run["plant.y_pi"][-1] - TARGET)) < 1.5e-3
    assert np.max(np.ptp(run["plant.y_pi"][-2000:], axis=0)) < 1e-5


def test_new_targets_during_the_motion() -> None:
    """Remark 5: each met that is waited for, no jump in u_ff, the voltage within its limit."""
    targets = [(0.1, TARGET), (0.6, (-4e-3, 2e-3, 6e-3, -3e-3)), (1.1, (3e-3, -1e-3, -2e-3, 4e-3))]
    run = simulate(design(), model(), steps=14000, targets=targets)
    assert np.max(np.abs(run["plant.y_pi"][-1] - targets[-1][1])) < 2e-5
    u_ff = run["feedforward.u_ff"]
    assert np.max(np.abs(u_ff)) <= 1000 * (1 + 2e-3)
    rate = np.max(np.abs(np.diff(u_ff, axis=0)))
    one = feedforward(design(), steps=7000, step=SAMPLE, targets=[(0.1, TARGET)])
    assert rate < 4 * np.max(np.abs(np.diff(one.u_ff, axis=0)))
    assert np.max(np.abs(np.diff(u_ff, 2, axis=0))) < 0.1 * rate


def test_feedback_ends_the_ringing_after_a_blow() -> None:
    """Scaled to 32 mm open loop: decay within 4.2 s and at least 4.5 times sooner than without control."""
    steps = 85000
    loose = simulate(design(), model(), steps=steps, voltage=np.zeros((steps + 1, 4)), force=hammer(steps))
    scale = 32e-3 / np.max(np.abs(loose["plant.y_pi"]))
    run = simulate(design(), model(), steps=22500, force=hammer(22500, peak=scale))
    rest = np.zeros(4)
    open_loop = decay_time(loose["time"], loose["plant.y_pi"] * scale, rest, 0.02, 32e-3)
    closed_loop = decay_time(run["time"], run["plant.y_pi"], rest, 0.02, 32e-3)
    assert open_loop < 16.9
    assert closed_loop < 4.2
    assert open_loop / closed_loop > 4.5
    assert not run["controller.saturated"].any()


@pytest.mark.parametrize(("name", "step"), [("single", 0.5), ("five", 2.0)])
def test_one_and_five_beams(name: str, step: float) -> None:
    """Other counts of inputs, points and gauges: the end of a motion that the feedforward can reach."""
    made = design(name)
    y = np.linalg.pinv(made.arrays["static_inverse"]) @ np.full(len(made.structure.patch), 200.0)
    run = simulate(made, model(name), steps=round((step + 1.5) / SAMPLE), targets=[(0.0002, y)], transition_time=step)
    assert np.max(np.abs(run["plant.y_pi"][-1] - y)) < 0.01 * np.max(np.abs(y))
