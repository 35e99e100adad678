"""How well each patch pair moves and each gauge sees the modes that a design controls."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh, solve_continuous_lyapunov

from flexbeams.controller.design import Design
from flexbeams.plant.basis import Array

_LARGEST_CONDITION = 1e6  # of eigenvectors, up to which they give Gramians to ten digits


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """Modal shares and the part in the Hankel singular values from voltages to strains.

    The modal share of a pair is |phi_i' L_k| beside the largest of all pairs for this mode, that of a gauge likewise
    |H_pm phi_i|. The loss is the part of the sum of the reduced model's Hankel singular values, from voltages to
    strains, that the loop would lack without the pair or gauge: the smallest names the one to move.
    """

    frequencies: Array  # (modes,), rad/s, undamped
    pairs: Array  # (modes, n_u), 0 ... 1
    gauges: Array  # (modes, n_pm), 0 ... 1
    pair_losses: Array  # (n_u,), 0 ... 1
    gauge_losses: Array  # (n_pm,), 0 ... 1

    def figures(self) -> dict[str, Any]:
        """For the summary, in JSON's types."""
        return {
            "frequencies": self.frequencies.tolist(),
            "modal_controllability": self.pairs.tolist(),
            "modal_observability": self.gauges.tolist(),
            "hankel_loss_without_pair": self.pair_losses.tolist(),
            "hankel_loss_without_gauge": self.gauge_losses.tolist(),
        }


def rank(design: Design) -> Ranking:
    """The ranking of a design's pairs and gauges, over as many modes as it retains."""
    model, modes = design.model(), len(design.arrays["A"]) // 2
    system = model.assemble()
    inverse_squares, shapes = eigh(system.M, system.K)
    slowest_first = np.argsort(-inverse_squares)[:modes]
    shapes = shapes[:, slowest_first]
    A, B, C = (design.arrays[name] for name in ("A", "B", "H_pm"))
    return Ranking(
        frequencies=1 / np.sqrt(inverse_squares[slowest_first]),
        pairs=_shares(shapes.T @ system.L),
        gauges=_shares((model.strain @ shapes).T),
        pair_losses=_losses(A, B, C),
        gauge_losses=_losses(A.T, C.T, B.T),
    )


def _shares(effects: Array) -> Array:
    """|effects| (modes, channels) beside the largest of each mode."""
    magnitudes = np.abs(effects)
    return np.asarray(magnitudes / np.maximum(np.max(magnitudes, axis=1, keepdims=True), np.finfo(float).tiny))


def _losses(A: Array, B: Array, C: Array) -> Array:
    """Relative loss of the sum of the Hankel singular values of (A, B, C) without each column of B (n, m).

    With the observability Gramian R R' they are the roots of the eigenvalues of R' W R, W that of controllability.
    """
    squares, vectors = eigh(solve_continuous_lyapunov(A.T, -C.T @ C))
    R = vectors * np.sqrt(np.maximum(squares, 0.0))
    parts = list(_controllability(A, B, R))

    def total(products: Array) -> float:
        return float(np.sum(np.sqrt(np.maximum(np.linalg.eigvalsh(products), 0.0))))

    whole = np.sum(parts, axis=0)
    sum_of_all = total(whole)
    return np.array([1 - total(whole - part) / sum_of_all for part in parts])


def _controllability(A: Array, B: Array, R: Array) -> Iterator[Array]:
    """R' W R (n, n) with the Gramian W of each column of B, by the eigenvectors of A where they are independent enough.

    Of W = V X V*, X = -beta beta* / (a_i + conj a_j) with V beta = b, one of each pair of rows counts twice.
    """
    values, V = np.linalg.eig(A)
    if not np.linalg.cond(V) < _LARGEST_CONDITION:
        yield from (R.T @ solve_continuous_lyapunov(A, -np.outer(b, b)) @ R for b in B.T)
        return
    half = values.imag >= 0
    left = R.T @ V
    one_of_each = left[:, half] * np.where(values[half].imag > 0, 2.0, 1.0)
    sums = values[half, None] + values.conj()
    for beta in np.linalg.solve(V, B.astype(np.complex128)).T:
        X = -np.outer(beta[half], beta.conj()) / sums
        yield (one_of_each @ (X @ left.conj().T)).real
