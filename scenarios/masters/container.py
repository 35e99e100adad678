"""FMUContainer of fmu-manipulation-toolbox: makes an FMU of the SSP whose C library steps all units, then exchanges."""

import logging
import shutil
import time
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.masters.tasks import private_folder
from flexbeams.scenarios.masters.trace import Fault, Master, Task, Trace, step_times
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.instance import UnitInstance

FAULTS = (
    Fault(
        name="no outputs",
        description="The container of an SSP exposes no output of its units.",
        remedy="The outputs to record are added before the container is made.",
    ),
    Fault(
        name="components renamed",
        description="Components are named after their files.",
        remedy="They are identified by their order, which is the package's.",
    ),
    Fault(
        name="duplicate names",
        description="A connection becomes a local variable whose name may also be that of a component.",
        remedy="Of two variables of one name the last is the output.",
    ),
    Fault(
        name="ignores parameter sets",
        description="Parameter sets and the step of the package are ignored.",
        remedy="Start values are built into the units; the step is passed.",
    ),
    Fault(
        name="extracts beside the package",
        description="The package is extracted beside itself, and its units are then looked up in the working folder.",
        remedy="It is copied to a folder that is removed.",
    ),
    Fault(
        name="no reason",
        description="The reason for a refused call is lost: messages arrive as an unfilled `%s`.",
        remedy="None; the refusal itself is reported.",
    ),
)


class ContainerError(FlexbeamsError):
    """A package cannot be converted to a container, or the container cannot be loaded."""


def simulate(task: Task) -> Trace:
    """Runs an SSP; recording costs one call a step."""
    from fmu_manipulation_toolbox import assembly  # noqa: F401  (not part of the loading)

    logging.getLogger("fmu_manipulation_toolbox").setLevel(logging.CRITICAL)  # it raises errors
    begin = time.perf_counter()
    with private_folder() as folder, _loaded(_container(task, folder), folder / "container") as unit:
        row = np.zeros(len(task.signals))
        unit.connect(list(task.signals), row, [])
        unit.call("setupExperiment", None, 0.0)
        unit.call("enterInitializationMode")
        unit.call("exitInitializationMode")
        values: Array = np.zeros((task.steps + 1 if task.signals else 1, len(task.signals)))
        loaded = time.perf_counter()
        unit.read()
        values[0] = row
        for k in range(task.steps):
            unit.step(k * task.step, task.step)
            if task.signals:
                unit.read()
                values[k + 1] = row
        done = time.perf_counter()
    return Trace(
        time=step_times(task.step, 0, len(values)),
        columns=list(task.signals),
        values=values,
        loading=loaded - begin,
        stepping=done - loaded,
    )


def _container(task: Task, folder: Path) -> Path:
    """The package as one FMU in `folder`, its outputs named as the signals."""
    from fmu_manipulation_toolbox.assembly import Assembly, AssemblyError
    from fmu_manipulation_toolbox.container import FMUContainerError
    from fmu_manipulation_toolbox.operations import FMUError

    shutil.copyfile(task.file, folder / "package.ssp")
    try:
        assembly = Assembly("package.ssp", fmu_directory=folder, default_step_size=task.step, default_mt=False)
        units = dict(zip(task.components, assembly.root.fmu_names_list, strict=True))
        for signal in task.signals:
            component, _, variable = signal.partition(".")
            assembly.root.add_output(units[component], variable, signal)
        assembly.make_fmu()
    except (AssemblyError, FMUContainerError, FMUError) as error:
        raise ContainerError(f"{task.file.name} cannot be converted to a container: {error.reason}") from None
    return folder / "package.fmu"


def _loaded(file: Path, folder: Path) -> UnitInstance:
    extract(str(file), str(folder))
    description = read_model_description(str(folder), validate=False)  # which refuses names that are there twice
    try:
        return UnitInstance("container", folder, description, lambda text: None)
    except UnitFailure:
        raise ContainerError("a unit of the container refused to be loaded or to instantiate") from None


MASTER = Master(
    name="FMUContainer",
    distribution="fmu-manipulation-toolbox",
    module="fmu_manipulation_toolbox",
    coupling="jacobi",
    delayed_start=False,
    faults=FAULTS,
    simulate=simulate,
)
