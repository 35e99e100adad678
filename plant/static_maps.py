"""The CSV file of static gains measured on a rig: what each patch pair does at rest, per volt.

One row a patch pair, in the order of the structure file; columns are found by name:

    # comment lines start with a hash
    pair,y_pi[1] [m/V],...,y_pm[1] [1/V],...,+-y_pi[1] [m/V],...,+-y_pm[1] [1/V],...
    1,-9.7e-06,...

Deflections are in m/V, mm/V, um/V or the same per kV; strains in 1/V, 1/kV, um/m/V or um/m/kV. The columns that start
with +- are optional: half widths of 95 % intervals.
"""

import csv
import io
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexbeams.plant.archive import write_whole
from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion

DEFLECTION_UNITS = {"m/V": 1.0, "mm/V": 1e-3, "um/V": 1e-6, "m/kV": 1e-3, "mm/kV": 1e-6, "um/kV": 1e-9}
STRAIN_UNITS = {"1/V": 1.0, "1/kV": 1e-3, "um/m/V": 1e-6, "um/m/kV": 1e-9}
INTERVAL_MARK = "+-"  # before the name of a column that holds half widths
_HEADER = re.compile(r"^\s*(?P<mark>\+-)?\s*(?P<name>y_p[im]\[\d+\])\s*\[(?P<unit>[^\]]+)\]\s*$")


@dataclass(frozen=True, kw_only=True)
class StaticMaps:
    """Static gains from the voltages of the patch pairs, and how well each is known."""

    deflection: Array  # (n_pi, n_u), m/V
    strain: Array  # (n_pm, n_u), 1/V
    deflection_interval: Array | None = None  # (n_pi, n_u), half widths of 95 % intervals, m/V
    strain_interval: Array | None = None  # (n_pm, n_u), 1/V


def write_static_maps(maps: StaticMaps, path: Path, comment: str = "") -> None:
    """Writes the gains in m/V and 1/V with full precision, the lines of `comment` first."""
    gains = np.vstack([maps.deflection, maps.strain]).T
    names = [f"y_pi[{k}] [m/V]" for k in range(1, len(maps.deflection) + 1)]
    names += [f"y_pm[{k}] [1/V]" for k in range(1, len(maps.strain) + 1)]
    header = ["pair", *names]
    if maps.deflection_interval is not None and maps.strain_interval is not None:
        header += [INTERVAL_MARK + name for name in names]
        gains = np.hstack([gains, np.vstack([maps.deflection_interval, maps.strain_interval]).T])
    text = io.StringIO()
    text.writelines(f"# {line}\n" for line in comment.splitlines())
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([pair, *(repr(float(v)) for v in row)] for pair, row in enumerate(gains, 1))
    write_whole(path, text.getvalue().encode())


def read_static_maps(path: Path | str, *, pairs: int, points: int, gauges: int) -> StaticMaps:
    """The gains in a file for a structure of so many patch pairs, points of interest and strain gauges.

    Raises InputError with file, column, row and reason where a column or pair is missing, unknown or repeated, or
    where a value is not a finite number.
    """
    source = str(path)
    rows = _rows(Path(path), source)
    names = [f"y_pi[{k}]" for k in range(1, points + 1)] + [f"y_pm[{k}]" for k in range(1, gauges + 1)]
    columns = _columns(rows[0][1], names, source)
    values = {key: np.full(pairs, np.nan) for key in columns}
    seen: set[int] = set()
    for line, row in rows[1:]:
        pair = _pair(row, line, pairs, seen, source)
        for key, (column, factor) in columns.items():
            cell = row[column] if column < len(row) else ""
            values[key][pair - 1] = factor * _number(cell, key, line, source)
    if missing := sorted(set(range(1, pairs + 1)) - seen):
        raise InputError(f"pair {missing[0]}", f"has no row; the structure has {pairs} patch pairs", source=source)

    def stack(prefix: str, chosen: list[str]) -> Array:
        return np.array([values[prefix + name] for name in chosen])

    intervals = INTERVAL_MARK + names[0] in columns
    return StaticMaps(
        deflection=stack("", names[:points]),
        strain=stack("", names[points:]),
        deflection_interval=stack(INTERVAL_MARK, names[:points]) if intervals else None,
        strain_interval=stack(INTERVAL_MARK, names[points:]) if intervals else None,
    )


def _rows(path: Path, source: str) -> list[tuple[int, list[str]]]:
    """(line number, cells) of every line that is neither empty nor a comment; the first is the header."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError("", f"is not UTF-8 text: {error.reason}", source=source) from None
    except OSError as error:
        raise InputError("", f"cannot be read: {error.strerror}", source=source) from None
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise InputError("", "has no header line", source=source)
    return [(n, next(csv.reader([line]))) for n, line in lines]


def _columns(header: list[str], names: list[str], source: str) -> dict[str, tuple[int, float]]:
    """Position and factor to SI of each gain by its name; names of intervals start with INTERVAL_MARK."""
    if header[0].strip() != "pair":
        raise InputError("", "must start with the column 'pair'", header[0], source=source)
    found: dict[str, tuple[int, float]] = {}
    for position, text in enumerate(header[1:], 1):
        match = _HEADER.match(text)
        if match is None:
            raise InputError(f"column {text!r}", "must read like 'y_pi[1] [m/V]' or '+-y_pm[2] [1/V]'", source=source)
        name, unit = match["name"], match["unit"].strip()
        if name not in names:
            raise InputError(
                f"column {text!r}", "is not an output of the structure" + suggestion(name, names), source=source
            )
        units = DEFLECTION_UNITS if name.startswith("y_pi") else STRAIN_UNITS
        if unit not in units:
            raise InputError(f"column {text!r}", f"must have one of the units {', '.join(units)}", unit, source=source)
        key = (match["mark"] or "") + name
        if key in found:
            raise InputError(f"column {text!r}", "must not repeat an earlier one", source=source)
        found[key] = (position, units[unit])
    wanted = list(names)
    if any(key.startswith(INTERVAL_MARK) for key in found):
        wanted += [INTERVAL_MARK + name for name in names]
    if missing := [name for name in wanted if name not in found]:
        raise InputError(f"column {missing[0]}", "is missing", source=source)
    return found


def _pair(row: list[str], line: int, pairs: int, seen: set[int], source: str) -> int:
    try:
        pair = int(row[0])
    except ValueError:
        pair = 0
    if not 1 <= pair <= pairs:
        raise InputError(f"row {line}, column pair", f"must be a patch pair from 1 to {pairs}", row[0], source=source)
    if pair in seen:
        raise InputError(f"row {line}, column pair", "must not repeat an earlier row", pair, source=source)
    seen.add(pair)
    return pair


def _number(cell: str, key: str, line: int, source: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"row {line}, column {key}", "must be a finite number", cell, source=source)
    return value
