"""Instances as their model descriptions declare them, before any of them is loaded."""

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from flexbeams.fmus.interface.variables import Interface
from flexbeams.fmus.units.catalogue import kind_named
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.scenarios.definition.dimensions import OWN_DIMENSIONS, Dimension, declared_dimensions

TYPE_ORDER = ("Real", "Integer", "Boolean")  # FMI's functions by type, in the order in which a run calls them


def access_type(kind: str) -> str:
    """The type whose functions read and write a variable: FMI sets an Enumeration as an Integer."""
    return "Integer" if kind == "Enumeration" else kind


def access_order(variable: Any) -> int:
    """The place of a variable's type in TYPE_ORDER, a sort key."""
    return TYPE_ORDER.index(access_type(variable.type))


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
    description: str | None
    nominal: float | None
    declaredType: None = None  # no Enumerations


@dataclass(frozen=True, kw_only=True)
class InstanceDeclaration:
    """The kind and the variables of an instance."""

    kind: UnitKind | None  # None for a unit that is not of this project
    variables: dict[str, Any]  # by name; DeclaredVariable or FMPy's
    description: Any = None  # FMPy's; None for a unit that is built from the design
    dimensions: Mapping[str, Dimension] = field(default_factory=dict)  # units of measurement by name

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
                description=v.description,
                nominal=v.nominal,
            )
            for v in interface.variables
        }
        return cls(kind=kind, variables=declared, dimensions=OWN_DIMENSIONS)

    @classmethod
    def of_description(cls, description: Any) -> "InstanceDeclaration":
        """The declaration in an FMU, as FMPy reads it."""
        variables = {v.name: v for v in description.modelVariables}
        return cls(
            kind=kind_named(description.modelName),
            variables=variables,
            description=description,
            dimensions=declared_dimensions(description),
        )


def element_names(variables: Collection[str], name: str) -> list[str]:
    """Scalars that a name stands for: itself, or all elements name[1], name[2] ... by index; may be empty."""
    if name in variables:
        return [name]
    prefix = f"{name}["
    inside = (n for n in variables if n.startswith(prefix) and n.endswith("]"))
    return by_index(n for n in inside if "]." not in n.removeprefix(prefix))


def by_index(names: Iterable[str]) -> list[str]:
    """Names in the order of the numbers in their brackets: u[2] before u[10], whatever the order of declaration."""
    return sorted(
        names, key=lambda n: [tuple(map(int, i.split(","))) for i in re.findall(r"\[([0-9]+(?:,[0-9]+)*)\]", n)]
    )


def split_owner(text: str, owners: Iterable[str]) -> tuple[str, str]:
    """The instance and the variable of <instance>.<variable>, where names of instances may have dots."""
    owner = max((name for name in owners if text.startswith(f"{name}.")), key=len, default=text.partition(".")[0])
    return owner, text.removeprefix(owner).removeprefix(".")


def is_settable(variable: Any) -> bool:
    """Whether a variable takes a start value: parameters, inputs, and what starts exactly or approximately."""
    if variable.causality in ("parameter", "input"):
        return True
    variable_initial = getattr(variable, "initial", None)
    return variable_initial in ("exact", "approx") and getattr(variable, "variability", None) != "constant"
