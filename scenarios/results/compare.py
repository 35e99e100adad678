"""Finished runs side by side: their common signals, checks and metrics."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.declaration import by_index
from flexbeams.scenarios.definition.dimensions import KNOWN_DIMENSIONS, conversion
from flexbeams.scenarios.results.curves import array_name, display_unit
from flexbeams.scenarios.results.display import number, verdict
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.results.folder import PARTIAL
from flexbeams.scenarios.results.long_files import read_long, read_partial
from flexbeams.scenarios.results.reading import read_recording
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
    signals: list[str]  # recorded in every run, each element
    left_out: list[str]  # recorded in some


def compare(
    runs: Sequence[Path | FinishedRun],
    names: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    notify: Callable[[str], None] = lambda text: None,
) -> Comparison:
    """At least two runs, folders of results or files of other tools, which are read; the first is the reference.

    `names` and `units` are for files, see read_recording. Signals whose units of measurement are known are converted to
    those of the first run, with a note. Raises InputError for what cannot be read, and for runs
    without a common signal.
    """
    if len(runs) < 2:
        raise InputError("RUN", "must be at least two folders of results, or files", len(runs))
    resolved = [run.folder / run.label if isinstance(run, FinishedRun) else run.resolve() for run in runs]
    for given, path in zip(runs, resolved, strict=True):
        if not isinstance(given, FinishedRun) and resolved.count(path) > 1:
            raise InputError("RUN", "must be different folders", str(given))
    labels = [path.name for path in resolved]
    for option, table in (("--map", names), ("--unit", units)):
        if table and all(isinstance(run, FinishedRun) or run.is_dir() for run in runs):
            raise InputError(option, "is for files of other tools, these are folders of results", next(iter(table)))
    read = []
    for k, (given, label) in enumerate(zip(runs, labels, strict=True), 1):
        if isinstance(given, FinishedRun):
            read.append(replace(given, label=label if labels.count(label) == 1 else f"{label} ({k})"))
        else:
            own = label if labels.count(label) == 1 else str(given)
            read.append(_read(given, own, names or {}, units or {}, notify))
    read = [_with_names_of(run, read) for run in read]
    read = [read[0], *(_in_units_of(read[0], run, notify) for run in read[1:])]
    columns = [run.recording.columns for run in read]
    signals = [name for name in columns[0] if all(name in c for c in columns)]
    if not signals:
        raise InputError("RUN", f"must record the same signals: {runs[0]} and the others share none (use --map)")
    elements = [_elements(run.recording) for run in read]
    arrays = [name for name, own in elements[0].items() if all(e.get(name) == own for e in elements)]
    left_out = dict.fromkeys(array_name(name) for c in columns for name in c if name not in signals)
    return Comparison(runs=read, arrays=arrays, signals=signals, left_out=list(left_out))


def _with_names_of(run: FinishedRun, runs: list[FinishedRun]) -> FinishedRun:
    """A run from a file, whose columns without an instance get the name of the only signal that ends with theirs."""
    if run.summary:
        return run
    known = dict.fromkeys(name for other in runs if other.summary for name in other.recording.columns)

    def full(name: str) -> str:
        ends = [] if name in known else [k for k in known if k.partition(".")[2] == name]
        return ends[0] if len(ends) == 1 else name

    own = run.recording
    renamed = replace(
        own, columns=[full(n) for n in own.columns], units={full(name): unit for name, unit in own.units.items()}
    )
    return replace(run, recording=renamed)


def _in_units_of(first: FinishedRun, run: FinishedRun, notify: Callable[[str], None]) -> FinishedRun:
    """A run whose signals are in the units of measurement of the first one, where both are known.

    Signals without a known unit are taken to be in that of the first run.
    """
    recording, known = run.recording, first.recording.units
    values = recording.values
    for k, name in enumerate(recording.columns):
        one, other = recording.units.get(name, ""), known.get(name, "")
        if name not in first.recording.columns or one == other:
            continue
        found = conversion(one, other, KNOWN_DIMENSIONS, KNOWN_DIMENSIONS)
        if isinstance(found, str):
            raise InputError("RUN", f"must have comparable signals, {found}: {name} of {run.label} and {first.label}")
        if not found.trivial:
            values = np.array(values) if values is recording.values else values
            values[:, k] = values[:, k] * found.factor + found.offset
            notify(f"{run.label}: {name} is converted from {one} to {other}")
    units = {**recording.units, **{name: unit for name, unit in known.items() if name in recording.columns}}
    file = recording.file if values is recording.values else None
    return replace(run, recording=replace(recording, values=values, units=units, file=file))


def _read(
    path: Path, label: str, names: Mapping[str, str], units: Mapping[str, str], notify: Callable[[str], None]
) -> FinishedRun:
    if path.is_dir() or not path.suffix:
        return read_folder(path, label)
    return FinishedRun(label=label, folder=path, summary={}, recording=read_recording(path, names, units, notify))


def read_folder(folder: Path, label: str) -> FinishedRun:
    """The results in a folder; InputError for a folder without, or with some that cannot be read."""
    path = folder / "summary.json"
    if not path.is_file():
        raise InputError("", "is not a folder of results: it has no summary.json", source=str(folder))
    try:
        summary = json.loads(path.read_text(encoding="utf-8"))
        missing = [key for key in _KEYS if key not in summary] if isinstance(summary, dict) else list(_KEYS)
    except (OSError, ValueError):  # their texts quote the file
        raise InputError("", "is not a summary of a run: it is not JSON", source=str(path)) from None
    if isinstance(summary, dict) and summary.get("unfinished"):
        if (folder / PARTIAL).is_file():
            return FinishedRun(label=label, folder=folder, summary=summary, recording=read_partial(folder / PARTIAL))
        raise InputError("", "is of a run that was ended while it wrote its results", source=str(path))
    if missing:
        raise InputError(missing[0], "is missing: this is not a summary of a run", source=str(path))
    for suffix in (".csv", ".parquet", ".mat", ".mf4"):
        file = folder / f"results{suffix}"
        if file.is_file():
            recording = read_long(file) or (read_results(file) if suffix == ".csv" else read_recording(file, {}, {}))
            signals = summary.get("signals", {})
            recording.units = {name: signals[name]["unit"] for name in recording.columns if name in signals}
            return FinishedRun(label=label, folder=folder, summary=summary, recording=recording)
    raise InputError("", "has no results.csv or other results", source=str(folder))


def figure_arrays(comparison: Comparison) -> list[str]:
    """Arrays for the figure: deflections and voltages of the plants, or the first arrays where there is no plant."""
    plants = [name.removesuffix(".y_pi") for name in comparison.arrays if name.endswith(".y_pi")]
    signals = [f"{plant}.{base}" for plant in plants for base in ("y_pi", "u")]
    return [name for name in signals if name in comparison.arrays] or comparison.arrays[:3] or comparison.signals[:8]


def figure_signals(comparison: Comparison) -> list[str]:
    """The common signals of these arrays."""
    arrays = figure_arrays(comparison)
    return [name for name in comparison.signals if name in arrays or array_name(name) in arrays]


def _elements(recording: Recording) -> dict[str, list[str]]:
    """The columns of each recorded array, by index."""
    arrays: dict[str, list[str]] = {}
    for column in recording.columns:
        arrays.setdefault(array_name(column), []).append(column)
    return {name: by_index(own) for name, own in arrays.items()}


def check_table(comparison: Comparison) -> list[tuple[str, list[dict[str, str]]]]:
    """Each check's name with its measured value in each run; empty text where a run has no such check."""
    checks_by_run = [{c["name"]: c for c in run.summary.get("checks", [])} for run in comparison.runs]
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
    checks = {c["name"] for run in comparison.runs for c in run.summary.get("checks", [])}
    names = dict.fromkeys(n for run in comparison.runs for n in run.summary.get("metrics", {}) if n not in checks)

    def text(name: str, run: FinishedRun) -> str:
        value, column = run.summary.get("metrics", {}).get(name), name.rpartition(".")[0]
        unit, factor = display_unit(array_name(column).partition(".")[2], run.recording.units.get(column))
        return "" if value is None else f"{value * factor:.5g} {unit}".strip()

    return [(name, [text(name, run) for run in comparison.runs]) for name in names]


def fact_table(comparison: Comparison) -> list[tuple[str, list[str]]]:
    """Title, backend, coupling, design id, end and duration of each run."""
    rows = [(term, [str(run.summary.get(key, "")) for run in comparison.runs]) for key, term in _FACTS.items()]
    ends = [
        f"{run.recording.time[-1]:g} s" + ("" if run.summary.get("complete", True) else ", incomplete")
        for run in comparison.runs
    ]
    walls = [number(run.summary.get("timing", {}).get("wall_s"), "s") for run in comparison.runs]
    return [*rows, ("Simulated", ends), ("Stepping loop", walls)]
