"""Frequency responses of linear systems by a Schur form, which every frequency shares."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import matrix_balance, schur, solve_triangular

from flexbeams.plant.basis import Array

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class Resolvent:
    """C (s - A)^-1 B of real A (n, n), B (n, m), C (p, n), prepared for many s."""

    triangular: Complex
    B: Complex
    C: Complex

    @classmethod
    def of(cls, A: Array, B: Array, C: Array) -> "Resolvent":
        """Balances A and brings it to complex Schur form."""
        balanced, scaling = matrix_balance(A, permute=False)
        triangular, vectors = schur(balanced, output="complex")
        scale = np.diag(scaling)
        return cls(triangular, vectors.conj().T @ (B / scale[:, None]), (C * scale) @ vectors)

    def at(self, points: ArrayLike) -> Complex:
        """Values (k, p, m) at complex points s (k,)."""
        values = np.asarray(points, dtype=np.complex128)
        shifted = -self.triangular
        diagonal = np.diag(self.triangular)
        result = np.empty((len(values), len(self.C), self.B.shape[1]), dtype=np.complex128)
        for k, s in enumerate(values):
            np.fill_diagonal(shifted, s - diagonal)
            result[k] = self.C @ solve_triangular(shifted, self.B, check_finite=False)
        return result
