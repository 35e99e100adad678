"""The structured singular value of a complex matrix for independent complex scalars, bounded from above by scaling.

mu(M) = 1 / min{|Delta| : det(I - M Delta) = 0, Delta diagonal} <= min over D diagonal > 0 of sigma(D M D^-1), with
equality for up to three scalars (Packard and Doyle 1993).
"""

import numpy as np

from flexbeams.controller.frequency import Complex
from flexbeams.plant.basis import Array

_OSBORNE_SWEEPS = 12
_RADIUS = 6.0  # of log D around Osborne's scaling in which the best one is searched for


def osborne_bounds(M: Complex) -> tuple[Array, Array]:
    """sigma(D M D^-1) for the D of least Frobenius norm, for each M (k, n, n); values (k,) and log D (k, n)."""
    k, n, _ = M.shape
    logs = np.zeros((k, n))
    squares = np.abs(M) ** 2
    squares[:, range(n), range(n)] = 0.0
    for _ in range(_OSBORNE_SWEEPS):
        for i in range(n):
            weights = np.exp(2 * (logs[:, i, None] - logs))
            row = np.sum(squares[:, i, :] * weights, axis=1)
            column = np.sum(squares[:, :, i] / weights, axis=1)
            logs[:, i] += np.where((row > 0) & (column > 0), 0.25 * np.log(_or_one(column) / _or_one(row)), 0.0)
    scaled = np.exp(logs[:, :, None] - logs[:, None, :]) * M
    return np.linalg.norm(scaled, ord=2, axis=(1, 2)), logs


def structured_bound(M: Complex, start: Array, tolerance: float = 1e-5) -> float:
    """min over D of sigma(D M D^-1) for M (n, n), to `tolerance`, relative; `start` is log D (n,) to search around.

    The value is convex in log D. The ellipsoid method halves in on its minimum whether or not the largest singular
    value is simple there, and states how far the best value may be from it.
    """
    n = len(M)
    if n == 1:
        return float(abs(M[0, 0]))
    value, gradient = _scaled_norm(M, start)
    if n == 2:
        # one free scaling: the ellipsoid method needs two dimensions
        return _interval_minimum(M, start, tolerance)
    x, shape, best, m = start[:-1] - start[-1], _RADIUS**2 * np.eye(n - 1), value, n - 1
    for _ in range(100 * m**2):
        length = float(np.sqrt(gradient[:-1] @ shape @ gradient[:-1]))
        if length <= tolerance * best:
            break
        step = shape @ gradient[:-1] / length
        x = x - step / (m + 1)
        shape = m**2 / (m**2 - 1) * (shape - 2 / (m + 1) * np.outer(step, step))
        value, gradient = _scaled_norm(M, np.append(x, 0.0))
        best = min(best, value)
    return best


def _scaled_norm(M: Complex, logs: Array) -> tuple[float, Array]:
    """sigma(D M D^-1) and its derivative by log D (n,)."""
    scaled = np.exp(logs[:, None] - logs[None, :]) * M
    U, sigma, Vh = np.linalg.svd(scaled)
    return float(sigma[0]), sigma[0] * (np.abs(U[:, 0]) ** 2 - np.abs(Vh[0]) ** 2)


def _interval_minimum(M: Complex, start: Array, tolerance: float) -> float:
    """The minimum over the one scaling of two scalars, by the sign of the derivative."""
    low, high = start[0] - start[1] - _RADIUS, start[0] - start[1] + _RADIUS
    best = np.inf
    while high - low > tolerance:
        middle = (low + high) / 2
        value, gradient = _scaled_norm(M, np.array([middle, 0.0]))
        best = min(best, value)
        low, high = (low, middle) if gradient[0] > 0 else (middle, high)
    return float(best)


def _or_one(values: Array) -> Array:
    return np.where(values > 0, values, 1.0)
