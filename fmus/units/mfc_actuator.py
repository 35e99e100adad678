"""MfcActuator: amplifier, hysteresis and creep between a controller's voltages and those that act on the beams."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from flexbeams.controller.design import Design
from flexbeams.fmus.documents.chapter import Chapter
from flexbeams.fmus.documents.loop_figure import loop_figure
from flexbeams.fmus.interface.variables import TIME, Interface, Variable, array
from flexbeams.fmus.references.mfc import mfc_actuator_experiments
from flexbeams.fmus.units.kind import STOP_TIME, UnitKind, design_id_variable
from flexbeams.fmus.units.mfc_parameters import (
    MFC_LITERATURE,
    actuator_of,
    amplifier_limits,
    operator_parameters,
    saturation_outputs,
    shared_fields,
)
from flexbeams.fmus.units.native_kernel import NATIVE, Fields, NativeKernel, UnitData, first_references
from flexbeams.fmus.units.ranges import voltage_range
from flexbeams.plant.actuator.parameters import Actuator
from flexbeams.plant.galerkin import BeamModel


def declare(design: Design, model: BeamModel) -> Interface:
    """Commands in, effective voltages out."""
    actuator = actuator_of(model)
    channels = len(actuator.pair)
    nominal = design.options.voltage_limit
    return Interface(
        unit_name=MFC_ACTUATOR.name,
        variables=(
            TIME,
            *array(
                "u",
                channels,
                causality="input",
                start=0.0,
                unit="V",
                nominal=nominal,
                description="Commanded voltage of patch pair {}",
                **voltage_range(design),
            ),
            *array(
                "u_eff",
                channels,
                causality="output",
                unit="V",
                nominal=nominal,
                description="Effective voltage of patch pair {}: what acts on the beams",
            ),
            *saturation_outputs(),
            *array(
                "voltage",
                channels,
                causality="local",
                unit="V",
                nominal=nominal,
                description="Voltage of patch pair {} behind the amplifier",
            ),
            *operator_parameters(actuator),
            *amplifier_limits(actuator),
            *_amplifier(actuator),
            design_id_variable(design),
        ),
        step_size=design.options.sample_time,
        stop_time=STOP_TIME,
        description=f"Amplifier, hysteresis and creep of {channels} pairs of patches of macro-fibre composite",
    )


def _amplifier(actuator: Actuator) -> Iterator[Variable]:
    common: dict[str, Any] = {"causality": "parameter", "minimum": 0.0}
    for name, value, unit, maximum, meaning in (
        ("lag", actuator.lag, "s", 1e3, "Time constant of the amplifier of channel {}, 0 for none"),
        ("slew_rate", actuator.slew_rate, "V/s", 1e12, "Largest rate of the voltage of channel {}, 0 for no limit"),
        ("resolution", actuator.resolution, "V", 1e5, "Step to which the command of channel {} is rounded, 0 for none"),
    ):
        yield from array(
            name, len(actuator.pair), start=value, unit=unit, maximum=maximum, description=meaning, **common
        )


def unit_data(interface: Interface, design: Design, model: BeamModel) -> UnitData:
    """No numbers beside the parameters."""
    return UnitData(meta={"design_id": design.design_id})


def native_data(interface: Interface, data: UnitData) -> Fields:
    """The fields of MfcActuatorData."""
    names = ("u", "u_eff", "voltage", "lag", "slew_rate", "resolution")
    return {"parameters": shared_fields(interface), **first_references(interface, *names)}


MFC_ACTUATOR = UnitKind(
    name="MfcActuator",
    interface=declare,
    data=unit_data,
    chapter=Chapter(
        equations="""
Each channel is a pair of patches behind an amplifier. The command u is rounded to the resolution and limited so that
the faces, at supply + u and supply − u, keep to their range:
= |v_c| ≤ min(v_max − v_0 , v_0 − v_min)
While the command holds, the voltage v follows it with the amplifier's lag, no faster than its slew rate; lag, slew rate
and resolution are off at 0, and then v is the command:
= τ dot v = v_c − v ; |dot v| ≤ σ
Hysteresis is a superposition of a linear part and play operators p_i with thresholds r_i and weights w_i, followed by
one of one-sided dead zones D_j, which make it asymmetric:
= p_i = max(v − r_i , min(v + r_i , p_i)) ; z = w_0 v + ∑_i w_i p_i ; h = z + ∑_j s_j D_j(z)
= D_j(z) = max(z − ρ_j , 0) ; D_j(z) = min(z − ρ_j , 0)
the first for thresholds ρ_j of 0 and above, the second below 0. Creep follows, first-order operators c_i whose time
constants cover decades, so that the effective voltage grows by about a_i in each decade of time:
= τ_i dot c_i = h − c_i ; u_eff = h + ∑_i a_i c_i
The weights are not negative, so a closed loop of u and u_eff dissipates energy, and the slope of h is positive, so
there is an inverse: MfcCompensator. The start is the state after the voltages history, from the demagnetised state on,
at rest under the last one.
""",
        timing="""
A step of any size is exact for commands that hold, and the result does not depend on how a step is split: play
operators need the last voltage alone, since v does not turn while the command holds; creep is computed with
exponentials between the voltages at which the slope of h changes.
# How to take the data on a rig
Drive one pair slowly against its first mode, loops of some seconds each: from 0 V twice through the whole range, then
loops of two thirds, a half and a third of it, one more through the whole range, and two small ones off the middle.
Record time, voltage and a deflection or a strain at 50 rows a second or more; then the command
flexbeams identify hysteresis DATA.csv --structure START.toml --pair 1 --out RESULT.toml
writes the section actuator of the structure, with a page of loops, residuals and the error that a compensator would
leave. For creep, hold a voltage for as long as it matters.
""",
        figure=loop_figure,
        literature=MFC_LITERATURE,
    ),
    native=NativeKernel(
        source=NATIVE / "units" / "mfc_actuator.c",
        data_type="MfcActuatorData",
        hooks="mfc_actuator_hooks",
        data=native_data,
        provides_derivatives=True,
    ),
    python=Path(__file__).parents[1] / "python" / "mfc_actuator.py",
    experiments=mfc_actuator_experiments,
    section="actuator",
    records_inputs=True,
    loops=("u", "u_eff"),
)
