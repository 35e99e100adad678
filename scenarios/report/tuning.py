"""The page of a tuning: the Pareto front, where each point shows its response, figures and weights."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.controller.design import Design
from flexbeams.controller.modal_loop import Response
from flexbeams.controller.options import Weights
from flexbeams.controller.tuning import Candidate, TuningProblem
from flexbeams.plant.archive import write_whole
from flexbeams.plant.basis import Array
from flexbeams.scenarios.report.charts import axis, chart
from flexbeams.scenarios.report.page import render
from flexbeams.scenarios.results.decimation import plotted_rows

MAX_ROWS = 500  # of a response
WIDTH, HEIGHT = 640, 320  # of the front's picture
LEFT, BOTTOM, EDGE = 66, 46, 16
FEWEST_TICKS = 3  # of an axis


@dataclass(frozen=True, kw_only=True)
class PagePoint:
    """A point of the front."""

    candidate: Candidate
    design: Design
    toml: str  # its section [design]


def write_tuning_page(
    scenario: str,
    problem: TuningProblem,
    published: Candidate,
    points: Sequence[PagePoint],
    chosen: int,
    path: Path,
) -> None:
    """Writes the page; it needs no other file."""
    write_whole(path, tuning_html(scenario, problem, published, points, chosen).encode())


def tuning_html(
    scenario: str, problem: TuningProblem, published: Candidate, points: Sequence[PagePoint], chosen: int
) -> str:
    """The page; equal results give equal bytes."""
    entries = [("Published weights", published, Weights())]
    entries += [(f"Point {k}", p.candidate, p.design.options.weights) for k, p in enumerate(points, 1)]
    shown = [(c.noise_voltage, c.worst_decay) for _, c, _ in entries]
    scale = _Scale.of(np.array([x for x, _ in shown]), np.array([y for _, y in shown]))
    tomls = ["", *(p.toml for p in points)]
    rows = [
        {
            "name": name,
            "x": scale.x(c.noise_voltage),
            "y": scale.y(c.worst_decay),
            "cells": c.texts(problem.open_decay),
            "toml": toml,
            "text": f"{name}: decay {c.worst_decay:.3g} s, noise {c.noise_voltage:.3g} V rms",
        }
        for (name, c, _), toml in zip(entries, tomls, strict=True)
    ]
    data = {"charts": {}, "responses": [_response(problem, weights) for _, _, weights in entries], "chosen": chosen + 1}
    required = problem.requirements
    return render(
        "tune.html.j2",
        title=f"Tuning: {scenario}",
        requirements=[
            ("Uncertainty", f"± {100 * required.uncertainty:g} % of every parameter, random plants: {required.plants}"),
            ("Strain noise", f"{required.strain_noise:g} rms a sample"),
            ("Disk margin of all pairs at once", f"at least {required.disk_margin:g}, on both plants"),
            ("Voltage limit", f"{required.voltage_limit:g} V"),
            ("Decay without control", f"{problem.open_decay:.2f} s"),
            ("Seed", str(required.seed)),
        ],
        rows=rows,
        chosen=chosen + 1,
        front=" ".join(f"{r['x']:.1f},{r['y']:.1f}" for r in rows[1:]),
        ticks_x=[{"at": scale.x(v), "text": f"{v:g}"} for v in round_ticks(*scale.noise)],
        ticks_y=[{"at": scale.y(v), "text": f"{v:g}"} for v in round_ticks(*scale.decay)],
        size={"width": WIDTH, "height": HEIGHT, "left": LEFT, "bottom": HEIGHT - BOTTOM, "right": WIDTH - EDGE},
        data=data,
    )


@dataclass(frozen=True, kw_only=True)
class _Scale:
    """Logarithmic axes of the front's picture."""

    noise: tuple[float, float]
    decay: tuple[float, float]

    @classmethod
    def of(cls, noise: Array, decay: Array) -> "_Scale":
        def widened(values: Array) -> tuple[float, float]:
            return float(values.min()) / 1.15, float(values.max()) * 1.15

        return cls(noise=widened(noise), decay=widened(decay))

    def x(self, value: float) -> float:
        low, high = np.log(self.noise)
        return float(LEFT + (np.log(value) - low) / (high - low) * (WIDTH - LEFT - EDGE))

    def y(self, value: float) -> float:
        low, high = np.log(self.decay)
        return float(HEIGHT - BOTTOM - (np.log(value) - low) / (high - low) * (HEIGHT - BOTTOM - EDGE))


def round_ticks(low: float, high: float) -> list[float]:
    """1, 2 and 5 times powers of ten; in a range with few of them, at least three in equal steps of that kind."""
    powers = range(int(np.floor(np.log10(min(low, high - low)))) - 1, int(np.ceil(np.log10(high))) + 1)
    round_numbers = [f * 10.0**p for p in powers for f in (1, 2, 5)]
    ticks = [v for v in round_numbers if low <= v <= high]
    if len(ticks) < FEWEST_TICKS:
        step = max(v for v in round_numbers if v <= (high - low) / FEWEST_TICKS)
        ticks = [k * step for k in range(int(np.ceil(low / step)), int(np.floor(high / step)) + 1)]
    return ticks


def _response(problem: TuningProblem, weights: Weights) -> list[dict[str, Any]]:
    """Charts of deflections and voltages on the scenario's plant."""
    response = problem.response(weights)
    return [
        _curves("Deflections", "mm", response, 1e3 * response.y, "y_pi"),
        _curves("Voltages", "V", response, response.u, "u"),
    ]


def _curves(title: str, unit: str, response: Response, values: Array, name: str) -> dict[str, Any]:
    rows = plotted_rows(values, MAX_ROWS)
    curves = {f"{name}[{k + 1}]": values[rows, k] for k in range(values.shape[1])}
    return chart(
        title, ({**axis("time in s"), "short": "s"}, response.time[rows]), axis(f"in {unit}", unit=unit), curves
    )
