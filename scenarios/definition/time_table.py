"""Signals measured elsewhere: a CSV file with a column of times."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError, suggestion
from flexbeams.plant.number_table import read_number_table


@dataclass(frozen=True, kw_only=True)
class TimeTable:
    """Rows of values, row k from time[k] on."""

    time: Array  # (rows,), s, ascending
    columns: list[str]  # names of the header, without the time's
    values: Array  # (rows, len(columns))

    def select(self, names: list[str]) -> Array:
        """The columns named, (rows, k); a name also stands for all its elements name[1], name[2] ... in order.

        Raises InputError for a name that the header does not have.
        """
        return self.values[:, self._chosen(names)]

    def names(self, names: list[str]) -> list[str]:
        """The names of the columns that `select` gives."""
        return [self.columns[k] for k in self._chosen(names)]

    def _chosen(self, names: list[str]) -> list[int]:
        chosen: list[int] = []
        for name in names:
            matches = [k for k, c in enumerate(self.columns) if c == name or c.startswith(f"{name}[")]
            if not matches:
                raise InputError("columns", "names no column of the file" + suggestion(name, self.columns), name)
            chosen += sorted(matches, key=lambda k: element_index(self.columns[k]))
        return chosen

    def belongs_to(self, variable: str) -> bool:
        """Whether the columns are named like the input "instance.name" or its elements."""
        owner, _, name = variable.partition(".")
        own = [c.removeprefix(f"{owner}.") for c in self.columns]
        return any(c == name or (c.startswith(f"{name}[") and bool(element_index(c))) for c in own)

    def elements_of(self, variable: str) -> Array:
        """All columns, (rows, k), for the elements of an input "instance.name": by number where the header names them.

        Elements are named name[2] or instance.name[2]. Raises InputError where only some columns are named so, or an
        element is missing.
        """
        owner, _, name = variable.partition(".")
        own = [c.removeprefix(f"{owner}.") for c in self.columns]
        named = [c == name or (c.startswith(f"{name}[") and bool(element_index(c))) for c in own]
        if not any(named):
            return self.values
        if not all(named):
            other = self.columns[named.index(False)]
            raise InputError("columns", f"must choose columns: some of the file belong to {variable}, not", other)
        order = sorted(range(len(own)), key=lambda k: element_index(own[k]))
        numbers = [element_index(own[k]) for k in order]
        if len(own) > 1 and numbers != [(k,) for k in range(1, len(own) + 1)]:
            raise InputError("columns", f"must have one column for each element of {variable}", ", ".join(self.columns))
        return self.values[:, order]


def element_index(name: str) -> tuple[int, ...]:
    """The index of an element, (2, 10) of w[2,10]; empty for a name without one."""
    match = re.fullmatch(r"[^\[\]]*\[([0-9]+(?:,[0-9]+)*)\]", name)
    return tuple(map(int, match[1].split(","))) if match else ()


def read_time_table(path: Path, jumps: bool = False) -> TimeTable:
    """A CSV file (commas, a header row), checked; InputError names file, row and column.

    The time (s) is the column called time, or the first one where no column has that name. With `jumps` several rows
    may have one time.
    """
    table, source = read_number_table(path), str(path)
    header, place = table.header, f"row {table.header_row}"
    if len(header) < 2:
        rule = "must name the time and at least one more column, separated by commas"
        raise InputError(place, rule, ",".join(header), source=source)
    clock = _time_column(header, place, source)
    times = table.values[:, clock]
    increments = np.diff(times)
    late = np.flatnonzero(increments < 0 if jumps else increments <= 0)
    if len(late):
        row = late[0] + 1
        rule = f"must be {'>=' if jumps else '>'} {times[row - 1]:g}, the time of the row before"
        raise InputError(f"row {table.rows[row]}, column {header[clock]!r}", rule, float(times[row]), source=source)
    others = [k for k in range(len(header)) if k != clock]
    return TimeTable(time=times, columns=[header[k] for k in others], values=table.values[:, others])


def _time_column(header: list[str], place: str, source: str) -> int:
    """The index of the column of times."""
    clocks = [k for k, name in enumerate(header) if name.casefold() in ("time", "t")]
    exact = [k for k in clocks if header[k] == "time"]
    clocks = exact or clocks
    if len(clocks) > 1:
        raise InputError(place, "must name one column time", ", ".join(header[k] for k in clocks), source=source)
    return clocks[0] if clocks else 0
