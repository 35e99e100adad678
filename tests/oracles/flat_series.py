"""The coefficients of u = sum_i c_i xi^(i) and x = sum_i X_i xi^(i) themselves.

They are products of the eigenvalues' factors and fit into doubles up to degrees of about 100.
"""

import numpy as np
from numpy.typing import NDArray

from flexbeams.controller.transition import Transition

Real = NDArray[np.float64]


def flat_series(A: Real, B: Real) -> tuple[Real, Real]:
    """c (m + 1,) and X (m, m, n_u): state, order of the derivative, input; (31), (34)."""
    eigenvalues, vectors = np.linalg.eig(A)
    inputs = np.linalg.solve(vectors, B.astype(complex))
    m, n_u = B.shape
    X = np.zeros((m, m, n_u), dtype=complex)
    for index, eigenvalue in enumerate(eigenvalues):
        z = -np.outer(_product(np.delete(eigenvalues, index)), inputs[index]) / eigenvalue
        X += vectors[:, index, None, None] * z
    return _product(eigenvalues).real.copy(), X.real.copy()


def _product(eigenvalues: Real) -> Real:
    product = np.ones(1, dtype=complex)
    for eigenvalue in sorted(eigenvalues, key=lambda v: (-abs(v), v.imag)):
        product = np.convolve(product, [1.0, -1 / eigenvalue])
    return product


def derivatives(transition: Transition, tau: Real, degree: int, duration: float) -> Real:
    """Theta^(i)(t) at tau = t / duration (k,), i = 0 ... degree, by the recurrences of the product; (k, degree + 1)."""
    rows = [transition.series(float(t), degree) for t in tau]
    index = np.arange(degree + 1)
    taylor = np.array([row.coefficients / row.unit**index for row in rows])
    return np.asarray(taylor * factorials(degree) / duration**index)


def factorials(degree: int) -> Real:
    """i!, i = 0 ... degree."""
    return np.cumprod(np.maximum(np.arange(degree + 1), 1.0))
