"""Tables and JSON of a plan of an experiment."""

from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from flexbeams.scenarios.api.plans import ExperimentPlan


def plan_table(plan: ExperimentPlan) -> dict[str, Any]:
    """Everything about a plan in JSON's types; deviations are relative, one standard deviation."""
    return {
        "segments": [{"signal": s.signal, "voltages": list(s.voltages)} for s in plan.segments],
        "duration": plan.experiment.duration,
        "largest_deflection": plan.largest_deflection,
        "mean_deviations": dict(plan.sizes),
        "deviations": dict(zip(plan.expected.names, plan.expected.deviations.tolist(), strict=True)),
        "undetermined": list(plan.expected.undetermined),
        "open_directions": [
            {"deviation": d.deviation if np.isfinite(d.deviation) else None, "shares": d.shares}
            for d in plan.expected.directions
        ],
    }


def show_plan(plan: ExperimentPlan) -> None:
    """The segments, what they will tell, and what simpler records would."""
    console = Console()
    headers = [f"u[{k}], V" for k in range(1, len(plan.segments[0].voltages) + 1)]
    table = Table("segment", "signal", *map(escape, headers), title="Experiment")
    for k, segment in enumerate(plan.segments, 1):
        table.add_row(str(k), segment.signal, *(f"{voltage:.5g}" for voltage in segment.voltages))
    console.print(table)
    first = Column(header="parameter", no_wrap=True, min_width=27)
    table = Table(first, "expected +- 95 %", title="What it will tell")
    for name, deviation in zip(plan.expected.names, plan.expected.deviations, strict=True):
        table.add_row(
            escape(name), "undetermined" if name in plan.expected.undetermined else f"{196 * deviation:.2g} %"
        )
    console.print(table)
    table = Table("record", "mean deviation, %", title="Criterion")
    for name, size in plan.sizes.items():
        table.add_row(name, f"{100 * size:.2g}")
    console.print(table)
    console.print(
        f"{plan.experiment.duration:g} s, largest deflection {1e3 * plan.largest_deflection:.3g} mm", highlight=False
    )
