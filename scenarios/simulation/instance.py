"""An FMU instance for the stepping loop: value references looked up once, buffers shared with the caller."""

import ctypes
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

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
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.declaration import TYPE_ORDER, access_order, access_type
from flexbeams.scenarios.definition.dimensions import Conversion
from flexbeams.scenarios.definition.values import TypedValue
from flexbeams.scenarios.importing.library import library_file
from flexbeams.scenarios.simulation.failure import UnitEnded, UnitFailure
from flexbeams.scenarios.simulation.loggers import Logger
from flexbeams.scenarios.simulation.messages import Messages

_WARNING = 1  # fmi2Warning
DISCARD = 2  # fmi2Discard
_LAST_SUCCESSFUL_TIME = 2  # fmi2LastSuccessfulTime, a kind of fmi2GetRealStatus
_TERMINATED = 3  # fmi2Terminated, a kind of fmi2GetBooleanStatus
_POINTERS = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p)
_FUNCTIONS = {
    "fmi2GetReal": _POINTERS,
    "fmi2SetReal": _POINTERS,
    "fmi2GetInteger": _POINTERS,
    "fmi2GetBoolean": _POINTERS,
    "fmi2SetInteger": _POINTERS,
    "fmi2SetBoolean": _POINTERS,
    "fmi2DoStep": (ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int),
}


@dataclass(frozen=True, kw_only=True)
class ValueReferences:
    """Value references that a run reads and writes at every step, by FMI's type; Enumerations are Integers."""

    written: Mapping[str, NDArray[np.uint32]]  # inputs
    read: Mapping[str, NDArray[np.uint32]]  # outputs


class _Transfer(NamedTuple):
    """One call that gets or sets variables of a type."""

    function: str
    arguments: tuple[Any, ...]
    values: Array  # of all signals' array
    buffer: NDArray[Any]  # that the library reads or fills; `values` itself for Real


