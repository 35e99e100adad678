"""The verb `flexbeams run`."""

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from os.path import exists
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.options import (
    POSITIVE,
    cache_option,
    compiler_option,
    max_size_option,
    note,
    scenario_options,
)
from flexbeams.scenarios.definition.choices import BACKENDS, FORMATS

if TYPE_CHECKING:
    from flexbeams.scenarios.definition.settings import Settings
    from flexbeams.scenarios.report.figure_process import FigureProcess
    from flexbeams.scenarios.runs.job import Experiment, Job, JobResult
    from flexbeams.scenarios.runs.progress import Display


def _formats(context: click.Context, parameter: click.Parameter, values: Sequence[str]) -> tuple[str, ...]:
    """Formats given one by one or separated by commas, each once."""
    names = [name.strip().lower() for value in values for name in value.split(",")]
    for name in names:
        if name not in FORMATS:
            raise click.BadParameter(f"must be of {', '.join(FORMATS)}, got {name!r}")
    return tuple(dict.fromkeys(names))


def _rates(context: click.Context, parameter: click.Parameter, values: Sequence[str]) -> dict[str, int]:
    """SIGNAL=N options as a table."""
    rates = {}
    for text in values:
        name, equals, count = text.partition("=")
        if not equals or not name.strip() or not count.strip().isdecimal():
            raise click.BadParameter(f"must be SIGNAL=N with a whole number of steps, got {text!r}")
        rates[name.strip()] = int(count)
    return rates


@click.command()
@click.argument("scenarios", nargs=-1, required=True, metavar="SCENARIO...")
@click.option(
    "--backend", type=click.Choice(list(BACKENDS)), default="native", show_default=True, help="Kernel of the units."
)
@compiler_option
@cache_option
@scenario_options(
    "Set a start value or parameter: plant.beam[1].tip_mass=0.03, plant.beam[].tip_mass=0.03 for all, "
    "plant.u=100,0,0,0 for an array.",
    "Communication step in s; by default the scenario's, or the package's.",
)
@click.option(
    "--decimate",
    type=click.IntRange(min=1),
    default=1,
    metavar="N",
    help="Record every N-th step (and the last); checks are measured on these.",
)
@click.option(
    "--record-every",
    multiple=True,
    callback=_rates,
    metavar="SIGNAL=N",
    help="Record a signal or array at every N-th step alone: plant.y_pm=10. Rows between hold its last value, which "
    "takes little room in Parquet files. Repeatable.",
)
@click.option(
    "--format",
    "formats",
    multiple=True,
    callback=_formats,
    default=("csv",),
    show_default=True,
    metavar="|".join(FORMATS),
    help="Files of the recorded signals; several separated by commas.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Scenarios that run in parallel. [default: as many as there are cores]",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the results; with several scenarios a folder for each inside it. "
    "[default: results/<scenario>, with a suffix that names settings other than the scenario's; "
    "results/<package>-ssp]",
)
@click.option("--real-time", is_flag=True, help="Pace the run to the wall clock (native units); lateness is reported.")
@click.option(
    "--real-time-factor",
    type=POSITIVE,
    metavar="F",
    help="Simulated seconds for each second of the wall clock: 0.1 is slow motion. Implies --real-time.",
)
@click.option(
    "--patience",
    type=POSITIVE,
    default=60.0,
    show_default=True,
    metavar="S",
    help="Seconds without progress after which the units of a package and FMUs that a scenario names, which run in a "
    "process of their own, are ended.",
)
@max_size_option
@click.option("--units-row", is_flag=True, help="Write units of measurement into the second row of results.csv.")
@click.option("--no-figures", is_flag=True, help="Write no figures.")
@click.option("--no-report", is_flag=True, help="Write no report.html.")
@click.option(
    "--json", "as_json", is_flag=True, help="Status, folder and summary of each run as JSON instead of tables."
)
def run(
    scenarios: tuple[str, ...], jobs: int | None, real_time: bool, as_json: bool, patience: float, **options: Any
) -> int:
    """Run scenarios (names from `flexbeams list`, files, or SSP packages) and check the results.

    Builds the units that are missing, runs them, writes results.csv, summary.json, figures and report.html, and
    prints each check beside the paper's figure. Several scenarios run in parallel.
    """
    from flexbeams.scenarios.importing.package import is_package
    from flexbeams.scenarios.runs.progress import Display

    if real_time and options["real_time_factor"] is None:
        options["real_time_factor"] = 1.0
    names = [Path(scenario).stem for scenario in scenarios]
    with ExitStack() as stack:
        display = stack.enter_context(Display(names))
        figure_process = None
        own = len(names) == 1 and not is_package(scenarios[0])  # in this process
        drawn = exists((options["out"] or Path("results", names[0])) / "summary.json")  # most often the same figures
        if own and not options["no_figures"] and not drawn and options["real_time_factor"] is None:
            from flexbeams.scenarios.report.figure_process import FigureProcess  # before all that takes time

            figure_process = stack.enter_context(FigureProcess())
        results = _run_all(_planned(scenarios, stack, **options), jobs, display, figure_process, patience)
    if as_json:
        click.echo(json.dumps([_record(result) for result in results], indent=2))
        return max(result.status for result in results)
    from flexbeams.scenarios.cli.run_tables import show_checks, show_overview

    for result in results:
        show_checks(result)
        if result.message and len(results) == 1:
            note(f"flexbeams: {result.message}")
    if len(results) > 1:
        show_overview(results)
    return max(result.status for result in results)


