"""Matrices of one tick of the controller: filter (42), regulator (44), (45) and estimated deflections."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array


@dataclass(frozen=True, kw_only=True)
class TickMatrices:
    """A tick as three products; m states, n_u voltages, n_pi points of interest, n_pm gauges.

    x_est <- filter (x_est, u, y_pm); (w - u_ff - z, z growth / k_I) = regulator (x_ref - x_est, u_ff - u), where the
    second argument counts in the growth only; y_est = estimates (x_est, u).
    """

    filter: Array  # (m, m + n_u + n_pm): [A_d - L H_pm, B_d - L D_pm, L]
    regulator: Array  # (2 n_u, m + n_u): [K, 0; G_0^+ H_pi, G_0^+ D_pi]
    estimates: Array  # (n_pi, m + n_u): [H_pi, D_pi]


def tick_matrices(arrays: Mapping[str, Array]) -> TickMatrices:
    """The matrices of a design, from its arrays.

    G_0^+ is the pseudo-inverse of the static gain: that gain is negative, a positive scalar would destabilise.
    """
    L, K, G = arrays["estimator_gain"], arrays["feedback_gain"], arrays["static_inverse"]
    estimates = np.hstack([arrays["H_pi"], arrays["D_pi"]])
    return TickMatrices(
        filter=np.hstack([arrays["A_d"] - L @ arrays["H_pm"], arrays["B_d"] - L @ arrays["D_pm"], L]),
        regulator=np.vstack([np.hstack([K, np.zeros((len(K), len(K)))]), G @ estimates]),
        estimates=estimates,
    )
