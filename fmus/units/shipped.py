"""The variables of the three units, declared once for every kernel and for modelDescription.xml."""

from dataclasses import replace

from flexbeams.controller.design import Design
from flexbeams.fmus.interface.variables import Interface, Variable, array, matrix, time_variable
from flexbeams.plant.galerkin import STATIONS, BeamModel
from flexbeams.plant.parameters import PARAMETERS, in_unit_order

UNITS = ("BeamPlant", "FlatnessFeedforward", "TrackingController")
STOP_TIME = 6.0  # s, of the default experiment


def interface_of(unit: str, design: Design, model: BeamModel) -> Interface:
    """The interface of a unit built from a design; `model` is the plant's, of any basis."""
    if unit == "BeamPlant":
        return beam_plant(design, model)
    if unit == "FlatnessFeedforward":
        return flatness_feedforward(design)
    return tracking_controller(design)


def _design_id(design: Design) -> Variable:
    return Variable(
        name="design_id",
        type="String",
        causality="local",
        variability="constant",
        start=design.design_id,
        description="Hash of the design; units of different designs do not fit",
    )


def _each(text: str, variables: tuple[Variable, ...]) -> list[Variable]:
    """The variables with their number put into the description."""
    return [replace(v, description=text.format(k)) for k, v in enumerate(variables, 1)]


def beam_plant(design: Design, model: BeamModel) -> Interface:
    """BeamPlant: voltages and tip forces in, deflections and strains out, every physical parameter settable."""
    structure = model.structure
    limit = design.options.voltage_limit
    r, n_u = len(structure.beam), len(structure.patch)
    values = structure.parameters()
    parameters = []
    for entry in PARAMETERS:
        starts = [values[name] for name, other in in_unit_order(values) if other is entry]
        parameters += _each(
            entry.meaning,
            array(
                f"{entry.part}[].{entry.name}",
                len(starts),
                causality="parameter",
                unit=entry.unit,
                start=starts,
                minimum=0.0,
                nominal=max(starts, default=0.0) or 1.0,
            ),
        )
    points, gauges = structure.point_of_interest, structure.strain_gauge
    variables = [
        time_variable,
        *_each("Voltage of patch pair {}", array("u", n_u, causality="input", unit="V", start=0.0, nominal=limit)),
        *_each("Force on the tip of beam {}", array("force", r, causality="input", unit="N", start=0.0)),
        *[
            Variable(
                name=f"y_pi[{k}]",
                causality="output",
                unit="m",
                nominal=1e-3,
                description=f"Deflection at point of interest {k}: beam {p.beam}, {p.position:g} m from the clamp",
            )
            for k, p in enumerate(points, 1)
        ],
        *[
            Variable(
                name=f"y_pm[{k}]",
                causality="output",
                unit="1",
                nominal=1e-4,
                description=f"Strain at gauge {k}: beam {g.beam}, {g.position:g} m from the clamp",
            )
            for k, g in enumerate(gauges, 1)
        ],
        *[
            Variable(
                name=v.name,
                causality="local",
                unit="m",
                nominal=1e-3,
                description=f"Deflection of beam {v.name[2:].split(',')[0]} at station "
                f"{v.name[:-1].split(',')[1]} of {STATIONS} from the clamp to the tip",
            )
            for v in matrix("w", r, STATIONS, causality="local")
        ],
        Variable(
            name="energy",
            causality="local",
            unit="J",
            nominal=1e-3,
            description="Kinetic and elastic energy of the structure",
        ),
        *parameters,
        *_each(
            "Voltage of patch pair {} under which the structure rests at the start",
            array("start_at_rest_under", n_u, causality="parameter", unit="V", start=0.0, nominal=limit),
        ),
        Variable(
            name="strain_noise_std",
            causality="parameter",
            unit="1",
            start=0.0,
            minimum=0.0,
            nominal=1e-6,
            description="Standard deviation of white noise on the strains, a new value each sample time",
        ),
        Variable(
            name="noise_seed",
            type="Integer",
            causality="parameter",
            start=1,
            minimum=0,
            description="Seed of the noise; equal seeds give equal noise",
        ),
        _design_id(design),
    ]
    return Interface(
        unit_name="BeamPlant",
        variables=tuple(variables),
        step_size=design.options.sample_time,
        stop_time=STOP_TIME,
        description="Elastically coupled Euler-Bernoulli beams with piezoelectric "
        f"patch pairs: {r} beams, {n_u} pairs, Galerkin model of {2 * model.size} states, exact for "
        "inputs held over any step",
    )


