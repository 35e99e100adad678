"""The page of a design: stability on both plants, margins, sensitivities, statics, pairs and gauges, spectra, Bode."""

from dataclasses import asdict, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.controller.analysis import Analysis, LoopAnalysis
from flexbeams.controller.frequency import Complex
from flexbeams.controller.motion_figures import motion_fact
from flexbeams.controller.options import DesignOptions
from flexbeams.plant.archive import write_whole
from flexbeams.plant.basis import Array
from flexbeams.scenarios.report.charts import axis, chart, scatter
from flexbeams.scenarios.report.page import render

PLANTS = {"design": "own plant", "exact": "exact plant"}
FREQUENCY = {**axis("frequency in rad/s", log=True), "short": "rad/s"}
SLOWEST = 1e-2  # 1/s, decay rates shown from here on


def write_design_page(analysis: Analysis, path: Path, name: str) -> None:
    """Writes the page; it needs no other file."""
    write_whole(path, design_html(analysis, name).encode())


def design_html(analysis: Analysis, name: str) -> str:
    """The page; equal designs give equal bytes."""
    design, summary = analysis.design, analysis.design.summary
    charts = {
        "sensitivity": [c for plant, loop in analysis.loops.items() for c in _sensitivities(plant, loop)],
        "spectra": _spectra(analysis),
        "static": [_static_errors(analysis)],
        "bode": _bode(analysis),
        "hankel": [_hankel(summary)],
    }
    strain = 1e6 * design.options.voltage_limit * np.array(summary["static_gain_pm"])
    ranking = analysis.ranking
    return render(
        "design.html.j2",
        title=f"Design: {name}",
        stable=all(loop.margins for loop in analysis.loops.values()),
        verdict=_verdict(analysis),
        loops=[_loop_row(PLANTS[plant], loop) for plant, loop in analysis.loops.items()],
        margins=[
            {
                "plant": PLANTS[plant],
                "rows": [
                    {"pair": f"u[{k}]", "cells": [*c.texts(), f"{1e-3 * noise:.2f}"]}
                    for k, (c, noise) in enumerate(zip(loop.margins.channels, loop.noise_gain, strict=True), 1)
                ],
            }
            for plant, loop in analysis.loops.items()
            if loop.margins and loop.noise_gain is not None
        ],
        warnings=summary["warnings"],
        errors=_error_rows(analysis),
        offsets=summary.get("offsets"),
        limit=f"{design.options.voltage_limit:g}",
        strain={"columns": _names("u", strain.shape[1]), "rows": _heat(strain, _names("y_pm", len(strain)), "{:.1f}")},
        pairs=_ranking(ranking.frequencies, ranking.pairs, ranking.pair_losses, "u"),
        gauges=_ranking(ranking.frequencies, ranking.gauges, ranking.gauge_losses, "y_pm"),
        modes=_mode_rows(summary),
        facts=_facts(analysis),
        charts=charts,
        data={"charts": charts},
    )


def _verdict(analysis: Analysis) -> str:
    unstable = [PLANTS[name] for name, loop in analysis.loops.items() if not loop.margins]
    if unstable:
        return f"Unstable on the {' and the '.join(unstable)}"
    return "Stable on both plants" if len(analysis.loops) > 1 else "Stable"


def _loop_row(plant: str, loop: LoopAnalysis) -> dict[str, str]:
    pole = loop.poles[0]
    row = {"plant": plant, "pole": _pole(pole), "oscillation": "–", "disk": "–", "gains": "–", "phase": "–", "at": "–"}
    oscillating = loop.poles[np.abs(loop.poles.imag) > 1e-6 * np.abs(loop.poles)]
    if len(oscillating):
        row["oscillation"] = _pole(oscillating[0])
    if loop.margins:
        disk = loop.margins.disk
        gain = "any" if np.isinf(disk.gain) else f"{1 / disk.gain:.2f} … {disk.gain:.2f}"
        row |= {
            "disk": f"{disk.alpha:.3f}",
            "gains": gain,
            "phase": f"± {disk.phase:.0f}°",
            "at": f"{disk.frequency:.1f}",
        }
    return row


