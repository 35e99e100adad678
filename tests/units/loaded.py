"""An instance of one of the real units, with whole arrays set and read by name."""

from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Self

import numpy as np
from fmpy import read_model_description
from numpy.typing import NDArray

from flexbeams.scenarios.definition.declaration import element_names
from flexbeams.scenarios.simulation.instance import UnitInstance

Real = NDArray[np.float64]


class Loaded(UnitInstance):
    """An instance of the FMU extracted to `folder`; what the unit logs stands in `notes`. Use it with `with`."""

    def __init__(self, folder: Path, name: str = "unit") -> None:
        self.notes: list[str] = []
        self._known: dict[str, list[str]] = {}  # elements by the name of their array
        super().__init__(name, folder, read_model_description(folder, validate=False), self.notes.append)

    def put(self, name: str, values: float | bool | Sequence[float] | Real) -> None:
        """Sets a variable, or every element of an array."""
        names = self._elements(name)
        listed = np.broadcast_to(np.asarray(values), len(names)).tolist()
        kind = self.variables[names[0]].type
        self.call(
            f"set{kind}",
            [self.variables[n].valueReference for n in names],
            listed if kind == "Real" else [int(v) for v in listed],
        )

    def take(self, *names: str) -> Real:
        """Values of variables and whole arrays, one after the other."""
        return np.concatenate([self._take(name) for name in names])

    def _elements(self, name: str) -> list[str]:
        if name not in self._known:
            self._known[name] = element_names(self.variables, name)
        return self._known[name]

    def _take(self, name: str) -> Real:
        names = self._elements(name)
        references = [self.variables[n].valueReference for n in names]
        return np.array(self.call(f"get{self.variables[names[0]].type}", references), dtype=float)

    def begin(self, start_time: float = 0.0, **values: Any) -> Self:
        """From instantiation through initialisation, with these start values."""
        self.prepare(start_time, **values)
        self.call("exitInitializationMode")
        return self

    def prepare(self, start_time: float = 0.0, **values: Any) -> Self:
        """Into initialization mode, with these start values."""
        self.call("setupExperiment", None, start_time)
        self.call("enterInitializationMode")
        for name, value in values.items():
            self.put(name, value)
        self.now = start_time
        return self

    def advance(self, step: float, **inputs: Any) -> Self:
        """Sets inputs, then one doStep."""
        for name, value in inputs.items():
            self.put(name, value)
        self.step(self.now, step)
        self.now += step
        return self

    def everything(self) -> Real:
        """Every value but texts, in the order of the value references."""
        numbers = [v for v in self.variables.values() if v.type != "String"]
        values = np.empty(len(numbers))
        for kind in ("Real", "Integer", "Boolean"):
            places = [k for k, v in enumerate(numbers) if v.type == kind]
            if places:
                values[places] = self.call(f"get{kind}", [numbers[k].valueReference for k in places])
        return values

    def saved(self) -> bytes:
        """The FMU state, serialised."""
        state = self.call("getFMUstate")
        try:
            return bytes(self.call("serializeFMUstate", state))
        finally:
            self.call("freeFMUstate", state)

    def restore(self, content: bytes) -> Self:
        """Continues from a serialised state."""
        state = self.call("deSerializeFMUstate", content)
        try:
            self.call("setFMUstate", state)
        finally:
            self._fmu.freeFMUstate(state)
        self.now = float(self.take("time")[0])
        return self


def loaded(folder: Path, name: str = "unit") -> "closing[Loaded]":
    """A context that gives an instance and frees it."""
    return closing(Loaded(folder, name))


def pushed_in_turn(units: Sequence[UnitInstance], force: str, deflection: str) -> list[list[float]]:
    """What each of some instances puts out in 200 steps of 0.2 ms under a steady force, all stepped in turn."""
    rows: list[list[float]] = [[] for _ in units]
    for k in range(200):
        for row, unit in zip(rows, units, strict=True):
            unit.set_start(force, 0.1)
            unit.step(k * 2e-4, 2e-4)
            row.append(float(unit.get(deflection)))
    return rows
