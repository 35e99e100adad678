"""BeamClosedLoop: the wired instances of a scenario as one native unit.

Its variables are those of its parts, each part's in one piece with its time first: the mathematics of a part works on
a slice of the whole's values. They are called <part>.<variable>; inputs and outputs go without their part, and so
without a dot, where no two arrays have the same name.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from flexbeams.fmus.documents.chapter import PAPER, Chapter
from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.interface.variables import TIME, Interface, Variable, bounds
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.fmus.units.native_kernel import NATIVE, Fields, NativeKernel, Records, Text, UnitData


@dataclass(frozen=True, kw_only=True)
class LoopPart:
    """A unit within a closed loop."""

    name: str
    kind: UnitKind
    interface: Interface
    data: UnitData

    @property
    def variables(self) -> tuple[Variable, ...]:
        """The variables among the values, time first; strings have no slot and come last in the interface."""
        return tuple(v for v in self.interface if v.type != "String")


@dataclass(frozen=True, kw_only=True)
class LoopWire:
    """An output and an input that takes its value, both by <part>.<variable>."""

    source: str
    to: str


def closed_loop_interface(
    parts: Sequence[LoopPart],
    wires: Sequence[LoopWire],
    step: float,
    stop_time: float,
    description: str,
    *,
    name: str = "BeamClosedLoop",
) -> Interface:
    """The variables of a closed loop called `name` that communicates inside every `step` (s).

    Inputs that are wired become locals. Raises InterfaceError for an array of inputs that is wired in part, and for
    names that do not fit.
    """
    wiring = _Wiring(parts, wires)
    for part in parts:
        _check_arrays(part, wiring.sources)
    designs = [v for part in parts for v in part.interface if v.name == "design_id"]
    variables = [wiring.outer(part, v) for part in parts for v in part.variables]
    return Interface(
        unit_name=name,
        description=description,
        step_size=step,
        stop_time=stop_time,
        variables=(TIME, *without_parts(variables), *designs[:1]),
    )


def without_parts(variables: Sequence[Variable]) -> list[Variable]:
    """Variables <part>.<variable>, inputs and outputs without their part where no other array has that name.

    Tools make nested buses and wrong names of dots.
    """
    arrays = dict.fromkeys(v.array for v in variables if v.causality in ("input", "output"))
    short = {array: array.partition(".")[2] for array in arrays}
    names = [*short.values(), *dict.fromkeys(v.array for v in variables), TIME.name]
    short = {array: name if names.count(name) == 1 else array for array, name in short.items()}
    return [
        replace(
            v,
            name=short[v.array] + v.name[len(v.array) :] if v.array in short else v.name,
            initial_inputs=tuple(short[array] for array in v.initial_inputs),
        )
        for v in variables
    ]


def part_references(parts: Sequence[LoopPart]) -> dict[str, int]:
    """Value references in the whole by <part>.<variable>."""
    names = [f"{part.name}.{v.name}" for part in parts for v in part.variables]
    return {name: k for k, name in enumerate(names, 1)}


class _Wiring:
    """The parts' variables as those of the whole."""

    def __init__(self, parts: Sequence[LoopPart], wires: Sequence[LoopWire]) -> None:
        self.sources = {w.to: w.source for w in wires}
        self._owners = {f"{part.name}.{v.name}": (part, v) for part in parts for v in part.interface}

    def outer(self, part: LoopPart, v: Variable) -> Variable:
        """A part's variable as the whole declares it."""
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
        hidden = v.array in part.kind.internal_outputs and name in self.sources.values()
        return replace(
            v,
            name=name,
            causality="local" if hidden else v.causality,
            initial_inputs=tuple(self._origins(part, v.initial_inputs, set())),
        )

    def _origins(self, part: LoopPart, arrays: Iterable[str], seen: set[str]) -> list[str]:
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


def _check_arrays(part: LoopPart, sources: Mapping[str, str]) -> None:
    for array, span in part.interface.arrays.items():
        names = [f"{part.name}.{part.interface.variables[k].name}" for k in span]
        wired = [name for name in names if name in sources]
        if wired and len(wired) < len(names):
            raise InterfaceError(
                f"{part.name}.{array} must be wired as a whole or not at all in a closed loop, got {', '.join(wired)}"
            )


def closed_loop_data(parts: Sequence[LoopPart], wires: Sequence[LoopWire], coupling: str) -> UnitData:
    """The fields of LoopPart and LoopWire in C; `coupling` is jacobi or gauss-seidel.

    The data of part k, counted from 1, is a struct part_k.
    """
    sources, references = {w.to: w.source for w in wires}, part_references(parts)
    runs: list[dict[str, Any]] = []
    rows: list[dict[str, Any]] = []
    for number, part in enumerate(parts, 1):
        first = len(runs)
        for v in part.variables:
            if (to := f"{part.name}.{v.name}") in sources:
                _extend(runs, first, references[sources[to]], references[to], v)
        rows.append(
            {
                "hooks": f"&{part.kind.require_native().hooks}",
                "data": f"&part_{number}",
                "step_size": part.interface.step_size,
                "values": references[f"{part.name}.time"],
                "first_wire": first,
                "wire_count": len(runs) - first,
                "name": Text(part.name),
            }
        )
    return UnitData(meta={"parts": rows, "wires": runs, "is_sequential": coupling == "gauss-seidel"})


def _extend(runs: list[dict[str, Any]], first: int, source: int, to: int, v: Variable) -> None:
    """One more wire to the input `v`: the last run of those from `first` on, or a new one."""
    low, high = bounds(v)
    last = runs[-1] if len(runs) > first else None
    if last is not None and (source, to, low, high) == (
        last["from"] + last["count"],
        last["to"] + last["count"],
        last["minimum"],
        last["maximum"],
    ):
        last["count"] += 1
    else:
        runs.append({"from": source, "to": to, "count": 1, "minimum": low, "maximum": high})


def native_data(interface: Interface, data: UnitData) -> Fields:
    """The fields of ClosedLoopData."""
    parts, wires = data.meta["parts"], data.meta["wires"]
    return {
        "part_count": len(parts),
        "parts": Records(type="LoopPart", rows=parts, comment="the parts in the order in which they step"),
        "wire_count": len(wires),
        "wires": Records(
            type="LoopWire",
            rows=wires or [{"from": 0, "to": 0, "count": 0, "minimum": 0.0, "maximum": 0.0}],
            comment="from outputs to inputs, by value reference",
        ),
        "is_sequential": data.meta["is_sequential"],
    }


CLOSED_LOOP = UnitKind(
    name="BeamClosedLoop",
    chapter=Chapter(
        equations="",  # of the parts
        timing="""
Inside, the parts step by {step:g} s, the step size of the unit, in the order {order}. {coupling}
A step of the host may have any size, its inputs are held over it; the unit takes no input derivatives. Steps that are
multiples of {step:g} s give, to the last digit, what the single units give under such a master. A step that ends in
between moves the parts up to its end; they exchange values at multiples of {step:g} s all the same{cut}. An integer
counts these.
""",
        clock="",
        literature=PAPER,
    ),
    native=NativeKernel(
        source=NATIVE / "units" / "closed_loop.c",
        data_type="ClosedLoopData",
        hooks="closed_loop_hooks",
        data=native_data,
    ),
)