def _pole(value: complex) -> str:
    return f"{value.real:.3f}" + (f" ± {abs(value.imag):.2f}j" if abs(value.imag) > 1e-9 else "")


def _sensitivities(plant: str, loop: LoopAnalysis) -> list[dict[str, Any]]:
    scaled = {"S": (loop.S, "", 1.0), "T": (loop.T, "", 1.0), "KS": (loop.KS, "V per µm/m", 1e-6)}
    return [
        chart(
            f"{name}, {PLANTS[plant]}",
            (FREQUENCY, loop.omega),
            axis(f"singular values{' in ' + unit if unit else ''}", unit=unit, log=True),
            {f"σ{k}": np.maximum(factor * values[:, k - 1], 1e-9) for k in range(1, values.shape[1] + 1)},
        )
        for name, (values, unit, factor) in scaled.items()
    ]


def _spectra(analysis: Analysis) -> list[dict[str, Any]]:
    """Decay rate over frequency |s|: of real poles both are equal, an undamped one would lie at the lower edge."""
    summary = analysis.design.summary
    pairs = {
        "full model": [*summary["damped_eigenvalues"], *([v, 0.0] for v in summary["real_eigenvalues"])],
        "reduced model": summary["reduced_eigenvalues"],
        "filter": summary["estimator_eigenvalues"],
        "regulator": summary["feedback_eigenvalues"],
    }
    groups = {
        name: np.array([complex(*pair) for pair in values], dtype=np.complex128) for name, values in pairs.items()
    }
    loops = {f"loop, {PLANTS[plant]}": loop.poles for plant, loop in analysis.loops.items()}
    charts = []
    for title, shown in (("Poles of the parts", groups), ("Poles of the closed loop", loops)):
        charts.append(
            scatter(
                title,
                {**axis("frequency |s| in rad/s", log=True), "short": "rad/s"},
                axis("decay rate −Re s in 1/s", unit="1/s", log=True),
                {name: _decays(poles, analysis.design.options) for name, poles in shown.items()},
            )
        )
    return charts


def _decays(poles: Complex, options: DesignOptions) -> tuple[Array, Array]:
    """Frequency and decay rate of the poles of the upper half plane that a sample does not end."""
    shown = poles[(poles.imag >= 0) & (np.abs(poles) < 2 * np.pi / options.sample_time)]
    return np.abs(shown), np.maximum(-shown.real, SLOWEST)


def _static_errors(analysis: Analysis) -> dict[str, Any]:
    errors = analysis.static_errors
    share = 100 * (np.arange(len(errors.loop)) + 0.5) / len(errors.loop)
    return chart(
        "Static error",
        (axis("plants below, %"), share),
        axis("largest error of a point, mm", unit="mm"),
        {"feedforward alone": 1e3 * np.sort(errors.feedforward), "with control": 1e3 * np.sort(errors.loop)},
    )


def _error_rows(analysis: Analysis) -> list[dict[str, Any]]:
    figures = analysis.static_errors.figures()
    return [
        {"name": name, "cells": [f"{1e3 * v:.3f}" for v in figures[key]]}
        for key, name in (("feedforward", "feedforward alone"), ("loop", "with control"))
    ]


