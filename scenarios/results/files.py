"""Result files of a run: results.csv or other formats; each is written whole or not at all."""

import csv
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import Format
from flexbeams.scenarios.results.folder import ResultFolder
from flexbeams.scenarios.results.formats import Output, write_mat, write_mf4, write_parquet
from flexbeams.scenarios.simulation.recording import Recording

_LINES_TOGETHER = 1000  # of a CSV file: their text stays in the processor's cache


def write_results(
    path: Path, recording: Recording, summary: dict[str, Any], formats: Sequence[Format] = ("csv",)
) -> None:
    """Writes results.<format> for each format and summary.json into the folder `path`.

    Raises InputError for a file in the way that no earlier run wrote.
    """
    with ResultFolder(path) as folder:
        folder.require_free([f"results.{kind}" for kind in formats])
        folder.begin({})
        write_formats(folder, recording, json_values(summary), formats)
        folder.finish(json_values(summary))


def write_formats(
    folder: ResultFolder, recording: Recording, summary: dict[str, Any], formats: Sequence[Format] = ("csv",)
) -> None:
    """Writes results.<format> for each format; `summary` is of JSON's types."""
    writers = {"csv": write_csv, "parquet": write_parquet, "mat": write_mat, "mf4": write_mf4}
    for kind in formats:
        path = folder.path / f"results.{kind}"
        try:
            with folder.writing(path) as file:
                writers[kind](file, recording, summary)
        except InputError as error:
            raise error if error.source else error.at(str(path)) from None


def write_csv(file: Output, recording: Recording, summary: dict[str, Any]) -> None:
    """A CSV file (RFC 4180) with the shortest digits that give the same double; units in row 2, if asked for."""
    file.write((",".join(map(_quoted, ["time", *recording.columns])) + "\n").encode())
    if recording.units_row:
        units = [recording.units.get(name, "") for name in recording.columns]
        file.write((",".join(map(_quoted, ["s", *units])) + "\n").encode())
    for time, values in recording.blocks():
        for begin in range(0, len(time), _LINES_TOGETHER):
            part = slice(begin, begin + _LINES_TOGETHER)
            file.write(b"".join(_lines(np.column_stack([time[part], values[part]]))))


def _lines(table: Array) -> list[bytes]:
    """A line for each row, ended."""
    if np.isfinite(table).all():  # writing JSON, which has no infinities, is the fastest
        return [orjson.dumps(row, option=orjson.OPT_SERIALIZE_NUMPY)[1:-1] + b"\n" for row in table]
    return [(",".join(map(repr, row)) + "\n").encode() for row in table.tolist()]


def _quoted(text: str) -> str:
    """A cell, in quotes where it needs them; quotes inside are doubled."""
    if not any(c in text for c in ',"\r\n') and text == text.strip():
        return text
    return '"' + text.replace('"', '""') + '"'


def read_results(path: Path) -> Recording:
    """The recording in a results.csv; InputError for any other file."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = csv.reader(file)
            header = next(lines)
            second = next(lines, [])
        units = second[1:] if second[:1] == ["s"] and len(second) == len(header) else []
        with warnings.catch_warnings(action="error"):  # of a file without data
            table = np.loadtxt(path, delimiter=",", skiprows=2 if units else 1, ndmin=2)
    except OSError as error:
        raise InputError("", f"cannot be read: {error.strerror}", source=str(path)) from None
    except (StopIteration, ValueError, csv.Error, UserWarning):  # their texts quote the file
        raise InputError("", "is not a CSV file of numbers under a header", source=str(path)) from None
    if table.shape[1] != len(header) or header[:1] != ["time"]:
        rule = "is not a CSV file of numbers with the columns of its header, time first"
        raise InputError("", rule, source=str(path))
    return Recording(
        time=table[:, 0],
        columns=header[1:],
        values=table[:, 1:],
        wall_seconds=float("nan"),
        units=dict(zip(header[1:], units, strict=True)) if units else {},
        units_row=bool(units),
    )


def json_values(value: Any) -> Any:
    """JSON-compatible values: infinities and NaN become null."""
    if isinstance(value, dict):
        return {k: json_values(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [json_values(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
