"""sofirpy: is told the units and connections of an SSP; all units step and then exchange, value by value."""

import logging
import time
from typing import Any

from flexbeams.scenarios.masters.tasks import FOLDERS_LEFT, NO_SSP, unpacked, wires_by_pair
from flexbeams.scenarios.masters.trace import Fault, Master, Task, Trace, step_times

FAULTS = (
    NO_SSP,
    Fault(
        name="late start",
        what="Nothing is passed on before the first step: what is constant from the start on "
        "counts from the second step on. Nothing can be done about it.",
    ),
    Fault(
        name="lost row",
        what="The number of rows is rounded down, which ends some runs with an IndexError in the "
        "last step. It is told to stop half a step later.",
    ),
    FOLDERS_LEFT,
    Fault(name="root logger", what="It replaces the handlers and the level of the root logger. Both are put back."),
)


def simulate(task: Task) -> Trace:
    """Runs the units and connections of an SSP."""
    import sofirpy

    begin, root = time.perf_counter(), logging.getLogger()
    handlers, level = root.handlers[:], root.level
    with unpacked(task.file) as package:
        connections: dict[str, list[Any]] = {}
        for (start, end), wires in wires_by_pair(package).items():
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
    late=True,
    faults=FAULTS,
    simulate=simulate,
)
