"""Result files for other tools: Parquet for large tables, MAT for MATLAB and Octave, MF4 for measuring tools.

A Parquet file has the columns of results.csv, with `unit` and `description` in the metadata of each, and summary.json
as the metadata entry `flexbeams`. An MF4 file (4.10) has a channel with unit and comment for each column.

A MAT file (version 5) holds `time` (rows, 1); a struct for each instance with a field for each variable, scalars
(rows, 1) and arrays (rows, elements) in the order of their indices: plant.y_pi(:, 2) is `plant.y_pi[2]`; the struct
`columns` of the same form with the names of those columns as cells, as `units` and `descriptions` have these; and the
struct `run` with entries of summary.json.
Indices are removed from names, and characters other than letters, digits and underscores become underscores:
`plant.beam[2].tip_mass` is plant.beam_tip_mass. A name that does not begin with a letter gets the prefix x, a duplicate
a number at its end.
"""

import io
import json
import re
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from importlib.util import find_spec
from itertools import count
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.plant.temporary import temporary_folder
from flexbeams.scenarios.definition.choices import FORMATS, Format
from flexbeams.scenarios.definition.declaration import by_index
from flexbeams.scenarios.simulation.recording import Recording

_ROWS_IN_GROUP = 2**17  # of a Parquet or MF4 file
_COPIED = 2**24  # bytes together
_MAX_NAME_LENGTH = 63  # characters of a MATLAB name
_MAX_ARRAY_BYTES = 2**31 - 2**16  # bytes of a variable in a MAT file of version 5
_KEYWORDS = (
    "break",
    "case",
    "catch",
    "classdef",
    "continue",
    "else",
    "elseif",
    "end",
    "for",
    "function",
    "global",
    "if",
    "otherwise",
    "parfor",
    "persistent",
    "return",
    "spmd",
    "switch",
    "try",
    "while",
)
_RUN = ("scenario", "title", "design_id", "coupling", "backend", "complete", "decimate")


def require_formats(formats: Sequence[Format]) -> None:
    """InputError for an unknown format, and where one needs a package that is not installed."""
    if isinstance(formats, str):
        raise InputError("formats", "must be a list, such as ['csv']", formats)
    for name in formats:
        if name not in FORMATS:
            raise InputError("formats", f"must be of {', '.join(FORMATS)}", name)
    for name, package, extra in (("parquet", "pyarrow", "formats"), ("mf4", "asammdf", "mf4")):
        if name in formats and find_spec(package) is None:
            rule = f"{name} needs the package {package} (pip install 'flexbeams[{extra}]')"
            raise InputError("--format", rule)


class Output(Protocol):
    """A binary file to write."""

    def write(self, content: bytes, /) -> int:
        """Appends the content."""
        ...


def write_parquet(file: Output, recording: Recording, summary: dict[str, Any]) -> None:
    """A file with a column of doubles for the time and for each signal; long recordings in groups of rows."""
    import pyarrow
    import pyarrow.parquet

    about = {"time": {"unit": "s", "description": "Time"}, **summary.get("signals", {})}
    fields = [pyarrow.field(name, pyarrow.float64(), metadata=about.get(name)) for name in ("time", *recording.columns)]
    schema = pyarrow.schema(fields, metadata={"flexbeams": json.dumps(summary)})
    with pyarrow.parquet.ParquetWriter(file, schema) as writer:
        for time, values in recording.blocks(rows=_ROWS_IN_GROUP):
            columns = [np.ascontiguousarray(column) for column in (time, *values.T)]
            writer.write_table(pyarrow.table(columns, schema=schema))


