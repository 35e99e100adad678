"""Finished runs side by side: their common signals, checks and metrics."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.results.curves import DISPLAY_UNITS, array_name, quantity_of
from flexbeams.scenarios.results.display import number, verdict
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.simulation.recording import Recording

_KEYS = ("scenario", "title", "checks", "metrics", "timing", "coupling", "backend", "design_id", "complete")
_FACTS = {"title": "Title", "backend": "Backend", "coupling": "Coupling", "design_id": "Design id"}


@dataclass(frozen=True, kw_only=True)
class FinishedRun:
    """Results of `flexbeams run` in a folder."""

    label: str
    folder: Path
    summary: dict[str, Any]
    recording: Recording


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Runs with signals in common."""

    runs: list[FinishedRun]
    arrays: list[str]  # recorded in every run, with the same elements
    left_out: list[str]  # recorded in some


def compare(folders: list[Path]) -> Comparison:
    """Reads at least two runs; InputError for a folder without results and for runs without comparable signals."""
    if len(folders) < 2:
        raise InputError("RUN", "must be at least two folders of results", len(folders))
    resolved = [folder.resolve() for folder in folders]
    for folder, path in zip(folders, resolved, strict=True):
        if resolved.count(path) > 1:
            raise InputError("RUN", "must be different folders", str(folder))
    names = [path.name for path in resolved]
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
        arrays.setdefault(array_name(column), []).append(column)
    return arrays


def check_table(comparison: Comparison) -> list[tuple[str, list[dict[str, str]]]]:
    """Each check's name with its measured value in each run; empty text where a run has no such check."""
    checks_by_run = [{c["name"]: c for c in run.summary["checks"]} for run in comparison.runs]
    empty = {"measured": "", "paper": "", "verdict": ""}

    def cell(record: dict[str, Any]) -> dict[str, str]:
        return {
            "measured": number(record["value"], record["unit"]) or "no value",
            "paper": number(record["paper"], record["unit"]),
            "verdict": verdict(record),
        }

    return [
        (name, [cell(checks[name]) if name in checks else empty for checks in checks_by_run])
        for name in dict.fromkeys(name for checks in checks_by_run for name in checks)
    ]


def metric_table(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """Each metric that is not a check, with its value in each run; empty text where a run has none."""
    checks = {c["name"] for run in comparison.runs for c in run.summary["checks"]}
    names = dict.fromkeys(n for run in comparison.runs for n in run.summary["metrics"] if n not in checks)

    def text(name: str, value: float | None) -> str:
        unit, factor = DISPLAY_UNITS[quantity_of(name.split(".")[1].split("[")[0]) if "." in name else "value"]
        return "" if value is None else f"{value * factor:.5g} {unit}".strip()

    return [(name, [text(name, run.summary["metrics"].get(name)) for run in comparison.runs]) for name in names]


def fact_table(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """Title, backend, coupling, design id, end and duration of each run."""
    rows = [(term, [str(run.summary[key]) for run in comparison.runs]) for key, term in _FACTS.items()]
    ends = [
        f"{run.recording.time[-1]:g} s" + ("" if run.summary["complete"] else ", incomplete") for run in comparison.runs
    ]
    walls = [number(run.summary["timing"].get("wall_s"), "s") for run in comparison.runs]
    return [*rows, ("Simulated", ends), ("Stepping loop", walls)]
