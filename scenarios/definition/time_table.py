"""Signals measured elsewhere: a CSV file with the time in its first column."""

import csv
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion


@dataclass(frozen=True, kw_only=True)
class TimeTable:
    """Rows of values, row k from time[k] on."""

    time: Array  # (rows,), s, ascending
    columns: list[str]  # names of the header, without the time's
    values: Array  # (rows, len(columns))

    def select(self, names: list[str]) -> Array:
        """The columns named, (rows, k); a name also stands for all its elements name[1], name[2] ... in order.

        Raises InputError for a name that the header has not.
        """
        places: list[int] = []
        for name in names:
            found = [k for k, c in enumerate(self.columns) if c == name or c.startswith(f"{name}[")]
            if not found:
                raise InputError("columns", "names no column of the file" + suggestion(name, self.columns), name)
            places += found
        return self.values[:, places]


def read_time_table(path: Path, jumps: bool = False) -> TimeTable:
    """A CSV file (commas, a header row, the time in s first), checked; InputError names file, row and column.

    With `jumps` several rows may have one time.
    """
    source = str(path)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [(k, row) for k, row in enumerate(csv.reader(file), 1) if row]
    except UnicodeDecodeError as error:
        raise InputError("", f"is not UTF-8 text: {error.reason}", source=source) from None
    except csv.Error as error:
        raise InputError("", f"is not a CSV file: {error}", source=source) from None
    except OSError as error:
        raise InputError("", f"cannot be read: {error.strerror}", source=source) from None
    if not rows:
        raise InputError("", "must have a header row", source=source)
    number, header = rows[0][0], [name.strip() for name in rows[0][1]]
    if len(header) < 2:
        raise InputError(
            f"row {number}",
            "must name the time and at least one more column, separated by commas",
            ",".join(header),
            source=source,
        )
    repeated = next((name for k, name in enumerate(header) if name in header[:k]), None)
    if repeated is not None:
        raise InputError(f"row {number}", "must name each column once", repeated, source=source)
    if all(_is_number(name) for name in header):
        raise InputError(f"row {number}", "must be a header that names the columns", ",".join(header), source=source)
    if len(rows) < 2:
        raise InputError("", "must have at least one row below the header", source=source)
    table = np.array([_numbers(row, number, header, source) for number, row in rows[1:]])
    apart = np.diff(table[:, 0])
    late = np.flatnonzero(apart < 0 if jumps else apart <= 0)
    if len(late):
        number, row = rows[late[0] + 2]
        raise InputError(
            f"row {number}, column {header[0]!r}",
            f"must be {'>=' if jumps else '>'} {table[late[0], 0]:g}, the time of the row before",
            float(row[0]),
            source=source,
        )
    return TimeTable(time=table[:, 0], columns=header[1:], values=table[:, 1:])


def _numbers(row: list[str], number: int, header: list[str], source: str) -> list[float]:
    if len(row) != len(header):
        raise InputError(f"row {number}", f"must have {len(header)} columns as the header", len(row), source=source)
    try:
        values = [float(cell) for cell in row]
    except ValueError:
        values = []
    if not values or not all(map(isfinite, values)):
        k = next(k for k, cell in enumerate(row) if not _is_number(cell))
        raise InputError(f"row {number}, column {header[k]!r}", "must be a finite number", row[k], source=source)
    return values


def _is_number(text: str) -> bool:
    try:
        return isfinite(float(text))
    except ValueError:
        return False
