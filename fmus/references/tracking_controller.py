"""Reference results of TrackingController: (42) to (45) one after the other, where the kernels have few matrices."""

from dataclasses import replace

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.fmus.references.experiments import Experiment, Series, digits, names_of
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel


def controller_experiments(design: Design, model: BeamModel) -> list[Experiment]:
    """Measurements and references that swing, with the design's parameters and with a limit that is reached."""
    arrays, step, limit = design.arrays, design.options.sample_time, design.options.voltage_limit
    (n_u, m), n_pi, n_pm = arrays["feedback_gain"].shape, len(arrays["H_pi"]), len(arrays["H_pm"])
    names = (*names_of("y_pm", n_pm), *names_of("u_ff", n_u), *names_of("x_ref", m))
    reach = 0.3 * limit / float(np.max(np.abs(arrays["feedback_gain"]).sum(axis=1)))
    size = np.concatenate([np.full(n_pm, 1e-4), np.full(n_u, 0.6 * limit), np.full(m, reach)])
    k, column = np.arange(101.0)[:, None], np.arange(len(names))
    inputs = np.round(np.sin(2 * np.pi * k / (25 + 3 * (column % 17))), 3) * digits(size, 1)
    stimuli = Series(names=names, time=step * k[:, 0], values=digits(inputs, 4))
    outputs = (*names_of("u", n_u), *names_of("y_est", n_pi), "saturated")
    experiments = []
    for name, description, parameters in (
        ("swinging", "Measurements and references swing", {}),
        (
            "limited",
            "The same with a voltage limit that is reached, and a faster integral",
            {"integral_gain": 0.9 * design.integral_gain_limit, "voltage_limit": float(f"{0.4 * limit:.4g}")},
        ),
    ):
        values = controller_response(design, stimuli.values, **parameters)
        experiments.append(
            Experiment(
                name=name,
                description=description,
                step=step,
                steps=len(inputs) - 1,
                parameters=dict(parameters),
                stimuli=stimuli,
                references=Series(names=outputs, time=stimuli.time, values=values),
            )
        )
    return experiments


def controller_response(
    design: Design, inputs: Array, integral_gain: float | None = None, voltage_limit: float | None = None
) -> Array:
    """u, y_est and saturated (0 or 1), (k, n_u + n_pi + 1), at the ticks to which y_pm, u_ff, x_ref (k, .) belong.

    (42c), (44), (45) with clipped voltages; an integral that drives a voltage further beyond the limit is held, and
    the others' integrals grow so that the sum stays a voltage of G_0^+.
    With the offset-free observer the strain offsets d have a target calculator of their own.
    """
    a, options = design.arrays, design.options
    A, B, H, D, L, K, G = (
        a[n] for n in ("A_d", "B_d", "H_pm", "D_pm", "estimator_gain", "feedback_gain", "static_inverse")
    )
    gain = design.integral_gain if integral_gain is None else integral_gain
    limits = (options if voltage_limit is None else replace(options, voltage_limit=voltage_limit)).voltage_limits(
        len(G)
    )
    n_u, n_pm = B.shape[1], len(H)
    y_pm, u_ff, x_ref = inputs[:, :n_pm], inputs[:, n_pm : n_pm + n_u], inputs[:, n_pm + n_u :]
    W, rate = a.get("offset_map", np.zeros((len(a["H_pi"]), n_pm))), a.get("offset_gain", np.zeros(n_pm))
    at_rest, basis = np.linalg.solve(np.eye(len(A)) - A, B), _range_basis(G)
    x, integral, wanted, d = x_ref[0], np.zeros(n_u), u_ff[0], np.zeros(n_pm)
    rows = []
    for k in range(len(inputs)):
        u = np.clip(wanted, limits.lowest, limits.highest)
        rows.append(np.concatenate([u, a["H_pi"] @ x + a["D_pi"] @ u + W @ d, [np.any(wanted != u)]]))
        innovation = y_pm[k] - H @ x - D @ u - d
        x_next = A @ x + B @ u + L @ innovation
        d = d + rate * innovation
        du = -G @ (W @ d)
        error = a["H_pi"] @ (x_ref[k] - x_next) + a["D_pi"] @ (u_ff[k] - u) - W @ d
        wanted = u_ff[k] + du + K @ (x_ref[k] + at_rest @ du - x_next) + integral
        excess = wanted - np.clip(wanted, limits.lowest, limits.highest)
        integral = integral + _growth_without_windup(basis, gain * (G @ error), excess)
        x = x_next
    return np.array(rows)


def _range_basis(G: Array) -> Array:
    """Orthonormal basis (n_u, rank) of the range of G (n_u, n_pi)."""
    directions, sigma, _ = np.linalg.svd(G)
    rank = int(np.count_nonzero(sigma > 1e-9 * max(sigma[0], np.finfo(float).tiny)))
    return np.asarray(directions[:, :rank], dtype=np.float64)


def _growth_without_windup(basis: Array, growth: Array, excess: Array) -> Array:
    """The growth G a nearest to the given one that is zero in every pair that it drives further out.

    `basis` (n_u, rank) is that of the range of G, `excess` (n_u,) is how far voltages are beyond their limits.
    Pairs are held one after the other, from the first on.
    """
    from scipy.linalg import null_space  # which a run with built units does not need

    kept, held = growth, np.zeros(len(growth), dtype=bool)
    while (winding := ~held & (excess * kept > 0)).any():
        held[int(np.argmax(winding))] = True
        free = basis @ null_space(basis[held])
        kept = np.where(held, 0.0, free @ (free.T @ growth))
    return kept
