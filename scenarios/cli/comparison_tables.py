"""Tables of compared runs for the terminal."""

from rich.table import Table

from flexbeams.scenarios.api.comparisons import Comparison
from flexbeams.scenarios.cli.tables import cell, console
from flexbeams.scenarios.results.compare import check_table, fact_table, metric_table
from flexbeams.scenarios.results.differences import LEAST_SHARE

_MARKS = {"holds": " [green]ok[/]", "failed": " [red bold]FAILED[/]", "": ""}


def show_differences(comparison: Comparison) -> None:
    """Settings that differ, then the difference of each signal from the first run, the largest first."""
    settings, signals, tolerance = comparison.settings, comparison.differences, comparison.tolerance
    out = console()
    if settings:
        table = Table(title="settings that differ", title_justify="left", title_style="bold")
        table.add_column("")
        for run in comparison.runs:
            table.add_column(cell(run.label), justify="right")
        for name, cells in settings.items():
            table.add_row(cell(name), *map(cell, cells))
        out.print(table)
    elif all(run.summary for run in comparison.runs):
        out.print("no settings differ")
    title = f"differences from {cell(comparison.runs[0].label)}, in its units of measurement"
    table = Table(title=title, title_justify="left", title_style="bold")
    table.add_column("signal")
    for heading in ("largest", "rms", "relative", "at"):
        table.add_column(heading, justify="right")
    table.add_column("")
    several = len(comparison.runs) > 2
    for d in signals:
        name = f"{d.run}: {d.signal}" if several else d.signal
        figures = (f"{d.largest:.3g}", f"{d.rms:.3g}", f"{d.relative:.2g}", f"{d.time:.6g} s")
        verdict = "" if tolerance is None else _MARKS["holds" if d.relative <= tolerance else "failed"]
        table.add_row(cell(name), *figures, verdict)
    out.print(table)
    worst = signals[0]
    equal = (
        "all signals are equal"
        if worst.largest == 0
        else f"largest relative difference: {worst.relative:.2g}, {worst.signal}"
    )
    between = f", {worst.interpolated} of {worst.rows} rows interpolated" if worst.interpolated else ""
    span = next(s for s in comparison.spans if s.run == worst.run)
    out.print(cell(f"{equal} ({worst.rows} common times, {span.text}{between})"), soft_wrap=True)
    if tolerance is not None:
        for span in (s for s in comparison.spans if s.share < LEAST_SHARE):
            text = f"{span.run} is compared for less than {LEAST_SHARE:.0%} of the longer recording:"
            out.print(f"{cell(text)}{_MARKS['failed']}", soft_wrap=True)


def show_comparison(comparison: Comparison) -> None:
    """Checks and metrics of the runs side by side."""
    out = console()
    for title, rows in (
        ("runs", fact_table(comparison)),
        ("checks", _checks(comparison)),
        ("metrics", metric_table(comparison)),
    ):
        if not rows:
            continue
        table = Table(title=title, title_justify="left", title_style="bold")
        table.add_column("")
        for run in comparison.runs:
            table.add_column(cell(run.label), justify="right")
        for name, cells in rows:
            table.add_row(cell(name), *(cells if title == "checks" else map(cell, cells)))
        out.print(table)


def _checks(comparison: Comparison) -> list[tuple[str, list[str]]]:
    return [
        (
            name,
            [
                cell(c["measured"]) + (f" (paper {cell(c['paper'])})" if c["paper"] else "") + _MARKS[c["verdict"]]
                for c in cells
            ],
        )
        for name, cells in check_table(comparison)
    ]
