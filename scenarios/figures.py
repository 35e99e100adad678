"""Figures of a run in the style of the paper's Figs. 4, 5 and 6."""

import io
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from plant.archive import write_whole
from plant.basis import Array
from plant.errors import InputError, suggestion
from scenarios.cosimulation import Recording
from scenarios.metrics import column_indices
from scenarios.schema import Figure, Scenario

PLOTTED = 4000   # points of a curve at most; each stretch keeps its least and its largest value
_COLOURS = ("#2c8a3c", "#1f4fb4", "#c43131", "#8a5a00")
_SHOWN = {"deflection": ("mm", 1e3), "voltage": ("V", 1.0), "strain": ("µm/m", 1e6), "force": ("N", 1.0)}
_ELEMENTS = {"deflection": "point", "voltage": "patch pair", "strain": "gauge", "force": "tip of beam"}


def quantity_of(base: str) -> str:
    """What a unit's signal is, by its variable's name without index."""
    if base in ("u", "u_ff"):
        return "voltage"
    return {"y_pm": "strain", "force": "force"}.get(base, "deflection")


def draw_figures(scenario: Scenario, recording: Recording, folder: Path,
                 open_loop: Recording | None = None) -> list[Path]:
    """Draws every figure of the scenario as PNG and SVG; returns the files."""
    written = []
    for k, figure in enumerate(scenario.figure, 1):
        canvas = draw(figure, scenario, recording, open_loop, f"figure[{k}]")
        for kind in ("png", "svg"):
            buffer = io.BytesIO()
            with matplotlib.rc_context({"svg.hashsalt": "flexbeams", "svg.fonttype": "none"}):
                canvas.savefig(buffer, format=kind, dpi=150, metadata={"Date": None} if kind == "svg" else None)
            path = folder / f"{figure.file}.{kind}"
            write_whole(path, buffer.getvalue())
            written.append(path)
    return written


@dataclass(frozen=True)
class Curve:
    """A signal array of one of the recordings, to be drawn in one row."""

    label: str
    base: str                # the variable's name without owner and index
    quantity: str            # deflection, voltage, strain or force
    recording: Recording
    places: list[int]        # columns of the recording


def draw(figure: Figure, scenario: Scenario, recording: Recording, open_loop: Recording | None, key: str) -> Canvas:
    """One figure: a row for each entry of `rows`, a column for each element of its signals."""
    rows = [[_curve(name, recording, open_loop, figure.points, key) for name in names] for names in figure.rows]
    columns = max(len(curve.places) for row in rows for curve in row)
    canvas = Canvas(figsize=(3.0 * columns + 0.6, 2.3 * len(rows) + 0.7), layout="constrained")
    axes = canvas.subplots(len(rows), columns, squeeze=False, sharex=True)
    for row, line in zip(rows, axes, strict=True):
        for c, axis in enumerate(line):
            _fill(axis, row, c, figure.start, figure.stop or recording.time[-1])
        line[0].set_ylabel(f"{row[0].quantity} in {_SHOWN[row[0].quantity][0]}", fontsize=9)
        if len(row) > 1:
            line[0].legend(fontsize=8, frameon=False)
    for axis in axes[-1]:
        axis.set_xlabel("time in s", fontsize=9)
    canvas.suptitle(figure.title or scenario.title, fontsize=11)
    return canvas


def _fill(axis: Axes, row: list[Curve], c: int, start: float, stop: float) -> None:
    """Draws element c of a row's curves over each other; a reference below is wider, so that it is not hidden."""
    for s, curve in enumerate(row):
        if c >= len(curve.places):
            continue
        shown = (curve.recording.time >= start) & (curve.recording.time <= stop)
        t, y = decimated(curve.recording.time[shown], curve.recording.values[shown, curve.places[c]], PLOTTED)
        below = len(row) - 1 - s
        wide = below and curve.recording is row[-1].recording
        axis.plot(t, y * _SHOWN[curve.quantity][1], color=_COLOURS[s if len(row) > 1 else 1], label=curve.label,
                  linewidth=3.3 if wide else 1.1, alpha=0.5 if below else 1.0, solid_capstyle="butt")
        column = curve.recording.columns[curve.places[c]]
        number = column[column.rindex("[") + 1:-1] if column.endswith("]") else ""
        axis.set_title(f"{_ELEMENTS[curve.quantity]} {number}" if number else curve.base, fontsize=9)
    axis.grid(alpha=0.3, linewidth=0.5)
    axis.tick_params(labelsize=8)
    axis.margins(x=0)


def decimated(time: Array, values: Array, limit: int) -> tuple[Array, Array]:
    """At most about `limit` points; of every stretch the least and the largest value stay, so no peak is lost."""
    stretch = int(np.ceil(2 * len(time) / limit))
    if stretch <= 2:
        return time, values
    whole = len(time) // stretch * stretch
    blocks = values[:whole].reshape(-1, stretch)
    first = np.arange(len(blocks)) * stretch
    kept = np.sort(np.concatenate([first + blocks.argmin(axis=1), first + blocks.argmax(axis=1),
                                   np.arange(whole, len(time)), [0, len(time) - 1]]))
    kept = np.unique(kept)
    return time[kept], values[kept]


def _curve(name: str, recording: Recording, open_loop: Recording | None, points: list[int] | None, key: str) -> Curve:
    label, source = name, recording
    if name.startswith("open_loop."):
        if open_loop is None:
            raise InputError(f"{key}.rows", "needs the scenario's key open_loop", name)
        name, source, label = name.removeprefix("open_loop."), open_loop, "without control"
    places = column_indices(source.columns, name)
    if not places:
        known = dict.fromkeys(c.split("[")[0] for c in source.columns)
        raise InputError(f"{key}.rows", "names a signal that is not recorded" + suggestion(name, known), name)
    base = name.split(".", 1)[1].split("[")[0]
    return Curve(label, base, quantity_of(base), source,
                 [places[p - 1] for p in points if p <= len(places)] if points else places)
