"""Stepping of native units by a loop in C."""

import ctypes
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexbeams.fmus.packaging.cache import is_sound, keep, prepare_cache, toolchain_key
from flexbeams.fmus.packaging.compilers import find_compiler, host_platform
from flexbeams.plant.basis import Array
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.declaration import TYPE_ORDER
from flexbeams.scenarios.simulation.instance import DISCARD, UnitInstance
from flexbeams.scenarios.simulation.stepping import Move, SignalBus

_NATIVE = Path(__file__).parent / "native"
_FUNCTIONS = {  # of a unit, in the order of the C structure
    "get_real": "fmi2GetReal",
    "set_real": "fmi2SetReal",
    "get_integer": "fmi2GetInteger",
    "get_boolean": "fmi2GetBoolean",
    "do_step": "fmi2DoStep",
    "set_integer": "fmi2SetInteger",
    "set_boolean": "fmi2SetBoolean",
}
_CONVERSION = np.dtype([("input", np.int64), ("factor", np.float64), ("offset", np.float64)])


class _References(ctypes.Structure):
    _fields_ = [
        (field, kind)
        for name in ("reals", "integers", "booleans")
        for field, kind in ((name, ctypes.c_void_p), (f"n_{name}", ctypes.c_size_t))
    ]


class _Unit(ctypes.Structure):
    _fields_ = [
        ("component", ctypes.c_void_p),
        *((name, ctypes.c_void_p) for name in _FUNCTIONS),
        ("written", _References),
        ("sources", ctypes.c_void_p),
        ("n_sources", ctypes.c_size_t),
        ("conversions", ctypes.c_void_p),
        ("n_conversions", ctypes.c_size_t),
        ("inputs", ctypes.c_void_p),
        ("read", _References),
        ("scratch", ctypes.c_void_p),
        ("first_output", ctypes.c_int64),
    ]


class _Run(ctypes.Structure):
    _fields_ = [
        ("units", ctypes.POINTER(_Unit)),
        ("n_units", ctypes.c_size_t),
        ("gauss_seidel", ctypes.c_int),
        ("step", ctypes.c_double),
        ("start_time", ctypes.c_double),
        ("signals", ctypes.c_void_p),
        ("first_external", ctypes.c_int64),
        ("n_external", ctypes.c_size_t),
        ("recorded", ctypes.c_void_p),
        ("n_spans", ctypes.c_size_t),
        ("n_recorded", ctypes.c_size_t),
        ("done", ctypes.c_int64),
        ("calls", ctypes.c_int64),
        ("failed_unit", ctypes.c_int64),
        ("failed_function", ctypes.c_int),
        ("failed_status", ctypes.c_int),
    ]


class _Pace(ctypes.Structure):
    _fields_ = [("started", ctypes.c_double), ("seconds_per_step", ctypes.c_double), ("lateness", ctypes.c_void_p)]


_RUN_BLOCK = (  # run, first, count, external, every, rows, pace
    ctypes.c_void_p,
    ctypes.c_int64,
    ctypes.c_size_t,
    ctypes.c_void_p,
    ctypes.c_int64,
    ctypes.c_void_p,
    ctypes.c_void_p,
)


