"""Jobs: a scenario or package to run, where its results go, and the result as the command line reports it."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from flexbeams.controller.design import Design
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import Format
from flexbeams.scenarios.definition.scenario_file import ScenarioFile, load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.variants import changed_settings
from flexbeams.scenarios.importing.package import is_package
from flexbeams.scenarios.processes.interrupt import deferred_interrupt
from flexbeams.scenarios.results.checks import Outcome
from flexbeams.scenarios.results.files import json_values
from flexbeams.scenarios.results.folder import ResultFolder
from flexbeams.scenarios.results.run import Kind, Run
from flexbeams.scenarios.results.saturation import saturation_lines
from flexbeams.scenarios.runs.files import figure_names, file_names, summary_head, write_files
from flexbeams.scenarios.runs.observer import SILENT, Observer
from flexbeams.scenarios.runs.scenario import run_scenario

if TYPE_CHECKING:
    from flexbeams.scenarios.report.figure_process import FigureProcess
    from flexbeams.scenarios.runs.package import ExtractedPackage

OK, CHECK_FAILED, FAILED, INTERRUPTED = 0, 1, 2, 130  # exit statuses, in this order of severity

Experiment: TypeAlias = "ScenarioFile | ExtractedPackage"


@dataclass(frozen=True, kw_only=True)
class Job:
    """An experiment to run and the files to write."""

    experiment: Experiment
    folder: Path
    settings: Settings
    formats: Sequence[Format] = ("csv",)
    figures: bool = True
    report: bool = True
    named_folder: bool = True  # by --out

    @property
    def name(self) -> str:
        """The experiment's name."""
        return self.experiment.name

    @property
    def kind(self) -> Kind:
        """What the experiment is."""
        return "scenario" if isinstance(self.experiment, ScenarioFile) else "package"

    @property
    def foreign(self) -> bool:
        """Whether units run that were not built for it: those of a package, or FMUs that the scenario names."""
        if not isinstance(self.experiment, ScenarioFile):
            return True
        files = [file for file in (self.experiment, self.experiment.open_loop) if file is not None]
        return any(instance.fmu is not None for file in files for instance in file.scenario.instance.values())

    @property
    def changed(self) -> dict[str, Any]:
        """The settings with which the run differs from its scenario."""
        scenario = self.experiment.scenario if isinstance(self.experiment, ScenarioFile) else None
        return changed_settings(self.settings, scenario)

    @property
    def files(self) -> list[str]:
        """Names of the files that it writes."""
        scenario = self.experiment.scenario if isinstance(self.experiment, ScenarioFile) else None
        figures = figure_names(None if scenario is None else scenario.figure) if self.figures else []
        return file_names(figures, self.report, self.formats)


@dataclass(frozen=True, kw_only=True)
class JobResult:
    """What there is to report of a finished job; small, since it is passed between processes."""

    name: str
    status: int  # exit status
    title: str = ""
    folder: Path | None = None  # None: nothing was written
    outcomes: Sequence[Outcome] = ()
    timing: dict[str, Any] | None = None  # as in summary.json
    saturation: Sequence[str] = ()  # lines about instances whose voltages were at a limit
    message: str = ""  # why it is not complete

    @property
    def failed(self) -> int:
        """Number of checks that do not hold."""
        return sum(not o.passed for o in self.outcomes)

    @property
    def factor(self) -> str:
        """Simulated time divided by computing time, as text."""
        value = (self.timing or {}).get("real_time_factor")
        return f"{value:.1f}" if value else ""


@contextmanager
def opened_experiment(name: str) -> Iterator[Experiment]:
    """A scenario, given as a shipped name or as a file, or an SSP package, which is extracted until the end.

    Raises InputError for what cannot be read.
    """
    if is_package(name):
        from flexbeams.scenarios.runs.package import extracted_package

        with extracted_package(Path(name)) as package:
            yield package
    else:
        yield load_scenario(name)


def run_experiment(
    experiment: Experiment, settings: Settings, observer: Observer = SILENT, designs: Sequence[Design] = ()
) -> Run:
    """Runs a scenario or a package; raises FlexbeamsError where the run cannot start."""
    if isinstance(experiment, ScenarioFile):
        return run_scenario(experiment, settings, observer, designs)
    from flexbeams.scenarios.runs.package import run_package

    return run_package(experiment, settings, observer)


def run_job(
    job: Job, observer: Observer, designs: Sequence[Design] = (), figure_process: "FigureProcess | None" = None
) -> JobResult:
    """Runs a job in this process and writes its files.

    Raises FlexbeamsError where the run cannot start, or its files cannot be written without harm to others.
    """
    with ResultFolder(job.folder) as folder:
        replaced = _replaced(job, folder.require_free(job.files))
        head = summary_head(job.kind, job.name, job.changed)

        @cache  # once, before the first row or file is written
        def announce() -> None:
            if replaced:
                observer.notify(f"{job.folder}: replaces {replaced}")

        def begin_rows() -> Path:
            announce()
            return folder.begin_rows(head)

        recorded = replace(observer, row_path=begin_rows)
        settings = replace(job.settings, formats=tuple(job.formats), results_folder=job.folder)
        run = run_experiment(job.experiment, settings, recorded, designs)
        announce()
        observer.writing()
        with deferred_interrupt() as interrupted:
            status, message = _verdict(run, job.folder)
            write_files(
                run,
                folder,
                figures=job.figures,
                report=job.report,
                formats=job.formats,
                figure_process=figure_process,
            )
            if interrupted() and run.recording.complete:
                status, message = INTERRUPTED, "interrupted while the results were written; they are complete"
    return JobResult(
        name=run.name,
        status=status,
        title=f"{run.name}: {run.scenario.title}" + (f" (paper: {run.scenario.paper})" if run.scenario.paper else ""),
        folder=job.folder,
        outcomes=run.outcomes,
        timing=run.summary["timing"],
        saturation=saturation_lines(run.summary["metrics"]),
        message=message,
    )


def _replaced(job: Job, earlier: dict[str, Any]) -> str:
    """A run of another kind, name or settings that is replaced, in a folder that was named only; empty for none."""
    before = (earlier.get("kind", "scenario"), earlier.get("scenario"), earlier.get("settings"))
    if not earlier or before == (job.kind, job.name, json_values(job.changed)):
        return ""
    changes = ", ".join(f"{key} {value}" for key, value in (before[2] or {}).items()) or "its own settings"
    of_kind = f"the {before[0]} " if before[0] != job.kind else ""
    held = f"a run of {of_kind}{before[1]} with {changes}"
    if not job.named_folder:
        raise InputError("", f"holds {held}; choose another folder with --out", source=str(job.folder))
    return held


def _verdict(run: Run, folder: Path) -> tuple[int, str]:
    recording = run.recording
    if recording.interrupted:
        return INTERRUPTED, f"interrupted at {recording.time[-1]:.6g} s; what was recorded is marked incomplete"
    if recording.failure is not None:
        return FAILED, f"{recording.failure}; what was recorded up to then is in {folder}"
    return (OK if run.passed else CHECK_FAILED), ""
