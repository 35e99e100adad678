"""A process beside a run that draws its figures: it imports the plotting library while the run steps."""

import multiprocessing
from collections.abc import Sequence
from multiprocessing.connection import Connection
from types import TracebackType

from scenarios.interrupt import deaf_children
from scenarios.plots import Plot


class FigureProcess:
    """Draws plots beside what the caller does; what it cannot draw is drawn by the caller."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._line, end = context.Pipe()
        self._process = context.Process(target=_serve, args=(end,), daemon=True)
        with deaf_children():
            self._process.start()
        end.close()
        self._plots: Sequence[Plot] = ()
        self._lost = False

    def __enter__(self) -> "FigureProcess":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self._line.close()
        self._process.terminate()
        self._process.join()

    def begin(self, plots: Sequence[Plot]) -> None:
        """Hands the plots over and returns at once."""
        self._plots = plots
        try:
            self._line.send(plots)
        except OSError:
            self._lost = True

    def finish(self) -> None:
        """Waits for the files; errors as of writing them."""
        try:
            drawn = not self._lost and self._line.recv()
        except (EOFError, OSError):
            drawn = False
        if not drawn:
            from scenarios.figures import write_figures

            write_figures(self._plots)


def _serve(line: Connection) -> None:
    """Draws one list of plots, and tells whether it did."""
    from scenarios.figures import write_figures

    try:
        plots = line.recv()
    except EOFError:
        return
    try:
        write_figures(plots)
    except OSError:
        line.send(False)
    else:
        line.send(True)