class NativeStepper:
    """The loop in C (native/stepper.c), for instances whose functions are C; bit-identical to the Python one.

    With `pace`, seconds of the wall clock for each second of the run, every step waits for its time; `lateness` then
    has the delay of each step, s.
    """

    def __init__(
        self,
        instances: Mapping[str, UnitInstance],
        bus: SignalBus,
        library: Path,
        pace: float | None = None,
        steps: int = 0,
    ) -> None:
        self._instances, self._bus = list(instances.values()), bus
        self._library = ctypes.CDLL(str(library))
        self._library.run_block.restype = ctypes.c_size_t
        self._library.run_block.argtypes = _RUN_BLOCK
        self._library.time_block.restype = ctypes.c_size_t
        self._library.pace_clock.restype = ctypes.c_double
        self._referenced: list[Any] = []  # by the C structures
        table = (_Unit * len(instances))(*[self._describe(i) for i in self._instances])
        recorded = _spans(bus.recorded)
        self._referenced.append(recorded)
        self._run = _Run(
            units=table,
            n_units=len(instances),
            gauss_seidel=bus.coupling != "jacobi",
            step=bus.step,
            start_time=bus.start_time,
            signals=bus.signals.ctypes.data,
            first_external=bus.external.start,
            n_external=bus.external.stop - bus.external.start,
            recorded=recorded.ctypes.data,
            n_spans=len(recorded),
            n_recorded=len(bus.recorded),
        )
        for instance in self._instances:
            instance.calls = lambda: self._run.calls
        self._pace = None if pace is None else _Pace(started=0.0, seconds_per_step=pace * bus.step, lateness=None)
        self.lateness = None if pace is None else np.zeros(steps)

    def advance(self, first: int, external: Array, every: int, rows: Array, first_row: int = 0) -> int:
        """See Stepper.advance."""
        external = self._rows(external)
        pace = None
        if self._pace is not None and self.lateness is not None:
            if first == 0:
                self._pace.started = self._library.pace_clock()
            self._pace.lateness = self.lateness.ctypes.data + first * self.lateness.itemsize
            pace = ctypes.byref(self._pace)
        rows_at = rows.ctypes.data - first_row * rows.strides[0]  # of row 0, as the loop counts
        done = self._library.run_block(
            ctypes.byref(self._run), first, len(external), external.ctypes.data, every, rows_at, pace
        )
        return self._require(int(done), len(external))

    @property
    def done(self) -> int:
        """See Stepper.done."""
        number: int = self._run.done
        return number

    def begin(self, number: int) -> None:
        """See Stepper.begin."""
        self._run.done = number

    def bound(self, external: Array, every: int, rows: Array) -> Move:
        """See Stepper.bound; the call costs about a microsecond."""
        run_block, run, require = self._library.run_block, ctypes.byref(self._run), self._require
        external_at, row_size, rows_at = external.ctypes.data, external.strides[0], rows.ctypes.data

        def move(first: int, row: int, count: int) -> int:
            done: int = run_block(run, first, count, external_at + row * row_size, every, rows_at, None)
            return done if done == count else require(done, count)

        return move

    def durations(self, first: int, external: Array) -> Array:
        """Duration of each step, s (count,), of steps as in `advance` with nothing recorded."""
        external, seconds = self._rows(external), np.empty(len(external))
        done = self._library.time_block(
            ctypes.byref(self._run),
            ctypes.c_int64(first),
            ctypes.c_size_t(len(external)),
            ctypes.c_void_p(external.ctypes.data),
            ctypes.c_void_p(seconds.ctypes.data),
        )
        self._require(int(done), len(external))
        return seconds

    def _rows(self, external: Array) -> Array:
        assert external.shape[1] == self._run.n_external, "a row has the external signals that change"
        return np.ascontiguousarray(external)

    def _require(self, done: int, count: int) -> int:
        """The steps done; UnitFailure or UnitEnded where they are fewer than `count`."""
        if done < count:
            instance = self._instances[self._run.failed_unit]
            function = ("fmi2Set...", "fmi2DoStep", "fmi2Get...")[self._run.failed_function]
            instance.time = self._bus.start_time + self.done * self._bus.step
            discarded = function == "fmi2DoStep" and self._run.failed_status == DISCARD
            if discarded and (end := instance.end(self._bus.step)):
                raise end
            raise instance.failure(function, f"status {self._run.failed_status}")
        return done

    def _describe(self, instance: UnitInstance) -> _Unit:
        references = instance.references
        sources = _spans(self._bus.sources[instance.name])
        conversions = np.array([(k, c.factor, c.offset) for k, c in instance.conversions.items()], _CONVERSION)
        scratch = np.zeros(max(len(instance.inputs), sum(map(len, references.read.values())), 1), np.int32)
        self._referenced += [sources, conversions, scratch]
        return _Unit(
            component=instance.component,
            written=self._typed(references.written),
            sources=sources.ctypes.data,
            n_sources=len(sources),
            conversions=conversions.ctypes.data,
            n_conversions=len(conversions),
            inputs=instance.inputs.ctypes.data,
            read=self._typed(references.read),
            scratch=scratch.ctypes.data,
            first_output=self._bus.spans[instance.name].start,
            **{field: instance.address(name) for field, name in _FUNCTIONS.items()},
        )

    def _typed(self, references: Mapping[str, NDArray[np.uint32]]) -> _References:
        """Value references by type as the C loop takes them."""
        arrays = [np.array(references[kind], np.uint32) for kind in TYPE_ORDER]
        self._referenced += arrays
        return _References(*[value for array in arrays for value in (array.ctypes.data, len(array))])


def _spans(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices as (spans, 2): first and count of each run of consecutive ones."""
    begins = np.flatnonzero(np.diff(indices, prepend=-2) != 1)
    return np.stack([indices[begins], np.diff(begins, append=len(indices))], axis=1).astype(np.int64)


def stepper_library(folder: Path, compiler: str) -> Path:
    """The compiled loop and loggers, kept in the cache `folder` under a name that depends on sources and compiler.

    Raises BuildError, and InputError for a cache that cannot be trusted.
    """
    sources = [_NATIVE / "stepper.c", _NATIVE / "loggers.c"]
    key = b"".join(file.read_bytes() for file in [*sources, _NATIVE / "stepper.h"]) + toolchain_key(compiler).encode()
    digest, platform = hashlib.sha256(key).hexdigest()[:16], host_platform()
    library = folder / f"stepper-{digest}{platform.suffix}"
    prepare_cache(folder)
    if not is_sound(library, folder):
        with temporary_folder() as temporary:
            built = temporary / f"stepper{platform.suffix}"
            find_compiler(compiler).build(built, sources, [_NATIVE], platform)
            keep(library, built.read_bytes(), folder)
    return library
