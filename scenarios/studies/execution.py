"""Runs the missing runs of a study through an executor, a few requests for each worker at a time."""

import queue
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.processes.interrupt import deferred_interrupt
from flexbeams.scenarios.processes.pools import Executor
from flexbeams.scenarios.studies.assignments import Work, works
from flexbeams.scenarios.studies.dataset import DataSet
from flexbeams.scenarios.studies.planning import StudyPlan
from flexbeams.scenarios.studies.tasks import Answer, answer

REQUEST_SECONDS = 1.0  # that a request takes, about
MOST_RUNS = 512  # of a request
QUEUED = 2  # requests for each worker
AGREEMENT = 1e-9  # of the batch kernel with the units, relative
ATTEMPTS = 2  # of a run whose process ends, before it counts as failed

Open = Callable[[], AbstractContextManager[Executor]]
Progress = Callable[[int, int], None]  # runs done, of all


class ExecutorLost(FlexbeamsError):
    """The executor cannot be reached any more."""


@dataclass(kw_only=True)
class _Pending:
    """A request under way."""

    work: Work
    numbers: NDArray[np.int64]
    attempts: int = 0
    missing: tuple[str, ...] = ()


@dataclass(kw_only=True)
class _Pace:
    """How many runs a request takes."""

    seconds: float = 0.0  # CPU time of a run, 0 before the first answer

    def runs(self, left: int, workers: int) -> int:
        """Runs of the next request: few at first, and few at the end so that all workers end together."""
        if self.seconds == 0.0:
            return min(2, left)
        fair = -(-left // (QUEUED * workers))
        return max(1, min(left, fair, MOST_RUNS, round(REQUEST_SECONDS / self.seconds)))

    def take(self, done: Answer) -> None:
        if len(done.numbers):
            self.seconds = max(done.seconds / len(done.numbers), 1e-5)


@dataclass(kw_only=True)
class StudyRun:
    """Runs what is missing in a data set; `finished` tells whether nothing is left."""

    plan: StudyPlan
    data: DataSet
    workers: int
    notify: Callable[[str], None]
    progress: Progress
    part: NDArray[np.bool_]  # runs that this process is to do
    _futures: dict[Future[Answer], _Pending] = field(default_factory=dict)
    _pace: _Pace = field(default_factory=_Pace)
    _retries: deque[_Pending] = field(default_factory=deque)

    def run(self, open_executor: Open) -> bool:
        """Whether all runs are done; False after Ctrl-C. Raises FlexbeamsError where the executor cannot work."""
        self._count()
        requests = self._requests()
        with deferred_interrupt() as interrupted:
            more = True
            while more:
                with open_executor() as executor:
                    try:
                        more = self._work(executor, requests, interrupted)
                        break
                    except BrokenProcessPool:
                        self._split()
                        self.notify("a worker ended; its runs are repeated one by one")
            return not more and not interrupted()

    def _requests(self) -> Iterator[_Pending]:
        """Requests one after the other; units are built when their controller's turn comes."""
        for work in works(self.plan, self.data.missing & self.part, self.notify):
            if work.failure:
                self._record(work.numbers, work.failure)
                continue
            first = 0
            while first < len(work.numbers):
                count = self._pace.runs(len(work.numbers) - first, self.workers)
                yield _Pending(work=work, numbers=work.numbers[first : first + count])
                first += count

    def _work(self, executor: Executor, requests: Iterator[_Pending], interrupted: Callable[[], bool]) -> bool:
        """Whether something is left to do, after an interrupt."""
        answered: queue.SimpleQueue[Future[Answer]] = queue.SimpleQueue()
        while True:
            limit = 1 if self._retries else QUEUED * self.workers  # runs that ended a worker run alone
            while len(self._futures) < limit and not interrupted():
                pending = self._retries.popleft() if self._retries else next(requests, None)
                if pending is None:
                    break
                self._submit(executor, pending, answered)
            if not self._futures:
                return bool(interrupted())
            try:
                future = answered.get(timeout=0.2)
            except queue.Empty:
                continue
            self._take(executor, future, answered)

    def _submit(self, executor: Executor, pending: _Pending, answered: "queue.SimpleQueue[Future[Answer]]") -> None:
        request = pending.work.request(self.plan, pending.numbers, pending.missing)
        try:
            future = executor.submit(answer, request)
        except BrokenProcessPool:
            self._retries.append(pending)
            raise
        self._futures[future] = pending
        future.add_done_callback(answered.put)

    def _take(self, executor: Executor, future: Future[Answer], answered: "queue.SimpleQueue[Future[Answer]]") -> None:
        pending = self._futures[future]
        try:
            done = future.result()
        except (BrokenProcessPool, FlexbeamsError):
            raise
        except BaseException as error:
            if type(error).__module__.startswith(("distributed", "concurrent", "asyncio")):
                reason = " ".join(str(error).split()) or type(error).__name__
                raise ExecutorLost(f"the cluster was lost ({reason}); the same command does what is missing") from None
            raise
        del self._futures[future]
        if done.missing:
            pending.missing = done.missing
            self._submit(executor, pending, answered)
            return
        self._require_agreement(done)
        self._pace.take(done)
        self.data.add(done)
        self._count()

    def _require_agreement(self, done: Answer) -> None:
        """FlexbeamsError where the batch kernel and the units disagree."""
        for number, gap in zip(done.numbers.tolist(), done.differences.tolist(), strict=False):
            if gap > AGREEMENT:
                text = f"run {number}: the batch kernel and the units differ by {gap:.3g}, more than {AGREEMENT:g}"
                raise FlexbeamsError(f"{text}; --no-batch runs all through the units")

    def _split(self) -> None:
        """Takes back what was under way when a worker ended: run by run, and a run that ends workers as failed."""
        running, waiting = list(self._futures.values()), list(self._retries)
        self._futures, self._retries = {}, deque()
        for request in running:
            alone = len(running) == 1 and len(request.numbers) == 1
            if alone and request.attempts + 1 >= ATTEMPTS:
                self._record(request.numbers, "the code of a unit ended its process")
                continue
            for number in request.numbers:
                single = np.array([number], dtype=np.int64)
                self._retries.append(_Pending(work=request.work, numbers=single, attempts=request.attempts + alone))
        self._retries.extend(waiting)

    def _record(self, numbers: NDArray[np.int64], failure: str) -> None:
        """Records runs that cannot be done."""
        plan = self.plan
        kept = None
        if plan.signals:
            kept = np.full((len(numbers), plan.prepared.steps // plan.every + 1, len(plan.signals)), np.nan)
        self.data.add(
            Answer(
                numbers=numbers,
                measures=np.full((len(numbers), len(plan.checks)), np.nan),
                failures=(failure,) * len(numbers),
                signals=kept,
            )
        )
        self._count()

    def _count(self) -> None:
        self.progress(int(np.count_nonzero(self.data.done & self.part)), int(np.count_nonzero(self.part)))


class Clock:
    """Rate and remaining time of a study, from the first answer on: builds and the start of workers do not count."""

    def __init__(self) -> None:
        self._begin, self._first, self._start = 0.0, -1, -1

    def text(self, done: int, total: int) -> str:
        """How far it is, in words."""
        if self._start < 0:
            self._start = done
        if self._first < 0 and done > self._start:
            self._begin, self._first = time.monotonic(), done
        new = done - self._first
        seconds = time.monotonic() - self._begin
        if self._first < 0 or new <= 0 or seconds <= 0:
            return f"{done} of {total} runs"
        rate = new / seconds
        left = f", {duration((total - done) / rate)} left" if done < total else ""
        return f"{done} of {total} runs, {rate:.3g} a second{left}"


def duration(seconds: float) -> str:
    """A duration in words."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = seconds / 60
    return f"{minutes:.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"
