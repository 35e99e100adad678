"""PathSim with pathsim-fmi: gets the units and connections of an SSP; each unit's outputs are transferred at once."""

import gc
import time
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.importing.package import Package
from flexbeams.scenarios.masters.fmpy_library import FOLDER_WITHOUT_CPU, library_for_this_cpu
from flexbeams.scenarios.masters.tasks import FOLDERS_LEFT, NO_SSP, connections_by_pair, unpacked
from flexbeams.scenarios.masters.trace import Fault, Master, Task, Trace, step_times

FAULTS = (
    NO_SSP,
    Fault(
        name="Boolean outputs",
        description="Every output is read as Real, which units with Boolean or Integer outputs refuse.",
        remedy="Its map of outputs is reduced to the Real ones.",
    ),
    Fault(
        name="early labels",
        description="Units step at the beginning of a step of the simulation: a row holds the values one step later.",
        remedy="Times are shifted by one step.",
    ),
    FOLDERS_LEFT,
    FOLDER_WITHOUT_CPU,
    Fault(
        name="late release",
        description="Units are freed by the garbage collector only.",
        remedy="It is called after the run.",
    ),
)


def simulate(task: Task) -> Trace:
    """Runs the units and connections of an SSP."""
    import pathsim_fmi  # noqa: F401  (not part of the loading)

    begin = time.perf_counter()
    with unpacked(task.file) as package, library_for_this_cpu():
        simulation, scopes = _assembled(package, task)
        loaded = time.perf_counter()
        simulation.run((task.steps - 1) * task.step)
        done = time.perf_counter()
        values: Array = np.zeros((task.steps if scopes else 0, len(task.signals)))
        for places, scope in scopes:
            values[:, places] = scope.read()[1].T
        del simulation, scopes
        gc.collect()
    return Trace(
        time=step_times(task.step, 1, len(values)),
        columns=list(task.signals),
        values=values,
        loading=loaded - begin,
        stepping=done - loaded,
    )


def _assembled(package: Package, task: Task) -> tuple[Any, list[tuple[list[int], Any]]]:
    """The simulation, and for each recording block the indices of its signals."""
    from pathsim import Connection, Simulation
    from pathsim.blocks import Scope
    from pathsim_fmi import blocks as fmu_blocks

    original = fmu_blocks.FMUWrapper
    fmu_blocks.FMUWrapper = _wrapper_of_reals(original)
    try:
        blocks = {
            name: fmu_blocks.CoSimulationFMU(str(component.fmu), name, dt=task.step)
            for name, component in package.components.items()
        }
    finally:
        fmu_blocks.FMUWrapper = original
    connections = [
        Connection(blocks[start][[output for output, _ in wires]], blocks[end][[i for _, i in wires]])
        for (start, end), wires in connections_by_pair(package).items()
    ]
    scopes = []
    for name, block in blocks.items():
        places = [k for k, signal in enumerate(task.signals) if signal.startswith(f"{name}.")]
        if places:
            scopes.append((places, Scope()))
            connections.append(
                Connection(
                    block[[task.signals[k].partition(".")[2] for k in places]], scopes[-1][1][list(range(len(places)))]
                )
            )
    return Simulation([*blocks.values(), *(scope for _, scope in scopes)], connections, dt=task.step, log=False), scopes


def _wrapper_of_reals(wrapper: Any) -> Any:
    """pathsim-fmi's wrapper of a unit, restricted to Real inputs and outputs."""

    class RealWrapper(wrapper):  # type: ignore[misc]
        def _build_variable_maps(self) -> None:
            super()._build_variable_maps()
            for references in (self.input_refs, self.output_refs):
                for name in [n for n in references if self.variable_map[n].type != "Real"]:
                    del references[name]

    return RealWrapper


MASTER = Master(
    name="PathSim",
    distribution="pathsim-fmi",
    module="pathsim_fmi",
    coupling="gauss-seidel",
    delayed_start=False,
    faults=FAULTS,
    simulate=simulate,
)
