"""Several scenarios in processes side by side, with one display and one verdict."""

import multiprocessing
import os
import queue
import signal
import time as clock
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event

from flexbeams.controller.design import Design
from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.definition.schema import find_scenario
from flexbeams.scenarios.importing.package import is_package
from flexbeams.scenarios.processes.interrupt import deferred_interrupt, ignore_interrupts_in_children
from flexbeams.scenarios.runs.job import CHECK_FAILED, FAILED, INTERRUPTED, OK, Job, JobResult, run_job
from flexbeams.scenarios.runs.progress import Display
from flexbeams.scenarios.runs.scenario import prepare, unit_files
from flexbeams.scenarios.simulation.stepping import stepper_library

INTERVAL = 0.1  # s between two messages of a scenario's progress

Message = tuple[int, str, object]  # number of the job; begin, note, progress or end; its content


def usable_cores() -> int:
    """Cores that this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def prepare_all(jobs: Sequence[Job], display: Display) -> list[Design]:
    """The designs of all jobs, each once; units and stepping loop built, so that no two processes do the same work."""
    designs: list[Design] = []
    for job in jobs:
        name: str | None = None if is_package(job.scenario) else job.scenario
        while name is not None:
            path = find_scenario(name)
            scenario, design = prepare(path, job.settings, designs)
            if not any(design is d for d in designs):
                designs.append(design)
            unit_files(path, scenario, design, job.settings, partial(display.note, name=job.name))
            if job.settings.backend == "native" and any(i.unit for i in scenario.instance.values()):
                stepper_library(job.settings.build_folder, job.settings.compiler)
            name = scenario.open_loop
    return designs


def run_parallel(jobs: Sequence[Job], workers: int, display: Display) -> list[JobResult]:
    """Runs the jobs, `workers` at a time, and returns their ends in the order of the jobs.

    Input that no job can run with raises FlexbeamsError before any of them starts; later failures of one leave
    the others alone. Ctrl-C ends all at their next block of steps, a second one at once.
    """
    designs = prepare_all(jobs, display)
    context = multiprocessing.get_context("spawn")
    messages: Queue[Message] = context.Queue()
    stop = context.Event()
    with ProcessPoolExecutor(workers, context, _enter, (messages, stop)) as pool:
        with ignore_interrupts_in_children(), _one_thread_each():
            futures = [pool.submit(_work, number, job, designs) for number, job in enumerate(jobs)]
        following = _Following(jobs, futures, messages, display)
        with deferred_interrupt() as interrupted:  # an exception in the middle of a message would garble the next ones
            while not following.done and not interrupted():
                following.follow()
            if not following.done:
                display.note("interrupted, ending all runs (once more: at once)")
                stop.set()
                for future in futures:
                    future.cancel()
                try:
                    while not following.done:
                        following.follow()
                except KeyboardInterrupt:
                    for process in multiprocessing.active_children():
                        process.terminate()
                    wait(futures)
                    following.give_up()
    return following.finished


class _Following:
    """Passes on what the workers tell, until every future is over."""

    def __init__(
        self, jobs: Sequence[Job], futures: list[Future[JobResult]], messages: "Queue[Message]", display: Display
    ) -> None:
        self._jobs, self._futures, self._messages, self._display = jobs, futures, messages, display
        self._ended: set[int] = set()
        self._over: dict[int, JobResult] = {}

    @property
    def finished(self) -> list[JobResult]:
        """The ends of the jobs, in their order."""
        return [self._over[number] for number in range(len(self._jobs))]

    @property
    def done(self) -> bool:
        """All are over, and all that they told is shown."""
        return len(self._over) == len(self._futures)

    def follow(self) -> None:
        """Takes one message, or waits a moment for one."""
        self._take(timeout=0.1)
        for number, future in enumerate(self._futures):
            lost = future.cancelled() or (future.done() and future.exception() is not None)
            if number not in self._over and (lost or (future.done() and number in self._ended)):
                self._end(number, self._result(future, number))

    def give_up(self) -> None:
        """Takes the rest as ended without results; their messages may be broken off."""
        for number, job in enumerate(self._jobs):
            if number not in self._over:
                self._end(number, JobResult(name=job.name, status=INTERRUPTED, message="ended at once"))

    def _end(self, number: int, finished: JobResult) -> None:
        self._over[number] = finished
        self._display.end(finished.name, outline(finished))

    def _result(self, future: Future[JobResult], number: int) -> JobResult:
        name = self._jobs[number].name
        if future.cancelled():
            return JobResult(name=name, status=INTERRUPTED, message="not run")
        try:
            return future.result()
        except BrokenProcessPool:
            return JobResult(name=name, status=FAILED, message="its process, or one beside it, was ended from outside")

    def _take(self, timeout: float) -> None:
        try:
            number, kind, content = self._messages.get(timeout=timeout)
        except queue.Empty:
            return
        name = self._jobs[number].name
        if kind == "begin":
            self._display.begin(name)
        elif kind == "note":
            self._display.note(str(content), name)
        elif kind == "progress":
            assert isinstance(content, tuple)
            self._display.progress(name, *content)
        else:
            self._ended.add(number)


def outline(finished: JobResult) -> str:
    """A job's end in a few words."""
    if finished.status not in (OK, CHECK_FAILED):
        return finished.message
    count = len(finished.outcomes)
    checks = "one check holds" if count == 1 else f"{count} checks hold" if count else "done"
    if finished.failed:
        checks = f"{finished.failed} of {count} checks failed"
    return f"{checks}, {finished.factor} times real time"


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes started inside compute with one thread: side by side, more would be in each other's way."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    added = [name for name in names if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


class _Link:
    """A worker's way to the process that started it; the one thing that a worker holds between jobs."""

    messages: "Queue[Message]"
    stop: Event


def _enter(messages: "Queue[Message]", stop: Event) -> None:
    """First in each worker. Ctrl-C reaches all processes of a terminal; only the first one acts on it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _Link.messages, _Link.stop = messages, stop


def _work(number: int, job: Job, designs: Sequence[Design]) -> JobResult:
    """A job in a worker; every error that a person can mend becomes part of the result."""
    told = 0.0

    def notify(text: str) -> None:
        _Link.messages.put((number, "note", text))

    def progress(done: int, steps: int) -> None:
        nonlocal told
        if _Link.stop.is_set():
            raise KeyboardInterrupt
        if done == steps or clock.monotonic() - told > INTERVAL:
            told = clock.monotonic()
            _Link.messages.put((number, "progress", (done, steps)))

    try:
        if _Link.stop.is_set():
            raise KeyboardInterrupt
        _Link.messages.put((number, "begin", None))
        return run_job(job, notify, progress, designs)
    except KeyboardInterrupt:
        return JobResult(name=job.name, status=INTERRUPTED, message="interrupted before it had results")
    except FlexbeamsError as error:
        return JobResult(name=job.name, status=FAILED, message=str(error))
    finally:
        _Link.messages.put((number, "end", None))
