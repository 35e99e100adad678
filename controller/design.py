"""One design, computed once: structure and options -> everything that the units carry."""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from flexbeams.controller.flatness import cancellation_ratio, flat_parameterisation, tabulate_input_shapes
from flexbeams.controller.gains import control_arrays, offset_gain
from flexbeams.controller.offsets import OffsetMap, offset_map, uncertainty_of
from flexbeams.controller.options import DesignOptions
from flexbeams.controller.reach import Reach, reach_of
from flexbeams.controller.reduction import ReducedModel, reduce
from flexbeams.controller.retained_modes import missing_mode_warnings
from flexbeams.controller.sampling import sampling_warnings
from flexbeams.controller.statics import Statics, statics_of, with_statics
from flexbeams.controller.structure_checks import structure_warnings
from flexbeams.controller.summary import design_summary
from flexbeams.controller.transition import transition_of_order
from flexbeams.controller.verification import verify_design
from flexbeams.plant.archive import array_bytes
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.choices import BasisName
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.plausibility import implausible_values
from flexbeams.plant.static_sensitivities import static_sensitivities
from flexbeams.plant.structure import Structure
from flexbeams.plant.threads import one_thread

METHOD = 2  # version of the method; raised by every change that changes a design beyond rounding


@dataclass(frozen=True, kw_only=True)
class Design:
    """A finished design. Shapes: m = 2 r N_r states, n_u inputs, n_pi points, n_pm gauges."""

    structure: Structure
    options: DesignOptions
    summary: dict[str, Any]  # figures for people and for --json
    arrays: dict[str, Array]  # the numbers that the units compute with, by name; see compute_design
    design_id: str  # see identify

    @property
    def integral_gain(self) -> float:
        """k_I of (45) at the sample time of the design."""
        return float(self.summary["integral_gain"])

    @property
    def integral_gain_limit(self) -> float:
        """Largest k_I for which the closed loop is stable."""
        return float(self.summary["integral_gain_limit"])

    def model(self, basis: BasisName | None = None, order: int | None = None) -> BeamModel:
        """The plant's model: of the design's own basis, or another one of the same structure."""
        if basis is None or basis == self.options.basis:
            return beam_model(self.structure, self.options.basis, order or self.options.order)
        return beam_model(self.structure, basis, order)


def compute_design(structure: Structure, options: DesignOptions | None = None) -> Design:
    """Reduction, flatness coefficients, filter and regulator of a structure.

    Arrays: A, B, H_pi, H_pm, H_w, D_pi, D_pm, D_w (reduced, continuous); A_d, B_d (sampled); estimator_gain
    (m, n_pm), feedback_gain (n_u, m), static_inverse (n_u, n_pi) V/m, unreachable (n_pi, n_pi), the part of a target
    that is refused; flat_ratios (m,), mode_series (2 l, m), mode_inputs (2 l, n_u), mode_states (m, 2 l) of
    FlatParameterisation; shape_times, shape_values; transition_table, transition_constants (exponent, norm).
    Raises DesignError where a step has no acceptable result, or where the closed loop is unstable on a full plant.
    """
    try:
        with one_thread():
            return _compute(structure, options or DesignOptions())
    except DesignError as error:
        if unusual := implausible_values(structure):  # no other advice helps
            raise DesignError(f"there is no design, perhaps because {unusual[0]}") from error
        raise


def _compute(structure: Structure, options: DesignOptions) -> Design:
    try:
        model = beam_model(structure, options.basis, options.basis_order)
    except InputError as error:
        raise DesignError(str(error)) from None
    system = model.assemble()
    reduced = reduced_with(model, system, options, options.reduced_modes)
    warnings = sampling_warnings(reduced, options, partial(reduced_with, model, system, options))
    statics = statics_of(model, options)
    if options.static_maps != "basis":
        reduced = with_statics(reduced, statics)
    offsets = _offsets(statics, options)
    reach = _reach(statics, reduced, options)
    motion, cancellation = _motion_arrays(reduced, options)
    arrays = {
        **_model_arrays(reduced),
        **_gains(reduced, offsets, options),
        "static_inverse": reach.inverse,
        "unreachable": reach.unreachable * (options.targets == "reachable"),
        **motion,
    }
    verification = verify_design(model, arrays, options, partial(_gains, reduced, offsets))
    summary = {
        **design_summary(model, system, reduced, options, arrays),
        **verification.figures(),
        **({"offsets": offsets.figures()} if offsets else {}),
        **reach.figures(),
        "flatness_cancellation": cancellation,
        "warnings": [
            *structure_warnings(model, system),
            *reach.warnings(nearest=options.targets == "nearest"),
            *warnings,
            *missing_mode_warnings(system, reduced, len(structure.beam)),
            *verification.warnings(),
        ],
    }
    reliable = reduced.position_coordinates.reliable and reduced.velocity_coordinates.reliable
    design_id = identify(structure, options, arrays, with_fingerprint=not reliable)
    return Design(structure=structure, options=options, summary=summary, arrays=arrays, design_id=design_id)


