"""What a sample of a study costs through the batch kernel and through the FMI units, beside the stepping loop of a run.

All three in turn in one process, in processor time of the thread. Set-up, measures and what Python adds count; the
first request of a worker, which loads the units, does not.
"""

import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np

from flexbeams.plant.errors import FlexbeamsError
from flexbeams.scenarios.bench.timing import interleaved
from flexbeams.scenarios.bench.workbench import Workbench
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.study_file import load_study
from flexbeams.scenarios.studies.assignments import Work, works
from flexbeams.scenarios.studies.planning import StudyPlan, plan_study
from flexbeams.scenarios.studies.tasks import Answer, answer

STUDY, RUNS, ROUNDS = "robustness", 256, 9
SAMPLES = {"units": 2, "batch": 32}  # of a measurement


class _Worker:
    """A thread that does runs of a study, with instances of its own."""

    def __init__(self, plan: StudyPlan, stack: ExitStack, notify: Callable[[str], None]) -> None:
        self._plan = plan
        self._work: Work = next(works(plan, np.ones(plan.samples.runs, dtype=bool), notify))
        self._thread = stack.enter_context(ThreadPoolExecutor(1))
        self._answer(1, tuple(self._work.contents))

    def seconds(self, runs: int) -> float:
        """Of each of some runs, on average."""
        return self._answer(runs).seconds / runs

    def _answer(self, runs: int, missing: tuple[str, ...] = ()) -> Answer:
        """Runs 1, 2, ..., none of which goes through batch kernel and units both, as run 0 does."""
        request = self._work.request(self._plan, np.arange(1, 1 + runs), missing)
        done = self._thread.submit(answer, request).result()
        if failed := [text for text in done.failures if text]:
            raise FlexbeamsError(failed[0])
        return done


def sample_costs(
    compiler: str,
    build_folder: Path,
    notify: Callable[[str], None],
    progress: Callable[[int, int], None] = lambda done, parts: None,
    rounds: int = ROUNDS,
) -> dict[str, Any]:
    """Seconds of a run's steps, and of a sample of the study, which takes as many.

    Keys: `study`, `steps`, `rounds`, `statistic`, `compiler`, `platform`, and for `run`, `units` and `batch` their
    `seconds` and `ratio`, to the run.
    """
    settings = Settings(compiler=compiler, build_folder=build_folder)
    progress(0, 2)
    plans = {name: plan_study(load_study(STUDY), settings, runs=RUNS, batch=name == "batch") for name in SAMPLES}
    steps = plans["batch"].prepared.steps
    with Workbench(steps, compiler, build_folder, notify) as bench, ExitStack() as stack:
        loop = bench.closed_loop(recorded=True)
        workers = {name: _Worker(plan, stack, notify) for name, plan in plans.items()}

        def run() -> float:
            loop.start()
            begin = thread_time()
            loop.run(steps)
            return thread_time() - begin

        progress(1, 2)
        variants = {name: partial(worker.seconds, SAMPLES[name]) for name, worker in workers.items()}
        times = interleaved({"bare": run, **variants}, rounds)
    return {
        "study": STUDY,
        "steps": steps,
        "rounds": rounds,
        "statistic": "least processor seconds and median ratio over rounds",
        "compiler": compiler,
        "platform": sys.platform,
        "run": {"seconds": times["bare"][0], "ratio": 1.0},
        **{name: {"seconds": times[name][0], "ratio": times[name][1]} for name in SAMPLES},
    }
