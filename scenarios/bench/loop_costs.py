"""Costs of each unit and of the closed loop: bare C, FMI functions, runner and numpy."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from flexbeams.controller.planner import PLANNING_TICKS
from flexbeams.plant.basis import Array
from flexbeams.scenarios.bench.bare_loops import BareLoops
from flexbeams.scenarios.bench.timing import Cost, Times, bare_and_fmi, interleaved, recursion_time, timed
from flexbeams.scenarios.bench.unit_loops import Starts
from flexbeams.scenarios.bench.workbench import Workbench

NUMPY_STEPS = 3_000  # of a unit's recursion in numpy, at most
REAL_TIME_LIMIT = 2e-4  # s, the sample time


@dataclass(frozen=True, kw_only=True)
class UnitCase:
    """A unit's inputs, and the same steps as a bare loop and in numpy."""

    instance: str
    inputs: Sequence[str]  # arrays
    rows: Array  # (steps, elements of the inputs)
    bare: BareLoops
    bare_steps: Callable[[], None]
    numpy_step: Callable[[int], None]
    starts: Starts | None = None


def unit_costs(bench: Workbench, rounds: int) -> list[dict[str, Any]]:
    """Each unit alone, driven by the inputs that it has in the closed loop."""
    signals = bench.closed_run()
    u, y_pm = _columns(signals, "controller.u["), _columns(signals, "plant.y_pm[")
    forces = np.zeros((bench.steps, len(bench.model.structure.beam)))
    plant_rows = np.ascontiguousarray(np.hstack([u[:-1], forces]))
    reference = np.hstack([_columns(signals, "feedforward.u_ff["), _columns(signals, "feedforward.x_ref["), y_pm])
    at_rest = _costs(bench, rounds, "feedforward, at rest", _feedforward(bench, moving=False))
    for variant in ("bare", "fmi", "runner", "numpy"):  # the bare loop has nothing to do
        at_rest[variant]["ratio"] = None
    return [
        _costs(bench, rounds, "plant", _plant(bench, plant_rows)),
        _costs(bench, rounds, "feedforward, moving", _feedforward(bench, moving=True)),
        at_rest,
        _costs(bench, rounds, "controller", _controller(bench, np.ascontiguousarray(reference[:-1]))),
    ]


def _columns(signals: dict[str, Array], prefix: str) -> Array:
    return np.column_stack([values for name, values in signals.items() if name.startswith(prefix)])


def _plant(bench: Workbench, rows: Array) -> UnitCase:
    """Under rows of voltages and forces."""
    bare, numpy = bench.bare(), bench.numpy()
    return UnitCase(
        instance="plant",
        inputs=("u", "force"),
        rows=rows,
        bare=bare,
        bare_steps=partial(bare.plant, rows),
        numpy_step=lambda k: numpy.plant_step(rows[k]),
    )


def _controller(bench: Workbench, rows: Array) -> UnitCase:
    """Under rows of u_ff, x_ref and y_pm."""
    bare, numpy = bench.bare(), bench.numpy()
    n_u, n = len(numpy.u), len(numpy.u) + len(numpy.x_est)
    return UnitCase(
        instance="controller",
        inputs=("u_ff", "x_ref", "y_pm"),
        rows=rows,
        bare=bare,
        bare_steps=partial(bare.controller, rows),
        numpy_step=lambda k: numpy.controller_step(rows[k, :n_u], rows[k, n_u:n], rows[k, n:]),
    )


def _feedforward(bench: Workbench, moving: bool) -> UnitCase:
    """One transition in progress all the time, or none."""
    rows = np.zeros((bench.steps, len(bench.target)))
    rows[1:] = bench.target if moving else 0.0
    starts = {"transition_time": 1.25 * bench.steps * bench.step, "preview": bench.preview}
    transitions = bench.transitions(rows, starts)
    bare, numpy = bench.bare(transitions), bench.numpy(transitions)
    return UnitCase(
        instance="feedforward",
        inputs=("y_target",),
        rows=rows,
        bare=bare,
        bare_steps=partial(bare.feedforward, 0, bench.steps),
        numpy_step=numpy.feedforward_step,
        starts=starts,
    )


