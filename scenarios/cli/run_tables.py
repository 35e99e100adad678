"""Tables of `flexbeams run` for the terminal: checks of a run, and an overview of several."""

from collections.abc import Sequence

from rich.table import Table

from flexbeams.scenarios.cli.tables import cell, console
from flexbeams.scenarios.results.display import limits, number
from flexbeams.scenarios.runs.job import CHECK_FAILED, FAILED, INTERRUPTED, OK, JobResult


def show_checks(result: JobResult) -> None:
    """Prints each check beside the paper's figure, and the folder of the results."""
    out = console()
    if result.title:
        out.print(cell(result.title), style="bold", soft_wrap=True)
    table = Table()
    table.add_column("check")
    for heading in ("measured", "limit", "paper"):
        table.add_column(heading, justify="right")
    table.add_column("")
    for o in result.outcomes:
        limited = o.minimum is not None or o.maximum is not None
        verdict = "" if not limited else "[green]ok[/]" if o.passed else "[red bold]FAILED[/]"
        texts = (o.name, number(o.value, o.unit), limits(o.minimum, o.maximum, o.unit), number(o.paper, o.unit))
        table.add_row(*map(cell, texts), verdict)
    if result.outcomes:
        out.print(table)
    for line in result.saturation:
        out.print(cell(line), soft_wrap=True)
    if result.timing is not None:
        out.print(
            f"{result.timing['steps']} steps in {result.timing['wall_s']:.2f} s"
            + (f", {result.factor} times real time" if result.factor else "")
            + f"; results in {cell(str(result.folder))}",
            soft_wrap=True,
        )
        if late := result.timing.get("lateness"):
            delays = {key: f"{1e6 * late[key]:.0f} µs" for key in ("median", "p99", "p99.99", "max")}
            out.print(
                f"late at the start of a step: median {delays['median']}, 99 % {delays['p99']}, 99.99 % "
                f"{delays['p99.99']}, largest {delays['max']}; "
                f"{late['overruns']} steps late by more than a step; rate error {late['rate_error']:.1e}",
                soft_wrap=True,
            )


def show_overview(results: Sequence[JobResult]) -> None:
    """Prints a line for each of several runs."""
    table = Table()
    table.add_column("scenario", no_wrap=True)
    table.add_column("checks")
    for heading in ("held", "failed", "x real time"):
        table.add_column(heading, justify="right")
    table.add_column("results", overflow="fold")
    words = {
        OK: "[green]ok[/]",
        CHECK_FAILED: "[red bold]FAILED[/]",
        FAILED: "[red bold]ERROR[/]",
        INTERRUPTED: "[yellow]interrupted[/]",
    }
    for result in results:
        complete = result.status in (OK, CHECK_FAILED)
        held = str(len(result.outcomes) - result.failed)
        table.add_row(
            cell(result.name),
            words[result.status],
            *((held, str(result.failed)) if complete else ("", "")),
            result.factor,
            cell(str(result.folder)) if result.folder else "none",
        )
    out = console(width=300)
    out.print(table)
    for result in results:
        for line in result.saturation:
            out.print(cell(f"{result.name}: {line}"))
