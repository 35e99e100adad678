"""The structured singular value of a complex matrix for independent complex scalars, bounded from above by scaling.

mu(M) = 1 / min{|Delta| : det(I - M Delta) = 0, Delta diagonal} <= min over D diagonal > 0 of sigma(D M D^-1), with
equality for up to three scalars (Packard and Doyle 1993).
"""

import numpy as np

from flexbeams.controller.frequency import Complex
from flexbeams.plant.basis import Array

_OSBORNE_SWEEPS = 12
_FIRST_LEVEL = 1.1  # of the method of centers, times the square to begin with
_APPROACH = 0.1  # part of a level's distance to the best value that the next one keeps
_SMALLEST = 1e-30  # the square of a norm that counts as zero
_LEVELS = 200
_NEWTON_STEPS = 40
_ROUNDING = 1e-14  # of the Hessian, which grows without end towards the minimum
_CENTRED = 0.1  # Newton decrement at which a centre is close enough


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


def structured_bound(M: Complex, start: Array, tolerance: float = 1e-6) -> float:
    """min over D of sigma(D M D^-1) for M (n, n), to `tolerance`, relative; `start` is log D (n,) to begin with.

    With X = D^2, the square is the least l for which F = l X - M' X M >= 0 for some diagonal X > 0. The method of
    centers (Boyd and El Ghaoui 1993) goes to the X of largest det F for levels l that come down to the minimum, which
    is about n times the distance of a level to the value at its center away at most.
    """
    n = len(M)
    if n == 1:
        return float(abs(M[0, 0]))
    M = np.exp(start[:, None] - start[None, :]) * M
    x, best = np.ones(n), float(np.linalg.norm(M, 2) ** 2)
    level = _FIRST_LEVEL * max(best, _SMALLEST)
    for _ in range(_LEVELS):
        x = _centre(M, x, level)
        D = np.sqrt(x)
        value = float(np.linalg.norm(D[:, None] * M / D, 2) ** 2)
        best = min(best, value)
        if n * (level - value) <= 2 * tolerance * max(best, _SMALLEST):
            break
        level = value + _APPROACH * (level - value)
    return float(np.sqrt(best))


def _centre(M: Complex, x: Array, level: float) -> Array:
    """The diagonal (n,) of X with unit mean and largest det F, by Newton's method from x."""
    for _ in range(_NEWTON_STEPS):
        Z = np.linalg.inv(level * np.diag(x) - (M.conj().T * x) @ M)
        W = Z @ M.conj().T
        V = M @ W
        gradient = np.diag(V).real - level * np.diag(Z).real
        hessian = np.abs(level * Z) ** 2 - level * (np.abs(W) ** 2 + np.abs(W.T) ** 2) + np.abs(V) ** 2
        hessian += _ROUNDING * np.trace(hessian) * np.eye(len(x))
        full, along = np.linalg.solve(hessian, np.column_stack([gradient, np.ones(len(x))])).T
        step = along * (np.sum(full) / np.sum(along)) - full
        decrement = np.sqrt(max(-float(gradient @ step), 0.0))
        moved = x + step / (1 + decrement)
        if decrement < _CENTRED or not np.min(moved) > 0:
            break
        x = moved
    return x


def _or_one(values: Array) -> Array:
    return np.where(values > 0, values, 1.0)
