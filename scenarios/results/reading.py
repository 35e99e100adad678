"""Recordings from files of other tools: CSV, Parquet, MAT and MF4 with a column of the time, in their own names."""

import csv
import re
import warnings
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.scenarios.simulation.recording import Recording

SUFFIXES = (".csv", ".parquet", ".mat", ".mf4")
# Units of measurement that a column may have, and their size in SI units
UNITS = {
    **dict.fromkeys(("m", "s", "V", "N", "m/m", "1", "rad", "J"), 1.0),
    **{"mm": 1e-3, "cm": 1e-2, "µm": 1e-6, "um": 1e-6, "ms": 1e-3, "us": 1e-6, "µs": 1e-6},
    **{"mV": 1e-3, "kV": 1e3, "mN": 1e-3, "kN": 1e3, "µm/m": 1e-6, "um/m": 1e-6, "mm/m": 1e-3, "%": 1e-2},
}
_TIME = re.compile(r"(time|t)\s*([\[(](?P<unit>.*)[\])])?", re.IGNORECASE)


def read_recording(path: Path, names: Mapping[str, str], units: Mapping[str, str]) -> Recording:
    """The recording in a file of another tool, in ascending time, SI units and names of this project.

    `names` maps columns or arrays of the file to ours, `units` columns or arrays of the file to units of measurement.
    Raises InputError for a file that is not such a table, and for names and units that do not exist.
    """
    readers = {".csv": _read_csv, ".parquet": _read_parquet, ".mat": _read_mat, ".mf4": _read_mf4}
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise InputError("RUN", f"must be a folder of results or a file {', '.join(SUFFIXES)}", str(path))
    if not path.is_file():
        raise InputError("RUN", "must be a folder or file that exists", str(path))
    columns = readers[suffix](path)
    time_name = next((name for name in columns if _TIME.fullmatch(name.strip())), None)
    if time_name is None:
        raise InputError("", "must have a column named time or t", source=str(path))
    time = columns.pop(time_name) * _time_factor(time_name, units, path)
    if len(time) < 2 or np.any(np.diff(time) < 0) or not np.isfinite(time).all():
        raise InputError("", "must have ascending times, at least two", source=str(path))
    if repeated := np.flatnonzero(np.diff(time) == 0).tolist():  # events: the last row of a time holds
        keep = np.setdiff1d(np.arange(len(time)), repeated)
        time, columns = time[keep], {name: values[keep] for name, values in columns.items()}
    renamed = _renamed(columns, names, units, path)
    values = np.column_stack(list(renamed.values())) if renamed else np.empty((len(time), 0))
    return Recording(time=time, columns=list(renamed), values=values, wall_seconds=float("nan"), steps=len(time) - 1)


def _time_factor(name: str, units: Mapping[str, str], path: Path) -> float:
    match = _TIME.fullmatch(name.strip())
    written = match["unit"] if match else None
    unit = units.get(name, units.get("time", written or "s"))
    return _factor(unit, name)


def _factor(unit: str, name: str) -> float:
    if unit not in UNITS:
        raise InputError("--unit", f"of {name} must be a known unit" + suggestion(unit, UNITS), unit)
    return UNITS[unit]


def _renamed(
    columns: dict[str, Array], names: Mapping[str, str], units: Mapping[str, str], path: Path
) -> dict[str, Array]:
    """The columns under our names in SI units; an entry of an array applies to its elements."""
    used: set[str] = set()

    def entry(table: Mapping[str, str], column: str) -> tuple[str, str] | None:
        """The entry's value, and what of the column's name it does not cover."""
        base = column[: column.rindex("[")] if column.endswith("]") and "[" in column else column
        for key in (column, base):
            if key in table:
                used.add(key)
                return table[key], column[len(key) :]
        return None

    renamed = {}
    for column, values in columns.items():
        target = entry(names, column)
        unit = entry(units, column)
        ours = target[0] + target[1] if target else column
        if ours in renamed:
            raise InputError("--map", "must not give two columns one name", ours)
        renamed[ours] = values * (_factor(unit[0], column) if unit else 1.0)
    for option, table in (("--map", names), ("--unit", units)):
        for key in table:
            if key not in used and not _TIME.fullmatch(key.strip()):
                raise InputError(option, f"names no column of {path}" + suggestion(key, columns), key)
    return renamed


