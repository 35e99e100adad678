"""The verb `flexbeams run`."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from math import isfinite
from pathlib import Path
from typing import Any

import click

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.options import BACKENDS, BASES, COUPLINGS, POSITIVE, compiler_option, note

FORMATS = ("csv", "parquet", "mat")


def assignment(context: click.Context, parameter: click.Parameter, values: Sequence[str]) -> dict[str, Any]:
    """INSTANCE.VARIABLE=VALUE options as a table; several numbers, separated by commas, are those of an array."""
    table: dict[str, Any] = {}
    for text in values:
        name, equals, value = text.rpartition("=")
        if not equals or "." not in name:
            raise click.BadParameter(f"must be INSTANCE.VARIABLE=VALUE, got {text!r}")
        if value.lower() in ("true", "false"):
            table[name] = value.lower() == "true"
            continue
        try:
            numbers = [float(part) for part in value.removeprefix("[").removesuffix("]").split(",")]
        except ValueError:
            raise click.BadParameter(
                f"{name} must be a number, numbers separated by commas, true or false, got {value!r}"
            ) from None
        if not all(map(isfinite, numbers)):
            raise click.BadParameter(f"{name} must be finite, got {value!r}")
        table[name] = numbers if "," in value or value.startswith("[") else numbers[0]
    return table


def _formats(context: click.Context, parameter: click.Parameter, values: Sequence[str]) -> tuple[str, ...]:
    """Formats given one by one or separated by commas, each once."""
    names = [name.strip().lower() for value in values for name in value.split(",")]
    for name in names:
        if name not in FORMATS:
            raise click.BadParameter(f"must be of {', '.join(FORMATS)}, got {name!r}")
    return tuple(dict.fromkeys(names))


@click.command()
@click.argument("scenarios", nargs=-1, required=True, metavar="SCENARIO...")
@click.option("--backend", type=BACKENDS, default="native", show_default=True, help="Kernel of the units.")
@compiler_option
@click.option("--coupling", type=COUPLINGS, help="Override the scenario's coupling.")
@click.option("--basis", type=BASES, help="Override the basis of design and plant.")
@click.option("--structure", metavar="FILE", help="Override the scenario's structure.")
@click.option(
    "--set",
    "overrides",
    multiple=True,
    callback=assignment,
    metavar="UNIT.VARIABLE=VALUE",
    help="Set a start value or parameter: plant.beam[1].tip_mass=0.03, plant.beam[].tip_mass=0.03 for all, "
    "plant.u=100,0,0,0 for an array. Repeatable.",
)
@click.option("--stop-time", type=POSITIVE, metavar="S", help="Simulated time in s.")
@click.option(
    "--step", type=POSITIVE, metavar="S", help="Communication step in s; by default the scenario's, or the package's."
)
@click.option(
    "--decimate",
    type=click.IntRange(min=1),
    default=1,
    metavar="N",
    help="Record every N-th step (and the last); checks are measured on these.",
)
@click.option(
    "--format",
    "formats",
    multiple=True,
    callback=_formats,
    default=("csv",),
    show_default=True,
    metavar="csv|parquet|mat",
    help="Files of the recorded signals; several separated by commas.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Scenarios that run side by side. [default: as many as there are cores]",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder of the results; with several scenarios a folder for each inside it. [default: results/<scenario>]",
)
@click.option("--real-time", is_flag=True, help="Pace the run to the wall clock (native units); lateness is reported.")
@click.option(
    "--real-time-factor",
    "real_time_factor",
    type=POSITIVE,
    metavar="F",
    help="Simulated seconds for each second of the wall clock: 0.1 is slow motion. Implies --real-time.",
)
@click.option("--no-figures", is_flag=True, help="Write no figures.")
@click.option("--no-report", is_flag=True, help="Write no report.html.")
def run(
    scenarios: tuple[str, ...],
    formats: Any,
    jobs: int | None,
    out: Path | None,
    no_figures: bool,
    no_report: bool,
    real_time: bool,
    real_time_factor: float | None,
    **options: Any,
) -> int:
    """Run scenarios (names from `flexbeams list`, files, or SSP packages) and check the results.

    Builds the units that are missing, runs them, writes results.csv, summary.json, figures and report.html, and
    prints each check beside the paper's figure. Several scenarios run side by side.
    """
    from flexbeams.scenarios.runs.progress import Display

    names = [Path(scenario).stem for scenario in scenarios]
    with Display(names) as display, ExitStack() as stack:
        beside = None
        if len(names) == 1 and not no_figures and not real_time and real_time_factor is None:
            from flexbeams.scenarios.report.figure_process import FigureProcess  # before all that takes time

            beside = stack.enter_context(FigureProcess())
        from flexbeams.scenarios.definition.schema import find_scenario, read_scenario
        from flexbeams.scenarios.definition.settings import Settings
        from flexbeams.scenarios.importing.package import is_package
        from flexbeams.scenarios.results.formats import require_formats
        from flexbeams.scenarios.runs.job import Job, run_job
        from flexbeams.scenarios.runs.package import require_package

        for k, scenario in enumerate(scenarios):
            if is_package(scenario):
                require_package(Path(scenario))
            else:
                read_scenario(find_scenario(scenario))
            if names[k] in names[:k]:
                raise InputError("SCENARIO", "must be given once, since its name is that of its results", names[k])
        require_formats(formats)
        folders = [out if out and len(names) == 1 else (out or Path("results")) / name for name in names]
        stack.enter_context(_folders(folders))
        settings = Settings(
            record_animation=not no_report, real_time_factor=real_time_factor or (1.0 if real_time else None), **options
        )
        planned = [
            Job(
                scenario=scenario,
                folder=folder,
                settings=settings,
                formats=formats,
                figures=not no_figures,
                report=not no_report,
            )
            for scenario, folder in zip(scenarios, folders, strict=True)
        ]
        if len(planned) > 1:
            from flexbeams.scenarios.runs.parallel import run_parallel, usable_cores

            finished = run_parallel(planned, min(jobs or usable_cores(), len(planned)), display)
        else:
            finished = [
                run_job(
                    planned[0], display.note, lambda done, steps: display.progress(names[0], done, steps), beside=beside
                )
            ]
    from flexbeams.scenarios.cli.tables import show_checks, show_overview

    for one in finished:
        show_checks(one)
        if one.message and len(finished) == 1:
            note(f"flexbeams: {one.message}")
    if len(finished) > 1:
        show_overview(finished)
    return max(one.status for one in finished)


@contextmanager
def _folders(folders: Sequence[Path]) -> Iterator[None]:
    """Makes folders for results, so that a run is not lost for want of one; in the end, new ones that are empty go."""
    made: list[Path] = []
    try:
        for folder in folders:
            made += [f for f in (*reversed(folder.parents), folder) if not f.exists()]
            _require_folder(folder)
        yield
    finally:
        for folder in reversed(made):
            with suppress(OSError):
                folder.rmdir()


def _require_folder(folder: Path) -> None:
    """A folder for results, made here so that a run is not lost for want of one."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("", f"cannot be made a folder for results: {error.strerror}", source=str(folder)) from None
