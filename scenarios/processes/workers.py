"""Worker processes: only the process that started them acts on signals, and they end with it."""

import multiprocessing
import multiprocessing.connection
import os
import signal
import threading

_LOST_PARENT = 130  # exit status of a worker whose parent has ended


def leave_signals_to_parent() -> None:
    """First call in a child process: signals may reach both, and only the parent acts on them.

    The child ends with the process that started it, even if that is killed.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(_LOST_PARENT)
