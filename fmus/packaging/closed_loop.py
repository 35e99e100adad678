"""BeamClosedLoop: the wired instances of a scenario as one native unit.

Its variables are those of its parts, <part>.<variable>, each part's in one piece with its time first: the mathematics
of a part works on a slice of the whole's values.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from numpy.typing import ArrayLike

from flexbeams.fmus.documents.closed_loop_page import Block, loop_picture, wiring_page
from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.interface.variables import Interface, Variable, time_variable
from flexbeams.fmus.packaging.c_tables import (
    DEFERRED,
    NAME_SIZE,
    c_list,
    c_real,
    c_source,
    c_text,
    interface_tables,
    kernel_tables,
)
from flexbeams.fmus.packaging.native import FMI_FILES, NativeUnit, mathematics_files, native_source

UNIT = "BeamClosedLoop"
_INNER = ("x_ref",)  # outputs that concern nobody outside once they are wired


@dataclass(frozen=True, kw_only=True)
class Part:
    """A unit within a closed loop; data and meta are those of fmus.data.unit_data."""

    name: str
    interface: Interface
    data: Mapping[str, ArrayLike]
    meta: Mapping[str, Any]

    @property
    def unit(self) -> str:
        """Which unit it is."""
        return self.interface.unit_name

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Those with a place among the values, time first; the texts, which have none, stand behind them."""
        return tuple(v for v in self.interface if v.type != "String")


@dataclass(frozen=True, kw_only=True)
class Wire:
    """An output and an input that takes its value, both by <part>.<variable>."""

    source: str
    to: str


@dataclass(frozen=True, kw_only=True)
class ClosedLoop(NativeUnit):
    """A unit of wired parts, which step in their order; `interface` is that of closed_loop_interface."""

    data: Mapping[str, ArrayLike] = field(default_factory=dict)
    parts: tuple[Part, ...]
    wires: tuple[Wire, ...]
    coupling: str  # jacobi or gauss-seidel

    def files(self) -> tuple[str, ...]:
        """The files of fmus/native that are among its sources."""
        headers = {file for part in self.parts for file in mathematics_files(part.unit) if file.endswith(".h")}
        return (*FMI_FILES, "closed_loop.c", "closed_loop.h", "part.h", *sorted(headers))

    def tables(self, guid: str) -> dict[str, str]:
        """tables.c, part_<k>.c, and the mathematics under names that no tool compiles, since the parts include it."""
        sources = {f"part_{k}.c": self._part_source(part, k) for k, part in enumerate(self.parts, 1)}
        included = {
            _included(file): native_source(file)
            for part in self.parts
            for file in mathematics_files(part.unit)
            if file.endswith(".c")
        }
        return sources | included | {"tables.c": self._loop_source(guid)}

    def compiled(self) -> list[str]:
        """All .c files: the parts include the mathematics, each under names of its own."""
        parts = [f"part_{k}.c" for k in range(1, len(self.parts) + 1)]
        return sorted([*(file for file in FMI_FILES if file.endswith(".c")), "closed_loop.c", "tables.c", *parts])

    def picture(self) -> bytes:
        """model.png: the parts as blocks with their wires."""
        return loop_picture(self.interface, self._blocks(), self._array_wires())

    def page(self, picture: bytes) -> str:
        """documentation/index.html."""
        return wiring_page(self.interface, picture, self._blocks(), self._array_wires(), self.coupling)

    def _blocks(self) -> list[Block]:
        return [Block(name=part.name, unit=part.unit) for part in self.parts]

    def _array_wires(self) -> list[tuple[str, str]]:
        """Arrays for elements, each pair once."""
        arrays = {f"{part.name}.{v.name}": f"{part.name}.{v.array}" for part in self.parts for v in part.interface}
        return list(dict.fromkeys((arrays[w.source], arrays[w.to]) for w in self.wires))

    def _part_source(self, part: Part, number: int) -> str:
        files = [file for file in mathematics_files(part.unit) if file.endswith(".c")]
        return c_source(
            f"{part.name}, a {part.unit}, as a part of a closed loop",
            f"#define PART(name) part_{number}_##name",
            f"#define PART_VALUES {self.interface.reference(f'{part.name}.time')}",
            "",
            '#include "part.h"',
            *[f'#include "{_included(file)}"' for file in files],
            "",
            f"const double unit_step_size = {c_real(part.interface.step_size)};",
            *kernel_tables(part.interface, part.data, part.meta),
        )

    def _loop_source(self, guid: str) -> str:
        names = {w.to: w.source for w in self.wires}
        runs: list[list[int]] = []
        parts = []
        for part in self.parts:
            first = len(runs)
            for v in part.variables:
                if (to := f"{part.name}.{v.name}") in names:
                    _extend(runs, first, self.interface.reference(names[to]), self.interface.reference(to))
            parts.append(
                f"{{.values = {self.interface.reference(f'{part.name}.time')}, .first_wire = {first}, "
                f".wire_count = {len(runs) - first}, .name = {c_text(part.name, NAME_SIZE)}}}"
            )
        wires = [f"{{.from = {source}, .to = {to}, .count = {count}}}" for source, to, count in runs]
        numbers = range(1, len(self.parts) + 1)
        deferred = {f"{part.name}.{array}" for part in self.parts for array in DEFERRED.get(part.unit, ())}
        return c_source(
            f"the tables of {UNIT}",
            '#include "closed_loop.h"',
            "",
            *interface_tables(self.interface, guid, deferred),
            f"const size_t loop_part_count = {len(parts)};",
            f"const size_t loop_wire_count = {len(wires)};",
            f"const bool loop_is_sequential = {'true' if self.coupling == 'gauss-seidel' else 'false'};",
            c_list("loop_part loop_parts[]", parts, 1),
            c_list("loop_wire loop_wires[]", wires or ["{0}"], 1),
            *[f"SHARED mathematics fmi2FullName(part_{k}_mathematics)(void);" for k in numbers],
            "\nmathematics loop_mathematics(size_t part)\n{\n    switch (part) {",
            *[f"    case {k - 1}: return fmi2FullName(part_{k}_mathematics)();" for k in numbers[:-1]],
            f"    default: return fmi2FullName(part_{numbers[-1]}_mathematics)();",
            "    }\n}\n",
        )


