"""Interactive plots of a page: groups of panels with their curves and data."""

from typing import Any

import numpy as np

from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.report.decimation import plotted_rows
from flexbeams.scenarios.report.page import float32
from flexbeams.scenarios.results.curves import DISPLAY_UNITS, Curve, align, array_name, curve, figure_curve
from flexbeams.scenarios.simulation.recording import Recording

MAX_ROWS = 2000  # of a panel


def panel(
    title: str, curves: list[tuple[Curve, int, str]], background: bool = False, stop: float = np.inf
) -> dict[str, Any]:
    """One plot of the elements (curve, element, label) over time; `background`: the last is drawn over the others.

    The rows are those that any of the curves needs, so that every plotted value is a recorded one.
    """
    first = curves[0][0]
    recordings = list({id(c.recording): c.recording for c, _, _ in curves}.values())
    time, aligned = align(recordings)
    tables = {id(r): v for r, v in zip(recordings, aligned, strict=True)}
    values = np.column_stack(
        [tables[id(c.recording)][:, c.columns[e]] * DISPLAY_UNITS[c.quantity][1] for c, e, _ in curves]
    )
    rows = plotted_rows(values[: np.searchsorted(time, stop, side="right")], MAX_ROWS)
    return {
        "title": title,
        "axis": first.axis(),
        "unit": DISPLAY_UNITS[first.quantity][0],
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
    """The recorded arrays that no figure of the scenario contains, all elements in one panel.

    Arrays that are constant or repeat another one are not drawn but named in `notes`.
    """
    arrays = list(dict.fromkeys(map(array_name, recording.columns)))
    in_figures = {name for figure in scenario.figure for row in figure.rows for name in row}
    drawn = {name: curve(name, recording) for name in arrays if name in in_figures}
    panels, constant, repeated = [], [], []
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
        else:
            drawn[name] = candidate
            elements = [(candidate, e, candidate.element(e)) for e in range(len(candidate.columns))]
            panels.append(panel(name, elements))
    notes = [
        f"{text}: {'; '.join(names)}"
        for text, names in (("Constant throughout", constant), ("The same signal", repeated))
        if names
    ]
    return {"title": "Further signals", "window": None, "panels": panels, "notes": notes} if panels or notes else None
