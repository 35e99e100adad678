"""The C mathematics of a unit: where it is, and the data that it takes.

A kernel is one C file with a table of hooks (native/units/unit.h) and, in its header, a struct for its data. The
fields of that struct are given here as Python values; fmus.packaging.c_tables writes them as C.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike, NDArray

from flexbeams.fmus.interface.variables import Interface

NATIVE = Path(__file__).parents[1] / "native"

Data = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class Table:
    """A constant array of numbers, `const double *` or, of uint8, `const unsigned char *`.

    `comment` says what it is, its shape and its unit. `decimals` are matrices that the comment shows as decimals too,
    by what they are.
    """

    values: ArrayLike
    comment: str
    in_panels: bool = False  # stored as native/numerics/linear_algebra.h describes
    decimals: Mapping[str, NDArray[Any]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Records:
    """A constant array of structs of one type, each by its fields."""

    type: str
    rows: Sequence[Fields]
    comment: str


# A field is a number, a truth value, a C expression, an array, or the fields of a struct within.
Field = int | float | bool | str | Table | Records | Mapping[str, Any]
Fields = Mapping[str, Field]


@dataclass(frozen=True, kw_only=True)
class Kernel:
    """The native mathematics of one kind of unit."""

    source: Path  # its C file; files that belong to headers included there come along
    data_type: str  # BeamPlantData
    hooks: str  # beam_plant_hooks
    data: Callable[[Interface, Data, Mapping[str, Any]], Fields]  # from interface, arrays and plain values of a unit
    deferred: tuple[str, ...] = ()  # arrays that are computed when they are read
    interpolates_inputs: bool = False


def first_references(interface: Interface, *arrays: str) -> dict[str, int]:
    """The value reference of each array's first element, by its name."""
    return {name: interface.references(name).start for name in arrays}
