"""Experiments from CSV files: columns as in a run's results.csv, or mapped to them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.identification.experiment import Experiment, Start, sensor_names
from flexbeams.plant.number_table import read_number_table
from flexbeams.plant.structure import Structure

EVEN = 0.02  # of a step by which a time may be off the grid


@dataclass(frozen=True, kw_only=True)
class Column:
    """Where a signal comes from: a column of the file and a factor to SI."""

    name: str
    factor: float = 1.0


@dataclass(frozen=True, kw_only=True)
class Reading:
    """How files are read."""

    columns: Mapping[str, Column] = field(default_factory=dict)  # by signal: time, u[1], force[1], y_pi[1], y_pm[1]
    begin: float | None = None  # s, in the file's own time: outputs before do not count
    end: float | None = None  # s: rows beyond are dropped


def read_experiment(
    path: Path,
    structure: Structure,
    reading: Reading | None = None,
    *,
    start: Start = "rest",
    uncoupled: bool = False,
    held_back: bool = False,
) -> Experiment:
    """The experiment in a file.

    Names are time, u[k] (V), force[j] (N, optional), y_pi[k] (m) and y_pm[k] (1), with or without the name of an
    instance before them; sensors may be missing, voltages may not. The structure rests under the first row's voltages
    if the outputs do not move before they change, else under none. Raises InputError with column, row and reason.
    """
    reading = reading or Reading()
    source = str(path)
    header, values, step, first = _window(path, reading, source)
    voltages = [
        signal_column(f"u[{k}]", header, values, reading, source, required=True)
        for k in range(1, len(structure.patch) + 1)
    ]
    forces = [signal_column(f"force[{j}]", header, values, reading, source) for j in range(1, len(structure.beam) + 1)]
    outputs = {
        k: column
        for k, name in enumerate(sensor_names(structure))
        if (column := signal_column(name, header, values, reading, source)) is not None
    }
    if not outputs:
        raise InputError(
            "", "has no column of a sensor" + suggestion("y_pi[1]", sensor_names(structure)), source=source
        )
    u, y = np.stack([v for v in voltages if v is not None], axis=1), np.stack(list(outputs.values()), axis=1)
    return Experiment(
        name=path.stem,
        step=step,
        voltages=u,
        forces=_stacked_forces(forces, len(values)),
        outputs=y,
        sensors=tuple(outputs),
        rest_voltages=_rest(u, y),
        start=start,
        first_counted=first,
        uncoupled=uncoupled,
        held_back=held_back,
    )


def _window(path: Path, reading: Reading, source: str) -> tuple[list[str], Array, float, int]:
    """Header, values up to the end of the window, step in s, and the first row that counts."""
    table = read_number_table(path)
    header, values = table.header, table.values
    time = signal_column("time", header, values, reading, source, required=True)
    assert time is not None
    step = even_step(time, table.rows, source)
    if reading.end is not None:
        values, time = values[time <= reading.end], time[time <= reading.end]
    first = 0 if reading.begin is None else int(np.searchsorted(time, reading.begin))
    if len(time) - first < 20:
        raise InputError("", f"must have at least 20 rows that count, got {max(0, len(time) - first)}", source=source)
    return header, values, step, first


def _stacked_forces(forces: list[Array | None], rows: int) -> Array | None:
    """Tip forces (rows, r), zero where a column is missing; None where all are."""
    if all(force is None for force in forces):
        return None
    return np.stack([np.zeros(rows) if force is None else force for force in forces], axis=1)


def _rest(voltages: Array, outputs: Array) -> Array:
    """Voltages at rest: the first row's, unless the outputs move while these stay."""
    changed = np.any(voltages != voltages[0], axis=1)
    onset = int(np.argmax(changed)) if np.any(changed) else len(voltages)
    if not np.any(voltages[0]) or onset < 2:
        return voltages[0] if np.any(changed) and onset >= 2 else np.zeros(voltages.shape[1])
    before, size = outputs[:onset], np.ptp(outputs, axis=0)
    moves = np.median(np.ptp(before, axis=0) / np.where(size > 0, size, 1.0))
    return np.zeros(voltages.shape[1]) if moves > 0.5 else voltages[0].copy()


def signal_column(
    name: str, header: list[str], values: Array, reading: Reading, source: str, required: bool = False
) -> Array | None:
    """The column of a signal in SI; None where it is missing and not required."""
    mapped = reading.columns.get(name)
    if mapped is not None:
        named = header.index(mapped.name) if mapped.name in header else None
        ends = [k for k, column_name in enumerate(header) if column_name.endswith(f".{mapped.name}")]
        at = named if named is not None else ends[0] if len(ends) == 1 else None
        if at is None:
            raise InputError(f"column {mapped.name!r}", "is missing" + suggestion(mapped.name, header), source=source)
        column: Array = values[:, at] * mapped.factor
        return column
    found = [k for k, column_name in enumerate(header) if column_name == name or column_name.endswith(f".{name}")]
    if len(found) > 1:
        all_names = ", ".join(header[k] for k in found)
        raise InputError(f"signal {name}", f"has several columns ({all_names}); choose one with --map", source=source)
    if not found:
        if required:
            raise InputError(f"column {name!r}", "is missing" + suggestion(name, header), source=source)
        return None
    own: Array = values[:, found[0]]
    return own


def even_step(time: Array, rows: Sequence[int], source: str) -> float:
    """The step of an even time column, s; `rows` are the numbers of its rows in the file."""
    steps = np.diff(time)
    if len(steps) == 0 or np.any(steps <= 0):
        row = rows[int(np.argmax(steps <= 0)) + 1] if len(steps) else rows[0]
        raise InputError(f"row {row}, column 'time'", "must increase from row to row", source=source)
    step = float((time[-1] - time[0]) / (len(time) - 1))
    off = np.abs(time - time[0] - step * np.arange(len(time)))
    if np.max(off) > EVEN * step:
        jump = int(np.argmax(np.abs(steps - np.median(steps))))
        raise InputError(
            f"row {rows[jump + 1]}, column 'time'",
            f"must have even steps of {np.median(steps):.6g} s; resample the data or cut them at the gap",
            float(steps[jump]),
            source=source,
        )
    return step
