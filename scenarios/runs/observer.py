"""Callbacks of a run."""

from collections.abc import Callable
from dataclasses import dataclass


def ignore_note(text: str) -> None:
    """Ignores a note."""


def ignore_progress(done: int, steps: int) -> None:
    """Ignores progress."""


@dataclass(frozen=True, kw_only=True)
class Observer:
    """Receives notes, one line each, and the progress of stepping: steps done and steps in all."""

    notify: Callable[[str], None] = ignore_note
    progress: Callable[[int, int], None] = ignore_progress


SILENT = Observer()