def write_mat(file: Output, recording: Recording, summary: dict[str, Any]) -> None:
    """A MAT file of version 5; InputError where an array is too large for that format."""
    from scipy.io import savemat

    structs, columns = _structs(recording)
    about = summary.get("signals", {})
    texts = {
        f"{key}s": {
            owner: {
                field: np.array([about.get(str(name), {}).get(key, "") for name in names], dtype=object)
                for field, names in fields.items()
            }
            for owner, fields in columns.items()
        }
        for key in ("unit", "description")
    }
    largest = max((array.nbytes for struct in structs.values() for array in struct.values()), default=0)
    if largest > _MAX_ARRAY_BYTES:
        raise InputError(
            "",
            "must have arrays of less than 2 GiB in a MAT file of version 5 (use --decimate or --format parquet)",
            f"{largest / 2**30:.1f} GiB",
        )
    buffer = io.BytesIO()
    savemat(
        buffer,
        {
            "time": recording.time[:, None],
            **structs,
            "columns": columns,
            **(texts if about else {}),
            "run": {key: summary[key] for key in _RUN if key in summary},
        },
        long_field_names=True,
        do_compression=True,
    )
    file.write(b"MATLAB 5.0 MAT-file, written by flexbeams".ljust(116))  # in place of the date
    file.write(buffer.getvalue()[116:])


def write_mf4(file: Output, recording: Recording, summary: dict[str, Any]) -> None:
    """An MF4 file with a channel for each signal."""
    from asammdf import MDF, Signal

    about = summary.get("signals", {})
    blocks = recording.blocks(rows=_ROWS_IN_GROUP)
    time, values = next(blocks)
    signals = [
        Signal(
            np.ascontiguousarray(values[:, k]),
            np.ascontiguousarray(time),
            name=name,
            unit=about.get(name, {}).get("unit", ""),
            comment=about.get(name, {}).get("description", ""),
        )
        for k, name in enumerate(recording.columns)
    ]
    with temporary_folder() as folder, MDF(version="4.10") as measured:
        measured.start_time = datetime(1980, 1, 1, tzinfo=UTC)  # no date, so that equal runs give equal files
        measured.append(signals, comment=str(summary.get("title", "")), common_timebase=True)
        for time, values in blocks:
            measured.extend(0, [(np.ascontiguousarray(column), None) for column in (time, *values.T)])
        with Path(measured.save(folder / "results.mf4")).open("rb") as written:
            while content := written.read(_COPIED):
                file.write(content)


def _structs(recording: Recording) -> tuple[dict[str, dict[str, Array]], dict[str, dict[str, Any]]]:
    """Structs of arrays, and of the columns' names, by instance and variable."""
    grouped: dict[str, dict[str, list[int]]] = {}
    places = {column: k for k, column in enumerate(recording.columns)}
    for column in recording.columns:
        owner, _, variable = column.partition(".")
        grouped.setdefault(owner, {}).setdefault(re.sub(r"\[[^\]]*\]", "", variable), []).append(places[column])
    for variables in grouped.values():
        for base, indices in variables.items():
            variables[base] = [places[n] for n in by_index(recording.columns[k] for k in indices)]
    owners = matlab_names(grouped, taken=["time", "columns", "units", "descriptions", "run"])
    structs: dict[str, dict[str, Array]] = {}
    columns: dict[str, dict[str, Any]] = {}
    for owner, variables in grouped.items():
        fields = matlab_names(variables)
        structs[owners[owner]] = {fields[n]: recording.values[:, indices] for n, indices in variables.items()}
        columns[owners[owner]] = {
            fields[n]: np.array([recording.columns[k] for k in indices], dtype=object)
            for n, indices in variables.items()
        }
    return structs, columns


def matlab_names(names: Iterable[str], taken: Iterable[str] = ()) -> dict[str, str]:
    """A valid MATLAB name for each name, all different and none of those taken."""
    used, chosen = {*taken, *_KEYWORDS}, {}
    for name in names:
        text = re.sub(r"[^A-Za-z0-9_]", "_", name)
        text = (text if text[:1].isalpha() else f"x{text}")[:_MAX_NAME_LENGTH]
        candidates = (f"{text[: _MAX_NAME_LENGTH - 4]}_{k}" for k in count(2))
        chosen[name] = text if text not in used else next(c for c in candidates if c not in used)
        used.add(chosen[name])
    return chosen
