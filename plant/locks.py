"""Exclusive locks of folders and files; a lock ends with the process that holds it, however that ends."""

import os
import sys
from contextlib import suppress
from pathlib import Path
from types import TracebackType


class Lock:
    """A lock of a folder or file, which must exist; a context manager that releases it.

    `held` is False where another holder has it. Raises OSError where the file system has no locks.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = _locked(path)
        self.held = self._descriptor is not None

    def __enter__(self) -> "Lock":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def release(self) -> None:
        """Gives the lock back."""
        if self._descriptor is not None:
            with suppress(OSError):
                os.close(self._descriptor)
        self._descriptor, self.held = None, False


if sys.platform == "win32":
    import msvcrt

    def _locked(path: Path) -> int | None:
        """A descriptor of the locked file, or of one inside the folder that the system removes with the descriptor."""
        temporary = path.is_dir()
        file = path / ".lock" if temporary else path
        try:
            descriptor = os.open(file, os.O_RDWR | os.O_CREAT | (os.O_TEMPORARY if temporary else 0))
        except PermissionError:
            return None
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            os.close(descriptor)
            return None
        return descriptor

else:
    import fcntl

    def _locked(path: Path) -> int | None:
        """A descriptor that holds the lock; None where another one holds it."""
        descriptor = os.open(path, os.O_RDONLY)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return None
        except OSError:
            os.close(descriptor)
            raise
        return descriptor
