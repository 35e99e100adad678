"""Tables and JSON of an identification."""

from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from flexbeams.plant.identification.contradictions import warnings_of
from flexbeams.plant.identification.experiment import sensor_names
from flexbeams.plant.identification.method import Identification
from flexbeams.plant.identification.modal import modal_form
from flexbeams.plant.identification.quality import end_error, fits_of
from flexbeams.scenarios.report.identification import unit_of


def as_table(result: Identification) -> dict[str, Any]:
    """Everything about an identification in JSON's types; deviations are relative, one standard deviation."""
    names = sensor_names(result.structure)
    before, after = (_modes(result, values) for values in _values(result))
    error, fits = end_error(result), fits_of(result)
    return {
        "interrupted": result.estimate.interrupted,
        "warnings": warnings_of(result, fits),
        "start": {
            "method": result.start.method,
            "measured_frequencies": [] if result.start.modes is None else result.start.modes.frequencies.tolist(),
            "frequencies": result.start.given.tolist(),
        },
        "parameters": {
            p.name: {
                "start": p.start,
                "value": p.value,
                "unit": unit_of(p.name),
                "deviation": p.deviation,
                "status": p.status,
            }
            for p in result.parameters
        },
        "open_directions": [
            {"deviation": d.deviation if np.isfinite(d.deviation) else None, "shares": d.shares}
            for d in result.joint.directions
        ],
        "correlations": {"names": list(result.joint.names), "matrix": result.joint.correlations.tolist()},
        "modes": {"start": before, "identified": after},
        "sensors": {
            name: {
                "residual": float(result.estimate.deviations[k] * result.estimate.weights[k]),
                "weight": float(result.estimate.weights[k]),
                "correlation_length": float(result.joint.correlation_lengths[k]),
            }
            for k, name in enumerate(names)
        },
        "experiments": [
            {"name": fit.name, "held_back": fit.held_back, "relative_residual": fit.relative_by_sensor(names)}
            for fit in fits
        ],
        "feedforward_end_error": {
            "target": error.target.tolist(),
            "half_width": error.half_width.tolist(),
            "unit": "m",
        },
    }


def show_identification(result: Identification) -> None:
    """The parameters, what stays open, and how well each file is met."""
    console = Console()
    console.print(f"Start: {result.start.method}", highlight=False)
    first, last = Column(header="parameter", no_wrap=True, min_width=27), Column(header="+- 95 %", min_width=12)
    table = Table(first, "start", "identified", "unit", last, title="Parameters")
    for p in result.parameters:
        width = {"fitted": f"{196 * p.deviation:.2g} %", "assumed": "undetermined", "known": "known"}[p.status]
        table.add_row(escape(p.name), f"{p.start:.5g}", f"{p.value:.5g}", unit_of(p.name), width)
    console.print(table)
    for direction in result.joint.directions:
        shares = ", ".join(f"{name} {share:+.2f}" for name, share in direction.shares.items())
        size = "any" if not np.isfinite(direction.deviation) else f"{100 * direction.deviation:.0f} %"
        console.print(f"Open ({size}): {shares}", highlight=False, markup=False)
    names = sensor_names(result.structure)
    fits = fits_of(result)
    fitted = [(fit, fit.relative_by_sensor(names)) for fit in fits]
    headers = [fit.name + (" (held back)" if fit.held_back else "") for fit, _ in fitted]
    table = Table("sensor", *map(escape, headers), title="Residual over signal, rms, %")
    for name in names:
        cells = [f"{100 * relative[name]:.2f}" if name in relative else "" for _, relative in fitted]
        table.add_row(escape(name), *cells)
    console.print(table)
    error = end_error(result)
    widths = ", ".join(f"{1e3 * width:.2g}" for width in error.half_width)
    console.print(f"Predicted end error of a feedforward at the points: +- {widths} mm (95 %)", highlight=False)
    for warning in warnings_of(result, fits):
        console.print(f"Warning: {warning}", highlight=False, markup=False)
    weights = [n for n, weight in zip(names, result.estimate.weights, strict=True) if weight != 1]
    if weights:
        console.print(f"Less weight, residuals are no noise: {', '.join(weights)}", highlight=False, markup=False)


def _values(result: Identification) -> tuple[dict[str, float], dict[str, float]]:
    return {p.name: p.start for p in result.parameters}, {p.name: p.value for p in result.parameters}


def _modes(result: Identification, values: dict[str, float]) -> list[dict[str, float]]:
    poles = modal_form(result.model, values).poles
    return [{"frequency": float(abs(p)), "damping_ratio": float(-p.real / abs(p))} for p in poles[:12]]
