"""An instance of one of the real units, with whole arrays set and read by name."""

from collections.abc import Sequence
from contextlib import closing
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from fmpy import read_model_description
from numpy.typing import NDArray

from flexbeams.scenarios.definition.declaration import element_names
from flexbeams.scenarios.simulation.instance import UnitInstance

Real = NDArray[np.float64]
_KINDS: dict[str, type] = {"Real": np.float64, "Integer": np.int32, "Boolean": np.int32}


class Access(NamedTuple):
    """Variables of one type, with what a call that sets or gets them takes."""

    name: str  # of the call, as FMPy has it
    function: str
    arguments: tuple[int, int, int]  # addresses of references and values with their number between
    references: NDArray[np.uint32]
    values: NDArray[Any]


@cache
def _description(folder: Path, written: int) -> Any:
    return read_model_description(folder, validate=False)


class Loaded(UnitInstance):
    """An instance of the FMU extracted to `folder`; what the unit logs stands in `notes`. Use it with `with`.

    Values go through arrays that are made once for a name: FMPy's own calls cost more than the unit's. `call_count`
    is the number of FMI calls.
    """

    def __init__(self, folder: Path, name: str = "unit") -> None:
        self.notes: list[str] = []
        self.call_count = 0
        self._accesses: dict[tuple[str, ...], Access] = {}
        description = _description(folder, (folder / "modelDescription.xml").stat().st_mtime_ns)
        super().__init__(name, folder, description, self.notes.append)
        self._numbers = [v for v in self.variables.values() if v.type != "String"]
        places = {kind: [k for k, v in enumerate(self._numbers) if v.type == kind] for kind in _KINDS}
        self._places = [
            (np.array(of_kind), self._access("get", kind, [self._numbers[k].name for k in of_kind]))
            for kind, of_kind in places.items()
            if of_kind
        ]

    def renew(self) -> Self:
        """Another instance, just instantiated, in place of this one; the library stays loaded."""
        self._fmu.fmi2FreeInstance(self.component)
        self._instantiate()
        self.call_count += 2
        return self

    def call(self, function: str, *arguments: Any) -> Any:
        self.call_count += 1
        return super().call(function, *arguments)

    def put(self, name: str, values: float | bool | Sequence[float] | Real) -> None:
        """Sets a variable, or every element of an array."""
        access = self._access_of("set", name)
        access.values[:] = values
        self._transfer(access)

    def take(self, *names: str) -> Real:
        """Values of variables and whole arrays, one after the other."""
        return np.concatenate([self._take(name) for name in names])

    def _take(self, name: str) -> Real:
        return self._transfer(self._access_of("get", name)).astype(float)

    def _access_of(self, verb: str, name: str) -> Access:
        key = (verb, name)
        if key not in self._accesses:
            names = element_names(self.variables, name)
            self._accesses[key] = self._access(verb, self.variables[names[0]].type, names)
        return self._accesses[key]

    def _access(self, verb: str, kind: str, names: list[str]) -> Access:
        references = np.array([self.variables[n].valueReference for n in names], dtype=np.uint32)
        values = np.zeros(len(names), _KINDS[kind])
        return Access(
            name=f"{verb}{kind}",
            function=f"fmi2{verb.capitalize()}{kind}",
            arguments=(references.ctypes.data, len(names), values.ctypes.data),
            references=references,
            values=values,
        )

    def _transfer(self, access: Access) -> NDArray[Any]:
        self.call_count += 1
        self.last_error = ""
        self._require(access.name, self._functions[access.function](self.component, *access.arguments))
        return access.values

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

    def step(self, time: float, step: float) -> None:
        self.call_count += 1
        super().step(time, step)

    def everything(self) -> Real:
        """Every value but texts, in the order of the value references."""
        values = np.empty(len(self._numbers))
        for places, access in self._places:
            values[places] = self._transfer(access)
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
            self.call_count += 1
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
