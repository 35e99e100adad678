"""Recordings from files of other tools: CSV, Parquet, MAT and MF4 with a column of the time, in their own names."""

import csv
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.definition.dimensions import KNOWN_DIMENSIONS, si_unit
from flexbeams.scenarios.simulation.recording import Recording

SUFFIXES = (".csv", ".parquet", ".mat", ".mf4")
_LISTED = 8  # columns that are not read, by name
_TIME = re.compile(r"(time|t)\s*([\[(](?P<unit>.*)[\])])?", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True)
class FileContent:
    """What a file holds: columns of numbers as long as the time, and the names of what is something else."""

    columns: dict[str, Array]  # (rows,) each, the time among them
    units: dict[str, str] = field(default_factory=dict)  # that the file states, by column
    unread: list[str] = field(default_factory=list)


def read_recording(
    path: Path,
    names: Mapping[str, str],
    units: Mapping[str, str],
    notify: Callable[[str], None] = lambda text: None,
) -> Recording:
    """The recording in a file of another tool, in ascending time and names of this project.

    `names` maps columns or arrays of the file to ours, `units` columns or arrays of the file to units of measurement:
    these are converted to SI units; others stay in the unit that the file states. What is not numbers at the times of
    the file is noted. Raises InputError for a file that is not such a table, and for names and units that do not exist.
    """
    readers = {".csv": _read_csv, ".parquet": _read_parquet, ".mat": _read_mat, ".mf4": _read_mf4}
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise InputError("RUN", f"must be a folder of results or a file {', '.join(SUFFIXES)}", str(path))
    if not path.is_file():
        raise InputError("RUN", "must be a folder or file that exists", str(path))
    content = readers[suffix](path)
    columns = dict(content.columns)
    time_name = next((name for name in columns if _TIME.fullmatch(name.strip())), None)
    if time_name is None:
        raise InputError("", "must have a column named time or t", source=str(path))
    if content.unread:
        more = f" and {len(content.unread) - _LISTED} more" if len(content.unread) > _LISTED else ""
        notify(f"{path}: not read, since no numbers over the time: {', '.join(content.unread[:_LISTED])}{more}")
    time = columns.pop(time_name) * _time_factor(time_name, {**content.units, **units})
    if len(time) < 2 or np.any(np.diff(time) < 0) or not np.isfinite(time).all():
        raise InputError("", "must have ascending times, at least two", source=str(path))
    if repeated := np.flatnonzero(np.diff(time) == 0).tolist():  # events: the last row of a time holds
        keep = np.setdiff1d(np.arange(len(time)), repeated)
        time, columns = time[keep], {name: values[keep] for name, values in columns.items()}
    renamed, known = _renamed(columns, names, units, content.units, path)
    values = np.column_stack(list(renamed.values())) if renamed else np.empty((len(time), 0))
    return Recording(
        time=time, columns=list(renamed), values=values, wall_seconds=float("nan"), steps=len(time) - 1, units=known
    )


def _time_factor(name: str, units: Mapping[str, str]) -> float:
    match = _TIME.fullmatch(name.strip())
    written = match["unit"] if match else None
    unit = units.get(name, units.get("time", written or "s"))
    factor = _factor(unit, name)
    if si_unit(unit) != "s":
        raise InputError("--unit", f"of {name} must be one of time, such as ms", unit)
    return factor


def _factor(unit: str, name: str) -> float:
    if unit not in KNOWN_DIMENSIONS:
        raise InputError("--unit", f"of {name} must be a known unit" + suggestion(unit, KNOWN_DIMENSIONS), unit)
    return KNOWN_DIMENSIONS[unit].factor


