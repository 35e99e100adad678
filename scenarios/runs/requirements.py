"""Requirements of a run that are checked before units are built: size, targets, windows of checks, figures."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.controller.planner import OFF_REACH
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.declaration import InstanceDeclaration
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.definition.settings import Settings, StartValues
from flexbeams.scenarios.definition.signals import TIME_TOLERANCE, Signal, require_sampled, skipped_rows
from flexbeams.scenarios.definition.values import require_value
from flexbeams.scenarios.results.checks import Measurement
from flexbeams.scenarios.results.curves import figure_curve
from flexbeams.scenarios.runs.voltage_limits import broken_limit, other_voltages, voltage_limits_of
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.wiring import Wiring

_CHUNK = 2**14  # steps whose signals are looked at together


def whole_steps(scenario: Scenario, step: float, settings: Settings, source: str) -> int:
    """Number of steps of `step` s up to the stop time; InputError unless it is whole and > 0."""
    ratio = scenario.stop_time / step
    steps = round(ratio) if math.isfinite(ratio) else 0
    if steps < 1 or abs(steps * step - scenario.stop_time) > 1e-6 * step:
        raise InputError(
            "stop_time",
            f"must be a whole number of steps of {step:g} s",
            scenario.stop_time,
            source=settings.stop_time_source(source),
        )
    return steps


def require_sections(kinds: Mapping[str, UnitKind], design: Design, source: str) -> None:
    """InputError for an instance whose unit needs a section that the structure file does not have."""
    for name, kind in kinds.items():
        if not kind.is_made_by(design):
            rule = f"needs a section [{kind.section}] in the structure file"
            raise InputError(f"instance.{name}.unit", rule, kind.name, source=source)


def require_sampled_signals(scenario: Scenario, step: float, source: str) -> None:
    """InputError for an input signal that steps of `step` s are too slow for."""
    for k, drive in enumerate(scenario.input, 1):
        try:
            require_sampled(drive, step)
        except InputError as error:
            raise error.at(source, f"input[{k}].") from None


def require_discrete_signals(
    wiring: Wiring, declarations: Mapping[str, InstanceDeclaration], steps: int, step: float, source: str
) -> None:
    """InputError for a signal with a value that an Integer, Boolean or Enumeration input cannot take."""
    for owner, inputs in wiring.inputs.items():
        for name, index in inputs:
            variable = declarations[owner].variables[name]
            span, signal = next(((s, f) for s, f in wiring.external if s.start <= index < s.stop), (slice(0), 0.0))
            if variable.type == "Real" or isinstance(signal, float):
                continue
            column = index - span.start if signal.width > 1 else 0
            for first in range(0, steps + 1, _CHUNK):
                time = np.arange(first, min(first + _CHUNK, steps + 1), dtype=np.float64) * step
                for value in np.unique(signal.sample(time)[:, column]):
                    _require_discrete(f"{owner}.{name}", variable, float(value), source)


def _require_discrete(name: str, variable: Any, value: float, source: str) -> None:
    if variable.type == "Boolean":
        if value not in (0.0, 1.0):
            raise InputError(name, "is Boolean and must be driven by 0 and 1", value, source=source)
    elif not value.is_integer():
        raise InputError(name, f"is of type {variable.type} and must be driven by integers", value, source=source)
    else:
        require_value(name, variable, value, source)


def note_skipped_rows(
    scenario: Scenario, wiring: Wiring, steps: int, step: float, notify: Callable[[str], None]
) -> None:
    """Notes tables and targets with changes between two samples, which no unit sees."""
    signals = [signal for _, signal in wiring.external if isinstance(signal, Signal)]
    for k, (drive, signal) in enumerate(zip(scenario.input, signals, strict=True), 1):
        if count := skipped_rows(signal, step, steps):
            what = f"rows of {drive.table.file}" if drive.table else "targets"
            notify(f"input[{k}]: {count} {what} have no effect, the next one comes within the same step of {step:g} s")


def require_one_design(declarations: Mapping[str, InstanceDeclaration], source: str) -> None:
    """InputError for units of different designs."""
    designs = {
        name: str(declaration.variables["design_id"].start)
        for name, declaration in declarations.items()
        if "design_id" in declaration.variables
    }
    if len(set(designs.values())) > 1:
        listed = ", ".join(f"{name} has {value[:12]}" for name, value in designs.items())
        raise InputError(
            "instance", f"units must be of one design (design_id): {listed}; build them together", source=source
        )


def require_one_instance_each(declarations: Mapping[str, InstanceDeclaration], source: str) -> None:
    """InputError for two instances of a unit that a process can instantiate only once."""
    owners: dict[str, str] = {}
    for name, declaration in declarations.items():
        simulation = getattr(declaration.description, "coSimulation", None)
        if simulation is None or not simulation.canBeInstantiatedOnlyOncePerProcess:
            continue
        other = owners.setdefault(declaration.description.guid, name)
        if other != name:
            rule = f"is of the same unit as {other}, which can be instantiated only once (its modelDescription.xml)"
            raise InputError(f"instance.{name}", rule, simulation.modelIdentifier, source=source)


def require_reachable_targets(
    scenario: Scenario,
    design: Design,
    kinds: Mapping[str, UnitKind],
    declarations: Mapping[str, InstanceDeclaration],
    starts: Mapping[str, StartValues],
    source: str,
) -> None:
    """InputError for a target that no voltages reach, or that needs more than the feedforward's limit at rest."""
    for k, drive in enumerate(scenario.input, 1):
        owner, _, variable = drive.to.partition(".")
        if owner not in kinds or not variable or variable != kinds[owner].targets:
            continue
        for t, target in enumerate(drive.targets or [], 1):
            key = f"input[{k}].targets[{t}].value"
            _require_reachable(target.value, design, declarations[owner].variables, starts[owner], key, source)


