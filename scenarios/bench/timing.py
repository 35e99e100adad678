"""Timing of variants side by side in one process, as seconds, microseconds a step and ratios."""

import time as clock
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

Times = Mapping[str, tuple[float, float]]  # least seconds and median ratio to the bare loop, by variant


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Least time over the rounds, and the median over the rounds of the ratio to the bare loop."""

    seconds: float  # for all steps
    us_per_step: float
    ratio: float | None  # None where the bare loop has nothing to do


@dataclass(frozen=True, kw_only=True)
class Target:
    """A measured value and its upper limit."""

    name: str
    measured: float
    limit: float
    unit: str  # x (a ratio) or us

    @property
    def met(self) -> bool:
        """Within the limit."""
        return self.measured <= self.limit


def interleaved(variants: Mapping[str, Callable[[], float]], rounds: int) -> dict[str, tuple[float, float]]:
    """Least seconds of each variant and its median ratio to `bare`; each round runs all variants in turn."""
    times = np.array([[measure() for measure in variants.values()] for _ in range(rounds)])
    bare = times[:, list(variants).index("bare")]
    return {
        name: (float(column.min()), float(np.median(column / bare)))
        for name, column in zip(variants, times.T, strict=True)
    }


def timed(work: Callable[[], object]) -> float:
    """Seconds that a call takes."""
    begin = clock.perf_counter()
    work()
    return clock.perf_counter() - begin


def recursion_time(step: Callable[[int], None], steps: int) -> float:
    """Seconds of `steps` calls step(0), step(1), ... in Python."""
    begin = clock.perf_counter()
    for k in range(steps):
        step(k)
    return clock.perf_counter() - begin


def bare_and_fmi(times: Times, steps: int) -> dict[str, float]:
    """Microseconds a step of the bare loop and of the FMI functions, and their ratio."""
    return {
        "bare_us_per_step": 1e6 * times["bare"][0] / steps,
        "fmi_us_per_step": 1e6 * times["fmi"][0] / steps,
        "ratio": times["fmi"][1],
    }
