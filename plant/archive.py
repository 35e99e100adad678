"""Archives whose bytes depend on their contents only, and atomic writing of files."""

import io
import os
import re
import threading
import time
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from os.path import exists, isfile
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from flexbeams.plant.errors import InputError
from flexbeams.plant.locks import Lock

_ATTEMPTS = 100  # to make a draft that no other writer of the same file sweeps before it is locked
_EARLIEST = 315532800  # s since 1970: 1980-01-01, the first date of the zip format


def zip_bytes(entries: Mapping[str, bytes]) -> bytes:
    """The entries (path with / to content) as a zip archive, sorted.

    Uncompressed, because compressors differ between platforms. Time stamps are those of SOURCE_DATE_EPOCH (s)
    or 1980-01-01.
    """
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH", _EARLIEST))
    stamp = time.gmtime(max(seconds, _EARLIEST))[:6]
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name in sorted(entries):
            info = zipfile.ZipInfo(name, stamp)
            info.create_system = 3  # Unix on every platform
            info.external_attr = 0o100644 << 16
            archive.writestr(info, entries[name])
    return buffer.getvalue()


def write_whole(path: Path, content: bytes) -> None:
    """Writes a file atomically: under a temporary name in its folder, then renamed.

    Raises InputError where it cannot be written, or where something other than a file has the name, such as a device.
    """
    with whole_file(path) as file:
        file.write(content)


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write, which gets its name at the end, or does not exist after an error; errors as of write_whole."""
    if exists(path) and not isfile(path):
        raise InputError("", "must be a regular file or a new path", source=str(path))
    draft = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_native_id()}.tmp")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep_drafts(path)
        with _draft(draft) as file:
            yield file
            file.close()
            draft.replace(path)
    except OSError as error:
        raise InputError("", f"cannot be written: {error.strerror or error}", source=str(path)) from None


@contextmanager
def _draft(draft: Path) -> Iterator[BinaryIO]:
    """A new file, locked so that it counts as in use, and removed at the end if it is still there."""
    try:
        for _ in range(_ATTEMPTS):
            with draft.open("wb") as file, _lock(draft):
                if exists(draft):
                    yield file
                    return
    finally:
        draft.unlink(missing_ok=True)
    raise FileNotFoundError("another process removes it again and again")


def _sweep_drafts(path: Path) -> None:
    """Removes drafts of a file that killed processes left; on Windows, those in use cannot be removed."""
    name = re.compile(rf"\.{re.escape(path.name)}\.[0-9-]+\.tmp")
    with os.scandir(path.parent) as entries:
        drafts = [Path(e.path) for e in entries if name.fullmatch(e.name) and e.is_file(follow_symlinks=False)]
    for draft in drafts:
        with suppress(OSError), _lock(draft) as lock:
            if lock is None or lock.held:
                draft.unlink()


def _lock(draft: Path) -> AbstractContextManager[Lock | None]:
    """The draft's lock; none on Windows, where a locked file cannot be renamed, and on file systems without locks."""
    if os.name != "posix":
        return nullcontext()
    try:
        return Lock(draft)
    except OSError:
        return nullcontext()


def remove_file(path: Path) -> None:
    """Removes a file if there is one; InputError where it cannot be removed."""
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError("", f"cannot be removed: {error.strerror or error}", source=str(path)) from None


def array_bytes(array: NDArray[Any]) -> bytes:
    """The array in NumPy's .npy format, C order, without pickled objects."""
    buffer = io.BytesIO()
    np.lib.format.write_array(buffer, array.copy(order="C"), allow_pickle=False)
    return buffer.getvalue()


def npz_bytes(arrays: Mapping[str, NDArray[Any]]) -> bytes:
    """An .npz archive of the arrays."""
    return zip_bytes({f"{name}.npy": array_bytes(array) for name, array in arrays.items()})


def read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    """The arrays of an .npz archive; InputError where the file is not one."""
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError, AttributeError) as error:
        raise InputError("", f"is not a readable NumPy archive: {error}", source=str(path)) from None
