"""The page of an identification: measured beside fitted, residuals, parameters with intervals, correlations, modes."""

from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.archive import write_whole
from flexbeams.plant.basis import Array
from flexbeams.plant.identification.contradictions import warnings_of
from flexbeams.plant.identification.experiment import sensor_names
from flexbeams.plant.identification.method import Identification
from flexbeams.plant.identification.modal import modal_form
from flexbeams.plant.identification.quality import Fit, end_error, fits_of
from flexbeams.plant.parameters import parameter
from flexbeams.scenarios.report.page import float32, render
from flexbeams.scenarios.results.curves import DISPLAY_UNITS
from flexbeams.scenarios.results.decimation import plotted_rows

MAX_ROWS = 1500  # of a panel
MODES = 9  # of the table
LAGS = 200  # of the autocorrelation
WIDTH, HEIGHT = 240.0, 70.0  # of a small plot
_REACH = 2.0  # a bar's length stands for a factor of so much at the edge


def unit_of(name: str) -> str:
    """Unit of measurement of a full parameter name such as beam[1].density."""
    place, short = name.split("].")
    return parameter(place.split("[")[0], short).unit


def write_identification(result: Identification, path: Path) -> None:
    """Writes the page; it needs no other file."""
    write_whole(path, identification_html(result).encode("utf-8", "replace"))


def identification_html(result: Identification) -> str:
    """The page; equal results give equal bytes."""
    names = sensor_names(result.structure)
    fits = fits_of(result)
    groups = [_group(fit, names) for fit in fits]
    error = end_error(result)
    return render(
        "identify.html.j2",
        title="Identification",
        interrupted=result.estimate.interrupted,
        start=result.start.method,
        warnings=warnings_of(result, fits),
        parameters=[_parameter_row(p) for p in result.parameters],
        directions=[
            {
                "size": "any size" if not np.isfinite(d.deviation) else f"{100 * d.deviation:.0f} %",
                "shares": ", ".join(f"{name} {share:+.2f}" for name, share in d.shares.items()),
            }
            for d in result.joint.directions
        ],
        modes=_modes(result),
        measured=[] if result.start.modes is None else [f"{f:.2f}" for f in result.start.modes.frequencies],
        residuals=_residuals(result, fits, names),
        fits=[
            {"name": fit.name, "held_back": fit.held_back, "relative": fit.relative_by_sensor(names)} for fit in fits
        ],
        sensors=names,
        correlations=_correlations(result),
        correlation_names=result.joint.names,
        ends=[
            {"point": k, "target": f"{1e3 * y:.2f}", "half": f"{1e3 * h:.3g}"}
            for k, (y, h) in enumerate(zip(error.target, error.half_width, strict=True), 1)
        ],
        groups=groups,
        data={"groups": groups},
    )


def _group(fit: Fit, names: list[str]) -> dict[str, Any]:
    """Panels of an experiment: each sensor measured, by the start and by the fit, and what the fit leaves."""
    time = fit.experiment.time[fit.experiment.first_counted :]
    panels = []
    for k, sensor in enumerate(fit.experiment.sensors):
        quantity = "deflection" if names[sensor].startswith("y_pi") else "strain"
        unit, factor = DISPLAY_UNITS[quantity]
        measured, fitted = fit.measured[:, k], fit.predicted[:, k]
        values = factor * np.column_stack([measured, fit.initial[:, k], fitted, measured - fitted])
        rows = plotted_rows(values, MAX_ROWS)
        labels = ("measured", "start", "identified", "residual")
        panels.append(
            {
                "title": names[sensor],
                "axis": f"{quantity} in {unit}",
                "unit": unit,
                "time": float32(time[rows]),
                "curves": [
                    {"label": label, "values": float32(values[rows, c]), "below": c == 0}
                    for c, label in enumerate(labels)
                ],
            }
        )
    title = f"{fit.name} (held back)" if fit.held_back else fit.name
    return {"title": title, "window": None, "panels": panels, "notes": []}


