"""Page and figure of a comparison: the signals of finished runs overlaid, their checks and metrics side by side."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.archive import write_whole
from flexbeams.scenarios.report.figure_plots import plot_rows
from flexbeams.scenarios.report.page import render
from flexbeams.scenarios.report.panels import panel
from flexbeams.scenarios.results.compare import Comparison, check_table, fact_table, figure_arrays, metric_table
from flexbeams.scenarios.results.curves import Curve, curve
from flexbeams.scenarios.results.decimation import thinned
from flexbeams.scenarios.results.differences import RunDifference, run_differences


def write_comparison(
    comparison: Comparison, folder: Path, differences: Sequence[RunDifference] | None = None
) -> list[Path]:
    """Writes compare.html, compare.png and compare.svg; returns the files.

    `differences` are those of the comparison where they are known.
    """
    from flexbeams.scenarios.report.figures import write_figures

    drawn = _drawn(comparison)
    title = " and ".join(run.label for run in comparison.runs)
    page = folder / "compare.html"
    write_whole(page, _html(comparison, drawn, title, differences).encode("utf-8", "replace"))
    stop = max(float(run.recording.time[-1]) for run in comparison.runs)
    rows = [_curves(drawn, name) for name in figure_arrays(comparison)]
    return [page, *write_figures([plot_rows(rows, title, folder / "compare", 0.0, stop, wide=True)])]


def comparison_html(comparison: Comparison, title: str, differences: Sequence[RunDifference] | None = None) -> str:
    """The page, with `differences` where they are known; equal runs give equal bytes except for the durations."""
    return _html(comparison, _drawn(comparison), title, differences)


def _drawn(comparison: Comparison) -> Comparison:
    """The comparison with recordings in memory that are drawn as its own."""
    return replace(comparison, runs=[replace(r, recording=thinned(r.recording)) for r in comparison.runs])


def _html(comparison: Comparison, drawn: Comparison, title: str, differences: Sequence[RunDifference] | None) -> str:
    differences = run_differences(comparison) if differences is None else differences
    groups = [*_groups(drawn), *_difference_groups(comparison, differences)]
    return render(
        "compare.html.j2",
        title=title,
        labels=[run.label for run in comparison.runs],
        facts=fact_table(comparison),
        spans=[d.span for d in differences],
        checks=check_table(comparison),
        metrics=metric_table(comparison),
        groups=groups,
        data={"groups": groups},
    )


def _difference_groups(comparison: Comparison, differences: Sequence[RunDifference]) -> list[dict[str, Any]]:
    """A group of panels for each further run: its differences from the first run, for the arrays of the figure."""
    first, groups = comparison.runs[0], []
    for difference in differences:
        recording = difference.gaps
        curves = [curve(name, recording) for name in figure_arrays(comparison)]
        drawn = [c for c in curves if np.any(recording.values[:, c.columns])]
        panels = [panel(f"{c.label} {c.element(e)}", [(c, e, c.label)]) for c in drawn for e in range(len(c.columns))]
        notes = [f"{c.label} is equal" for c in curves if c not in drawn]
        title = f"Difference of {difference.label} from {first.label}"
        groups.append({"title": title, "window": None, "panels": panels, "notes": notes})
    return groups


def _groups(comparison: Comparison) -> list[dict[str, Any]]:
    """A group of panels for each array; arrays that repeat another one or are constant are named at the end."""
    groups: list[dict[str, Any]] = []
    drawn: list[tuple[str, list[Curve]]] = []
    notes: list[str] = []
    first = figure_arrays(comparison)
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
