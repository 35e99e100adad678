"""Log lines of a unit: the first few of a kind, then how often it came."""

import re
from collections.abc import Callable
from dataclasses import dataclass, field

MAX_KINDS = 20  # of lines of one instance
MAX_SHOWN = 3  # warnings of one kind that are passed on, each text once
_NUMBER = re.compile(r"[-+]?[0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?")
_FURTHER = "further lines"


@dataclass
class _Kind:
    first: str
    shown: set[str] = field(default_factory=set)  # texts that were passed on
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
        kind = self._kinds.setdefault(name, _Kind(text))
        kind.count += 1
        if warning and text not in kind.shown and len(kind.shown) < MAX_SHOWN:
            kind.shown.add(text)
            self._notify(f"{self._instance}: {text}")

    def forget(self, text: str) -> None:
        """Takes back a line, which the message of a failure quotes."""
        if kind := self._kinds.get(_NUMBER.sub("#", text)):
            kind.count -= 1

    def finish(self) -> None:
        """Passes on errors, and how often lines were repeated."""
        for kind in self._kinds.values():
            if kind.count > len(kind.shown):
                times = f" ({kind.count} times)" if kind.count > 1 else ""
                self._notify(f"{self._instance}: {kind.first}{times}")
        self._kinds.clear()
