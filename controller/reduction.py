"""Second-order balanced truncation (22)-(30), with a static correction that the paper omits."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, solve_continuous_lyapunov, svd

from flexbeams.controller.canonical import Coordinates, canonical_coordinates
from flexbeams.controller.choices import OutputWeight
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.statespace import static_gains

ENERGY_MODES = 30  # undamped modes retained before balancing in the energy norm, at least
ENERGY_RESERVE = 1.2  # and at least so many times the states that are retained
NEGLIGIBLE_HANKEL = 1e-7  # relative; smaller singular values are rounding: square roots of Gramians accurate to 1e-16


@dataclass(frozen=True, kw_only=True)
class ReducedModel:
    """x_r' = A x_r + B u, y_pi = H_pi x_r + D_pi u, y_pm = H_pm x_r + D_pm u with m = 2 r N_r states (29).

    D_pi, D_pm are the static corrections G_full(0) - G_reduced(0), zero without static correction. The deflection of
    the beams, w = H_w x_r + D_w u, has the same form.
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
    position_coordinates: Coordinates  # of the m / 2 position states
    velocity_coordinates: Coordinates
    hankel_share: float  # part of their sum that the retained states hold, 0 ... 1
    residual: float  # of both Lyapunov equations, relative

    @property
    def position_states(self) -> int:
        """Number of position states, equal to that of velocity states."""
        return int(self.A.shape[0] // 2)

    @property
    def rotation(self) -> Array:
        """(m, m), orthogonal: balanced states of (29), whose weights are diagonal, from the states of this model."""
        return _block_diagonal(self.position_coordinates.rotation, self.velocity_coordinates.rotation)

    def static_gain(self) -> tuple[Array, Array]:
        """DC gains u -> y_pi and u -> y_pm of the reduced model without its corrections."""
        rest = -np.linalg.solve(self.A, self.B)
        return self.H_pi @ rest, self.H_pm @ rest


def reduce(
    model: BeamModel,
    system: SecondOrderSystem,
    *,
    position_states: int,
    output_weight: OutputWeight,
    static_correction: bool = True,
) -> ReducedModel:
    """Balances position and velocity blocks separately and retains `position_states` states of each.

    output_weight "identity" balances in the Galerkin coordinates (H = I in (22), the paper); "energy" in
    coordinates whose squared norm is twice the energy, after a truncation to the lowest undamped modes, ENERGY_MODES
    or, for many states, ENERGY_RESERVE times as many: that choice does not depend on the basis. Raises DesignError
    where the model has fewer states, where a mode is not damped or where the reduced A is not Hurwitz; the message
    names the eigenvalue.
    """
    form = _modal_form(system, output_weight, position_states)
    n = form.positions.shape[1]
    _require_states(position_states, n, len(model.structure.beam))
    _require_damped(form.A)
    projection = _projection(form, _all_stations(model), position_states)
    right, left, sigma_p, sigma_v = projection.right, projection.left, projection.sigma_p, projection.sigma_v
    A_r, B_r = left @ form.A @ right, left @ form.B
    _require_stable(A_r, position_states, system)
    H_pi, H_pm, H_w = (
        np.hstack([rows @ form.positions, np.zeros((len(rows), n))]) @ right
        for rows in (model.deflection, model.strain, _all_stations(model))
    )
    D_pi, D_pm, D_w = (np.zeros((len(H), B_r.shape[1])) for H in (H_pi, H_pm, H_w))
    if static_correction:
        rest = -np.linalg.solve(A_r, B_r)
        full = _full_static_gains(model, system)
        D_pi, D_pm, D_w = (G - H @ rest for G, H in zip(full, (H_pi, H_pm, H_w), strict=True))
    retained = sigma_p[:position_states].sum() + sigma_v[:position_states].sum()
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
        position_coordinates=projection.position,
        velocity_coordinates=projection.velocity,
        hankel_share=float(retained / (sigma_p.sum() + sigma_v.sum())),
        residual=projection.residual,
    )


