"""Several jobs in parallel processes, with one display."""

import multiprocessing
import queue
import time as clock
from collections.abc import Sequence
from concurrent.futures import Future, wait
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from multiprocessing.process import BaseProcess
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event

from flexbeams.controller.design import Design
from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.processes.guarded import end_of
from flexbeams.scenarios.processes.interrupt import deferred_interrupt
from flexbeams.scenarios.processes.pools import ProcessPool
from flexbeams.scenarios.runs.job import CHECK_FAILED, FAILED, INTERRUPTED, OK, Job, JobResult, run_job
from flexbeams.scenarios.runs.observer import Observer
from flexbeams.scenarios.runs.package import ExtractedPackage, prepare_package
from flexbeams.scenarios.runs.prepare import PreparedScenario, prepare_scenario
from flexbeams.scenarios.runs.progress import Display
from flexbeams.scenarios.runs.scenario import unit_files
from flexbeams.scenarios.simulation.native_stepper import stepper_library

STARTING_TIME = 60.0  # s, for a worker's first message
WRITING_TIME = 600.0  # s, for results, figures and report
PROGRESS_INTERVAL = 0.1  # s between two messages of a job's progress

Message = tuple[int, str, object]  # number of the job; begin, note, progress, writing or end; its content


def prepare_all(jobs: Sequence[Job], display: Display) -> list[Design]:
    """Computes the designs of all jobs, and builds units and stepping loop, so that no two processes do the same work.

    A job that cannot run is left to its worker, which reports it; FlexbeamsError where none of them can run.
    """
    designs: list[Design] = []
    errors: list[FlexbeamsError] = []
    for job in jobs:
        prepared: PreparedScenario | None = None
        try:
            if isinstance(job.experiment, ExtractedPackage):
                prepare_package(job.experiment, job.settings)
            else:
                prepared = prepare_scenario(job.experiment, job.settings, designs=designs)
        except FlexbeamsError as error:
            errors.append(error)
        while prepared is not None:
            if not any(prepared.design is design for design in designs):
                designs.append(prepared.design)
            unit_files(prepared, partial(display.note, name=job.name))
            if job.settings.backend == "native" and prepared.models:
                stepper_library(job.settings.build_folder, job.settings.compiler)
            prepared = prepared.open_loop
    if len(errors) == len(jobs):
        raise errors[0]
    return designs


def run_parallel(jobs: Sequence[Job], workers: int, display: Display, patience: float | None = None) -> list[JobResult]:
    """Runs jobs, `workers` at a time; returns their results in the order of the jobs.

    A job that fails does not affect the others; FlexbeamsError, before any starts, where none of them can run. Ctrl-C
    ends all after their current block of steps, a second one at once. So do `patience` s without any message.
    """
    designs = prepare_all(jobs, display)
    context = multiprocessing.get_context("spawn")
    messages: Queue[Message] = context.Queue()
    stop = context.Event()
    with ProcessPool(workers, _init_worker, (messages, stop)) as pool:
        futures = [pool.submit(_run_job, number, job, designs) for number, job in enumerate(jobs)]
        monitor = _Monitor(jobs, futures, messages, display, pool.processes)
        with deferred_interrupt() as interrupted:  # an exception within a message would corrupt those that follow
            while not monitor.finished and not interrupted():
                monitor.poll()
                if patience is not None and monitor.silence() > patience:
                    monitor.kill(f"the code of a unit made no progress for {patience:g} s (see --patience)")
            if not monitor.finished:
                what = "the run" if len(jobs) == 1 else "all runs"
                display.note(f"interrupted, ending {what} (press Ctrl-C again to end at once)")
                stop.set()
                for future in futures:
                    future.cancel()
                try:
                    while not monitor.finished:
                        monitor.poll()
                except KeyboardInterrupt:
                    pool.kill()
                    wait(futures)
                    monitor.abandon()
    return monitor.results


