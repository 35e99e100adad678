"""Rows of a long recording in a file: a NumPy array that can be read while it grows, and after its process was killed.

The file is in NumPy's format .npy, version 3, with a field of doubles for the time and for each column: `np.load(file)`
gives it, `np.load(file)["plant.y_pi[1]"]` one signal. From some 350 columns on NumPy asks for `max_header_size=2**20`.
"""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError

_MAGIC = b"\x93NUMPY\x03\x00"
_ALIGNMENT = 64  # bytes
_LARGEST_HEAD = 2**20  # bytes; NumPy refuses more than 10,000 unless told
_ROWS = 2**14  # that are read together
_DIGITS = 20  # of the number of rows in the header


class RowFile:
    """A file of rows (time, values), written at its end and read anywhere.

    `path` None stands for a temporary file without a name. Raises InputError for a file that cannot be written.
    """

    def __init__(self, columns: Sequence[str], path: Path | None = None) -> None:
        self.path, self.width, self.count = path, 1 + len(columns), 0
        self._least, self._last = np.inf, np.empty(0)  # s: shortest time between two rows, time of the last one
        self._names = ["time", *columns]
        self._head_size = len(self._head(0))
        try:
            if path is not None:
                path.unlink(missing_ok=True)  # who reads rows that an earlier run left there goes on reading these
            self._file = tempfile.TemporaryFile() if path is None else path.open("w+b")  # noqa: SIM115
        except OSError as error:
            raise self._unwritable(error) from None
        self.append(np.empty((0, self.width)))

    def append(self, rows: Array) -> None:
        """Writes rows (k, 1 + columns) of later times at the end; InputError where the disk is full."""
        self.write(self.count, rows)
        self.count += len(rows)
        self._note_times(rows[:, 0])
        self._put(0, self._head(self.count))

    def _note_times(self, times: Array) -> None:
        if len(times):
            self._least = min(self._least, float(np.diff(times, prepend=self._last).min(initial=np.inf)))
            self._last = times[-1:].copy()

    @property
    def least_interval(self) -> float:
        """The shortest time between two rows, s; infinite for one row."""
        return self._least

    def write(self, first: int, rows: Array) -> None:
        """Writes rows (k, 1 + columns) from row `first` on; InputError where the disk is full."""
        if len(rows):
            self._put(self._head_size + first * self._row_bytes, np.ascontiguousarray(rows, dtype="<f8").data.cast("B"))

    def _put(self, place: int, content: bytes | memoryview) -> None:
        try:
            self._file.seek(place)
            self._file.write(content)
            self._file.flush()
        except OSError as error:
            raise self._unwritable(error) from None

    def read(self, first: int, stop: int) -> Array:
        """Rows first ... stop - 1, a copy (stop - first, 1 + columns)."""
        rows = np.empty((stop - first, self.width))
        self._file.seek(self._head_size + first * self._row_bytes)
        if len(rows) and self._file.readinto(rows.data.cast("B")) != rows.nbytes:
            raise OSError(f"{self.path or 'the temporary file of the recording'} was cut short")
        return rows

    def mapped(self) -> Array:
        """All rows (count, 1 + columns), read from the file where they are used; read-only."""
        return np.memmap(self._file, dtype="<f8", mode="r", offset=self._head_size, shape=(self.count, self.width))

    def close(self) -> None:
        """Removes the file."""
        self._file.close()
        if self.path is not None:
            self.path.unlink(missing_ok=True)

    @property
    def _row_bytes(self) -> int:
        return 8 * self.width

    def _head(self, count: int) -> bytes:
        fields = [(name, "<f8") for name in self._names]
        text = f"{{'descr': {fields!r}, 'fortran_order': False, 'shape': ({count},), }}"
        length = len(text.encode()) - len(str(count)) + _DIGITS + 1
        length += -(len(_MAGIC) + 4 + length) % _ALIGNMENT
        padded = text.encode().ljust(length - 1) + b"\n"
        return _MAGIC + length.to_bytes(4, "little") + padded

    def _unwritable(self, error: OSError) -> InputError:
        where = str(self.path or os.path.join(tempfile.gettempdir(), "a temporary file"))
        return InputError("", f"cannot be written: {error.strerror or error}", source=where)


class LeftRows(RowFile):
    """The rows in a file that another process wrote, read where they are; the file stays.

    Raises OSError, EOFError or ValueError where there are none.
    """

    def __init__(self, path: Path) -> None:
        rows = np.load(path, mmap_mode="r", max_header_size=_LARGEST_HEAD)
        if not isinstance(rows, np.memmap):  # an archive of arrays
            raise ValueError
        self._names = list(rows.dtype.names or [])
        if self._names[:1] != ["time"] or not len(rows) or rows.dtype != [(name, "<f8") for name in self._names]:
            raise ValueError
        self.path, self.width, self.count = None, len(self._names), len(rows)
        self._head_size = int(rows.offset)
        self._file = path.open("rb")  # type: ignore[assignment]

    @property
    def columns(self) -> list[str]:
        """Names of the columns."""
        return self._names[1:]

    @property
    def least_interval(self) -> float:
        """See RowFile; looked for in all rows."""
        self._least, self._last = np.inf, np.empty(0)
        for first in range(0, self.count, _ROWS):
            self._note_times(self.read(first, min(first + _ROWS, self.count))[:, 0])
        return self._least
