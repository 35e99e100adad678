"""Calls into code of unknown origin in a process of their own: a crash, an exit or a hang is an error in one line."""

import signal
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from time import sleep
from typing import Any, TypeVar

from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.processes.pools import ProcessPool

PATIENCE = 60.0  # s without a sign of life
T = TypeVar("T")


class GuardedFailure(FlexbeamsError):
    """The called code ended its process, or did not return."""


def guarded(function: Callable[..., T], *arguments: Any, patience: float = PATIENCE) -> T:
    """The result of a module's function in a new process; its exceptions are raised here.

    Raises GuardedFailure where the process ends or takes longer than `patience` s. Ctrl-C ends it.
    """
    with ProcessPool(1) as pool:
        future = pool.submit(function, *arguments)
        processes = pool.processes
        try:
            return future.result(timeout=patience)
        except BrokenProcessPool:
            raise GuardedFailure(f"the code of a unit {end_of(processes)}") from None
        except TimeoutError:
            pool.kill()
            raise GuardedFailure(f"the code of a unit did not return within {patience:g} s") from None


def end_of(processes: list[BaseProcess]) -> str:
    """How the first of these processes ended."""
    for process in processes:
        code = _exit_code(process)
        if code is not None and code >= 0:
            return f"ended its process with the exit status {code}"
        if code is not None:
            return f"crashed ({signal.Signals(-code).name})"
    return "ended its process"


def _exit_code(process: BaseProcess) -> int | None:
    """None where it still runs after a while. The pool's own thread may have just taken it from the system."""
    for _ in range(40):
        process.join(0.05)
        if process.exitcode is not None:
            break
        sleep(0.05)
    return process.exitcode
