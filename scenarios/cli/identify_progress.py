"""Progress of an identification on stderr: a bar for each stage on a terminal, plain lines elsewhere."""

from types import TracebackType

from rich.progress import BarColumn, TextColumn, TimeElapsedColumn

from flexbeams.scenarios.cli.options import note
from flexbeams.scenarios.runs.progress import terminal_bars


class StageDisplay:
    """Stages of a search and its evaluations; a stage ends as soon as it has converged."""

    def __init__(self) -> None:
        self._bars = terminal_bars(
            TextColumn("fitting {task.description}"),
            BarColumn(bar_width=30),
            TextColumn("evaluation {task.completed} of at most {task.total}"),
            TimeElapsedColumn(),
        )
        if self._bars is not None:
            self._task = self._bars.add_task("", total=1, start=True)

    def __enter__(self) -> "StageDisplay":
        if self._bars is not None:
            self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bars is not None:
            self._bars.stop()

    def stage(self, name: str) -> None:
        """A stage begins."""
        if self._bars is None:
            note(f"fitting {name}")
        else:
            self._bars.update(self._task, description=name, completed=0)

    def evaluation(self, done: int, most: int) -> None:
        """Moves the bar of the stage."""
        if self._bars is not None:
            self._bars.update(self._task, completed=done, total=most)
