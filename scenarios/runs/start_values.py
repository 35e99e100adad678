"""Start values of the instances: a scenario's factors and tables, then --set."""

import re
from collections.abc import Mapping
from typing import Any

from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.declaration import InstanceDeclaration, element_names
from flexbeams.scenarios.definition.schema import Scenario, Value
from flexbeams.scenarios.simulation.wiring import Wiring

_INTEGERS = range(-(2**31), 2**31)


def start_values(
    scenario: Scenario, instances: Mapping[str, InstanceDeclaration], settings: Mapping[str, Value], source: str
) -> dict[str, dict[str, float | bool]]:
    """Start values of each instance by variable; `settings` has those of --set. InputError for one that cannot be."""
    values: dict[str, dict[str, float | bool]] = {name: {} for name in instances}
    for name, instance in scenario.instance.items():
        variables = instances[name].variables
        for key, factor in instance.scale.items():
            where = f"instance.{name}.scale.{key}"
            for variable, f in _pairs(where, key, factor, variables, source):
                if variables[variable].type != "Real":
                    raise InputError(where, "must be of a Real variable", variables[variable].type, source=source)
                scaled = float(variables[variable].start) * float(f)
                _require_value(where, variables[variable], scaled, source)
                values[name][variable] = scaled
        for key, value in instance.start.items():
            values[name] |= _checked(f"instance.{name}.start.{key}", key, value, variables, source)
    for key, value in settings.items():
        owner, _, variable = key.partition(".")
        if owner not in instances:
            raise InputError("--set", f"names an unknown instance {owner!r}" + suggestion(owner, instances), key)
        values[owner] |= _checked(f"--set {key}", variable, value, instances[owner].variables, "")
    return values


def require_open(wiring: Wiring, settings: Mapping[str, Value]) -> None:
    """InputError for a --set of an input that a connection or a signal drives: it would never be seen."""
    external = {
        place for span, signal in wiring.external if isinstance(signal, float) for place in range(span.start, span.stop)
    }
    for key in settings:
        owner, _, variable = key.removesuffix("[]").partition(".")
        driven = [n for n, place in wiring.inputs[owner] if place not in external]
        if any(n == variable or n.startswith(f"{variable}[") for n in driven):
            raise InputError("--set", "must not set an input that the scenario drives", key)


def _checked(where: str, key: str, value: Any, variables: Mapping[str, Any], source: str) -> dict[str, float | bool]:
    pairs = _pairs(where, key, value, variables, source)
    for name, v in pairs:
        _require_value(where, variables[name], v, source)
    return dict(pairs)


def _pairs(where: str, key: str, value: Any, variables: Mapping[str, Any], source: str) -> list[tuple[str, Any]]:
    """A value for a scalar, an array (name) or all numbers of a family (name with []), as pairs by scalar."""
    if "[]" in key:
        head, tail = key.split("[]", 1)
        names = [n for n in variables if n.startswith(f"{head}[") and n.endswith(f"]{tail}")]
    else:
        names = element_names(dict(variables), key)
    settable = [n for n in names if variables[n].causality in ("parameter", "input")]
    if not settable:
        known = [
            re.sub(r"\[[0-9,]+\]$", "", re.sub(r"\[[0-9,]+\]\.", "[].", n))
            for n, v in variables.items()
            if v.causality in ("parameter", "input")
        ]  # arrays and families, not each of their numbers
        rule = "is not settable" if names else "is not a variable" + suggestion(key, known)
        raise InputError(where, rule, key, source=source)
    listed = value if isinstance(value, list) else [value] * len(settable)
    if len(listed) != len(settable):
        raise InputError(where, f"must have {len(settable)} values", value, source=source)
    return list(zip(settable, listed, strict=True))


def _require_value(where: str, variable: Any, value: float | bool, source: str) -> None:
    """InputError for a value that is not of the variable's type or not within its bounds."""
    kind = variable.type
    whole = kind != "Integer" or (value == int(value) and int(value) in _INTEGERS)
    if isinstance(value, bool) != (kind == "Boolean") or kind not in ("Real", "Integer", "Boolean") or not whole:
        raise InputError(where, f"must be of type {kind}", value, source=source)
    low = "-inf" if variable.min is None else variable.min
    high = "inf" if variable.max is None else variable.max
    if not float(low) <= value <= float(high):
        raise InputError(where, f"must be from {low} to {high}", value, source=source)
