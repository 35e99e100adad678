"""MfcCompensator: the voltages that give wanted effective voltages behind hysteresis and creep."""

from pathlib import Path

from flexbeams.controller.design import Design
from flexbeams.fmus.documents.chapter import Chapter
from flexbeams.fmus.documents.loop_figure import loop_figure
from flexbeams.fmus.interface.variables import TIME, Interface, array
from flexbeams.fmus.references.mfc import mfc_compensator_experiments
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
from flexbeams.plant.galerkin import BeamModel


def declare(design: Design, model: BeamModel) -> Interface:
    """Wanted effective voltages in, commands out."""
    actuator = actuator_of(model)
    channels = len(actuator.pair)
    nominal = design.options.voltage_limit
    return Interface(
        unit_name=MFC_COMPENSATOR.name,
        variables=(
            TIME,
            *array(
                "u_eff",
                channels,
                causality="input",
                start=0.0,
                unit="V",
                nominal=nominal,
                description="Wanted effective voltage of patch pair {}",
                **voltage_range(design),
            ),
            *array(
                "u",
                channels,
                causality="output",
                unit="V",
                nominal=nominal,
                description="Voltage to command to patch pair {}",
            ),
            *saturation_outputs(),
            *operator_parameters(actuator),
            *amplifier_limits(actuator),
            design_id_variable(design),
        ),
        step_size=design.options.sample_time,
        stop_time=STOP_TIME,
        description=f"Inverse of hysteresis and creep of {channels} pairs of patches of macro-fibre composite",
    )


def unit_data(interface: Interface, design: Design, model: BeamModel) -> UnitData:
    """No numbers beside the parameters."""
    return UnitData(meta={"design_id": design.design_id})


def native_data(interface: Interface, data: UnitData) -> Fields:
    """The fields of MfcCompensatorData."""
    return {"parameters": shared_fields(interface), **first_references(interface, "u_eff", "u")}


MFC_COMPENSATOR = UnitKind(
    name="MfcCompensator",
    interface=declare,
    data=unit_data,
    chapter=Chapter(
        equations="""
The inverse of MfcActuator without its amplifier, with the same parameters; see its page for the operators. The unit
keeps the states p_i and c_i that its own commands leave in the patches. For a wanted effective voltage w at the end of
a step of T seconds, the discrete inverse of the creep gives the hysteresis that must hold during the step:
= e_i = exp(−T / τ_i) ; η = (w − ∑_i a_i e_i c_i) / (1 + ∑_i a_i (1 − e_i))
The inverse of the dead zones is one of dead zones, with S_j = 1 + s_1 + … + s_j counted from 0 outwards on each side,
and h(ρ) the image of a threshold:
= z = η + ∑_j (1 / S_j − 1 / S_{j−1}) D_j'(η) ; ρ_j' = h(ρ_j)
That of the play operators is one of play operators, with W_i = w_0 + … + w_i, r_0 = 0 and p_0 = u:
= r_i' = ∑_{j ≤ i} w_j (r_i − r_j) ; w_i' = 1 / W_i − 1 / W_{i−1} ; p_i' = W_i p_i + ∑_{j > i} w_j p_j
= u = ∑_i w_i' max(z − r_i' , min(z + r_i' , p_i'))
The inverse exists where all W_i and S_j are > 0; parameters that break this are refused by name when the initialisation
ends. A command beyond the amplifier's limit is held there, saturated says so, the first one since the start also in
the log; the states follow the command that is given, so that the inverse is exact again as soon as the limit allows.
""",
        timing="""
The command after a step is for the time from its end on, and is computed for a next step of the same size: behind an
actuator that steps after it, or at the same time with one step of delay, the effective voltage at the end of that step
is the one that was wanted. At the start, actuator and compensator rest under the last voltage of the history.
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
        source=NATIVE / "units" / "mfc_compensator.c",
        data_type="MfcCompensatorData",
        hooks="mfc_compensator_hooks",
        data=native_data,
        provides_derivatives=True,
    ),
    python=Path(__file__).parents[1] / "python" / "mfc_compensator.py",
    experiments=mfc_compensator_experiments,
    section="actuator",
    records_inputs=True,
)
