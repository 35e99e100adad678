"""The closed loop as one recursion z_{k+1} = Phi z_k + Gamma v_k with a clip: what a co-simulation must reproduce.

z holds plant, estimate, integral and last voltage side by side, v_k the feedforward's signals and the tip forces as the
coupling delivers them. Row k of every result is the value at t_k = k step, row 0 the initial state. In a Jacobi
coupling all units step from t_k with each other's outputs of t_k; in a Gauss-Seidel coupling feedforward, controller
and plant step in this order with the newest values.

Written apart from the units: the plant in modal coordinates, discretised by scipy; the feedforward for all times at
once from closed forms of Theta's derivatives. Only the planned durations come from the planner, as they
are a choice; they can be given instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular, svd
from scipy.signal import cont2discrete

from flexbeams.controller.design import Design
from flexbeams.controller.planner import PLANNING_TICKS, InputShapes, PendingTransitions, plan_transition
from flexbeams.plant.galerkin import BeamModel
from tests.oracles.flat_series import factorials, flat_series
from tests.oracles.gevrey import taylor_coefficients_at

Real = NDArray[np.float64]
Coupling = Literal["jacobi", "gauss-seidel"]
Target = tuple[float, Sequence[float]]


@dataclass(frozen=True, kw_only=True)
class PlantMatrices:
    """x_{k+1} = A x_k + B u_k + F force_k, y = C x; x = (Omega eta, eta') of mass-normalised modes."""

    A: Real
    B: Real
    F: Real
    y_pi: Real
    y_pm: Real
    w: Real
    at_rest: Real  # x under a voltage


def plant_matrices(model: BeamModel, step: float, parameters: dict[str, float] | None = None) -> PlantMatrices:
    """The plant sampled with zero-order hold."""
    system = model.assemble(parameters)
    n, n_u = system.L.shape
    R_M, R_K = cholesky(system.M, lower=True), cholesky(system.K, lower=True)
    U, omega, Vt = svd(solve_triangular(R_M, R_K, lower=True))  # q = R_K^-T V (Omega eta)
    shapes = solve_triangular(R_M, U, lower=True, trans="T")  # q' = R_M^-T U eta'
    positions = solve_triangular(R_K, Vt.T, lower=True, trans="T")
    A = np.block([[np.zeros((n, n)), np.diag(omega)], [-np.diag(omega), -shapes.T @ system.D @ shapes]])
    B = np.vstack([np.zeros((n, n_u + system.F.shape[1])), shapes.T @ np.hstack([system.L, system.F])])
    A_d, B_d, *_ = cont2discrete((A, B, np.eye(2 * n), np.zeros_like(B)), step)
    y_pi, y_pm, w = (
        np.hstack([rows @ positions, np.zeros((len(rows), n))])
        for rows in (model.deflection, model.strain, model.stations.reshape(-1, n))
    )
    at_rest = np.vstack([positions.T @ system.L, np.zeros((n, n_u))])
    return PlantMatrices(A=A_d, B=B_d[:, :n_u], F=B_d[:, n_u:], y_pi=y_pi, y_pm=y_pm, w=w, at_rest=at_rest)


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What the feedforward puts out, row k at t_k."""

    u_ff: Real
    x_ref: Real
    y_ref: Real
    moving: Real  # (steps + 1, 1); rounding decides where a transition ends at a t_k
    starts: Real  # s, of each transition that a target started
    durations: Real  # s


def feedforward(
    design: Design,
    *,
    steps: int,
    step: float,
    targets: Sequence[Target] = (),
    transition_time: float | None = None,
    voltage_limit: float | None = None,
    preview: float = 0.0,
    durations: Sequence[float] | None = None,
) -> Reference:
    """All outputs of the feedforward; targets (time, y) in order, those at time <= 0 the initial rest position.

    A target is seen in the step from the first t_k >= time on; its transition starts at that t_k where there is no
    motion and the requested time fits, else after the samples that planning takes. `durations` has one value for each
    later target, which all start from rest, else the planner chooses; a refused target is skipped.
    """
    arrays, options = design.arrays, design.options
    c, X = flat_series(arrays["A"], arrays["B"])
    inverse = arrays["static_inverse"]
    m, time = len(c) - 1, step * np.arange(steps + 1)
    shapes = InputShapes(times=arrays["shape_times"], values=arrays["shape_values"])
    wanted = options.transition_time if transition_time is None else transition_time
    limit = options.voltage_limit if voltage_limit is None else voltage_limit
    offset = np.zeros(len(inverse))
    for at, y in targets:
        if at <= 0:
            offset = inverse @ np.asarray(y)
    motion = PendingTransitions(
        offset=offset, starts=np.zeros(0), durations=np.zeros(0), changes=np.zeros((0, len(offset)))
    )
    firsts = []
    given = iter(durations or ())
    for at, y in targets:
        first = int(np.ceil(at / step - 1e-6))
        if at <= 0 or first > steps:
            continue
        change = inverse @ np.asarray(y) - offset - motion.changes.sum(axis=0)
        moving = bool(np.any(first * step + preview < motion.starts + motion.durations))
        for begin in (first, first + round(PLANNING_TICKS * options.sample_time / step)):
            plan = plan_transition(motion, shapes, now=begin * step, change=change, requested=wanted, limit=limit)
            duration = plan.duration if durations is None else next(given)
            if not moving and (durations is not None or plan.as_requested):
                break
        if duration:
            firsts.append(begin)
            motion = motion.with_transition(begin * step, duration, change)
    xi = np.zeros((steps + 1, m + 1, len(offset)))
    xi[:, 0] = offset
    moves = np.zeros((steps + 1, 1))
    index = np.arange(m + 1)
    for first, start, duration, change in zip(firsts, motion.starts, motion.durations, motion.changes, strict=True):
        later = np.arange(first + 1, steps + 1)
        tau = np.clip((time[later] + preview - start) / duration, 0, 1)
        series = taylor_coefficients_at(options.gevrey_order, tau, m)
        xi[later] += (series * factorials(m) / duration**index)[:, :, None] * change
        moves[later, 0] += time[later] + preview < start + duration
    u_ff, x_ref = np.einsum("i,kij->kj", c, xi), np.einsum("aij,kij->ka", X, xi[:, :-1])
    return Reference(
        u_ff=u_ff,
        x_ref=x_ref,
        y_ref=x_ref @ arrays["H_pi"].T + u_ff @ arrays["D_pi"].T,
        moving=(moves > 0).astype(float),
        starts=motion.starts,
        durations=motion.durations,
    )


@dataclass(frozen=True, kw_only=True)
class LoopMatrices:
    """One tick of the controller on s = (x_est, integral, u) with its inputs e = (y_pm, u_ff, x_ref).

    x_est+ = estimate (s, e); wanted = proportional (x_est+, integral, u, e); growth likewise.
    """

    estimate: Real
    wanted: Real
    growth: Real


def loop_matrices(design: Design, integral_gain: float) -> LoopMatrices:
    """Estimate (42c), voltage wanted (44) and growth of the integral (45), each as one matrix of (s, e)."""
    a = design.arrays
    A, B, H, D, L, K = (a[k] for k in ("A_d", "B_d", "H_pm", "D_pm", "estimator_gain", "feedback_gain"))
    (m, n_u), n_pm = B.shape, len(H)
    none = np.zeros((m, n_u))
    estimate = np.hstack([A - L @ H, none, B - L @ D, L, none, np.zeros((m, m))])
    unit = np.eye(n_u)
    wanted = np.hstack([np.zeros((n_u, m)), unit, np.zeros((n_u, n_u + n_pm)), unit, K]) - K @ estimate
    G = integral_gain * a["static_inverse"]
    growth = (
        np.hstack([np.zeros((n_u, m + n_u)), -G @ a["D_pi"], np.zeros((n_u, n_pm)), G @ a["D_pi"], G @ a["H_pi"]])
        - G @ a["H_pi"] @ estimate
    )
    return LoopMatrices(estimate=estimate, wanted=wanted, growth=growth)


def recursion_matrix(design: Design, plant: PlantMatrices, integral_gain: float) -> Real:
    """One sample of the loop without saturation and references as a matrix of (plant, x_est, integral, u)."""
    loop = loop_matrices(design, integral_gain)
    n, (m, n_u), n_pm = len(plant.A), design.arrays["B_d"].shape, len(design.arrays["H_pm"])
    s = slice(0, m + 2 * n_u)
    gauges = slice(m + 2 * n_u, m + 2 * n_u + n_pm)
    keep = np.hstack([np.zeros((n_u, m)), np.eye(n_u), np.zeros((n_u, n_u))])
    rows = [
        np.hstack([plant.A, np.zeros((n, m + n_u)), plant.B]),
        *(
            np.hstack([matrix[:, gauges] @ plant.y_pm, own])
            for matrix, own in (
                (loop.estimate, loop.estimate[:, s]),
                (loop.growth, loop.growth[:, s] + keep),
                (loop.wanted, loop.wanted[:, s]),
            )
        ),
    ]
    return np.vstack(rows)


def simulate(
    design: Design,
    model: BeamModel,
    *,
    steps: int,
    coupling: Coupling = "jacobi",
    step: float | None = None,
    targets: Sequence[Target] = (),
    force: Real | None = None,
    voltage: Real | None = None,
    use_controller: bool = True,
    feedback: bool = True,
    integral_gain: float | None = None,
    controller_limit: float | None = None,
    transition_time: float | None = None,
    voltage_limit: float | None = None,
    preview: float = 0.0,
    durations: Sequence[float] | None = None,
    parameters: dict[str, float] | None = None,
    rest_voltage: Sequence[float] | Real | None = None,
) -> dict[str, Real]:
    """A run of `steps` communication steps; keys as in a result file, such as plant.y_pi (steps + 1, n_pi).

    Instances: {plant} where `voltage` (steps + 1, n_u) is given; {feedforward, plant} without `use_controller`; else
    {feedforward, controller, plant}. `force` (steps + 1, r) in N and `voltage` are external signals, read at t_k in
    both couplings. `voltage_limit` is the feedforward's, `controller_limit` the controller's; None stands for the
    design's value. The plant starts at rest under `rest_voltage`.
    """
    step = design.options.sample_time if step is None else step
    plant = plant_matrices(model, step, parameters)
    n_u, r = plant.B.shape[1], plant.F.shape[1]
    forces = np.zeros((steps + 1, r)) if force is None else force
    results: dict[str, Real] = {"time": step * np.arange(steps + 1.0), "plant.force": forces}
    start = plant.at_rest @ (np.zeros(n_u) if rest_voltage is None else np.asarray(rest_voltage))
    if voltage is not None:
        return results | plant_run(plant, start, voltage, voltage, forces)
    reference = feedforward(
        design,
        steps=steps,
        step=step,
        targets=targets,
        transition_time=transition_time,
        voltage_limit=voltage_limit,
        preview=preview,
        durations=durations,
    )
    results |= {f"feedforward.{name}": getattr(reference, name) for name in ("u_ff", "x_ref", "y_ref", "moving")}
    results |= {"feedforward.starts": reference.starts, "feedforward.durations": reference.durations}
    newest = 1 if coupling == "gauss-seidel" else 0
    if not use_controller:
        held = reference.u_ff[newest:] if newest else reference.u_ff[:-1]
        return results | plant_run(plant, start, reference.u_ff, held, forces)

    options, a = design.options, design.arrays
    loop = loop_matrices(design, design.integral_gain if integral_gain is None else integral_gain)
    limit = options.voltage_limit if controller_limit is None else controller_limit
    per_step = Fraction(step).limit_denominator(10**9) / Fraction(options.sample_time).limit_denominator(10**9)
    ticks = [int(-(-(k * per_step) // 1)) for k in range(steps + 1)]
    m = len(a["A_d"])
    x = np.zeros((steps + 1, len(start)))
    s = np.zeros((steps + 1, m + 2 * n_u))
    saturated = np.zeros((steps + 1, 1))
    x[0] = start
    s[0] = np.concatenate([reference.x_ref[0], np.zeros(n_u), np.clip(reference.u_ff[0], -limit, limit)])
    saturated[0] = np.any(np.abs(reference.u_ff[0]) > limit)
    every = np.vstack([loop.estimate, loop.wanted, loop.growth])
    for k in range(steps):
        e = np.concatenate([plant.y_pm @ x[k], reference.u_ff[k + newest], reference.x_ref[k + newest]])
        s[k + 1], saturated[k + 1] = s[k], saturated[k]
        for _ in range(ticks[k + 1] - ticks[k]):
            estimate, wanted, growth = np.split(every @ np.concatenate([s[k + 1], e]), [m, m + n_u])
            integral = s[k + 1, m : m + n_u]
            if not feedback:
                wanted, integral, growth = reference.u_ff[k + newest], np.zeros(n_u), np.zeros(n_u)
            beyond = np.abs(wanted) > limit
            integral = integral + np.where(beyond & (np.sign(wanted) == np.sign(growth)), 0.0, growth)
            s[k + 1] = np.concatenate([estimate, integral, np.clip(wanted, -limit, limit)])
            saturated[k + 1] = beyond.any()
        x[k + 1] = plant.A @ x[k] + plant.B @ s[k + newest, m + n_u :] + plant.F @ forces[k]
    u, x_est = s[:, m + n_u :], s[:, :m]
    return (
        results
        | shown(plant, x)
        | {
            "plant.u": u,
            "controller.u": u,
            "controller.x_est": x_est,
            "controller.saturated": saturated,
            "controller.integral": s[:, m : m + n_u],
            "controller.y_est": x_est @ a["H_pi"].T + u @ a["D_pi"].T,
        }
    )


def plant_run(plant: PlantMatrices, start: Real, recorded: Real, held: Real, force: Real) -> dict[str, Real]:
    """The plant under voltages `held` from t_k on, of which row k of the result shows `recorded`."""
    x = np.zeros((len(recorded), len(start)))
    x[0] = start
    for k in range(len(recorded) - 1):
        x[k + 1] = plant.A @ x[k] + plant.B @ held[k] + plant.F @ force[k]
    return {"plant.u": recorded, **shown(plant, x)}


def shown(plant: PlantMatrices, x: Real) -> dict[str, Real]:
    """The plant's outputs for its states x (k, 2n)."""
    return {
        "plant.y_pi": x @ plant.y_pi.T,
        "plant.y_pm": x @ plant.y_pm.T,
        "plant.w": x @ plant.w.T,
        "plant.energy": np.sum(x**2, axis=1, keepdims=True) / 2,
    }


def largest_difference(found: Real, expected: Real) -> float:
    """Largest |found - expected| relative to the largest |expected|."""
    return float(np.max(np.abs(found - expected)) / (np.max(np.abs(expected)) or 1.0))
