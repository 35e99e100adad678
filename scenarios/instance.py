"""One FMU instance for the stepping loop: value references looked up once, buffers shared with the runner."""

import ctypes
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from fmpy import calloc, free
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)

from plant.basis import Array

_REFERENCES = ctypes.POINTER(ctypes.c_uint32)
_REALS = ctypes.POINTER(ctypes.c_double)
_INTEGERS = ctypes.POINTER(ctypes.c_int32)


class UnitFailure(RuntimeError):
    """A unit refused a call; names instance, time, function and what the unit logged."""

    def __init__(self, instance: str, time: float, function: str, reason: str) -> None:
        super().__init__(f"{instance} failed at {time:.6g} s in {function}: {reason}")


class UnitInstance:
    """An instance of an extracted FMU.

    `connect` fixes which value references are read and written and where their values stand in arrays of the
    caller; `read`, `write` and `step` then take no arguments but the time. Messages of the unit go to `report`.
    """

    def __init__(self, name: str, folder: Path, description: Any, report: Callable[[str], None]) -> None:
        self.name = name
        self.description = description
        self.variables = {v.name: v for v in description.modelVariables}
        self._report = report
        self._reason = ""
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(self._log)
        self._callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        self._callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        self._fmu = FMU2Slave(guid=description.guid, unzipDirectory=str(folder), instanceName=name,
                              modelIdentifier=description.coSimulation.modelIdentifier)
        self.time = 0.0
        try:
            self._fmu.instantiate(callbacks=self._callbacks, loggingOn=True)
        except Exception as error:
            raise UnitFailure(name, 0.0, "fmi2Instantiate", self._reason or str(error)) from None
        self._component = self._fmu.component

    def _log(self, _: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        text = (message or b"").decode("utf-8", "replace").strip()
        if status > 1:
            self._reason = text
        elif text:
            self._report(f"{self.name}: {text}")

    def call(self, function: str, *arguments: Any) -> Any:
        """Calls an FMI function by the name that FMPy gives it; UnitFailure with the logged reason otherwise."""
        self._reason = ""
        try:
            result = getattr(self._fmu, function)(*arguments)
        except FMICallException as error:
            raise UnitFailure(self.name, self.time, function, self._reason or str(error)) from None
        if self._reason:  # a unit that cannot return fmi2Error has logged it
            raise UnitFailure(self.name, self.time, function, self._reason)
        return result

    def set_start(self, name: str, value: float | bool | str) -> None:
        """Sets one variable by name, by its type."""
        variable = self.variables[name]
        self.call(f"set{variable.type}", [variable.valueReference],
                  [value if variable.type == "String" else float(value) if variable.type == "Real" else int(value)])

    def get(self, name: str) -> float | bool | str:
        """Value of one variable."""
        variable = self.variables[name]
        value = self.call(f"get{variable.type}", [variable.valueReference])[0]
        if variable.type == "String":
            return str(value.decode() if isinstance(value, bytes) else value)
        return bool(value) if variable.type == "Boolean" else float(value)

    def connect(self, read: list[str], into: Array, write: list[str]) -> None:
        """`read` names fill `into` (len(read),), a slice of the caller's; `write` names take from `self.inputs`."""
        reals = [k for k, n in enumerate(read) if self.variables[n].type == "Real"]
        others = [k for k, n in enumerate(read) if self.variables[n].type != "Real"]
        if reals != list(range(len(reals))):
            raise ValueError("Real variables must be read before the others")
        self._read_references = self._references([read[k] for k in reals])
        self._others = [(self.variables[read[k]].type, self._references([read[k]]), np.zeros(1, np.int32), k)
                        for k in others]
        self._into = into
        self._read_pointer = into.ctypes.data_as(_REALS)
        self._n_read = len(reals)
        self.inputs = np.zeros(len(write))
        self._write_references = self._references(write)
        self._write_pointer = self.inputs.ctypes.data_as(_REALS)
        self._n_write = len(write)

    def _references(self, names: list[str]) -> Any:
        return (ctypes.c_uint32 * max(len(names), 1))(*[self.variables[n].valueReference for n in names])

    def read(self) -> None:
        """Outputs into the caller's array."""
        try:
            if self._n_read:
                self._fmu.fmi2GetReal(self._component, self._read_references, self._n_read, self._read_pointer)
            for kind, reference, value, place in self._others:
                get = self._fmu.fmi2GetBoolean if kind == "Boolean" else self._fmu.fmi2GetInteger
                get(self._component, reference, 1, value.ctypes.data_as(_INTEGERS))
                self._into[place] = value[0]
        except FMICallException as error:
            raise UnitFailure(self.name, self.time, error.function, self._reason or str(error)) from None
        if self._reason:
            raise UnitFailure(self.name, self.time, "fmi2GetReal", self._reason)

    def write(self) -> None:
        """`self.inputs` to the unit."""
        if not self._n_write:
            return
        try:
            self._fmu.fmi2SetReal(self._component, self._write_references, self._n_write, self._write_pointer)
        except FMICallException as error:
            raise UnitFailure(self.name, self.time, error.function, self._reason or str(error)) from None
        if self._reason:
            raise UnitFailure(self.name, self.time, "fmi2SetReal", self._reason)

    def step(self, time: float, step: float) -> None:
        """One doStep from `time`."""
        self.time = time
        try:
            self._fmu.fmi2DoStep(self._component, time, step, 1)
        except FMICallException as error:
            raise UnitFailure(self.name, time, "fmi2DoStep", self._reason or str(error)) from None
        if self._reason:
            raise UnitFailure(self.name, time, "fmi2DoStep", self._reason)

    def close(self) -> None:
        """Terminates and frees the instance."""
        try:
            self._fmu.terminate()
        except Exception:
            self._reason = ""
        self._fmu.freeInstance()

    def __enter__(self) -> "UnitInstance":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()


def element_names(variables: dict[str, Any], name: str) -> list[str]:
    """The scalars that a name means: itself, or all elements name[1], name[2], ... ; empty where there are none."""
    if name in variables:
        return [name]
    prefix = f"{name}["
    return [n for n in variables if n.startswith(prefix) and n.endswith("]") and "]." not in n]