def _renamed(
    columns: dict[str, Array],
    names: Mapping[str, str],
    units: Mapping[str, str],
    stated: Mapping[str, str],
    path: Path,
) -> tuple[dict[str, Array], dict[str, str]]:
    """The columns under our names, those of `units` in SI units, and the units as far as they are known.

    An entry of an array in `names` and `units` applies to its elements; `stated` are units that the file states.
    """
    used: set[str] = set()

    def entry(table: Mapping[str, str], column: str) -> tuple[str, str] | None:
        """The entry's value, and what of the column's name it does not cover."""
        base = column[: column.rindex("[")] if column.endswith("]") and "[" in column else column
        for key in (column, base):
            if key in table:
                used.add(key)
                return table[key], column[len(key) :]
        return None

    renamed, known = {}, {}
    for column, values in columns.items():
        target, given = entry(names, column), entry(units, column)
        ours = target[0] + target[1] if target else column
        if ours in renamed:
            raise InputError("--map", "must not give two columns one name", ours)
        renamed[ours] = values * (_factor(given[0], column) if given else 1.0)
        if given or column in stated:
            known[ours] = si_unit(given[0]) if given else stated[column]
    for option, table in (("--map", names), ("--unit", units)):
        for key in table:
            if key not in used and not _TIME.fullmatch(key.strip()):
                raise InputError(option, f"names no column of {path}" + suggestion(key, columns), key)
    return renamed, known


