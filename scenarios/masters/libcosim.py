"""libcosim of the Open Simulation Platform by libcosimpy: reads an SSP or OspSystemStructure.xml itself."""

import time
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.importing.package import is_package
from flexbeams.scenarios.masters.tasks import private_folder
from flexbeams.scenarios.masters.trace import Fault, Master, Task, Trace, step_times

FAULTS = (
    Fault(
        name="no reason",
        description="The error for a package that cannot be loaded has no message.",
        remedy="The library's last message is read.",
    ),
    Fault(
        name="lost last sample",
        description="Samples of step 0 count as empty, so that a series read from the start lacks its last sample.",
        remedy="The first sample is read separately.",
    ),
    Fault(
        name="keeps only 10000 samples",
        description="A series without a given length keeps the last 10000 samples.",
        remedy="The length is given.",
    ),
    Fault(
        name="complaint about time",
        description="Its FMI library logs `Start attribute is required` for the independent variable.",
        remedy="Messages below the level fatal are suppressed.",
    ),
    Fault(
        name="threads",
        description="Units are stepped on threads, which costs several times the units' own work.",
        remedy="Its process is pinned to one core.",
    ),
)


class CosimError(FlexbeamsError):
    """libcosim refused a package."""


def simulate(task: Task) -> Trace:
    """Runs an SSP or an OspSystemStructure.xml."""
    from libcosimpy._internal import get_last_error_message
    from libcosimpy.CosimEnums import CosimVariableType
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.FATAL)
    begin = time.perf_counter()
    with private_folder():
        try:
            if is_package(task.file.name):
                execution = CosimExecution.from_ssp_file(str(task.file), step_size=round(1e9 * task.step))
            else:
                execution = CosimExecution.from_osp_config_file(str(task.file))
        except AssertionError:
            raise CosimError(get_last_error_message()) from None
        slaves = {slave.name.decode(): slave.index for slave in execution.slave_infos()}
        references = {
            f"{name}.{v.name.decode()}": (index, v.reference)
            for name, index in slaves.items()
            for v in execution.slave_variables(index)
            if v.type == CosimVariableType.REAL.value
        }
        observer = CosimObserver.create_time_series(task.steps + 1)
        execution.add_observer(observer)
        for name in task.signals:
            observer.start_time_series(*references[name], CosimVariableType.REAL)
        loaded = time.perf_counter()
        stepped = execution.step(task.steps)
        done = time.perf_counter()
        if not stepped:
            raise CosimError(get_last_error_message())
        values = np.array([_samples(observer, *references[name], task.steps) for name in task.signals])
    return Trace(
        time=step_times(task.step, 0, task.steps + 1),
        columns=list(task.signals),
        values=values.reshape(-1, task.steps + 1).T,
        loading=loaded - begin,
        stepping=done - loaded,
    )


def _samples(observer: Any, slave: int, reference: int, steps: int) -> Array:
    """A series from step 0 on with its last sample, (steps + 1,)."""
    parts = [
        observer.time_series_real_samples(slave, reference, first, count)[1:] for first, count in ((0, 2), (1, steps))
    ]
    numbers, values = (np.concatenate(both) for both in zip(*parts, strict=True))
    assert np.array_equal(numbers, np.arange(steps + 1))
    return values


MASTER = Master(
    name="libcosim",
    distribution="libcosimpy",
    module="libcosimpy",
    coupling="jacobi",
    delayed_start=False,
    faults=FAULTS,
    simulate=simulate,
)
