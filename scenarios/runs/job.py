"""A run as the command line asks for it, to its files and its verdict."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexbeams.controller.design import Design
from flexbeams.plant.archive import remove_file
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.importing.package import is_package
from flexbeams.scenarios.report.figure_process import FigureProcess
from flexbeams.scenarios.results.checks import Outcome
from flexbeams.scenarios.results.files import write_results
from flexbeams.scenarios.results.formats import Format
from flexbeams.scenarios.runs.package import run_package
from flexbeams.scenarios.runs.scenario import run_scenario, write_run
from flexbeams.scenarios.simulation.recording import Recording

OK, CHECK_FAILED, FAILED, INTERRUPTED = 0, 1, 2, 130  # exit statuses, in this order of severity


@dataclass(frozen=True, kw_only=True)
class Job:
    """One scenario to run and where its results go."""

    scenario: str  # a shipped name or a file
    folder: Path
    settings: Settings
    formats: Sequence[Format] = ("csv",)
    figures: bool = True
    report: bool = True

    @property
    def name(self) -> str:
        """The scenario's name."""
        return Path(self.scenario).stem


@dataclass(frozen=True, kw_only=True)
class JobResult:
    """What there is to say of a job when it is over; without recordings, so that it passes between processes."""

    name: str
    status: int  # exit status
    title: str = ""
    folder: Path | None = None  # None: nothing was written
    outcomes: Sequence[Outcome] = ()
    timing: dict[str, Any] | None = None  # as in summary.json
    message: str = ""  # why it is not complete

    @property
    def failed(self) -> int:
        """Checks that do not hold."""
        return sum(not o.passed for o in self.outcomes)

    @property
    def factor(self) -> str:
        """Simulated time by computing time, for people."""
        value = (self.timing or {}).get("real_time_factor")
        return f"{value:.1f}" if value else ""


def run_job(
    job: Job,
    notify: Callable[[str], None],
    progress: Callable[[int, int], None],
    designs: Sequence[Design] = (),
    beside: FigureProcess | None = None,
) -> JobResult:
    """Runs a job in this process and writes its files; errors as of run_scenario or run_package.

    Figures are drawn `beside` where given.
    """
    if is_package(job.scenario):
        return _execute_package(job, notify, progress)
    run = run_scenario(job.scenario, job.settings, notify=notify, progress=progress, designs=designs)
    write_run(run, job.folder, job.figures, job.report, job.formats, beside)
    status, message = _verdict(run.recording, run.passed, job.folder)
    title = f"{run.name}: {run.scenario.title}" + (f" (paper: {run.scenario.paper})" if run.scenario.paper else "")
    return JobResult(
        name=job.name,
        status=status,
        title=title,
        folder=job.folder,
        outcomes=run.outcomes,
        timing=run.summary["timing"],
        message=message,
    )


def _execute_package(job: Job, notify: Callable[[str], None], progress: Callable[[int, int], None]) -> JobResult:
    """A package has no checks and no figures of its own."""
    run = run_package(Path(job.scenario), job.settings, notify=notify, progress=progress)
    remove_file(job.folder / "report.html")
    write_results(job.folder, run.recording, run.summary, job.formats)
    status, message = _verdict(run.recording, True, job.folder)
    return JobResult(
        name=job.name,
        status=status,
        title=f"{job.name}: {run.title}",
        folder=job.folder,
        timing=run.summary["timing"],
        message=message,
    )


def _verdict(recording: Recording, passed: bool, folder: Path) -> tuple[int, str]:
    if recording.interrupted:
        return INTERRUPTED, f"interrupted at {recording.time[-1]:.6g} s; what was recorded is marked incomplete"
    if recording.failure is not None:
        return FAILED, f"{recording.failure}; what was recorded up to then is in {folder}"
    return (OK if passed else CHECK_FAILED), ""
