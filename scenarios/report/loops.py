"""Pictures of loops: one signal over another, as lines in boxes of a page."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexbeams.plant.basis import Array
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.results.checks import column_indices
from flexbeams.scenarios.results.decimation import plotted_rows
from flexbeams.scenarios.simulation.recording import Recording

WIDTH, HEIGHT = 300.0, 220.0  # of a picture
LEFT, BELOW, ROOM = 46.0, 34.0, 10.0  # for numbers, and around the lines
MAX_ROWS = 3000  # of a picture
TICKS = (1.0, 2.0, 5.0, 10.0)


def loop_picture(title: str, axes: tuple[str, str], curves: Mapping[str, tuple[Array, Array]]) -> dict[str, Any]:
    """Curves (x, y) by label in one box, with axes named `axes`; each keeps the extremes of every stretch."""
    x_range = _range([x for x, _ in curves.values()])
    y_range = _range([y for _, y in curves.values()])
    place_x = (LEFT, WIDTH - ROOM)
    place_y = (HEIGHT - BELOW, ROOM)
    lines = []
    for number, (label, (x, y)) in enumerate(curves.items(), 1):
        rows = plotted_rows(np.column_stack([x, y]), MAX_ROWS)
        at = zip(_placed(x[rows], x_range, place_x), _placed(y[rows], y_range, place_y), strict=True)
        lines.append({"label": label, "colour": number, "points": " ".join(f"{a:.1f},{b:.1f}" for a, b in at)})
    return {
        "title": title,
        "x_name": axes[0],
        "y_name": axes[1],
        "width": f"{WIDTH:g}",
        "height": f"{HEIGHT:g}",
        "lines": lines,
        "x_ticks": _marks(x_range, place_x),
        "y_ticks": _marks(y_range, place_y),
        "box": {"left": f"{LEFT:g}", "right": f"{WIDTH - ROOM:g}", "top": f"{ROOM:g}", "bottom": f"{HEIGHT - BELOW:g}"},
    }


def run_loops(scenario: Scenario, recording: Recording, arrays: Mapping[str, tuple[str, str]]) -> list[dict[str, Any]]:
    """A picture for each channel of the instances that have loops: their input and output arrays by instance."""
    pictures = []
    for instance in scenario.instance:
        if instance not in arrays:
            continue
        names = [f"{instance}.{name}" for name in arrays[instance]]
        columns = [column_indices(recording.columns, name) for name in names]
        for k, (x, y) in enumerate(zip(*columns, strict=False), 1):
            pair = (recording.values[:, x], recording.values[:, y])
            pictures.append(
                loop_picture(f"{instance}, channel {k}", (f"{names[0]} in V", f"{names[1]} in V"), {"": pair})
            )
    return pictures


def _range(values: Sequence[Array]) -> tuple[float, float]:
    low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
    if not high > low:
        low, high = low - 1.0, high + 1.0
    return low - 0.03 * (high - low), high + 0.03 * (high - low)


def _placed(values: Array, span: tuple[float, float], place: tuple[float, float]) -> list[float]:
    share = (values - span[0]) / (span[1] - span[0])
    at: list[float] = (place[0] + share * (place[1] - place[0])).tolist()
    return at


def _marks(span: tuple[float, float], place: tuple[float, float]) -> list[dict[str, str]]:
    """Round numbers along an axis, about five."""
    rough = (span[1] - span[0]) / 5
    power = 10.0 ** np.floor(np.log10(rough))
    step = power * next(t for t in TICKS if t * power >= rough * (1 - 1e-9))
    first = np.ceil(span[0] / step)
    marks = [float(step * (first + k)) for k in range(12) if step * (first + k) <= span[1]]
    return [
        {"text": f"{mark:.6g}".replace("-", "−"), "at": f"{at:.1f}"}
        for mark, at in zip(marks, _placed(np.array(marks), span, place), strict=True)
    ]