def _full_static_gains(model: BeamModel, system: SecondOrderSystem) -> tuple[Array, Array, Array]:
    """DC gains of the full model from u to y_pi, y_pm and w."""
    full_pi, full_pm = static_gains(model, system)
    return full_pi, full_pm, _all_stations(model) @ np.linalg.solve(system.K, system.L)


def _all_stations(model: BeamModel) -> Array:
    """(r STATIONS, n): deflection at every station, beam after beam."""
    return model.stations.reshape(-1, model.size)


def _block_diagonal(first: Array, second: Array) -> Array:
    return np.block([[first, np.zeros_like(second)], [np.zeros_like(first), second]])


def _gramians(A: Array, B: Array, output_gram: Array) -> tuple[Array, Array, float]:
    """Controllability and observability Gramians (23), (24) and the larger relative residual of their equations."""
    controllability = solve_continuous_lyapunov(A, -B @ B.T)
    observability = solve_continuous_lyapunov(A.T, -output_gram)
    residual = max(
        _relative(A @ controllability + controllability @ A.T, B @ B.T),
        _relative(A.T @ observability + observability @ A, output_gram),
    )
    return controllability, observability, residual


@dataclass(frozen=True, kw_only=True)
class _ModalForm:
    """State (Omega eta, eta') of n modal coordinates, in which the Lyapunov equations are well scaled.

    Singular values and reduced model do not depend on the coordinates once H'H is carried along. Solved for the state
    (q, q') of the Galerkin coordinates, residuals come out near 1e-3.
    """

    A: Array  # (2 n, 2 n)
    B: Array  # (2 n, n_u)
    positions: Array  # (coordinates, n): q = positions x[:n]
    velocities: Array  # (coordinates, n): q' = velocities x[n:]
    output_gram: Array  # H'H of (22), (2 n, 2 n)


def _modal_form(system: SecondOrderSystem, output_weight: OutputWeight, position_states: int) -> _ModalForm:
    # 1/omega^2 as eigenvalues: the low modes, which matter, are then the accurate ones
    inverse_squares, mode_shapes = eigh(system.M, system.K)
    n = len(inverse_squares)
    if output_weight == "energy":
        n = min(n, max(ENERGY_MODES, int(np.ceil(ENERGY_RESERVE * position_states))))
    omega = 1 / np.sqrt(inverse_squares[::-1][:n])
    mode_shapes = mode_shapes[:, ::-1][:, :n] * omega  # mass-normalised
    A = np.block([[np.zeros((n, n)), np.diag(omega)], [-np.diag(omega), -mode_shapes.T @ system.D @ mode_shapes]])
    B = np.vstack([np.zeros((n, system.L.shape[1])), mode_shapes.T @ system.L])
    positions = mode_shapes / omega
    output_gram = np.eye(2 * n)
    if output_weight == "identity":
        output_gram[:n, :n], output_gram[n:, n:] = positions.T @ positions, mode_shapes.T @ mode_shapes
    return _ModalForm(A=A, B=B, positions=positions, velocities=mode_shapes, output_gram=output_gram)


@dataclass(frozen=True, kw_only=True)
class _Projection:
    """T = diag(T_p, T_v) in canonical coordinates."""

    right: Array  # T (2 n, 2 k)
    left: Array  # its left inverse (2 k, 2 n)
    sigma_p: Array  # (n,), all singular values (25)
    sigma_v: Array  # (n,)
    position: Coordinates
    velocity: Coordinates
    residual: float  # of the Lyapunov equations, relative


