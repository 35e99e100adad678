"""Checks of keyword arguments, where a wrong type or name would show much later."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from numbers import Real
from operator import index
from typing import Any

from flexbeams.plant.errors import InputError


def require_choices(**arguments: tuple[object, Sequence[str]]) -> None:
    """InputError for an argument, with its valid values, that is none of these; None is a default."""
    for name, (value, valid) in arguments.items():
        if value is not None and not (isinstance(value, str) and value in valid):
            raise InputError(name, f"must be {' or '.join(map(repr, valid))}", value)


def require_number(name: str, value: object) -> None:
    """InputError for what is no number; None is a default."""
    if value is not None and (isinstance(value, bool) or not isinstance(value, Real)):
        raise InputError(name, "must be a number", value)


def require_integer(name: str, value: Any, least: int, most: int | None = None) -> None:
    """InputError for what is no integer from `least` on, up to `most` if given; None is a default."""
    if value is not None:
        integer(name, value, least, most)


def integer(name: str, value: Any, least: int, most: int | None = None) -> int:
    """`value` as an int; InputError for what is no integer from `least` on, up to `most` if given."""
    whole = None
    with suppress(TypeError):
        whole = None if isinstance(value, bool) else index(value)
    if whole is None or whole < least or (most is not None and whole > most):
        what = f">= {least}" if most is None else f"from {least} to {most}"
        raise InputError(name, f"must be an integer {what}", value)
    return whole


def require_table(name: str, value: object) -> None:
    """InputError for what is no mapping; None is a default."""
    if value is not None and not isinstance(value, Mapping):
        raise InputError(name, "must be a dictionary of names and values", value)
