"""A child process that draws the figures of a run: it imports the plotting library while the run steps.

The child runs `serve`: it reads pickled plots from standard input and writes the files' contents, pickled, to standard
output. It writes no file itself, so that it cannot write one after its run has been killed.
"""

import pickle
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

from flexbeams.scenarios.processes.children import python_command, python_environment
from flexbeams.scenarios.processes.interrupt import ignore_interrupts_in_children
from flexbeams.scenarios.report.plots import Plot

_PROGRAM = "from flexbeams.scenarios.report.figure_process import serve; serve()"


class FigureProcess:
    """Draws plots while the caller works; the caller draws them if the process fails."""

    def __init__(self) -> None:
        with ignore_interrupts_in_children():
            self._process = subprocess.Popen(
                python_command("-c", _PROGRAM),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=python_environment(),
            )
        self._plots: Sequence[Plot] = ()

    def __enter__(self) -> "FigureProcess":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.communicate()

    def start(self, plots: Sequence[Plot]) -> None:
        """Starts drawing the plots."""
        self._plots = plots
        assert self._process.stdin is not None
        try:
            pickle.dump(plots, self._process.stdin)
            self._process.stdin.flush()
        except OSError:  # the process has ended: wait draws
            pass

    def wait(self) -> dict[Path, bytes]:
        """Waits for the contents of the files."""
        assert self._process.stdout is not None
        try:
            drawn: dict[Path, bytes] = pickle.load(self._process.stdout)
        except (EOFError, OSError, pickle.UnpicklingError):
            from flexbeams.scenarios.report.figures import drawn_figures

            return drawn_figures(self._plots)
        return drawn


def serve() -> None:
    """Draws one list of plots."""
    from matplotlib.artist import Artist

    # Help texts of `Artist.set`, which nobody reads in this process, are a third of the time to import matplotlib
    Artist._update_set_signature_and_docstring = classmethod(lambda cls: None)  # type: ignore[attr-defined]
    from flexbeams.scenarios.report.figures import drawn_figures

    drawn = drawn_figures(pickle.load(sys.stdin.buffer))
    pickle.dump(drawn, sys.stdout.buffer)
