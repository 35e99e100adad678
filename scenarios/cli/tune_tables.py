"""Progress and table of `flexbeams tune`."""

from collections.abc import Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from flexbeams.scenarios.cli.options import note
from flexbeams.scenarios.cli.tables import console
from flexbeams.scenarios.runs.progress import terminal_bars
from flexbeams.scenarios.studies.tuning import Progress as Report
from flexbeams.scenarios.studies.tuning import Tuning

_LINES = 10  # of progress where there is no terminal


@contextmanager
def tuning_progress() -> Iterator[Report]:
    """A bar on a terminal; elsewhere a line for every tenth of the search."""
    shown = terminal_bars(TextColumn("{task.fields[state]}"), BarColumn(bar_width=30), TimeRemainingColumn())
    if shown is None:
        yield _plain
        return
    with shown as bars:
        task = bars.add_task("", state="")
        yield lambda done, total, best: bars.update(task, completed=done, total=total, state=_state(done, total, best))


def _plain(done: int, total: int, best: float) -> None:
    if done % max(1, total // _LINES) == 0:
        note(_state(done, total, best))


def _state(done: int, total: int, best: float) -> str:
    return f"{done} of {total} candidates, best worst-case decay {best:.3g} s"


def show_tuning(found: Tuning) -> None:
    """The front as a table; the chosen point is marked."""
    out = console()
    problem = found.problem
    out.print(
        f"{found.evaluated} candidates, {found.feasible} of them meet the requirements; without control the "
        f"disturbance takes {problem.open_decay:.2f} s to decay"
    )
    table = Table(title="Pareto front", title_justify="left")
    for heading in ("", "decay, s", "times faster", "worst, s", "voltage, V", "noise, V rms", "disk margin"):
        table.add_column(heading, justify="right")
    table.add_row("published", *found.published.texts(problem.open_decay), style="dim")
    for k, point in enumerate(found.front):
        mark = " ←" if k == found.chosen else ""
        table.add_row(f"{k + 1}{mark}", *point.candidate.texts(problem.open_decay))
    out.print(table)
