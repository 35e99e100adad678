"""Connections of an exported system, element by element."""

from typing import NamedTuple


class Link(NamedTuple):
    """An output of one component that drives an input of another."""

    start: str
    output: str
    end: str
    input: str
