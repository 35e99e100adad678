"""The verb `flexbeams study`."""

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from flexbeams.scenarios.cli.options import cache_option, compiler_option, note, scenario_options
from flexbeams.scenarios.definition.choices import BACKENDS, METHODS

if TYPE_CHECKING:
    from flexbeams.scenarios.studies.study import Study, Workers

INTERRUPTED = 130


def _part(context: click.Context, parameter: click.Parameter, text: str | None) -> tuple[int, int]:
    """k/n as two numbers."""
    match = re.fullmatch(r"([0-9]+)/([0-9]+)", text or "1/1")
    k, n = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= k <= n:
        raise click.BadParameter(f"must be k/n with k from 1 to n, got {text!r}")
    return k, n


@click.command()
@click.argument("name", metavar="NAME|FILE")
@click.option("--runs", type=click.IntRange(1), help="Number of runs, whatever the method. [default: the study's]")
@click.option("--method", type=click.Choice(list(METHODS)), help="How inputs are chosen. [default: the study's]")
@click.option("--seed", type=click.IntRange(0), help="Equal seeds give equal results. [default: the study's]")
@click.option("--jobs", type=click.IntRange(1), help="Processes. [default: as many as there are cores]")
@click.option("--scheduler", metavar="ADDRESS", help="Runs on a Dask cluster, such as tcp://machine:8786.")
@click.option("--part", metavar="K/N", callback=_part, help="Only part k of n, for job arrays; all parts share --out.")
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), help="Folder of the results. [default: studies/NAME]"
)
@click.option(
    "--controller",
    metavar="FILE.fmu|FILE.py:CLASS",
    help="Of `study benchmark`: your own beside those of this project.",
)
@click.option("--full", type=click.IntRange(0), metavar="N", help="Make the report of run N alone, in OUT/runs/N.")
@click.option("--no-report", is_flag=True, help="Write no study.html, and no reports of the worst runs.")
@click.option(
    "--backend", type=click.Choice(list(BACKENDS)), default="native", show_default=True, help="Kernel of the units."
)
@click.option("--no-batch", is_flag=True, help="Run all samples through the FMI units, none through the batch kernel.")
@compiler_option
@cache_option
@scenario_options("Set a start value or parameter in all runs.", "Communication step in s.")
@click.option("--json", "as_json", is_flag=True, help="The results as JSON instead of tables.")
def study(
    name: str,
    runs: int | None,
    method: Any,
    seed: int | None,
    jobs: int | None,
    scheduler: str | None,
    part: tuple[int, int],
    out: Path | None,
    controller: str | None,
    full: int | None,
    no_report: bool,
    no_batch: bool,
    as_json: bool,
    **options: Any,
) -> int:
    """Run a scenario many times with other parameters, and say what matters.

    A study file names what varies. Results go to Parquet files in OUT/data, one row a run, and to OUT/study.html. The
    same command goes on with a study that was interrupted or killed. Shipped studies: `flexbeams list`.

    `flexbeams study benchmark` compares controllers on fixed scenarios.
    """
    if name == "benchmark":
        return _benchmark(controller or "", out, options, as_json)
    if controller is not None:
        raise click.UsageError("--controller belongs to `flexbeams study benchmark`")
    if scheduler is not None and jobs is not None:
        raise click.UsageError("--jobs is for processes of this machine, --scheduler for a cluster")
    planned = _planned(name, out, options, runs=runs, method=method, seed=seed, batch=not no_batch)
    if full is not None:
        from flexbeams.scenarios.studies.pages import write_full_run

        note(f"{write_full_run(planned.plan, full, planned.folder)} written")
        return 0
    return _run(planned, _workers(jobs, scheduler), part, not no_report, as_json)


def _run(planned: "Study", workers: "Workers", part: tuple[int, int], report: bool, as_json: bool) -> int:
    """Does the runs that are missing, and shows what there is once all are done."""
    from flexbeams.scenarios.cli.study_tables import show_study, study_progress
    from flexbeams.scenarios.studies.pages import write_pages
    from flexbeams.scenarios.studies.summary import study_summary

    with study_progress() as progress:
        finished = planned.run(workers, part=part, notify=note, progress=progress)
    if not finished:
        note(f"flexbeams: interrupted; the same command goes on (results so far are in {planned.folder})")
        return INTERRUPTED
    results = planned.results()
    left = planned.plan.samples.runs - len(results.numbers)
    if left:
        note(f"part {part[0]} of {part[1]} is done; {left} runs of other parts are missing")
        return 0
    summary = study_summary(planned.plan, results)
    if report:
        write_pages(planned.plan, results, summary, planned.folder, note)
    if as_json:
        click.echo(json.dumps(summary, indent=2))
    else:
        show_study(summary)
    note(f"{planned.folder} written")
    return 0


def _benchmark(controller: str, out: Path | None, options: dict[str, Any], as_json: bool) -> int:
    from flexbeams.fmus.packaging.cache import cache_folder
    from flexbeams.scenarios.cli.study_benchmark import show_benchmark
    from flexbeams.scenarios.definition.settings import Settings

    settings = Settings(build_folder=cache_folder(options.pop("build_folder")), **options)
    return show_benchmark(controller, settings, out or Path("studies/benchmark"), as_json)


def _planned(name: str, out: Path | None, options: dict[str, Any], **samples: Any) -> "Study":
    from flexbeams.fmus.packaging.cache import cache_folder
    from flexbeams.scenarios.definition.settings import Settings
    from flexbeams.scenarios.definition.study_file import load_study
    from flexbeams.scenarios.studies.dataset import require_parquet
    from flexbeams.scenarios.studies.planning import plan_study
    from flexbeams.scenarios.studies.study import Study

    require_parquet()
    file = load_study(name)
    settings = Settings(build_folder=cache_folder(options.pop("build_folder")), **options)
    return Study(plan=plan_study(file, settings, notify=note, **samples), folder=out or Path("studies") / file.name)


def _workers(jobs: int | None, scheduler: str | None) -> "Workers":
    from flexbeams.scenarios.studies.study import cluster, local_workers

    return local_workers(jobs) if scheduler is None else cluster(scheduler)
