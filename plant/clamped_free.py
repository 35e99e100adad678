"""Basis of the paper: eigenfunctions of a uniform undamped clamped-free beam, stable to any mode number."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np
from numpy.polynomial.legendre import leggauss

from flexbeams.plant.basis import Array, symmetric_product


def clamped_free_roots(count: int) -> Array:
    """The first `count` positive roots of cos(b) cosh(b) = -1, shape (count,).

    Solved as cos(b) + 1/cosh(b) = 0 by Newton's method from (k - 1/2) pi, which keeps every digit at any order.
    """
    b: Array = (np.arange(1, count + 1, dtype=np.float64) - 0.5) * np.pi
    b[0] = 1.875
    for _ in range(6):
        sech = 2 * np.exp(-b) / (1 + np.exp(-2 * b))
        b = b - (np.cos(b) + sech) / (-np.sin(b) - sech * np.tanh(b))
    return b


@dataclass(frozen=True)
class ClampedFreeBasis:
    """phi = cosh(bx) - cos(bx) - sigma (sinh(bx) - sin(bx)), x = z / length, of L2 norm sqrt(length).

    The two hyperbolic functions cancel to nothing near mode 10 and overflow later, so they are folded into
    decaying exponentials: cosh - sigma sinh = ((1 - sigma) e^{bx} + (1 + sigma) e^{-bx}) / 2 with
    1 - sigma = 2 (sin b - cos b - e^{-b}) / (e^b - e^{-b} + 2 sin b) joined to e^{b(x-1)}.
    """

    length: float
    size: int
    roots: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "roots", clamped_free_roots(self.size))

    def evaluate(self, z: Array, derivative: int = 0) -> Array:
        """See Basis.evaluate."""
        b = self.roots
        x = np.asarray(z, dtype=float)[:, None] / self.length
        decay = np.exp(-b)
        # e^b (1 - sigma), of order one for every mode
        growing = 2 * (np.sin(b) - np.cos(b) - decay) / (1 - decay**2 + 2 * np.sin(b) * decay)
        sigma = 1 - growing * decay
        rising = 0.5 * growing * np.exp(b * (x - 1))
        falling = 0.5 * (1 + sigma) * np.exp(-b * x)
        sine, cosine = np.sin(b * x), np.cos(b * x)
        if derivative == 0:
            shape = rising + falling - cosine + sigma * sine
        elif derivative == 1:
            shape = rising - falling + sine + sigma * cosine
        elif derivative == 2:
            shape = rising + falling + cosine - sigma * sine
        else:
            raise ValueError(f"derivative must be 0, 1 or 2, got {derivative}")
        values: Array = shape * (b / self.length) ** derivative
        return values

    def gram(self, start: float, end: float, derivative: int) -> Array:
        """See Basis.gram; Gauss-Legendre with points enough for the product of the two highest modes."""
        phase = 2 * self.roots[-1] * (end - start) / self.length
        nodes, weights = _gauss_legendre(24 + int(np.ceil(0.75 * phase)))
        half = (end - start) / 2
        return symmetric_product(self.evaluate(start + half * (nodes + 1), derivative), half * weights)


@cache
def _gauss_legendre(count: int) -> tuple[Array, Array]:
    """Nodes and weights (count,) on [-1, 1]."""
    return leggauss(count)