def _require_reachable(
    target: list[float], design: Design, variables: Mapping[str, Any], starts: StartValues, key: str, source: str
) -> None:
    inverse = design.arrays["static_inverse"]
    if len(target) != inverse.shape[1]:
        rule = f"must have {inverse.shape[1]} values, one for each point of interest"
        raise InputError(key, rule, target, source=source)
    missed = design.arrays["unreachable"] @ np.array(target)
    if np.max(np.abs(missed)) > OFF_REACH * np.max(np.abs(target)):
        nearest = ", ".join(f"{y:.6g}" for y in np.array(target) - missed)
        rule = f"is out of reach: no voltages reach it, the nearest reachable target is [{nearest}]"
        raise InputError(key, f'{rule}; design.targets = "nearest" takes that', target, source=source)
    voltages = inverse @ np.array(target)
    limits = voltage_limits_of(variables, starts)
    worst = limits.furthest_beyond(voltages, voltages)
    if worst.excess > 0:
        rule = f"is out of reach: {broken_limit(worst, variables, starts)}{other_voltages(inverse, voltages, limits)}"
        raise InputError(key, rule, target, source=source)


def reachable_checks(scenario: Scenario, settings: Settings, source: str, notify: Callable[[str], None]) -> Scenario:
    """The scenario with the checks whose windows the run reaches.

    Others are left out, with a note, under --stop-time only; else they raise InputError.
    """
    checks = []
    for k, check in enumerate(scenario.check, 1):
        if check.before is not None and check.before < check.after:
            raise InputError(f"check[{k}].before", f"must be >= after ({check.after:g} s)", check.before, source=source)
        key, last = ("after", check.after) if check.before is None else ("before", check.before)
        if last <= scenario.stop_time + TIME_TOLERANCE:
            checks.append(check)
        elif settings.stop_time:
            notify(f"check {check.name!r} is left out: it looks at {last:g} s")
        else:
            raise InputError(
                f"check[{k}].{key}", f"must be within the run of {scenario.stop_time:g} s", last, source=source
            )
    return replace(scenario, check=checks)


def require_measurable(scenario: Scenario, columns: list[str], source: str) -> None:
    """InputError for a check that cannot be measured on these columns: measures a recording of zeros."""
    zeros = zero_recording(scenario, columns)
    Measurement(scenario, source, zeros, zeros).outcomes()


def require_figures(scenario: Scenario, columns: list[str], open_loop: list[str] | None, source: str) -> None:
    """InputError for a figure of signals that are not among the columns of the run or of the open loop's."""
    recording = zero_recording(scenario, columns)
    other = None if open_loop is None else zero_recording(scenario, open_loop)
    for k, figure in enumerate(scenario.figure, 1):
        for name in (name for row in figure.rows for name in row):
            try:
                curve = figure_curve(name, recording, other, figure.points, f"figure[{k}]")
            except InputError as error:
                raise error.at(source) from None
            if not curve.columns:
                raise InputError(f"figure[{k}].points", f"must have one within {name}", figure.points, source=source)


def zero_recording(scenario: Scenario, columns: list[str]) -> Recording:
    """A recording of zeros, with rows at the ends of the run and of each check's window."""
    ends = [t for c in scenario.check for t in (c.after, c.before) if t is not None]
    time: Any = np.array(sorted({0.0, scenario.stop_time, *ends}))
    return Recording(time=time, columns=columns, values=np.zeros((len(time), len(columns))), wall_seconds=0.0)
