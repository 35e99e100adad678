"""Interface of the shape functions on one beam, as the Galerkin method uses them."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Basis(Protocol):
    """Shape functions phi_i(z) on [0, length] with phi_i(0) = phi_i'(0) = 0."""

    @property
    def length(self) -> float:
        """Length of the beam, m."""
        ...

    @property
    def size(self) -> int:
        """Number of functions N."""
        ...

    def evaluate(self, z: Array, derivative: int = 0) -> Array:
        """The derivative of order 0, 1 or 2 at z (k,) in m; returns (k, N)."""
        ...

    def gram(self, start: float, end: float, derivative: int) -> Array:
        """Integral of phi_i^(d) phi_m^(d) over [start, end]; returns (N, N), symmetric."""
        ...


def symmetric_product(values: Array, weights: Array) -> Array:
    """Sum over quadrature points of weight times the outer product of values (k, N); returns (N, N)."""
    scaled = values * np.sqrt(weights)[:, None]
    return scaled.T @ scaled
