"""Checks of the calls that an importer makes: the variable is there, of the right type, and may have the value."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from flexbeams.fmus.python.kernel import CallError, UnitError

PHASES = ("just instantiated", "in initialization mode", "initialised", "terminated")
INSTANTIATED, INITIALISING, STEPPING, TERMINATED = range(4)


def require_phase(function: str, needed: int, phase: int) -> None:
    """UnitError for a call in another phase of the life cycle."""
    if phase != needed:
        raise UnitError(f"{function} needs an instance {PHASES[needed]}, this one is {PHASES[phase]}")


def require_sound(function: str, failure: str | None) -> None:
    """UnitError for a call of an instance that has failed."""
    if failure is not None:
        raise UnitError(f"{function} is refused until fmi2Reset or fmi2SetFMUstate, the instance failed: {failure}")


def variable_of(variables: Sequence[dict[str, Any]], reference: int, kind: str) -> dict[str, Any]:
    """The variable of a value reference; CallError where there is none or it is not of the type `kind`."""
    if not 0 <= reference < len(variables):
        unsigned = reference % 2**32
        raise CallError(f"value reference must be within 0..{len(variables) - 1}, got {unsigned}")
    variable = variables[reference]
    if variable["type"] != kind:
        raise CallError(f"{variable['name']} is {variable['type']}, got a call for {kind}")
    return variable


def require_settable(variable: dict[str, Any], value: Any, phase: int) -> None:
    """CallError for what may not be set now, and for values that are not finite or out of bounds."""
    name, causality = variable["name"], variable["causality"]
    if causality not in ("input", "parameter"):
        raise CallError(f"{name} is {causality} and cannot be set, got {value!r}")
    if variable["variability"] == "fixed" and phase == STEPPING:
        raise CallError(f"{name} is fixed and cannot be set after initialisation, got {value!r}")
    if variable["type"] == "String":
        return
    if not math.isfinite(value):
        raise CallError(f"{name} must be finite, got {value!r}")
    minimum, maximum = variable.get("minimum"), variable.get("maximum")
    if minimum is not None and value < minimum:
        raise CallError(f"{name} must be >= {minimum!r}, got {value!r}")
    if maximum is not None and value > maximum:
        raise CallError(f"{name} must be <= {maximum!r}, got {value!r}")


def common_bounds(variables: Sequence[dict[str, Any]]) -> tuple[float, float]:
    """The range of values that all of some variables may have."""
    return (
        max((v.get("minimum", -math.inf) for v in variables), default=-math.inf),
        min((v.get("maximum", math.inf) for v in variables), default=math.inf),
    )
