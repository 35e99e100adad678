"""The physical parameters of a structure: names, units, bounds and meanings.

Structure files, the units' interface, their kernels and the identification read this table.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import Field


@dataclass(frozen=True, slots=True, kw_only=True)
class PhysicalParameter:
    """A number that each beam, patch pair or spring has."""

    part: str  # beam, patch or spring
    name: str
    unit: str  # of measurement, written as FMI advises
    meaning: str  # {} stands for the number of the part
    may_vanish: bool = False  # 0 is allowed; all others are > 0
    minimum: float  # of plausible values, which units accept
    maximum: float

    def of(self, number: int) -> str:
        """Full name for one part, counted from 1: beam[2].density."""
        return f"{self.part}[{number}].{self.name}"

    @property
    def rule(self) -> str:
        """What its values must be."""
        return "must be finite and >= 0" if self.may_vanish else "must be finite and > 0"


PARAMETERS = (
    PhysicalParameter(
        part="beam",
        name="density",
        unit="kg/m3",
        meaning="Density of beam {}",
        minimum=1.0,
        maximum=1e6,
    ),
    PhysicalParameter(
        part="beam",
        name="youngs_modulus",
        unit="Pa",
        meaning="Young's modulus of beam {}",
        minimum=1e6,
        maximum=1e14,
    ),
    PhysicalParameter(
        part="beam",
        name="tip_mass",
        unit="kg",
        meaning="Tip mass of beam {}",
        may_vanish=True,
        minimum=0.0,
        maximum=1e4,
    ),
    PhysicalParameter(
        part="beam",
        name="viscous_damping",
        unit="N.s/m2",
        meaning="Viscous damping gamma^v of beam {}",
        may_vanish=True,
        minimum=0.0,
        maximum=1e6,
    ),
    PhysicalParameter(
        part="beam",
        name="structural_damping",
        unit="N.s",
        meaning="Structural damping gamma^sv of beam {}",
        may_vanish=True,
        minimum=0.0,
        maximum=1e6,
    ),
    PhysicalParameter(
        part="patch",
        name="density",
        unit="kg/m3",
        meaning="Density of patch pair {}",
        minimum=1.0,
        maximum=1e6,
    ),
    PhysicalParameter(
        part="patch",
        name="youngs_modulus",
        unit="Pa",
        meaning="Young's modulus of patch pair {}",
        minimum=1e6,
        maximum=1e14,
    ),
    PhysicalParameter(
        part="patch",
        name="viscous_damping",
        unit="N.s/m2",
        meaning="Viscous damping gamma^v of patch pair {}",
        may_vanish=True,
        minimum=0.0,
        maximum=1e6,
    ),
    PhysicalParameter(
        part="patch",
        name="structural_damping",
        unit="N.s",
        meaning="Structural damping gamma^sv of patch pair {}",
        may_vanish=True,
        minimum=0.0,
        maximum=1e6,
    ),
    PhysicalParameter(
        part="patch",
        name="piezo_ratio",
        unit="C/m2",
        meaning="Piezo ratio a11/beta of (9) of patch pair {}",
        minimum=1e-6,
        maximum=1e6,
    ),
    PhysicalParameter(
        part="spring",
        name="stiffness",
        unit="N/m",
        meaning="Stiffness of spring {}",
        may_vanish=True,
        minimum=0.0,
        maximum=1e9,
    ),
)


def parameters_of(part: str) -> tuple[PhysicalParameter, ...]:
    """The parameters of each beam, patch or spring."""
    return tuple(p for p in PARAMETERS if p.part == part)


def parameter(part: str, name: str) -> PhysicalParameter:
    """The parameter of a name; KeyError where there is none."""
    for entry in parameters_of(part):
        if entry.name == name:
            return entry
    raise KeyError(f"{part}[].{name}")


def within_bounds(part: str, name: str) -> Any:
    """The bounds of a parameter for a field of a pydantic dataclass: a finite number > 0, or >= 0."""
    if parameter(part, name).may_vanish:
        return Field(ge=0, strict=True, allow_inf_nan=False)
    return Field(gt=0, strict=True, allow_inf_nan=False)


def in_unit_order(names: Mapping[str, Any]) -> Iterator[tuple[str, PhysicalParameter]]:
    """Full names and parameters in the order of the units: the first parameter of every beam, then the second ..."""
    for entry in PARAMETERS:
        number = 1
        while (name := entry.of(number)) in names:
            yield name, entry
            number += 1
