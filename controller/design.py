"""One design, computed once: structure and options -> everything that the units carry, one file, one hash."""

import hashlib
import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass as checked_dataclass

from flexbeams.controller.flatness import cancellation, flat_parameterisation, tabulate_input_shapes
from flexbeams.controller.kalman import predictor_gain, process_noise
from flexbeams.controller.lqr import lqr_gain
from flexbeams.controller.reduction import OutputWeight, ReducedModel, reduce
from flexbeams.controller.transition import LOWEST_ORDER, transition_of_order
from flexbeams.plant.archive import array_bytes, npz_bytes, read_arrays, write_whole
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.energy import discretise
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.galerkin import DEFAULT_ORDER, BasisName, BeamModel, beam_model
from flexbeams.plant.statespace import state_matrices, static_gains, undamped_frequencies
from flexbeams.plant.structure import Structure
from flexbeams.plant.validation import TABLE, Index, Positive, checked

FORMAT = 1  # of the design file


@checked_dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class Weights:
    """Weights (46), (47) of filter and regulator; the defaults are the published ones."""

    kalman_measurement: Positive = 20.0  # R_o / I, strain^2 in SI
    kalman_q_total: Positive = 50.0
    kalman_q_position: Positive = 5e3
    kalman_q_velocity: Positive = 10.0
    lqr_input: Positive = 0.01  # R_c / I
    lqr_q_total: Positive = 200.0
    lqr_q_position: Positive = 10.0
    lqr_q_velocity: Positive = 1e-3


@checked_dataclass(frozen=True, slots=True, kw_only=True, config=TABLE)
class DesignOptions:
    """What a designer chooses; the defaults are the paper's but for the static correction."""

    basis: BasisName = "clamped_free"
    order: Index | None = None  # modes of a beam, or polynomial degree; default 10 or 9
    reduced_modes: Index = 5  # N_r: position and velocity states kept of each beam
    output_weight: OutputWeight | None = None  # default: identity for clamped_free, energy for segment
    static_correction: Annotated[bool, Field(strict=True)] = True  # direct terms that carry the truncated modes at rest
    static_gain: Literal["full", "reduced"] = "full"  # which DC gain turns a target into the flat output
    sample_time: Positive = 2e-4  # s
    transition_time: Annotated[float, Field(ge=1e-3, le=1e4, strict=True)] = 0.9  # s, as the unit's bounds
    gevrey_order: Annotated[float, Field(ge=LOWEST_ORDER, lt=2, strict=True)] = 1.9
    voltage_limit: Positive = 1000.0  # V
    integral_gain: Annotated[float, Field(ge=0, le=1, strict=True)] = 1e-4  # k_I of (45), a sample
    weights: Weights = field(default_factory=Weights)


@dataclass(frozen=True, kw_only=True)
class Design:
    """A finished design. Shapes: m = 2 r N_r states, n_u inputs, n_pi points, n_pm gauges."""

    structure: Structure
    options: DesignOptions
    summary: dict[str, Any]  # figures for people and for --json
    arrays: dict[str, Array]  # what the units compute with, by name; see compute_design
    design_id: str  # hash of all of the above

    def model(self, basis: BasisName | None = None, order: int | None = None) -> BeamModel:
        """The plant's model: of the design's own basis, or another one of the same structure."""
        if basis is None or basis == self.options.basis:
            return beam_model(self.structure, self.options.basis, order or self.options.order)
        return beam_model(self.structure, basis, order)


def compute_design(structure: Structure, options: DesignOptions | None = None) -> Design:
    """Reduction, flatness coefficients, filter and regulator of a structure.

    Arrays: A, B, H_pi, H_pm, H_w, D_pi, D_pm, D_w (reduced, continuous); A_d, B_d (sampled); estimator_gain
    (m, n_pm), feedback_gain (n_u, m), static_inverse (n_u, n_pi) V/m; input_series (m + 1,), state_series (m, m, n_u);
    shape_times, shape_values; transition_table, transition_constants (exponent, norm).
    Raises DesignError where a step has no acceptable result.
    """
    options = options or DesignOptions()
    weights, kept = options.weights, options.reduced_modes * len(structure.beam)
    order = DEFAULT_ORDER[options.basis] if options.order is None else options.order
    try:
        model = beam_model(structure, options.basis, order)
    except InputError as error:
        raise DesignError(str(error)) from None
    system = model.assemble()
    output_weight = options.output_weight or ("energy" if options.basis == "segment" else "identity")
    reduced = reduce(model, system, kept=kept, output_weight=output_weight, static_correction=options.static_correction)
    A_d, B_d = discretise(reduced.A, reduced.B, options.sample_time)
    zeta = reduced.hankel_position[:kept], reduced.hankel_velocity[:kept]
    Q_o = np.diag(
        process_noise(
            *zeta, total=weights.kalman_q_total, position=weights.kalman_q_position, velocity=weights.kalman_q_velocity
        )
    )
    Q_c = np.diag(
        process_noise(
            *zeta, total=weights.lqr_q_total, position=weights.lqr_q_position, velocity=weights.lqr_q_velocity
        )
    )
    n_u, n_pm = B_d.shape[1], len(reduced.H_pm)
    estimator_gain = predictor_gain(A_d, reduced.H_pm, Q_o, weights.kalman_measurement * np.eye(n_pm))
    feedback_gain = lqr_gain(A_d, B_d, Q_c, weights.lqr_input * np.eye(n_u))
    flat = flat_parameterisation(reduced)
    transition = transition_of_order(options.gevrey_order)
    eigenvalues = np.linalg.eigvals(reduced.A)
    shapes = tabulate_input_shapes(flat, transition, float(np.min(np.abs(eigenvalues))))
    gain_full, _ = static_gains(model, system)
    gain = gain_full if options.static_gain == "full" else reduced.static_gain()[0] + reduced.D_pi
    arrays = {
        "A": reduced.A,
        "B": reduced.B,
        "H_pi": reduced.H_pi,
        "H_pm": reduced.H_pm,
        "D_pi": reduced.D_pi,
        "D_pm": reduced.D_pm,
        "H_w": reduced.H_w,
        "D_w": reduced.D_w,
        "A_d": A_d,
        "B_d": B_d,
        "estimator_gain": estimator_gain,
        "feedback_gain": feedback_gain,
        "static_inverse": np.linalg.pinv(gain),
        "input_series": flat.input,
        "state_series": flat.state,
        "shape_times": shapes.times,
        "shape_values": shapes.values,
        "transition_table": transition.table,
        "transition_constants": np.array([transition.exponent, transition.norm]),
    }
    summary = _summary(model, system, reduced, options, kept, arrays)
    summary["flatness_cancellation"] = cancellation(flat, transition, options.transition_time)
    return _identified(structure, options, summary, arrays)


