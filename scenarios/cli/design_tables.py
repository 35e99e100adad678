"""Tables of `flexbeams design` for the terminal."""

from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from flexbeams.controller.analysis import Analysis, LoopAnalysis
from flexbeams.controller.motion_figures import motion_fact
from flexbeams.scenarios.cli.tables import console

_POINT_WIDTH, _GAIN_WIDTH = 13, 20  # characters of a column of points and of gains
PLANTS = {"design": "the design's own plant", "exact": "the exact plant"}


def show_design(analysis: Analysis) -> None:
    """Prints the figures of a design and of its analysis."""
    design = analysis.design
    out, s = console(), design.summary
    out.print(f"[bold]design {design.design_id}[/]")
    out.print(
        f"{s['beams']} beams, {s['inputs']} patch pairs, {s['points_of_interest']} points of interest, "
        f"{s['strain_gauges']} strain gauges, {s['parameters']} parameters"
    )
    out.print(f"basis {s['basis']} (order {s['order']}): {s['full_order']} states, reduced to {s['reduced_order']}")
    out.print(
        f"Hankel singular values: {100 * s['hankel_share']:.2f} % of the sum retained, first "
        f"{s['hankel_position'][0]:.3e}, last retained {s['hankel_position'][s['reduced_order'] // 2 - 1]:.3e}, "
        f"first truncated {_first_truncated(s)}"
    )
    out.print("{}: {}".format(*motion_fact(s)))
    modes = Table(title="modes", title_justify="left")
    for heading in ("mode", "undamped, rad/s", "Hz", "damping ratio", "reduced model, 1/s"):
        modes.add_column(heading, justify="right")
    reduced = _nearest_modes(s)
    for k, omega in enumerate(s["frequencies"][:30]):
        damping = s["damping_ratios"][k]
        ratio = "overdamped" if damping is None else f"{damping:.4f}"
        eigenvalue = f"{reduced[k][0]:.3f} ± {reduced[k][1]:.2f}j" if k in reduced else ""
        modes.add_row(str(k + 1), f"{omega:.3f}", f"{omega / (2 * np.pi):.3f}", ratio, eigenvalue)
    out.print(modes)
    if len(s["frequencies"]) > 30:
        out.print(f"... {len(s['frequencies'])} modes in all (--json lists all)")
    if s["real_eigenvalues"]:
        out.print("real poles, 1/s: " + ", ".join(f"{value:.3f}" for value in s["real_eigenvalues"][:12]))
    for table in static_gains(s, out.width):
        out.print(table)
    for name, loop in analysis.loops.items():
        pole = loop.poles[0]
        out.print(f"closed loop on {PLANTS[name]}: least stable pole {pole.real:.3f} ± {abs(pole.imag):.2f}j 1/s")
    for name in ("estimator", "feedback"):
        slowest = s[f"{name}_eigenvalues"][0]
        out.print(f"slowest {name} eigenvalue: {slowest[0]:.3f} ± {abs(slowest[1]):.2f}j 1/s")
    for name, loop in analysis.loops.items():
        if loop.margins:
            disk = loop.margins.disk
            out.print(
                f"margins on {PLANTS[name]}: disk margin {disk.alpha:.3f} of all pairs at once, at "
                f"{disk.frequency:.1f} rad/s: gains {1 / disk.gain:.2f} to {disk.gain:.2f} times, phases "
                f"± {disk.phase:.0f}°"
            )
            out.print(_margins(loop))
    out.print(f"integral gain: {s['integral_gain']:g} a sample, stable up to {s['integral_gain_limit']:g}")
    _show_statics(out, analysis)
    for warning in s["warnings"]:
        out.print(f"[yellow]warning:[/] {escape(warning)}")


def _margins(loop: LoopAnalysis) -> Table:
    """Margins of each pair with the others closed, and noise."""
    margins, noise = loop.margins, loop.noise_gain
    assert margins is not None
    assert noise is not None
    table = Table()
    for heading in ("pair", "gain", "phase", "delay", "disk margin", "noise, mV rms per µm/m"):
        table.add_column(heading, justify="right")
    for k, channel in enumerate(margins.channels):
        table.add_row(f"u[{k + 1}]", *channel.texts(), f"{1e-3 * noise[k]:.2f}")
    return table


def _show_statics(out: Console, analysis: Analysis) -> None:
    """Expected static errors, the offset-free observer, and what to move."""
    errors, ranking, offsets = (
        analysis.static_errors.figures(),
        analysis.ranking,
        analysis.design.summary.get("offsets"),
    )
    for name in ("feedforward", "loop"):
        label = "feedforward alone" if name == "feedforward" else "with control"
        median, high, largest = (1e3 * v for v in errors[name])
        out.print(
            f"expected static error, {label}: median {median:.3f} mm, 95 % {high:.3f} mm, largest {largest:.3f} mm "
            f"of {errors['samples']} plants"
        )
    if offsets:
        out.print(
            f"offset map: {offsets['independent_errors']} independent strain errors of "
            f"{len(ranking.gauge_losses)} gauges, condition {offsets['condition']:.3g}, rms deflection error "
            f"{1e3 * offsets['static_error_before']:.3f} mm before, {1e3 * offsets['static_error_after']:.3f} mm after"
            + (f"; blind gauges {offsets['blind_gauges']}" if offsets["blind_gauges"] else "")
        )
    for word, losses in (("patch pair", ranking.pair_losses), ("strain gauge", ranking.gauge_losses)):
        order = np.argsort(-losses)
        listed = ", ".join(f"{k + 1} ({100 * losses[k]:.0f} %)" for k in order)
        out.print(f"{word}s by their part in the Hankel singular values: {listed}")


def static_gains(s: dict[str, Any], width: int) -> list[Table]:
    """Tables of as many pairs as `width` characters take, at least two."""
    tables = []
    count = max(2, (width - _POINT_WIDTH) // _GAIN_WIDTH)
    for first in range(0, s["inputs"], count):
        pairs = range(first, min(first + count, s["inputs"]))
        title = "static gains, mm per 1000 V (reduced model without correction in brackets)"
        if len(pairs) < s["inputs"]:
            title += f", pairs {pairs[0] + 1} to {pairs[-1] + 1}"
        gains = Table(title=title, title_justify="left")
        gains.add_column("point", justify="right")
        for k in pairs:
            gains.add_column(f"u[{k + 1}]", justify="right")
        for point, (full, red) in enumerate(zip(s["static_gain_pi"], s["static_gain_reduced_pi"], strict=True), 1):
            gains.add_row(f"y_pi[{point}]", *[f"{1e6 * full[k]:.3f} ({1e6 * red[k]:.3f})" for k in pairs])
        tables.append(gains)
    return tables


def _nearest_modes(summary: dict[str, Any]) -> dict[int, list[float]]:
    """The reduced model's eigenvalues, each at the mode of the full model whose frequency is nearest."""
    frequencies = np.array(summary["frequencies"])
    nearest: dict[int, list[float]] = {}
    for value in summary["reduced_eigenvalues"]:
        if value[1] >= 0:
            distance = np.abs(np.log(frequencies / np.hypot(*value)))
            distance[list(nearest)] = np.inf
            nearest[int(np.argmin(distance))] = value
    return nearest


def _first_truncated(summary: dict[str, Any]) -> str:
    values = summary["hankel_position"]
    order = int(summary["reduced_order"]) // 2
    return f"{values[order]:.3e}" if order < len(values) else "none"
