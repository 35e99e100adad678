"""Ctrl-C and termination: what ends a command, deferred while an FMU call is in progress."""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn


class Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a command as Ctrl-C does."""


class _Termination:
    """Handler of SIGTERM that raises Terminated."""

    received = False

    def __call__(self, number: int, frame: FrameType | None) -> NoReturn:
        self.received = True
        raise Terminated


@contextmanager
def termination_as_interrupt() -> Iterator[Callable[[], bool]]:
    """SIGTERM raises Terminated inside; yields a function that returns whether it was received."""
    handler = _Termination()
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    outside = signal.signal(signal.SIGTERM, handler)
    try:
        yield lambda: handler.received
    finally:
        signal.signal(signal.SIGTERM, outside)


@contextmanager
def deferred_interrupt() -> Iterator[Callable[[], bool]]:
    """Records Ctrl-C and SIGTERM instead of raising them; yields a function that returns whether there was one.

    A second one is raised.
    """
    pressed = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield pressed.is_set
        return
    outside = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in outside.items():
            signal.signal(number, handler)

    def note(number: int, frame: FrameType | None) -> None:
        pressed.set()
        handler = outside[signal.Signals(number)]
        if isinstance(handler, _Termination):
            handler.received = True
        restore()

    for number, handler in outside.items():
        if handler is signal.default_int_handler or isinstance(handler, _Termination):
            signal.signal(number, note)
    try:
        yield pressed.is_set
    finally:
        restore()


@contextmanager
def ignore_interrupts_in_children() -> Iterator[None]:
    """Processes started inside do not get Ctrl-C, on systems where they inherit that; this one gets it afterwards."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "pthread_sigmask"):
        yield
        return
    outside = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, outside)
