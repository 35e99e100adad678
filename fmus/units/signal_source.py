"""SignalSource: a unit whose outputs are functions of time, for tools that have no external signals of their own."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.interface.si import SI_UNITS
from flexbeams.fmus.interface.variables import Interface, Variable, array, matrix, time_variable

Kind = Literal[
    "constant",
    "step",
    "pulse",
    "targets",
    "linear_chirp",
    "logarithmic_chirp",
    "binary",
    "levels",
    "held_table",
    "joined_table",
]

_MEANINGS = {
    "time": "Start of {}",
    "duration": "Duration of {}",
    "value": "Value of {}",
    "impulse": "Integral of {}",
    "amplitude": "Amplitude of {}",
    "start_frequency": "First frequency of {}",
    "stop_frequency": "Last frequency of {}",
    "hold": "Time that a level of {} holds",
}
_FIELDS = {
    "time": "time",
    "duration": "duration",
    "value": "value",
    "impulse": "value",
    "amplitude": "value",
    "start_frequency": "first",
    "hold": "first",
    "stop_frequency": "last",
}  # of source_signal in C


@dataclass(frozen=True, kw_only=True)
class SourceSignal:
    """What drives some outputs: one signal for all of them, or one of `width` elements for each.

    `parameters` has those of its kind: numbers, lists of `width` numbers, or for targets time (rows,) and value
    (rows, width). `table` (rows, 1 + width) has the time in its first column. `sequence` are the levels -1 and 1 of
    one period of a binary sequence, `begin` the number of the first.
    """

    name: str  # of its parameters, before their point
    kind: Kind
    outputs: tuple[str, ...]  # elements that stand next to each other
    width: int = 1
    drives: str = ""  # for the descriptions
    unit: str | None = None
    nominal: float | None = None
    parameters: dict[str, Any] = field(default_factory=dict)
    table: NDArray[np.float64] | None = None
    sequence: NDArray[np.float64] | None = None
    begin: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.width not in (1, len(self.outputs)):
            raise InterfaceError(f"{self.name}: width must be 1 or {len(self.outputs)}, got {self.width}")


def signal_source(signals: Sequence[SourceSignal], step_size: float, stop_time: float) -> Interface:
    """The interface of a source of these signals; outputs in the order of the signals, elements by number."""
    outputs = sorted(((o, s) for s in signals for o in s.outputs), key=lambda pair: _place(pair[0], signals))
    variables = [
        time_variable,
        *[
            Variable(name=name, causality="output", unit=s.unit, nominal=s.nominal, description=f"Drives {s.drives}")
            for name, s in outputs
        ],
        *[variable for s in signals for variable in _parameters(s)],
    ]
    return Interface(
        unit_name="SignalSource",
        variables=tuple(variables),
        step_size=step_size,
        stop_time=stop_time,
        description="External signals of a scenario: outputs are those of the communication point",
    )


def source_data(interface: Interface, signals: Sequence[SourceSignal]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arrays `numbers` and `bits` and, in `signals`, the fields of source_signal in C, for fmus.tables."""
    numbers: list[float] = []
    packed = np.zeros(0, np.uint8)
    rows = []
    for s in signals:
        entry: dict[str, Any] = {
            "kind": s.kind.upper(),
            "output": interface.reference(s.outputs[0]),
            "outputs": len(s.outputs),
            "width": s.width,
        }
        for key in s.parameters:
            entry[_FIELDS[key]] = interface.references(f"{s.name}.{key}").start
        if s.kind == "targets":
            entry["rows"] = len(s.parameters["time"])
        if s.table is not None:
            entry |= {"rows": len(s.table), "data": len(numbers)}
            numbers += [*s.table[:, 0].tolist(), *s.table[:, 1:].ravel().tolist()]
        if s.sequence is not None:
            entry |= {"rows": len(s.sequence), "data": len(packed), "begin": s.begin}
            packed = np.concatenate([packed, np.packbits(s.sequence > 0, bitorder="little")])
        if s.kind == "levels":
            entry["seed"] = s.seed
        rows.append(entry)
    return {"numbers": np.array(numbers), "bits": packed}, {"signals": rows}


def _place(output: str, signals: Sequence[SourceSignal]) -> tuple[int, list[int]]:
    """Arrays in the order in which they first appear, their elements by index."""
    name, _, index = output.partition("[")
    arrays = list(dict.fromkeys(o.partition("[")[0] for s in signals for o in s.outputs))
    return arrays.index(name), [int(i) for i in index.removesuffix("]").split(",") if i.isdigit()]


def _parameters(signal: SourceSignal) -> list[Variable]:
    found: list[Variable] = []
    for key, value in signal.parameters.items():
        name, meaning = f"{signal.name}.{key}", _MEANINGS[key].format(f"what drives {signal.drives}")
        common: dict[str, Any] = {"causality": "parameter", "unit": _unit(key, signal.unit), "description": meaning}
        if key in ("time", "duration", "hold", "start_frequency", "stop_frequency"):
            common["minimum"] = 0.0
        values = np.asarray(value, dtype=np.float64)
        if values.ndim == 2:
            found += matrix(name, *values.shape, start=values.ravel(), **common)
        elif values.size > 1 or (signal.kind == "targets" and key == "time"):
            found += array(name, values.size, start=values.ravel(), **common)
        else:
            found.append(Variable(name=name, start=float(values.ravel()[0]), **common))
    return found


def _unit(key: str, unit: str | None) -> str | None:
    if key in ("time", "duration", "hold"):
        return "s"
    if key.endswith("frequency"):
        return "Hz"
    if key != "impulse" or unit is None:
        return unit
    return "s" if unit == "1" else f"{unit}.s" if f"{unit}.s" in SI_UNITS else None
