"""A scenario's external signals as those of a SignalSource, for tools that have none of their own."""

import re
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.fmus.interface.si import BASE_UNITS
from flexbeams.fmus.units.signal_source import SourceSignal
from flexbeams.scenarios.definition.schema import SIGNALS, Chirp, Input, PseudoRandom, Scenario
from flexbeams.scenarios.definition.signals import binary_sequence, table_rows
from flexbeams.scenarios.simulation.instance import element_names

Starts = Mapping[str, Mapping[str, float | bool]]


def source_signals(
    scenario: Scenario,
    folder: Path,
    variables: Mapping[str, Mapping[str, Any]],
    starts: Starts,
    connected: Collection[str],
) -> tuple[list[SourceSignal], dict[str, str]]:
    """Signals that drive every Real input that is not `connected`, and the output by <instance>.<input>.

    Inputs that the scenario leaves open get a constant, their start value: some tools set an input that nothing
    drives to zero or to the value of another. `variables` and `starts` are by instance; files of tables are relative
    to `folder`.
    """
    signals: list[SourceSignal] = []
    driven: dict[str, Input] = {}
    groups: list[tuple[str, list[str], Input | None]] = []
    for drive in scenario.input:
        owner, _, variable = drive.to.partition(".")
        names = element_names(dict(variables[owner]), variable)
        groups.append((owner, names, drive))
        driven |= {f"{owner}.{n}": drive for n in names}
    for owner, table in variables.items():
        left = [
            n
            for n, v in table.items()
            if v.causality == "input"
            and v.type == "Real"
            and f"{owner}.{n}" not in connected
            and f"{owner}.{n}" not in driven
        ]
        for name in dict.fromkeys(n.partition("[")[0] for n in left):
            elements = [n for n in left if n.partition("[")[0] == name]
            whole = elements == element_names(dict(table), name)
            groups += [(owner, part, None) for part in ([elements] if whole else [[n] for n in elements])]
    outputs = _output_names([f"{owner}.{n}" for owner, names, _ in groups for n in names])
    for owner, names, given in groups:
        found = [outputs[f"{owner}.{n}"] for n in names]
        kind, width, rest = _content(given, folder) if given else _start(owner, names, variables, starts)
        first = variables[owner][names[0]]
        stem = found[0].partition("[")[0] if len(found) > 1 or "[" not in found[0] else re.sub(r"\W+", "_", found[0])
        signals.append(
            SourceSignal(
                name=f"{stem.rstrip('_')}_{_name(given)}",
                kind=kind,
                outputs=tuple(found),
                width=width,
                unit=first.unit if first.unit in BASE_UNITS else None,
                nominal=float(first.nominal) if first.nominal and float(first.nominal) > 0 else None,
                drives=f"{owner}.{names[0].partition('[')[0] if len(names) > 1 else names[0]}",
                **rest,
            )
        )
    return signals, outputs


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


def _start(
    owner: str, names: list[str], variables: Mapping[str, Mapping[str, Any]], starts: Starts
) -> tuple[Any, int, dict[str, Any]]:
    values = [float(starts.get(owner, {}).get(n, variables[owner][n].start) or 0.0) for n in names]
    return "constant", len(names), {"parameters": {"value": values if len(names) > 1 else values[0]}}


def _content(drive: Input, folder: Path) -> tuple[Any, int, dict[str, Any]]:
    """Kind, width and the fields that only this kind has."""
    if drive.chirp:
        return _chirp(drive.chirp)
    if drive.pseudo_random:
        return _pseudo_random(drive.pseudo_random)
    if drive.table:
        rows = table_rows(drive.table, folder)
        kind = "held_table" if drive.table.hold == "zero" else "joined_table"
        return kind, rows.shape[1] - 1, {"table": rows}
    if drive.targets:
        parameters = {"time": [t.time for t in drive.targets], "value": [t.value for t in drive.targets]}
        return "targets", len(drive.targets[0].value), {"parameters": parameters}
    if drive.pulse:
        pulse = drive.pulse
        return "pulse", 1, {"parameters": {"time": pulse.time, "duration": pulse.duration, "impulse": pulse.impulse}}
    if drive.step:
        value = drive.step.value
        return "step", _width(value), {"parameters": {"time": drive.step.time, "value": value}}
    return "constant", _width(drive.constant), {"parameters": {"value": drive.constant}}


def _name(drive: Input | None) -> str:
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
