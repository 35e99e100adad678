"""Progress of running scenarios on stderr: a bar for each on a terminal, plain lines elsewhere."""

import sys
from types import TracebackType
from typing import TYPE_CHECKING

from flexbeams.plant.text import printable

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn, TaskID

ALL = "all"  # name of the bar that counts scenarios


def terminal_bars(*columns: "ProgressColumn") -> "Progress | None":
    """Bars on stderr that go when they stop; None where that is no terminal.

    Output to stdout, which may be a file, is not redirected.
    """
    if not sys.stderr.isatty():
        return None
    from rich.console import Console
    from rich.progress import Progress

    return Progress(
        *columns,
        console=Console(stderr=True, highlight=False),
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
    )


def _scenario_bars() -> "Progress | None":
    from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeRemainingColumn

    return terminal_bars(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        TextColumn("{task.fields[state]}"),
        TimeRemainingColumn(elapsed_when_finished=True),
    )


class Display:
    """Notes and progress of the scenarios named; with several, notes carry the scenario's name."""

    def __init__(self, names: list[str]) -> None:
        self._names = names
        self._tasks: dict[str, TaskID] = {}
        self._ended = 0
        self._bars = _scenario_bars() if sys.stderr.isatty() else None

    def __enter__(self) -> "Display":
        if self._bars is not None:
            self._bars.start()
            self._task(self._names[0] if len(self._names) == 1 else ALL)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars is not None:
            self._bars.stop()

    def note(self, text: str, name: str = "") -> None:
        """One line, above the bars."""
        line = printable(f"{name}: {text}" if name and len(self._names) > 1 else text)
        if self._bars is not None:
            self._bars.console.print(line, markup=False, soft_wrap=True)
        else:
            print(line, file=sys.stderr, flush=True)

    def progress(self, name: str, done: int, steps: int) -> None:
        """Moves a scenario's bar."""
        if self._bars is not None:
            state = f"{done} of {steps} steps" if done < steps else "finishing"
            self._bars.update(self._task(name), completed=done, total=steps, state=state)

    def begin(self, name: str) -> None:
        """One of several scenarios has started; its bar appears."""
        if self._bars is not None:
            self._task(name)
            self._count()
        elif len(self._names) > 1:
            self.note("started", name)

    def end(self, name: str, text: str) -> None:
        """One of several scenarios has ended; a line replaces its bar."""
        self._ended += 1
        if self._bars is not None:
            if name in self._tasks:
                self._bars.remove_task(self._tasks.pop(name))
            self._count()
        if len(self._names) > 1:  # the caller says how a single one ended
            self.note(text, name)

    def _count(self) -> None:
        assert self._bars is not None
        count = len(self._names)
        if count == 1:
            return
        self._bars.update(self._task(ALL), completed=self._ended, total=count, state=f"{self._ended} of {count} done")

    def _task(self, name: str) -> "TaskID":
        assert self._bars is not None
        from rich.markup import escape

        if name not in self._tasks:
            width = max(map(len, [*self._names, ALL] if len(self._names) > 1 else self._names))
            self._tasks[name] = self._bars.add_task(escape(printable(f"{name:{width}}")), total=None, state="preparing")
        return self._tasks[name]
