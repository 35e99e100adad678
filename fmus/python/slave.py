"""Base of the Python units: FMI's bookkeeping between pythonfmu's wrapper and a numpy kernel.

The packager joins this module, those it imports and a kernel to one file with a name of its own, because all
pythonfmu units of a process share one interpreter.

A refused call raises, because that is the only way pythonfmu 0.7.0's wrapper can tell the importer: it
returns fmi2Fatal and logs the text. (It never returns fmi2Error; fmi2Discard, a step's False, ends FMPy's
simulation silently.) It also releases references to class, instance and log queue that
it needs again, so `Unit._fail` adds spare ones: the instance stays usable and can be reset. It
reads the log queue after every call except construction, reset and free, and crashes on a line that
remains at free.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import math
import sys
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, NoReturn, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray
from pythonfmu import Fmi2Slave

from flexbeams.fmus.python.checks import (
    INITIALISING,
    INSTANTIATED,
    STEPPING,
    TERMINATED,
    common_bounds,
    require_phase,
    require_settable,
    require_sound,
    variable_of,
)
from flexbeams.fmus.python.kernel import CallError, Kernel, UnitError, failure_text, one_line
from flexbeams.fmus.python.snapshot import is_plausible, little_endian, pack_state, unpack_arrays, unpack_state
from flexbeams.fmus.python.tables import read_tables, selector_of

Value = TypeVar("Value")
Arguments = ParamSpec("Arguments")
CACHED_CALLS = 256


def entry(function: Callable[Concatenate[Unit, Arguments], Value]) -> Callable[Concatenate[Unit, Arguments], Value]:
    """Mark a method the wrapper calls: whatever it raises leaves through `Unit._fail`."""

    @wraps(function)
    def guarded(self: Unit, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Value:
        try:
            return function(self, *args, **kwargs)
        except BaseException as error:
            self._fail(error)

    return guarded


class Unit(Kernel, Fmi2Slave):  # type: ignore[misc]
    """A co-simulation unit. The class of a unit derives from it and fills in the hooks of `Kernel`."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        resources = kwargs["resources"]
        while sys.path.count(resources) > 1:  # the wrapper adds it again for every instance
            sys.path.remove(resources)
        self._load(read_tables(Path(resources) / "data.npz"))
        self._digest = hashlib.sha256(self._tables.digest + type(self).__module__.encode()).digest()
        self.modelName = self._tables.unit_name
        self._failure: str | None = None
        self._stale = True
        self._enter(INSTANTIATED)
        self.setup()
        self._constructing = False

    # Life cycle, called by the wrapper

    @entry
    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """fmi2SetupExperiment, times in s."""
        self._release_early_lines()
        require_phase("fmi2SetupExperiment", INSTANTIATED, self._phase)
        if not math.isfinite(start_time):
            raise UnitError(f"startTime must be finite, got {start_time!r}")
        if stop_time is not None and not stop_time > start_time:
            raise UnitError(f"stopTime must be > startTime {start_time!r}, got {stop_time!r}")
        self.clock.begin(start_time, math.inf if stop_time is None else stop_time)
        self.values[0] = start_time

    @entry
    def enter_initialization_mode(self) -> None:
        """fmi2EnterInitializationMode."""
        self._release_early_lines()
        require_phase("fmi2EnterInitializationMode", INSTANTIATED, self._phase)
        self._enter(INITIALISING)

    @entry
    def exit_initialization_mode(self) -> None:
        """fmi2ExitInitializationMode: first state and outputs."""
        require_phase("fmi2ExitInitializationMode", INITIALISING, self._phase)
        require_sound("fmi2ExitInitializationMode", self._failure)
        self._refresh()
        self._enter(STEPPING)

    @entry
    def do_step(self, current_time: float, step_size: float) -> bool:
        """fmi2DoStep from `current_time` by `step_size` (s)."""
        require_sound("fmi2DoStep", self._failure)
        require_phase("fmi2DoStep", STEPPING, self._phase)
        clock = self.clock
        if (refusal := clock.refusal(current_time, step_size, self._tables.step_size)) is not None:
            raise UnitError(refusal)
        self._compute(lambda: self.advance(clock.elapsed, step_size))
        clock.advance(current_time, step_size)
        self.values[0] = clock.start + clock.elapsed
        return True

    @entry
    def terminate(self) -> None:
        """fmi2Terminate."""
        require_phase("fmi2Terminate", STEPPING, self._phase)
        self._enter(TERMINATED)

    # Values, called by the wrapper

    # The calls of every step guard themselves: `entry` would cost them a tenth

    def get_real(self, references: list[int]) -> list[float]:
        """fmi2GetReal."""
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
        """fmi2GetInteger."""
        return self._get("Integer", references, int)

    def get_boolean(self, references: list[int]) -> list[bool]:
        """fmi2GetBoolean."""
        try:
            selector = self._readable_booleans.get(tuple(references))
            if selector is not None:
                return [value != 0.0 for value in self.values[selector].tolist()]
            return self._get("Boolean", references, bool)
        except BaseException as error:
            self._fail(error)

    @entry
    def get_string(self, references: list[int]) -> list[str]:
        """fmi2GetString."""
        return self._get("String", references, str)

    def set_real(self, references: list[int], values: list[float]) -> None:
        """fmi2SetReal."""
        try:
            selector, low, high = self._writable.get(tuple(references), (None, 0.0, 0.0))
            if (
                selector is not None
                and math.isfinite(sum(values))  # min and max overlook NaN
                and low <= min(values)
                and max(values) <= high
            ):
                self.values[selector] = values
            else:
                self._set("Real", references, values)
        except BaseException as error:
            self._fail(error)

    @entry
    def set_integer(self, references: list[int], values: list[int]) -> None:
        """fmi2SetInteger."""
        self._set("Integer", references, values)

    @entry
    def set_boolean(self, references: list[int], values: list[bool]) -> None:
        """fmi2SetBoolean."""
        self._set("Boolean", references, values)

    @entry
    def set_string(self, references: list[int], values: list[str]) -> None:
        """fmi2SetString."""
        self._set("String", references, values)

    # FMU state: always the serialised bytes, so that saving and serialising are one

    @entry
    def _get_fmu_state(self) -> bytes:
        texts = json.dumps([self._failure, *self._texts.values()]).encode()
        arrays = [little_endian(array) for array in self._arrays()]
        return pack_state(self._digest, self._phase, [*arrays, texts])

    @entry
    def _set_fmu_state(self, state: object) -> None:
        arrays = self._arrays()
        try:
            phase, parts = unpack_state(state, self._digest, len(arrays) + 1)
            saved = unpack_arrays(arrays, parts[:-1])
            failure, *texts = json.loads(parts[-1])
            if not is_plausible(self._tables.variables, phase, saved, failed=failure is not None):
                raise ValueError("must have contents that this unit can have saved")
        except ValueError as error:
            raise UnitError(f"FMU state {error}") from None
        for array, content in zip(arrays, saved, strict=True):
            array[...] = content
        self._failure = failure
        self._texts = dict(zip(self._texts, texts, strict=True))
        self._stale = True
        self._enter(phase)
        if phase >= STEPPING:
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
        return [self.clock.fields, self.values, *self._state.values()]

    def _enter(self, phase: int) -> None:
        """Change phase. The caches hold only calls that need no check in this phase."""
        self._phase = phase
        self._readable: dict[tuple[int, ...], slice | NDArray[np.intp]] = {}
        self._readable_booleans: dict[tuple[int, ...], slice | NDArray[np.intp]] = {}  # the same of Booleans
        # with the bounds that the values have in common
        self._writable: dict[tuple[int, ...], tuple[slice | NDArray[np.intp], float, float]] = {}

    def _refresh(self) -> None:
        if self._stale:
            self._compute(self.initialise)
            self._stale = False

    def _try_refresh(self) -> None:
        """The same for a call that only reads: where it is refused, the instance goes on."""
        try:
            self._refresh()
        except UnitError as error:
            raise CallError(str(error)) from None

    def _get(self, kind: str, references: list[int], convert: Callable[[Any], Value]) -> list[Value]:
        for reference in references:
            variable_of(self._tables.variables, reference, kind)
        if self._phase == INITIALISING:
            self._try_refresh()
        if kind == "String":
            return [convert(self._texts[reference]) for reference in references]
        key = tuple(references)
        selector = selector_of(key)
        cache = {"Real": self._readable, "Boolean": self._readable_booleans}.get(kind)
        if cache is not None and self._phase != INITIALISING and len(cache) < CACHED_CALLS:
            cache[key] = selector
        return [convert(value) for value in self.values[selector].tolist()]

    def _set(self, kind: str, references: list[int], values: Sequence[Any]) -> None:
        if self._phase == TERMINATED:
            raise CallError("no variable can be set after fmi2Terminate")
        variables = [variable_of(self._tables.variables, reference, kind) for reference in references]
        for variable, value in zip(variables, values, strict=True):
            require_settable(variable, value, self._phase)
        if kind == "String":
            self._texts.update(zip(references, values, strict=True))
        else:
            selector = selector_of(tuple(references))
            self.values[selector] = values
            only_inputs = kind == "Real" and all(v["causality"] == "input" for v in variables)
            if only_inputs and self._phase == STEPPING and len(self._writable) < CACHED_CALLS:
                self._writable[tuple(references)] = (selector, *common_bounds(variables))
        self._stale = True

    def _fail(self, error: BaseException) -> NoReturn:
        """Raise with spare references; but for a CallError the instance has failed and steps no more.

        Lines still in the queue join the error's text: to read them while the error is pending would lose it.
        """
        text = "; ".join([*(line.msg for line in self.log_queue), one_line(failure_text(error))])
        self.log_queue.clear()
        if not isinstance(error, CallError):
            self._failure = self._failure or text
        for released in (type(self), self, self.log_queue):
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(released))
        raise UnitError(text) from None
