"""FMPy's simulate_ssp: reads the SSP itself, all units step and then exchange."""

import time
from typing import Any

import numpy as np

from flexbeams.scenarios.masters.tasks import private_folder
from flexbeams.scenarios.masters.trace import Fault, Master, Task, Trace, step_times

FAULTS = (
    Fault(
        name="early labels",
        what="A row holds the values after a step and is labelled with the time before it; "
        "there is no row of the start. Times are shifted by a step.",
    ),
    Fault(
        name="accumulated time",
        what="Steps are added up, and one more is made where the sum falls short of the "
        "stop time. It is told to stop half a step earlier; rows are counted.",
    ),
    Fault(
        name="late start",
        what="Connectors begin at 0 and pass on nothing before the first step: what is constant "
        "from the start on counts from the second step on. Nothing can be done about it.",
    ),
    Fault(
        name="deaf to the package",
        what="Parameter sets, stop time and step of the package are ignored. Start "
        "values are the units' own anyway; stop time and step are handed over.",
    ),
)


def simulate(task: Task) -> Trace:
    """Runs an SSP; always records every connector."""
    from fmpy.ssp.simulation import simulate_ssp

    begin = time.perf_counter()
    with private_folder():
        table = simulate_ssp(str(task.file), stop_time=(task.steps - 0.5) * task.step, step_size=task.step)
    return _corrected(table, task, time.perf_counter() - begin)


def _corrected(table: Any, task: Task, seconds: float) -> Trace:
    """The faults in labels and number of rows taken back."""
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
    late=True,
    faults=FAULTS,
    simulate=simulate,
)
