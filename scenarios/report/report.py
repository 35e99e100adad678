"""report.html: one self-contained page about a run."""

from importlib.metadata import version
from typing import Any

from flexbeams.controller.design import Design
from flexbeams.scenarios.definition.kinds import instance_kinds
from flexbeams.scenarios.definition.schema import Scenario
from flexbeams.scenarios.report.animation import animation
from flexbeams.scenarios.report.loops import run_loops
from flexbeams.scenarios.report.overview import OVERVIEW
from flexbeams.scenarios.report.page import render
from flexbeams.scenarios.report.panels import figure_groups, remaining_signals_group
from flexbeams.scenarios.results.decimation import thinned
from flexbeams.scenarios.results.display import check_limits, limits, number, verdict
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.results.saturation import saturation_lines
from flexbeams.scenarios.simulation.recording import Recording

_TIMING = {"steps": "steps", "wall_s": "stepping loop, s", "real_time_factor": "times real time"}


def report_html(run: Run) -> str:
    """The page; equal runs give equal bytes except for the section on timing."""
    drawn, open_loop = thinned(run.recording), None if run.open_loop is None else thinned(run.open_loop)
    groups = figure_groups(run.scenario, drawn, open_loop)
    if further := remaining_signals_group(run.scenario, drawn):
        groups.append(further)
    design = run.design
    moving = None if design is None else animation(run.recording.frames, design, _step(run.scenario, design))
    data = {"groups": groups, "animation": moving}
    return render(
        "report.html.j2",
        title=run.scenario.title,
        paper=run.scenario.paper,
        about="" if run.description == run.scenario.title else run.description,
        checks=[check_row(c) for c in run.summary["checks"]],
        outcome=_outcome(run),
        facts=_package_facts(run) if design is None else _facts(run, design),
        metrics=_metrics(run.summary["metrics"], run.summary["checks"]),
        timing=_timing(run.summary["timing"]),
        groups=groups,
        loop_pictures=_loops(run, drawn),
        figures=[OVERVIEW] if design is None else [figure.file for figure in run.scenario.figure],
        animation=moving,
        data=data,
    )


def _loops(run: Run, drawn: Recording) -> list[dict[str, Any]]:
    """Pictures of the instances whose kind has loops; none for a package."""
    if run.design is None:
        return []
    kinds = instance_kinds(run.scenario, run.settings.kinds, run.name)
    arrays = {name: kind.loops for name, kind in kinds.items() if kind.loops is not None}
    return run_loops(run.scenario, drawn, arrays)


def check_row(record: dict[str, Any]) -> dict[str, str]:
    """An entry of summary.json's `checks` as text."""
    unit = record["unit"]
    limit = limits(*check_limits(record), unit).replace("<=", "≤").replace(">=", "≥")
    return {
        "name": record["name"],
        "measured": number(record["value"], unit) or "no value",
        "limit": limit,
        "paper": number(record["paper"], unit),
        "verdict": verdict(record),
    }


def _outcome(run: Run) -> dict[str, Any]:
    limited = [o for o in run.outcomes if o.minimum is not None or o.maximum is not None]
    failed = sum(not o.passed for o in limited)
    if not limited:
        return {"passed": None, "text": "No checks"}
    count = f"{len(limited)} check{'s' if len(limited) > 1 else ''}"
    if failed:
        return {"passed": False, "text": f"{failed} of {count} failed"}
    return {"passed": True, "text": f"All {count} hold" if len(limited) > 1 else "The check holds"}


def _step(scenario: Scenario, design: Design) -> float:
    return scenario.step or design.options.sample_time


def _facts(run: Run, design: Design) -> list[tuple[str, str]]:
    """Facts about the run, as terms and descriptions."""
    s, summary, settings = run.scenario, design.summary, run.settings
    kinds = instance_kinds(s, settings.kinds, run.name)
    parts = [
        (summary["beams"], "beam"),
        (summary["inputs"], "patch pair"),
        (len(design.structure.spring), "spring"),
        (summary["points_of_interest"], "point of interest"),
        (summary["strain_gauges"], "strain gauge"),
    ]
    plants = {
        f"{i.basis or summary['basis']}" + (f" of order {i.order}" if i.order else "")
        for name, i in s.instance.items()
        if name in kinds and kinds[name].takes_basis and not settings.basis
    }
    facts = [
        ("Scenario", run.name),
        ("Structure", f"{settings.structure or s.structure}: " + ", ".join(_plural(n, word) for n, word in parts)),
        (
            "Design",
            f"basis {summary['basis']} of order {summary['order']}, {summary['full_order']} states, reduced to "
            f"{summary['reduced_order']}",
        ),
        *[("Plant", f"basis {name}") for name in sorted(plants - {summary["basis"]})],
        ("Units", ", ".join(f"{name} ({i.unit or i.fmu})" for name, i in s.instance.items())),
        ("Backend", settings.backend),
        ("Coupling", f"{s.coupling}, steps of {1e3 * _step(s, design):g} ms"),
        ("Simulated", f"{run.recording.time[-1]:g} s"),
        *_saturation(run),
        *([("Set", ", ".join(f"{k} = {v}" for k, v in settings.overrides.items()))] if settings.overrides else []),
        ("Design id", design.design_id),
        *(("Design warning", line) for line in summary["warnings"]),
        ("Version", f"flexbeams {version('flexbeams')}"),
    ]
    return facts


def _package_facts(run: Run) -> list[tuple[str, str]]:
    """Facts about the run of a package, whose units are built."""
    s, overrides = run.scenario, run.settings.overrides
    return [
        ("Package", run.name),
        ("Units", ", ".join(f"{name} ({i.fmu})" for name, i in s.instance.items())),
        ("Coupling", f"{s.coupling}, steps of {1e3 * (s.step or 0.0):g} ms"),
        ("Simulated", f"{run.recording.time[0]:g} to {run.recording.time[-1]:g} s"),
        *_saturation(run),
        *([("Set", ", ".join(f"{k} = {v}" for k, v in overrides.items()))] if overrides else []),
        ("Version", f"flexbeams {version('flexbeams')}"),
    ]


def _saturation(run: Run) -> list[tuple[str, str]]:
    return [("Voltages", line) for line in saturation_lines(run.summary["metrics"])]


def _plural(count: int, word: str) -> str:
    if count == 1:
        return f"1 {word}"
    return f"{count or 'no'} " + (word.replace("point", "points", 1) if word.startswith("point") else word + "s")


def _metrics(metrics: dict[str, Any], checks: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Metrics that are not checks, as recorded."""
    named = {c["name"] for c in checks}
    return [(name, f"{value:.6g}") for name, value in metrics.items() if name not in named and value is not None]


def _timing(timing: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    for key, value in timing.items():
        name = _TIMING.get(key, prefix + key.replace("_", " "))
        if isinstance(value, dict):
            rows += _timing(value, f"{name}: ")
        elif isinstance(value, float):
            rows.append((name, f"{value:.4g}"))
        elif value is not None:
            rows.append((name, f"{value:,}" if isinstance(value, int) else str(value)))
    return rows
