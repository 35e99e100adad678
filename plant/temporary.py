"""Temporary folders, and the removal of those whose process was killed.

A folder is locked as long as it is in use. It gets the name by which others look for it after it is locked.
"""

import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from flexbeams.plant.locks import Lock

_NAME = re.compile(r"flexbeams-\w{8}\.(new|tmp)")
_STARTING = 60.0  # s within which a new folder is locked and renamed


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """A new temporary folder, removed at the end."""
    created = Path(tempfile.mkdtemp(prefix="flexbeams-", suffix=".new"))
    lock = None
    with suppress(OSError):  # a file system without locks
        lock = Lock(created)
    folder = created.with_suffix(".tmp") if lock is not None and os.name == "posix" else created
    try:
        created.rename(folder)
        yield folder
    finally:
        if lock is not None and os.name != "posix":
            lock.release()  # its file is inside the folder
        for path in (created, folder):
            shutil.rmtree(path, ignore_errors=True)
        if lock is not None:
            lock.release()


def sweep_temporary_folders() -> None:
    """Removes this user's temporary folders that no process uses."""
    for folder in Path(tempfile.gettempdir()).glob("flexbeams-*"):
        with suppress(OSError):
            if _NAME.fullmatch(folder.name) and _is_abandoned(folder):
                shutil.rmtree(folder, ignore_errors=True)


def _is_abandoned(folder: Path) -> bool:
    state = folder.lstat()
    if folder.is_symlink() or not folder.is_dir() or (os.name == "posix" and state.st_uid != os.getuid()):
        return False
    if folder.suffix == ".new" and time.time() - state.st_mtime < _STARTING:
        return False
    with Lock(folder) as lock:
        return lock.held
