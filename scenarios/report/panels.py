"""Interactive plots of a page: which curves stand in which panel, and their data."""

from typing import Any

import numpy as np

from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.report.decimation import kept_rows
from flexbeams.scenarios.report.page import float32
from flexbeams.scenarios.results.curves import SHOWN, Curve, array_of, curve, figure_curve, on_one_time
from flexbeams.scenarios.simulation.recording import Recording

LIMIT = 2000  # rows of a panel at most


def panel(
    title: str, curves: list[tuple[Curve, int, str]], referred: bool = False, stop: float = np.inf
) -> dict[str, Any]:
    """One plot of the elements (curve, element, label) over time; `referred`: the last is to be seen on the others.

    Rows are those that any of the curves needs, so that every value is one of the recording.
    """
    first = curves[0][0]
    recordings = list({id(c.recording): c.recording for c, _, _ in curves}.values())
    time, placed = on_one_time(recordings)
    rows = {id(r): v for r, v in zip(recordings, placed, strict=True)}
    values = np.column_stack([rows[id(c.recording)][:, c.places[e]] * SHOWN[c.quantity][1] for c, e, _ in curves])
    kept = kept_rows(values[: np.searchsorted(time, stop, side="right")], LIMIT)
    return {
        "title": title,
        "axis": first.axis(),
        "unit": SHOWN[first.quantity][0],
        "time": float32(time[kept]),
        "curves": [
            {"label": label, "values": float32(values[kept, k]), "below": referred and k < len(curves) - 1}
            for k, (_, _, label) in enumerate(curves)
        ],
    }


def figure_groups(scenario: Scenario, recording: Recording, open_loop: Recording | None) -> list[dict[str, Any]]:
    """A group of panels for each figure of the scenario: a panel for each element of each row, up to the run's end."""
    groups, end = [], float(recording.time[-1])
    for k, figure in enumerate(scenario.figure, 1):
        panels = []
        for names in figure.rows:
            row = [figure_curve(name, recording, open_loop, figure.points, f"figure[{k}]") for name in names]
            for e in range(max(len(c.places) for c in row)):
                shown = [(c, e, c.label) for c in row if e < len(c.places)]
                panels.append(panel(shown[0][0].element(e), shown, referred=True, stop=end))
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


def further_group(scenario: Scenario, recording: Recording) -> dict[str, Any] | None:
    """The recorded arrays that no figure of the scenario shows, all elements in one panel.

    Left out, but named in `notes`: arrays that are constant and those that repeat one shown already.
    """
    arrays = list(dict.fromkeys(map(array_of, recording.columns)))
    in_figures = {name for figure in scenario.figure for row in figure.rows for name in row}
    shown = {name: curve(name, recording) for name in arrays if name in in_figures}
    panels, constant, repeated = [], [], []
    for name in arrays:
        if name in in_figures:
            continue
        found = curve(name, recording)
        values = recording.values[:, found.places]
        twin = next((n for n, c in shown.items() if np.array_equal(recording.values[:, c.places], values)), None)
        if np.all(values == values[0]):
            constant.append(f"{name} = {', '.join(f'{v:g}' for v in values[0])}")
        elif twin:
            repeated.append(f"{name} = {twin}")
        else:
            shown[name] = found
            panels.append(panel(name, [(found, e, found.element(e)) for e in range(len(found.places))]))
    notes = [
        f"{text}: {'; '.join(names)}"
        for text, names in (("Constant throughout", constant), ("The same signal", repeated))
        if names
    ]
    return {"title": "Further signals", "window": None, "panels": panels, "notes": notes} if panels or notes else None
