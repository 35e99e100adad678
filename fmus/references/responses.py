"""What the units must put out, computed apart from both kernels.

The plant is solved by its eigenvalues, where the kernels exponentiate matrices; the controller runs (42)-(45) one
equation after the other, where they have few matrices for a tick; the feedforward is a sum over all transitions at any
time, where they keep and retire them. It shares the series of Theta and the planner with the Python kernel.
"""

import numpy as np
from scipy.linalg import cholesky, solve_triangular, svd

from flexbeams.controller.design import Design
from flexbeams.controller.planner import InputShapes, PendingTransitions, plan_transition
from flexbeams.controller.transition import Transition, derivative_scales
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array


def held_response(
    system: SecondOrderSystem,
    rows: Array,
    starts: Array,
    inputs: Array,
    time: Array,
    at_rest_under: Array | None = None,
) -> Array:
    """rows q at `time` (k,) s, (k, len(rows)): inputs (i, n_u + r) of voltages and forces hold from starts (i,) s on.

    x = (Omega eta, eta') of mass-normalised modes moves around its rest position x_s by the eigenvalues of its
    matrix, x(t) = x(start) + W (exp(Lambda (t - start)) - 1) W^-1 (x(start) - x_s). At the first start it is at rest
    under the voltages given (n_u,).
    """
    n, n_u = system.L.shape
    R_M, R_K = cholesky(system.M, lower=True), cholesky(system.K, lower=True)
    U, omega, Vt = svd(solve_triangular(R_M, R_K, lower=True))  # q = R_K^-T V (Omega eta)
    shapes = solve_triangular(R_M, U, lower=True, trans="T")  # q' = R_M^-T U eta'
    A = np.block([[np.zeros((n, n)), np.diag(omega)], [-np.diag(omega), -shapes.T @ system.D @ shapes]])
    eigenvalues, W = np.linalg.eig(A)
    outputs = rows @ solve_triangular(R_K, Vt.T, lower=True, trans="T")
    rest = Vt @ solve_triangular(R_K, np.hstack([system.L, system.F]), lower=True)
    x = np.zeros(2 * n)
    if at_rest_under is not None:
        x[:n] = rest[:, :n_u] @ at_rest_under
    y = np.zeros((len(time), len(rows)))
    for start, end, held in zip(starts, [*starts[1:], np.inf], inputs, strict=True):
        x_s = np.concatenate([rest @ held, np.zeros(n)])
        z = np.linalg.solve(W, x - x_s)
        here = (time >= start) & (time < end)
        moved = np.expm1(np.outer(time[here] - start, eigenvalues)) * z
        y[here] = outputs @ x[:n] + (moved @ (outputs @ W[:n]).T).real
        if end < np.inf:
            x = x + (W @ (np.expm1(eigenvalues * (end - start)) * z)).real
    return y


def planned_motion(design: Design, starts: list[float], targets: Array, wanted: float) -> PendingTransitions:
    """The motion from rest at 0 through targets (i, n_pi) that are seen at `starts` (s), without those refused."""
    arrays = design.arrays
    inverse, shapes = arrays["static_inverse"], InputShapes(times=arrays["shape_times"], values=arrays["shape_values"])
    motion = PendingTransitions(
        offset=np.zeros(len(inverse)), starts=np.zeros(0), durations=np.zeros(0), changes=np.zeros((0, len(inverse)))
    )
    for start, target in zip(starts, targets, strict=True):
        change = inverse @ target - motion.changes.sum(axis=0)
        plan = plan_transition(
            motion, shapes, now=start, change=change, requested=wanted, limit=design.options.voltage_limit
        )
        if plan.duration > 0:
            motion = motion.with_transition(start, plan.duration, change)
    return motion


def feedforward_outputs(design: Design, motion: PendingTransitions, begun: int, time: float) -> Array:
    """u_ff, x_ref, y_ref and moving (0 or 1) at `time` (s), of the first `begun` transitions."""
    arrays = design.arrays
    degree = len(arrays["input_series"]) - 1
    exponent, norm = arrays["transition_constants"].tolist()
    theta = Transition(exponent=exponent, norm=norm, table=arrays["transition_table"])
    xi = np.zeros((degree + 1, len(motion.offset)))
    for start, duration, change in zip(
        motion.starts[:begun], motion.durations[:begun], motion.changes[:begun], strict=True
    ):
        tau = min(max((time - start) / duration, 0.0), 1.0)
        xi += np.outer(theta.series(tau, degree) * derivative_scales(degree, duration), change)
    u = arrays["input_series"] @ xi
    x = np.einsum("aij,ij->a", arrays["state_series"], xi[:-1])
    moving = bool(np.any(time < motion.starts[:begun] + motion.durations[:begun]))
    return np.concatenate([u, x, arrays["H_pi"] @ x + arrays["D_pi"] @ u, [moving]])


def controller_response(
    design: Design, inputs: Array, integral_gain: float | None = None, voltage_limit: float | None = None
) -> Array:
    """u, y_est and saturated (0 or 1), (k, n_u + n_pi + 1), at the ticks to which y_pm, u_ff, x_ref (k, .) belong.

    (42c), (44), (45) with clipped voltages; an integral that drives a voltage further out of the limit stands still.
    """
    a, options = design.arrays, design.options
    A, B, H, D, L, K, G = (
        a[n] for n in ("A_d", "B_d", "H_pm", "D_pm", "estimator_gain", "feedback_gain", "static_inverse")
    )
    gain = options.integral_gain if integral_gain is None else integral_gain
    limit = options.voltage_limit if voltage_limit is None else voltage_limit
    n_u, n_pm = B.shape[1], len(H)
    y_pm, u_ff, x_ref = inputs[:, :n_pm], inputs[:, n_pm : n_pm + n_u], inputs[:, n_pm + n_u :]
    x, integral, wanted = x_ref[0], np.zeros(n_u), u_ff[0]
    rows = []
    for k in range(len(inputs)):
        u = np.clip(wanted, -limit, limit)
        rows.append(np.concatenate([u, a["H_pi"] @ x + a["D_pi"] @ u, [np.any(np.abs(wanted) > limit)]]))
        innovation = y_pm[k] - H @ x - D @ u
        x_next = A @ x + B @ u + L @ innovation
        error = a["H_pi"] @ (x_ref[k] - x_next) + a["D_pi"] @ (u_ff[k] - u)
        wanted = u_ff[k] + K @ (x_ref[k] - x_next) + integral
        growth = gain * (G @ error)
        integral = integral + np.where((np.abs(wanted) > limit) & (wanted * growth > 0), 0.0, growth)
        x = x_next
    return np.array(rows)
