"""One design, computed once: structure and options -> everything that the units carry."""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flexbeams.controller.flatness import cancellation_ratio, flat_parameterisation, tabulate_input_shapes
from flexbeams.controller.kalman import hankel_weights, predictor_gain
from flexbeams.controller.lqr import lqr_gain
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reduction import ReducedModel, reduce
from flexbeams.controller.summary import design_summary
from flexbeams.controller.transition import transition_of_order
from flexbeams.plant.archive import array_bytes
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.energy import discretise
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.galerkin import BasisName, BeamModel, beam_model
from flexbeams.plant.statespace import static_gains
from flexbeams.plant.structure import Structure

METHOD = 2  # version of the method; raised by every change that changes a design beyond rounding


@dataclass(frozen=True, kw_only=True)
class Design:
    """A finished design. Shapes: m = 2 r N_r states, n_u inputs, n_pi points, n_pm gauges."""

    structure: Structure
    options: DesignOptions
    summary: dict[str, Any]  # figures for people and for --json
    arrays: dict[str, Array]  # the numbers that the units compute with, by name; see compute_design
    design_id: str  # see identify

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
    try:
        model = beam_model(structure, options.basis, options.basis_order)
    except InputError as error:
        raise DesignError(str(error)) from None
    system = model.assemble()
    reduced = reduce(
        model,
        system,
        position_states=options.reduced_modes * len(structure.beam),
        output_weight=options.balanced_norm,
        static_correction=options.static_correction,
    )
    motion, cancellation = _motion_arrays(reduced, options)
    arrays = {
        **_model_arrays(reduced),
        **_control_arrays(reduced, options),
        "static_inverse": _static_inverse(model, system, reduced, options),
        **motion,
    }
    summary = design_summary(model, system, reduced, options, arrays)
    summary["flatness_cancellation"] = cancellation
    reliable = reduced.position_coordinates.reliable and reduced.velocity_coordinates.reliable
    design_id = identify(structure, options, None if reliable else arrays)
    return Design(structure=structure, options=options, summary=summary, arrays=arrays, design_id=design_id)


def _model_arrays(reduced: ReducedModel) -> dict[str, Array]:
    names = ("A", "B", "H_pi", "H_pm", "D_pi", "D_pm", "H_w", "D_w")
    return {name: getattr(reduced, name) for name in names}


def _control_arrays(reduced: ReducedModel, options: DesignOptions) -> dict[str, Array]:
    """The sampled model (41) with the gains of filter (42), (46) and regulator (44), (47)."""
    weights, k = options.weights, reduced.position_states
    A_d, B_d = discretise(reduced.A, reduced.B, options.sample_time)
    sigma = reduced.hankel_position[:k], reduced.hankel_velocity[:k]
    rotation = reduced.rotation
    Q_o = hankel_weights(
        *sigma, total=weights.kalman_q_total, position=weights.kalman_q_position, velocity=weights.kalman_q_velocity
    )
    Q_c = hankel_weights(
        *sigma, total=weights.lqr_q_total, position=weights.lqr_q_position, velocity=weights.lqr_q_velocity
    )
    R_o = weights.kalman_measurement * np.eye(len(reduced.H_pm))
    R_c = weights.lqr_input * np.eye(B_d.shape[1])
    return {
        "A_d": A_d,
        "B_d": B_d,
        "estimator_gain": predictor_gain(A_d, reduced.H_pm, rotation.T @ np.diag(Q_o) @ rotation, R_o),
        "feedback_gain": lqr_gain(A_d, B_d, rotation.T @ np.diag(Q_c) @ rotation, R_c),
    }


def _static_inverse(
    model: BeamModel, system: SecondOrderSystem, reduced: ReducedModel, options: DesignOptions
) -> Array:
    """G_0^+ (n_u, n_pi), V/m: voltages that hold deflections at rest."""
    if options.static_gain == "full":
        gain, _ = static_gains(model, system)
    else:
        gain = reduced.static_gain()[0] + reduced.D_pi
    return np.asarray(np.linalg.pinv(gain), dtype=np.float64)


def _motion_arrays(reduced: ReducedModel, options: DesignOptions) -> tuple[dict[str, Array], float]:
    """The flat parameterisation (34)-(36), the planner's table and the transition (37); the cancellation ratio."""
    flat = flat_parameterisation(reduced)
    transition = transition_of_order(options.gevrey_order)
    slowest = float(np.min(np.abs(np.linalg.eigvals(reduced.A))))
    shapes = tabulate_input_shapes(flat, transition, slowest)
    arrays = {
        "input_series": flat.input,
        "state_series": flat.state,
        "shape_times": shapes.times,
        "shape_values": shapes.values,
        "transition_table": transition.table,
        "transition_constants": np.array([transition.exponent, transition.norm]),
    }
    return arrays, cancellation_ratio(flat, transition, options.transition_time)


def identify(structure: Structure, options: DesignOptions, arrays: dict[str, Array] | None = None) -> str:
    """The design_id: a hash of structure, options and METHOD, equal on every machine.

    Designs with equal ids fit each other: their arrays agree to about 1e-9. Where the truncation separates nearly
    equal singular values they do not, and a fingerprint of `arrays` follows the hash.
    """
    text = json.dumps({"method": METHOD, "structure": asdict(structure), "options": asdict(options)}, sort_keys=True)
    name = hashlib.sha256(text.encode()).hexdigest()[:32]
    return name if arrays is None else f"{name}-{fingerprint(arrays)[:8]}"


def fingerprint(arrays: dict[str, Array]) -> str:
    """Hash of every array's bytes: different where a linear algebra library rounds differently."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(name.encode())
        digest.update(array_bytes(arrays[name]))
    return digest.hexdigest()
