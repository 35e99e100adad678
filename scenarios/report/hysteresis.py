"""The page of identified hysteresis: loops, residuals, operators, and what a compensator would leave."""

from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.archive import write_whole
from flexbeams.plant.basis import Array
from flexbeams.plant.identification.hysteresis import HysteresisFit
from flexbeams.scenarios.report.loops import loop_picture
from flexbeams.scenarios.report.page import float32, render
from flexbeams.scenarios.results.curves import DISPLAY_UNITS
from flexbeams.scenarios.results.decimation import plotted_rows

MAX_ROWS = 2000  # of a panel


def write_hysteresis_page(fit: HysteresisFit, path: Path) -> None:
    """Writes the page; it needs no other file."""
    write_whole(path, hysteresis_html(fit).encode("utf-8", "replace"))


def hysteresis_html(fit: HysteresisFit) -> str:
    """The page; equal fits give equal bytes."""
    loops = fit.loops
    unit, factor = DISPLAY_UNITS["deflection" if loops.sensor.startswith("y_pi") else "strain"]
    counted = slice(loops.first_counted, None)
    axes = ("voltage in V", f"{loops.sensor} in {unit}")
    voltage, response = loops.voltage[counted], loops.response[counted]
    inverse = (response / fit.gain - fit.offset / fit.gain, fit.commands[counted])
    pictures = [
        loop_picture(
            "Response",
            axes,
            {"measured": (voltage, factor * response), "model": (voltage, factor * fit.model[counted])},
        ),
        loop_picture("Residual", (axes[0], "share of the stroke in %"), {"": (voltage, 100 * fit.residual)}),
        loop_picture("Inverse", ("wanted effective voltage in V", "command in V"), {"": inverse}),
    ]
    time: Array = loops.step * np.arange(float(len(loops.voltage)))
    groups = [
        {
            "title": "Over time",
            "window": None,
            "panels": [
                _panel(loops.sensor, unit, time, {"measured": factor * loops.response, "model": factor * fit.model}),
                _panel(
                    "voltage",
                    "V",
                    time,
                    {"applied": loops.voltage, "compensator for the measured response": fit.commands},
                ),
            ],
            "notes": [f"Rows count from {time[loops.first_counted]:.4g} s on, when both extremes have been reached."],
        }
    ]
    return render(
        "hysteresis.html.j2",
        title=f"Hysteresis of {loops.name}",
        facts=_facts(fit),
        trials=[(count, f"{100 * error:.3g} %") for count, error in fit.trials.items()],
        chosen=len(fit.pair.play_weights),
        tables=_tables(fit),
        pictures=pictures,
        groups=groups,
        data={"groups": groups},
    )


def _facts(fit: HysteresisFit) -> list[tuple[str, str]]:
    percent = {
        "Largest deviation from a straight line": fit.line,
        "Largest residual": fit.largest,
        "Residual, rms": fit.rms,
        "Variance explained": fit.explained,
        "Compensator: predicted remaining error, largest": fit.largest_remaining,
        "Compensator: predicted remaining error, rms": fit.rms_remaining,
    }
    return [(name, f"{100 * value:.{4 if value > 0.9 else 3}g} %") for name, value in percent.items()]


def _tables(fit: HysteresisFit) -> list[dict[str, Any]]:
    p = fit.pair
    return [
        {
            "title": title,
            "names": names,
            "rows": [(f"{a:g}", f"{b:g}") for a, b in zip(first, second, strict=True)],
        }
        for title, names, first, second in (
            (
                "Play operators",
                ("threshold, V", "weight"),
                [0.0, *p.play_thresholds],
                [p.linear_weight, *p.play_weights],
            ),
            ("Dead zones", ("threshold, V", "slope"), p.dead_zone_thresholds, p.dead_zone_slopes),
            ("Creep operators", ("time constant, s", "weight"), p.creep_times, p.creep_weights),
        )
    ]


def _panel(title: str, unit: str, time: Array, curves: dict[str, Array]) -> dict[str, Any]:
    values = np.column_stack(list(curves.values()))
    rows = plotted_rows(values, MAX_ROWS)
    return {
        "title": title,
        "axis": f"{title} in {unit}",
        "unit": unit,
        "time": float32(time[rows]),
        "curves": [
            {"label": label, "values": float32(values[rows, k]), "below": k == 0} for k, label in enumerate(curves)
        ],
    }
