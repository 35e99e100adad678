"""FlatnessFeedforward: motion planning and feedforward between rest positions."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.controller.planner import PLANNING_TICKS
from flexbeams.fmus.documents.chapter import PAPER, Chapter
from flexbeams.fmus.interface.variables import TIME, Interface, Variable, array
from flexbeams.fmus.references.flatness_feedforward import feedforward_experiments
from flexbeams.fmus.units.kind import STOP_TIME, UnitKind, design_id_variable
from flexbeams.fmus.units.motion_tables import MOTION_ARRAYS, SLOTS, motion_fields
from flexbeams.fmus.units.native_kernel import (
    NATIVE,
    Fields,
    NativeKernel,
    Table,
    UnitData,
    first_references,
)
from flexbeams.fmus.units.ranges import target_range
from flexbeams.fmus.units.voltage_limits import VOLTAGE_LIMITS, voltage_limits
from flexbeams.plant.galerkin import BeamModel


def declare(design: Design, model: BeamModel) -> Interface:
    """Target deflections in; voltages, reference state and reference deflections out."""
    options, limit = design.options, design.options.voltage_limit
    n_u, n_pi = design.arrays["static_inverse"].shape
    target = {"causality": "output", "initial_inputs": ("y_target",)}
    return Interface(
        unit_name=FLATNESS_FEEDFORWARD.name,
        variables=(
            TIME,
            *array(
                "y_target",
                n_pi,
                causality="input",
                unit="m",
                start=0.0,
                nominal=1e-3,
                description="Target deflection of point of interest {}; a change starts a transition",
                **target_range(design),
            ),
            *array("u_ff", n_u, unit="V", nominal=limit, description="Feedforward voltage of patch pair {}", **target),
            *array("x_ref", len(design.arrays["A"]), unit="1", description="Reference of reduced state {}", **target),
            *array(
                "y_ref",
                n_pi,
                unit="m",
                nominal=1e-3,
                description="Reference deflection at point of interest {}",
                **target,
            ),
            Variable(name="moving", type="Boolean", causality="output", description="A transition is in progress"),
            *_last_plan(limit),
            _transition_time(design),
            *voltage_limits(design, "planned voltages"),
            _preview(),
            design_id_variable(design),
        ),
        step_size=options.sample_time,
        stop_time=STOP_TIME,
        description="Flatness-based motion planning and feedforward: smooth, "
        f"superposable transitions of Gevrey order {options.gevrey_order:g} between rest positions",
    )


def _last_plan(limit: float) -> Iterator[Variable]:
    yield Variable(
        name="target_refused",
        type="Boolean",
        causality="local",
        description="The last target cannot be reached within the voltage limits; the previous one is held",
    )
    yield Variable(
        name="planned_time",
        causality="local",
        unit="s",
        description="Duration of the last transition planned, >= transition_time",
    )
    yield Variable(
        name="planned_peak",
        causality="local",
        unit="V",
        nominal=limit,
        description="Largest voltage of the last plan, also of a refused one",
    )


def _transition_time(design: Design) -> Variable:
    tabulated = design.arrays.get("spline_times")  # others than these have no spline
    return Variable(
        name="transition_time",
        causality="parameter",
        variability="tunable",
        unit="s",
        start=design.options.transition_time,
        minimum=1e-3,
        maximum=1e4 if tabulated is None else float(tabulated[-1]),
        description="Requested duration of the next transition; longer where a voltage limit requires it",
    )


def _preview() -> Variable:
    return Variable(
        name="preview",
        causality="parameter",
        variability="tunable",
        unit="s",
        start=0.0,
        minimum=0.0,
        maximum=10.0,
        description="Time by which the outputs lead, to compensate for the delay up to the plant",
    )


def unit_data(interface: Interface, design: Design, model: BeamModel) -> UnitData:
    """Arrays of the design by their names, and reference_outputs (n_pi, m + n_u): y_ref of (x_ref, u_ff)."""
    names = ("static_inverse", "unreachable", *MOTION_ARRAYS[design.options.planner])
    return UnitData(
        arrays={
            **{name: design.arrays[name] for name in names},
            "reference_outputs": np.hstack([design.arrays["H_pi"], design.arrays["D_pi"]]),
        },
        meta={
            "sample_time": design.options.sample_time,
            "design_id": design.design_id,
            "slots": SLOTS,
            "planner": design.options.planner,
        },
    )


def native_data(interface: Interface, data: UnitData) -> Fields:
    """The fields of FlatnessFeedforwardData."""
    return {
        "points": data.arrays["static_inverse"].shape[1],
        "sample_time": data.meta["sample_time"],
        **first_references(
            interface,
            "y_target",
            "u_ff",
            "x_ref",
            "y_ref",
            "moving",
            "target_refused",
            "planned_time",
            "planned_peak",
            "transition_time",
            *VOLTAGE_LIMITS,
            "preview",
        ),
        **motion_fields(data),
        **_native_outputs(data),
    }


def _native_outputs(data: UnitData) -> Fields:
    """The voltages of a target at rest, and the reference outputs."""
    arrays, inverse = data.arrays, data.arrays["static_inverse"]
    (voltages, points), states = inverse.shape, arrays["reference_outputs"].shape[1] - len(inverse)
    return {
        "static_inverse": Table(
            values=inverse,
            comment=f"G_0^+, from deflections to voltages at rest, ({voltages}, {points}), V/m",
            in_panels=True,
            decimals={"G_0^+, V/m": inverse},
        ),
        "unreachable": Table(
            values=arrays["unreachable"],
            comment=f"part of a target that is refused since no voltages reach it, ({points}, {points}), 1",
        ),
        "reference_outputs": Table(
            values=arrays["reference_outputs"],
            comment=f"[H_pi, D_pi] of y_ref, ({points}, {states} + {voltages}), m and m/V",
            in_panels=True,
        ),
    }


FLATNESS_FEEDFORWARD = UnitKind(
    name="FlatnessFeedforward",
    interface=declare,
    data=unit_data,
    chapter=Chapter(
        equations="""