class _Monitor:
    """Displays the messages of the workers, and collects their results."""

    def __init__(
        self,
        jobs: Sequence[Job],
        futures: list[Future[JobResult]],
        messages: "Queue[Message]",
        display: Display,
        processes: list[BaseProcess],
    ) -> None:
        self._processes, self._killed = processes, ""
        self._heard = clock.monotonic() + STARTING_TIME
        self._jobs, self._futures, self._messages, self._display = jobs, futures, messages, display
        self._ended: set[int] = set()  # jobs whose last message has arrived
        self._results: dict[int, JobResult] = {}

    @property
    def results(self) -> list[JobResult]:
        """The results in the order of the jobs."""
        return [self._results[number] for number in range(len(self._jobs))]

    @property
    def finished(self) -> bool:
        """Whether all jobs have ended and all their messages are displayed."""
        return len(self._results) == len(self._futures)

    def poll(self) -> None:
        """Takes one message, or waits a moment for one."""
        self._take(timeout=0.1)
        for number, future in enumerate(self._futures):
            lost = future.cancelled() or (future.done() and future.exception() is not None)
            if number not in self._results and (lost or (future.done() and number in self._ended)):
                self._end(number, self._result(future, number))

    def silence(self) -> float:
        """Seconds since the last message; negative while a worker starts, and for WRITING_TIME while one writes."""
        return clock.monotonic() - self._heard

    def kill(self, reason: str) -> None:
        """Ends all workers."""
        self._killed, self._heard = reason, clock.monotonic()
        for process in self._processes:
            process.kill()

    def abandon(self) -> None:
        """Ends the remaining jobs without results; their messages may be incomplete."""
        for number, job in enumerate(self._jobs):
            if number not in self._results:
                self._end(number, JobResult(name=job.name, status=INTERRUPTED, message="ended at once"))

    def _end(self, number: int, result: JobResult) -> None:
        self._results[number] = result
        self._display.end(result.name, one_line_result(result))

    def _result(self, future: Future[JobResult], number: int) -> JobResult:
        name = self._jobs[number].name
        if future.cancelled():
            return JobResult(name=name, status=INTERRUPTED, message="not run")
        try:
            return future.result()
        except BrokenProcessPool:
            message = "its process, or a parallel one, was killed"
            if len(self._jobs) == 1:
                message = self._killed or f"the code of a unit {end_of(self._processes)}"
            return JobResult(name=name, status=FAILED, message=message)

    def _take(self, timeout: float) -> None:
        try:
            number, kind, content = self._messages.get(timeout=timeout)
        except queue.Empty:
            return
        name = self._jobs[number].name
        self._heard = clock.monotonic() + (WRITING_TIME if kind == "writing" else 0.0)
        if kind == "begin":
            self._display.begin(name)
        elif kind == "note":
            self._display.note(str(content), name)
        elif kind == "progress":
            assert isinstance(content, tuple)
            self._display.progress(name, *content)
        elif kind == "end":
            self._ended.add(number)


def one_line_result(result: JobResult) -> str:
    """A job's result in a few words."""
    if result.status not in (OK, CHECK_FAILED):
        return result.message
    count = len(result.outcomes)
    checks = "one check holds" if count == 1 else f"{count} checks hold" if count else "done"
    if result.failed:
        checks = f"{result.failed} of {count} checks failed"
    return f"{checks}, {result.factor} times real time"


class _Parent:
    """Connection of a worker to the process that started it; the only state of a worker between jobs."""

    messages: "Queue[Message]"
    stop: Event


def _init_worker(messages: "Queue[Message]", stop: Event) -> None:
    """First call in each worker."""
    _Parent.messages, _Parent.stop = messages, stop


def _run_job(number: int, job: Job, designs: Sequence[Design]) -> JobResult:
    """Runs a job in a worker; an error that a user can fix becomes its result."""
    last_message = 0.0

    def notify(text: str) -> None:
        _Parent.messages.put((number, "note", text))

    def progress(done: int, steps: int) -> None:
        nonlocal last_message
        if _Parent.stop.is_set():
            raise KeyboardInterrupt
        if done == steps or clock.monotonic() - last_message > PROGRESS_INTERVAL:
            last_message = clock.monotonic()
            _Parent.messages.put((number, "progress", (done, steps)))

    def writing() -> None:
        _Parent.messages.put((number, "writing", None))

    try:
        if _Parent.stop.is_set():
            raise KeyboardInterrupt
        _Parent.messages.put((number, "begin", None))
        return run_job(job, Observer(notify=notify, progress=progress, writing=writing), designs)
    except KeyboardInterrupt:
        return JobResult(name=job.name, status=INTERRUPTED, message="interrupted before it had results")
    except FlexbeamsError as error:
        return JobResult(name=job.name, status=FAILED, message=str(error))
    finally:
        _Parent.messages.put((number, "end", None))