def _bode(analysis: Analysis) -> list[dict[str, Any]]:
    """Magnitude and phase of each output from the pair that moves it most at rest."""
    bode, charts = analysis.bode, []
    labels = {**PLANTS, "reduced": "reduced model"}
    for name, responses, unit, factor in (
        ("y_pi", bode.deflection, "mm/kV", 1e6),
        ("y_pm", bode.strain, "µm/m/kV", 1e9),
    ):
        first = next(iter(responses.values()))
        for output in range(first.shape[1]):
            pair = int(np.argmax(np.abs(first[0, output])))
            curves = {labels[model]: r[:, output, pair] for model, r in responses.items()}
            title = f"u[{pair + 1}] → {name}[{output + 1}]"
            magnitude = {label: factor * np.abs(v) for label, v in curves.items()}
            phase = {label: np.degrees(np.unwrap(np.angle(v))) for label, v in curves.items()}
            charts.append(
                chart(title, (FREQUENCY, bode.omega), axis(f"in {unit}", unit=unit, log=True), magnitude, "reduced")
            )
            charts.append(chart(title, (FREQUENCY, bode.omega), axis("phase in °", unit="°"), phase, "reduced"))
    return charts


def _hankel(summary: dict[str, Any]) -> dict[str, Any]:
    values = {name: np.array(summary[f"hankel_{name}"]) for name in ("position", "velocity")}
    number = np.arange(1, len(values["position"]) + 1, dtype=np.float64)
    floor = 1e-12 * max(v[0] for v in values.values())
    return scatter(
        f"Hankel singular values, {summary['reduced_order'] // 2} of each retained",
        axis("number"),
        axis("value", log=True),
        {name: (number, np.maximum(v, floor)) for name, v in values.items()},
    )


def _names(array: str, count: int) -> list[str]:
    return [f"{array}[{k}]" for k in range(1, count + 1)]


def _heat(values: Array, names: list[str], form: str) -> list[dict[str, Any]]:
    """Rows of cells with a text, and a strength and sign for their colour."""
    largest = float(np.max(np.abs(values))) or 1.0
    return [
        {
            "name": name,
            "cells": [
                {
                    "text": form.format(v),
                    "strength": f"{70 * abs(v) / largest:.0f}",
                    "sign": "positive" if v > 0 else "negative",
                }
                for v in row
            ],
        }
        for name, row in zip(names, values, strict=True)
    ]


def _ranking(frequencies: Array, shares: Array, losses: Array, array: str) -> dict[str, Any]:
    """Modes as rows, pairs or gauges as columns, in %; the last row is their part in the Hankel singular values."""
    names = [f"{k}: {omega:.1f} rad/s" for k, omega in enumerate(frequencies, 1)]
    return {
        "columns": _names(array, shares.shape[1]),
        "rows": _heat(100 * shares, names, "{:.0f}"),
        "losses": [f"{100 * loss:.1f}" for loss in losses],
        "least": int(np.argmin(losses)) + 1,
    }


def _mode_rows(summary: dict[str, Any]) -> list[list[str]]:
    return [
        [str(k), f"{omega:.3f}", f"{omega / (2 * np.pi):.3f}", "overdamped" if ratio is None else f"{100 * ratio:.2f}"]
        for k, (omega, ratio) in enumerate(zip(summary["frequencies"], summary["damping_ratios"], strict=True), 1)
    ]


def _facts(analysis: Analysis) -> list[tuple[str, str]]:
    design, s = analysis.design, analysis.design.summary
    title, line = motion_fact(s)
    facts = [
        ("Design id", design.design_id),
        (
            "Structure",
            f"{s['beams']} beams, {s['inputs']} patch pairs, {s['points_of_interest']} points of interest, "
            f"{s['strain_gauges']} strain gauges",
        ),
        (
            "Model",
            f"basis {s['basis']} of order {s['order']}, {s['full_order']} states, reduced to {s['reduced_order']}; "
            f"{100 * s['hankel_share']:.2f} % of the Hankel singular values retained",
        ),
        ("Integral gain", f"{s['integral_gain']:g} a sample, stable up to {s['integral_gain_limit']:g}"),
        (title[0].upper() + title[1:], line),
    ]
    options = asdict(design.options)
    weights = options.pop("weights")
    facts += [(f.name, str(options[f.name])) for f in fields(DesignOptions) if options.get(f.name) is not None]
    facts += [(f"weights.{name}", f"{value:g}") for name, value in weights.items()]
    return [*facts, ("Version", f"flexbeams {version('flexbeams')}")]
