"""The verb `flexbeams bench`."""

import json
from pathlib import Path
from typing import Any

import click

from flexbeams.scenarios.cli.options import cache_option, compiler_option


@click.command()
@click.option(
    "--steps",
    type=click.IntRange(min=1),
    default=30_000,
    show_default=True,
    metavar="N",
    help="Steps of each loop; 30000 are the whole run of `tracking`.",
)
@click.option(
    "--masters",
    is_flag=True,
    help="Instead: the exported scenario under third-party co-simulation "
    "tools (extra `masters`) beside the runner, and how far they agree.",
)
@click.option(
    "--identify", is_flag=True, help="Instead: processor time of identifications, two to four minutes in all."
)
@click.option("--study", is_flag=True, help="Instead: what a sample of a study costs, beside a run's stepping loop.")
@click.option("--json", "as_json", is_flag=True, help="Everything as JSON.")
@compiler_option
@cache_option
def bench(
    steps: int, masters: bool, identify: bool, study: bool, as_json: bool, compiler: str, build_folder: Path | None
) -> int:
    """Measure what a step costs: bare C loop, FMI functions, runner and numpy, interleaved in one process.

    Measures only: the exit status is 0 whether targets are met or not.
    """
    from flexbeams.fmus.packaging.cache import cache_folder
    from flexbeams.scenarios.runs.progress import Display

    with Display(["bench"]) as display:

        def progress(done: int, parts: int) -> None:
            display.progress("bench", done, parts)

        if identify:
            from flexbeams.scenarios.bench.identification import measure_identification
            from flexbeams.scenarios.cli.bench_tables import show_identification as show

            figures: dict[str, Any] = measure_identification(progress=progress)
        elif study:
            from flexbeams.scenarios.cli.bench_tables import show_samples as show
            from flexbeams.scenarios.studies.costs import sample_costs

            figures = sample_costs(compiler, cache_folder(build_folder), display.note, progress)
        elif masters:
            from flexbeams.scenarios.bench.masters import measure_masters
            from flexbeams.scenarios.cli.bench_tables import show_masters as show

            figures = measure_masters(steps, compiler, cache_folder(build_folder), display.note, progress)
        else:
            from flexbeams.scenarios.bench.measure import measure
            from flexbeams.scenarios.bench.workbench import Workbench
            from flexbeams.scenarios.cli.bench_tables import show_bench as show

            with Workbench(steps, compiler, build_folder, display.note) as workbench:
                figures = measure(workbench, progress=progress)
    if as_json:
        click.echo(json.dumps(figures, indent=2))
    else:
        show(figures)
    return 0