def _parameter_row(entry: Any) -> dict[str, Any]:
    """Cells of a parameter, and its bar: change from the start and 95 % interval, -1 ... 1."""
    change = np.log(entry.value / entry.start) / np.log(_REACH) if entry.value > 0 and entry.start > 0 else 0.0
    half = min(1.96 * entry.deviation / np.log(_REACH), 1.0)
    width = {"fitted": f"± {196 * entry.deviation:.2g} %", "assumed": "undetermined by the data", "known": "known"}
    return {
        "name": entry.name,
        "start": f"{entry.start:.5g}",
        "value": f"{entry.value:.5g}",
        "unit": unit_of(entry.name),
        "width": width[entry.status],
        "status": entry.status,
        "change": float(np.clip(change, -1, 1)),
        "low": float(np.clip(change - half, -1, 1)),
        "high": float(np.clip(change + half, -1, 1)),
    }


def _modes(result: Identification) -> list[dict[str, str]]:
    """Frequency and damping of the first modes at the start and identified."""
    before = modal_form(result.model, {p.name: p.start for p in result.parameters}).poles[:MODES]
    after = modal_form(result.model, {p.name: p.value for p in result.parameters}).poles[:MODES]
    return [
        {
            "frequency_before": f"{abs(b):.2f}",
            "frequency_after": f"{abs(a):.2f}",
            "damping_before": f"{-100 * b.real / abs(b):.2f}",
            "damping_after": f"{-100 * a.real / abs(a):.2f}",
        }
        for b, a in zip(before, after, strict=True)
    ]


def _residuals(result: Identification, fits: list[Fit], names: list[str]) -> list[dict[str, Any]]:
    """Autocorrelation and spectrum of each sensor's residual in the first experiment that has the sensor."""
    rows = []
    for sensor, name in enumerate(names):
        fit = next((f for f in fits if sensor in f.experiment.sensors and not f.held_back), None)
        if fit is None:
            continue
        k = fit.experiment.sensors.index(sensor)
        r = fit.measured[:, k] - fit.predicted[:, k]
        spectrum = np.abs(np.fft.rfft(r, 2 * len(r))) ** 2
        correlation = np.fft.irfft(spectrum)[: min(LAGS, len(r))]
        correlation = correlation / max(float(correlation[0]), 1e-300)
        power = np.abs(np.fft.rfft(r * np.hanning(len(r)))) ** 2
        level = np.log10(np.maximum(_smoothed(power), 1e-300))
        length = result.joint.correlation_lengths[sensor]
        rows.append(
            {
                "name": name,
                "weight": f"{result.estimate.weights[sensor]:g}",
                "length": f"{length:.0f}" if length >= 100 else f"{length:.3g}",
                "correlation": _polyline(correlation, -1.0, 1.0),
                "spectrum": _polyline(level, float(np.min(level)), float(np.max(level)) + 1e-9),
                "nyquist": f"{0.5 / fit.experiment.step:g}",
            }
        )
    return rows


def _smoothed(power: Array) -> Array:
    """Means over blocks, about 120 of them."""
    block = max(1, len(power) // 120)
    whole = power[: len(power) // block * block]
    means: Array = np.mean(whole.reshape(-1, block), axis=1)
    return means


def _polyline(values: Array, low: float, high: float) -> str:
    """Points of an SVG polyline in a box of WIDTH x HEIGHT."""
    x = np.linspace(0, WIDTH, len(values))
    y = HEIGHT * (1 - (np.clip(values, low, high) - low) / (high - low))
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def _correlations(result: Identification) -> list[dict[str, Any]]:
    """Cells of the picture of correlations above 5 %, with colours from blue (-1) to red (1)."""
    matrix, names = result.joint.correlations, result.joint.names
    return [
        {
            "row": i,
            "column": j,
            "strength": f"{abs(matrix[i, j]):.2f}",
            "sign": "positive" if matrix[i, j] > 0 else "negative",
            "text": f"{names[i]} and {names[j]}: {matrix[i, j]:+.2f}",
        }
        for i in range(len(names))
        for j in range(len(names))
        if abs(matrix[i, j]) > 0.05
    ]
