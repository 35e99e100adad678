"""Which output may drive which input: types, items of Enumerations, units of measurement."""

from collections.abc import Mapping
from typing import Any

from flexbeams.scenarios.definition.dimensions import Conversion, Dimension, conversion
from flexbeams.scenarios.definition.values import enumeration_items

# Types of outputs that an input takes without a change of value
_TAKEN = {
    "Real": ("Real", "Integer"),
    "Integer": ("Integer", "Enumeration"),
    "Boolean": ("Boolean",),
    "Enumeration": ("Enumeration",),
}


def join_problem(start: Any, end: Any) -> str:
    """Why the output `start` cannot drive the input `end` by its type; empty where it can."""
    if start.type not in _TAKEN.get(end.type, ()):
        return f"joins types that differ: {start.type} and {end.type}"
    if end.type == "Enumeration":
        items, others = enumeration_items(start), enumeration_items(end)
        if items and others and items != others:
            return f"joins Enumerations of different items: {', '.join(items)} and {', '.join(others)}"
    return ""


def joined(
    start: Any,
    end: Any,
    of_start: Mapping[str, Dimension],
    of_end: Mapping[str, Dimension],
    given: Conversion | None = None,
) -> Conversion | str:
    """What the input takes of the output's value, or the reason why they cannot be joined.

    `given` takes the place of the conversion between units of measurement.
    """
    if problem := join_problem(start, end):
        return problem
    if end.type != "Real":
        if given is not None and not given.trivial:
            return f"must have no factor and offset between {start.type} and {end.type}"
        return Conversion(factor=1.0, offset=0.0)
    found = given or conversion(start.unit or "", end.unit or "", of_start, of_end)
    return f"cannot be converted: {found}" if isinstance(found, str) else found
