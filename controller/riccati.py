"""The discrete algebraic Riccati equation, scaled, refined and checked."""

import numpy as np
from scipy.linalg import LinAlgError, solve_discrete_are, solve_discrete_lyapunov

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError

TOLERANCE = 1e-9  # relative residual accepted
MARGIN = 1e-12  # distance of a stable eigenvalue from the unit circle, larger than rounding
_DOUBLINGS = 30  # up to 2^30 samples, beyond which rounding decides about stability
_VANISHED = 1e-9  # norm of the closed loop's power from which the solution no longer changes


def residual(A: Array, B: Array, Q: Array, R: Array, S: Array) -> float:
    """||A'SA - S - A'SB (R + B'SB)^-1 B'SA + Q|| / ||S||."""
    gain = np.linalg.solve(R + B.T @ S @ B, B.T @ S @ A)
    return float(np.linalg.norm(A.T @ S @ A - S - A.T @ S @ B @ gain + Q) / (np.linalg.norm(S) or 1.0))


def solve_riccati(A: Array, B: Array, Q: Array, R: Array, name: str) -> Array:
    """Stabilising S (n, n) of A'SA - S - A'SB (R + B'SB)^-1 B'SA + Q = 0.

    A (n, n), B (n, m), Q (n, n) >= 0, R (m, m) > 0. Inputs are scaled to R = I. By doubling, and by the Schur method
    where this does not converge; two Newton steps (Kleinman, as closed-loop Lyapunov equations) remove the residual.
    Raises DesignError, naming `name`, where no stabilising solution exists or the residual stays above TOLERANCE.
    """
    root = np.linalg.cholesky(R)
    scaled = np.linalg.solve(root, B.T).T
    identity = np.eye(R.shape[0])
    try:
        S = _doubled(A, scaled, Q)
        if S is None:
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


def _doubled(A: Array, B: Array, Q: Array) -> Array | None:
    """The solution for R = I by structure-preserving doubling (Chu, Fan, Lin and Wang 2004); None where it diverges.

    Step k has A_k, similar to the 2^k-th power of the closed loop: where it vanishes, the solution is stabilising.
    """
    G, S, identity = B @ B.T, Q, np.eye(len(A))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(_DOUBLINGS):
            try:
                left, right = np.hsplit(np.linalg.solve(identity + G @ S, np.hstack([A, G @ A.T])), 2)
            except np.linalg.LinAlgError:
                return None
            A, G, S = A @ left, G + A @ right, S + A.T @ S @ left
            size = np.linalg.norm(A)
            if size < _VANISHED:
                return np.asarray((S + S.T) / 2, dtype=np.float64)
            if not np.isfinite(size):
                return None
    return None


def require_stable(A: Array, name: str) -> None:
    """DesignError where an eigenvalue of a discrete-time A (n, n) is not inside the unit circle."""
    radius = float(np.max(np.abs(np.linalg.eigvals(A))))
    if not radius < 1 - MARGIN:
        raise DesignError(f"{name} is not stable: an eigenvalue has magnitude {radius:.6g}; it must be < 1")
