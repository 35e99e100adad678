"""Frequency responses of linear systems by one decomposition, which every frequency shares."""

import warnings
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import LinAlgWarning, lu_factor, lu_solve, matrix_balance, schur, solve_triangular
from scipy.linalg.lapack import zgecon

from flexbeams.plant.basis import Array

Complex = NDArray[np.complex128]
_LARGEST_CONDITION = 1e6  # of the eigenvectors, up to which the modal form keeps ten digits
_BLOCK = 2**21  # complex numbers that a block of frequencies may occupy


class Resolvent(Protocol):
    """C (s - A)^-1 B of real A (n, n), B (n, m), C (p, n), prepared for many s."""

    @property
    def poles(self) -> Complex:
        """Eigenvalues (n,) of A."""

    def at(self, points: ArrayLike) -> Complex:
        """Values (k, p, m) at complex points s (k,)."""

    def at_each(self, points: ArrayLike) -> Complex:
        """Values (m, p) of column k of B at complex point s_k, of as many points as columns."""

    def part(self, rows: slice, columns: slice) -> "Resolvent":
        """That of some outputs and inputs."""


@dataclass(frozen=True)
class ModalForm:
    """The sum of C_i B_i / (s - poles_i) over the modes i; n (p + 1) m products for each s."""

    poles: Complex  # (n,)
    B: Complex  # (n, m)
    C: Complex  # (p, n)

    def at(self, points: ArrayLike) -> Complex:
        """Values (k, p, m) at complex points s (k,)."""
        s = np.asarray(points, dtype=np.complex128)
        size = max(1, _BLOCK // max(1, self.C.size))
        blocks = [self._block(s[start : start + size]) for start in range(0, len(s), size)]
        return np.concatenate(blocks) if blocks else np.zeros((0, len(self.C), self.B.shape[1]), dtype=np.complex128)

    def _block(self, s: Complex) -> Complex:
        modes = 1 / (s[:, None] - self.poles)
        products = (self.C * modes[:, None, :]).reshape(-1, len(self.poles)) @ self.B
        return np.asarray(products.reshape(len(s), len(self.C), -1), dtype=np.complex128)

    def at_each(self, points: ArrayLike) -> Complex:
        """Values (m, p) of column k of B at complex point s_k, of as many points as columns."""
        s = np.asarray(points, dtype=np.complex128)
        return np.asarray((self.B.T / (s[:, None] - self.poles)) @ self.C.T, dtype=np.complex128)

    def part(self, rows: slice, columns: slice) -> "ModalForm":
        """That of some outputs and inputs."""
        return ModalForm(self.poles, self.B[:, columns], self.C[rows])


@dataclass(frozen=True)
class SchurForm:
    """C (s - A)^-1 B by the triangular factor of A: n^2 m / 2 products for each s, accurate for any A."""

    triangular: Complex  # (n, n)
    B: Complex  # (n, m)
    C: Complex  # (p, n)

    @classmethod
    def of(cls, A: Array, B: Array, C: Array) -> "SchurForm":
        """In balanced coordinates."""
        balanced, scale = _balanced(A)
        triangular, vectors = schur(balanced, output="complex")
        return cls(triangular, vectors.conj().T @ (B / scale[:, None]), (C * scale) @ vectors)

    @property
    def poles(self) -> Complex:
        """Eigenvalues (n,) of A."""
        return np.diag(self.triangular)

    def at(self, points: ArrayLike) -> Complex:
        """Values (k, p, m) at complex points s (k,)."""
        values = np.asarray(points, dtype=np.complex128)
        shifted = -self.triangular
        result = np.empty((len(values), len(self.C), self.B.shape[1]), dtype=np.complex128)
        for k, s in enumerate(values):
            np.fill_diagonal(shifted, s - self.poles)
            result[k] = self.C @ solve_triangular(shifted, self.B, check_finite=False)
        return result

    def at_each(self, points: ArrayLike) -> Complex:
        """Values (m, p) of column k of B at complex point s_k, of as many points as columns."""
        s = np.asarray(points, dtype=np.complex128)
        columns = [self.part(slice(None), slice(k, k + 1)).at(s[k : k + 1])[0, :, 0] for k in range(len(s))]
        return np.array(columns, dtype=np.complex128)

    def part(self, rows: slice, columns: slice) -> "SchurForm":
        """That of some outputs and inputs."""
        return SchurForm(self.triangular, self.B[:, columns], self.C[rows])


def resolvent(A: Array, B: Array, C: Array) -> Resolvent:
    """The modal form where the eigenvectors of A allow it, in balanced coordinates, else the Schur form."""
    balanced, scale = _balanced(A)
    poles, vectors = np.linalg.eig(balanced)
    factors = _factors(vectors)
    if factors is None:
        return SchurForm.of(A, B, C)
    inputs = lu_solve(factors, (B / scale[:, None]).astype(np.complex128))
    return ModalForm(poles.astype(np.complex128), inputs, (C * scale) @ vectors)


def _balanced(A: Array) -> tuple[Array, Array]:
    """A in coordinates (n,) times others in which its rows and columns have nearly equal norms, and these factors."""
    balanced, scaling = matrix_balance(A, permute=False)
    return balanced, np.diag(scaling)


def _factors(vectors: Complex) -> tuple[Complex, NDArray[np.intp]] | None:
    """LU factors of a matrix of eigenvectors; None where it is too ill-conditioned."""
    with warnings.catch_warnings(action="ignore", category=LinAlgWarning):  # of one that is singular
        lu, pivots = lu_factor(vectors.astype(np.complex128))
    inverse_condition, _ = zgecon(lu, np.linalg.norm(vectors, 1))
    return (lu, pivots) if inverse_condition * _LARGEST_CONDITION > 1 else None
