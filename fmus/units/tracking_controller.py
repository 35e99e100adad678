"""TrackingController: Kalman filter, linear-quadratic regulator and integral action."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from flexbeams.controller.design import Design
from flexbeams.controller.observer import tick_matrices
from flexbeams.fmus.documents.chapter import PAPER, Chapter
from flexbeams.fmus.interface.variables import TIME, Interface, Variable, array
from flexbeams.fmus.references.tracking_controller import controller_experiments
from flexbeams.fmus.units.kind import STOP_TIME, UnitKind, design_id_variable
from flexbeams.fmus.units.native_kernel import NATIVE, Fields, NativeKernel, Table, UnitData, first_references
from flexbeams.fmus.units.ranges import state_range, voltage_range
from flexbeams.fmus.units.voltage_limits import VOLTAGE_LIMITS, voltage_limits
from flexbeams.plant.galerkin import BeamModel

WIDENING_TIME = 0.2  # s, in which a limit in force widens by the design's voltage limit


def declare(design: Design, model: BeamModel) -> Interface:
    """Strains and the feedforward's references in, voltages and estimates out."""
    m = len(design.arrays["A_d"])
    return Interface(
        unit_name=TRACKING_CONTROLLER.name,
        variables=(
            TIME,
            *_inputs(design),
            *_outputs(design),
            *array(
                "x_est",
                m,
                causality="local",
                unit="1",
                initial_inputs=("x_ref",),
                description="Estimate of reduced state {}",
            ),
            *_offsets(design),
            *_parameters(design),
            *_counts(),
            design_id_variable(design),
        ),
        step_size=design.options.sample_time,
        stop_time=STOP_TIME,
        description="Kalman filter, linear-quadratic regulator and integral action "
        f"with a sample time of {design.options.sample_time:g} s and {m} states",
    )


def _offsets(design: Design) -> Iterator[Variable]:
    """The strain offsets of the offset-free observer; they follow x_est."""
    if "offset_map" in design.arrays:
        yield from array(
            "offset",
            len(design.arrays["H_pm"]),
            causality="local",
            unit="1",
            nominal=1e-5,
            description="Estimated strain offset of gauge {}: the strain that the model does not explain",
        )


def _inputs(design: Design) -> Iterator[Variable]:
    n_u, m = design.arrays["feedback_gain"].shape
    held: dict[str, Any] = {"causality": "input", "start": 0.0}
    yield from array(
        "y_pm", len(design.arrays["H_pm"]), unit="1", nominal=1e-4, description="Measured strain at gauge {}", **held
    )
    yield from array(
        "u_ff",
        n_u,
        unit="V",
        nominal=design.options.voltage_limit,
        description="Feedforward voltage of patch pair {}",
        **voltage_range(design),
        **held,
    )
    yield from array("x_ref", m, unit="1", description="Reference of reduced state {}", **state_range(design), **held)


def _outputs(design: Design) -> Iterator[Variable]:
    n_u, n_pi = design.arrays["static_inverse"].shape
    yield from array(
        "u",
        n_u,
        causality="output",
        initial_inputs=("u_ff",),
        unit="V",
        nominal=design.options.voltage_limit,
        description="Voltage of patch pair {}",
    )
    yield from array(
        "y_est",
        n_pi,
        causality="output",
        unit="m",
        nominal=1e-3,
        initial_inputs=("x_ref", "u_ff"),
        description="Estimated deflection at point of interest {}",
    )
    yield Variable(
        name="saturated",
        type="Boolean",
        causality="output",
        initial_inputs=("u_ff",),
        description="A voltage is held at the limit",
    )


def _parameters(design: Design) -> Iterator[Variable]:
    yield Variable(
        name="feedback",
        type="Boolean",
        causality="parameter",
        variability="tunable",
        start=True,
        description="Feedback on; when off, the feedforward's voltages pass through",
    )
    yield Variable(
        name="integral_gain",
        causality="parameter",
        variability="tunable",
        unit="1",
        start=design.integral_gain,
        minimum=0.0,
        maximum=design.integral_gain_limit,
        description="k_I of (45), fraction of the deflection error corrected per sample; above the maximum the closed "
        "loop is unstable",
    )
    yield from voltage_limits(design, "output voltages")
    yield Variable(
        name="strain_limit",
        causality="parameter",
        variability="tunable",
        start=0.1,
        minimum=0.0,
        maximum=1.0,
        unit="1",
        description="Largest plausible magnitude of a strain; a sample beyond is left out of the estimate",
    )
    yield Variable(
        name="rejected_limit",
        type="Integer",
        causality="parameter",
        variability="tunable",
        start=50,
        minimum=1,
        description="Samples of one gauge left out in a row that end the run, one for each tick of the controller",
    )


def _counts() -> Iterator[Variable]:
    yield Variable(
        name="saturation_share",
        causality="local",
        unit="1",
        description="Share of the samples since the start with a voltage held at a limit",
    )
    yield Variable(
        name="rejected_samples",
        type="Integer",
        causality="local",
        description="Strain samples left out of the estimate since the start",
    )


def unit_data(interface: Interface, design: Design, model: BeamModel) -> UnitData:
    """The matrices of a tick, see controller.observer."""
    matrices = tick_matrices(design.arrays)
    return UnitData(
        arrays={
            "filter": matrices.filter,
            "regulator": matrices.regulator,
            "estimates": matrices.estimates,
            "strains": matrices.strains,
            "integral_range": matrices.integral_range,
        },
        meta={
            "sample_time": design.options.sample_time,
            "widening": design.options.voltage_limit * design.options.sample_time / WIDENING_TIME,
            "design_id": design.design_id,
        },
    )


