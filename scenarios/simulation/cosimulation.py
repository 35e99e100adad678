"""Stepping of coupled instances, in integer steps, with one array for all signals."""

import time as clock
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cached_property

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.choices import Coupling
from flexbeams.scenarios.definition.values import TypedValue
from flexbeams.scenarios.processes.interrupt import deferred_interrupt
from flexbeams.scenarios.simulation.failure import UnitEnded, UnitFailure
from flexbeams.scenarios.simulation.frames import FrameRecorder
from flexbeams.scenarios.simulation.initialisation import Initialisation, needed_inputs
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.simulation.recording import Recording, Rows
from flexbeams.scenarios.simulation.row_file import RowFile
from flexbeams.scenarios.simulation.stepping import PythonStepper, SignalBus, Stepper
from flexbeams.scenarios.simulation.wiring import Wiring

BLOCK = 500  # steps between updates of progress and external signals, fewer of slow units
_FIRST_BLOCK = 4  # steps, doubled while a block is short
_BLOCK_SECONDS = 0.5  # of a block that is long

Starts = Mapping[str, Mapping[str, TypedValue]]  # start values by instance and variable


class CoSimulation:
    """Instances that step together as wired; `stepper` chooses the loop, by default the one in Python."""

    def __init__(
        self,
        instances: dict[str, UnitInstance],
        wiring: Wiring,
        step: float,
        coupling: Coupling,
        stepper: Callable[[Mapping[str, UnitInstance], SignalBus], Stepper] | None = None,
        start_time: float = 0.0,
    ) -> None:
        self._instances, self._wiring, self._step = instances, wiring, step
        signals = np.zeros(wiring.size)
        sources = {name: np.array([index for _, index in wiring.inputs[name]], dtype=np.int64) for name in instances}
        self._bus = SignalBus(
            signals=signals,
            external=wiring.changing,
            spans=wiring.spans,
            sources=sources,
            recorded=np.array(wiring.recorded, dtype=np.int64),
            coupling=coupling,
            step=step,
            start_time=start_time,
        )
        for name, instance in instances.items():
            written = [n for n, _ in wiring.inputs[name]]
            instance.connect(wiring.reads[name], signals[wiring.spans[name]], written, wiring.conversions.get(name))
        self._python_stepper = PythonStepper(instances, self._bus)
        self.stepper: Stepper = stepper(instances, self._bus) if stepper else self._python_stepper

    def initialise(self, starts: Starts, stop_time: float, notify: Callable[[str], None] = lambda text: None) -> None:
        """Start values, then initialisation mode of all instances for a run of `stop_time` s; values follow the wires.

        Loops are noted. Raises UnitFailure where a unit refuses a value.
        """
        for name, values in starts.items():
            self._instances[name].set_values(values)
        for instance in self._instances.values():
            instance.call("setupExperiment", None, self._bus.start_time, self._bus.start_time + stop_time)
            instance.call("enterInitializationMode")
        self._hold(starts)
        self._drive(0)
        Initialisation(self._instances, self._wiring, self._bus.signals, self._needs).exchange(notify)
        for instance in self._instances.values():
            instance.call("exitInitializationMode")
        for instance in self._instances.values():
            instance.read()

    @cached_property
    def _needs(self) -> dict[str, dict[str, frozenset[str]]]:
        return needed_inputs(self._instances, self._wiring)

    def run(
        self,
        steps: int,
        progress: Callable[[int], None] = lambda done: None,
        decimate: int = 1,
        file: RowFile | None = None,
    ) -> Recording:
        """Steps from 0 to steps * step and records every `decimate`-th step and the last one, into `file` if given.

        A unit that fails or wants to end, or Ctrl-C, ends the run; the rows until then are kept. Ctrl-C, or a
        KeyboardInterrupt raised by `progress`, takes effect after a block of steps, so that it interrupts no call of a
        unit; a second Ctrl-C is raised at once.
        """
        rows = Rows(
            self._bus.signals,
            self._bus.recorded,
            steps,
            decimate,
            step=self._step,
            start_time=self._bus.start_time,
            converted=self._wiring.converted_columns,
            file=file,
        )
        rows.take(0)
        frames = FrameRecorder(self._wiring.frames, self._instances, steps, self._step)
        failure, ended = None, ""
        begin = clock.perf_counter()
        with deferred_interrupt() as interrupted:
            try:
                done = self._step_blocks(steps, rows, frames, interrupted, progress)
                self._drive(done)
                rows.take(done)
                if done == frames.due:
                    frames.take(self._bus.signals)
            except UnitFailure as error:
                failure, done = error, self.stepper.done
            except UnitEnded as end:
                ended, done = str(end), self.stepper.done
                if end.completed:
                    try:
                        self._complete_step(end.instance, done)
                        done += 1
                        self._drive(done)
                        rows.take(done)
                    except UnitFailure as error:
                        failure, ended = error, ""
        seconds = clock.perf_counter() - begin
        recording = rows.recording(self._wiring.columns, done, seconds, self._wiring.deflections)
        recording.failure, recording.ended = failure, ended
        recording.interrupted = failure is None and not ended and done < steps
        recording.frames = frames.taken()
        if self.stepper.lateness is not None:
            recording.lateness = self.stepper.lateness[:done]
        return recording

    def _step_blocks(
        self,
        steps: int,
        rows: Rows,
        frames: FrameRecorder,
        interrupted: Callable[[], bool],
        progress: Callable[[int], None],
    ) -> int:
        """Steps in blocks that end where a frame is due; returns the steps done, fewer after an interrupt."""
        done, notified, block = 0, 0, _FIRST_BLOCK
        while done < steps and not interrupted():
            if done == frames.due:
                self._drive(done)
                frames.take(self._bus.signals)
            count = min(block, steps - done, frames.due - done if frames.due > done else block)
            count = rows.room(done, count)
            begin = clock.perf_counter()
            done += self.stepper.advance(done, self._external(done, count), rows.decimate, rows.values, rows.first)
            seconds = clock.perf_counter() - begin
            block = min(2 * block, BLOCK) if seconds < _BLOCK_SECONDS else max(block // 2, 1)
            if done - notified >= min(block, BLOCK) or done == steps:
                notified = done
                try:
                    progress(done)
                except KeyboardInterrupt:
                    break
        return done

    def _complete_step(self, ended: str, number: int) -> None:
        """Steps the instances behind the one that ended the run at the end of this step."""
        bus, jacobi = self._bus, self._bus.coupling == "jacobi"
        names = list(self._instances)
        if not jacobi:
            self._instances[ended].read()
        for name in names[names.index(ended) + 1 :]:
            if not jacobi:
                self._python_stepper.exchange(name, bus.start_time + number * bus.step)
            with suppress(UnitEnded):
                self._instances[name].step(bus.start_time + number * bus.step, bus.step)
            if not jacobi:
                self._instances[name].read()
        for name in names if jacobi else ():
            self._instances[name].read()

    def _hold(self, starts: Starts) -> None:
        """Writes the start values of held signals into the array."""
        for span, signal in self._wiring.external:
            if isinstance(signal, float):
                self._bus.signals[span] = signal
        for owner, inputs in self._wiring.inputs.items():
            for name, index in inputs:
                if index >= self._bus.external.stop and name in starts.get(owner, {}):
                    self._bus.signals[index] = float(starts[owner][name])

    def _drive(self, number: int) -> None:
        """Writes the external signals of one step into the array."""
        self._bus.signals[self._bus.external] = self._external(number, 1)[0]

    def _external(self, first: int, count: int) -> Array:
        """External signals of steps first ... first + count - 1, (count, all external elements)."""
        time = np.arange(first, first + count, dtype=np.float64) * self._step
        external = self._bus.external
        rows = np.empty((count, external.stop - external.start))
        for span, signal in self._wiring.external:
            if not isinstance(signal, float):
                rows[:, span.start - external.start : span.stop - external.start] = signal.sample(time)
        return rows
