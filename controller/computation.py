"""The steps of a design, one after the other."""

from functools import partial
from typing import Any

import numpy as np

from flexbeams.controller.design_record import Design, identify
from flexbeams.controller.flatness import cancellation_ratio, flat_parameterisation, tabulate_input_shapes
from flexbeams.controller.gains import control_arrays, offset_gain
from flexbeams.controller.multi_input import RingingPlant, tabulate_spline_transitions
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
from flexbeams.plant.assembly import SecondOrderSystem
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import DesignError, InputError
from flexbeams.plant.galerkin import BeamModel, beam_model
from flexbeams.plant.statespace import spectrum_of, state_matrices
from flexbeams.plant.static_sensitivities import static_sensitivities
from flexbeams.plant.structure import Structure


def compute(structure: Structure, options: DesignOptions) -> Design:
    """The design; see `compute_design`, which also keeps linear algebra on one thread."""
    try:
        model = beam_model(structure, options.basis, options.basis_order)
    except InputError as error:
        raise DesignError(str(error)) from None
    options.voltage_limits(len(structure.patch))
    system = model.assemble()
    reduced = reduced_with(model, system, options, options.reduced_modes)
    warnings = sampling_warnings(reduced, options, partial(reduced_with, model, system, options))
    statics = statics_of(model, options)
    if options.static_maps != "basis":
        reduced = with_statics(reduced, statics)
    offsets = _offsets(statics, options)
    reach = _reach(statics, reduced, options)
    motion, figures = _motion(model, system, reduced, options)
    arrays = {
        **_model_arrays(reduced),
        **_gains(reduced, offsets, options),
        "static_inverse": reach.inverse,
        "unreachable": reach.unreachable * (options.targets == "reachable"),
        **motion,
    }
    verification = verify_design(model, arrays, options, partial(_gains, reduced, offsets))
    spectrum = spectrum_of(system)
    summary = {
        **design_summary(model, system, spectrum, reduced, options, arrays),
        **verification.figures(),
        **({"offsets": offsets.figures()} if offsets else {}),
        **reach.figures(),
        **figures,
        "warnings": [
            *options.limit_warnings(),
            *structure_warnings(model, system),
            *reach.warnings(nearest=options.targets == "nearest"),
            *warnings,
            *missing_mode_warnings(spectrum.oscillating, reduced, len(structure.beam)),
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


def _motion(
    model: BeamModel, system: SecondOrderSystem, reduced: ReducedModel, options: DesignOptions
) -> tuple[dict[str, Array], dict[str, Any]]:
    """Arrays of the planner, and figures for the summary."""
    if options.planner == "paper":
        return _flat_motion(reduced, options)
    A, B = state_matrices(system)
    plant = RingingPlant.of(A, B, np.hstack([model.deflection, np.zeros_like(model.deflection)]))
    table = tabulate_spline_transitions(reduced, plant, options.transition_time)
    return table.transitions.arrays(), table.figures()


def _flat_motion(reduced: ReducedModel, options: DesignOptions) -> tuple[dict[str, Array], dict[str, Any]]:
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
    return arrays, {"flatness_cancellation": cancellation_ratio(flat, transition, shortest)}
