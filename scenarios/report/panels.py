"""Interactive plots of a page: groups of panels with their curves and data."""

from typing import Any

import numpy as np

from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.report.overview import overview
from flexbeams.scenarios.report.page import float32
from flexbeams.scenarios.results.curves import Curve, align, figure_curve
from flexbeams.scenarios.results.decimation import plotted_rows
from flexbeams.scenarios.simulation.recording import Recording

MAX_ROWS = 2000  # of a panel


def panel(
    title: str, curves: list[tuple[Curve, int, str]], background: bool = False, stop: float = np.inf
) -> dict[str, Any]:
    """One plot of the elements (curve, element, label) over time; `background`: the last is drawn over the others.

    The rows are those that any of the curves needs, so that every plotted value is a recorded one.
    """
    first = curves[0][0]
    time, values = align([(c, element) for c, element, _ in curves])
    rows = plotted_rows(values[: np.searchsorted(time, stop, side="right")], MAX_ROWS)
    return {
        "title": title,
        "axis": first.axis(),
        "unit": first.unit,
        "time": float32(time[rows]),
        "curves": [
            {"label": label, "values": float32(values[rows, k]), "below": background and k < len(curves) - 1}
            for k, (_, _, label) in enumerate(curves)
        ],
    }


def figure_groups(scenario: Scenario, recording: Recording, open_loop: Recording | None) -> list[dict[str, Any]]:
    """A group of panels for each figure of the scenario: a panel for each element of each row, until the run ends."""
    groups, end = [], float(recording.time[-1])
    for k, figure in enumerate(scenario.figure, 1):
        panels = []
        for names in figure.rows:
            row = [figure_curve(name, recording, open_loop, figure.points, f"figure[{k}]") for name in names]
            for e in range(max(len(c.columns) for c in row)):
                elements = [(c, e, c.label) for c in row if e < len(c.columns)]
                panels.append(panel(elements[0][0].element(e), elements, background=True, stop=end))
        window = [figure.start, figure.stop or end]
        groups.append(
            {
                "title": figure.title or scenario.title,
                "window": window if window != [0.0, end] else None,
                "panels": panels,
                "notes": [],
            }
        )
    return groups


def remaining_signals_group(scenario: Scenario, recording: Recording) -> dict[str, Any] | None:
    """The recorded arrays that no figure of the scenario contains, all elements in one panel."""
    found = overview(recording, {name for figure in scenario.figure for row in figure.rows for name in row})
    if not found.curves and not found.notes:
        return None
    panels = [panel(c.label, [(c, e, c.element(e)) for e in range(len(c.columns))]) for c in found.curves]
    title = "Further signals" if scenario.figure else "Recorded signals"
    return {"title": title, "window": None, "panels": panels, "notes": found.notes}
