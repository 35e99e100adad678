"""The discrete algebraic Riccati equation, scaled, refined and checked."""

import numpy as np
from scipy.linalg import LinAlgError, solve_discrete_are, solve_discrete_lyapunov

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError

TOLERANCE = 1e-9  # relative residual accepted
MARGIN = 1e-12  # distance of a stable eigenvalue from the unit circle, larger than rounding


def residual(A: Array, B: Array, Q: Array, R: Array, S: Array) -> float:
    """||A'SA - S - A'SB (R + B'SB)^-1 B'SA + Q|| / ||S||."""
    gain = np.linalg.solve(R + B.T @ S @ B, B.T @ S @ A)
    return float(np.linalg.norm(A.T @ S @ A - S - A.T @ S @ B @ gain + Q) / (np.linalg.norm(S) or 1.0))


def solve_riccati(A: Array, B: Array, Q: Array, R: Array, name: str) -> Array:
    """Stabilising S (n, n) of A'SA - S - A'SB (R + B'SB)^-1 B'SA + Q = 0.

    A (n, n), B (n, m), Q (n, n) >= 0, R (m, m) > 0. Inputs are scaled to R = I; two Newton steps (Kleinman, as
    closed-loop Lyapunov equations) remove the residual of the Schur method. Raises DesignError, naming `name`, where
    no stabilising solution exists or the residual stays above TOLERANCE.
    """
    root = np.linalg.cholesky(R)
    scaled = np.linalg.solve(root, B.T).T
    identity = np.eye(R.shape[0])
    try:
        S = solve_discrete_are(A, scaled, Q, identity)
        for _ in range(2):
            gain = np.linalg.solve(identity + scaled.T @ S @ scaled, scaled.T @ S @ A)
            S = solve_discrete_lyapunov((A - scaled @ gain).T, Q + gain.T @ gain, method="bilinear")
            S = (S + S.T) / 2
    except (LinAlgError, ValueError) as error:
        raise DesignError(f"{name}: the Riccati equation has no stabilising solution ({error})") from None
    if not (remaining := residual(A, scaled, Q, identity, S)) <= TOLERANCE:
        raise DesignError(
            f"{name}: the Riccati equation has a residual of {remaining:.1e}; it must be <= {TOLERANCE:.0e}"
        )
    result: Array = S
    return result


def require_stable(A: Array, name: str) -> None:
    """DesignError where an eigenvalue of a discrete-time A (n, n) is not inside the unit circle."""
    radius = float(np.max(np.abs(np.linalg.eigvals(A))))
    if not radius < 1 - MARGIN:
        raise DesignError(f"{name} is not stable: an eigenvalue has magnitude {radius:.6g}; it must be < 1")
