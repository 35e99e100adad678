"""Tables of compared runs for the terminal."""

from rich.table import Table

from flexbeams.scenarios.cli.tables import cell, console
from flexbeams.scenarios.results.compare import Comparison, check_table, fact_table, metric_table

_MARKS = {"holds": " [green]ok[/]", "failed": " [red bold]FAILED[/]", "": ""}


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
