"""A scenario's external signals as signals of a SignalSource, for tools without signals of their own."""

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.fmus.interface.si import SI_UNITS
from flexbeams.fmus.units.signal_source import SourceSignal
from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.declaration import element_names
from flexbeams.scenarios.definition.schema import SIGNALS, Chirp, Input, PseudoRandom, Scenario
from flexbeams.scenarios.definition.signals import binary_sequence, loses_impulse, signal_of, table_rows

Starts = Mapping[str, Mapping[str, float | bool]]
Variables = Mapping[str, Mapping[str, Any]]  # FMPy's, by instance and name


@dataclass(frozen=True)
class DrivenInputs:
    """Inputs of an instance that one signal drives; those that the scenario leaves open have none."""

    owner: str
    names: list[str]
    drive: Input | None


def source_signals(
    scenario: Scenario,
    folder: Path,
    variables: Variables,
    starts: Starts,
    connected: Collection[str],
    open_arrays: bool = True,
    step: float | None = None,
) -> tuple[list[SourceSignal], dict[str, str]]:
    """Signals that drive every Real input that is not `connected`, and the output by <instance>.<input>.

    Inputs that the scenario leaves open get a constant, their start value: some tools set an input that nothing
    drives to zero or to the value of another. Without `open_arrays` they do so only within arrays that a signal
    drives in part. `variables` and `starts` are by instance; files of tables are relative
    to `folder`. A pulse that is short for steps of `step` s becomes a table of its means.
    """
    groups = [*_scenario_inputs(scenario, variables)]
    driven = {f"{group.owner}.{name}" for group in groups for name in group.names}
    arrays = {name.partition("[")[0] for name in driven}
    groups += [
        group
        for group in _open_inputs(variables, driven | set(connected))
        if open_arrays or f"{group.owner}.{group.names[0]}".partition("[")[0] in arrays
    ]
    outputs = _output_names([f"{group.owner}.{name}" for group in groups for name in group.names])
    return [_source_signal(group, outputs, folder, variables, starts, step) for group in groups], outputs


def _scenario_inputs(scenario: Scenario, variables: Variables) -> Iterator[DrivenInputs]:
    for drive in scenario.input:
        owner, _, variable = drive.to.partition(".")
        yield DrivenInputs(owner, element_names(dict(variables[owner]), variable), drive)


def _open_inputs(variables: Variables, driven: Collection[str]) -> Iterator[DrivenInputs]:
    """Complete arrays together, elements of incomplete arrays one by one."""
    for owner, table in variables.items():
        open_names = [
            n for n, v in table.items() if v.causality == "input" and v.type == "Real" and f"{owner}.{n}" not in driven
        ]
        for name in dict.fromkeys(n.partition("[")[0] for n in open_names):
            elements = [n for n in open_names if n.partition("[")[0] == name]
            whole = elements == element_names(dict(table), name)
            for part in [elements] if whole else [[n] for n in elements]:
                yield DrivenInputs(owner, part, None)


def _source_signal(
    group: DrivenInputs,
    outputs: Mapping[str, str],
    folder: Path,
    variables: Variables,
    starts: Starts,
    step: float | None,
) -> SourceSignal:
    names = [outputs[f"{group.owner}.{n}"] for n in group.names]
    first = variables[group.owner][group.names[0]]
    if group.drive:
        kind, width, fields = _content(group.drive, folder, step)
    else:
        kind, width, fields = _start(group, variables, starts)
    stem = names[0].partition("[")[0] if len(names) > 1 or "[" not in names[0] else re.sub(r"\W+", "_", names[0])
    return SourceSignal(
        name=f"{stem.rstrip('_')}_{_kind_name(group.drive)}",
        kind=kind,
        outputs=tuple(names),
        width=width,
        unit=first.unit if first.unit in SI_UNITS else None,
        nominal=float(first.nominal) if first.nominal and float(first.nominal) > 0 else None,
        drives=f"{group.owner}.{group.names[0].partition('[')[0] if len(group.names) > 1 else group.names[0]}",
        **fields,
    )


