"""Tables for the terminal: a design's figures, a run's checks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from flexbeams.controller.design import Design
from flexbeams.scenarios.results.display import limits, number
from flexbeams.scenarios.runs.job import CHECK_FAILED, FAILED, INTERRUPTED, OK, JobResult


def console(width: int = 100) -> Console:
    """Standard output; of the width given where it is not a terminal."""
    out = Console(highlight=False)
    return out if out.is_terminal else Console(highlight=False, width=width)


def show_checks(finished: JobResult) -> None:
    """Each check beside the paper's figure, and where the results are."""
    out = console()
    if finished.title:
        out.print(escape(finished.title), style="bold", soft_wrap=True)
    table = Table()
    table.add_column("check")
    for heading in ("measured", "limit", "paper"):
        table.add_column(heading, justify="right")
    table.add_column("")
    for o in finished.outcomes:
        limited = o.minimum is not None or o.maximum is not None
        verdict = "" if not limited else "[green]ok[/]" if o.passed else "[red bold]FAILED[/]"
        texts = (o.name, number(o.value, o.unit), limits(o.minimum, o.maximum, o.unit), number(o.paper, o.unit))
        table.add_row(*map(escape, texts), verdict)
    if finished.outcomes:
        out.print(table)
    if finished.timing is not None:
        out.print(
            f"{finished.timing['steps']} steps in {finished.timing['wall_s']:.2f} s"
            + (f", {finished.factor} times real time" if finished.factor else "")
            + f"; results in {escape(str(finished.folder))}",
            soft_wrap=True,
        )
        if late := finished.timing.get("lateness"):
            shown = {key: f"{1e6 * late[key]:.0f} µs" for key in ("median", "p99", "p99.99", "max")}
            out.print(
                f"late at the start of a step: median {shown['median']}, 99 % {shown['p99']}, 99.99 % "
                f"{shown['p99.99']}, largest {shown['max']}; "
                f"{late['overruns']} steps late by more than a step; rate error {late['rate_error']:.1e}",
                soft_wrap=True,
            )


def show_overview(runs: Sequence[JobResult]) -> None:
    """A line for each of several runs."""
    table = Table()
    table.add_column("scenario", no_wrap=True)
    table.add_column("checks")
    for heading in ("held", "failed", "x real time"):
        table.add_column(heading, justify="right")
    table.add_column("results", overflow="fold")
    words = {
        OK: "[green]ok[/]",
        CHECK_FAILED: "[red bold]FAILED[/]",
        FAILED: "[red bold]ERROR[/]",
        INTERRUPTED: "[yellow]interrupted[/]",
    }
    for run in runs:
        complete = run.status in (OK, CHECK_FAILED)
        held = str(len(run.outcomes) - run.failed)
        table.add_row(
            run.name,
            words[run.status],
            *((held, str(run.failed)) if complete else ("", "")),
            run.factor,
            str(run.folder) if run.folder else "none",
        )
    console(width=300).print(table)


def show_design(design: Design) -> None:
    """The figures of a design for a person."""
    out, s = console(), design.summary
    out.print(f"[bold]design {design.design_id}[/]")
    out.print(
        f"{s['beams']} beams, {s['inputs']} patch pairs, {s['points_of_interest']} points of interest, "
        f"{s['strain_gauges']} strain gauges, {s['parameters']} parameters"
    )
    out.print(f"basis {s['basis']} (order {s['order']}): {s['full_order']} states, reduced to {s['reduced_order']}")
    out.print(
        f"Hankel singular values: {100 * s['hankel_share']:.2f} % of the sum kept, first "
        f"{s['hankel_position'][0]:.3e}, last kept {s['hankel_position'][s['reduced_order'] // 2 - 1]:.3e}, "
        f"first cut {_first_cut(s)}"
    )
    out.print(f"flatness series: terms cancel by a factor {s['flatness_cancellation']:.3g} over the transition")
    modes = Table(title="modes", title_justify="left")
    for heading in ("mode", "undamped, rad/s", "Hz", "damping ratio", "reduced model, 1/s"):
        modes.add_column(heading, justify="right")
    kept = _nearest_modes(s)
    for k, omega in enumerate(s["frequencies"][:30]):
        ratio = f"{s['damping_ratios'][k]:.4f}" if k < len(s["damping_ratios"]) else ""
        shown = f"{kept[k][0]:.3f} ± {kept[k][1]:.2f}j" if k in kept else ""
        modes.add_row(str(k + 1), f"{omega:.3f}", f"{omega / (2 * np.pi):.3f}", ratio, shown)
    out.print(modes)
    if len(s["frequencies"]) > 30:
        out.print(f"... {len(s['frequencies'])} modes in all (--json lists every one)")
    gains = Table(
        title="static gains, mm per 1000 V (reduced model without correction in brackets)", title_justify="left"
    )
    gains.add_column("point", justify="right")
    for k in range(s["inputs"]):
        gains.add_column(f"u[{k + 1}]", justify="right")
    for k, (full, red) in enumerate(zip(s["static_gain_pi"], s["static_gain_reduced_pi"], strict=True), 1):
        gains.add_row(f"y_pi[{k}]", *[f"{1e6 * a:.3f} ({1e6 * b:.3f})" for a, b in zip(full, red, strict=True)])
    out.print(gains)
    for name in ("estimator", "feedback"):
        slowest = s[f"{name}_eigenvalues"][0]
        out.print(f"slowest {name} eigenvalue: {slowest[0]:.3f} ± {abs(slowest[1]):.2f}j 1/s")


def _nearest_modes(summary: dict[str, Any]) -> dict[int, list[float]]:
    """The reduced model's eigenvalues, each at the mode of the full model whose frequency is nearest."""
    frequencies = np.array(summary["frequencies"])
    placed: dict[int, list[float]] = {}
    for value in summary["reduced_eigenvalues"]:
        if value[1] >= 0:
            distance = np.abs(np.log(frequencies / np.hypot(*value)))
            distance[list(placed)] = np.inf
            placed[int(np.argmin(distance))] = value
    return placed


def _first_cut(summary: dict[str, Any]) -> str:
    values = summary["hankel_position"]
    kept = int(summary["reduced_order"]) // 2
    return f"{values[kept]:.3e}" if kept < len(values) else "none"
