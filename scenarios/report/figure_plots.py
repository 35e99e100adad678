"""Plots of a run from its recording: the figures that a scenario asks for, and rows of curves."""

from itertools import zip_longest
from pathlib import Path

from flexbeams.scenarios.definition.schema import Figure, Scenario
from flexbeams.scenarios.report.decimation import decimated
from flexbeams.scenarios.report.plots import Line, Panel, Plot, PlotRow, Style
from flexbeams.scenarios.results.curves import SHOWN, Curve, figure_curve
from flexbeams.scenarios.simulation.recording import Recording

PLOTTED = 4000  # points of a curve at most; each stretch keeps its least and its largest value


def figure_plots(
    scenario: Scenario, recording: Recording, folder: Path, open_loop: Recording | None = None
) -> list[Plot]:
    """Every figure of the scenario."""
    return [
        figure_plot(figure, scenario, recording, folder, open_loop, f"figure[{k}]")
        for k, figure in enumerate(scenario.figure, 1)
    ]


def figure_plot(
    figure: Figure, scenario: Scenario, recording: Recording, folder: Path, open_loop: Recording | None, key: str
) -> Plot:
    """A row for each entry of `rows`, a column for each element of its signals; `key` is for errors."""
    rows = [[figure_curve(name, recording, open_loop, figure.points, key) for name in names] for names in figure.rows]
    return plot_rows(
        rows, figure.title or scenario.title, folder / figure.file, figure.start, figure.stop or recording.time[-1]
    )


def plot_rows(rows: list[list[Curve]], title: str, stem: Path, start: float, stop: float, wide: bool = False) -> Plot:
    """Curves of a row over each other, from `start` to `stop` in s; a column for each element.

    A curve below others is wide, so that it is not hidden, where it is of their recording, or `wide` is set.
    """
    return Plot(
        stem=stem,
        title=title,
        rows=[
            PlotRow(
                axis=row[0].axis(),
                legend=len(row) > 1,
                panels=[
                    Panel(
                        title=next(curve.element(c) for curve in reversed(row) if c < len(curve.places)),
                        lines=[line for line in column if line],
                    )
                    for c, column in enumerate(
                        zip_longest(*(_lines(row, s, start, stop, wide) for s in range(len(row))))
                    )
                ],
            )
            for row in rows
        ],
    )


def _lines(row: list[Curve], s: int, start: float, stop: float, wide: bool) -> list[Line]:
    """Curve s of a row, a line for each element."""
    curve = row[s]
    style: Style = "own"
    if s < len(row) - 1:
        style = "wide" if wide or curve.recording is row[-1].recording else "below"
    shown = (curve.recording.time >= start) & (curve.recording.time <= stop)
    time, factor = curve.recording.time[shown], SHOWN[curve.quantity][1]
    lines = []
    for place in curve.places:
        t, y = decimated(time, curve.recording.values[shown, place], PLOTTED)
        lines.append(Line(time=t, values=y * factor, label=curve.label, place=s, style=style))
    return lines
