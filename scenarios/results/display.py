"""SI values as text, in the units in which they are displayed."""

from typing import Any

import numpy as np

from flexbeams.plant.basis import Array

_SCALES = {"m": ("mm", 1e3), "s": ("s", 1.0), "V": ("V", 1.0), "%": ("%", 1.0), "": ("", 1.0)}


def number(value: float | str | None, unit: str) -> str:
    """A value with its unit; text is unchanged, None is empty."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    unit_name, factor = _SCALES.get(unit, (unit, 1.0))
    if unit == "m" and 0 < abs(value) < 1e-4:
        unit_name, factor = "µm", 1e6
    return f"{value * factor:.4g} {unit_name}".strip()


def display_unit(unit: str, values: Array) -> tuple[str, float]:
    """The unit in which values are displayed, and the factor from SI to it."""
    name, factor = _SCALES.get(unit, (unit, 1.0))
    if unit == "m" and 0 < np.max(np.abs(values[np.isfinite(values)]), initial=0.0) < 1e-4:
        return "µm", 1e6
    return name, factor


def limits(least: float | None, largest: float | None, unit: str) -> str:
    """A range as text."""
    low, high = number(least, unit), number(largest, unit)
    if low and high:
        return f"{low} ... {high}"
    return f"<= {high}" if high else f">= {low}" if low else ""


def check_limits(record: dict[str, Any]) -> tuple[float | None, float | None]:
    """Lower and upper limit of an entry of summary.json's `checks`."""
    limit = record["limit"]
    return (limit[0], limit[1]) if isinstance(limit, list) else (None, limit)


def verdict(record: dict[str, Any]) -> str:
    """The word holds or failed; empty for a check without limits."""
    if check_limits(record) == (None, None):
        return ""
    return "holds" if record["passed"] else "failed"
