"""A study with its data set: runs what is missing, and answers questions about the results."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexbeams.scenarios.processes.cluster import cluster_executor, cluster_workers
from flexbeams.scenarios.processes.pools import Executor, ProcessPool, usable_cores
from flexbeams.scenarios.runs.observer import ignore_note, ignore_progress
from flexbeams.scenarios.studies.dataset import DataSet, Results
from flexbeams.scenarios.studies.execution import Open, Progress, StudyRun
from flexbeams.scenarios.studies.planning import StudyPlan


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Who does the runs."""

    count: int
    open: Open


def local_workers(jobs: int | None = None) -> Workers:
    """Processes of this machine, by default one for each core."""
    count = jobs or usable_cores()

    @contextmanager
    def opened() -> Iterator[Executor]:
        with ProcessPool(count) as pool:
            yield pool

    return Workers(count=count, open=opened)


def cluster(address: str) -> Workers:
    """The workers of a Dask cluster; InputError where it cannot be reached or has none."""
    return Workers(count=cluster_workers(address), open=lambda: cluster_executor(address))


@dataclass(frozen=True, kw_only=True)
class Study:
    """A planned study and the folder of its data set."""

    plan: StudyPlan
    folder: Path

    def run(
        self,
        workers: Workers,
        *,
        part: tuple[int, int] = (1, 1),
        notify: Callable[[str], None] = ignore_note,
        progress: Progress = ignore_progress,
    ) -> bool:
        """Does the runs that are missing, of part k of n; whether all are done, False after Ctrl-C.

        Raises FlexbeamsError where they cannot be done.
        """
        k, n = part
        own = np.arange(self.plan.samples.runs) % n == k - 1
        with DataSet(self.plan, self.folder, part) as data:
            work = StudyRun(
                plan=self.plan, data=data, workers=workers.count, notify=notify, progress=progress, part=own
            )
            return work.run(workers.open)

    def results(self) -> Results:
        """The runs that are done."""
        with DataSet(self.plan, self.folder, part=(0, 0)) as data:
            return data.results()
