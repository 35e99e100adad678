"""Processes that work for this one, behind the interface of concurrent.futures: submit a function, get a future."""

import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from types import ModuleType, TracebackType
from typing import Any, Protocol, TypeVar

from flexbeams.scenarios.processes.interrupt import ignore_interrupts_in_children

ORPHANED = 130  # exit status of a process whose parent has ended
T = TypeVar("T")


class Executor(Protocol):
    """Whatever runs functions elsewhere: a ProcessPool, one of concurrent.futures, Dask's `client.get_executor()`."""

    def submit(self, function: Callable[..., T], /, *arguments: Any) -> "Future[T]":
        """Starts the call of a module's function; its result comes through the future."""
        ...


def usable_cores() -> int:
    """Cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


class ProcessPool:
    """A pool of new processes, each with one thread of linear algebra; a context manager that ends them.

    They ignore Ctrl-C and SIGTERM, which may reach all processes: only this one acts on them, and one that leaves the
    context ends them at once. They end with this process, even if it is killed. `initializer` is their first call.
    """

    def __init__(
        self, workers: int, initializer: Callable[..., None] | None = None, arguments: tuple[Any, ...] = ()
    ) -> None:
        before = set(multiprocessing.active_children())
        context = multiprocessing.get_context("spawn")
        if os.name == "posix":
            resource_tracker.ensure_running()  # it unblocks Ctrl-C, which must not happen while a process starts
        self._pool = ProcessPoolExecutor(workers, context, _initialise, (initializer, arguments))
        self._before = before

    def submit(self, function: Callable[..., T], /, *arguments: Any) -> "Future[T]":
        """As Executor.submit; starts a process where one is missing. BrokenProcessPool where one has died."""
        with ignore_interrupts_in_children(), _one_thread_each(), _without_main():
            return self._pool.submit(function, *arguments)

    @property
    def processes(self) -> list[BaseProcess]:
        """The processes that run."""
        return [p for p in multiprocessing.active_children() if p not in self._before]

    def kill(self) -> None:
        """Ends the processes at once."""
        for process in self.processes:
            process.kill()

    def __enter__(self) -> "ProcessPool":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            self.kill()
        self._pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Limits processes that start inside to one thread of linear algebra: parallel ones would slow each other down."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    added = [name for name in names if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


@contextmanager
def _without_main() -> Iterator[None]:
    """Processes that start inside do not import the script of this one, which may call what started them.

    All that they are to do is in modules.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def _initialise(initializer: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    """First call in each process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if initializer is not None:
        initializer(*arguments)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(ORPHANED)
