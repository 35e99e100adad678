"""Figures of a run in the style of the paper's Figs. 4, 5 and 6."""

import io
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from plant.archive import write_whole
from scenarios.cosimulation import Recording
from scenarios.curves import SHOWN, Curve, figure_curve
from scenarios.decimation import decimated
from scenarios.schema import Figure, Scenario

PLOTTED = 4000   # points of a curve at most; each stretch keeps its least and its largest value
_COLOURS = ("#2c8a3c", "#1f4fb4", "#c43131", "#8a5a00", "#6a3d9a", "#0e7c7b")


def draw_figures(scenario: Scenario, recording: Recording, folder: Path,
                 open_loop: Recording | None = None) -> list[Path]:
    """Draws every figure of the scenario as PNG and SVG; returns the files."""
    written = []
    for k, figure in enumerate(scenario.figure, 1):
        canvas = draw(figure, scenario, recording, open_loop, f"figure[{k}]")
        written += write_figure(canvas, folder / figure.file)
    return written


def write_figure(canvas: Canvas, stem: Path) -> list[Path]:
    """<stem>.png and <stem>.svg; same figure, same bytes."""
    written = []
    canvas.draw_without_rendering()
    canvas.set_layout_engine("none")   # the layout just found holds for both files
    for kind in ("png", "svg"):
        buffer = io.BytesIO()
        with matplotlib.rc_context({"svg.hashsalt": "flexbeams", "svg.fonttype": "none"}):
            canvas.savefig(buffer, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else None)
        path = stem.with_name(f"{stem.name}.{kind}")
        write_whole(path, buffer.getvalue())
        written.append(path)
    return written


def draw(figure: Figure, scenario: Scenario, recording: Recording, open_loop: Recording | None, key: str) -> Canvas:
    """One figure: a row for each entry of `rows`, a column for each element of its signals."""
    rows = [[figure_curve(name, recording, open_loop, figure.points, key) for name in names] for names in figure.rows]
    return draw_rows(rows, figure.title or scenario.title, figure.start, figure.stop or recording.time[-1])


def draw_rows(rows: list[list[Curve]], title: str, start: float, stop: float, wide: bool = False) -> Canvas:
    """Curves of a row over each other, from `start` to `stop` in s; a column for each element.

    A curve below others is wide, so that it is not hidden, where it is of their recording, or `wide` is set.
    """
    columns = max(len(curve.places) for row in rows for curve in row)
    canvas = Canvas(figsize=(3.0 * columns + 0.6, 2.3 * len(rows) + 0.7), layout="constrained")
    axes = canvas.subplots(len(rows), columns, squeeze=False, sharex=True)
    for row, line in zip(rows, axes, strict=True):
        for c, axis in enumerate(line):
            _fill(axis, row, c, start, stop, wide)
        line[0].set_ylabel(row[0].axis(), fontsize=9)
        if len(row) > 1:
            line[0].legend(fontsize=8, frameon=False)
    for axis in axes[-1]:
        axis.set_xlabel("time in s", fontsize=9)
    canvas.suptitle(title, fontsize=11)
    return canvas


def _fill(axis: Axes, row: list[Curve], c: int, start: float, stop: float, wide: bool) -> None:
    """Draws element c of a row's curves over each other."""
    for s, curve in enumerate(row):
        if c >= len(curve.places):
            continue
        shown = (curve.recording.time >= start) & (curve.recording.time <= stop)
        t, y = decimated(curve.recording.time[shown], curve.recording.values[shown, curve.places[c]], PLOTTED)
        below = len(row) - 1 - s
        widened = below and (wide or curve.recording is row[-1].recording)
        axis.plot(t, y * SHOWN[curve.quantity][1], color=_COLOURS[s % len(_COLOURS) if len(row) > 1 else 1],
                  label=curve.label, linewidth=3.3 if widened else 1.1, alpha=0.5 if below else 1.0,
                  solid_capstyle="butt")
        axis.set_title(curve.element(c), fontsize=9)
    axis.grid(alpha=0.3, linewidth=0.5)
    axis.tick_params(labelsize=8)
    axis.margins(x=0)
