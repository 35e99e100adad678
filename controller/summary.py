"""Figures of a design for people and for --json."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reduction import ReducedModel
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.statespace import Spectrum, static_gains


def design_summary(
    model: BeamModel,
    system: SecondOrderSystem,
    spectrum: Spectrum,
    reduced: ReducedModel,
    options: DesignOptions,
    arrays: dict[str, Array],
) -> dict[str, Any]:
    """Sizes, frequencies (rad/s), spectra (1/s), singular values and static gains (m/V, 1/V), in JSON's types."""
    full_pi, full_pm = static_gains(model, system)
    reduced_pi, reduced_pm = reduced.static_gain()
    step, A_d, B_d = options.sample_time, arrays["A_d"], arrays["B_d"]
    return {
        "beams": len(model.structure.beam),
        "inputs": B_d.shape[1],
        "points_of_interest": len(full_pi),
        "strain_gauges": len(full_pm),
        "parameters": len(model.structure.parameters()),
        "basis": model.basis,
        "order": model.order,
        "full_order": 2 * model.size,
        "reduced_order": len(reduced.A),
        "frequencies": spectrum.frequencies.tolist(),
        "damping_ratios": _damping_ratios(spectrum.frequencies, spectrum.oscillating),
        "damped_eigenvalues": [[float(v.real), float(v.imag)] for v in spectrum.oscillating],
        "real_eigenvalues": spectrum.real.tolist(),
        "hankel_position": reduced.hankel_position.tolist(),
        "hankel_velocity": reduced.hankel_velocity.tolist(),
        "hankel_share": reduced.hankel_share,
        "state_groups": {
            "position": list(reduced.position_coordinates.groups),
            "velocity": list(reduced.velocity_coordinates.groups),
        },
        "truncation_gap": min(reduced.position_coordinates.truncation_gap, reduced.velocity_coordinates.truncation_gap),
        "lyapunov_residual": reduced.residual,
        "reduced_eigenvalues": _spectrum(reduced.A),
        "static_gain_pi": full_pi.tolist(),
        "static_gain_pm": full_pm.tolist(),
        "static_gain_reduced_pi": reduced_pi.tolist(),
        "static_gain_reduced_pm": reduced_pm.tolist(),
        "estimator_eigenvalues": _sampled_spectrum(A_d - arrays["estimator_gain"] @ arrays["H_pm"], step),
        "feedback_eigenvalues": _sampled_spectrum(A_d - B_d @ arrays["feedback_gain"], step),
    }


def _damping_ratios(frequencies: Array, oscillating: NDArray[np.complex128]) -> list[float | None]:
    """The damping ratio of the mode of each undamped frequency; None where the mode is overdamped.

    Each eigenvalue above the real axis belongs to the frequency nearest to its magnitude.
    """
    distance = np.abs(np.log(np.abs(oscillating))[:, None] - np.log(frequencies))
    ratios: list[float | None] = [None] * len(frequencies)
    for mode, frequency in zip(*linear_sum_assignment(distance), strict=True):
        value = oscillating[mode]
        ratios[frequency] = float(-value.real / abs(value))
    return ratios


def _spectrum(matrix: Array) -> list[list[float]]:
    """Eigenvalues as [real, imaginary] in 1/s, by magnitude."""
    values = np.linalg.eigvals(matrix)
    return [[float(v.real), float(v.imag)] for v in sorted(values, key=lambda v: (abs(v), v.imag))]


def _sampled_spectrum(matrix: Array, step: float) -> list[list[float]]:
    """Eigenvalues of a discrete-time matrix as [real, imaginary] in 1/s, the slowest first."""
    values = np.log(np.linalg.eigvals(matrix).astype(complex)) / step
    return [[float(v.real), float(v.imag)] for v in sorted(values, key=lambda v: (-v.real, v.imag))]
