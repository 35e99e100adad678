"""The C mathematics of a unit: its source file and the data that it takes.

A kernel is one C file with a table of hooks (native/units/unit.h) and, in its header, a struct for its data. The
fields of that struct are given here as Python values; fmus.packaging.c_tables writes them as C.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike, NDArray

from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.interface.variables import Interface

NATIVE = Path(__file__).parents[1] / "native"


@dataclass(frozen=True, kw_only=True)
class UnitData:
    """The numbers that a unit carries, the same for both kernels."""

    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    meta: Mapping[str, Any] = field(default_factory=dict)  # JSON values


@dataclass(frozen=True, kw_only=True)
class Table:
    """A constant array of numbers, `const double *`, of uint32 `const unsigned *`, of uint8 `const unsigned char *`.

    `comment` gives meaning, shape and unit. `decimals` are matrices, by title, that the comment repeats as decimals.
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


@dataclass(frozen=True)
class Text:
    """A name for people, char[NAME_SIZE]."""

    text: str


# A field is a number, a truth value, a C expression, a name, an array, or the fields of a struct within.
Field = int | float | bool | str | Text | Table | Records | Mapping[str, Any]
Fields = Mapping[str, Field]


@dataclass(frozen=True, kw_only=True)
class NativeKernel:
    """The native mathematics of one kind of unit."""

    source: Path  # its C file; those of the headers that it includes are added
    data_type: str  # BeamPlantData
    hooks: str  # beam_plant_hooks
    data: Callable[[Interface, UnitData], Fields]
    deferred: tuple[str, ...] = ()  # arrays that are computed when they are read
    interpolates_inputs: bool = False
    provides_derivatives: bool = False  # directional ones: there is a hook `differentiate`


def first_references(interface: Interface, *arrays: str) -> dict[str, int]:
    """The value reference of each array's first element, by its name."""
    return {name: interface.references(name).start for name in arrays}


def header_constant(header: Path, name: str) -> int:
    """The whole number that a C header defines by this name; BuildError where it does not."""
    match = re.search(rf"^#define {name} (\d+)\b", header.read_text(encoding="utf-8"), re.MULTILINE)
    if match is None:
        raise BuildError(f"{header.name} must define the number {name}")
    return int(match.group(1))
