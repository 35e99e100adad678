"""Log lines of a unit, each kind once with how often it came."""

import re
from collections.abc import Callable
from dataclasses import dataclass

MAX_KINDS = 20  # of lines of one instance
_NUMBER = re.compile(r"[-+]?[0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?")
_FURTHER = "further lines"


@dataclass
class _Kind:
    first: str
    heard: bool  # whether it was passed on already
    count: int = 0


class Messages:
    """Passes the lines of an instance to `notify`; lines that differ in numbers only are of one kind."""

    def __init__(self, instance: str, notify: Callable[[str], None]) -> None:
        self._instance, self._notify = instance, notify
        self._kinds: dict[str, _Kind] = {}

    def add(self, text: str, warning: bool) -> None:
        """One line: a warning is passed on at once, an error with `finish`, unless it is the reason of a failure."""
        name = _NUMBER.sub("#", text)
        if name not in self._kinds and len(self._kinds) >= MAX_KINDS:
            name, text, warning = _FURTHER, _FURTHER, False
        kind = self._kinds.setdefault(name, _Kind(text, warning))
        kind.count += 1
        if kind.count == 1 and warning:
            self._notify(f"{self._instance}: {text}")

    def forget(self, text: str) -> None:
        """Takes back a line, which the message of a failure quotes."""
        if kind := self._kinds.get(_NUMBER.sub("#", text)):
            kind.count -= 1

    def finish(self) -> None:
        """Passes on errors, and how often lines were repeated."""
        for kind in self._kinds.values():
            if kind.count > 1:
                self._notify(f"{self._instance}: {kind.first} ({kind.count} times)")
            elif kind.count == 1 and not kind.heard:
                self._notify(f"{self._instance}: {kind.first}")
        self._kinds.clear()