def _output_names(inputs: list[str]) -> dict[str, str]:
    """An output's name for each <instance>.<input>: the input's, with its instance where two have the same."""
    arrays = {name: name.partition(".")[2].partition("[")[0] for name in inputs}
    owners: dict[str, set[str]] = {}
    for name, array in arrays.items():
        owners.setdefault(array, set()).add(name.partition(".")[0])
    outputs = {}
    for name, array in arrays.items():
        owner, _, variable = name.partition(".")
        stem = re.sub(r"\W+", "_", array if len(owners[array]) == 1 else f"{owner}_{array}").strip("_")
        index = re.search(r"\[[\d,]+\]$", variable)
        outputs[name] = stem + (index.group() if index else "")
    return outputs


def _start(group: DrivenInputs, variables: Variables, starts: Starts) -> tuple[Any, int, dict[str, Any]]:
    """A constant, the start values of open inputs."""
    given, table = starts.get(group.owner, {}), variables[group.owner]
    values = [float(given.get(n, table[n].start) or 0.0) for n in group.names]
    return "constant", len(values), {"parameters": {"value": values if len(values) > 1 else values[0]}}


def _content(drive: Input, folder: Path, step: float | None) -> tuple[Any, int, dict[str, Any]]:
    """Kind, width and further fields of the signal of an input."""
    if drive.chirp:
        return _chirp(drive.chirp)
    if drive.pseudo_random:
        return _pseudo_random(drive.pseudo_random)
    if drive.table:
        rows = table_rows(drive.table, drive.to, folder)
        kind = "held_table" if drive.table.hold == "zero" else "joined_table"
        return kind, rows.shape[1] - 1, {"table": rows}
    if drive.targets:
        parameters = {"time": [t.time for t in drive.targets], "value": [t.value for t in drive.targets]}
        return "targets", len(drive.targets[0].value), {"parameters": parameters}
    if drive.pulse:
        pulse = drive.pulse
        if step is not None and loses_impulse(pulse, step):
            return "held_table", 1, {"table": _pulse_rows(drive, folder, step)}
        return "pulse", 1, {"parameters": {"time": pulse.time, "duration": pulse.duration, "impulse": pulse.impulse}}
    if drive.step:
        value = drive.step.value
        return "step", _width(value), {"parameters": {"time": drive.step.time, "value": value}}
    return "constant", _width(drive.constant), {"parameters": {"value": drive.constant}}


def _pulse_rows(drive: Input, folder: Path, step: float) -> Array:
    """Time and value (rows, 2) of a pulse that is short for the step: the means over the steps that it meets."""
    assert drive.pulse is not None
    first = max(int(drive.pulse.time / step) - 1, 0)
    last = int((drive.pulse.time + drive.pulse.duration) / step) + 2
    time = np.unique([0.0, *(step * np.arange(first, last + 1, dtype=np.float64))])
    return np.column_stack([time, signal_of(drive, folder, step).sample(time)])


def _kind_name(drive: Input | None) -> str:
    return next(s for s in SIGNALS if getattr(drive, s) is not None) if drive else "constant"


def _width(value: Any) -> int:
    return int(np.size(value))


def _chirp(chirp: Chirp) -> tuple[Any, int, dict[str, Any]]:
    parameters = {
        "time": chirp.time,
        "duration": chirp.duration,
        "amplitude": chirp.amplitude,
        "start_frequency": chirp.start_frequency,
        "stop_frequency": chirp.stop_frequency,
    }
    return f"{chirp.sweep}_chirp", _width(chirp.amplitude), {"parameters": parameters}


def _pseudo_random(signal: PseudoRandom) -> tuple[Any, int, dict[str, Any]]:
    parameters: dict[str, Any] = {"time": signal.time, "amplitude": signal.amplitude, "hold": signal.hold}
    if signal.duration is not None:
        parameters["duration"] = signal.duration
    width = _width(signal.amplitude)
    if signal.kind == "levels":
        return "levels", width, {"parameters": parameters, "seed": signal.seed}
    sequence, begin = binary_sequence(signal)
    return "binary", width, {"parameters": parameters, "sequence": sequence, "begin": begin}
