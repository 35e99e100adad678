"""Stepping of connected instances in blocks of steps, and the loop in Python, for units of any kind."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.choices import Coupling
from flexbeams.scenarios.simulation.instance import UnitInstance


@dataclass(frozen=True, kw_only=True)
class SignalBus:
    """The array of all signals during a run: outputs by instance, external ones, held ones; and its use."""

    signals: Array  # (n,)
    external: slice  # signals that change from step to step
    spans: Mapping[str, slice]  # for each instance, its outputs
    sources: Mapping[str, NDArray[np.int64]]  # for each instance, the indices of its inputs' sources
    recorded: NDArray[np.int64]  # indices of a recorded row
    coupling: Coupling
    step: float  # s
    start_time: float = 0.0  # s, of step 0


Move = Callable[[int, int, int], int]


class Stepper(Protocol):
    """Advances all instances by blocks."""

    def advance(self, first: int, external: Array, every: int, rows: Array, first_row: int = 0) -> int:
        """Steps from number `first` on, a row of `external` (count, n_external) each; returns the steps done.

        Before each step the recorded signals are copied to row ceil(number / every) of the recording; `rows` begin
        with its row `first_row`. Raises UnitFailure, with the number of the failed step in `done`.
        """
        ...

    def bound(self, external: Array, every: int, rows: Array) -> Move:
        """`advance` for arrays that stay: a function of the first number, its row of `external`, and the count."""
        ...

    @property
    def done(self) -> int:
        """Number of the present or next step."""
        ...

    def begin(self, number: int) -> None:
        """Makes `number` the next step."""
        ...

    lateness: Array | None  # s, how late each step of a paced run began


class PythonStepper:
    """The loop in Python, through FMPy."""

    def __init__(self, instances: Mapping[str, UnitInstance], bus: SignalBus) -> None:
        self._instances, self._bus, self._done = instances, bus, 0
        self.lateness: Array | None = None

    def advance(self, first: int, external: Array, every: int, rows: Array, first_row: int = 0) -> int:
        """See Stepper.advance."""
        bus = self._bus
        move = self._jacobi if bus.coupling == "jacobi" else self._gauss_seidel
        driven = bus.signals[bus.external]
        self._done = first
        for row in external:
            driven[:] = row
            bus.signals.take(bus.recorded, out=rows[-(-self._done // every) - first_row], mode="clip")
            move(bus.start_time + self._done * bus.step)
            self._done += 1
        return len(external)

    @property
    def done(self) -> int:
        """See Stepper.done."""
        return self._done

    def begin(self, number: int) -> None:
        """See Stepper.begin."""
        self._done = number

    def bound(self, external: Array, every: int, rows: Array) -> Move:
        """See Stepper.bound."""
        return lambda first, row, count: self.advance(first, external[row : row + count], every, rows)

    def exchange(self, name: str, time: float) -> None:
        """Sets the inputs of an instance to the present values, of `time` s."""
        instance = self._instances[name]
        instance.time = time
        self._bus.signals.take(self._bus.sources[name], out=instance.inputs, mode="clip")
        instance.write()

    def _jacobi(self, time: float) -> None:
        """All units read the values of t_k, then all step."""
        for name in self._instances:
            self.exchange(name, time)
        for instance in self._instances.values():
            instance.step(time, self._bus.step)
        for instance in self._instances.values():
            instance.read()

    def _gauss_seidel(self, time: float) -> None:
        """Units step in their order and pass on new values at once."""
        for name, instance in self._instances.items():
            self.exchange(name, time)
            instance.step(time, self._bus.step)
            instance.read()
