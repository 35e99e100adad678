"""Deferring Ctrl-C while an FMU call is in progress, which it would make fail instead of ending the run."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType


@contextmanager
def deferred_interrupt() -> Iterator[Callable[[], bool]]:
    """Records Ctrl-C instead of raising it; yields a function that returns whether it was pressed.

    A second Ctrl-C is raised.
    """
    pressed = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield pressed.is_set
        return
    outside = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: FrameType | None) -> None:
        pressed.set()
        signal.signal(signal.SIGINT, outside)

    if outside is signal.default_int_handler:
        signal.signal(signal.SIGINT, note)
    try:
        yield pressed.is_set
    finally:
        signal.signal(signal.SIGINT, outside)


@contextmanager
def ignore_interrupts_in_children() -> Iterator[None]:
    """Processes started inside ignore Ctrl-C from their start, on systems where children inherit that."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    outside = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, outside)
