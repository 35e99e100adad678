"""Instances as their model descriptions declare them, before any of them is loaded."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flexbeams.fmus.interface.variables import Interface
from flexbeams.fmus.units.catalogue import kind_named
from flexbeams.fmus.units.kind import UnitKind

TYPE_ORDER = ("Real", "Integer", "Boolean")  # types that a run reads, in the order in which it reads them


@dataclass(frozen=True, kw_only=True)
class DeclaredVariable:
    """A variable of a unit that is not built yet, with the attributes of FMPy's variables that a run needs."""

    name: str
    type: str
    causality: str
    start: Any
    min: Any
    max: Any
    unit: str | None
    nominal: float | None


@dataclass(frozen=True, kw_only=True)
class InstanceDeclaration:
    """The kind and the variables of an instance."""

    kind: UnitKind | None  # None for a unit that is not of this project
    variables: dict[str, Any]  # by name; DeclaredVariable or FMPy's
    description: Any = None  # FMPy's; None for a unit that is built from the design

    @classmethod
    def of_interface(cls, kind: UnitKind, interface: Interface) -> "InstanceDeclaration":
        """The declaration of a unit that is built from the design."""
        declared = {
            v.name: DeclaredVariable(
                name=v.name,
                type=v.type,
                causality=v.causality,
                start=v.start,
                min=v.minimum,
                max=v.maximum,
                unit=v.unit,
                nominal=v.nominal,
            )
            for v in interface.variables
        }
        return cls(kind=kind, variables=declared)

    @classmethod
    def of_description(cls, description: Any) -> "InstanceDeclaration":
        """The declaration in an FMU, as FMPy reads it."""
        variables = {v.name: v for v in description.modelVariables}
        return cls(kind=kind_named(description.modelName), variables=variables, description=description)


def element_names(variables: Mapping[str, Any], name: str) -> list[str]:
    """Scalars that a name stands for: itself, or all elements name[1], name[2], ...; empty if there are none."""
    if name in variables:
        return [name]
    prefix = f"{name}["
    return [n for n in variables if n.startswith(prefix) and n.endswith("]") and "]." not in n]