class UnitInstance:
    """An instance of an extracted FMU.

    `connect` fixes which value references are read and written and where their values stand in arrays of the
    caller; `read`, `write` and `step` then take no arguments but the time and call the library with cached
    pointers: FMPy's own calls convert lists and cost more than the model. Log lines of the unit go to `notify`,
    each kind once, with its count when the instance closes; the loggers of `library` (stepper_library) format them.
    """

    def __init__(
        self,
        name: str,
        folder: Path,
        description: Any,
        notify: Callable[[str], None],
        library: Path | None = None,
    ) -> None:
        self.name = name
        self.description = description
        self.variables = {v.name: v for v in description.modelVariables}
        self._messages = Messages(name, notify)
        # Units by pythonfmu cannot return fmi2Error: an error that they log is a failure
        self._fails_by_log = description.coSimulation.needsExecutionTool
        self.last_error = ""
        self.calls: Callable[[], int] = lambda: 0  # number of the present call, where a loop in C makes them
        self._call_of_error = 0
        self._callbacks = fmi2CallbackFunctions()
        self._logger = Logger(library, self._receive) if library else None
        if self._logger and self._logger.address is not None:
            self._callbacks.logger = ctypes.cast(self._logger.address, fmi2CallbackLoggerTYPE)
        else:
            self._callbacks.logger = fmi2CallbackLoggerTYPE(self._log)
        self._callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
        self._callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
        self.time = 0.0
        identifier = description.coSimulation.modelIdentifier
        try:
            self._fmu = FMU2Slave(
                guid=description.guid,
                unzipDirectory=str(folder),
                instanceName=name,
                modelIdentifier=identifier,
                libraryPath=str(library_file(folder, identifier)),
            )
        except Exception as error:  # FMPy and the loader raise various errors
            raise UnitFailure(name, 0.0, "loading its library", str(error)) from None
        try:
            self._instantiate()
        except Exception as error:  # FMPy raises Exception itself
            self._fmu.freeLibrary()
            self._release_logger()
            raise UnitFailure(name, 0.0, "fmi2Instantiate", self.last_error or str(error)) from None
        self._functions = {}
        for function, types in _FUNCTIONS.items():
            self._functions[function] = self._fmu.dll[function]
            self._functions[function].argtypes = types

    def _instantiate(self) -> None:
        # Units with the standard's log categories log errors; others may log every step
        categories = {category.name for category in self.description.logCategories}
        self._fmu.instantiate(callbacks=self._callbacks, loggingOn="logStatusWarning" in categories)
        self.component = self._fmu.component

    def _log(self, _: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        self._receive(status, message)

    def _receive(self, status: int, message: bytes) -> None:
        lines = (message or b"").decode("utf-8", "replace").strip().splitlines()
        if len(lines) > 1 and lines[0].startswith("Fatal py exception encountered"):
            del lines[0]  # pythonfmu's wrapper puts this line before the unit's own text
        text = " ".join(lines)
        if status > _WARNING:
            self.last_error, self._call_of_error = text, self.calls()
        if text and not (status > _WARNING and self._fails_by_log):
            self._messages.add(text, warning=status <= _WARNING)

    def call(self, function: str, *arguments: Any) -> Any:
        """Calls an FMI function by the name that FMPy gives it; UnitFailure with the logged reason otherwise."""
        self.last_error = ""
        try:
            result = getattr(self._fmu, function)(*arguments)
        except FMICallException as error:
            raise self.failure(function, str(error)) from None
        if self.last_error and self._fails_by_log:
            raise self.failure(function)
        return result

    def failure(self, function: str, reason: str = "") -> UnitFailure:
        """The failure of the last call, for the reason that the unit logged in it, or else for this one."""
        if self._call_of_error != self.calls():
            self.last_error = ""
        self._messages.forget(self.last_error)
        return UnitFailure(self.name, self.time, function, self.last_error or reason)

    def end(self, step: float) -> UnitEnded | None:
        """The end of the run that the unit wants, where it discarded a step of `step` s from `self.time` for that."""
        logged, completed = self.last_error, False
        with suppress(FMICallException):
            if self._fmu.getBooleanStatus(_TERMINATED):
                with suppress(FMICallException):
                    completed = abs(self._fmu.getRealStatus(_LAST_SUCCESSFUL_TIME) - self.time - step) < 1e-6 * step
                self.last_error = ""
                return UnitEnded(self.name, self.time + step if completed else self.time, completed)
        self.last_error = logged  # in the step, whatever this call logs
        return None

    def set_values(self, values: Mapping[str, TypedValue]) -> None:
        """Sets variables by name, those of a type in one call."""
        by_type: dict[str, tuple[list[int], list[Any]]] = {}
        for name, value in values.items():
            kind = access_type(self.variables[name].type)
            references, typed = by_type.setdefault(kind, ([], []))
            references.append(self.variables[name].valueReference)
            typed.append(value if kind == "String" else float(value) if kind == "Real" else int(value))
        for kind, arguments in by_type.items():
            self.call(f"set{kind}", *arguments)

    def set_start(self, name: str, value: TypedValue) -> None:
        """Sets one variable by name, by its type."""
        self.set_values({name: value})

    def get(self, name: str) -> float | bool | str:
        """Value of one variable."""
        variable = self.variables[name]
        value = self.call(f"get{access_type(variable.type)}", [variable.valueReference])[0]
        if variable.type == "String":
            return str(value.decode() if isinstance(value, bytes) else value)
        return bool(value) if variable.type == "Boolean" else float(value)

    def connect(
        self, read: list[str], into: Array, write: list[str], conversions: Mapping[str, Conversion] | None = None
    ) -> None:
        """`read` names fill `into` (len(read),), a slice of the caller's; `write` names take from `self.inputs`.

        Both have the Real variables first, then Integer and Enumeration, then Boolean ones. `conversions` are applied
        to inputs by name.
        """
        for names in (read, write):
            orders = [access_order(self.variables[n]) for n in names]
            if orders != sorted(orders):
                raise ValueError("names must be of Real, then Integer, then Boolean variables")
        self.references = ValueReferences(written=self._by_type(write), read=self._by_type(read))
        self._into, self.inputs = into, np.zeros(len(write))
        self.conversions = {write.index(name): c for name, c in (conversions or {}).items()}
        self._read = self._transfers("Get", self.references.read, into)
        self._write = self._transfers("Set", self.references.written, self.inputs)

    def _by_type(self, names: list[str]) -> dict[str, NDArray[np.uint32]]:
        kinds = {kind: [n for n in names if access_type(self.variables[n].type) == kind] for kind in TYPE_ORDER}
        return {kind: self._references(of_kind) for kind, of_kind in kinds.items()}

    def _transfers(self, verb: str, references: Mapping[str, NDArray[np.uint32]], values: Array) -> list[_Transfer]:
        """The calls that get or set all values: Real ones from the array itself, others through a copy."""
        transfers, first = [], 0
        for kind, of_kind in references.items():
            part = values[first : first + len(of_kind)]
            first += len(of_kind)
            buffer = part if kind == "Real" else np.zeros(len(of_kind), np.int32)
            if len(of_kind):
                transfers.append(_Transfer(f"fmi2{verb}{kind}", self._arguments(of_kind, buffer), part, buffer))
        return transfers

    def reader(self, names: list[str]) -> Callable[[Array], None]:
        """A function that fills the head of an array with the values of Real variables, all in one call."""
        references = self._references(names)

        def read(into: Array) -> None:
            self._call("fmi2GetReal", self._arguments(references, into))

        return read

    def read(self) -> None:
        """Outputs into the caller's array."""
        for function, arguments, values, buffer in self._read:
            self._call(function, arguments)
            if buffer is not values:
                values[:] = buffer

    def write(self) -> None:
        """`self.inputs`, converted, to the unit."""
        for k, conversion in self.conversions.items():
            self.inputs[k] *= conversion.factor
            self.inputs[k] += conversion.offset
        for function, arguments, values, buffer in self._write:
            if buffer is not values:
                buffer[:] = values
            self._call(function, arguments)

    def step(self, time: float, step: float) -> None:
        """One doStep from `time`; UnitEnded where the unit discards it since it wants the run to end."""
        self.time, self.last_error = time, ""
        status = self._functions["fmi2DoStep"](self.component, time, step, 1)
        if status == DISCARD and (end := self.end(step)):
            raise end
        self._require("fmi2DoStep", status)

    def address(self, function: str) -> int | None:
        """Address of one of the functions that a run calls at every step."""
        return ctypes.cast(self._functions[function], ctypes.c_void_p).value

    def _call(self, function: str, arguments: tuple[Any, ...]) -> None:
        self.last_error = ""
        self._require(function, self._functions[function](*arguments))

    def _require(self, function: str, status: int) -> None:
        if status > _WARNING or (self.last_error and self._fails_by_log):
            raise self.failure(function, f"status {status}")

    def _references(self, names: list[str]) -> NDArray[np.uint32]:
        return np.array([self.variables[n].valueReference for n in names], dtype=np.uint32)

    def _arguments(self, references: NDArray[np.uint32], values: NDArray[Any]) -> tuple[Any, ...]:
        """Component, references, count and values as the library takes them; both arrays must be kept alive."""
        return self.component, references.ctypes.data, len(references), values.ctypes.data

    def close(self) -> None:
        """Terminates and frees the instance."""
        try:
            self._fmu.terminate()
        except FMICallException:  # of an instance that failed before
            self._messages.forget(self.last_error)
        self._fmu.freeInstance()
        self._release_logger()
        self._messages.finish()

    def _release_logger(self) -> None:
        if self._logger:
            self._logger.release()

    def __enter__(self) -> "UnitInstance":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
