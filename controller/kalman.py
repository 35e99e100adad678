"""The steady-state Kalman filter (40)-(42) with the weights (46)."""

import numpy as np

from flexbeams.controller.riccati import require_stable, solve_riccati
from flexbeams.plant.basis import Array


def hankel_weights(
    hankel_position: Array, hankel_velocity: Array, *, total: float, position: float, velocity: float
) -> Array:
    """Diagonal of the weights (46), (47), shape (2 k,), from the kept singular values (k,) each.

    total * (position * zeta_p / sum(zeta_p), velocity * zeta_v / sum(zeta_v)).
    """
    return total * np.concatenate(
        [position * hankel_position / hankel_position.sum(), velocity * hankel_velocity / hankel_velocity.sum()]
    )


def steady_kalman_gain(A: Array, C: Array, Q: Array, R: Array) -> Array:
    """Gain of the steady-state Kalman filter (42).

    A (n, n), C (p, n), Q (n, n) >= 0, R (p, p) > 0; returns L (n, p).
    P = A P A' - A P C' (C P C' + R)^-1 C P A' + Q;  L = P C' (C P C' + R)^-1.
    Raises DesignError where (A, C) is not detectable.
    """
    P = solve_riccati(A.T, C.T, Q, R, "Kalman filter")
    return np.asarray(np.linalg.solve(C @ P @ C.T + R, C @ P).T, dtype=np.float64)


def predictor_gain(A: Array, C: Array, Q: Array, R: Array) -> Array:
    """A L, the gain that carries the innovation of t_k into the estimate for t_{k+1}; (n, p).

    (42c) prints L itself beside the measurement of k - 1. The innovation passes through A like the estimate it
    corrects; only then is the error's matrix A - A L C stable for every detectable pair.
    """
    gain: Array = A @ steady_kalman_gain(A, C, Q, R)
    require_stable(A - gain @ C, "the estimation error")
    return gain
