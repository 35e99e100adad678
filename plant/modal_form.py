"""The modal form of a linear system x' = A x + B v and its exact step, on plain arrays."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class ModalForm:
    """Coordinates z with x = Re(V z), in which each eigenvalue has an equation of its own: z' = eigenvalues z + W B v.

    Of a conjugate pair the eigenvalue with the positive imaginary part stands for both. `condition` is the largest
    condition number of an eigenvalue, the product of the lengths of its right and left vectors, by which rounding
    errors grow: 1 where A is normal, infinite where there are no independent eigenvectors.
    """

    eigenvalues: ComplexArray  # (m,), 1/s; n / 2 <= m <= n
    V: ComplexArray  # (n, m)
    W: ComplexArray  # (m, n)
    condition: float

    def step_functions(self, step: float) -> tuple[ComplexArray, ComplexArray]:
        """exp(a h) - 1 and its integral over the step, (exp(a h) - 1) / a, s, for each eigenvalue a (m,).

        z(t + h) = z + growth z + hold W B v for an input v held from t to t + h.
        """
        growth = np.expm1(self.eigenvalues * step)
        hold = np.full(len(growth), step, dtype=np.complex128)
        np.divide(growth, self.eigenvalues, out=hold, where=self.eigenvalues != 0.0)
        return growth, hold


def modal_form(A: Array) -> ModalForm:
    """The modal form of A (n, n), finite.

    Rows and columns are taken from the largest row to the smallest: in this order the QR iteration leaves the digits
    of small eigenvalues alone.
    """
    order = np.argsort(-np.abs(A).sum(axis=1), kind="stable")
    values, vectors = np.linalg.eig(A[np.ix_(order, order)])
    V = np.empty(A.shape, dtype=np.complex128)
    V[order] = vectors
    W = np.full(A.shape, np.inf, dtype=np.complex128)
    with suppress(np.linalg.LinAlgError):  # where V is singular
        W[:] = np.linalg.inv(V)
    condition = float(np.max(np.linalg.norm(V, axis=0) * np.linalg.norm(W, axis=1)))
    eigenvalues = values.astype(np.complex128)
    one_of_each = eigenvalues.imag >= 0.0
    weights = np.where(eigenvalues.imag > 0.0, 2.0, 1.0)
    return ModalForm(
        eigenvalues=eigenvalues[one_of_each],
        V=(weights * V)[:, one_of_each],
        W=W[one_of_each],
        condition=condition,
    )
