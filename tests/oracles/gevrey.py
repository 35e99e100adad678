"""The transition Theta and its derivatives twice over: in 50 digits, and in doubles for many times at once."""

from functools import cache

import mpmath
import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

DIGITS = 50
POINTS = 192  # on Cauchy's circle


def taylor_coefficients(gevrey_order: float, tau: float, degree: int) -> Real:
    """Theta^(i)(tau) / i!, i = 0 ... degree: the integral by quadrature, the others by Cauchy's formula.

    On a circle of twice the radius around tau, theta is still bounded, so aliases are 2^-POINTS of the values;
    near the ends the circle is small enough that theta on it does not differ by more than some 10 digits.
    """
    with mpmath.workdps(DIGITS):
        x, whole = mpmath.mpf(tau), _integral(gevrey_order, mpmath.mpf(1) / 2) * 2
        rising = _integral(gevrey_order, min(x, 1 - x))
        g, edge = 1 / (mpmath.mpf(gevrey_order) - 1), min(x, 1 - x)
        radius = min(edge * mpmath.sin(min(mpmath.pi / 6, mpmath.pi / (4 * g))), 20 * edge ** (g + 1) / g)
        around = mpmath.unitroots(POINTS)
        values = [_theta(gevrey_order, x + radius * w) for w in around]
        theta = [
            mpmath.fsum(v * around[-i * j % POINTS] for j, v in enumerate(values)).real / POINTS / radius**i
            for i in range(degree)
        ]
        first = rising if x <= 0.5 else whole - rising
        return np.array([float(c / whole) for c in (first, *(t / (i + 1) for i, t in enumerate(theta)))])


def _theta(gevrey_order: float, tau: mpmath.mpf | mpmath.mpc) -> mpmath.mpf | mpmath.mpc:
    g = 1 / (mpmath.mpf(gevrey_order) - 1)
    return mpmath.exp(-((tau * (1 - tau)) ** -g))


@cache
def _integral(gevrey_order: float, tau: mpmath.mpf) -> mpmath.mpf:
    return mpmath.quad(lambda t: _theta(gevrey_order, t), [0, tau / 2, tau])


def taylor_coefficients_at(gevrey_order: float, tau: Real, degree: int) -> Real:
    """The same in doubles for tau (k,), shape (k, degree + 1); 0 outside [0, 1] but for Theta, which stays 0 or 1.

    Coefficients of (tau (1 - tau))^-g are a product of two binomial series. Theta is a Gauss-Legendre sum over
    [0, tau] or [tau, 1].
    """
    g = 1 / (gevrey_order - 1)
    moving = np.minimum(tau, 1 - tau) > 1e-4  # theta is below e^-9000 elsewhere
    inside = tau[moving]
    binomials = np.cumprod(np.concatenate([[1.0], (-g - np.arange(degree)) / np.arange(1, degree + 1)]))
    left = binomials * inside[:, None] ** (-g - np.arange(degree + 1))
    right = binomials * (-1.0) ** np.arange(degree + 1) * (1 - inside[:, None]) ** (-g - np.arange(degree + 1))
    with np.errstate(under="ignore", over="ignore", invalid="ignore"):
        exponent = -np.stack([np.sum(left[:, : k + 1] * right[:, k::-1], axis=1) for k in range(degree)], axis=1)
        theta = np.empty((len(inside), degree))
        theta[:, 0] = np.exp(exponent[:, 0] + 4**g)  # for small orders doubles hold theta only beside its maximum
        for k in range(1, degree):
            theta[:, k] = np.sum(np.arange(1, k + 1) * exponent[:, 1 : k + 1] * theta[:, k - 1 :: -1], axis=1) / k
    theta[theta[:, 0] == 0] = 0.0
    norm = 2 * _area(g, np.array([0.5]))[0]
    series = np.zeros((len(tau), degree + 1))
    series[tau >= 0.5, 0] = 1.0
    area = _area(g, np.minimum(inside, 1 - inside)) / norm
    series[moving, 0] = np.where(inside < 0.5, area, 1 - area)
    series[moving, 1:] = theta / norm / np.arange(1, degree + 1)
    return series


def _area(g: float, tau: Real) -> Real:
    """Integral of theta over [0, tau], tau <= 1/2."""
    points, weights = np.polynomial.legendre.leggauss(80)
    t = tau[:, None] * (points + 1) / 2
    with np.errstate(under="ignore"):
        area: Real = np.exp(4**g - (t * (1 - t)) ** -g) @ weights * tau / 2
    return area
