"""Texts of the options of `flexbeams identify` as values."""

import math
from collections.abc import Sequence
from typing import Any

from flexbeams.plant.errors import InputError


def values_of(texts: Sequence[str], option: str, factor: float = 1.0) -> dict[str, float]:
    """NAME=VALUE texts as a table, values times `factor`; a percent sign may follow the value."""
    table = {}
    for text in texts:
        name, value = assignment(text, option)
        table[name] = factor * number(value.rstrip("%"), text, option)
    return table


def bounds_of(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """NAME=LOW:HIGH texts as a table."""
    table = {}
    for text in texts:
        name, value = assignment(text, "--bounds")
        low, _, high = value.partition(":")
        table[name] = (number(low, text, "--bounds"), number(high, text, "--bounds"))
    return table


def columns_of(texts: Sequence[str]) -> dict[str, str | tuple[str, float]]:
    """SIGNAL=COLUMN[*FACTOR] texts as a table."""
    table: dict[str, str | tuple[str, float]] = {}
    for text in texts:
        signal, column = assignment(text, "--map")
        name, star, factor = column.rpartition("*")
        table[signal] = (name, number(factor, text, "--map")) if star else column
    return table


def window_of(text: str | None) -> tuple[float | None, float | None]:
    """BEGIN:END as two times, None for a missing one."""
    begin, _, end = (text or ":").partition(":")
    return (
        number(begin, text or "", "--window") if begin else None,
        number(end, text or "", "--window") if end else None,
    )


def call_options(options: dict[str, Any]) -> dict[str, Any]:
    """Options of the command line as those of the function `identify`."""
    return {
        "known": values_of(options["known"], "--known"),
        "fixed": options["fix"],
        "priors": values_of(options["prior"], "--prior", 0.01),
        "bounds": bounds_of(options["bounds"]),
        "weights": values_of(options["weight"], "--weight"),
        "delays": values_of(options["delay"], "--delay"),
        "offsets": values_of(options["offset"], "--offset"),
        "columns": columns_of(options["mapping"]),
        "window": window_of(options["window"]),
        **{
            name: options[name]
            for name in (
                "free",
                "fit_delays",
                "fit_offsets",
                "hold_back",
                "uncoupled",
                "free_start",
                "basis",
                "order",
                "loss",
                "steps",
            )
        },
    }


def assignment(text: str, option: str) -> tuple[str, str]:
    """The two sides of NAME=VALUE."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise InputError(option, "must read NAME=VALUE", text)
    return name.strip(), value.strip()


def number(text: str, whole: str, option: str) -> float:
    """A finite number; the message shows the whole option."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(option, "must have a finite number", whole)
    return value
