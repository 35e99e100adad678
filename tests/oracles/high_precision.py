"""Closed forms in arbitrary precision, written as in the textbooks, without care for cancellation."""

from functools import cache

import mpmath
import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

DIGITS = 60


@cache
def clamped_free_root(k: int) -> mpmath.mpf:
    """The k-th positive root of 1 + cos(b) cosh(b), k from 1."""
    with mpmath.workdps(DIGITS + 2 * k):
        return mpmath.findroot(
            lambda b: mpmath.cos(b) + 1 / mpmath.cosh(b),
            mpmath.mpf("1.8751") if k == 1 else (k - mpmath.mpf(1) / 2) * mpmath.pi,
        )


def clamped_free_shape(k: int, x: float, derivative: int) -> float:
    """d-th derivative at x in [0, 1] of cosh(bx) - cos(bx) - sigma (sinh(bx) - sin(bx)), d = 0, 1, 2."""
    with mpmath.workdps(DIGITS + 2 * k):  # the terms are of size e^(k pi), and so 1.4 k digits cancel
        b = clamped_free_root(k)
        sigma = (mpmath.cosh(b) + mpmath.cos(b)) / (mpmath.sinh(b) + mpmath.sin(b))
        ch, sh, c, s = (f(b * mpmath.mpf(x)) for f in (mpmath.cosh, mpmath.sinh, mpmath.cos, mpmath.sin))
        shape = (ch - c - sigma * (sh - s), sh + s - sigma * (ch - c), ch + c - sigma * (sh + s))[derivative]
        return float(b**derivative * shape)


def tip_mass_roots(ratio: float, count: int) -> Real:
    """The first roots of 1 + cos b cosh b = ratio b (sin b cosh b - cos b sinh b), ratio = m / (rho A l).

    Divided by cosh b, the left side less the right changes sign once between neighbouring multiples of pi.
    """

    def residual(b: mpmath.mpf) -> mpmath.mpf:
        return 1 / mpmath.cosh(b) + mpmath.cos(b) - ratio * b * (mpmath.sin(b) - mpmath.cos(b) * mpmath.tanh(b))

    with mpmath.workdps(30):
        brackets = [(k * mpmath.pi + mpmath.mpf("1e-6"), (k + 1) * mpmath.pi) for k in range(count)]
        return np.array([float(mpmath.findroot(residual, bracket, solver="anderson")) for bracket in brackets])


def exponential(matrix: Real) -> Real:
    """Matrix exponential with 40 digits, rounded to doubles."""
    with mpmath.workdps(40):
        return np.array(mpmath.expm(mpmath.matrix(matrix.tolist())).tolist(), dtype=float)


def frequency_response(M: Real, D: Real, K: Real, rows: Real, inputs: Real, omega: float) -> NDArray[np.complex128]:
    """rows (K + j w D - w^2 M)^-1 inputs with 40 digits, rounded to doubles."""
    with mpmath.workdps(40):
        mass, damping, stiffness = (mpmath.matrix(matrix.tolist()) for matrix in (M, D, K))
        dynamic = stiffness + mpmath.mpc(0, omega) * damping - mpmath.mpf(omega) ** 2 * mass
        answers = [mpmath.lu_solve(dynamic, mpmath.matrix(column.tolist())) for column in inputs.T]
        outputs = [mpmath.matrix(rows.tolist()) * answer for answer in answers]
        return np.array([[complex(value) for value in output] for output in outputs]).T
