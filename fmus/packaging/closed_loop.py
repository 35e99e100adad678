"""BeamClosedLoop: the wired instances of a scenario as one native unit.

Its variables are those of its parts, <part>.<variable>, each part's in one piece with its time first: the mathematics
of a part works on a slice of the whole's values.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from flexbeams.fmus.documents.closed_loop_page import Block, loop_picture, wiring_page
from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.interface.variables import Interface, Variable, time_variable
from flexbeams.fmus.packaging.c_tables import (
    NAME_SIZE,
    c_array,
    c_real,
    c_text,
    description_tables,
    heading,
    kernel_data,
)
from flexbeams.fmus.packaging.native import NativeUnit
from flexbeams.fmus.units.kernels import NATIVE, Kernel
from flexbeams.fmus.units.native_kernels import kernel_of

UNIT = "BeamClosedLoop"
_HIDDEN_WHEN_WIRED = ("x_ref",)  # outputs hidden once connected


@dataclass(frozen=True, kw_only=True)
class Part:
    """A unit within a closed loop; data and meta are those of fmus.packaging.design_data.unit_data."""

    name: str
    interface: Interface
    data: Mapping[str, ArrayLike]
    meta: Mapping[str, Any]

    @property
    def unit(self) -> str:
        """Which unit it is."""
        return self.interface.unit_name

    @property
    def kernel(self) -> Kernel:
        """Its mathematics."""
        return kernel_of(self.unit)

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

    def interpolates_inputs(self) -> bool:
        """Inputs are held."""
        return False

    def kernels(self) -> list[Path]:
        """The C files of its mathematics, that of each kind of part once."""
        return [NATIVE / "units" / "closed_loop.c", *dict.fromkeys(part.kernel.source for part in self.parts)]

    def tables(self, guid: str) -> str:
        """The C text of the parts' data, of the wires, and of the variables and the GUID."""
        deferred = {f"{part.name}.{array}" for part in self.parts for array in part.kernel.deferred}
        return "\n".join(
            [
                heading(self.interface),
                *[text for number, part in enumerate(self.parts, 1) for text in self._part_data(part, number)],
                *self._loop_data(),
                *description_tables(self.interface, guid, "closed_loop_hooks", "unit_data", deferred),
            ]
        )

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

    def _part_data(self, part: Part, number: int) -> list[str]:
        about = f"/* Part {number}: {part.name}, a {part.unit}. Value references are its own. */\n"
        return [about, *kernel_data(f"part_{number}", part.kernel, part.interface, part.data, part.meta)]

    def _loop_data(self) -> list[str]:
        sources = {w.to: w.source for w in self.wires}
        runs: list[list[int]] = []
        parts = []
        for number, part in enumerate(self.parts, 1):
            first = len(runs)
            for v in part.variables:
                if (to := f"{part.name}.{v.name}") in sources:
                    _extend(runs, first, self.interface.reference(sources[to]), self.interface.reference(to))
            parts.append(
                f"{{.hooks = &{part.kernel.hooks}, .data = &part_{number}, "
                f".step_size = {c_real(part.interface.step_size)}, "
                f".values = {self.interface.reference(f'{part.name}.time')}, .first_wire = {first}, "
                f".wire_count = {len(runs) - first}, .name = {c_text(part.name, NAME_SIZE)}}}"
            )
        wires = [f"{{.from = {source}, .to = {to}, .count = {count}}}" for source, to, count in runs]
        return [
            c_array("LoopPart data_parts[]", "the parts in the order in which they step", parts, 1),
            c_array("LoopWire data_wires[]", "from outputs to inputs, by value reference", wires or ["{0}"], 1),
            "static const ClosedLoopData unit_data = {\n"
            f"    .part_count = {len(parts)},\n    .parts = data_parts,\n"
            f"    .wire_count = {len(wires)},\n    .wires = data_wires,\n"
            f"    .is_sequential = {'true' if self.coupling == 'gauss-seidel' else 'false'},\n}};\n",
        ]


def closed_loop_interface(
    parts: Sequence[Part], wires: Sequence[Wire], step: float, stop_time: float, description: str
) -> Interface:
    """The variables of a closed loop that communicates inside every `step` (s).

    Inputs that are wired become locals. Raises InterfaceError for an array of inputs that is wired in part, and for
    names that do not fit.
    """
    wiring = _Wiring(parts, wires)
    for part in parts:
        _check_arrays(part, wiring.sources)
    return Interface(
        unit_name=UNIT,
        description=description,
        step_size=step,
        stop_time=stop_time,
        variables=(
            time_variable,
            *[wiring.outer(part, v) for part in parts for v in part.variables],
            parts[0].interface["design_id"],
        ),
    )


class _Wiring:
    """The parts' variables as those of the whole."""

    def __init__(self, parts: Sequence[Part], wires: Sequence[Wire]) -> None:
        self.sources = {w.to: w.source for w in wires}
        self._owners = {f"{part.name}.{v.name}": (part, v) for part in parts for v in part.interface}

    def outer(self, part: Part, v: Variable) -> Variable:
        """What the whole shows of a part's variable."""
        name = f"{part.name}.{v.name}"
        if v.causality == "independent":
            text = f"Time that {part.name} has reached"
            return replace(v, name=name, causality="local", variability="", initial=None, description=text)
        if name in self.sources:
            return replace(
                v,
                name=name,
                causality="local",
                initial=None,
                start=None,
                description=f"{v.description}; from {self.sources[name]}",
                initial_inputs=tuple(self._origins(part, [v.array], set())),
            )
        hidden = v.array in _HIDDEN_WHEN_WIRED and name in self.sources.values()
        return replace(
            v,
            name=name,
            causality="local" if hidden else v.causality,
            initial_inputs=tuple(self._origins(part, v.initial_inputs, set())),
        )

    def _origins(self, part: Part, arrays: Iterable[str], seen: set[str]) -> list[str]:
        """The arrays of inputs of the whole on which first values depend that depend on these inputs of a part."""
        origins = []
        for array in arrays:
            for v in part.interface.variables[(span := part.interface.references(array)).start : span.stop]:
                name = f"{part.name}.{v.name}"
                if name not in self.sources:
                    origins.append(f"{part.name}.{array}")
                elif name not in seen:
                    seen.add(name)
                    owner, output = self._owners[self.sources[name]]
                    origins += self._origins(owner, output.initial_inputs, seen)
        return list(dict.fromkeys(origins))


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
