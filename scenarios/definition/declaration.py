"""Instances as their model descriptions declare them, before any of them is loaded."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

TYPE_ORDER = ("Real", "Integer", "Boolean")  # types that a run reads, in the order in which it reads them


@dataclass(frozen=True, kw_only=True)
class InstanceDeclaration:
    """The kind and the variables of an instance."""

    description: Any  # with modelName
    variables: dict[str, Any]  # by name; each with name, type, causality, start, min and max


def element_names(variables: Mapping[str, Any], name: str) -> list[str]:
    """Scalars that a name stands for: itself, or all elements name[1], name[2], ...; empty if there are none."""
    if name in variables:
        return [name]
    prefix = f"{name}["
    return [n for n in variables if n.startswith(prefix) and n.endswith("]") and "]." not in n]
