"""Recording of a run: chosen signals at every step, or at every n-th."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.dimensions import Conversion
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.frames import Frames


@dataclass(kw_only=True)
class Recording:
    """Recorded signals: row k holds the values at time[k]; the last step is recorded whatever `decimate` is."""

    time: Array  # (rows,), s
    columns: list[str]  # <instance>.<variable>
    values: Array  # (rows, len(columns))
    wall_seconds: float  # of the stepping loop alone
    steps: int = 0  # done
    decimate: int = 1  # steps from row to row
    failure: UnitFailure | None = None
    interrupted: bool = False
    units: list[str] = field(default_factory=list)  # of measurement, by column, where a run is asked for them
    ended: str = ""  # which unit ended the run before its stop time, a regular end
    frames: Frames | None = None  # of the animation, if it was recorded
    lateness: Array | None = None  # s, of each step of a paced run against the wall clock

    @property
    def complete(self) -> bool:
        """Whether the run reached its stop time, or the time at which a unit ended it."""
        return self.failure is None and not self.interrupted


def step_times(numbers: NDArray[np.int64], step: float) -> Array:
    """numbers * step, s, rounded to the decimals of the step: 3 * 2e-4 is 0.0006, not 0.0006000000000000001."""
    per_step, scale = decimal_ticks(step)
    ticks = numbers * per_step
    if scale > 10**15 or np.max(np.abs(ticks), initial=0) > 2**53:
        return np.asarray(numbers * step, dtype=np.float64)
    exact: Array = ticks / scale
    return exact


def decimal_ticks(step: float) -> tuple[int, int]:
    """Whole numbers whose ratio is the step: 2 and 10000 for 2e-4."""
    decimals = -int(Decimal(repr(float(step))).as_tuple().exponent)
    scale = 10 ** max(decimals, 0)
    return round(step * scale), scale


class Rows:
    """Rows of a recording in the making, which steppers fill: row ceil(n / decimate) is of step n."""

    def __init__(self, signals: Array, recorded: NDArray[np.int64], steps: int, decimate: int) -> None:
        self._signals, self._recorded, self.decimate = signals, recorded, decimate
        self.values = np.empty((self.count(steps), len(recorded)))

    def count(self, done: int) -> int:
        """Number of rows after `done` steps."""
        return -(-done // self.decimate) + 1

    def take(self, done: int) -> None:
        """The signals as they are after `done` steps."""
        np.take(self._signals, self._recorded, out=self.values[self.count(done) - 1])

    def copy(self, done: int) -> "Rows":
        """Rows of their own, of the first `done` steps."""
        copied = Rows(self._signals, self._recorded, 0, self.decimate)
        copied.values = self.values[: self.count(done)].copy()
        return copied

    def recording(
        self,
        columns: Sequence[str],
        done: int,
        step: float,
        wall_seconds: float,
        converted: Mapping[int, Conversion] = MappingProxyType({}),
    ) -> Recording:
        """The recording of the first `done` steps of `step` s; `converted` are columns of inputs that take others."""
        count = self.count(done)
        for column, conversion in converted.items():
            self.values[:count, column] *= conversion.factor
            self.values[:count, column] += conversion.offset
        return Recording(
            time=step_times(np.minimum(np.arange(count) * self.decimate, done), step),
            columns=list(columns),
            values=self.values[:count],
            wall_seconds=wall_seconds,
            steps=done,
            decimate=self.decimate,
        )
