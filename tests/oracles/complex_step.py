"""Responses of the Galerkin model by matrix exponentials in complex numbers, and derivatives from imaginary parts.

f(p + i h) = f(p) + i h f'(p) + O(h^2): with h = 1e-30 the imaginary part is h f' to rounding (Squire and Trapp 1998).
Matrices are assembled term by term and stepped sample by sample, so nothing is shared with the modal form.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.identification.experiment import Experiment

Complex = NDArray[np.complex128]
STEP = 1e-30


def response(
    model: BeamModel,
    experiment: Experiment,
    values: dict[str, complex],
    *,
    delay: complex = 0.0,
    loads: Complex | None = None,
) -> Complex:
    """Outputs (n_s, rows), every sensor late by `delay`; loads (2 r,) are released tip forces, then impulses."""
    n, r = model.size, len(model.tips)
    M, D, K = (np.zeros((n, n), dtype=complex) for _ in range(3))
    L = np.zeros((n, experiment.voltages.shape[1]), dtype=complex)
    for term in model.terms:
        rows = slice(term.start, term.start + len(term.block))
        if term.matrix == "L":
            L[rows, term.column] += values[term.parameter] * term.block[:, 0]
        else:
            {"M": M, "D": D, "K": K}[term.matrix][rows, rows] += values[term.parameter] * term.block
    # Coordinates in which the real parts of M and K are unit matrix and diagonal, for a well-scaled exponential
    _, shapes = np.linalg.eigh(
        np.linalg.solve(np.linalg.cholesky(M.real), np.linalg.solve(np.linalg.cholesky(M.real), K.real).T)
    )
    shapes = np.linalg.solve(np.linalg.cholesky(M.real).T, shapes)
    omega = np.sqrt(np.diag(shapes.T @ K.real @ shapes))
    M, D, K, L, F = (
        shapes.T @ M @ shapes,
        shapes.T @ D @ shapes,
        shapes.T @ K @ shapes,
        shapes.T @ L,
        shapes.T @ model.tips.T,
    )
    inverse = np.linalg.inv(M)
    inputs = np.hstack([L, F])
    A = np.block([[np.zeros((n, n)), np.diag(omega)], [-inverse @ K / omega, -inverse @ D]])
    B = np.vstack([np.zeros_like(inputs), inverse @ inputs])
    C = np.hstack(
        [
            np.vstack([model.deflection, model.strain])[list(experiment.sensors)] @ shapes / omega,
            np.zeros((len(experiment.sensors), n)),
        ]
    )
    forces = np.zeros((experiment.rows, r)) if experiment.forces is None else experiment.forces
    u = np.hstack([experiment.voltages, forces])
    rest = np.zeros(u.shape[1], dtype=complex)
    if experiment.rest_voltages is not None:
        rest[: L.shape[1]] = experiment.rest_voltages
    impulse = np.zeros(r, dtype=complex)
    if loads is not None:
        rest[L.shape[1] :] += loads[:r]
        impulse = loads[r:]
    before = -np.linalg.solve(A, B @ rest)
    x = before + B @ np.concatenate([np.zeros(L.shape[1]), impulse])
    samples = int(np.ceil(delay.real / experiment.step - 1e-9)) if delay != 0 else 0
    whole, part = _hold(A, B, experiment.step), _hold(A, B, samples * experiment.step - delay)
    states = []
    for row in u:
        states.append(part[0] @ x + part[1] @ row)
        x = whole[0] @ x + whole[1] @ row
    shifted = [before] * samples + states[: len(states) - samples]
    y: Complex = C @ np.array(shifted).T
    return y


def _hold(A: Complex, B: Complex, step: complex) -> tuple[Complex, Complex]:
    n, m = B.shape
    big = np.zeros((n + m, n + m), dtype=complex)
    big[:n, :n], big[:n, n:] = A * step, B * step
    exponential = expm(big)
    return exponential[:n, :n], exponential[:n, n:]
