"""Loggers in C (native/loggers.c): they format the arguments of a unit's log lines, which Python cannot read."""

import ctypes
from collections.abc import Callable
from pathlib import Path
from typing import Any

_LINE = ctypes.CFUNCTYPE(None, ctypes.c_int, ctypes.c_char_p)


class Logger:
    """One logger of the library; `address` is its function, None where all are in use."""

    def __init__(self, library: Path, receive: Callable[[int, bytes], None]) -> None:
        self._library: Any = ctypes.PyDLL(str(library))  # calls hold Python's lock: no two threads take one logger
        self._library.take_logger.restype = ctypes.c_void_p
        self._library.release_logger.argtypes = (ctypes.c_void_p,)
        self._receive = _LINE(receive)
        self.address: int | None = self._library.take_logger(self._receive)

    def release(self) -> None:
        """Frees the logger for another unit."""
        if self.address is not None:
            self._library.release_logger(self.address)
            self.address = None