_REFERENCED = (
    "y_pm",
    "u_ff",
    "x_ref",
    "u",
    "y_est",
    "saturated",
    "saturation_share",
    "x_est",
    "feedback",
    "integral_gain",
    *VOLTAGE_LIMITS,
    "strain_limit",
    "rejected_limit",
    "rejected_samples",
)  # arrays that the native kernel finds by value reference


def native_data(interface: Interface, data: UnitData) -> Fields:
    """The fields of TrackingControllerData."""
    reduced, voltages, points, gauges = (len(interface.references(name)) for name in ("x_est", "u", "y_est", "y_pm"))
    states = len(data.arrays["filter"])
    return {
        "states": states,
        "reduced_states": reduced,
        "voltages": voltages,
        "points": points,
        "gauges": gauges,
        "sample_time": float(data.meta["sample_time"]),
        "widening": float(data.meta["widening"]),
        **first_references(interface, *_REFERENCED),
        "filter": Table(
            values=data.arrays["filter"],
            comment=f"[A_d - L H_pm, B_d - L D_pm, L] of the Kalman filter (42), "
            f"({states}, {states} + {voltages} + {gauges})",
            in_panels=True,
            decimals={"estimator gain L, state per strain": data.arrays["filter"][:, -gauges:]},
        ),
        "regulator": Table(
            values=data.arrays["regulator"],
            comment=f"[K, 0; G_0^+ H_pi, G_0^+ D_pi] of (44) and (45), (2 x {voltages}, {states} + {voltages}), "
            "V per state and V/V",
            in_panels=True,
            decimals={"feedback gain K, V per state": data.arrays["regulator"][:voltages, :states]},
        ),
        "estimates": Table(
            values=data.arrays["estimates"],
            comment=f"[H_pi, D_pi] of y_est, ({points}, {states} + {voltages}), m and m/V",
            in_panels=True,
        ),
        "strains": Table(
            values=data.arrays["strains"],
            comment=f"[H_pm, D_pm] of the strains predicted, ({gauges}, {states} + {voltages}), 1 and 1/V",
            in_panels=True,
        ),
        "integral_range": Table(
            values=data.arrays["integral_range"],
            comment=f"projection onto the range of G_0^+, where the integral lives, ({voltages}, {voltages}), 1",
        ),
    }


TRACKING_CONTROLLER = UnitKind(
    name="TrackingController",
    interface=declare,
    data=unit_data,
    chapter=Chapter(
        equations="""
A steady-state Kalman filter, equation (42) of the paper, a linear-quadratic regulator (44) and integral action (45):
= x_est(k+1) = A_d x_est(k) + B_d u(k) + L (y_pm(k) − H_pm x_est(k) − D_pm u(k))
= w(k) = u_ff(k) + K (x_ref(k) − x_est(k)) + z(k) ; u(k) = min(max(w(k) , u_min) , u_max)
= z(k+1) = z(k) + k_I G_0^+ (H_pi (x_ref − x_est) + D_pi (u_ff − u))
A unit with the variables offset has the offset-free observer: d = offset are strains that the model does not explain,
W d the deflections that belong to them over the declared uncertainty of the parameters, and l their rate:
= d(k+1) = d(k) + l (y_pm(k) − H_pm x_est(k) − D_pm u(k) − d(k)) ; δu = −G_0^+ W d
= w(k) = u_ff(k) + δu(k) + K (x_ref(k) + (I − A_d)^−1 B_d δu(k) − x_est(k)) + z(k)
d is also subtracted where x_est is corrected, and W d is added to y_est. Without feedback, d is zero.
A strain sample beyond strain_limit is left out: its gauge's term of the correction is zero. The first one since the
start gives a line and fmi2Warning, rejected_samples counts them, rejected_limit of one gauge in a row give fmi2Error.
Counted are ticks of the controller (its samples), also those inside one longer step, which see its inputs held.
G₀⁺ is the pseudo-inverse of the static gain from voltages to deflections: that gain is negative, a positive
factor alone would destabilise. With feedback off, the feedforward's voltages pass through.
The limits are voltage_limit of all magnitudes, voltage_min and voltage_max of each pair: u_min is the larger of
voltage_min and −voltage_limit, u_max the smaller of voltage_max and voltage_limit. A limit that is narrowed holds from
the next sample on; one that is widened moves there at the design's voltage limit in 0.2 s, so that no voltage jumps.
saturation_share is the share of the samples since the start with a voltage held at a limit. The integral of a voltage
that is held does not grow further out; the rest of the growth stays within the range of G₀⁺, since what left it no
deviation would ever take back.
""",
        timing="""
The unit runs on its own clock, whose period is the sample time of the design. The voltages after a step
are for the time at its end, computed from the measurement at its start: one sample of delay is part of the
design. Ticks inside a longer step see the inputs held; a step shorter than the period holds some ticks or none.
""",
        literature=PAPER,
    ),
    native=NativeKernel(
        source=NATIVE / "units" / "tracking_controller.c",
        data_type="TrackingControllerData",
        hooks="tracking_controller_hooks",
        data=native_data,
        provides_derivatives=True,
    ),
    python=Path(__file__).parents[1] / "python" / "tracking_controller.py",
    experiments=controller_experiments,
)
