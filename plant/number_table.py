"""Tables of numbers in CSV files: a header row and rows of finite numbers, separated by commas."""

import csv
import re
from dataclasses import dataclass
from itertools import takewhile
from math import isfinite
from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.text import is_decimal
from flexbeams.plant.validation import read_text

_DECIMAL_COMMA = re.compile(r"\s*[-+]?[0-9]+,[0-9]+\s*")


@dataclass(frozen=True, kw_only=True)
class NumberTable:
    """Rows are counted as in the file, from 1."""

    header: list[str]
    header_row: int
    rows: list[int]
    values: Array  # (rows, columns)


def read_number_table(path: Path) -> NumberTable:
    """The table in a file; InputError that names the row and the column of the first fault.

    Empty rows are left out, and lines before the header that begin with #; the last of these is the header where no
    other one is.
    """
    source = str(path)
    lines = [(k, line) for k, line in enumerate(read_text(path).splitlines(), 1) if line.strip()]
    comments = list(takewhile(lambda entry: entry[1].startswith("#"), lines))
    lines = lines[len(comments) :]
    if comments and (not lines or all(map(_is_finite, _cells(lines[0][1], source)))):
        lines.insert(0, (comments[-1][0], comments[-1][1].lstrip("#")))
    if not lines:
        raise InputError("", "must have a header row", source=source)
    (place, first), *rows = lines
    header = _header(first, place, source)
    if not rows:
        raise InputError("", "must have at least one row below the header", source=source)
    try:
        values: Array = np.loadtxt([line for _, line in rows], delimiter=",", quotechar='"', ndmin=2, comments=None)
    except ValueError:
        raise _fault(header, rows, source) from None
    if values.shape[1] != len(header) or not np.isfinite(values).all():
        raise _fault(header, rows, source)
    return NumberTable(header=header, header_row=place, rows=[k for k, _ in rows], values=values)


def _header(line: str, place: int, source: str) -> list[str]:
    """The names of the columns, each once."""
    if ";" in line and "," not in line:
        rule = "has columns separated by semicolons; use commas, and points in decimal numbers"
        raise InputError(f"row {place}", rule, source=source)
    header = [name.strip() for name in _cells(line, source)]
    if repeated := [name for k, name in enumerate(header) if name in header[:k]]:
        raise InputError(f"row {place}", "must name each column once", repeated[0], source=source)
    if all(map(_is_finite, header)):
        raise InputError(f"row {place}", "must be a header that names the columns", ",".join(header), source=source)
    return header


def _cells(line: str, source: str) -> list[str]:
    try:
        return next(csv.reader([line]), [])
    except csv.Error as error:
        raise InputError("", f"is not a CSV file: {error}", source=source) from None


def _fault(header: list[str], rows: list[tuple[int, str]], source: str) -> InputError:
    """The first fault of rows that are not all finite numbers."""
    for number, line in rows:
        cells = _cells(line, source)
        if len(cells) != len(header):
            hint = " (decimal commas? write 0.5, not 0,5)" if len(cells) > len(header) else ""
            rule = f"must have {len(header)} values as the header{hint}"
            return InputError(f"row {number}", rule, len(cells), source=source)
        for name, cell in zip(header, cells, strict=True):
            place = f"row {number}, column {name!r}"
            if _DECIMAL_COMMA.fullmatch(cell):
                return InputError(place, "has a decimal comma; write 0.5, not 0,5", cell, source=source)
            if not _is_finite(cell):
                return InputError(place, "must be a finite number", cell, source=source)
    return InputError("", "is not a table of numbers", source=source)


def _is_finite(cell: str) -> bool:
    """Whether a cell is a finite decimal number."""
    return is_decimal(cell.strip()) and isfinite(float(cell))