def _record(result: "JobResult") -> dict[str, Any]:
    """A result for --json."""
    folder = result.folder
    summary = json.loads((folder / "summary.json").read_bytes()) if folder is not None else None
    return {
        "scenario": result.name,
        "status": result.status,
        "message": result.message,
        "folder": None if folder is None else str(folder),
        "summary": summary,
    }


def _planned(
    scenarios: Sequence[str],
    stack: ExitStack,
    *,
    out: Path | None,
    formats: Any,
    no_figures: bool,
    no_report: bool,
    build_folder: Path | None,
    **options: Any,
) -> "list[Job]":
    """The jobs, with all input read and folders for their results made."""
    from flexbeams.fmus.packaging.cache import cache_folder
    from flexbeams.scenarios.definition.settings import Settings
    from flexbeams.scenarios.definition.variants import variant_suffix
    from flexbeams.scenarios.results.formats import require_formats
    from flexbeams.scenarios.runs.job import Job, opened_experiment

    experiments = [stack.enter_context(opened_experiment(scenario)) for scenario in scenarios]
    names = [experiment.name for experiment in experiments]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise InputError("SCENARIO", "must be given once, since its name is that of its results", name)
    require_formats(formats)
    settings = Settings(record_animation=not no_report, build_folder=cache_folder(build_folder), **options)
    if out is None:
        folders = [Path("results") / f"{e.folder_name}{variant_suffix(_changes(e, settings))}" for e in experiments]
    else:
        folders = [out if len(names) == 1 else out / name for name in names]
    stack.enter_context(_folders(folders))
    return [
        Job(
            experiment=experiment,
            folder=folder,
            settings=settings,
            formats=formats,
            figures=not no_figures,
            report=not no_report,
            named_folder=out is not None,
        )
        for experiment, folder in zip(experiments, folders, strict=True)
    ]


def _changes(experiment: "Experiment", settings: "Settings") -> dict[str, Any]:
    """The settings with which a run differs from its scenario or package."""
    from flexbeams.scenarios.definition.scenario_file import ScenarioFile
    from flexbeams.scenarios.definition.variants import changed_settings

    return changed_settings(settings, experiment.scenario if isinstance(experiment, ScenarioFile) else None)


def _run_all(
    planned: "Sequence[Job]",
    jobs: int | None,
    display: "Display",
    figure_process: "FigureProcess | None",
    patience: float,
) -> "list[JobResult]":
    """Runs one scenario in this process; several jobs, and units that were not built for them, in other ones."""
    from flexbeams.scenarios.definition.scenario_file import ScenarioFile

    packages = [job.experiment for job in planned if not isinstance(job.experiment, ScenarioFile)]
    for extracted in packages:
        if extracted.package.tool != "flexbeams":
            display.note(f"{extracted.file} was not written by flexbeams; its units run in a process of their own")
    foreign = any(job.foreign for job in planned)
    if len(planned) > 1 or foreign:
        from flexbeams.scenarios.processes.pools import usable_cores
        from flexbeams.scenarios.runs.parallel import run_parallel

        workers = min(jobs or usable_cores(), len(planned))
        return run_parallel(planned, workers, display, patience if foreign else None)
    from flexbeams.scenarios.runs.job import run_job
    from flexbeams.scenarios.runs.observer import Observer

    job = planned[0]
    observer = Observer(notify=display.note, progress=lambda done, steps: display.progress(job.name, done, steps))
    return [run_job(job, observer, figure_process=figure_process)]


@contextmanager
def _folders(folders: Sequence[Path]) -> Iterator[None]:
    """Creates result folders before anything runs; at the end, new ones that are empty are removed."""
    created: list[Path] = []
    try:
        for folder in folders:
            created += [f for f in (*reversed(folder.parents), folder) if not exists(f)]
            _create_folder(folder)
        yield
    finally:
        for folder in reversed(created):
            with suppress(OSError):
                folder.rmdir()


def _create_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("", f"cannot be made a folder for results: {error.strerror}", source=str(folder)) from None
