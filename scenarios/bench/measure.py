"""All measurements of `flexbeams bench`."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from flexbeams.fmus.units.motion_tables import SLOTS
from flexbeams.scenarios.bench.callers import caller_costs
from flexbeams.scenarios.bench.growth import BEAMS, measure_growth
from flexbeams.scenarios.bench.loop_costs import (
    REAL_TIME_LIMIT,
    closed_loop_costs,
    step_durations,
    superposed_costs,
    unit_costs,
)
from flexbeams.scenarios.bench.plant_forms import plant_form_costs
from flexbeams.scenarios.bench.timing import Target
from flexbeams.scenarios.bench.workbench import SCENARIO, Workbench

STEPS, ROUNDS = 30_000, 25
CALLER_ROUNDS = 9
FORM_ROUNDS = 9  # of the plant's forms, at most: a new length of the dense one takes as long as a thousand steps


def measure(
    bench: Workbench,
    rounds: int = ROUNDS,
    beams: Sequence[int] | None = None,
    progress: Callable[[int, int], None] = lambda done, parts: None,
) -> dict[str, Any]:
    """Everything, in JSON's types; `beams` chooses the structures of `growth`, `progress` gets parts done and in all.

    Keys: `scenario`, `design_id`, `steps`, `step_s`, `rounds`, `statistic`, `compiler`, `platform`; `loops`, a list of
    `name` and a Cost for `bare`, `fmi`, `runner` and `numpy`; `transitions` and `growth`, lists of costs by number of
    transitions in progress and of beams; `plant_forms`, costs of the plant in modal and in dense form; `real_time`,
    durations of single steps; `callers`, microseconds a step from Python; `targets`, a list of Target with `met`.
    """
    parts: list[Callable[[], Any]] = [
        partial(unit_costs, bench, rounds),
        partial(closed_loop_costs, bench, rounds),
        partial(superposed_costs, bench, rounds, 1),
        partial(superposed_costs, bench, rounds, SLOTS),
        partial(step_durations, bench),
        partial(plant_form_costs, bench, min(rounds, FORM_ROUNDS)),
        partial(caller_costs, bench, min(rounds, CALLER_ROUNDS)),
        *(partial(measure_growth, bench, rounds, count) for count in beams or BEAMS),
    ]
    results = []
    for done, part in enumerate(parts):
        progress(done, len(parts))
        results.append(part())
    units, closed_loop, one, several, real_time, plant_forms, callers, *growth = results
    loops, transitions = [*units, closed_loop], [one, several]
    return {
        "scenario": SCENARIO,
        "design_id": bench.design.design_id,
        "steps": bench.steps,
        "step_s": bench.step,
        "rounds": rounds,
        "statistic": "least seconds and median ratio over rounds",
        "compiler": bench.compiler,
        "platform": sys.platform,
        "loops": loops,
        "transitions": transitions,
        "real_time": real_time,
        "plant_forms": plant_forms,
        "callers": callers,
        "growth": growth,
        "targets": [{**asdict(t), "met": t.met} for t in _targets(loops, transitions, plant_forms, real_time, callers)],
    }


def _targets(
    loops: Sequence[dict[str, Any]],
    transitions: Sequence[dict[str, Any]],
    plant_forms: Sequence[dict[str, Any]],
    real_time: dict[str, Any],
    callers: dict[str, Any],
) -> list[Target]:
    by_name = {loop["name"]: loop for loop in loops}
    plant, closed = by_name["plant"], by_name["closed loop"]
    step, new_length = (form["modal_us"] for form in plant_forms[:2])
    return [
        Target(name="plant: FMI functions to bare", measured=plant["fmi"]["ratio"], limit=1.5, unit="x"),
        Target(name="plant: step of a new length to a usual one", measured=new_length / step, limit=3.0, unit="x"),
        Target(name="closed loop: FMI functions to bare", measured=closed["fmi"]["ratio"], limit=1.3, unit="x"),
        Target(name="closed loop: runner to bare", measured=closed["runner"]["ratio"], limit=1.5, unit="x"),
        *(
            Target(
                name=f"feedforward step, transitions: {t['transitions']}",
                measured=t["fmi_us_per_step"],
                limit=10.0,
                unit="us",
            )
            for t in transitions
        ),
        Target(
            name="closed-loop step, p99.99", measured=1e6 * real_time["p99.99"], limit=1e6 * REAL_TIME_LIMIT, unit="us"
        ),
        Target(name="simulation from Python, beyond the units", measured=callers["overhead"], limit=10.0, unit="us"),
    ]