def _read_csv(path: Path) -> dict[str, Array]:
    """Columns of numbers under a header; separated by commas, semicolons or tabs."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            line = file.readline()
        separator = max(",;\t", key=line.count)
        header = [name.strip() for name in next(csv.reader([line], delimiter=separator))]
        columns = _numbers(path, separator, len(header))
    except OSError as error:
        raise InputError("", f"cannot be read: {error.strerror}", source=str(path)) from None
    except InputError as error:
        raise error.at(str(path)) from None
    except (StopIteration, ValueError, csv.Error, UserWarning):  # their texts quote the file
        raise InputError("", "is not a CSV file of numbers under a header", source=str(path)) from None
    if len(columns) != len(header) or len(set(header)) != len(header):
        raise InputError("", "is not a CSV file with one name for each column", source=str(path))
    return {name: values for name, values in zip(header, columns, strict=True) if values is not None}


def _numbers(path: Path, separator: str, count: int) -> Sequence[Array | None]:
    """The columns of a CSV file; None for those that are not of numbers. The file may hold true and false, or text."""
    with warnings.catch_warnings(action="error"):
        try:
            table: Array = np.loadtxt(path, delimiter=separator, skiprows=1, ndmin=2, encoding="utf-8-sig")
            return list(table.T)
        except ValueError:
            pass
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [row for row in csv.reader(file, delimiter=separator) if row][1:]
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


def _read_parquet(path: Path) -> dict[str, Array]:
    _require("pyarrow", "formats", path)
    import pyarrow
    import pyarrow.parquet

    try:
        table = pyarrow.parquet.read_table(path)
        numeric = [
            f.name for f in table.schema if pyarrow.types.is_floating(f.type) or pyarrow.types.is_integer(f.type)
        ]
        return {name: np.asarray(table[name].to_numpy(), dtype=float) for name in numeric}
    except (pyarrow.ArrowException, OSError, ValueError):
        raise InputError("", "is not a readable Parquet file", source=str(path)) from None


def _read_mat(path: Path) -> dict[str, Array]:
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
        return {}
    found: dict[str, Array] = {"time": time.astype(float)}
    for name, value in content.items():
        fields = value.items() if isinstance(value, dict) else [("", value)]
        for field, array in fields:
            base = f"{name}.{field}" if field else name
            written = names.get(name, {}).get(field) if isinstance(names.get(name), dict) else None
            found |= _matrix_columns(base, array, len(time), written)
    return found


def _matrix_columns(base: str, array: Any, rows: int, written: Any) -> dict[str, Array]:
    if base.startswith("__") or _TIME.fullmatch(base) or not isinstance(array, np.ndarray):
        return {}
    if array.dtype.kind not in "fiu" or rows not in array.shape or array.ndim > 2:
        return {}
    table = array.reshape(rows, -1) if array.shape[0] == rows else array.T
    labels = [str(name) for name in np.atleast_1d(written)] if written is not None else []
    if len(labels) != table.shape[1]:
        labels = [base] if table.shape[1] == 1 else [f"{base}[{k + 1}]" for k in range(table.shape[1])]
    return dict(zip(labels, table.T.astype(float), strict=True))


def _read_mf4(path: Path) -> dict[str, Array]:
    _require("asammdf", "mf4", path)
    from asammdf import MDF

    try:
        with MDF(path) as file:
            frame = file.to_dataframe(use_interpolation=False, time_from_zero=False)
    except Exception:  # asammdf raises various errors on a damaged file
        raise InputError("", "is not a readable MF4 file", source=str(path)) from None
    numeric = frame.select_dtypes("number")
    return {"time": frame.index.to_numpy(dtype=float), **{str(n): numeric[n].to_numpy(dtype=float) for n in numeric}}


def _require(package: str, extra: str, path: Path) -> None:
    if find_spec(package) is None:
        rule = f"needs the package {package} (pip install 'flexbeams[{extra}]')"
        raise InputError("", rule, source=str(path))
