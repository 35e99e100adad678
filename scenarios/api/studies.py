"""Studies: many runs of a scenario."""

from collections.abc import Callable, Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.fmus.packaging.cache import cache_folder
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.arguments import require_choices, require_integer, require_number, require_table
from flexbeams.scenarios.definition.choices import BACKENDS, METHODS, Backend, Method
from flexbeams.scenarios.definition.schema import Value
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.study_file import load_study
from flexbeams.scenarios.processes.pools import Executor, usable_cores
from flexbeams.scenarios.runs.observer import ignore_note
from flexbeams.scenarios.runs.run_view import RunView
from flexbeams.scenarios.studies.dataset import Results, require_parquet
from flexbeams.scenarios.studies.execution import Progress
from flexbeams.scenarios.studies.pages import full_run, write_pages
from flexbeams.scenarios.studies.planning import plan_study
from flexbeams.scenarios.studies.sensitivity import Sensitivity, sensitivities
from flexbeams.scenarios.studies.study import Study, Workers, local_workers
from flexbeams.scenarios.studies.summary import study_summary, worst_first


@dataclass(frozen=True)
class StudyResults:
    """A study with its results; those of a run that is not done yet are missing until `resume`."""

    study: Study
    workers: Workers
    results: Results
    notify: Callable[[str], None] = ignore_note

    @property
    def folder(self) -> Path:
        """Folder of the data set."""
        return self.study.folder

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, columns of the table."""
        return tuple(axis.name for axis in self.study.plan.axes)

    @property
    def measures(self) -> tuple[str, ...]:
        """Names of the measures, columns of the table."""
        return tuple(check.name for check in self.study.plan.checks)

    @property
    def table(self) -> Any:
        """A row for each run: `run`, inputs, measures, `failure`; a pyarrow.Table, whose to_pandas() makes a frame."""
        import pyarrow

        results = self.results
        columns: dict[str, Any] = {"run": results.numbers}
        columns |= {name: results.inputs[:, k] for k, name in enumerate(self.inputs)}
        columns |= {name: results.measures[:, k] for k, name in enumerate(self.measures)}
        return pyarrow.table({**columns, "failure": results.failures})

    def __getitem__(self, name: str) -> Array:
        """Values (runs,) of an input or a measure, NaN where a run failed; InputError for another name."""
        if name in self.inputs:
            return self.results.inputs[:, self.inputs.index(name)].copy()
        return self.results.measures[:, self._column(name)].copy()

    @property
    def failed(self) -> dict[int, str]:
        """Reasons of failed runs by number."""
        pairs = zip(self.results.numbers.tolist(), self.results.failures, strict=True)
        return {number: reason for number, reason in pairs if reason}

    def worst(self, measure: str, count: int = 5) -> list[int]:
        """Numbers of the runs with the worst values: the largest, or the smallest where only a lower limit is set."""
        column = self._column(measure)
        complete = np.flatnonzero(self.results.complete)
        order = worst_first(self.study.plan.checks[column], self.results.measures[complete, column])
        return [int(self.results.numbers[k]) for k in complete[order[:count]]]

    def run(self, number: int) -> RunView:
        """The full run of a number, with the study's measures as checks; raises as `fb.run`."""
        return RunView.of(full_run(self.study.plan, number))

    def sensitivity(self, measure: str) -> Sensitivity:
        """Indices of all inputs or groups, with intervals.

        First-order and total ones of a Saltelli design, first-order ones by ranks of any other. Failed runs are
        excluded and counted.
        """
        return sensitivities(self.study.plan, self.results, [self._column(measure)])[0]

    def resume(self, progress: Progress = lambda done, total: None) -> "StudyResults":
        """Does the runs that are missing; the results with them."""
        self.study.run(self.workers, notify=self.notify, progress=progress)
        return StudyResults(self.study, self.workers, self.study.results(), self.notify)

    def summary(self) -> dict[str, Any]:
        """Figures, as `flexbeams study --json` prints them."""
        return study_summary(self.study.plan, self.results)

    def report(self) -> Path:
        """Writes study.html and the full runs of the worst samples; the page."""
        return write_pages(self.study.plan, self.results, self.summary(), self.folder, self.notify)

    def _column(self, measure: str) -> int:
        if measure not in self.measures:
            raise InputError("measure", "is not one of the study" + suggestion(measure, self.measures), measure)
        return self.measures.index(measure)

    def _repr_html_(self) -> str:
        from html import escape

        complete = self.results.complete
        medians = {name: np.median(self[name][complete]) if complete.any() else np.nan for name in self.measures}
        rows = "".join(f"<tr><th>{escape(name)}</th><td>{value:.4g}</td></tr>" for name, value in medians.items())
        done = f"{len(complete)} of {self.study.plan.samples.runs} runs, {len(self.failed)} failed"
        title = escape(self.study.plan.file.study.title)
        return f"<p>{title}: {done}</p><table><tr><th></th><th>median</th></tr>{rows}</table>"


