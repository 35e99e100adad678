"""Units of measurement as FMI and SSP define them, and the conversion of a value from one to another."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from flexbeams.fmus.interface.si import SI_UNITS

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True, kw_only=True)
class Dimension:
    """A unit of measurement: a value in SI base units is factor * value + offset."""

    exponents: tuple[int, ...]  # of BASE
    factor: float = 1.0
    offset: float = 0.0

    @classmethod
    def of_base(cls, base: Mapping[str, Any]) -> "Dimension":
        """That of the attributes of a BaseUnit."""
        return cls(
            exponents=tuple(int(base.get(k) or 0) for k in BASE),
            factor=float(base.get("factor") or 1),
            offset=float(base.get("offset") or 0),
        )


@dataclass(frozen=True, kw_only=True)
class Conversion:
    """target = factor * source + offset."""

    factor: float
    offset: float

    @property
    def trivial(self) -> bool:
        """Whether it changes nothing."""
        return self.factor == 1.0 and self.offset == 0.0


IDENTITY = Conversion(factor=1.0, offset=0.0)
OWN_DIMENSIONS = {name: Dimension.of_base(base) for name, base in SI_UNITS.items()}
_MULTIPLES = {  # units that recordings of other tools are in, with their size in an SI unit
    "s": {"ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "min": 60.0, "h": 3600.0},
    "m": {"km": 1e3, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "nm": 1e-9},
    "1": {"m/m": 1.0, "mm/m": 1e-3, "um/m": 1e-6, "µm/m": 1e-6, "μm/m": 1e-6, "%": 1e-2},
    "V": {"kV": 1e3, "mV": 1e-3, "uV": 1e-6, "µV": 1e-6, "μV": 1e-6},
    "N": {"kN": 1e3, "mN": 1e-3},
    "kg": {"g": 1e-3, "t": 1e3},
    "Pa": {"kPa": 1e3, "MPa": 1e6, "GPa": 1e9},
    "J": {"kJ": 1e3, "mJ": 1e-3},
    "Hz": {"kHz": 1e3},
    "m/s": {"mm/s": 1e-3},
}
KNOWN_DIMENSIONS = OWN_DIMENSIONS | {
    name: replace(OWN_DIMENSIONS[si], factor=size) for si, sizes in _MULTIPLES.items() for name, size in sizes.items()
}


def si_unit(name: str) -> str:
    """The SI unit of the quantity that a unit of KNOWN_DIMENSIONS measures."""
    return next((si for si, sizes in _MULTIPLES.items() if name in sizes), name)


def declared_dimensions(description: Any) -> dict[str, Dimension]:
    """Dimensions by name that FMPy's description of an FMU defines."""
    return {
        unit.name: Dimension.of_base({k: getattr(unit.baseUnit, k) for k in (*BASE, "factor", "offset")})
        for unit in description.unitDefinitions or []
        if unit.baseUnit is not None
    }


def conversion(
    one: str, other: str, of_one: Mapping[str, Dimension], of_other: Mapping[str, Dimension]
) -> Conversion | str:
    """The conversion from unit `one` to `other`, or the reason why there is none; units left open agree with all."""
    if not one or not other:
        return IDENTITY
    first, second = of_one.get(one), of_other.get(other)
    if first is None or second is None:
        if one == other:
            return IDENTITY
        unknown = one if first is None else other
        return f"the units {one!r} and {other!r} cannot be compared, {unknown!r} has no definition"
    if first.exponents != second.exponents:
        return f"the units {one!r} and {other!r} are of different quantities"
    if (first.factor, first.offset) == (second.factor, second.offset):
        return IDENTITY
    return Conversion(factor=_ratio(first, second), offset=(first.offset - second.offset) / second.factor)


def _ratio(first: Dimension, second: Dimension) -> float:
    """The quotient of factors; exact where it is a power of ten, as 1 / 0.001 is and 0.001 / 1e-6 is not."""
    ratio = first.factor / second.factor
    decimal = float(f"{ratio:.12g}")
    return decimal if abs(ratio - decimal) <= 4e-16 * abs(ratio) else ratio
