"""Task and result of a master, its faults, and its deviation from the runner."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.choices import Coupling
from flexbeams.scenarios.simulation.recording import Recording


@dataclass(frozen=True, kw_only=True)
class Task:
    """A package and how to run it."""

    file: Path
    step: float  # s
    steps: int
    components: tuple[str, ...]
    signals: tuple[str, ...]  # Real outputs to record, <component>.<variable>
    compiler: str = "zig"  # of the loop of this project's runner


@dataclass(frozen=True, kw_only=True)
class Trace:
    """Result of a master."""

    time: Array  # (rows,), s; whole steps
    columns: list[str]  # <component>.<variable>
    values: Array  # (rows, columns), at these times
    loading: float | None  # s, up to the first step; None where the tool does not separate it from stepping
    stepping: float  # s, with loading where that is None


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault of a tool that affects results or the process, and its remedy here."""

    name: str
    description: str
    remedy: str  # "None" where there is none


@dataclass(frozen=True, kw_only=True)
class Master:
    """A tool that runs packages."""

    name: str
    distribution: str  # that pip installs
    module: str  # that it contains
    coupling: Coupling  # of the runner with the same results
    delayed_start: bool  # nothing is transferred before the first step: constants count from the second on
    faults: tuple[Fault, ...]
    simulate: Callable[[Task], Trace]
    leaked_bytes: int = 0  # for every package loaded


def step_times(step: float, first: int, count: int) -> Array:
    """Times of `count` steps from step `first` on, (count,); multiples of the step (s), not sums."""
    times: Array = step * np.arange(first, first + count, dtype=np.float64)
    return times


def deviation(trace: Trace, recording: Recording) -> float:
    """Largest difference of a recorded signal from the runner's, relative to the signal's largest value in the run.

    The result is infinite where a signal is zero throughout in the run but not in the trace.
    """
    step = recording.time[1] - recording.time[0]
    rows = np.rint(trace.time / step).astype(int)
    expected = recording.values[np.ix_(rows, [recording.columns.index(c) for c in trace.columns])]
    error, scale = (np.max(np.abs(a), axis=0) for a in (trace.values - expected, expected))
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.max(np.where(error == 0, 0.0, error / scale)))
