"""What a step costs a caller in Python: of a simulation with a law of one's own, and of the learning environment.

Processor time, since one round takes a second and other processes would count in it.
"""

import time as clock
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.bench.workbench import SCENARIO, Workbench
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.simulation import Simulation


def caller_costs(bench: Workbench, rounds: int) -> dict[str, float | None]:
    """Microseconds a step, the least of interleaved rounds.

    `units`: all steps in one call; `simulation`: a call for each, with voltages set and two arrays read; `overhead`:
    their difference. `environment`: a step of flexbeams/Tracking-v0, None without gymnasium.
    """
    settings = Settings(compiler=bench.compiler, build_folder=bench.build_folder, stop_time=bench.steps * bench.step)
    with Simulation(load_scenario(SCENARIO), settings, without=["controller"]) as sim:
        reference = np.zeros(len(sim.view("plant.u")))

        def law(y_pm: object, x_ref: object) -> Array:
            return reference

        def single() -> None:
            for _ in range(bench.steps):
                sim["plant.u"] = law(sim["plant.y_pm"], sim["feedforward.x_ref"])
                sim.step()

        def from_start(work: Callable[[], None]) -> float:
            sim.reset()
            return timed(work)

        times = [(from_start(lambda: sim.step(bench.steps)), from_start(single)) for _ in range(rounds)]
    units, one_by_one = (1e6 * float(least) / bench.steps for least in np.min(times, axis=0))
    return {
        "units": units,
        "simulation": one_by_one,
        "overhead": one_by_one - units,
        "environment": _environment_cost(bench, rounds) if find_spec("gymnasium") else None,
    }


def timed(work: Callable[[], None]) -> float:
    """Processor time of a call, s."""
    begin = clock.process_time()
    work()
    return clock.process_time() - begin


def _environment_cost(bench: Workbench, rounds: int) -> float:
    from flexbeams.scenarios.learning.tracking import TrackingEnvironment

    environment: Any = TrackingEnvironment(SCENARIO, episode_time=bench.steps * bench.step)
    action = np.zeros(environment.action_space.shape, np.float32)

    def episode() -> float:
        environment.reset(seed=1)

        def steps() -> None:
            for _ in range(bench.steps):
                environment.step(action)

        return timed(steps)

    seconds = min(episode() for _ in range(rounds))
    environment.close()
    return 1e6 * seconds / bench.steps
