"""Figures as people read them: SI values in the units they are shown in."""

from typing import Any

_SCALES = {"m": ("mm", 1e3), "s": ("s", 1.0), "V": ("V", 1.0), "%": ("%", 1.0), "": ("", 1.0)}


def number(value: float | str | None, unit: str) -> str:
    """A value with its unit; text stays as it is, None becomes nothing."""
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    shown, factor = _SCALES.get(unit, (unit, 1.0))
    if unit == "m" and 0 < abs(value) < 1e-4:
        shown, factor = "µm", 1e6
    return f"{value * factor:.4g} {shown}".strip()


def limits(least: float | None, largest: float | None, unit: str) -> str:
    """A range as text."""
    low, high = number(least, unit), number(largest, unit)
    if low and high:
        return f"{low} ... {high}"
    return f"<= {high}" if high else f">= {low}" if low else ""


def check_limits(record: dict[str, Any]) -> tuple[float | None, float | None]:
    """Least and largest value that an entry of summary.json's `checks` allows."""
    limit = record["limit"]
    return (limit[0], limit[1]) if isinstance(limit, list) else (None, limit)


def verdict(record: dict[str, Any]) -> str:
    """holds, failed, or nothing for a figure that is only reported."""
    if check_limits(record) == (None, None):
        return ""
    return "holds" if record["passed"] else "failed"