def _summary(
    model: BeamModel,
    system: SecondOrderSystem,
    reduced: ReducedModel,
    options: DesignOptions,
    kept: int,
    arrays: dict[str, Array],
) -> dict[str, Any]:
    """Figures of a design, in JSON's types."""
    modes = np.linalg.eigvals(state_matrices(system)[0])
    modes = modes[modes.imag >= 0]
    modes = modes[np.argsort(np.abs(modes))]
    full_pi, full_pm = static_gains(model, system)
    red_pi, red_pm = reduced.static_gain()
    step = options.sample_time

    def spectrum(matrix: Array) -> list[list[float]]:
        values = np.linalg.eigvals(matrix)
        return [[float(v.real), float(v.imag)] for v in sorted(values, key=lambda v: (abs(v), v.imag))]

    def sampled(matrix: Array) -> list[list[float]]:
        values = np.log(np.linalg.eigvals(matrix).astype(complex)) / step
        return [[float(v.real), float(v.imag)] for v in sorted(values, key=lambda v: (-v.real, v.imag))]

    A_d, B_d = arrays["A_d"], arrays["B_d"]
    return {
        "beams": len(model.structure.beam),
        "inputs": B_d.shape[1],
        "points_of_interest": len(full_pi),
        "strain_gauges": len(full_pm),
        "parameters": len(model.structure.parameters()),
        "basis": model.basis,
        "order": model.order,
        "full_order": 2 * model.size,
        "reduced_order": 2 * kept,
        "frequencies": undamped_frequencies(system).tolist(),
        "damping_ratios": (-modes.real / np.abs(modes)).tolist(),
        "damped_eigenvalues": [[float(v.real), float(v.imag)] for v in modes],
        "hankel_position": reduced.hankel_position.tolist(),
        "hankel_velocity": reduced.hankel_velocity.tolist(),
        "hankel_share": reduced.share,
        "lyapunov_residual": reduced.residual,
        "reduced_eigenvalues": spectrum(reduced.A),
        "static_gain_pi": full_pi.tolist(),
        "static_gain_pm": full_pm.tolist(),
        "static_gain_reduced_pi": red_pi.tolist(),
        "static_gain_reduced_pm": red_pm.tolist(),
        "estimator_eigenvalues": sampled(A_d - arrays["estimator_gain"] @ arrays["H_pm"]),
        "feedback_eigenvalues": sampled(A_d - B_d @ arrays["feedback_gain"]),
    }


def _identified(
    structure: Structure, options: DesignOptions, summary: dict[str, Any], arrays: dict[str, Array]
) -> Design:
    """The design with its hash, over the structure, the options and every array's bytes."""
    digest = hashlib.sha256(_meta(structure, options).encode())
    for name in sorted(arrays):
        digest.update(name.encode())
        digest.update(array_bytes(arrays[name]))
    return Design(
        structure=structure, options=options, summary=summary, arrays=arrays, design_id=digest.hexdigest()[:32]
    )


def _meta(structure: Structure, options: DesignOptions, **more: Any) -> str:
    return json.dumps(
        {"format": FORMAT, "structure": asdict(structure), "options": asdict(options), **more}, sort_keys=True
    )


def write_design(design: Design, path: Path) -> None:
    """Writes the design file: a NumPy archive of the arrays and a JSON text `meta`; same design, same bytes."""
    meta = np.array(_meta(design.structure, design.options, summary=design.summary, design_id=design.design_id))
    write_whole(path, npz_bytes({**design.arrays, "meta": meta}))


def read_design(path: Path) -> Design:
    """The design in a file; InputError where it is not a design file of this format or was altered."""
    arrays, source = read_arrays(path), str(path)
    try:
        meta = json.loads(str(arrays.pop("meta")))
        known, structure, options, summary, design_id = (
            meta[key] for key in ("format", "structure", "options", "summary", "design_id")
        )
    except (KeyError, TypeError, json.JSONDecodeError):
        raise InputError("", "is not a flexbeams design file", source=source) from None
    if known != FORMAT:
        raise InputError("format", f"must be {FORMAT}; make the design again", known, source=source)
    design = _identified(
        checked(Structure, structure, source), checked(DesignOptions, options, source), summary, arrays
    )
    if design.design_id != design_id:
        raise InputError(
            "design_id",
            f"must be {design.design_id}, the hash of the contents: the file was altered",
            design_id,
            source=source,
        )
    return design
