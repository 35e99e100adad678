"""Page and figure of a comparison: the signals of finished runs overlaid, their checks and metrics side by side."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.archive import write_whole
from flexbeams.scenarios.report.decimation import thinned
from flexbeams.scenarios.report.figure_plots import plot_rows
from flexbeams.scenarios.report.page import render
from flexbeams.scenarios.report.panels import panel
from flexbeams.scenarios.results.compare import Comparison, check_table, fact_table, metric_table
from flexbeams.scenarios.results.curves import Curve, curve
from flexbeams.scenarios.results.differences import common_rows
from flexbeams.scenarios.results.long_files import recorded_rows
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.row_file import RowFile


def write_comparison(comparison: Comparison, folder: Path) -> list[Path]:
    """Writes compare.html, compare.png and compare.svg; returns the files."""
    from flexbeams.scenarios.report.figures import write_figures

    drawn = _drawn(comparison)
    title = " and ".join(run.label for run in comparison.runs)
    page = folder / "compare.html"
    write_whole(page, _html(comparison, drawn, title).encode("utf-8", "replace"))
    stop = max(float(run.recording.time[-1]) for run in comparison.runs)
    rows = [_curves(drawn, name) for name in _figure_arrays(comparison)]
    return [page, *write_figures([plot_rows(rows, title, folder / "compare", 0.0, stop, wide=True)])]


def comparison_html(comparison: Comparison, title: str) -> str:
    """The page; equal runs give equal bytes except for the durations."""
    return _html(comparison, _drawn(comparison), title)


def _drawn(comparison: Comparison) -> Comparison:
    """The comparison with recordings in memory that are drawn as its own."""
    return replace(comparison, runs=[replace(r, recording=thinned(r.recording)) for r in comparison.runs])


def _html(comparison: Comparison, drawn: Comparison, title: str) -> str:
    groups = [*_groups(drawn), *_difference_groups(comparison)]
    return render(
        "compare.html.j2",
        title=title,
        labels=[run.label for run in comparison.runs],
        facts=fact_table(comparison),
        checks=check_table(comparison),
        metrics=metric_table(comparison),
        groups=groups,
        data={"groups": groups},
    )


def _difference_groups(comparison: Comparison) -> list[dict[str, Any]]:
    """A group of panels for each further run: its differences from the first run, for the arrays of the figure."""
    first, *others = comparison.runs
    groups = []
    for run in others:
        recording = _gaps(first.recording, run.recording, comparison.signals)
        curves = [curve(name, recording) for name in _figure_arrays(comparison)]
        drawn = [c for c in curves if np.any(recording.values[:, c.columns])]
        panels = [panel(f"{c.label} {c.element(e)}", [(c, e, c.label)]) for c in drawn for e in range(len(c.columns))]
        notes = [f"{c.label} is equal" for c in curves if c not in drawn]
        title = f"Difference of {run.label} from {first.label}"
        groups.append({"title": title, "window": None, "panels": panels, "notes": notes})
    return groups


def _gaps(first: Recording, other: Recording, signals: list[str]) -> Recording:
    """The differences of two recordings at their common times, in memory, as they are drawn."""
    if first.file is None and other.file is None:
        (rows,) = common_rows(first, other, signals)
        gap = rows.other - rows.first
        return Recording(time=rows.time, columns=signals, values=gap, wall_seconds=float("nan"))
    file = RowFile(signals)
    for rows in common_rows(first, other, signals):
        file.append(np.column_stack([rows.time, rows.other - rows.first]))
    found = recorded_rows(file, signals)
    drawn = thinned(found)
    found.release()
    return drawn


def _groups(comparison: Comparison) -> list[dict[str, Any]]:
    """A group of panels for each array; arrays that repeat another one or are constant are named at the end."""
    groups: list[dict[str, Any]] = []
    drawn: list[tuple[str, list[Curve]]] = []
    notes: list[str] = []
    first = _figure_arrays(comparison)
    for name in [*first, *(n for n in comparison.arrays if n not in first)]:
        curves = _curves(comparison, name)
        if twin := next((n for n, others in drawn if _equal(curves, others)), None):
            notes.append(f"{name} = {twin}")
            continue
        if all(np.ptp(c.recording.values[:, c.columns], axis=0).max() == 0 for c in curves):
            notes.append(f"{name} is constant")
            continue
        drawn.append((name, curves))
        panels = [
            panel(curves[0].element(e), [(c, e, c.label) for c in curves], background=True)
            for e in range(len(curves[0].columns))
        ]
        groups.append({"title": name, "window": None, "panels": panels, "notes": []})
    if notes:
        text = f"In every run: {'; '.join(notes)}"
        groups.append({"title": "Not drawn", "window": None, "panels": [], "notes": [text]})
    return groups


def _curves(comparison: Comparison, name: str) -> list[Curve]:
    return [curve(name, run.recording, run.label) for run in comparison.runs]


def _equal(curves: list[Curve], others: list[Curve]) -> bool:
    return all(
        np.array_equal(c.recording.values[:, c.columns], o.recording.values[:, o.columns])
        for c, o in zip(curves, others, strict=True)
    )


def _figure_arrays(comparison: Comparison) -> list[str]:
    """Arrays for the figure: deflections and voltages of the plants, or the first arrays where there is no plant."""
    plants = [name.removesuffix(".y_pi") for name in comparison.arrays if name.endswith(".y_pi")]
    signals = [f"{plant}.{base}" for plant in plants for base in ("y_pi", "u")]
    return [name for name in signals if name in comparison.arrays] or comparison.arrays[:3] or comparison.signals[:8]
