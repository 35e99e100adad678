"""The clock of an instance: the time since its start, counted in steps, as in fmus/native/fmi/clock.h."""

from __future__ import annotations

import math
import sys

import numpy as np
from numpy.typing import NDArray

LONGEST_STEP = 1e6  # sample times; a longer step would keep a sampled unit busy for seconds
MOST_STEPS = 2.0**53  # beyond, a count stands still


def clock_resolution(time: float) -> float:
    """What two times of a host near `time` (s) must differ by to be two, s."""
    return 2 * sys.float_info.epsilon * abs(time)


class Clock:
    """What a step does depends on the time since the start and the step alone, not on the rounding of the host's times.

    `fields` (7,) is what a saved state holds: start and stop (s), end of the last step as the host counts it, time
    since the start when steps of the present size began with what its rounding lost, that size, and the steps since.
    """

    def __init__(self) -> None:
        self.fields: NDArray[np.float64] = np.zeros(7)
        self.begin(0.0, math.inf)

    def begin(self, start: float, stop: float) -> None:
        """Set the times of the experiment (s)."""
        self.fields[:] = (start, min(stop, sys.float_info.max), start, 0.0, 0.0, 0.0, 0.0)

    @property
    def start(self) -> float:
        """Start time, s."""
        return float(self.fields[0])

    @property
    def elapsed(self) -> float:
        """Time since the start, s."""
        _, _, _, base, lost, step, count = self.fields.tolist()
        return float(base + (lost + count * step))

    def refusal(self, time: float, step: float, sample_time: float) -> str | None:
        """Why a step from the host's `time` (s) cannot be done; None where it can."""
        start, stop, last = self.fields[:3].tolist()
        resolution = clock_resolution(last)
        if not 0.0 < step < math.inf:
            return f"communicationStepSize must be finite and > 0, got {step!r}"
        if step > LONGEST_STEP * sample_time:
            return f"communicationStepSize must be <= {LONGEST_STEP * sample_time!r}, got {step!r}"
        if not step > resolution:
            known = f"the resolution of the clock at {last!r} s"
            return f"communicationStepSize must be > {resolution!r}, {known}, got {step!r}"
        if not abs(time - last) <= 1e-6 * step + resolution:
            return f"currentCommunicationPoint must be {last!r}, the end of the last step, got {time!r}"
        if min(start + self.elapsed, last) + step > stop + 1e-3 * step + resolution:
            return f"communicationStepSize must end by stopTime {stop!r}, got {step!r} from {time!r} on"
        return None

    def advance(self, time: float, step: float) -> None:
        """A step from the host's `time` (s) is done."""
        fields = self.fields
        if step != fields[5]:
            _, _, _, base, lost, size, count = fields.tolist()
            added = lost + count * size
            total = base + added
            fields[3:7] = (total, added - (total - base), step, 0.0)
        fields[6] += 1.0
        fields[2] = time + step

    def is_valid(self) -> bool:
        """Whether a clock can have these values."""
        start, stop, time, base, lost, step, count = self.fields.tolist()
        finite = all(map(math.isfinite, (start, time, base, lost, step, count)))
        counted = finite and 0 <= count < MOST_STEPS and count == math.floor(count)
        return counted and stop > start and step >= 0 and base >= 0 and 0 <= self.elapsed < math.inf

    def tolerance(self, time: float, tick: float) -> float:
        """How far a time (s since the start) may be from a multiple of `tick` (s) and mean it."""
        return min(1e-6 * tick + 2 * sys.float_info.epsilon * (abs(self.start) + time), tick / 4)
