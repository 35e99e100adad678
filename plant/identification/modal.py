"""Modal form of a parameter set together with its exact derivatives.

M q'' + D q' + K q = L u + F force has eigenvalues lambda_k with right vectors phi_k (n,) of q and left vectors w_k (n,)
of the momentum equation, so that

    q(t) = sum_k phi_k z_k(t),   z_k' = lambda_k z_k + b_k v,   b_k = w_k' [L F],   v = (u, force).

M, D, K, L are affine in the parameters. A change dM, dD, dK, dL couples the modes by

    E_kj = -w_k' (dK + lambda_j dD + lambda_j^2 dM) phi_j,   db_k = w_k' (dL - dM M^-1 [L F]),

and the derivative of q is the response of mode k to mode j, whose transfer function splits into partial fractions:

    1 / ((s - lambda_k)(s - lambda_j)) = (1/(s - lambda_k) - 1/(s - lambda_j)) / (lambda_k - lambda_j).

Hence derivatives need no simulation of their own: only z_k and dz_k/dlambda_k (k = j). Pairs of eigenvalues that are
nearly or exactly equal, as identical beams have them, keep a response of their own, because the partial fractions
would cancel there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve

from flexbeams.plant.assembly import Term
from flexbeams.plant.basis import Array
from flexbeams.plant.energy import energy_form
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import BeamModel

ComplexArray = NDArray[np.complex128]
NEAR = 1e-5  # relative distance below which two eigenvalues are treated as a pair
LARGEST_CONDITION = 1e10  # of the eigenvectors; beyond it the system is numerically defective


@dataclass(frozen=True, kw_only=True)
class ModalForm:
    """The modal form of one parameter set; m inputs are voltages, then tip forces.

    Of each conjugate pair the upper eigenvalue represents both: a real signal is the sum over `kept` of
    weight_k Re(...), with weight 2 for pairs and 1 for real eigenvalues.
    """

    model: BeamModel
    eigenvalues: ComplexArray  # (2n,), 1/s
    right: ComplexArray  # (n, 2n): phi
    left: ComplexArray  # (2n, n): w'
    inputs: ComplexArray  # (2n, m): b
    acceleration: Array  # (n, m): M^-1 [L F]
    kept: NDArray[np.intp]  # (k,) into the eigenvalues: upper half plane and real ones
    weights: Array  # (k,): 2 or 1
    pairs: tuple[tuple[int, int], ...]  # near pairs, counted within kept

    @property
    def poles(self) -> ComplexArray:
        """The kept eigenvalues (k,), 1/s."""
        return self.eigenvalues[self.kept]


def modal_form(model: BeamModel, parameters: dict[str, float]) -> ModalForm:
    """The modal form for `parameters`, which replace the structure's own where named.

    Raises DesignError where M or K is not positive definite, or where eigenvectors coincide (critical damping to
    rounding).
    """
    system = model.assemble(parameters)
    n = model.size
    form = energy_form(system.M, system.D, system.K, np.eye(n))
    eigenvalues, vectors = np.linalg.eig(form.A)
    vectors = vectors.astype(complex)
    eigenvalues = eigenvalues.astype(complex)
    try:
        inverse = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:
        inverse = np.full_like(vectors, np.nan)
    if not np.linalg.norm(vectors, 2) * np.linalg.norm(inverse, "fro") < LARGEST_CONDITION:
        raise DesignError("two eigenvectors coincide: a mode is critically damped, change its damping a little")
    loads = np.hstack([system.L, system.F])
    left = inverse[:, n:] @ form.B[n:].astype(complex)
    right = form.position @ vectors[:n]
    kept = np.flatnonzero(eigenvalues.imag >= 0)
    kept = kept[np.argsort(np.abs(eigenvalues[kept]), kind="stable")]
    return ModalForm(
        model=model,
        eigenvalues=eigenvalues,
        right=right,
        left=left,
        inputs=left @ loads.astype(complex),
        acceleration=solve(system.M, loads, assume_a="pos"),
        kept=kept,
        weights=np.where(eigenvalues[kept].imag > 0, 2.0, 1.0),
        pairs=_near_pairs(eigenvalues[kept]),
    )


def _near_pairs(poles: ComplexArray) -> tuple[tuple[int, int], ...]:
    distance = np.abs(poles[:, None] - poles[None, :])
    near = np.triu(distance <= NEAR * np.abs(poles)[:, None], 1)
    return tuple((int(i), int(j)) for i, j in np.argwhere(near))


@dataclass(frozen=True, kw_only=True)
class ModalDerivative:
    """Derivative of the modal form with respect to one parameter, in a form that does not depend on the scaling of
    the eigenvectors.

    The derivative of rows q for the input direction d (m,) is the sum over the kept modes of weight_k Re of

        residue_k z_k + shift_k (rows phi_k) (b_k d) dz_k/dlambda_k  (+ pairs),
        residue_k = (rows phi_k) (mixing_k d) - (rows bending_k) (b_k d).
    """

    shift: ComplexArray  # (k,): d lambda_k
    mixing: ComplexArray  # (k, m)
    bending: ComplexArray  # (n, k)
    coupling: tuple[tuple[complex, complex], ...]  # E_ij, E_ji of each near pair


def modal_derivative(form: ModalForm, term: Term, reciprocal: ComplexArray) -> ModalDerivative:
    """The derivative with respect to the parameter of `term`, which enters one matrix only.

    `reciprocal` (2n, 2n) is that of reciprocal_distances(form).
    """
    rows = slice(term.start, term.start + term.block.shape[0])
    kept, eigenvalues = form.kept, form.eigenvalues
    voltages, m = len(form.model.structure.patch), form.inputs.shape[1]
    direct: ComplexArray = np.zeros((len(kept), m), dtype=complex)
    left = form.left[:, rows]
    if term.matrix == "L":
        direct[:, term.column] = left[kept] @ term.block[:, 0]
        assert term.column < voltages
        zero = np.zeros(len(kept), dtype=complex)
        none = np.zeros((form.model.size, len(kept)), dtype=complex)
        return ModalDerivative(shift=zero, mixing=direct, bending=none, coupling=((0j, 0j),) * len(form.pairs))
    power = {"K": 0, "D": 1, "M": 2}[term.matrix]
    coupled = -(left @ term.block) @ (form.right[rows] * eigenvalues**power)  # E
    if term.matrix == "M":
        direct = -(left[kept] @ term.block) @ form.acceleration[rows]
    split = coupled * reciprocal  # E_kj / (lambda_k - lambda_j)
    return ModalDerivative(
        shift=np.diagonal(coupled)[kept].copy(),
        mixing=split[kept] @ form.inputs + direct,
        bending=form.right @ split[:, kept],
        coupling=tuple((complex(coupled[kept[i], kept[j]]), complex(coupled[kept[j], kept[i]])) for i, j in form.pairs),
    )


def reciprocal_distances(form: ModalForm) -> ComplexArray:
    """1 / (lambda_k - lambda_j) (2n, 2n), zero on the diagonal and for near pairs and their conjugates."""
    distance = form.eigenvalues[:, None] - form.eigenvalues[None, :]
    np.fill_diagonal(distance, np.inf)
    conjugates = _conjugates(form)
    for i, j in form.pairs:
        a, b = form.kept[i], form.kept[j]
        for left, right in ((a, b), (conjugates[a], conjugates[b])):
            distance[left, right] = distance[right, left] = np.inf
    return 1 / distance


def _conjugates(form: ModalForm) -> dict[int, int]:
    """Index of each eigenvalue's conjugate; LAPACK returns pairs side by side, the upper one first."""
    return {
        **{int(k): int(k) + (1 if form.eigenvalues[k].imag > 0 else 0) for k in form.kept},
        **{int(k) + 1: int(k) for k in form.kept if form.eigenvalues[k].imag > 0},
    }
