"""sofirpy: gets the units and connections of an SSP; steps all units, then exchanges value by value."""

import logging
import time
from typing import Any

from flexbeams.scenarios.masters.fmpy_library import FOLDER_WITHOUT_CPU, library_for_this_cpu
from flexbeams.scenarios.masters.tasks import FOLDERS_LEFT, NO_SSP, connections_by_pair, unpacked
from flexbeams.scenarios.masters.trace import Fault, Master, Task, Trace, step_times

FAULTS = (
    NO_SSP,
    Fault(
        name="late start",
        description="Nothing is transferred before the first step: constants count from the second step on.",
        remedy="None.",
    ),
    Fault(
        name="lost row",
        description="The number of rows is rounded down, which ends some runs with an IndexError in the last step.",
        remedy="The stop time passed is half a step later.",
    ),
    FOLDERS_LEFT,
    FOLDER_WITHOUT_CPU,
    Fault(
        name="root logger",
        description="It replaces the handlers and the level of the root logger.",
        remedy="Both are restored.",
    ),
)


def simulate(task: Task) -> Trace:
    """Runs the units and connections of an SSP."""
    import sofirpy

    begin, root = time.perf_counter(), logging.getLogger()
    handlers, level = root.handlers[:], root.level
    with unpacked(task.file) as package, library_for_this_cpu():
        connections: dict[str, list[Any]] = {}
        for (start, end), wires in connections_by_pair(package).items():
            connections.setdefault(end, []).extend(
                {"parameter_name": target, "connect_to_system": start, "connect_to_external_parameter": output}
                for output, target in wires
            )
        recorded: dict[str, list[str]] = {}
        for name in task.signals:
            component, _, variable = name.partition(".")
            recorded.setdefault(component, []).append(variable)
        try:
            table = sofirpy.simulate(
                (task.steps + 0.5) * task.step,
                task.step,
                fmu_paths={name: c.fmu for name, c in package.components.items()},
                connections_config=connections,
                parameters_to_log=recorded,
            )
        finally:
            root.handlers[:] = handlers
            root.setLevel(level)
    assert len(table) == task.steps + 1
    return Trace(
        time=step_times(task.step, 0, task.steps + 1),
        columns=list(task.signals),
        values=table[list(task.signals)].to_numpy(),
        loading=None,
        stepping=time.perf_counter() - begin,
    )


MASTER = Master(
    name="sofirpy",
    distribution="sofirpy",
    module="sofirpy",
    coupling="jacobi",
    delayed_start=True,
    faults=FAULTS,
    simulate=simulate,
)
