"""Large result files of runs, read in blocks into a file of rows, so that they need little memory."""

import csv
from collections.abc import Iterator
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.row_file import LeftRows, RowFile

LARGE = 2**26  # bytes of a file that is read in blocks
_ROWS = 2**13  # of a block: they stay in the processor's cache while they are put side by side


def read_long(path: Path) -> Recording | None:
    """The recording in a large results.csv, .parquet or .mf4; None for a smaller file, which may be read at once.

    Raises InputError for a file that is not as a run writes it.
    """
    readers = {".csv": _csv, ".parquet": _parquet, ".mf4": _mf4}
    if path.suffix not in readers or path.stat().st_size < LARGE:
        return None
    try:
        names, blocks = readers[path.suffix](path)
        if names[:1] != ["time"] or len(set(names)) != len(names):
            raise ValueError
        file = RowFile(names[1:])
        for block in blocks:
            file.append(block)
    except InputError:
        raise
    except Exception:  # readers raise various errors on a damaged file, and their texts may quote it
        raise InputError("", "is not a readable file of results", source=str(path)) from None
    return recorded_rows(file, names[1:])


def read_partial(path: Path) -> Recording:
    """The rows that a run left which was killed, where they are; InputError for a file that cannot be read."""
    try:
        file = LeftRows(path)
    except (OSError, ValueError, EOFError):
        raise InputError("", "has no rows that can be read", source=str(path)) from None
    return recorded_rows(file, file.columns)


def recorded_rows(file: RowFile, columns: list[str]) -> Recording:
    """The recording in a file of rows."""
    table = file.mapped()
    return Recording(
        time=table[:, 0],
        columns=columns,
        values=table[:, 1:],
        wall_seconds=float("nan"),
        steps=max(file.count - 1, 0),
        file=file,
    )


def _csv(path: Path) -> tuple[list[str], Iterator[Array]]:
    """Names of the columns, and the rows; a second row of units of measurement is skipped."""
    with path.open(newline="", encoding="utf-8") as file:
        lines = csv.reader(file)
        names, second = next(lines), next(lines)
    head = 2 if second[:1] == ["s"] else 1
    return names, (_arrow_csv if find_spec("pyarrow") is not None else _text)(path, head, len(names))


def _arrow_csv(path: Path, head: int, width: int) -> Iterator[Array]:
    import pyarrow.csv

    columns = [str(k) for k in range(width)]
    options = pyarrow.csv.ReadOptions(column_names=columns, skip_rows=head, block_size=2**21)
    plain = pyarrow.csv.ParseOptions(quote_char=False)
    doubles = pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(columns, pyarrow.float64()), null_values=[])
    for batch in pyarrow.csv.open_csv(path, read_options=options, parse_options=plain, convert_options=doubles):
        yield np.column_stack([column.to_numpy(zero_copy_only=False) for column in batch.columns])


def _text(path: Path, head: int, width: int) -> Iterator[Array]:
    with path.open(encoding="utf-8") as file:
        lines = islice(file, head, None)
        while text := list(islice(lines, _ROWS)):
            yield np.loadtxt(text, delimiter=",", ndmin=2)


def _parquet(path: Path) -> tuple[list[str], Iterator[Array]]:
    import pyarrow.parquet

    file = pyarrow.parquet.ParquetFile(path)
    batches = file.iter_batches(batch_size=_ROWS)
    rows = (np.column_stack([c.to_numpy(zero_copy_only=False) for c in batch.columns]) for batch in batches)
    return list(file.schema_arrow.names), rows


def _mf4(path: Path) -> tuple[list[str], Iterator[Array]]:
    """Records of doubles as runs write them: one group, not compressed."""
    from asammdf import MDF

    with path.open("rb") as stream, MDF(stream) as file:  # which maps a file that it opens itself into memory
        group: Any = file.groups[0]
        names, blocks = [channel.name for channel in group.channels], list(group.get_data_blocks())
        layout = [(channel.data_type, channel.bit_count, channel.byte_offset) for channel in group.channels]
    width = len(names)
    sizes = [int(block.original_size) for block in blocks]
    plain = layout == [(4, 64, 8 * k) for k in range(width)] and all(size % (8 * width) == 0 for size in sizes)
    if not plain or any(block.block_type != 0 for block in blocks):
        raise ValueError
    part = 8 * width * _ROWS
    return names, (
        np.fromfile(path, "<f8", min(part, size - first) // 8, offset=block.address + first).reshape(-1, width)
        for block, size in zip(blocks, sizes, strict=True)
        for first in range(0, size, part)
    )
