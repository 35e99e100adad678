"""Recorded signals that no figure of a scenario contains: which arrays are drawn, and a figure of them for packages."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexbeams.scenarios.report.plots import MAX_POINTS, Line, Panel, Plot, PlotRow
from flexbeams.scenarios.results.curves import Curve, array_names, curve
from flexbeams.scenarios.results.decimation import decimated
from flexbeams.scenarios.simulation.recording import Recording

OVERVIEW = "signals"  # name of the figure's files
_COLUMNS = 3  # of panels
_MAX_PANELS = 24  # of the figure
_MAX_ARRAYS = 300  # of a page
_MAX_NAMES = 8  # of the curves of a panel


@dataclass(frozen=True, kw_only=True)
class Overview:
    """Arrays to draw, and in one line each why others are not."""

    curves: list[Curve]
    notes: list[str]


def overview(recording: Recording, in_figures: Collection[str] = ()) -> Overview:
    """The recorded arrays but those in figures; what is constant or repeats another array is named in the notes."""
    arrays = array_names(recording.columns)
    drawn = {name: curve(name, recording) for name in arrays if name in in_figures}
    chosen: list[Curve] = []
    constant, repeated, left = [], [], 0
    for name in arrays:
        if name in in_figures:
            continue
        candidate = curve(name, recording)
        values = recording.values[:, candidate.columns]
        twin = next((n for n, c in drawn.items() if np.array_equal(recording.values[:, c.columns], values)), None)
        if np.all(values == values[0]):
            constant.append(f"{name} = {', '.join(f'{v:g}' for v in values[0])}")
        elif twin:
            repeated.append(f"{name} = {twin}")
        elif len(chosen) == _MAX_ARRAYS:
            left += 1
        else:
            drawn[name] = candidate
            chosen.append(candidate)
    notes = [
        f"{text}: {'; '.join(names)}"
        for text, names in (("Constant throughout", constant), ("The same signal", repeated))
        if names
    ]
    return Overview(curves=chosen, notes=notes + ([f"Not drawn: {left} further arrays"] if left else []))


def overview_plot(recording: Recording, title: str, folder: Path) -> Plot | None:
    """A panel for each array with all its elements, the constant ones where there are no others; None without any."""
    curves = overview(recording).curves or [curve(name, recording) for name in array_names(recording.columns)]
    if not curves:
        return None
    if len(curves) > _MAX_PANELS:
        title = f"{title} ({_MAX_PANELS} of {len(curves)} signals)"
    panels = [_panel(c) for c in curves[:_MAX_PANELS]]
    rows = [panels[k : k + _COLUMNS] for k in range(0, len(panels), _COLUMNS)]
    return Plot(stem=folder / OVERVIEW, title=title, rows=[PlotRow(axis="", legend="each", panels=row) for row in rows])


def _panel(c: Curve) -> Panel:
    lines = []
    for k, column in enumerate(c.columns):
        time, values = decimated(c.recording.time, c.recording.values[:, column], MAX_POINTS)
        label = c.element(k) if 1 < len(c.columns) <= _MAX_NAMES else ""
        lines.append(Line(time=time, values=values * c.factor, label=label, index=k, style="own"))
    return Panel(title=f"{c.label} in {c.unit}" if c.unit else c.label, lines=lines)
