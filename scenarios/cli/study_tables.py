"""Progress and tables of `flexbeams study`."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.progress import BarColumn, TextColumn
from rich.table import Table

from flexbeams.scenarios.cli.options import note
from flexbeams.scenarios.cli.tables import cell, console
from flexbeams.scenarios.results.display import limits, number
from flexbeams.scenarios.runs.progress import terminal_bars
from flexbeams.scenarios.studies.execution import Clock, Progress

_SECONDS = 10.0  # between lines where there is no terminal
_SHOWN = 4  # inputs of a measure


@contextmanager
def study_progress() -> Iterator[Progress]:
    """A bar on a terminal; elsewhere a line every few seconds."""
    clock = Clock()
    shown = terminal_bars(BarColumn(bar_width=30), TextColumn("{task.fields[state]}"))
    if shown is None:
        yield _Lines(clock)
        return
    with shown as bars:
        task = bars.add_task("", state="preparing", total=None)
        yield lambda done, total: bars.update(task, completed=done, total=total, state=clock.text(done, total))


class _Lines:
    """Lines of progress: the first, the last, and one every few seconds."""

    def __init__(self, clock: Clock) -> None:
        self._clock, self._last, self._shown = clock, -_SECONDS, ""

    def __call__(self, done: int, total: int) -> None:
        text, now = self._clock.text(done, total), time.monotonic()
        if text != self._shown and (done == total or now - self._last > _SECONDS):
            self._last, self._shown = now, text
            note(text)


def show_study(summary: dict[str, Any]) -> None:
    """Failures first, then a row for each measure, with the inputs that explain most of it."""
    out = console()
    out.print(f"[bold]{cell(summary['study'])}[/bold]: {cell(summary['title'])}")
    out.print(f"{summary['runs']} runs, {summary['failed']} failed")
    if summary["checked"]["runs"]:
        gap = f"{summary['checked']['largest_difference']:.1g}"
        out.print(f"by the batch kernel; {summary['checked']['runs']} of them through the units as well, within {gap}")
    for failure in summary["failures"][:5]:
        out.print(f"  run {failure['run']}: {cell(failure['reason'])}")
    table = Table()
    table.add_column("measure")
    for heading in ("5 %", "median", "95 %", "worst", "run", "limit", "outside"):
        table.add_column(heading, justify="right")
    for name, measure in summary["measures"].items():
        table.add_row(cell(name), *_cells(measure))
    out.print(table)
    for name, measure in summary["measures"].items():
        if text := _explained(measure):
            out.print(f"{cell(name)}: {text}")


def _cells(measure: dict[str, Any]) -> list[str]:
    if "quantiles" not in measure:
        return ["–"] * 7
    unit, quantiles, worst = measure["unit"], measure["quantiles"], measure["worst"][0]
    limit = limits(measure["min"], measure["max"], unit)
    return [
        *(number(quantiles[q], unit) for q in ("0.05", "0.5", "0.95")),
        number(worst["value"], unit),
        str(worst["run"]),
        limit,
        str(measure["outside"]) if limit else "",
    ]


def _explained(measure: dict[str, Any]) -> str:
    found = measure.get("sensitivity", {})
    parts = []
    for name, index in list(found.get("indices", {}).items())[:_SHOWN]:
        half = (index["first_high"] - index["first_low"]) / 2
        parts.append(f"{cell(name)} {100 * index['first']:.0f} ± {100 * half:.0f} %")
    return ", ".join(parts)
