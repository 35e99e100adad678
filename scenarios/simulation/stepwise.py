"""Stepping under the caller's control: some steps at a time, with inputs of one's own, snapshots and new starts."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import Coupling
from flexbeams.scenarios.processes.interrupt import deferred_interrupt
from flexbeams.scenarios.simulation.cosimulation import BLOCK, CoSimulation, Starts
from flexbeams.scenarios.simulation.failure import UnitEnded, UnitFailure
from flexbeams.scenarios.simulation.frames import FrameRecorder
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.simulation.recording import Recording, Rows, decimal_ticks
from flexbeams.scenarios.simulation.stepping import Move, PythonStepper, SignalBus, Stepper
from flexbeams.scenarios.simulation.unit_states import HeldStates, UnitStates, pack_snapshot, unpack_snapshot
from flexbeams.scenarios.simulation.wiring import Wiring

_SIGNALS = "."  # name of the part of a snapshot that holds the signals; no instance has it


class _Branch(NamedTuple):
    """Where the course of a simulation last left another one: after a restored step."""

    first: int
    identity: object


class Snapshot:
    """The complete state of a simulation at a step; `bytes(snapshot)` can be restored in any process."""

    def __init__(self, data: bytes, held: "_Held | None" = None) -> None:
        self._data, self.held = data, held

    def __bytes__(self) -> bytes:
        return self._data

    def __reduce__(self) -> tuple[type["Snapshot"], tuple[bytes]]:
        return Snapshot, (self._data,)


class _Held(NamedTuple):
    """What a snapshot keeps in the process that took it."""

    states: HeldStates
    signals: Array
    done: int
    course: tuple[_Branch, ...]


class Stepwise(CoSimulation):
    """A co-simulation that the caller steps, from 0 to at most `steps` steps; every `decimate`-th is recorded.

    Signals that the wiring holds are the caller's to set, in `signals`.
    """

    def __init__(
        self,
        instances: dict[str, UnitInstance],
        wiring: Wiring,
        step: float,
        coupling: Coupling,
        stepper: Callable[[Mapping[str, UnitInstance], SignalBus], Stepper] | None,
        start_time: float,
        steps: int,
        decimate: int,
    ) -> None:
        super().__init__(instances, wiring, step, coupling, stepper, start_time)
        self.steps, self.signals = steps, self._bus.signals
        self._states = UnitStates(instances)
        self._rows = Rows(
            self._bus.signals,
            self._bus.recorded,
            steps,
            decimate,
            step=step,
            start_time=start_time,
            converted=wiring.converted_columns,
        )
        self._frames = FrameRecorder(wiring.frames, instances, steps, step)
        self._external_rows = np.zeros((BLOCK, self._bus.external.stop - self._bus.external.start))
        self._move: Move = self.stepper.bound(self._external_rows, decimate, self._rows.values)
        self._native = not isinstance(self.stepper, PythonStepper)
        self._block = 0  # first step of the rows in _external_rows, which depend on the time only
        self._fill(0)
        self._first = 0  # first step of the recording
        self._course: tuple[_Branch, ...] = ()
        self._failure: UnitFailure | None = None
        self._closed = False
        self.ended = ""
        self._per_step, self._scale = decimal_ticks(step)

    @property
    def time(self) -> float:
        """Simulated time, s, rounded to the decimals of the step."""
        return self._bus.start_time + self.stepper.done * self._per_step / self._scale

    @property
    def done(self) -> int:
        """Number of steps done."""
        return self.stepper.done

    def begin(self, starts: Starts, stop_time: float, notify: Callable[[str], None]) -> None:
        """Initialises instances that are new or were reset; UnitFailure where a unit refuses a value."""
        self.initialise(starts, stop_time, notify)
        self.stepper.begin(0)
        self._first, self._course, self._failure, self.ended = 0, (_Branch(0, object()),), None, ""
        self._frames.rewind(0)

    def reset(self, starts: Starts, stop_time: float, notify: Callable[[str], None]) -> None:
        """Starts anew with these values."""
        self._require_alive()
        for instance in self._instances.values():
            instance.call("reset")
        try:
            self.begin(starts, stop_time, notify)
        except UnitFailure as failure:
            self._failure = failure
            raise

    def advance(self, count: int) -> None:
        """Steps `count` times; UnitFailure where a unit fails, UnitEnded where it ends the run.

        Ctrl-C takes effect between two steps.
        """
        end = self.stepper.done + count
        if end > self.steps or self._failure is not None or self.ended or self._closed:
            self._require_open(end)
        if count == 1 and self._native:  # the call in C, which Ctrl-C does not interrupt, counts the step
            self._advance(end)
            return
        with deferred_interrupt() as interrupted:
            while self.stepper.done < end and not interrupted():
                self._advance(min(end, self.stepper.done + BLOCK))
            stopped = interrupted()
        if stopped:
            raise KeyboardInterrupt

    def _advance(self, end: int) -> None:
        done = self.stepper.done
        while done < end:
            if done == self._frames.due:
                self._drive(done)
                self._frames.take(self.signals)
            row = done - self._block
            if not 0 <= row < BLOCK:
                self._fill(done)
                row = 0
            size = min(end - done, BLOCK - row, self._frames.due - done if self._frames.due > done else BLOCK)
            try:
                done += self._move(done, row, size)
            except UnitFailure as failure:
                if self._bus.coupling != "jacobi" or " in fmi2Set" not in str(failure):
                    self._failure = failure  # some units may have stepped
                raise
            except UnitEnded as end_of_run:
                self._end(end_of_run)
                raise

    def _end(self, end: UnitEnded) -> None:
        """Completes the step of a unit that ended the run at its end."""
        self.ended = str(end)
        if not end.completed:
            return
        try:
            self._complete_step(end.instance, self.stepper.done)
        except UnitFailure as failure:
            self._failure, self.ended = failure, ""
            raise
        self.stepper.begin(self.stepper.done + 1)

    def _require_alive(self) -> None:
        if self._closed:
            raise InputError("simulation", "is closed")

    def _require_open(self, end: int) -> None:
        self._require_alive()
        if self._failure is not None:
            raise InputError("", f"{self._failure}; the simulation goes on after reset or restore")
        if self.ended:
            raise InputError("", f"{self.ended}; the simulation goes on after reset or restore")
        last = self._bus.start_time + self.steps * self._bus.step
        raise InputError("step", f"must end by the stop time, {last:g} s; see stop_time", end * self._bus.step)

    def _fill(self, first: int) -> None:
        """The external signals of a block of steps from `first` on."""
        self._block = first
        if self._external_rows.shape[1]:
            self._external_rows[:] = self._external(first, BLOCK)

    def snapshot(self) -> Snapshot:
        """The present state; InputError where a unit cannot save its own."""
        self._require_alive()
        self._states.require_savable()
        if self._failure is not None:
            self._require_open(0)
        states = self._states.take()
        parts = {_SIGNALS: self.signals.astype("<f8").tobytes(), **self._states.to_bytes(states)}
        data = pack_snapshot({"done": self.done, "step": self._bus.step}, parts)
        return Snapshot(data, _Held(states, self.signals.copy(), self.done, self._course))

    def restore(self, snapshot: Snapshot | bytes) -> None:
        """Goes on from a snapshot.

        The rows recorded up to its time stay where they are of the snapshot's past; else the recording begins at its
        time. Raises InputError for a snapshot of other units, signals or steps.
        """
        self._require_alive()
        held = snapshot.held if isinstance(snapshot, Snapshot) else None
        if held is None or not self._states.took(held.states):
            if not isinstance(snapshot, Snapshot | bytes | bytearray | memoryview):
                raise InputError("snapshot", "must be one that snapshot() gave, or its bytes", snapshot)
            header, parts = unpack_snapshot(bytes(snapshot))
            self._require_same(header, parts)
            signals = np.frombuffer(parts.pop(_SIGNALS), "<f8")
            held = _Held(self._states.from_bytes(parts), signals, int(header["done"]), ())
        self._states.put(held.states)
        self.signals[:] = held.signals
        self._go_on(held.done, held.course)

    def _require_same(self, header: Mapping[str, object], parts: Mapping[str, bytes]) -> None:
        if sorted(parts) != sorted([_SIGNALS, *self._instances]) or len(parts[_SIGNALS]) != self.signals.nbytes:
            raise InputError("snapshot", f"must be of a simulation of {', '.join(self._instances)} with these signals")
        if header["step"] != self._bus.step or not 0 <= int(str(header["done"])) <= self.steps:
            raise InputError("snapshot", f"must be of steps of {self._bus.step:g} s, by the stop time")

    def _go_on(self, done: int, course: tuple[_Branch, ...]) -> None:
        """Continues the recording at a step of a course, or begins it there."""
        past, own = (tuple(branch for branch in c if branch.first < done) for c in (course, self._course))
        if not past or past != own:
            self._first, past = done, ()
        self._course = (*past, _Branch(done, object()))
        self._failure, self.ended = None, ""
        self.stepper.begin(done)
        self._frames.rewind(done)

    def recording(self) -> Recording:
        """A copy of what is recorded, up to the present step."""
        done = self.done
        self._drive(done)
        self._take_frame()
        self._rows.take(done)
        rows = self._rows.copy(done)
        recording = rows.recording(self._wiring.columns, done, 0.0, self._wiring.deflections)
        skipped = -(-self._first // rows.decimate)
        recording.time = recording.time[skipped:]
        recording.values = recording.values[skipped:]
        recording.failure, recording.ended = self._failure, self.ended
        recording.frames = self._frames.taken() if self._first == 0 else None
        return recording

    def _take_frame(self) -> None:
        """The frame of the present step, if one is due."""
        if self.done == self._frames.due and not self._closed:
            self._drive(self.done)
            self._frames.take(self.signals)

    def close(self) -> None:
        """Frees the saved states, before the instances end; what was recorded stays."""
        with suppress(UnitFailure):
            self._take_frame()
        self._states.free_all()
        self._closed = True
