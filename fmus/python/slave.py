"""Base of the Python units: FMI's bookkeeping between pythonfmu's wrapper and a numpy kernel.

The packager joins this module, those it imports and a kernel to one file with a name of its own, because all
pythonfmu units of a process share one interpreter.

A refused call raises, because that is the only way pythonfmu 0.7.0's wrapper can tell the importer: it
returns fmi2Fatal and logs the text. (It never returns fmi2Error; fmi2Discard, a step's False, ends FMPy's
simulation without a word.) On the way it releases references to class, instance and log queue that
it needs again, so `Unit._fail` hands it spare ones: the instance stays whole and can be reset. It
reads the log queue after every call but construction, reset and free, and crashes on a line that is
left over at free.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import math
import sys
from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, NoReturn, ParamSpec, TypeVar

import numpy as np
from numpy.typing import DTypeLike, NDArray
from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from flexbeams.fmus.python.snapshot import pack_state, unpack_state
from flexbeams.fmus.python.tables import read_tables

Value = TypeVar("Value")
Arguments = ParamSpec("Arguments")
cached_calls = 256
phases = ("just instantiated", "in initialization mode", "initialised", "terminated")


class UnitError(Exception):
    """A call the unit refuses; its text becomes the line in the log, where the wrapper writes its repr."""

    def __repr__(self) -> str:
        return str(self)


def entry(function: Callable[Concatenate[Unit, Arguments], Value]) -> Callable[Concatenate[Unit, Arguments], Value]:
    """Mark a method the wrapper calls: whatever it raises leaves through `Unit._fail`."""

    @wraps(function)
    def guarded(self: Unit, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Value:
        try:
            return function(self, *args, **kwargs)
        except BaseException as error:
            self._fail(error)

    return guarded


class Unit(Fmi2Slave):  # type: ignore[misc]
    """A co-simulation unit. A kernel derives from it and fills in the four hooks.

    `values` (n,) holds every Real, Integer and Boolean variable at its value reference, `data` the arrays and
    `meta` the plain values of the data file. What changes in a step must live in `values` or in a
    `state_array`: together with phase and time these are the FMU state.
    """

    instantiated, initialising, stepping, terminated = range(4)

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        resources = kwargs["resources"]
        while sys.path.count(resources) > 1:  # the wrapper adds it again for every instance
            sys.path.remove(resources)
        self._tables = read_tables(Path(resources) / "data.npz")
        self._digest = hashlib.sha256(self._tables.digest + type(self).__module__.encode()).digest()
        self.modelName = self._tables.unit_name
        self.data = self._tables.data
        self.meta = self._tables.meta
        self.values: NDArray[np.float64] = self._tables.values.copy()
        self._texts = dict(self._tables.texts)
        self._state: dict[str, NDArray[Any]] = {}
        self._time = 0.0
        self._failure: str | None = None
        self._stale = True
        self._constructing = True
        self._early_lines: list[tuple[str, Fmi2Status]] = []
        self._enter(self.instantiated)
        self.setup()
        self._constructing = False

    # Hooks of the kernel

    def setup(self) -> None:
        """Once, at construction: take views, allocate state arrays."""

    def initialise(self) -> None:
        """Compute the first state and outputs from parameters and inputs.

        Runs at the end of the initialisation, and before it whenever a value is read after one was set: it
        must not build on its own earlier results.
        """

    def restore(self) -> None:
        """After values and state arrays were replaced by saved ones: rebuild what derives from them."""

    @abstractmethod
    def advance(self, time: float, step: float) -> None:
        """Move state and outputs from `time` to `time + step` (s), the inputs held."""

    # Services for the kernel

    def span(self, name: str) -> slice:
        """Positions in `values` of an array variable or of a scalar one."""
        if name not in self._tables.spans:
            raise UnitError(f"{self.modelName} has no variable {name}")
        return self._tables.spans[name]

    def view(self, name: str) -> NDArray[np.float64]:
        """The values of an array variable, or of a scalar one as an array of length 1; not a copy."""
        return self.values[self.span(name)]

    def text(self, name: str) -> str:
        """Value of a String variable."""
        return self._texts[self.span(name).start]

    def state_array(self, name: str, shape: int | Sequence[int], dtype: DTypeLike = np.float64) -> NDArray[Any]:
        """A zeroed array that is part of the FMU state; to be written in place."""
        if name in self._state:
            raise UnitError(f"state array {name} exists already")
        array = np.zeros(shape, dtype)
        self._state[name] = array
        return array

    def warn(self, message: str) -> None:
        self._say(Fmi2Status.warning, message)

    def note(self, message: str) -> None:
        self._say(Fmi2Status.ok, message)

    # Life cycle, called by the wrapper

    @entry
    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        self._release_early_lines()
        self._require("fmi2SetupExperiment", self.instantiated)
        if not math.isfinite(start_time):
            raise UnitError(f"startTime must be finite, got {start_time!r}")
        if stop_time is not None and not stop_time > start_time:
            raise UnitError(f"stopTime must be > startTime {start_time!r}, got {stop_time!r}")
        self._time = self.values[0] = start_time

    @entry
    def enter_initialization_mode(self) -> None:
        self._release_early_lines()
        self._require("fmi2EnterInitializationMode", self.instantiated)
        self._enter(self.initialising)

    @entry
    def exit_initialization_mode(self) -> None:
        self._require("fmi2ExitInitializationMode", self.initialising)
        self._refresh()
        self._enter(self.stepping)

    @entry
    def do_step(self, current_time: float, step_size: float) -> bool:
        if self._failure is not None:
            raise UnitError(f"fmi2DoStep is refused until fmi2Reset, the instance failed: {self._failure}")
        self._require("fmi2DoStep", self.stepping)
        if not 0.0 < step_size < math.inf:
            raise UnitError(f"communicationStepSize must be finite and > 0, got {step_size!r}")
        if not abs(current_time - self._time) <= 1e-6 * step_size + 1e-9 * abs(self._time):
            raise UnitError(
                f"currentCommunicationPoint must be {self._time!r}, the end of the last step, got {current_time!r}"
            )
        self.advance(current_time, step_size)
        self._time = self.values[0] = current_time + step_size
        return True

    @entry
    def terminate(self) -> None:
        self._require("fmi2Terminate", self.stepping)
        self._enter(self.terminated)

    # Values, called by the wrapper

    # The calls of every step guard themselves: `entry` would cost them a tenth

    def get_real(self, references: list[int]) -> list[float]:
        try:
            selector = self._readable.get(tuple(references))
            if selector is not None:
                values: list[float] = self.values[selector].tolist()
                return values
            return self._get("Real", references, float)
        except BaseException as error:
            self._fail(error)

    @entry
    def get_integer(self, references: list[int]) -> list[int]:
        return self._get("Integer", references, int)

    def get_boolean(self, references: list[int]) -> list[bool]:
        try:
            selector = self._readable_booleans.get(tuple(references))
            if selector is not None:
                return [value != 0.0 for value in self.values[selector].tolist()]
            return self._get("Boolean", references, bool)
        except BaseException as error:
            self._fail(error)

    @entry
    def get_string(self, references: list[int]) -> list[str]:
        return self._get("String", references, str)

    def set_real(self, references: list[int], values: list[float]) -> None:
        try:
            selector = self._writable.get(tuple(references))
            if selector is None or not math.isfinite(sum(values)):
                self._set("Real", references, values)
            else:
                self.values[selector] = values
        except BaseException as error:
            self._fail(error)

    @entry
    def set_integer(self, references: list[int], values: list[int]) -> None:
        self._set("Integer", references, values)

    @entry
    def set_boolean(self, references: list[int], values: list[bool]) -> None:
        self._set("Boolean", references, values)

    @entry
    def set_string(self, references: list[int], values: list[str]) -> None:
        self._set("String", references, values)

    # FMU state: always the serialised bytes, so that saving and serialising are one

    @entry
    def _get_fmu_state(self) -> bytes:
        texts = json.dumps([self._failure, *self._texts.values()]).encode()
        arrays = [_little_endian(array) for array in self._arrays()]
        return pack_state(self._digest, self._phase, self._time, [*arrays, texts])

    @entry
    def _set_fmu_state(self, state: object) -> None:
        arrays = self._arrays()
        try:
            phase, time, parts = unpack_state(state, self._digest, len(arrays) + 1)
            if [len(part) for part in parts[:-1]] != [array.nbytes for array in arrays]:
                raise ValueError("must have arrays of the same sizes")
        except ValueError as error:
            raise UnitError(f"FMU state {error}") from None
        for array, part in zip(arrays, parts[:-1], strict=True):
            array[...] = np.frombuffer(part, array.dtype.newbyteorder("<")).reshape(array.shape)
        self._failure, *texts = json.loads(parts[-1])
        self._texts = dict(zip(self._texts, texts, strict=True))
        self._time = time
        self._stale = True
        self._enter(phase)
        self.restore()

    @staticmethod
    def _fmu_state_to_bytes(state: object) -> bytes:
        return state if isinstance(state, bytes) else b""

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> bytes:
        """The wrapper offers no way to report a fault here; `_set_fmu_state` checks the bytes."""
        return state

    # Internals

    def _arrays(self) -> list[NDArray[Any]]:
        return [self.values, *self._state.values()]

    def _enter(self, phase: int) -> None:
        """Change phase. The caches hold only calls that need no check in this phase."""
        self._phase = phase
        self._readable: dict[tuple[int, ...], slice | NDArray[np.intp]] = {}
        self._readable_booleans: dict[tuple[int, ...], slice | NDArray[np.intp]] = {}  # the same of Booleans
        self._writable: dict[tuple[int, ...], slice | NDArray[np.intp]] = {}

    def _refresh(self) -> None:
        if self._stale:
            self.initialise()
            self._stale = False

    def _get(self, kind: str, references: list[int], convert: Callable[[Any], Value]) -> list[Value]:
        for reference in references:
            self._variable(reference, kind)
        if self._phase == self.initialising:
            self._refresh()
        if kind == "String":
            return [convert(self._texts[reference]) for reference in references]
        key = tuple(references)
        selector = _selector(key)
        cache = {"Real": self._readable, "Boolean": self._readable_booleans}.get(kind)
        if cache is not None and self._phase != self.initialising and len(cache) < cached_calls:
            cache[key] = selector
        return [convert(value) for value in self.values[selector].tolist()]

    def _set(self, kind: str, references: list[int], values: Sequence[Any]) -> None:
        if self._phase == self.terminated:
            raise UnitError("no variable can be set after fmi2Terminate")
        variables = [self._variable(reference, kind) for reference in references]
        for variable, value in zip(variables, values, strict=True):
            self._check(variable, value)
        if kind == "String":
            self._texts.update(zip(references, values, strict=True))
        else:
            selector = _selector(tuple(references))
            self.values[selector] = values
            only_inputs = kind == "Real" and all(v["causality"] == "input" for v in variables)
            if only_inputs and self._phase == self.stepping and len(self._writable) < cached_calls:
                self._writable[tuple(references)] = selector
        self._stale = True

    def _variable(self, reference: int, kind: str) -> dict[str, Any]:
        variables = self._tables.variables
        if not 0 <= reference < len(variables):
            unsigned = reference % 2**32
            raise UnitError(f"value reference must be within 0..{len(variables) - 1}, got {unsigned}")
        variable = variables[reference]
        if variable["type"] != kind:
            raise UnitError(f"{variable['name']} is {variable['type']}, got a call for {kind}")
        return variable

    def _check(self, variable: dict[str, Any], value: Any) -> None:
        """Refuse what may not be set now, and values that are not finite or, of a parameter, out of bounds."""
        name, causality = variable["name"], variable["causality"]
        if causality not in ("input", "parameter"):
            raise UnitError(f"{name} is {causality} and cannot be set, got {value!r}")
        if variable["variability"] == "fixed" and self._phase == self.stepping:
            raise UnitError(f"{name} is fixed and cannot be set after initialisation, got {value!r}")
        if variable["type"] == "String":
            return
        if not math.isfinite(value):
            raise UnitError(f"{name} must be finite, got {value!r}")
        if causality == "parameter":
            minimum, maximum = variable.get("minimum"), variable.get("maximum")
            if minimum is not None and value < minimum:
                raise UnitError(f"{name} must be >= {minimum!r}, got {value!r}")
            if maximum is not None and value > maximum:
                raise UnitError(f"{name} must be <= {maximum!r}, got {value!r}")

    def _require(self, function: str, phase: int) -> None:
        if self._phase != phase:
            raise UnitError(f"{function} needs an instance {phases[phase]}, this one is {phases[self._phase]}")

    def _fail(self, error: BaseException) -> NoReturn:
        """Mark the instance as failed, after which it steps no more, and raise with spare references.

        Lines still in the queue join the error's text: to read them while the error is pending would lose it.
        """
        try:
            text = str(error)
            if not isinstance(error, UnitError):
                last = error.__traceback__
                while last is not None and last.tb_next is not None:
                    last = last.tb_next
                place = f" (line {last.tb_lineno} of {last.tb_frame.f_code.co_name})" if last else ""
                text = f"{type(error).__name__}: {text}{place}"
        except Exception:
            text = type(error).__name__
        text = "; ".join([*(line.msg for line in self.log_queue), _one_line(text)])
        self.log_queue.clear()
        self._failure = self._failure or text
        for released in (type(self), self, self.log_queue):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(released))
        raise UnitError(text) from None

    def _say(self, status: Fmi2Status, message: str) -> None:
        """Queue one line; during construction keep it until the wrapper reads the log."""
        line = _one_line(message)
        if self._constructing:
            self._early_lines.append((line, status))
        else:
            self.log(line, status)

    def _release_early_lines(self) -> None:
        for line, status in self._early_lines:
            self.log(line, status)
        self._early_lines.clear()


def _one_line(text: str) -> str:
    """The text without line breaks and without what UTF-8 cannot hold, on which the wrapper would crash."""
    return " ".join(text.splitlines()).encode("utf-8", "replace").decode("utf-8")


def _little_endian(array: NDArray[Any]) -> bytes:
    return array.astype(array.dtype.newbyteorder("<"), copy=False).tobytes()


def _selector(references: tuple[int, ...]) -> slice | NDArray[np.intp]:
    """Index of these positions; a slice, which numpy reads much faster, where they are contiguous."""
    first = references[0] if references else 0
    if references == tuple(range(first, first + len(references))):
        return slice(first, first + len(references))
    return np.array(references, dtype=np.intp)
