"""Experiments with reference results inside FMUs, in the formats FMI-LS-REF and MA-HS-Experiments."""

import posixpath
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np

from flexbeams.fmus.documents.xml_documents import SSV
from flexbeams.fmus.references.results import EXPERIMENTS_TYPE, FOLDER, MANIFEST, SET_TYPE
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.declaration import access_order
from flexbeams.scenarios.definition.time_table import TimeTable, read_time_table
from flexbeams.scenarios.definition.values import TypedValue, value_of_text
from flexbeams.scenarios.importing.xml_reading import read_document, schema_problems

DEFAULT_TOLERANCE = 1e-6  # of an experiment without a tolerance
MAX_STEPS = 10**6  # steps
_OLD_TYPE = "application/x-ma-ls-experiments"  # the type in FMI-LS-REF 1.0.0-alpha.1
_PARTS = ("TransientSimulation", "Parameters", "Stimuli", "References", "Annotations")


@dataclass(frozen=True, kw_only=True)
class DeclaredExperiment:
    """An experiment as a unit declares it; files are relative to `base`, a path inside the unit."""

    name: str
    base: str
    references: Any  # elements with a source
    stimuli: Any = None
    parameters: Any = None
    settings: Any = None  # has startTime and stepSize
    tolerance: str | None = None
    problem: str = ""  # reason why it cannot be run


@dataclass(frozen=True, kw_only=True)
class ReferenceRun:
    """An experiment to simulate: steps from `start` on, inputs and expected values."""

    start: float  # s
    step: float  # s
    steps_done: list[int]  # steps done at each row of the references
    tolerance: float
    parameters: dict[str, TypedValue]
    names: list[str]  # of the references, Real before Integer before Boolean
    expected: Array  # (len(steps_done), len(names))
    inputs: list[str]
    driven: Array  # (steps + 1, len(inputs))


def declared_experiments(folder: Path, description: Any) -> list[DeclaredExperiment]:
    """Experiments in the manifest of an extracted unit, and results of its default experiment."""
    manifest = _document(folder, MANIFEST)
    if manifest.tag.rpartition("}")[2] != "fmiReferences":
        raise InputError(MANIFEST, "must be a manifest of fmiReferences", manifest.tag)
    experiments = list(_experiments(manifest, MANIFEST))  # the place in drafts before 1.0.0-alpha.1
    for related in manifest.iterfind("{*}Related"):
        role, _, purpose = related.get("role", "").partition("/")
        if (
            role == "experiment"
            and purpose != "uncertainty-analysis"
            and related.get("type") in (EXPERIMENTS_TYPE, _OLD_TYPE)
        ):
            where = _member(folder, MANIFEST, related.get("source", ""))
            experiments += _experiments(_document(folder, where), where)
    referenced = {
        posixpath.normpath(posixpath.join(posixpath.dirname(e.base), e.references.get("source", "")))
        for e in experiments
        if e.references is not None
    }
    for related in manifest.iterfind("{*}Related[@role='result']"):
        source = related.get("source", "")
        if posixpath.normpath(posixpath.join(FOLDER, source)) not in referenced:
            open_inputs = any(v.causality == "input" for v in description.modelVariables)
            experiments.append(
                DeclaredExperiment(
                    name=source,
                    base=MANIFEST,
                    references=related,
                    problem="has no stimuli for the unit's inputs" if open_inputs else "",
                )
            )
    return experiments


def _experiments(root: Any, base: str) -> Iterator[DeclaredExperiment]:
    for element in root.iterfind("{*}Experiment"):
        parts = {child.tag.rpartition("}")[2]: child for child in element}
        others = [name for name in parts if name not in _PARTS]
        missing = "" if "References" in parts else "has no reference results"
        yield DeclaredExperiment(
            name=element.get("name", ""),
            base=base,
            references=parts.get("References"),
            stimuli=parts.get("Stimuli"),
            parameters=parts.get("Parameters"),
            settings=parts.get("TransientSimulation", element),
            tolerance=element.get("tolerance"),
            problem=f"{others[0]} is not supported" if others else missing,
        )


def read_reference_run(folder: Path, description: Any, experiment: DeclaredExperiment) -> ReferenceRun:
    """The files of an experiment, checked against the unit's variables; InputError for unsupported features."""
    if experiment.problem:
        raise InputError("", experiment.problem)
    variables = {v.name: v for v in description.modelVariables}
    default = description.defaultExperiment
    references = _table(folder, experiment.base, experiment.references, variables)
    settings: Any = {} if experiment.settings is None else experiment.settings
    start = _number(settings.get("startTime") or getattr(default, "startTime", None) or "0", "startTime")
    spacing = np.diff(references.time)
    step = _number(
        settings.get("stepSize")
        or getattr(default, "stepSize", None)
        or (repr(float(spacing.min())) if len(spacing) else "1"),
        "stepSize",
    )
    if step <= 0:
        raise InputError("stepSize", "must be > 0", step)
    steps_done = (references.time - start) / step
    if steps_done[0] < -1e-6 or steps_done[-1] > MAX_STEPS:
        raise InputError("References", f"must lie within {MAX_STEPS} steps of {step:g} s from {start:g} s on")
    if np.max(np.abs(steps_done - np.round(steps_done))) > 1e-6:
        raise InputError("References", f"must have rows at multiples of {step:g} s only")
    names = sorted(_selected(experiment.references, references), key=lambda n: access_order(variables[n]))
    stimuli = None if experiment.stimuli is None else _table(folder, experiment.base, experiment.stimuli, variables)
    inputs = [] if stimuli is None else stimuli.columns
    for name in inputs:
        if variables[name].causality != "input":
            raise InputError(name, "must be an input to be driven by stimuli", variables[name].causality)
    order = sorted(range(len(inputs)), key=lambda k: access_order(variables[inputs[k]]))
    times = start + step * np.arange(round(float(steps_done[-1])) + 1.0)
    return ReferenceRun(
        start=start,
        step=step,
        steps_done=np.round(steps_done).astype(int).tolist(),
        names=names,
        tolerance=_tolerance(experiment.tolerance),
        parameters=_parameters(folder, experiment, variables),
        expected=references.values[:, [references.columns.index(n) for n in names]],
        inputs=[inputs[k] for k in order],
        driven=np.zeros((len(times), 0)) if stimuli is None else values_at(stimuli, times, step, variables)[:, order],
    )


