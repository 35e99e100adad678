"""Second-order balanced truncation (22)-(30), with the static correction that the paper leaves out."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.linalg import eigh, solve_continuous_lyapunov, svd

from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.statespace import static_gains

OutputWeight = Literal["identity", "energy"]
ENERGY_MODES = 30  # undamped modes kept before balancing in the energy norm
VANISHING = 1e-7  # singular values that are rounding: the roots of Gramians that are accurate to 1e-16


@dataclass(frozen=True, kw_only=True)
class ReducedModel:
    """x_r' = A x_r + B u, y_pi = H_pi x_r + D_pi u, y_pm = H_pm x_r + D_pm u with m = 2 r N_r states (29).

    D_pi, D_pm are the static corrections G_full(0) - G_reduced(0), zero without static correction. The shape of
    the beams, w = H_w x_r + D_w u, is read off in the same way.
    """

    A: Array  # (m, m), 1/s
    B: Array  # (m, n_u)
    H_pi: Array  # (n_pi, m)
    H_pm: Array  # (n_pm, m)
    D_pi: Array  # (n_pi, n_u), m/V
    D_pm: Array  # (n_pm, n_u), 1/V
    H_w: Array  # (r STATIONS, m), beam after beam, each from the clamp to the tip
    D_w: Array  # (r STATIONS, n_u), m/V
    hankel_position: Array  # all singular values of the position blocks (25), descending
    hankel_velocity: Array  # all singular values of the velocity blocks
    share: float  # part of their sum that the kept ones hold, 0 ... 1
    residual: float  # of both Lyapunov equations, relative

    @property
    def kept(self) -> int:
        """Position states kept, as many as velocity states."""
        return int(self.A.shape[0] // 2)

    def static_gain(self) -> tuple[Array, Array]:
        """DC gains u -> y_pi and u -> y_pm of the reduced model without its corrections."""
        rest = -np.linalg.solve(self.A, self.B)
        return self.H_pi @ rest, self.H_pm @ rest


def reduce(
    model: BeamModel,
    system: SecondOrderSystem,
    *,
    kept: int,
    output_weight: OutputWeight,
    static_correction: bool = True,
) -> ReducedModel:
    """Balances position and velocity blocks separately and keeps `kept` states of each.

    output_weight "identity" balances in the Galerkin coordinates (H = I in (22), the paper); "energy" in
    coordinates whose squared norm is twice the energy, after a truncation to the lowest ENERGY_MODES undamped
    modes: that choice does not depend on the basis. Raises DesignError where fewer states exist than are to be
    kept, where a mode is not damped or where the reduced A is not Hurwitz; the message names the eigenvalue.
    """
    A, B, positions, weight = _energy_coordinates(system, output_weight)
    n = positions.shape[1]
    if not 1 <= kept <= n:
        raise DesignError(f"reduced_modes must keep 1 to {n} position states, got {kept}")
    _require_damped(A)
    controllability = solve_continuous_lyapunov(A, -B @ B.T)
    observability = solve_continuous_lyapunov(A.T, -weight)
    residual = max(
        _relative(A @ controllability + controllability @ A.T, B @ B.T),
        _relative(A.T @ observability + observability @ A, weight),
    )
    blocks = [
        _balance(controllability[part, part], observability[part, part], kept)
        for part in (slice(0, n), slice(n, 2 * n))
    ]
    (right_p, left_p, sigma_p), (right_v, left_v, sigma_v) = blocks
    right = np.block([[right_p, np.zeros_like(right_v)], [np.zeros_like(right_p), right_v]])
    left = np.block([[left_p, np.zeros_like(left_v)], [np.zeros_like(left_p), left_v]])
    A_r = left @ A @ right
    _require_stable(A_r, kept)
    looks = (model.deflection, model.strain, model.stations.reshape(-1, model.size))
    H_pi, H_pm, H_w = (np.hstack([rows @ positions, np.zeros((len(rows), n))]) @ right for rows in looks)
    B_r = left @ B
    D_pi, D_pm, D_w = (np.zeros((len(rows), B.shape[1])) for rows in looks)
    if static_correction:
        rest = -np.linalg.solve(A_r, B_r)
        full_pi, full_pm = static_gains(model, system)
        D_pi, D_pm = full_pi - H_pi @ rest, full_pm - H_pm @ rest
        D_w = looks[2] @ np.linalg.solve(system.K, system.L) - H_w @ rest
    total = sigma_p.sum() + sigma_v.sum()
    return ReducedModel(
        A=A_r,
        B=B_r,
        H_pi=H_pi,
        H_pm=H_pm,
        D_pi=D_pi,
        D_pm=D_pm,
        H_w=H_w,
        D_w=D_w,
        hankel_position=sigma_p,
        hankel_velocity=sigma_v,
        share=float((sigma_p[:kept].sum() + sigma_v[:kept].sum()) / total),
        residual=residual,
    )


def _energy_coordinates(system: SecondOrderSystem, output_weight: OutputWeight) -> tuple[Array, Array, Array, Array]:
    """A, B for the state (Omega eta, eta') of modal coordinates, positions (n, m) with q = positions x[:m], and H'H.

    Singular values and reduced model do not depend on the coordinates once H'H is carried along, and in these the
    Lyapunov equations are well scaled: solved in (q, q') their residuals come out near 1e-3.
    """
    # 1/omega^2 as eigenvalues: the low modes, which matter, are then the accurate ones
    inverse_squares, shapes = eigh(system.M, system.K)
    count = len(inverse_squares) if output_weight == "identity" else min(ENERGY_MODES, len(inverse_squares))
    omega = 1 / np.sqrt(inverse_squares[::-1][:count])
    shapes = shapes[:, ::-1][:, :count] * omega  # mass-normalised
    A = np.block([[np.zeros((count, count)), np.diag(omega)], [-np.diag(omega), -shapes.T @ system.D @ shapes]])
    B = np.vstack([np.zeros((count, system.L.shape[1])), shapes.T @ system.L])
    positions = shapes / omega
    weight = np.eye(2 * count)
    if output_weight == "identity":
        weight[:count, :count], weight[count:, count:] = positions.T @ positions, shapes.T @ shapes
    return A, B, positions, weight


def _balance(controllability: Array, observability: Array, kept: int) -> tuple[Array, Array, Array]:
    """T (n, kept), its left inverse (kept, n), and all singular values of (25), (27)."""
    factor_c, factor_o = _factor(controllability), _factor(observability)
    U, sigma, Vt = svd(factor_o.T @ factor_c)
    if sigma[kept - 1] <= sigma[0] * VANISHING:
        raise DesignError(
            f"reduced_modes keeps state {kept}, whose Hankel singular value {sigma[kept - 1]:.3g} "
            f"vanishes beside the first, {sigma[0]:.3g}; keep fewer"
        )
    scale = 1 / np.sqrt(sigma[:kept])
    return factor_c @ Vt[:kept].T * scale, (factor_o @ U[:, :kept] * scale).T, sigma


def _factor(gramian: Array) -> Array:
    """R with R R' = gramian (n, n); rounding below zero is cut, where a bare Cholesky would raise."""
    values, vectors = eigh((gramian + gramian.T) / 2)
    root: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _relative(residual: Array, constant: Array) -> float:
    return float(np.linalg.norm(residual + constant) / np.linalg.norm(constant))


def _require_damped(A: Array) -> None:
    eigenvalues = np.linalg.eigvals(A)
    least = eigenvalues[np.argmax(eigenvalues.real / np.abs(eigenvalues))]
    if least.real > -1e-9 * abs(least):
        raise DesignError(
            f"the mode at {abs(least):.6g} rad/s is not damped, which balanced truncation needs; give "
            "the structure damping"
        )


def _require_stable(A: Array, kept: int) -> None:
    eigenvalues = np.linalg.eigvals(A)
    worst = eigenvalues[np.argmax(eigenvalues.real)]
    if worst.real >= 0:
        raise DesignError(
            f"the reduced model with {kept} position states is not stable: eigenvalue "
            f"{worst.real:.6g}{worst.imag:+.6g}j 1/s; change reduced_modes, output_weight or the basis"
        )
