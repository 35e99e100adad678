"""Finished runs beside each other: their signals over each other, their checks and metrics side by side."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.archive import write_whole
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.report.figure_plots import plot_rows
from flexbeams.scenarios.report.page import render
from flexbeams.scenarios.report.panels import panel
from flexbeams.scenarios.results.curves import SHOWN, Curve, array_of, curve, quantity_of
from flexbeams.scenarios.results.display import number, verdict
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.simulation.recording import Recording

_KEYS = ("scenario", "title", "checks", "metrics", "timing", "coupling", "backend", "design_id", "complete")
_FACTS = {"title": "Title", "backend": "Backend", "coupling": "Coupling", "design_id": "Design id"}


@dataclass(frozen=True, kw_only=True)
class FinishedRun:
    """What `flexbeams run` left in a folder."""

    label: str
    folder: Path
    summary: dict[str, Any]
    recording: Recording


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Runs that share signals."""

    runs: list[FinishedRun]
    arrays: list[str]  # recorded in every run, with the same elements
    left_out: list[str]  # recorded in some


def compare(folders: list[Path]) -> Comparison:
    """Reads the runs; InputError for a folder that holds none, and for runs that cannot lie over each other."""
    if len(folders) < 2:
        raise InputError("RUN", "must be at least two folders of results", len(folders))
    resolved = [folder.resolve() for folder in folders]
    for folder, place in zip(folders, resolved, strict=True):
        if resolved.count(place) > 1:
            raise InputError("RUN", "must be different folders", str(folder))
    names = [place.name for place in resolved]
    runs = [
        _read(folder, name if names.count(name) == 1 else str(folder))
        for folder, name in zip(folders, names, strict=True)
    ]
    elements = [_elements(run.recording) for run in runs]
    common = [name for name in elements[0] if all(name in e for e in elements)]
    for name in common:
        for run, e in zip(runs, elements, strict=True):
            if e[name] != elements[0][name]:
                raise InputError(
                    "RUN",
                    f"must record the same signals: {name} has {len(e[name])} elements in "
                    f"{run.folder}, {len(elements[0][name])} in {runs[0].folder}",
                )
    if not common:
        raise InputError("RUN", f"must record the same signals: {runs[0].folder} and the others share none")
    union = dict.fromkeys(name for e in elements for name in e)
    return Comparison(runs=runs, arrays=common, left_out=[name for name in union if name not in common])


def _read(folder: Path, label: str) -> FinishedRun:
    path = folder / "summary.json"
    if not path.is_file():
        raise InputError("", "is not a folder of results: it has no summary.json", source=str(folder))
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
        missing = [key for key in _KEYS if key not in summary] if isinstance(summary, dict) else list(_KEYS)
    except (OSError, ValueError) as error:
        raise InputError("", f"is not a summary of a run: {error}", source=str(path)) from None
    if missing:
        raise InputError(missing[0], "is missing: this is not a summary of a run", source=str(path))
    if not (folder / "results.csv").is_file():
        raise InputError("", "has no results.csv; run the scenario again with --format csv", source=str(folder))
    return FinishedRun(label=label, folder=folder, summary=summary, recording=read_results(folder / "results.csv"))


def _elements(recording: Recording) -> dict[str, list[str]]:
    """The columns of each recorded array."""
    arrays: dict[str, list[str]] = {}
    for column in recording.columns:
        arrays.setdefault(array_of(column), []).append(column)
    return arrays


def check_table(comparison: Comparison) -> list[tuple[str, list[dict[str, str]]]]:
    """Each check's name, and for each run what it measured there; empty text where a run has no such check."""
    found = [{c["name"]: c for c in run.summary["checks"]} for run in comparison.runs]
    empty = {"measured": "", "paper": "", "verdict": ""}

    def cell(record: dict[str, Any]) -> dict[str, str]:
        return {
            "measured": number(record["value"], record["unit"]) or "no value",
            "paper": number(record["paper"], record["unit"]),
            "verdict": verdict(record),
        }

    return [
        (name, [cell(checks[name]) if name in checks else empty for checks in found])
        for name in dict.fromkeys(name for checks in found for name in checks)
    ]