def values_at(stimuli: TimeTable, times: Array, step: float, variables: dict[str, Any]) -> Array:
    """Stimuli at each time, (k, columns): interpolated linearly between rows, discrete ones held.

    Where a time occurs twice, the last row counts.
    """
    index = np.searchsorted(stimuli.time, times + 1e-6 * step, side="right") - 1
    row, after = np.maximum(index, 0), np.minimum(index + 1, len(stimuli.time) - 1)
    gap = np.where(stimuli.time[after] > stimuli.time[row], stimuli.time[after] - stimuli.time[row], np.inf)
    fraction = np.clip((times - stimuli.time[row]) / gap, 0, 1)
    fraction[np.abs(times - stimuli.time[row]) <= 1e-6 * step] = 0.0
    continuous = np.array(
        [
            variables[n].variability not in ("discrete", "tunable") and variables[n].type == "Real"
            for n in stimuli.columns
        ]
    )
    here, there = stimuli.values[row], stimuli.values[after]
    values: Array = np.where(continuous & (fraction[:, None] > 0), here + fraction[:, None] * (there - here), here)
    return values


def _table(folder: Path, base: str, element: Any, variables: dict[str, Any]) -> TimeTable:
    """The time series of Stimuli or References."""
    source = element.get("source", "")
    if (kind := element.get("type", "text/csv")) != "text/csv":
        raise InputError(source, "must be text/csv", kind)
    if element.get("mapping"):
        raise InputError(source, "mappings are not supported", element.get("mapping"))
    table = read_time_table(folder / _member(folder, base, source), jumps=True)
    for name in table.columns:
        if name not in variables:
            raise InputError(source, "must name variables of the unit" + suggestion(name, variables), name)
        if variables[name].type == "String":
            raise InputError(source, "must be of numbers and truth values, not String", name)
    return table


def _selected(element: Any, table: TimeTable) -> list[str]:
    """The signals that References selects, by default all."""
    selected = [s.get("name", "") for s in element.iterfind("{*}Signal")]
    for name in selected:
        if name not in table.columns:
            raise InputError("Signal", "must name a column of the references" + suggestion(name, table.columns), name)
    return selected or table.columns


def _parameters(folder: Path, experiment: DeclaredExperiment, variables: dict[str, Any]) -> dict[str, TypedValue]:
    """Values of a parameter set, in the FMU's units of measurement."""
    element = experiment.parameters
    if element is None:
        return {}
    source = element.get("source", "")
    if (kind := element.get("type", SET_TYPE)) != SET_TYPE or element.get("mapping"):
        raise InputError(source, f"must be {SET_TYPE} without a mapping", kind)
    where = _member(folder, experiment.base, source)
    root = _document(folder, where)
    if problems := schema_problems(root, SSV):
        raise InputError(source, f"must be valid by the schema of SSP 1.0: {problems[0]}")
    values: dict[str, TypedValue] = {}
    for parameter in root.iterfind(f"{{{SSV}}}Parameters/{{{SSV}}}Parameter"):
        name, typed = parameter.get("name"), parameter[0]
        variable = variables.get(name)
        if (
            variable is None
            or variable.type != typed.tag.rpartition("}")[2]
            or (typed.get("unit") or variable.unit) != variable.unit
        ):
            raise InputError(source, "must have parameters of the unit, of its types and units", name)
        try:
            values[name] = value_of_text(variable, typed.get("value"))
        except ValueError as error:
            raise InputError(name, str(error)) from None
        if variable.type == "Real":
            _number(typed.get("value"), name)
    return values


def _document(folder: Path, where: str) -> Any:
    return read_document((folder / where).read_bytes(), where)


def _member(folder: Path, base: str, source: str) -> str:
    """Path inside the FMU of a file named relative to `base`; nothing outside is opened."""
    try:
        parts = urlsplit(source)
    except ValueError as error:
        raise InputError(source, f"must be a path inside the unit: {error}") from None
    where = posixpath.normpath(posixpath.join(posixpath.dirname(base), unquote(parts.path)))
    if parts.scheme or parts.netloc or where.startswith(("..", "/")) or "\\" in where or "\0" in where:
        raise InputError(source, "must be a path inside the unit")
    try:
        exists = (folder / where).is_file()
    except OSError:  # a name that the system does not allow
        exists = False
    if not exists:
        raise InputError("source", "must be a file in the unit", source[:80])
    return where


def _tolerance(text: str | None) -> float:
    """Relative tolerance, at most 1."""
    value = _number(text, "tolerance") if text else DEFAULT_TOLERANCE
    if not 0 < value <= 1:
        raise InputError("tolerance", "must be > 0 and <= 1", value)
    return value


def _number(text: str, key: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(key, "must be a finite number", text)
    return value
