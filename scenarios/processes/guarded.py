"""Calls into code of unknown origin in a process of their own: a crash, an exit or a hang is an error in one line."""

import multiprocessing
import signal
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.processes.workers import leave_signals_to_parent

PATIENCE = 60.0  # s without a sign of life
T = TypeVar("T")


class GuardedFailure(FlexbeamsError):
    """The called code ended its process, or did not return."""


def guarded(function: Callable[..., T], *arguments: Any, patience: float = PATIENCE) -> T:
    """The result of a module's function in a new process; its exceptions are raised here.

    Raises GuardedFailure where the process ends or takes longer than `patience` s.
    """
    context = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    with ProcessPoolExecutor(1, context, leave_signals_to_parent) as pool:
        future = pool.submit(function, *arguments)
        processes = [p for p in multiprocessing.active_children() if p not in before]
        try:
            return future.result(timeout=patience)
        except BrokenProcessPool:
            raise GuardedFailure(f"the code of a unit {end_of(processes)}") from None
        except TimeoutError:
            for process in processes:
                process.kill()
            raise GuardedFailure(f"the code of a unit did not return within {patience:g} s") from None
        except KeyboardInterrupt:
            for process in processes:
                process.kill()
            raise


def end_of(processes: list[BaseProcess]) -> str:
    """How the first of these processes ended."""
    for process in processes:
        process.join(1.0)
        code = process.exitcode
        if code is not None and code >= 0:
            return f"ended its process with the exit status {code}"
        if code is not None:
            return f"crashed ({signal.Signals(-code).name})"
    return "ended its process"
