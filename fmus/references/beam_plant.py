"""Reference results of BeamPlant, by damped modes that come from undamped ones, not by QR as in the kernels."""

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.fmus.references.experiments import Experiment, Series, alternating, jumps, names_of
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.damped_modes import ComplexArray, damped_modes, modal_matrix
from flexbeams.plant.galerkin import BeamModel


def plant_experiments(design: Design, model: BeamModel) -> list[Experiment]:
    """Steps of the voltages and pushes at the tips; a release of a structure with other parameters."""
    step, structure = design.options.sample_time, model.structure
    stride = max(1, round(0.002 / step))
    ticks = stride * np.arange(101.0)
    n_u, r = len(structure.patch), len(structure.beam)
    names = (*names_of("y_pi", len(model.deflection)), *names_of("y_pm", len(model.strain)))
    voltage = alternating(n_u, 0.4 * design.options.voltage_limit)
    inputs = np.zeros((4, n_u + r))
    inputs[1:, :n_u] = voltage
    inputs[2, n_u:] = alternating(r, 0.05)
    starts = stride * np.array([0.0, 1.0, 50.0, 52.0])
    rows, time = np.vstack([model.deflection, model.strain]), step * ticks
    moving = plant_response(model.assemble(), rows, step * starts, inputs, time)
    changed = _changed(structure.parameters())
    at_rest = np.zeros(1), np.zeros((1, n_u + r))
    released = plant_response(model.assemble(changed), rows, *at_rest, time, at_rest_under=voltage)
    return [
        Experiment(
            name="step_and_push",
            step=step,
            steps=int(ticks[-1]),
            description="Voltages step, then the tips are pushed for a moment",
            stimuli=jumps((*names_of("u", n_u), *names_of("force", r)), step * starts, inputs, time[-1]),
            references=Series(names=names, time=time, values=moving),
        ),
        Experiment(
            name="release",
            step=step,
            steps=int(ticks[-1]),
            description="A structure with other parameters swings freely from rest under voltages",
            parameters={**changed, **dict(zip(names_of("start_at_rest_under", n_u), voltage.tolist(), strict=True))},
            references=Series(names=names, time=time, values=released),
        ),
    ]


def _changed(parameters: dict[str, float]) -> dict[str, float]:
    """Every third parameter, by up to a fifth."""
    return {
        name: float(f"{value * (0.8 + 0.05 * (k % 9)):.4g}")
        for k, (name, value) in enumerate(parameters.items())
        if k % 3 == 0
    }


def plant_response(
    system: SecondOrderSystem,
    rows: Array,
    starts: Array,
    inputs: Array,
    time: Array,
    at_rest_under: Array | None = None,
) -> Array:
    """rows q at `time` (k,) s, (k, len(rows)): inputs (i, n_u + r) of voltages and forces hold from starts (i,) s on.

    x = (Omega eta, eta') of mass-normalised modes moves around its rest position x_s by the eigenvalues of its
    matrix, x(t) = x(start) + Re W (exp(Lambda (t - start)) - 1) z with Re W z = x(start) - x_s. At the first start it
    is at rest under the voltages given (n_u,).
    """
    from scipy.linalg import lu_factor, lu_solve  # only units that are built need it, and the modes

    from flexbeams.plant.statespace import undamped_modes

    n, n_u = system.L.shape
    undamped = undamped_modes(system)
    eigenvalues, W = _eigenvectors(undamped.frequencies, undamped.damping(system))
    pairs = np.flatnonzero(eigenvalues.imag)
    factors = lu_factor(np.hstack([W.real, -W[:, pairs].imag]))
    outputs = rows @ undamped.positions  # of Omega eta
    rest = undamped.positions.T @ np.hstack([system.L, system.F])
    x, z = np.zeros(2 * n), np.zeros(len(eigenvalues), dtype=np.complex128)
    if at_rest_under is not None:
        x[:n] = rest[:, :n_u] @ at_rest_under
    y = np.zeros((len(time), len(rows)))
    for start, end, held in zip(starts, [*starts[1:], np.inf], inputs, strict=True):
        x_s = np.concatenate([rest @ held, np.zeros(n)])
        coordinates = lu_solve(factors, x - x_s)
        z.real, z.imag[pairs] = np.split(coordinates, [len(z)])
        here = (time >= start) & (time < end)
        moved = np.expm1(np.outer(time[here] - start, eigenvalues)) * z
        y[here] = outputs @ x[:n] + (moved @ (outputs @ W[:n]).T).real
        if end < np.inf:
            x = x + (W @ (np.expm1(eigenvalues * (end - start)) * z)).real
    return y


def _eigenvectors(omega: Array, damping: Array) -> tuple[ComplexArray, ComplexArray]:
    """Of [[0, diag(omega)], [-diag(omega), -damping]]: eigenvalues (m,), one of each pair, and vectors (2 n, m)."""
    if modes := damped_modes(omega, damping):
        return modes.eigenvalues, modes.state_vectors()
    values, vectors = np.linalg.eig(modal_matrix(omega, damping))
    one_of_each = values.imag >= 0
    return values[one_of_each].astype(np.complex128), vectors[:, one_of_each].astype(np.complex128)
