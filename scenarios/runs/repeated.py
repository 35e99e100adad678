"""Runs of one scenario with other start values, in instances that are made once and reset in between."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.definition.declaration import InstanceDeclaration
from flexbeams.scenarios.definition.settings import StartValues
from flexbeams.scenarios.definition.signals import Signal
from flexbeams.scenarios.importing.archives import ExtractionBudget
from flexbeams.scenarios.runs.execution import chosen_stepper, loaded_instances
from flexbeams.scenarios.runs.observer import SILENT, Observer
from flexbeams.scenarios.runs.prepare import PreparedRun
from flexbeams.scenarios.simulation.cosimulation import CoSimulation
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.sensors import measure


def lean(prepared: PreparedRun) -> PreparedRun:
    """What stepping needs of a prepared run, to send to another process; descriptions are read from the units there."""
    return PreparedRun(
        source=prepared.source,
        scenario=replace(prepared.scenario, figure=[]),
        settings=replace(prepared.settings, kinds=()),
        step=prepared.step,
        steps=prepared.steps,
        declarations={name: InstanceDeclaration(kind=None, variables={}) for name in prepared.declarations},
        starts=prepared.starts,
        wiring=replace(prepared.wiring, external=[(span, _held(s, prepared)) for span, s in prepared.wiring.external]),
        start_time=prepared.start_time,
    )


@dataclass(frozen=True, kw_only=True)
class _HeldSamples:
    """The samples of a signal at every step; each is kept where it differs from the one before."""

    step: float  # s
    numbers: NDArray[np.int64]  # (changes,) of steps
    values: Array  # (changes, width)

    def __call__(self, time: Array) -> Array:
        number = np.rint(time / self.step).astype(np.int64)
        held: Array = self.values[np.searchsorted(self.numbers, number, side="right") - 1]
        return held


def _held(signal: Signal | float, prepared: PreparedRun) -> Signal | float:
    """The same samples from data instead of code, which cannot be sent to another process."""
    if isinstance(signal, float):
        return signal
    values = signal.sample(np.arange(prepared.steps + 1, dtype=np.float64) * prepared.step)
    changes = np.flatnonzero(np.r_[True, np.any(values[1:] != values[:-1], axis=1)])
    samples = _HeldSamples(step=prepared.step, numbers=changes.astype(np.int64), values=values[changes])
    return Signal(width=signal.width, sample=samples)


class RepeatedRun:
    """Instances of a prepared run; a context manager that frees them."""

    def __init__(
        self,
        prepared: PreparedRun,
        files: Mapping[str, Path],
        library: Path | None,
        observer: Observer = SILENT,
    ) -> None:
        """`files` are the units in the order of the scenario, `library` the stepping loop of native ones."""
        self._prepared, self._files, self._library, self._observer = prepared, files, library, observer
        self._stack: ExitStack | None = None
        self._fresh = False  # no run yet since the instances were made

    def run(self, starts: Mapping[str, StartValues]) -> Recording:
        """The recording of a run with these start values, by instance, over those of the prepared run.

        A unit that fails while it steps is the recording's `failure`. Raises FlexbeamsError where the units cannot be
        loaded, or do not start.
        """
        if self._stack is None:
            self._load()
        prepared = self._prepared
        try:
            if not self._fresh:
                for instance in self._instances.values():
                    instance.call("reset")
            self._fresh = False
            values = {name: {**own, **starts.get(name, {})} for name, own in prepared.starts.items()}
            self._simulation.initialise(values, prepared.scenario.stop_time)
            recording = self._simulation.run(prepared.steps, decimate=prepared.settings.decimate)
        except FlexbeamsError:
            self.close()
            raise
        if recording.failure is not None:
            self.close()  # nothing is known of the state of units that failed
        measure(recording, prepared.scenario.sensor, prepared.step * prepared.settings.decimate)
        return recording

    def _load(self) -> None:
        prepared, library = self._prepared, self._library
        with ExitStack() as stack:
            self._instances = loaded_instances(
                prepared, self._files, self._observer, stack, ExtractionBudget(), library
            )
            self._simulation = CoSimulation(
                self._instances,
                prepared.wiring,
                prepared.step,
                prepared.scenario.coupling,
                chosen_stepper(self._instances, prepared, library),
                prepared.start_time,
            )
            self._fresh, self._stack = True, stack.pop_all()

    def close(self) -> None:
        """Frees the instances; the next run makes new ones."""
        if self._stack is not None:
            stack, self._stack = self._stack, None
            stack.close()

    def __enter__(self) -> "RepeatedRun":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
