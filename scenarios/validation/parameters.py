"""Values of an SSP's parameter sets: matched with the variables of an FMU, converted, checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.declaration import is_settable
from flexbeams.scenarios.definition.dimensions import IDENTITY, Conversion, Dimension, conversion
from flexbeams.scenarios.definition.values import TypedValue, require_bounds, value_of_text
from flexbeams.scenarios.importing.package import Component, Parameter


@dataclass(frozen=True, kw_only=True)
class ParameterValues:
    """Start values of a component by variable, the last one counts; notes and problems in one line each."""

    values: dict[str, TypedValue] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    differences: list[str] = field(default_factory=list)  # from the FMU's own start values


def parameter_values(
    component: Component, description: Any, dimensions: Mapping[str, Dimension], of_unit: Mapping[str, Dimension]
) -> ParameterValues:
    """The values that a component's bindings give the variables of its FMU; `dimensions` are those of the package.

    As SSP 1.0.1 asks, parameters that match no variable are ignored, with a note.
    """
    found = ParameterValues()
    variables = {v.name: v for v in description.modelVariables}
    for parameter in component.parameters:
        name = f"{component.name}.{parameter.name}"
        variable = variables.get(parameter.name)
        if variable is None:
            hint = suggestion(parameter.name, variables)
            found.notes.append(f"{name} is ignored, it is not a variable of its FMU{hint}")
            continue
        try:
            units = _units_conversion(parameter, variable, {**of_unit, **dimensions}, of_unit)
            found.values[parameter.name] = _value(parameter, variable, units)
        except InputError as error:
            found.problems.append(f"{name} {error}")
            continue
        if not units.trivial:
            found.notes.append(f"{name} is converted from {parameter.unit} to {variable.unit}")
    for variable_name, value in found.values.items():
        own = variables[variable_name].start
        if own is not None and value != value_of_text(variables[variable_name], own):
            text = f"is {value!r} in the parameter set and {own} in its FMU"
            found.differences.append(f"{component.name}.{variable_name} {text}")
    return found


def _units_conversion(
    parameter: Parameter, variable: Any, dimensions: Mapping[str, Dimension], of_unit: Mapping[str, Dimension]
) -> Conversion:
    """Between the units of measurement of a parameter and its variable; InputError where there is none."""
    if variable.type != "Real" or not parameter.converted:
        return IDENTITY
    found = conversion(parameter.unit, variable.unit or "", dimensions, of_unit)
    if isinstance(found, str):
        units = f"has the unit {parameter.unit!r} in the parameter set and {variable.unit or ''!r} in its FMU"
        raise InputError("", units)
    return found


def _value(parameter: Parameter, variable: Any, units: Conversion) -> TypedValue:
    """The value in the variable's type, converted by `units`, then by the transformation of a mapping.

    InputError without a key where it does not fit.
    """
    if not is_settable(variable):
        raise InputError("", f"is {variable.causality} in its FMU and cannot take a start value")
    if parameter.type != variable.type and (parameter.type, variable.type) != ("Integer", "Real"):
        raise InputError("", f"is {parameter.type} in the parameter set and {variable.type} in its FMU")
    try:
        value = value_of_text(variable, parameter.value)
    except ValueError as error:
        raise InputError("", str(error)) from None
    if variable.type == "Real":
        value = parameter.factor * (units.factor * float(value) + units.offset) + parameter.offset
    elif parameter.factor != 1.0 or parameter.offset != 0.0:
        raise InputError("", f"is {variable.type} and takes no linear transformation")
    if variable.type in ("Real", "Integer"):
        low, high = (float(variable.min or "-inf"), float(variable.max or "inf"))
        if not low <= float(value) <= high or not isfinite(float(value)):
            raise InputError("", f"must be finite and from {low:g} to {high:g}, got {parameter.value}")
    elif variable.type == "Enumeration":
        require_bounds("", variable, float(value))
    return value
