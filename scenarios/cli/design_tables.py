"""Tables of `flexbeams design` for the terminal."""

from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from flexbeams.controller.design import Design
from flexbeams.scenarios.cli.tables import console


def show_design(design: Design) -> None:
    """Prints the figures of a design."""
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
    out.print(f"flatness series: terms cancel by a factor {s['flatness_cancellation']:.3g} over the transition")
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
    out.print(_static_gains(s))
    for plant, (real, imaginary) in s["closed_loop"].items():
        out.print(f"least stable pole of the closed loop on the {plant} plant: {real:.3f} ± {abs(imaginary):.2f}j 1/s")
    out.print(f"integral gain: {s['integral_gain']:g} a sample, stable up to {s['integral_gain_limit']:g}")
    for warning in s["warnings"]:
        out.print(f"[yellow]warning:[/] {escape(warning)}")
    for name in ("estimator", "feedback"):
        slowest = s[f"{name}_eigenvalues"][0]
        out.print(f"slowest {name} eigenvalue: {slowest[0]:.3f} ± {abs(slowest[1]):.2f}j 1/s")


def _static_gains(s: dict[str, Any]) -> Table:
    gains = Table(
        title="static gains, mm per 1000 V (reduced model without correction in brackets)", title_justify="left"
    )
    gains.add_column("point", justify="right")
    for k in range(s["inputs"]):
        gains.add_column(f"u[{k + 1}]", justify="right")
    for k, (full, red) in enumerate(zip(s["static_gain_pi"], s["static_gain_reduced_pi"], strict=True), 1):
        gains.add_row(f"y_pi[{k}]", *[f"{1e6 * a:.3f} ({1e6 * b:.3f})" for a, b in zip(full, red, strict=True)])
    return gains


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
