"""Ecos by ecospy: reads the SSP itself, steps the units on threads, then transfers the values."""

import ctypes
import time
from importlib.metadata import PackageNotFoundError, files
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.masters.tasks import private_folder
from flexbeams.scenarios.masters.trace import Fault, Master, Task, Trace, step_times

_TBB = "libtbb.so.12"
FAULTS = (
    Fault(
        name="missing library",
        description="On Linux it needs libtbb.so.12, which it does not include.",
        remedy="The library of the wheel `tbb` is loaded first where the system has none.",
    ),
    Fault(
        name="six decimals",
        description="Its CSV files hold six decimals, four digits of a deflection.",
        remedy="Values are read by get_real after every step.",
    ),
    Fault(
        name="accumulated time",
        description="Steps are added up, so that units get times with rounding errors.",
        remedy="Rows are counted.",
    ),
    Fault(
        name="does not report failed calls",
        description="A unit that refuses to be instantiated or stepped is not reported; its outputs stay as they are.",
        remedy="The time that each unit has reached is read at the end.",
    ),
    Fault(
        name="crash on loading",
        description="A unit whose library cannot be loaded ends the process.",
        remedy="It runs in a separate process.",
    ),
    Fault(
        name="folders left behind",
        description="The extracted package stays in the folder for temporary files.",
        remedy="That folder is replaced by one that is removed.",
    ),
    Fault(
        name="leaked descriptions",
        description="0.2 MB stay allocated for every package of this size that is loaded.",
        remedy="None; resetting a simulation allocates nothing.",
    ),
    Fault(
        name="threads",
        description="Units are stepped on threads, which costs as much as the units' own work.",
        remedy="Its process is pinned to one core.",
    ),
)


class EcosError(FlexbeamsError):
    """Ecos refused a package."""


def simulate(task: Task) -> Trace:
    """Runs an SSP; recording costs one call for each value and step."""
    _load_tbb()
    from ecospy import EcosSimulation
    from ecospy.lib import EcosLib

    EcosLib.set_log_level("warn")
    names = [name.replace(".", "::", 1) for name in task.signals]
    begin = time.perf_counter()
    with private_folder(), EcosSimulation(task.step, ssp_path=str(task.file)) as simulation:
        if not simulation.init():
            raise EcosError(EcosLib.get_last_error())
        values: Array = np.zeros((task.steps + 1 if names else 1, len(names)))
        loaded = time.perf_counter()
        if names:
            for k in range(task.steps + 1):
                if k:
                    simulation.step()
                values[k] = [simulation.get_real(name) for name in names]
        else:
            simulation.step(task.steps)
        done = time.perf_counter()
        for component in task.components:
            _require_end(component, _time(simulation, component), task)
        simulation.terminate()
    return Trace(
        time=step_times(task.step, 0, len(values)),
        columns=list(task.signals),
        values=values,
        loading=loaded - begin,
        stepping=done - loaded,
    )


def _time(simulation: Any, component: str) -> float:
    """The time that a unit has reached; the simulation's time where it has no variable for it."""
    try:
        return float(simulation.get_real(f"{component}::time"))
    except Exception:  # the only type that ecospy raises
        return float(simulation.get_time())


def _require_end(component: str, reached: float, task: Task) -> None:
    if abs(reached - task.steps * task.step) > 0.5 * task.step:
        raise EcosError(f"{component} refused a call at {reached:.6g} s")


def _load_tbb() -> None:
    """Loads the library that ecospy needs, from the wheel `tbb` where the system has none."""
    try:
        ctypes.CDLL(_TBB, ctypes.RTLD_GLOBAL)
    except OSError:
        try:
            found = [file.locate() for file in files("tbb") or () if file.name == _TBB]
        except PackageNotFoundError:
            found = []
        for path in found:
            ctypes.CDLL(str(path), ctypes.RTLD_GLOBAL)


MASTER = Master(
    name="Ecos",
    distribution="ecospy",
    module="ecospy",
    coupling="jacobi",
    delayed_start=False,
    faults=FAULTS,
    simulate=simulate,
    leaked_bytes=250_000,
)