def study(
    name: str | Path,
    *,
    runs: int | None = None,
    method: Method | None = None,
    seed: int | None = None,
    executor: Executor | None = None,
    workers: int | None = None,
    folder: str | Path | None = None,
    start: Mapping[str, Value] | None = None,
    stop_time: float | None = None,
    backend: Backend = "native",
    compiler: str = "zig",
    batch: bool = True,
    build_folder: str | Path | None = None,
    notify: Callable[[str], None] = ignore_note,
    progress: Progress = lambda done, total: None,
    part: tuple[int, int] = (1, 1),
) -> StudyResults:
    """Runs a scenario many times with other parameters; goes on where an earlier call with the same folder ended.

    Parameters
    ----------
    name
        A shipped study (see `flexbeams list`) or the path of a study file.
    runs, method, seed
        In place of the file's: number of runs, `lhs`, `sobol`, `saltelli` or `grid`, and seed. Equal seeds give equal
        results, whatever runs them.
    executor
        Anything with `submit`, such as a pool of concurrent.futures or `client.get_executor()` of Dask; by default
        processes of this machine.
    workers
        Processes, or workers of the executor: how many requests are under way. By default as many as there are cores.
    folder
        Of the data set; by default studies/<name>.
    start, stop_time, backend, compiler, build_folder
        In every run, as in `run`.
    batch
        Whether the batch kernel is used where only the plant varies.
    notify, progress
        Receive notes, one line each, and the runs done, of all.
    part
        (k, n): only part k of n, for job arrays that share the folder.

    Returns
    -------
    StudyResults
        The table of inputs and measures, worst and failed runs, sensitivities.

    Raises
    ------
    InputError
        For an unknown study, parameter or distribution, and for a folder that holds another study.
    FlexbeamsError
        Where runs cannot be done.

    Examples
    --------
    >>> import flexbeams as fb
    >>> study = fb.study("robustness", runs=8, workers=1)
    >>> study.failed, len(study.worst("error at the end", 3))
    ({}, 3)
    >>> bool(study["largest voltage"].max() < 1000)  # V
    True
    """
    require_parquet()
    require_choices(method=(method, METHODS), backend=(backend, BACKENDS))
    require_number("stop_time", stop_time)
    for key, value, least in (("runs", runs, 1), ("seed", seed, 0), ("workers", workers, 1)):
        require_integer(key, value, least)
    require_table("start", start)
    settings = Settings(
        backend=backend,
        compiler=compiler,
        overrides=dict(start or {}),
        stop_time=stop_time,
        build_folder=cache_folder(build_folder),
    )
    file = load_study(name)
    plan = plan_study(file, settings, runs=runs, method=method, seed=seed, batch=batch, notify=notify)
    planned = Study(plan=plan, folder=Path(folder) if folder is not None else Path("studies") / file.name)
    chosen = local_workers(workers)
    if executor is not None:
        own = executor
        chosen = Workers(count=workers or usable_cores(), open=lambda: nullcontext(own))
    planned.run(chosen, part=part, notify=notify, progress=progress)
    return StudyResults(planned, chosen, planned.results(), notify)