def _gains(reduced: ReducedModel, offsets: OffsetMap | None, options: DesignOptions) -> dict[str, Array]:
    """Arrays that depend on the weights."""
    arrays = control_arrays(reduced, options)
    if offsets:
        arrays |= {"offset_map": offsets.W, "offset_gain": offset_gain(options, len(reduced.H_pm))}
    return arrays


def _offsets(statics: Statics, options: DesignOptions) -> OffsetMap | None:
    if options.observer == "paper":
        return None
    names = list(statics.model.structure.parameters())
    return offset_map(
        static_sensitivities(statics.model),
        uncertainty_of(names, options.uncertainty),
        noise=options.weights.offset_strain_noise,
        voltage=options.voltage_limit,
    )


def reduced_with(model: BeamModel, system: SecondOrderSystem, options: DesignOptions, modes: int) -> ReducedModel:
    """The reduced model with so many modes of each beam, without static maps from elsewhere."""
    return reduce(
        model,
        system,
        position_states=modes * len(model.structure.beam),
        output_weight=options.balanced_norm,
        static_correction=options.static_correction,
    )


def _model_arrays(reduced: ReducedModel) -> dict[str, Array]:
    names = ("A", "B", "H_pi", "H_pm", "D_pi", "D_pm", "H_w", "D_w")
    return {name: getattr(reduced, name) for name in names}


def _reach(statics: Statics, reduced: ReducedModel, options: DesignOptions) -> Reach:
    """Deflections that voltages hold at rest."""
    gain = statics.deflection if options.static_gain == "full" else reduced.static_gain()[0] + reduced.D_pi
    return reach_of(gain, float(np.max(np.abs(statics.stations))))


def _motion_arrays(reduced: ReducedModel, options: DesignOptions) -> tuple[dict[str, Array], float]:
    """The flat parameterisation (34)-(36), the planner's table and the transition (37).

    Beside them the cancellation ratio at the transition time, or at the shortest that can be planned.
    """
    flat = flat_parameterisation(reduced)
    transition = transition_of_order(options.gevrey_order)
    slowest = float(np.min(np.abs(np.linalg.eigvals(reduced.A))))
    shapes = tabulate_input_shapes(flat, transition, slowest)
    arrays = {
        "flat_ratios": flat.ratios,
        "mode_series": flat.mode_series,
        "mode_inputs": flat.mode_inputs,
        "mode_states": flat.mode_states,
        "shape_times": shapes.times,
        "shape_values": shapes.values,
        "transition_table": transition.table,
        "transition_constants": np.array([transition.exponent, transition.norm]),
    }
    shortest = max(options.transition_time, float(shapes.times[0]))
    return arrays, cancellation_ratio(flat, transition, shortest)


def identify(
    structure: Structure, options: DesignOptions, arrays: dict[str, Array], with_fingerprint: bool = False
) -> str:
    """The design_id: a hash of structure, options and METHOD, equal on every machine.

    Designs with equal ids fit each other: their arrays agree to about 1e-9. Where the truncation separates nearly
    equal singular values they do not, and a fingerprint of `arrays` follows the hash. Static maps from a file count by
    their contents.
    """
    choices = asdict(options)
    if options.static_maps not in ("basis", "segment"):
        choices["static_maps"] = fingerprint({name: arrays[name] for name in ("D_pi", "D_pm", "static_inverse")})
    text = json.dumps({"method": METHOD, "structure": asdict(structure), "options": choices}, sort_keys=True)
    name = hashlib.sha256(text.encode()).hexdigest()[:32]
    return f"{name}-{fingerprint(arrays)[:8]}" if with_fingerprint else name


def fingerprint(arrays: dict[str, Array]) -> str:
    """Hash of every array's bytes: different where a linear algebra library rounds differently."""
    digest = hashlib.sha256()
    for name in sorted(arrays):
        digest.update(name.encode())
        digest.update(array_bytes(arrays[name]))
    return digest.hexdigest()