The reduced model is flat, equations (31) to (38) of the paper: voltages and states follow from derivatives of the flat
output ξ.
= u_ff = sum_i c_i ξ^{(i)} ; x_ref = sum_i X_i ξ^{(i)} ; y_ref = H_pi x_ref + D_pi u_ff
The states are summed over the modes of the reduced model, whose amplitudes have a series each.
A changed target starts a transition; transitions add, so that a new one may start while others are under way:
= ξ(t) = ξ_0 + sum_k Δξ_k Θ((t−t_k) / T_k)
= Θ(τ) = ∫_0^τ θ(s) d s / ∫_0^1 θ(s) d s ; θ(s) = exp(−(s (1−s))^{−g})
Derivatives of Θ are exact: they come from power series.
A design with the planner multi_input has splines of degree 5 for the voltages of all pairs instead, which add likewise.
Their control points bring the reduced model from rest to rest in each of the tabulated times, with the least change
from one to the next. Between knots the voltages are polynomials, under which each mode λ of the reduced model has the
exact solution, with derivatives U_k of the voltages as the mode sees them and s the part of the span h:
= y(s) = e^{λ h s} y(0) + h sum_k U_k s^{k+1} φ_{k+1}(λ h s) ; φ_k(z) = ∫_0^1 e^{(1−σ) z} σ^{k−1} / (k−1)! d σ
A transition takes transition_time, of splines the next longer time tabulated, or as much longer as it takes to keep the
whole motion within the limits: voltage_limit of all magnitudes, voltage_min and voltage_max of each pair; those of
splines are kept to 0.1 % of the largest. The limits are those at the tick that sees the target: transitions under way,
and one that is being planned, go on when a limit is narrowed later. Where a voltage is then beyond a limit, the next
transition takes it no further. A target that needs more at rest, or that no voltages reach, is refused: one line in the
log, target_refused is true, the previous target is held.
""",
        timing=f"""
The unit sees targets at the ticks of its sample time, whatever the size of a step, and in a step those that were set
before it. From rest a transition starts at the tick that sees its target where transition_time fits. During a motion,
and where a transition has to be longer, it starts {PLANNING_TICKS} ticks later: each of them does an equal part of the
planning, so that no step takes long. Until then further targets wait; the latest is seen next. Outputs after a step are
those at its end plus preview, which compensates for the delay between this unit and the plant. At most {SLOTS}
transitions are in progress at once; a further one starts when the first has ended.
""",
        literature=PAPER,
    ),
    native=NativeKernel(
        source=NATIVE / "units" / "flatness_feedforward.c",
        data_type="FlatnessFeedforwardData",
        hooks="flatness_feedforward_hooks",
        data=native_data,
        provides_derivatives=True,
    ),
    python=Path(__file__).parents[1] / "python" / "flatness_feedforward.py",
    experiments=feedforward_experiments,
    internal_outputs=("x_ref",),
    reference=("x_ref", "u_ff"),
    targets="y_target",
)
