"""Result files of a run: results.csv or other formats, and summary.json; each is written whole or not at all."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from flexbeams.plant.archive import remove_file, write_whole
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.choices import FORMATS, Format
from flexbeams.scenarios.results.formats import write_mat, write_parquet
from flexbeams.scenarios.simulation.recording import Recording


def write_results(
    folder: Path, recording: Recording, summary: dict[str, Any], formats: Sequence[Format] = ("csv",)
) -> None:
    """Writes results.<format> for each format, then summary.json.

    The summary and other formats of an earlier run are removed first: a missing summary.json marks an unfinished run.
    """
    summary = _plain(summary)
    remove_file(folder / "summary.json")
    writers = {"csv": write_csv, "parquet": write_parquet, "mat": write_mat}
    for kind in FORMATS:
        path = folder / f"results.{kind}"
        if kind in formats:
            writers[kind](path, recording, summary)
        else:
            remove_file(path)
    write_whole(folder / "summary.json", (json.dumps(summary, indent=2) + "\n").encode())


def write_csv(path: Path, recording: Recording, summary: dict[str, Any]) -> None:
    """Writes a CSV file (RFC 4180) with the shortest digits that give the same double."""
    header = ",".join(["time", *(f'"{c}"' if "," in c else c for c in recording.columns)]).encode()
    table = np.column_stack([recording.time, recording.values])
    if np.isfinite(table).all():  # writing JSON, which has no infinities, is the fastest
        rows = orjson.dumps(table, option=orjson.OPT_SERIALIZE_NUMPY)[2:-2].replace(b"],[", b"\n")
    else:
        rows = "\n".join(",".join(map(repr, row)) for row in table.tolist()).encode()
    write_whole(path, header + b"\n" + rows + b"\n")


def read_results(path: Path) -> Recording:
    """The recording in a results.csv; InputError for any other file."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            header = next(csv.reader(file))
        table = np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)
    except (OSError, StopIteration, ValueError) as error:
        raise InputError("", f"is not a results file: {error}", source=str(path)) from None
    return Recording(time=table[:, 0], columns=header[1:], values=table[:, 1:], wall_seconds=float("nan"))


def _plain(value: Any) -> Any:
    """JSON-compatible values: infinities and NaN become null."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
