"""SignalSource: outputs that are functions of time, for tools that have no external signals of their own."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.documents.chapter import PAPER, Chapter
from flexbeams.fmus.errors import InterfaceError
from flexbeams.fmus.interface.si import SI_UNITS
from flexbeams.fmus.interface.variables import TIME, Interface, Variable, array, matrix
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.fmus.units.native_kernel import NATIVE, Fields, NativeKernel, Records, Table, UnitData

HOLD_ROUNDING = 1e-9  # s, by which a level may hold shorter than a step

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
}  # of SourceSignal in C


@dataclass(frozen=True, kw_only=True)
class SourceSignal:
    """A signal that drives some outputs: one for all of them, or one of `width` elements for each.

    `parameters` has those of its kind: numbers, lists of `width` numbers, or for targets time (rows,) and value
    (rows, width). `table` (rows, 1 + width) has the time in its first column. `sequence` are the levels -1 and 1 of
    one period of a binary sequence, `begin` the number of the first.
    """

    name: str  # of its parameters, before their point
    kind: Kind
    outputs: tuple[str, ...]  # contiguous elements
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
        if self.kind == "joined_table" and self.table is not None:
            self._check_slopes(self.table)

    def _check_slopes(self, table: NDArray[np.float64]) -> None:
        with np.errstate(over="ignore"):
            steep = ~np.isfinite(np.diff(table[:, 1:], axis=0) / np.diff(table[:, :1], axis=0)).all(axis=1)
        if steep.any():
            row = int(np.argmax(steep))
            raise InterfaceError(f"{self.name}: table must have finite slopes, got another behind row {row + 1}")


def source_interface(signals: Sequence[SourceSignal], step_size: float, stop_time: float) -> Interface:
    """The interface of a source of these signals; outputs in the order of the signals, elements by number."""
    outputs = sorted(((o, s) for s in signals for o in s.outputs), key=lambda pair: _order(pair[0], signals))
    variables = [
        TIME,
        *[
            Variable(name=name, causality="output", unit=s.unit, nominal=s.nominal, description=f"Drives {s.drives}")
            for name, s in outputs
        ],
        *[variable for s in signals for variable in _parameters(s, step_size)],
    ]
    return Interface(
        unit_name=SIGNAL_SOURCE.name,
        variables=tuple(variables),
        step_size=step_size,
        stop_time=stop_time,
        description="External signals of a scenario: outputs are those of the communication point",
    )


def source_data(interface: Interface, signals: Sequence[SourceSignal]) -> UnitData:
    """Arrays `numbers` and `bits`, and in `signals` the fields of SourceSignal in C."""
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
    return UnitData(arrays={"numbers": np.array(numbers), "bits": packed}, meta={"signals": rows})


def _order(output: str, signals: Sequence[SourceSignal]) -> tuple[int, list[int]]:
    """Arrays in the order in which they first appear, their elements by index."""
    name, _, index = output.partition("[")
    arrays = list(dict.fromkeys(o.partition("[")[0] for s in signals for o in s.outputs))
    return arrays.index(name), [int(i) for i in index.removesuffix("]").split(",") if i.isdigit()]


def _parameters(signal: SourceSignal, step_size: float) -> list[Variable]:
    variables: list[Variable] = []
    for key, value in signal.parameters.items():
        name, meaning = f"{signal.name}.{key}", _MEANINGS[key].format(f"what drives {signal.drives}")
        common: dict[str, Any] = {"causality": "parameter", "unit": _unit(key, signal.unit), "description": meaning}
        if key in ("time", "duration", "hold", "start_frequency", "stop_frequency"):
            common["minimum"] = 0.0
        values = np.asarray(value, dtype=np.float64)
        if key == "hold":
            if not float(value) >= step_size - HOLD_ROUNDING:
                raise InterfaceError(f"{name}: must be >= {step_size:g} s, the step size, got {value!r}")
            common["minimum"] = min(step_size, float(value))
        if values.ndim == 2:
            variables += matrix(name, *values.shape, start=values.ravel(), **common)
        elif values.size > 1 or (signal.kind == "targets" and key == "time"):
            variables += array(name, values.size, start=values.ravel(), **common)
        else:
            variables.append(Variable(name=name, start=float(values.ravel()[0]), **common))
    return variables


def _unit(key: str, unit: str | None) -> str | None:
    if key in ("time", "duration", "hold"):
        return "s"
    if key.endswith("frequency"):
        return "Hz"
    if key != "impulse" or unit is None:
        return unit
    return "s" if unit == "1" else f"{unit}.s" if f"{unit}.s" in SI_UNITS else None


def native_data(interface: Interface, data: UnitData) -> Fields:
    """The fields of SignalSourceData."""
    signals, numbers, bits = data.meta["signals"], data.arrays["numbers"], data.arrays["bits"]
    return {
        "signal_count": len(signals),
        "signals": Records(type="SourceSignal", rows=signals, comment="what drives the outputs"),
        "numbers": Table(
            values=numbers if numbers.size else np.zeros(1),
            comment="tables of the signals, one after the other: times, s, then values, row by row",
        ),
        "bits": Table(
            values=bits if bits.size else np.zeros(1, np.uint8),
            comment="levels of the binary sequences, eight in a byte",
        ),
    }


SIGNAL_SOURCE = UnitKind(
    name="SignalSource",
    chapter=Chapter(
        equations="""
Outputs are functions of time, set by the parameters. A pulse is half a sine with the integral I over the duration T; a
chirp has amplitude a and a frequency that runs from f_0 to f_1, linearly or as a power of time:
= p(t) = (π I / (2 T)) sin(π (t−t_0) / T)
= c(t) = a sin(2 π ∫_{t_0}^t f(s) d s) ; f(s) = f_0 + (f_1 − f_0) (s−t_0) / T ; f(s) = f_0 (f_1 / f_0)^{(s−t_0) / T}
Targets hold from their times on. Pseudo-random levels hold for a while each: +a and −a by a maximum-length sequence, or
evenly distributed by the counter-based generator Philox 4x64. The rows of a table are held or joined by lines. A time
counts as reached from 1 ns before on.
""",
        timing="""
Outputs after a step, and after the initialisation, are those of its end: a master that exchanges values before each
step gives the other units the signals of the step's start. A master that passes on new values within a step
(Gauss-Seidel) must step this unit last; stepped first, every signal comes one step early. A time
that is a multiple of the step size up to the rounding of the host's clock is taken as that multiple.
""",
        literature=PAPER,
    ),
    native=NativeKernel(
        source=NATIVE / "units" / "signal_source.c",
        data_type="SignalSourceData",
        hooks="signal_source_hooks",
        data=native_data,
    ),
)