def metric_table(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """Each metric's name that is not a check's, and its value in each run; empty text where a run has none."""
    checks = {c["name"] for run in comparison.runs for c in run.summary["checks"]}
    names = dict.fromkeys(n for run in comparison.runs for n in run.summary["metrics"] if n not in checks)

    def text(name: str, value: float | None) -> str:
        unit, factor = SHOWN[quantity_of(name.split(".")[1].split("[")[0]) if "." in name else "value"]
        return "" if value is None else f"{value * factor:.5g} {unit}".strip()

    return [(name, [text(name, run.summary["metrics"].get(name)) for run in comparison.runs]) for name in names]


def fact_table(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """What each run was, and how long it took."""
    rows = [(term, [str(run.summary[key]) for run in comparison.runs]) for key, term in _FACTS.items()]
    ends = [
        f"{run.recording.time[-1]:g} s" + ("" if run.summary["complete"] else ", incomplete") for run in comparison.runs
    ]
    walls = [number(run.summary["timing"].get("wall_s"), "s") for run in comparison.runs]
    return [*rows, ("Simulated", ends), ("Stepping loop", walls)]


def write_comparison(comparison: Comparison, folder: Path) -> list[Path]:
    """compare.html, compare.png and compare.svg."""
    from flexbeams.scenarios.report.figures import write_figure

    title = " and ".join(run.label for run in comparison.runs)
    page = folder / "compare.html"
    write_whole(page, comparison_html(comparison, title).encode())
    stop = max(float(run.recording.time[-1]) for run in comparison.runs)
    rows = [_over_each_other(comparison, name) for name in _drawn(comparison)]
    return [page, *write_figure(plot_rows(rows, title, folder / "compare", 0.0, stop, wide=True))]


def comparison_html(comparison: Comparison, title: str) -> str:
    """The page: equal runs give equal bytes but for the times taken."""
    groups: list[dict[str, Any]] = []
    shown: list[tuple[str, list[Curve]]] = []
    notes: list[str] = []
    first = _drawn(comparison)
    for name in [*first, *(n for n in comparison.arrays if n not in first)]:
        curves = _over_each_other(comparison, name)
        if twin := next((n for n, others in shown if _equal(curves, others)), None):
            notes.append(f"{name} = {twin}")
            continue
        if all(np.ptp(c.recording.values[:, c.places], axis=0).max() == 0 for c in curves):
            notes.append(f"{name} is constant")
            continue
        shown.append((name, curves))
        panels = [
            panel(curves[0].element(e), [(c, e, c.label) for c in curves], referred=True)
            for e in range(len(curves[0].places))
        ]
        groups.append({"title": name, "window": None, "panels": panels, "notes": []})
    if notes:
        groups.append(
            {"title": "Not drawn", "window": None, "panels": [], "notes": [f"In every run: {'; '.join(notes)}"]}
        )
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


def _over_each_other(comparison: Comparison, name: str) -> list[Curve]:
    return [curve(name, run.recording, run.label) for run in comparison.runs]


def _equal(curves: list[Curve], others: list[Curve]) -> bool:
    return all(
        np.array_equal(c.recording.values[:, c.places], o.recording.values[:, o.places])
        for c, o in zip(curves, others, strict=True)
    )


def _drawn(comparison: Comparison) -> list[str]:
    """Arrays for the figure: deflections and voltages of the plants; the first ones where there is no plant."""
    plants = [name.removesuffix(".y_pi") for name in comparison.arrays if name.endswith(".y_pi")]
    wanted = [f"{plant}.{base}" for plant in plants for base in ("y_pi", "u")]
    return [name for name in wanted if name in comparison.arrays] or comparison.arrays[:3]
