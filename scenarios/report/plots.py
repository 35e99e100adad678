"""What a figure shows, free of the recording it comes from and of the library that draws it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from flexbeams.plant.basis import Array

Style = Literal["own", "below", "wide"]  # the upper curve; a faint one below it; one that shows beside a curve on it


@dataclass(frozen=True, kw_only=True)
class Line:
    """One curve of a panel."""

    time: Array  # (rows,), s
    values: Array  # (rows,), in the unit shown
    label: str
    place: int  # among the curves of the row, the same in all its panels
    style: Style


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Curves over each other; the last lies on top."""

    title: str
    lines: list[Line]


@dataclass(frozen=True, kw_only=True)
class PlotRow:
    """Panels of one quantity beside each other."""

    axis: str  # quantity and unit
    legend: bool
    panels: list[Panel]


@dataclass(frozen=True, kw_only=True)
class Plot:
    """A figure and where it goes."""

    stem: Path  # its file without .png and .svg
    title: str
    rows: list[PlotRow]
