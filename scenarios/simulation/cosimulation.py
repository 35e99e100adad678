"""Stepping of coupled instances, in integer steps, with one array for all signals."""

import time as clock
from collections.abc import Callable, Mapping

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.schema import Coupling
from flexbeams.scenarios.processes.interrupt import deferred_interrupt
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.frames import FrameRecorder
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.stepping import PythonStepper, SignalBus, Stepper
from flexbeams.scenarios.simulation.wiring import Wiring

BLOCK = 500  # steps between looks at progress and external signals


class CoSimulation:
    """Instances that step together as wired; `stepper` chooses the loop, by default the one in Python."""

    def __init__(
        self,
        instances: dict[str, UnitInstance],
        wiring: Wiring,
        step: float,
        coupling: Coupling,
        stepper: Callable[[Mapping[str, UnitInstance], SignalBus], Stepper] | None = None,
    ) -> None:
        self._instances, self._wiring, self._step = instances, wiring, step
        signals = np.zeros(wiring.size)
        sources = {name: np.array([place for _, place in wiring.inputs[name]], dtype=np.int64) for name in instances}
        first = wiring.external[0][0].start if wiring.external else wiring.size
        self._bus = SignalBus(
            signals=signals,
            first_external=first,
            spans=wiring.spans,
            sources=sources,
            recorded=np.array(wiring.recorded, dtype=np.int64),
            coupling=coupling,
            step=step,
        )
        for name, instance in instances.items():
            instance.connect(wiring.reads[name], signals[wiring.spans[name]], [n for n, _ in wiring.inputs[name]])
        self._first = PythonStepper(instances, self._bus)
        self.stepper: Stepper = stepper(instances, self._bus) if stepper else self._first

    def initialise(self, stop_time: float) -> None:
        """Initialisation mode of every instance; values pass through them as often as the longest chain needs."""
        for instance in self._instances.values():
            instance.call("setupExperiment", None, 0.0, stop_time)
            instance.call("enterInitializationMode")
        self._bus.signals[self._bus.first_external :] = self._external(0, 1)[0]
        for _ in self._instances:
            for name in self._instances:
                self._first.exchange(name)
                self._instances[name].read()
        for instance in self._instances.values():
            instance.call("exitInitializationMode")
        for instance in self._instances.values():
            instance.read()

    def run(self, steps: int, progress: Callable[[int], None] = lambda done: None, decimate: int = 1) -> Recording:
        """Steps from 0 to steps * step and records; a unit's failure or Ctrl-C ends the run, rows so far are kept.

        Every `decimate`-th step is recorded, and the last one. Ctrl-C, or a KeyboardInterrupt of `progress`, is looked
        at after each block of steps, so that it meets no unit at work; a second Ctrl-C is raised at once.
        """
        bus, stepper = self._bus, self.stepper
        rows = np.empty((-(-steps // decimate) + 1, len(bus.recorded)))
        recording = Recording(
            time=np.zeros(1), columns=self._wiring.columns, values=rows, wall_seconds=0.0, decimate=decimate
        )
        np.take(bus.signals, bus.recorded, out=rows[0])
        frames = FrameRecorder(self._wiring.frames, self._instances, steps, self._step)
        k, shown = 0, 0
        begin = clock.perf_counter()
        with deferred_interrupt() as interrupted:
            try:
                while k < steps and not interrupted():
                    if k == frames.due:
                        self._drive(k)
                        frames.take(bus.signals)
                    count = min(BLOCK, steps - k, frames.due - k if frames.due > k else BLOCK)
                    k += stepper.advance(k, self._external(k, count), decimate, rows)
                    if k - shown >= BLOCK or k == steps:
                        try:
                            progress(shown := k)
                        except KeyboardInterrupt:
                            break
                self._drive(k)
                np.take(bus.signals, bus.recorded, out=rows[-(-k // decimate)])
                if k == frames.due:
                    frames.take(bus.signals)
                recording.interrupted = k < steps
            except UnitFailure as failure:
                recording.failure, k = failure, stepper.done
        recording.wall_seconds = clock.perf_counter() - begin
        recording.steps, recording.frames = k, frames.taken()
        recording.lateness = None if stepper.lateness is None else stepper.lateness[:k]
        count = -(-k // decimate) + 1
        recording.time = np.minimum(np.arange(count) * decimate, k) * self._step
        recording.values = rows[:count]
        return recording

    def _drive(self, number: int) -> None:
        """External signals of one step into the array."""
        self._bus.signals[self._bus.first_external :] = self._external(number, 1)[0]

    def _external(self, first: int, count: int) -> Array:
        """External signals of steps first ... first + count - 1, (count, all external elements)."""
        time = np.arange(first, first + count, dtype=np.float64) * self._step
        offset = self._bus.first_external
        rows = np.empty((count, self._wiring.size - offset))
        for span, signal in self._wiring.external:
            part = rows[:, span.start - offset : span.stop - offset]
            part[:] = signal if isinstance(signal, float) else signal.sample(time)
        return rows