def _projection(form: _ModalForm, stations: Array, states: int) -> _Projection:
    """Balances both blocks (25)-(28); deflections stations @ q, stations (l, coordinates), fix the coordinates."""
    controllability, observability, residual = _gramians(form.A, form.B, form.output_gram)
    n = form.positions.shape[1]
    blocks = []
    for block, maps in ((slice(0, n), form.positions), (slice(n, 2 * n), form.velocities)):
        right, left, sigma = _balance(controllability[block, block], observability[block, block], states)
        coordinates = canonical_coordinates(sigma, stations @ (maps @ right))
        blocks.append((right @ coordinates.rotation, coordinates.rotation.T @ left, sigma, coordinates))
    (right_p, left_p, sigma_p, position), (right_v, left_v, sigma_v, velocity) = blocks
    return _Projection(
        right=_block_diagonal(right_p, right_v),
        left=_block_diagonal(left_p, left_v),
        sigma_p=sigma_p,
        sigma_v=sigma_v,
        position=position,
        velocity=velocity,
        residual=residual,
    )


def _balance(controllability: Array, observability: Array, states: int) -> tuple[Array, Array, Array]:
    """T (n, states), its left inverse (states, n), and all singular values of (25), (27)."""
    factor_c, factor_o = _factor(controllability), _factor(observability)
    U, sigma, Vt = svd(factor_o.T @ factor_c)
    if sigma[states - 1] <= sigma[0] * NEGLIGIBLE_HANKEL:
        raise DesignError(
            f"reduced_modes retains position or velocity state {states}, whose Hankel singular value "
            f"{sigma[states - 1]:.3g} vanishes beside the first, {sigma[0]:.3g}; use fewer modes"
        )
    scale = 1 / np.sqrt(sigma[:states])
    return factor_c @ Vt[:states].T * scale, (factor_o @ U[:, :states] * scale).T, sigma


def _factor(gramian: Array) -> Array:
    """R with R R' = gramian (n, n); negative eigenvalues are rounding and set to zero."""
    values, vectors = eigh((gramian + gramian.T) / 2)
    root: Array = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _relative(residual: Array, constant: Array) -> float:
    return float(np.linalg.norm(residual + constant) / np.linalg.norm(constant))


def _require_states(position_states: int, modes: int, beams: int) -> None:
    if not 1 <= position_states <= modes:
        raise DesignError(
            f"reduced_modes must be 1 to {modes // beams}, modes of each beam (the model has {modes} for {beams} "
            f"beams), got {position_states / beams:g}"
        )


def _require_damped(A: Array) -> None:
    eigenvalues = np.linalg.eigvals(A)
    least = eigenvalues[np.argmax(eigenvalues.real / np.abs(eigenvalues))]
    if least.real > -1e-9 * abs(least):
        raise DesignError(
            f"the mode at {abs(least):.6g} rad/s is not damped, as balanced truncation requires; give "
            "the structure damping"
        )


def _overdamped(system: SecondOrderSystem) -> str:
    """The modes without oscillation, with their damping ratios, as the cause of an unstable reduced model."""
    squares, shapes = eigh(system.K, system.M)
    frequencies = np.sqrt(np.maximum(squares, np.finfo(float).tiny))
    ratios = np.einsum("nk,nm,mk->k", shapes, system.D, shapes) / (2 * frequencies)
    modes = [f"{ratios[k]:.3g} at {frequencies[k]:.4g} rad/s" for k in np.flatnonzero(ratios > 1)]
    if not modes:
        return ""
    more = f" and {len(modes) - 3} more" if len(modes) > 3 else ""
    return f"; probably because of overdamped modes (damping ratio {', '.join(modes[:3])}{more}): lower the damping, or"


def _require_stable(A: Array, position_states: int, system: SecondOrderSystem) -> None:
    eigenvalues = np.linalg.eigvals(A)
    worst = eigenvalues[np.argmax(eigenvalues.real)]
    if worst.real >= 0:
        raise DesignError(
            f"the reduced model with {position_states} position states is not stable: eigenvalue "
            f"{worst.real:.6g}{worst.imag:+.6g}j 1/s{_overdamped(system) or ';'} change reduced_modes, output_weight "
            "or the basis"
        )
