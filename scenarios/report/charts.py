"""Charts of a page: curves or points with axes of their own."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.report.page import float32


def axis(label: str, *, unit: str = "", log: bool = False) -> dict[str, Any]:
    """An axis with its label, the unit of values displayed, and whether it is logarithmic."""
    return {"label": label, "unit": unit, "log": log}


def chart(
    title: str, x: tuple[dict[str, Any], Array], y: dict[str, Any], curves: Mapping[str, Array], dashed: str = ""
) -> dict[str, Any]:
    """Curves (k,) over the same x (k,); the names of dashed ones start with `dashed`, if any."""
    described, values = x
    return {
        "title": title,
        "x": {**described, "values": float32(values)},
        "y": y,
        "points": False,
        "curves": [
            {"label": label, "values": float32(v), "dashed": bool(dashed) and label.startswith(dashed)}
            for label, v in curves.items()
        ],
    }


def scatter(
    title: str, x: dict[str, Any], y: dict[str, Any], points: Mapping[str, tuple[Array, Array]]
) -> dict[str, Any]:
    """Groups of points (x (k,), y (k,)), each drawn in a colour."""
    every = np.concatenate([px for px, _ in points.values()])
    order = np.argsort(every, kind="stable")
    start, curves = 0, []
    for label, (px, py) in points.items():
        column = np.full(len(every), np.nan)
        column[start : start + len(px)] = py
        curves.append({"label": label, "values": float32(column[order]), "dashed": False})
        start += len(px)
    return {"title": title, "x": {**x, "values": float32(every[order])}, "y": y, "points": True, "curves": curves}
