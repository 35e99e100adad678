"""The linear-quadratic regulator (43), (44)."""

import numpy as np

from flexbeams.controller.riccati import require_stable, solve_riccati
from flexbeams.plant.basis import Array


def lqr_gain(A: Array, B: Array, Q: Array, R: Array) -> Array:
    """State feedback gain K (m, n) of u = K (x* - x), minimising the sum of x'Qx + u'Ru.

    A (n, n), B (n, m), Q (n, n) >= 0, R (m, m) > 0. K = (B'SB + R)^-1 B'SA; (44) as printed lacks the transpose
    of its second B. Raises DesignError where (A, B) is not stabilisable.
    """
    S = solve_riccati(A, B, Q, R, "LQR")
    gain = np.asarray(np.linalg.solve(B.T @ S @ B + R, B.T @ S @ A), dtype=np.float64)
    require_stable(A - B @ gain, "the state feedback loop")
    return gain
