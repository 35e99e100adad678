"""Figures in the style of the paper's Figs. 4, 5 and 6, drawn as PNG and SVG."""

import io
from collections.abc import Iterable
from pathlib import Path

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from flexbeams.plant.archive import write_whole
from flexbeams.plant.text import printable
from flexbeams.scenarios.report.plots import FILES, Panel, Plot

# All in inches: a panel with its labels, its axes alone, the margins around all panels. They are fixed, since
# matplotlib's search for a layout takes as long as the drawing.
_PANEL, _AXES = (3.0, 2.3), (2.45, 1.85)
_LEFT, _RIGHT, _BOTTOM, _TOP = 0.72, -0.4, 0.5, 0.25
_COLOURS = ("#2c8a3c", "#1f4fb4", "#c43131", "#8a5a00", "#6a3d9a", "#0e7c7b")


def write_figures(plots: Iterable[Plot]) -> list[Path]:
    """Draws the plots and writes their files; returns these."""
    drawn = drawn_figures(plots)
    for path, content in drawn.items():
        write_whole(path, content)
    return list(drawn)


def drawn_figures(plots: Iterable[Plot]) -> dict[Path, bytes]:
    """The files <stem>.png and <stem>.svg of each plot; same plot, same bytes."""
    return {path: content for plot in plots for path, content in _drawn(plot).items()}


def _drawn(plot: Plot) -> dict[Path, bytes]:
    canvas = draw(plot)
    files = {}
    for kind in FILES:
        buffer = io.BytesIO()
        with matplotlib.rc_context({"svg.hashsalt": "flexbeams", "svg.fonttype": "none"}):
            canvas.savefig(buffer, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else None)
        files[plot.stem.with_name(f"{plot.stem.name}.{kind}")] = buffer.getvalue()
    return files


def draw(plot: Plot) -> Figure:
    """The plot as a matplotlib figure."""
    columns, count = max(len(row.panels) for row in plot.rows), len(plot.rows)
    width, height = _LEFT + columns * _PANEL[0] + _RIGHT, _TOP + count * _PANEL[1] + _BOTTOM
    canvas = Figure(figsize=(width, height))
    grid = canvas.subplots(count, columns, squeeze=False, sharex=True)
    for r, (row, line) in enumerate(zip(plot.rows, grid, strict=True)):
        low = _BOTTOM + (count - 1 - r) * _PANEL[1]
        for c, axis in enumerate(line):
            left = _LEFT + c * _PANEL[0]
            axis.set_position((left / width, low / height, _AXES[0] / width, _AXES[1] / height))
            _style(axis)
            if c < len(row.panels):
                _fill(axis, row.panels[c], several=row.legend != "")
            elif row.legend == "each":
                axis.set_visible(False)
        line[0].set_ylabel(printable(row.axis), fontsize=9, parse_math=False)
        line[0].yaxis.set_label_coords(-0.55 / _AXES[0], 0.5)
        for axis in line[: {"": 0, "first": 1, "each": len(row.panels)}[row.legend]]:
            _name_curves(axis)
    for column in grid.T:
        lowest = [axis for axis in column if axis.get_visible()][-1]
        lowest.tick_params(labelbottom=True)
        lowest.set_xlabel("time in s", fontsize=9)
        lowest.xaxis.set_label_coords(0.5, -0.3 / _AXES[1])
    middle = (_LEFT + columns * _PANEL[0] - _PANEL[0] + _AXES[0] + _LEFT) / 2
    canvas.suptitle(printable(plot.title), parse_math=False, fontsize=11, x=middle / width, y=1 - 0.1 / height)
    return canvas


def _fill(axis: Axes, panel: Panel, several: bool) -> None:
    for line in panel.lines:
        colour = _COLOURS[line.index % len(_COLOURS) if several else 1]
        axis.plot(
            line.time,
            line.values,
            color=colour,
            label=printable(line.label) or None,
            solid_capstyle="butt",
            linewidth=3.3 if line.style == "wide" else 1.1,
            alpha=1.0 if line.style == "own" else 0.5,
        )
    axis.set_title(printable(panel.title), fontsize=9, y=1.0, parse_math=False)


def _name_curves(axis: Axes) -> None:
    if not axis.get_legend_handles_labels()[1]:
        return
    for text in axis.legend(fontsize=8, frameon=False).get_texts():
        text.set_parse_math(False)


def _style(axis: Axes) -> None:
    for scale in (axis.xaxis, axis.yaxis):
        scale.set_major_locator(MaxNLocator(5, steps=(1, 2, 2.5, 5, 10)))
    axis.grid(alpha=0.3, linewidth=0.5)
    axis.tick_params(labelsize=8)
    axis.margins(x=0)
