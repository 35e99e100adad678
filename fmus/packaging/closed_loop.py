"""Packing of a closed loop: the kernels of its parts, their data and their wires in one native unit."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from flexbeams.fmus.documents.closed_loop_page import loop_picture, wiring_page
from flexbeams.fmus.packaging.c_tables import kernel_data
from flexbeams.fmus.packaging.native import NativeUnit
from flexbeams.fmus.units.closed_loop import (
    CLOSED_LOOP,
    LoopPart,
    LoopWire,
    closed_loop_data,
    closed_loop_interface,
    part_references,
)


@dataclass(frozen=True, kw_only=True)
class ClosedLoop(NativeUnit):
    """A unit of wired parts, which step in their order; made by `closed_loop_unit`."""

    parts: tuple[LoopPart, ...]
    wires: tuple[LoopWire, ...]
    coupling: str  # jacobi or gauss-seidel

    def provides_derivatives(self) -> bool:
        """Whether all its parts have directional derivatives."""
        return all(part.kind.require_native().provides_derivatives for part in self.parts)

    def kernels(self) -> list[Path]:
        """The C files of its mathematics, that of each kind of part once."""
        return [*super().kernels(), *dict.fromkeys(part.kind.require_native().source for part in self.parts)]

    @cached_property
    def numbers(self) -> list[str]:
        """The C text of the parts' data and of the wires."""
        parts = [text for number, part in enumerate(self.parts, 1) for text in _part_data(part, number)]
        return [*parts, *kernel_data("unit_data", self.kind.require_native(), self.interface, self.data)]

    def deferred(self) -> Collection[str]:
        """Arrays of the parts that are computed when read."""
        references = part_references(self.parts)
        return {
            self.interface.variables[references[f"{part.name}.{v.name}"]].array
            for part in self.parts
            for v in part.variables
            if v.array in part.kind.require_native().deferred
        }

    def picture(self) -> bytes:
        """model.png: the parts as blocks with their wires."""
        return loop_picture(self.interface, self._units(), self._array_wires())

    def page(self, picture: bytes) -> str:
        """documentation/index.html."""
        chapters = {part.kind.name: part.kind.chapter for part in self.parts}
        return wiring_page(
            self.interface, picture, self.kind.chapter, self._units(), chapters, self._array_wires(), self.coupling
        )

    def _units(self) -> dict[str, str]:
        """Names of the units by part."""
        return {part.name: part.kind.name for part in self.parts}

    def _array_wires(self) -> list[tuple[str, str]]:
        """Arrays for elements, each pair once."""
        arrays = {f"{part.name}.{v.name}": f"{part.name}.{v.array}" for part in self.parts for v in part.interface}
        return list(dict.fromkeys((arrays[w.source], arrays[w.to]) for w in self.wires))


def closed_loop_unit(
    parts: Sequence[LoopPart],
    wires: Sequence[LoopWire],
    coupling: str,
    *,
    step: float,
    stop_time: float,
    description: str,
    out: Path,
    name: str = CLOSED_LOOP.name,
) -> ClosedLoop:
    """The unit of a loop that communicates inside every `step` (s), called `name`, to be built into `out`.

    Raises InterfaceError for an array of inputs that is wired in part and for names that do not fit, BuildError for a
    part without a native kernel.
    """
    interface = closed_loop_interface(parts, wires, step, stop_time, description, name=name)
    return ClosedLoop(
        kind=CLOSED_LOOP,
        interface=interface,
        data=closed_loop_data(parts, wires, coupling),
        parts=tuple(parts),
        wires=tuple(wires),
        coupling=coupling,
        out=out,
    )


def _part_data(part: LoopPart, number: int) -> list[str]:
    about = f"/* Part {number}: {part.name}, a {part.kind.name}. Value references are its own. */\n"
    return [about, *kernel_data(f"part_{number}", part.kind.require_native(), part.interface, part.data)]
