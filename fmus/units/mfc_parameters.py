"""Parameters that MfcActuator and MfcCompensator share: those of the section `actuator` of the structure file."""

from collections.abc import Iterator
from typing import Any

from flexbeams.fmus.interface.variables import Interface, Variable, array, matrix
from flexbeams.fmus.units.native_kernel import Fields, first_references
from flexbeams.plant.actuator.parameters import Actuator, histories, operators
from flexbeams.plant.galerkin import BeamModel

LARGEST_VOLTAGE = 1e5  # V
LARGEST_WEIGHT = 100.0
OPERATORS = (
    "linear_weight",
    "play_threshold",
    "play_weight",
    "dead_zone_threshold",
    "dead_zone_slope",
    "creep_time",
    "creep_weight",
    "history",
)
MFC_LITERATURE = (
    "J. Schröck, T. Meurer, A. Kugi, Control of a flexible beam actuated by macro-fiber composite patches, Smart "
    "Materials and Structures 20 (2011) 015015 and 015016. K. Kuhnen, Modeling, identification and compensation of "
    "complex hysteretic nonlinearities, European Journal of Control 9 (2003) 407-418."
)


def actuator_of(model: BeamModel) -> Actuator:
    """The section of the structure, which a kind with this `section` is only asked for where it is there."""
    actuator = model.structure.actuator
    assert actuator is not None
    return actuator


def operator_parameters(actuator: Actuator) -> Iterator[Variable]:
    """Hysteresis, creep and history of each channel."""
    numbers = operators(actuator.pair)
    volts: dict[str, Any] = {"causality": "parameter", "unit": "V", "nominal": 100.0, "maximum": LARGEST_VOLTAGE}
    plain: dict[str, Any] = {"causality": "parameter", "unit": "1", "nominal": 0.1, "maximum": LARGEST_WEIGHT}
    yield from array(
        "linear_weight",
        len(actuator.pair),
        start=numbers.play_weight[:, 0],
        minimum=1e-6,
        description="Weight of the linear part of channel {}",
        **plain,
    )
    yield from _matrix(
        "play_threshold", numbers.play_threshold[:, 1:], "Thresholds of the play operators, ascending", volts, 0.0
    )
    yield from _matrix("play_weight", numbers.play_weight[:, 1:], "Weights of the play operators", plain, 0.0)
    yield from _matrix(
        "dead_zone_threshold",
        numbers.dead_zone_threshold,
        "Thresholds of the one-sided dead zones, ascending",
        volts,
        -LARGEST_VOLTAGE,
    )
    yield from _matrix(
        "dead_zone_slope", numbers.dead_zone_slope, "Slopes that the dead zones add to 1", plain, -LARGEST_WEIGHT
    )
    times = {"causality": "parameter", "unit": "s", "nominal": 1.0, "maximum": 1e9}
    yield from _matrix("creep_time", numbers.creep_time, "Time constants of the creep operators", times, 1e-9)
    yield from _matrix("creep_weight", numbers.creep_weight, "Weights of the creep operators", plain, 0.0)
    yield from _matrix(
        "history",
        histories(actuator.pair),
        "Voltages that led from the demagnetised state to the start; the patches rest at the last one",
        volts,
        -LARGEST_VOLTAGE,
    )


def _matrix(name: str, values: Any, meaning: str, common: dict[str, Any], minimum: float) -> Iterator[Variable]:
    yield from matrix(
        name,
        *values.shape,
        start=values.ravel(),
        description=f"{meaning}: [channel, operator]",
        minimum=minimum,
        **common,
    )


def amplifier_limits(actuator: Actuator) -> Iterator[Variable]:
    """Supply and limits of the faces of each channel."""
    volts: dict[str, Any] = {
        "causality": "parameter",
        "unit": "V",
        "nominal": 1000.0,
        "minimum": -LARGEST_VOLTAGE,
        "maximum": LARGEST_VOLTAGE,
    }
    for name, value, meaning in (
        ("face_minimum", actuator.face_minimum, "Lowest voltage of a patch face of channel {}"),
        ("face_maximum", actuator.face_maximum, "Highest voltage of a patch face of channel {}"),
        ("supply", actuator.supply, "Voltage of both faces of channel {} at u = 0: they get supply + u and supply - u"),
    ):
        yield from array(name, len(actuator.pair), start=value, description=meaning, **volts)


def saturation_outputs() -> Iterator[Variable]:
    """Whether a command is at the limit, and how often one was."""
    yield Variable(
        name="saturated", type="Boolean", causality="output", description="A command is held at the amplifier's limit"
    )
    yield Variable(
        name="saturated_steps",
        type="Integer",
        causality="local",
        description="Communication steps since the start in which a command was held at the limit",
    )


def shared_fields(interface: Interface) -> Fields:
    """The fields of MfcParameters in C."""
    n = len(interface.references("u"))
    sizes = {
        "channels": n,
        "plays": len(interface.references("play_threshold")) // n,
        "dead_zones": len(interface.references("dead_zone_threshold")) // n,
        "creeps": len(interface.references("creep_time")) // n,
        "extremes": len(interface.references("history")) // n,
    }
    names = ("face_minimum", "face_maximum", "supply", "saturated", "saturated_steps")
    return {**sizes, **first_references(interface, *OPERATORS, *names)}