def flatness_feedforward(design: Design) -> Interface:
    """FlatnessFeedforward: target deflections in; voltages, reference state and reference deflections out."""
    options = design.options
    n_u, n_pi = design.arrays["static_inverse"].shape
    m = len(design.arrays["A"])
    target, limit = ("y_target",), options.voltage_limit
    variables = [
        time_variable,
        *_each(
            "Wanted deflection at point of interest {}; a change starts a transition",
            array("y_target", n_pi, causality="input", unit="m", start=0.0, nominal=1e-3),
        ),
        *_each(
            "Feedforward voltage of patch pair {}",
            array("u_ff", n_u, causality="output", initial_inputs=target, unit="V", nominal=limit),
        ),
        *_each("Reference of reduced state {}", array("x_ref", m, causality="output", unit="1", initial_inputs=target)),
        *_each(
            "Reference deflection at point of interest {}",
            array("y_ref", n_pi, causality="output", unit="m", nominal=1e-3, initial_inputs=target),
        ),
        Variable(name="moving", type="Boolean", causality="output", description="A transition is under way"),
        Variable(
            name="target_refused",
            type="Boolean",
            causality="local",
            description="The last target is out of reach within the voltage limit; the one before is held",
        ),
        Variable(
            name="planned_time",
            causality="local",
            unit="s",
            description="Duration of the last transition planned, >= transition_time",
        ),
        Variable(
            name="planned_peak",
            causality="local",
            unit="V",
            nominal=limit,
            description="Largest voltage of the last plan, of a refused one too",
        ),
        Variable(
            name="transition_time",
            causality="parameter",
            variability="tunable",
            unit="s",
            start=options.transition_time,
            minimum=1e-3,
            maximum=1e4,
            description="Wanted duration of the next transition; stretched where the voltage limit asks for it",
        ),
        Variable(
            name="voltage_limit",
            causality="parameter",
            variability="tunable",
            start=limit,
            minimum=0.0,
            unit="V",
            nominal=limit,
            description="Largest voltage magnitude planned with",
        ),
        Variable(
            name="preview",
            causality="parameter",
            variability="tunable",
            unit="s",
            start=0.0,
            minimum=0.0,
            maximum=10.0,
            description="Time by which outputs run ahead, to undo the delay up to the plant",
        ),
        _design_id(design),
    ]
    return Interface(
        unit_name="FlatnessFeedforward",
        variables=tuple(variables),
        step_size=options.sample_time,
        stop_time=STOP_TIME,
        description="Flatness-based motion planning and feedforward: smooth, "
        f"superposable transitions of Gevrey order {options.gevrey_order:g} between rest positions",
    )


def tracking_controller(design: Design) -> Interface:
    """TrackingController: strains and the feedforward's references in, voltages and estimates out."""
    options, arrays = design.options, design.arrays
    n_u, m = arrays["feedback_gain"].shape
    n_pi, n_pm = len(arrays["H_pi"]), len(arrays["H_pm"])
    limit = options.voltage_limit
    variables = [
        time_variable,
        *_each(
            "Measured strain at gauge {}", array("y_pm", n_pm, causality="input", unit="1", start=0.0, nominal=1e-4)
        ),
        *_each(
            "Feedforward voltage of patch pair {}",
            array("u_ff", n_u, causality="input", start=0.0, unit="V", nominal=limit),
        ),
        *_each("Reference of reduced state {}", array("x_ref", m, causality="input", unit="1", start=0.0)),
        *_each(
            "Voltage of patch pair {}",
            array("u", n_u, causality="output", initial_inputs=("u_ff",), unit="V", nominal=limit),
        ),
        *_each(
            "Estimated deflection at point of interest {}",
            array("y_est", n_pi, causality="output", unit="m", nominal=1e-3, initial_inputs=("x_ref", "u_ff")),
        ),
        Variable(
            name="saturated",
            type="Boolean",
            causality="output",
            initial_inputs=("u_ff",),
            description="A voltage is held at the limit",
        ),
        *_each(
            "Estimate of reduced state {}", array("x_est", m, causality="local", unit="1", initial_inputs=("x_ref",))
        ),
        Variable(
            name="feedback",
            type="Boolean",
            causality="parameter",
            variability="tunable",
            start=True,
            description="Feedback on; when off, the feedforward's voltages pass through",
        ),
        Variable(
            name="integral_gain",
            causality="parameter",
            variability="tunable",
            unit="1",
            start=options.integral_gain,
            minimum=0.0,
            maximum=1.0,
            description="k_I of (45), share of the deflection error mended each sample",
        ),
        Variable(
            name="voltage_limit",
            causality="parameter",
            variability="tunable",
            start=limit,
            minimum=0.0,
            unit="V",
            nominal=limit,
            description="Largest voltage magnitude put out",
        ),
        _design_id(design),
    ]
    return Interface(
        unit_name="TrackingController",
        variables=tuple(variables),
        step_size=options.sample_time,
        stop_time=STOP_TIME,
        description="Kalman filter, linear-quadratic regulator and integral action "
        f"with a sample time of {options.sample_time:g} s and {m} states",
    )