def _costs(bench: Workbench, rounds: int, name: str, case: UnitCase) -> dict[str, Any]:
    fmi = bench.unit_loop(case.instance, case.inputs, case.rows, case.starts)
    runner = bench.unit_loop(case.instance, case.inputs, case.rows, case.starts, recorded=True)
    times = interleaved(
        {
            "bare": from_rest(case.bare, case.bare_steps),
            "fmi": partial(fmi.advance_from_start, case.rows),
            "runner": partial(runner.run_from_start, bench.steps),
        },
        rounds,
    )
    steps = min(bench.steps, NUMPY_STEPS)
    return _cost_row(name, times, recursion_time(case.numpy_step, steps) * bench.steps / steps, bench.steps)


def closed_loop_costs(bench: Workbench, rounds: int) -> dict[str, Any]:
    """The closed loop of the scenario."""
    transitions = bench.closed_transitions()
    bare, rows = bench.bare(transitions), bench.closed_rows(bench.targets())
    fmi, runner = bench.closed_loop(recorded=False), bench.closed_loop(recorded=True)
    times = interleaved(
        {
            "bare": from_rest(bare, partial(bare.closed, bench.steps)),
            "fmi": partial(fmi.advance_from_start, rows),
            "runner": partial(runner.run_from_start, bench.steps),
        },
        rounds,
    )
    numpy = recursion_time(bench.numpy(transitions).closed_step, bench.steps)
    return _cost_row("closed loop", times, numpy, bench.steps)


def _cost_row(name: str, times: Times, numpy: float, steps: int) -> dict[str, Any]:
    """`name`, and a Cost for each variant; `numpy` is in seconds."""
    variants = {**times, "numpy": (numpy, numpy / times["bare"][0])}
    return {"name": name} | {
        variant: asdict(Cost(seconds=seconds, us_per_step=1e6 * seconds / steps, ratio=ratio))
        for variant, (seconds, ratio) in variants.items()
    }


def from_rest(bare: BareLoops, work: Callable[[], None]) -> Callable[[], float]:
    """A measurement of `work` with the bare loops back at rest."""

    def measure() -> float:
        bare.reset()
        return timed(work)

    return measure


def superposed_costs(bench: Workbench, rounds: int, count: int) -> dict[str, Any]:
    """A step of the feedforward with `count` transitions in progress, measured from a step after the last one began."""
    lead = count * (PLANNING_TICKS + 1) + 1
    rows = np.zeros((bench.steps + lead, len(bench.target)))
    for k in range(count):
        rows[k * (PLANNING_TICKS + 1) + 1 :] = bench.target * (k + 1) / count
    starts = {"transition_time": 1.25 * len(rows) * bench.step, "preview": bench.preview}
    bare = bench.bare(bench.transitions(rows, starts))
    loop = bench.unit_loop("feedforward", ("y_target",), rows, starts)

    def fmi() -> float:
        loop.start()
        loop.advance(rows[:lead])
        return loop.advance(rows[lead:], lead)

    def arithmetic() -> float:
        bare.reset()
        bare.feedforward(0, lead)
        return timed(partial(bare.feedforward, lead, bench.steps))

    times = interleaved({"bare": arithmetic, "fmi": fmi}, rounds)
    return {"transitions": count, **bare_and_fmi(times, bench.steps)}


def step_durations(bench: Workbench) -> dict[str, Any]:
    """Durations of single steps of the closed loop through the FMI functions, s; it moves half of the time."""
    steps = max(10 * bench.steps // 3, 1)
    period = round(2.0 / bench.step)
    rows: Array = ((np.arange(steps) // period % 2)[:, None] * bench.target).astype(np.float64)
    loop = bench.closed_loop(recorded=False)
    loop.start()
    durations = loop.stepper.durations(0, bench.closed_rows(rows))
    median, p99, p9999 = np.quantile(durations, [0.5, 0.99, 0.9999])
    return {
        "steps": steps,
        "median": float(median),
        "p99": float(p99),
        "p99.99": float(p9999),
        "max": float(durations.max()),
        "limit": REAL_TIME_LIMIT,
        "over_limit": int(np.count_nonzero(durations > REAL_TIME_LIMIT)),
    }
