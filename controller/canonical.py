"""Canonical coordinates of balanced states: the same on every machine, where singular vectors are not.

Singular vectors are unique up to their sign, and up to a rotation where singular values are equal; between libraries
they also rotate where singular values are nearly equal. Here every group of nearly equal singular values gets the one
rotation that a fixed rule on the states' deflections gives. A rotation of states changes no transfer function.
"""

from dataclasses import dataclass

import numpy as np

from flexbeams.plant.basis import Array

NEARLY_EQUAL = 1e-3  # relative gap of neighbouring singular values below which their states are rotated together
RELIABLE_GAP = 3e-4  # relative gap between the last retained state and the first truncated one, see Coordinates
_PROMINENT = 0.55  # of the largest magnitude: the first point above it decides; simple symmetries give no such ratio


@dataclass(frozen=True, kw_only=True)
class Coordinates:
    """Rotation of one block of balanced states.

    The retained subspace is determined to about 1e-13 / truncation_gap, relative. Below RELIABLE_GAP two machines
    may obtain reduced models that differ by more than 1e-9.
    """

    rotation: Array  # (k, k), orthogonal: balanced state = rotation times canonical state
    groups: tuple[int, ...]  # sizes of the groups of nearly equal singular values, in order; sum k
    truncation_gap: float  # relative gap between singular values k and k + 1; 1 where no state is truncated

    @property
    def reliable(self) -> bool:
        """Whether every machine obtains the same states."""
        return self.truncation_gap >= RELIABLE_GAP


def canonical_coordinates(sigma: Array, features: Array) -> Coordinates:
    """The canonical rotation of the k leading balanced states.

    sigma (n,), descending, all singular values; features (l, k): what each of l fixed points sees of each state, here
    deflections or their rates at the stations. Within a group, state 1 is the direction that the first prominent point
    sees, with positive sign; state 2 the direction that the first prominent point sees once state 1 is removed; and
    so on.
    """
    k = features.shape[1]
    gaps = -np.diff(sigma) / sigma[:-1]
    ends = [*(np.flatnonzero(gaps[: k - 1] >= NEARLY_EQUAL) + 1), k]
    rotation = np.zeros((k, k))
    start = 0
    for end in ends:
        rotation[start:end, start:end] = _canonical_basis(features[:, start:end])
        start = end
    return Coordinates(
        rotation=rotation,
        groups=tuple(int(size) for size in np.diff([0, *ends])),
        truncation_gap=float(gaps[k - 1]) if k < len(sigma) else 1.0,
    )


def _canonical_basis(features: Array) -> Array:
    """Orthogonal matrix (s, s) whose columns are the canonical states in the given ones, from features (l, s)."""
    size = features.shape[1]
    basis = np.zeros((size, size))
    remaining = features.copy()
    for column in range(size):
        lengths = np.linalg.norm(remaining, axis=1)
        direction = remaining[np.argmax(lengths >= _PROMINENT * lengths.max())].copy()
        for _ in range(2):  # a second pass keeps the basis orthogonal to rounding
            direction -= basis @ (basis.T @ direction)
        direction /= np.linalg.norm(direction)
        basis[:, column] = direction
        remaining -= np.outer(remaining @ direction, direction)
    return basis