def _read_csv(path: Path) -> FileContent:
    """Columns of numbers under a header, or a header and a row of units; separated by commas, semicolons or tabs."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = file.readline(), file.readline()
        separator = max(",;\t", key=lines[0].count)
        names, second = (next(csv.reader([line], delimiter=separator), []) for line in lines)
        header = [name.strip() for name in names]
        units = second if len(second) == len(header) and si_unit(second[0].strip()) == "s" else []
        columns = _numbers(path, separator, len(header), skipped=2 if units else 1)
    except OSError as error:
        raise InputError("", f"cannot be read: {error.strerror}", source=str(path)) from None
    except InputError as error:
        raise error.at(str(path)) from None
    except (StopIteration, ValueError, csv.Error, UserWarning):  # their texts quote the file
        raise InputError("", "is not a CSV file of numbers under a header", source=str(path)) from None
    if len(columns) != len(header) or len(set(header)) != len(header):
        raise InputError("", "is not a CSV file with one name for each column", source=str(path))
    return FileContent(
        columns={name: values for name, values in zip(header, columns, strict=True) if values is not None},
        units={name: unit.strip() for name, unit in zip(header, units, strict=False) if unit.strip()},
        unread=[name for name, values in zip(header, columns, strict=True) if values is None],
    )


def _numbers(path: Path, separator: str, count: int, skipped: int) -> Sequence[Array | None]:
    """The columns of a CSV file; None for those that are not of numbers. The file may hold true and false, or text."""
    with warnings.catch_warnings(action="error"):
        try:
            table: Array = np.loadtxt(path, delimiter=separator, skiprows=skipped, ndmin=2, encoding="utf-8-sig")
            return list(table.T)
        except ValueError:
            pass
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file, delimiter=separator) if row][skipped:]
    if not rows or any(len(row) != count for row in rows):
        raise ValueError
    return [_column(cells, f"{k}") for k, cells in enumerate(zip(*rows, strict=True), 1)]


def _column(cells: Sequence[str], place: str) -> Array | None:
    """The numbers of a column, None for one without any; InputError for one with both numbers and others."""
    words = {"true": "1", "false": "0"}
    values, others = np.empty(len(cells)), []
    for k, cell in enumerate(cells):
        try:
            values[k] = float(words.get(cell.strip().lower(), cell))
        except ValueError:
            others.append(k)
    if others and len(others) < len(cells):
        raise InputError("", f"column {place} must hold numbers alone, its row {others[0] + 1} does not")
    return None if others else values


def _read_parquet(path: Path) -> FileContent:
    _require("pyarrow", "formats", path)
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(path)
        numeric = [f.name for f in table.schema if _is_number(f.type)]
        columns = {name: np.asarray(table[name].to_numpy(), dtype=float) for name in numeric}
    except (pyarrow.ArrowException, OSError, ValueError):
        raise InputError("", "is not a readable Parquet file", source=str(path)) from None
    units = {f.name: f.metadata[b"unit"].decode() for f in table.schema if f.metadata and b"unit" in f.metadata}
    return FileContent(columns=columns, units=units, unread=[n for n in table.column_names if n not in columns])


def _is_number(kind: Any) -> bool:
    """Whether Parquet columns of a type are numbers, or true and false."""
    from pyarrow import types

    checks = (types.is_floating, types.is_integer, types.is_boolean, types.is_decimal)
    return any(check(kind) for check in checks)


def _read_mat(path: Path) -> FileContent:
    """Vectors and matrices as long as the time: <struct>.<field> of a struct, with [1], [2] ... of a matrix."""
    from scipy.io import loadmat

    try:
        content = loadmat(path, simplify_cells=True)
    except Exception:  # SciPy raises various errors on a damaged file, and NotImplementedError for version 7.3
        raise InputError("", "is not a readable MAT file of version 5 to 7", source=str(path)) from None
    for about in ("units", "descriptions", "run"):
        content.pop(about, None)
    names = content.pop("columns", {}) if isinstance(content.get("columns"), dict) else {}
    time = next((np.ravel(v) for k, v in content.items() if _TIME.fullmatch(k) and np.ndim(v)), None)
    if time is None:
        return FileContent(columns={})
    found: dict[str, Array] = {"time": time.astype(float)}
    unread: list[str] = []
    for name, value in content.items():
        if name.startswith("__"):
            continue
        fields = value.items() if isinstance(value, dict) else [("", value)]
        for field_name, array in fields:
            base = f"{name}.{field_name}" if field_name else name
            if _TIME.fullmatch(base):
                continue
            written = names.get(name, {}).get(field_name) if isinstance(names.get(name), dict) else None
            columns = _matrix_columns(base, array, len(time), written)
            found |= columns
            unread += [] if columns else [base]
    return FileContent(columns=found, unread=unread)


def _matrix_columns(base: str, array: Any, rows: int, written: Any) -> dict[str, Array]:
    """The columns of a vector or matrix with a row for each time; none of anything else."""
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiub":
        return {}
    if rows not in array.shape or array.ndim > 2:
        return {}
    table = array.reshape(rows, -1) if array.shape[0] == rows else array.T
    labels = [str(name) for name in np.atleast_1d(written)] if written is not None else []
    if len(labels) != table.shape[1]:
        labels = [base] if table.shape[1] == 1 else [f"{base}[{k + 1}]" for k in range(table.shape[1])]
    return dict(zip(labels, table.T.astype(float), strict=True))


def _read_mf4(path: Path) -> FileContent:
    """The channels at the times of the group with most rows."""
    _require("asammdf", "mf4", path)
    from asammdf import MDF

    try:
        with MDF(path) as file:
            signals = [s for s in file.iter_channels() if np.ndim(s.timestamps) == 1]
    except Exception:  # asammdf raises various errors on a damaged file
        raise InputError("", "is not a readable MF4 file", source=str(path)) from None
    if not signals:
        return FileContent(columns={})
    time = np.asarray(max((s.timestamps for s in signals), key=len), dtype=float)
    chosen = {s.name: s for s in signals if s.samples.dtype.kind in "fiub" and np.array_equal(s.timestamps, time)}
    return FileContent(
        columns={"time": time, **{name: np.asarray(s.samples, dtype=float) for name, s in chosen.items()}},
        units={name: s.unit for name, s in chosen.items() if s.unit},
        unread=[s.name for s in signals if s.name not in chosen],
    )


def _require(package: str, extra: str, path: Path) -> None:
    if find_spec(package) is None:
        rule = f"needs the package {package} (pip install 'flexbeams[{extra}]')"
        raise InputError("", rule, source=str(path))
