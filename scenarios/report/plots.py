"""Content of a figure, independent of the recording and of the plotting library."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from flexbeams.plant.basis import Array

FILES = ("png", "svg")  # kinds of files of a figure
MAX_POINTS = 4000  # of a curve
Style = Literal[
    "own", "below", "wide"
]  # uppermost curve; faint curve below it; curve wider than the one that covers it


@dataclass(frozen=True, kw_only=True)
class Line:
    """One curve of a panel."""

    time: Array  # (rows,), s
    values: Array  # (rows,), in the displayed unit
    label: str
    index: int  # of the curve in the row, the same in all its panels
    style: Style


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Overlaid curves; the last is on top."""

    title: str
    lines: list[Line]


@dataclass(frozen=True, kw_only=True)
class PlotRow:
    """Panels beside each other, of one quantity or each of its own."""

    axis: str  # quantity and unit of all
    legend: Literal["", "first", "each"]  # the panels with names of curves: none, the first for all, or each
    panels: list[Panel]


@dataclass(frozen=True, kw_only=True)
class Plot:
    """A figure and the path of its files."""

    stem: Path  # without .png and .svg
    title: str
    rows: list[PlotRow]
