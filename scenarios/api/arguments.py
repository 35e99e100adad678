"""Checks of keyword arguments, where a wrong type or name would show much later."""

from collections.abc import Mapping, Sequence
from numbers import Real
from operator import index
from typing import Any

from flexbeams.plant.errors import InputError


def require_choices(**arguments: tuple[object, Sequence[str]]) -> None:
    """InputError for an argument, with its valid values, that is none of these; None is a default."""
    for name, (value, valid) in arguments.items():
        if value is not None and value not in valid:
            raise InputError(name, f"must be {' or '.join(map(repr, valid))}", value)


def require_number(name: str, value: object) -> None:
    """InputError for what is no number; None is a default."""
    if value is not None and (isinstance(value, bool) or not isinstance(value, Real)):
        raise InputError(name, "must be a number", value)


def require_integer(name: str, value: Any, least: int) -> None:
    """InputError for what is no integer from `least` on; None is a default."""
    if value is None:
        return
    try:
        is_valid = index(value) >= least
    except TypeError:
        is_valid = False
    if not is_valid:
        raise InputError(name, f"must be an integer >= {least}", value)


def require_table(name: str, value: object) -> None:
    """InputError for what is no mapping; None is a default."""
    if value is not None and not isinstance(value, Mapping):
        raise InputError(name, "must be a dictionary of names and values", value)
