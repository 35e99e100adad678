"""Values of variables by FMI's types: from TOML, from the command line, from XML documents."""

import re
from collections.abc import Mapping
from typing import Any

from flexbeams.plant.errors import InputError, suggestion

TypedValue = float | int | bool | str
INT32 = range(-(2**31), 2**31)
_BOOLEANS = {"true": True, "1": True, "false": False, "0": False}  # as xs:boolean spells them


class TypedNumber(float):
    """A number as a person typed it: a String variable takes the text."""

    text: str

    def __new__(cls, text: str) -> "TypedNumber":
        number = super().__new__(cls, text)
        number.text = text
        return number

    def __getnewargs__(self) -> tuple[str]:  # type: ignore[override]
        return (self.text,)


def enumeration_items(variable: Any) -> Mapping[str, int]:
    """Numbers of an Enumeration's items by name, empty where they are not known."""
    declared = getattr(variable, "declaredType", None)
    return {item.name: int(item.value) for item in (declared.items or [] if declared is not None else [])}


def value_of_text(variable: Any, text: str) -> TypedValue:
    """The value that an XML attribute or a start attribute gives a variable; ValueError where it is none."""
    kind = variable.type
    if kind == "String":
        return text
    text = text.strip()
    if kind == "Boolean":
        if text not in _BOOLEANS:
            raise ValueError(f"must be true or false, got {text!r}")
        return _BOOLEANS[text]
    if kind == "Enumeration":
        return _item(variable, text)
    return int(text) if kind == "Integer" else float(text)


def own_start(variable: Any) -> float:
    """The unit's own start value of a variable as a signal; 0 where it has none."""
    start = variable.start
    if start in (None, "") or variable.type == "String":
        return 0.0
    return float(value_of_text(variable, start) if isinstance(start, str) else start)


def _item(variable: Any, text: str) -> int:
    """The number of an item given by name or number; ValueError with the valid ones."""
    items = enumeration_items(variable)
    if text in items:
        return items[text]
    if re.fullmatch(r"[+-]?[0-9]+", text, re.ASCII) and (not items or int(text) in items.values()):
        return int(text)
    raise ValueError(f"must be an item{suggestion(text, items)}, got {text!r}")


def require_value(where: str, variable: Any, value: Any, source: str = "") -> TypedValue:
    """The value in the variable's type; InputError for one of another type, outside bounds, or no item.

    Enumerations take a number or an item's name.
    """
    kind = variable.type
    if kind == "String":
        if isinstance(value, (str, TypedNumber)):
            return value.text if isinstance(value, TypedNumber) else value
        raise InputError(where, "must be of type String", value, source=source)
    if kind == "Boolean" and isinstance(value, str) and value.lower() in ("true", "false"):
        return value.lower() == "true"
    if kind == "Enumeration" and isinstance(value, (str, float, int)) and not isinstance(value, bool):
        return _require_item(where, variable, value, source)
    whole = kind != "Integer" or (not isinstance(value, str) and value == int(value) and int(value) in INT32)
    if isinstance(value, str) or isinstance(value, bool) != (kind == "Boolean") or not whole or kind == "Enumeration":
        raise InputError(where, f"must be of type {kind}", value, source=source)
    require_bounds(where, variable, value, source)
    return bool(value) if kind == "Boolean" else int(value) if kind == "Integer" else float(value)


def _require_item(where: str, variable: Any, value: str | float, source: str) -> int:
    text = value if isinstance(value, str) else f"{value:.17g}"
    try:
        number = _item(variable, text)
    except ValueError:
        items = [f"{name} ({number})" for name, number in enumeration_items(variable).items()]
        rule = f"must be an item of the Enumeration, by name or number: {', '.join(items)}"
        raise InputError(where, rule, value, source=source) from None
    require_bounds(where, variable, number, source)
    return number


def require_bounds(where: str, variable: Any, value: float, source: str = "") -> None:
    """InputError for a value outside the variable's min and max."""
    low = "-inf" if variable.min is None else variable.min
    high = "inf" if variable.max is None else variable.max
    if not float(low) <= value <= float(high):
        raise InputError(where, f"must be from {low} to {high}", value, source=source)
