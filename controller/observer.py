"""Matrices of one tick of the controller: filter (42), regulator (44), (45) and estimated deflections.

With the offset-free observer the estimate has a strain offset d of each gauge beside the reduced state:

    e = y_pm - H_pm x - D_pm u - d      x+ = A_d x + B_d u + L e      d+ = d + l e

Model errors leave d at rest; W d is the deflection that they cost. The target calculator takes it back by the voltage
du = -G_0^+ W d and the state that belongs to it, (I - A_d)^-1 B_d du:

    u = u_ff + du + K (x_ref + (I - A_d)^-1 B_d du - x) + integral

so that offsets are further states (x, d), whose references are zero, of one filter and one regulator.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array

_RANK_TOLERANCE = 1e-9  # of the largest singular value: smaller ones of a pseudo-inverse are rounding


@dataclass(frozen=True, kw_only=True)
class TickMatrices:
    """A tick as three products; s estimated states, n_u voltages, n_pi points of interest, n_pm gauges.

    The estimate z is x_est (m,) or, offset-free, x_est and the offsets (m + n_pm,); its reference r is x_ref, with
    zeros for the offsets.

    z <- filter (z, u, y_pm); (w - u_ff - integral, growth / k_I) = regulator (r - z, u_ff - u), where the second
    argument counts in the growth only; y_est = estimates (z, u); predicted strains = strains (z, u).
    """

    filter: Array  # (s, s + n_u + n_pm): [A_d - L H_pm, B_d - L D_pm, L]
    regulator: Array  # (2 n_u, s + n_u): [K, 0; G_0^+ H_pi, G_0^+ D_pi]
    estimates: Array  # (n_pi, s + n_u): [H_pi, D_pi]
    strains: Array  # (n_pm, s + n_u): [H_pm, D_pm]
    integral_range: Array  # (n_u, n_u): orthogonal projection onto the range of G_0^+, where the integral lives


def tick_matrices(arrays: Mapping[str, Array]) -> TickMatrices:
    """The matrices of a design, from its arrays; offset-free where these have an offset_map.

    G_0^+ is the pseudo-inverse of the static gain: that gain is negative, a positive scalar would destabilise.
    """
    A, B, H, D = arrays["A_d"], arrays["B_d"], arrays["H_pm"], arrays["D_pm"]
    L, K, G = arrays["estimator_gain"], arrays["feedback_gain"], arrays["static_inverse"]
    H_pi = arrays["H_pi"]
    if "offset_map" in arrays:
        W, offset_gain = arrays["offset_map"], arrays["offset_gain"]
        (m, n_u), n_pm = B.shape, len(H)
        # u falls by F d: du and the feedback on the state that belongs to it
        F = (np.eye(n_u) + K @ np.linalg.solve(np.eye(m) - A, B)) @ G @ W
        A = np.block([[A, np.zeros((m, n_pm))], [np.zeros((n_pm, m)), np.eye(n_pm)]])
        B = np.vstack([B, np.zeros((n_pm, n_u))])
        L = np.vstack([L, np.diag(offset_gain)])
        H, H_pi, K = np.hstack([H, np.eye(n_pm)]), np.hstack([H_pi, W]), np.hstack([K, F])
    estimates = np.hstack([H_pi, arrays["D_pi"]])
    return TickMatrices(
        filter=np.hstack([A - L @ H, B - L @ D, L]),
        regulator=np.vstack([np.hstack([K, np.zeros((len(K), len(K)))]), G @ estimates]),
        estimates=estimates,
        strains=np.hstack([H, D]),
        integral_range=_range_projection(G),
    )


def _range_projection(G: Array) -> Array:
    """The orthogonal projection (n_u, n_u) onto the range of G (n_u, n_pi); the unit matrix itself at full rank."""
    directions, sigma, _ = np.linalg.svd(G)
    rank = int(np.count_nonzero(sigma > _RANK_TOLERANCE * max(sigma[0], np.finfo(float).tiny)))
    within = directions[:, :rank]
    projection: Array = np.eye(len(G)) if rank == len(G) else within @ within.T
    return projection
