"""Plots of a recording: the figures of a scenario, and rows of curves."""

from itertools import zip_longest
from pathlib import Path

from flexbeams.scenarios.definition.schema import Figure, Scenario
from flexbeams.scenarios.report.plots import MAX_POINTS, Line, Panel, Plot, PlotRow, Style
from flexbeams.scenarios.results.curves import Curve, figure_curve
from flexbeams.scenarios.results.decimation import decimated, thinned
from flexbeams.scenarios.simulation.recording import Recording


def figure_plots(
    scenario: Scenario, recording: Recording, folder: Path, open_loop: Recording | None = None
) -> list[Plot]:
    """All figures of the scenario."""
    return [
        figure_plot(figure, scenario, recording, folder, open_loop, f"figure[{k}]")
        for k, figure in enumerate(scenario.figure, 1)
    ]


def figure_plot(
    figure: Figure, scenario: Scenario, recording: Recording, folder: Path, open_loop: Recording | None, key: str
) -> Plot:
    """A row for each entry of `rows`, a column for each element of its signals; `key` is for errors."""
    stop = figure.stop or float(recording.time[-1])
    own = thinned(recording, figure.start, stop)
    other = None if open_loop is None else thinned(open_loop, figure.start, stop)
    rows = [[figure_curve(name, own, other, figure.points, key) for name in names] for names in figure.rows]
    return plot_rows(rows, figure.title or scenario.title, folder / figure.file, figure.start, stop)


def plot_rows(rows: list[list[Curve]], title: str, stem: Path, start: float, stop: float, wide: bool = False) -> Plot:
    """Rows of overlaid curves from `start` to `stop`, s; a column for each element.

    A covered curve is drawn wide, so that it is not hidden, if it is from the same recording or `wide` is set.
    """
    drawn = [
        PlotRow(axis=row[0].axis(), legend="first" if len(row) > 1 else "", panels=_panels(row, start, stop, wide))
        for row in rows
    ]
    return Plot(stem=stem, title=title, rows=drawn)


def _panels(row: list[Curve], start: float, stop: float, wide: bool) -> list[Panel]:
    """A panel for each element; its title is that of the uppermost curve with such an element."""
    panels = []
    for c, lines in enumerate(zip_longest(*(_lines(row, k, start, stop, wide) for k in range(len(row))))):
        title = next(curve.element(c) for curve in reversed(row) if c < len(curve.columns))
        panels.append(Panel(title=title, lines=[line for line in lines if line]))
    return panels


def _lines(row: list[Curve], k: int, start: float, stop: float, wide: bool) -> list[Line]:
    """Curve k of a row, a line for each element."""
    curve = row[k]
    style: Style = "own"
    if k < len(row) - 1:
        style = "wide" if wide or curve.recording is row[-1].recording else "below"
    inside = (curve.recording.time >= start) & (curve.recording.time <= stop)
    time, factor = curve.recording.time[inside], curve.factor
    lines = []
    for column in curve.columns:
        t, y = decimated(time, curve.recording.values[inside, column], MAX_POINTS)
        lines.append(Line(time=t, values=y * factor, label=curve.label, index=k, style=style))
    return lines
