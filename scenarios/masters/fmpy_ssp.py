"""FMPy's simulate_ssp: reads the SSP itself, steps all units, then exchanges."""

import time
from typing import Any

import numpy as np

from flexbeams.scenarios.masters.fmpy_library import FOLDER_WITHOUT_CPU, library_for_this_cpu
from flexbeams.scenarios.masters.tasks import private_folder
from flexbeams.scenarios.masters.trace import Fault, Master, Task, Trace, step_times

FAULTS = (
    Fault(
        name="early labels",
        description="A row holds the values after a step with the time before it; the start has no row.",
        remedy="Times are shifted by one step.",
    ),
    Fault(
        name="accumulated time",
        description="Steps are added up, and one more is made where the sum falls short of the stop time.",
        remedy="The stop time passed is half a step earlier; rows are counted.",
    ),
    Fault(
        name="late start",
        description="Nothing is transferred before the first step: constants count from the second step on.",
        remedy="None.",
    ),
    Fault(
        name="ignores parameter sets",
        description="Parameter sets, stop time and step of the package are ignored.",
        remedy="Start values are built into the units; stop time and step are passed.",
    ),
    FOLDER_WITHOUT_CPU,
)


def simulate(task: Task) -> Trace:
    """Runs an SSP; always records every connector."""
    from fmpy.ssp.simulation import simulate_ssp

    begin = time.perf_counter()
    with private_folder(), library_for_this_cpu():
        table = simulate_ssp(str(task.file), stop_time=(task.steps - 0.5) * task.step, step_size=task.step)
    return _corrected(table, task, time.perf_counter() - begin)


def _corrected(table: Any, task: Task, seconds: float) -> Trace:
    """The result with corrected times."""
    assert len(table) == task.steps
    return Trace(
        time=step_times(task.step, 1, task.steps),
        columns=list(task.signals),
        values=np.array([table[name] for name in task.signals]).reshape(-1, task.steps).T,
        loading=None,
        stepping=seconds,
    )


MASTER = Master(
    name="FMPy",
    distribution="fmpy",
    module="fmpy.ssp.simulation",
    coupling="jacobi",
    delayed_start=True,
    faults=FAULTS,
    simulate=simulate,
)
