"""The loop that is really closed: the sampled controller of the reduced model on a full plant, with its real delay.

Separation of filter and regulator holds for the reduced model only. Saturation is left out; everything is linear.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexbeams.controller.frequency import Complex
from flexbeams.controller.observer import tick_matrices
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.damped_modes import damped_modes
from flexbeams.plant.energy import discretise, energy_form
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.statespace import undamped_modes


@dataclass(frozen=True, kw_only=True)
class SampledPlant:
    """x+ = A x + B u, y_pi = H_pi x + D_pi u, y_pm = H_pm x + D_pm u, voltages held over a sample.

    D_pi and D_pm stand for removed modes, which are taken to be at rest; they are zero where no mode was removed.
    """

    A: Array  # (n, n)
    B: Array  # (n, n_u)
    H_pi: Array  # (n_pi, n), m
    H_pm: Array  # (n_pm, n), 1
    D_pi: Array  # (n_pi, n_u), m/V
    D_pm: Array  # (n_pm, n_u), 1/V
    step: float  # s
    eigenvalues: Complex | None = None  # (n,) of A, where they are known

    def poles(self) -> Complex:
        """Eigenvalues (n,) of A."""
        return np.linalg.eigvals(self.A).astype(np.complex128) if self.eigenvalues is None else self.eigenvalues


def sampled_plant(model: BeamModel, step: float, parameters: dict[str, float] | None = None) -> SampledPlant:
    """The full plant, exact for voltages held over `step` s; `parameters` in place of the structure's.

    Raises DesignError where these make its mass or stiffness matrix not positive definite.
    """
    system = model.assemble(parameters)
    if plant := _modal_plant(model, system, step):
        return plant
    form = energy_form(system.M, system.D, system.K, system.L)
    A, B = discretise(form.A, form.B, step)
    return _without_feedthrough(A, B, form.outputs(model.deflection), form.outputs(model.strain), step)


def _modal_plant(model: BeamModel, system: SecondOrderSystem, step: float) -> SampledPlant | None:
    """The full plant in the real and imaginary parts of its damped modes; None where these are not found by iteration.

    A consists of four diagonals. In thousands of states that is a tenth of the work of a matrix exponential.
    """
    undamped = undamped_modes(system)
    modes = damped_modes(undamped.frequencies, undamped.damping(system))
    if modes is None:
        return None
    n, states = len(undamped.frequencies), modes.state_vectors()
    rest = np.vstack([undamped.positions.T @ system.L, np.zeros_like(system.L)])
    real, imaginary = np.split(np.linalg.solve(np.hstack([states.real, -states.imag]), rest), 2)
    growth = np.exp(modes.eigenvalues * step)
    held = -np.expm1(modes.eigenvalues * step)[:, None] * (real + 1j * imaginary)  # the way to rest that a step goes
    A = np.block([[np.diag(growth.real), np.diag(-growth.imag)], [np.diag(growth.imag), np.diag(growth.real)]])
    outputs = [rows @ undamped.positions @ states[:n] for rows in (model.deflection, model.strain)]
    H_pi, H_pm = (np.hstack([parts.real, -parts.imag]) for parts in outputs)
    plant = _without_feedthrough(A, np.vstack([held.real, held.imag]), H_pi, H_pm, step)
    return replace(plant, eigenvalues=np.concatenate([growth, growth.conj()]))


def _without_feedthrough(A: Array, B: Array, H_pi: Array, H_pm: Array, step: float) -> SampledPlant:
    D_pi, D_pm = (np.zeros((len(H), B.shape[1])) for H in (H_pi, H_pm))
    return SampledPlant(A=A, B=B, H_pi=H_pi, H_pm=H_pm, D_pi=D_pi, D_pm=D_pm, step=step)


@dataclass(frozen=True, kw_only=True)
class SampledController:
    """s+ = A s + B y_pm, u = C s: filter, regulator and integral as one system from strains to voltages.

    s = (estimate, zeta, u). The voltage of t_k is part of the state: it was computed from the strains of t_{k-1} (42c).
    zeta are coordinates of the integral within the range of G_0^+ [H_pi, D_pi]; outside it (45) never moves it.
    """

    A: Array  # (n_s, n_s)
    B: Array  # (n_s, n_pm), V
    C: Array  # (n_u, n_s), V


def sampled_controller(arrays: Mapping[str, Array], integral_gain: float) -> SampledController:
    """The controller of a design with references and feedforward at zero (42c), (44), (45).

    With the matrices of a tick (see observer): z+ = filter (z, u, y_pm), u+ = i - K z+,
    i+ = i - k_I G_0^+ (H_pi z+ + D_pi u).
    """
    tick = tick_matrices(arrays)
    m, (n_u, n_pm) = len(tick.filter), (len(tick.regulator) // 2, arrays["estimator_gain"].shape[1])
    K, G_H, G_D = tick.regulator[:n_u, :m], tick.regulator[n_u:, :m], tick.regulator[n_u:, m:]
    of_state, of_voltage, of_strain = np.split(tick.filter, [m, m + n_u], axis=1)
    range_basis = _range_basis(tick.regulator[n_u:]) if integral_gain > 0 else np.zeros((n_u, 0))
    k = range_basis.shape[1]
    z, zeta, u = slice(0, m), slice(m, m + k), slice(m + k, m + k + n_u)
    A = np.zeros((m + k + n_u, m + k + n_u))
    B = np.zeros((m + k + n_u, n_pm))
    A[z, z], A[z, u], B[z] = of_state, of_voltage, of_strain
    A[u, z], A[u, u], B[u] = -K @ of_state, -K @ of_voltage, -K @ of_strain
    A[u, zeta] = range_basis
    growth = -integral_gain * range_basis.T
    A[zeta, z], A[zeta, u], B[zeta] = (
        growth @ G_H @ of_state,
        growth @ (G_H @ of_voltage + G_D),
        growth @ G_H @ of_strain,
    )
    A[zeta, zeta] = np.eye(k)
    C = np.zeros((n_u, m + k + n_u))
    C[:, u] = np.eye(n_u)
    return SampledController(A=A, B=B, C=C)


def _range_basis(G: Array) -> Array:
    """Orthonormal basis (n, rank) of the range of G (n, k)."""
    U, sigma, _ = np.linalg.svd(G)
    rank = int(np.count_nonzero(sigma > 1e-9 * max(sigma[0], np.finfo(float).tiny)))
    return np.asarray(U[:, :rank], dtype=np.float64)


def closed_loop_matrix(controller: SampledController, plant: SampledPlant, extra_delay: int = 0) -> Array:
    """(n, n) of the loop's state (plant, controller, delayed voltages); `extra_delay` counts samples."""
    n, n_s, n_u = len(plant.A), len(controller.A), plant.B.shape[1]
    size = n + n_s + extra_delay * n_u
    loop = np.zeros((size, size))
    loop[:n, :n] = plant.A
    loop[n : n + n_s, :n] = controller.B @ plant.H_pm
    loop[n : n + n_s, n : n + n_s] = controller.A
    last = slice(n, n + n_s) if extra_delay == 0 else slice(size - n_u, size)
    voltage = controller.C if extra_delay == 0 else np.eye(n_u)  # of the state `last`, as it reaches the plant
    loop[:n, last] = plant.B @ voltage
    loop[n : n + n_s, last] += controller.B @ plant.D_pm @ voltage
    if extra_delay == 0:
        return loop
    queue = n + n_s
    loop[queue : queue + n_u, n : n + n_s] = controller.C
    for k in range(1, extra_delay):
        here = queue + k * n_u
        loop[here : here + n_u, here - n_u : here] = np.eye(n_u)
    return loop


def closed_loop_poles(controller: SampledController, plant: SampledPlant, extra_delay: int = 0) -> Complex:
    """Poles of the loop in 1/s, log(z) / step, the least stable first; stable ones have negative real parts."""
    eigenvalues = np.linalg.eigvals(closed_loop_matrix(controller, plant, extra_delay))
    return poles_of(eigenvalues.astype(np.complex128), plant.step)


def poles_of(eigenvalues: Complex, step: float) -> Complex:
    """Poles in 1/s, log(z) / step, of the eigenvalues z of a sampled system, the least stable first."""
    values = np.where(np.abs(eigenvalues) < 1e-300, 1e-300, eigenvalues)  # at z = 0, in one sample
    poles = np.log(values) / step
    return np.asarray(poles[np.argsort(-poles.real)], dtype=np.complex128)