def _included(file: str) -> str:
    """beam_plant.c as beam_plant.inc: some tools compile every .c file that they find."""
    return file.removesuffix(".c") + ".inc"


def closed_loop_interface(
    parts: Sequence[Part], wires: Sequence[Wire], step: float, stop_time: float, description: str
) -> Interface:
    """The variables of a closed loop that communicates inside every `step` (s).

    Inputs that are wired become locals. Raises InterfaceError for an array of inputs that is wired in part, and for
    names that do not fit.
    """
    sources = {w.to: w.source for w in wires}
    known = {f"{part.name}.{v.name}": (part, v) for part in parts for v in part.interface}
    passed_on = set(sources.values())
    for part in parts:
        _check_arrays(part, sources)

    def origins(part: Part, arrays: Iterable[str], seen: set[str]) -> list[str]:
        """The arrays of inputs of the whole on which first values depend that depend on these inputs of a part."""
        found = []
        for array in arrays:
            for v in part.interface.variables[(span := part.interface.references(array)).start : span.stop]:
                name = f"{part.name}.{v.name}"
                if name not in sources:
                    found.append(f"{part.name}.{array}")
                elif name not in seen:
                    seen.add(name)
                    owner, output = known[sources[name]]
                    found += origins(owner, output.initial_inputs, seen)
        return list(dict.fromkeys(found))

    def outer(part: Part, v: Variable) -> Variable:
        name = f"{part.name}.{v.name}"
        if v.causality == "independent":
            return replace(
                v,
                name=name,
                causality="local",
                variability="",
                initial=None,
                description=f"Time that {part.name} has reached",
            )
        if name in sources:
            return replace(
                v,
                name=name,
                causality="local",
                initial=None,
                start=None,
                description=f"{v.description}; from {sources[name]}",
                initial_inputs=tuple(origins(part, [v.array], set())),
            )
        inner = v.array in _INNER and name in passed_on
        return replace(
            v,
            name=name,
            causality="local" if inner else v.causality,
            initial_inputs=tuple(origins(part, v.initial_inputs, set())),
        )

    return Interface(
        unit_name=UNIT,
        description=description,
        step_size=step,
        stop_time=stop_time,
        variables=(
            time_variable,
            *[outer(part, v) for part in parts for v in part.variables],
            parts[0].interface["design_id"],
        ),
    )


def _check_arrays(part: Part, sources: Mapping[str, str]) -> None:
    for array, span in part.interface.arrays.items():
        names = [f"{part.name}.{part.interface.variables[k].name}" for k in span]
        wired = [name for name in names if name in sources]
        if wired and len(wired) < len(names):
            raise InterfaceError(
                f"{part.name}.{array} must be wired as a whole or not at all in a closed loop, got {', '.join(wired)}"
            )


def _extend(runs: list[list[int]], first: int, source: int, to: int) -> None:
    """One more wire: the last run of those from `first` on, or a new one."""
    if len(runs) > first and (source, to) == (runs[-1][0] + runs[-1][2], runs[-1][1] + runs[-1][2]):
        runs[-1][2] += 1
    else:
        runs.append([source, to, 1])
