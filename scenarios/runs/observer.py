"""Callbacks of a run."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path


def ignore_note(text: str) -> None:
    """Ignores a note."""


def ignore_progress(done: int, steps: int) -> None:
    """Ignores progress."""


def no_path() -> None:
    """No file: the rows of a long recording go to a temporary one."""


def ignore_writing() -> None:
    """Ignores that results are written."""


@dataclass(frozen=True, kw_only=True)
class Observer:
    """Receives notes, one line each, the steps done and in all, and the beginning of writing.

    `row_path` is asked for the file of the rows before a long recording begins.
    """

    notify: Callable[[str], None] = ignore_note
    progress: Callable[[int, int], None] = ignore_progress
    row_path: Callable[[], Path | None] = no_path
    writing: Callable[[], None] = ignore_writing


SILENT = Observer()
