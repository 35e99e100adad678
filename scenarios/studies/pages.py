"""What a study leaves beside its data: study.html, and the full runs of its worst samples."""

import json
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flexbeams.plant.errors import FlexbeamsError, InputError
from flexbeams.scenarios.report.study import PageInput, PageMeasure, StudyPage, write_study_page
from flexbeams.scenarios.results.folder import ResultFolder
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.runs.files import file_names, write_files
from flexbeams.scenarios.runs.prepare import prepare_scenario
from flexbeams.scenarios.runs.scenario import run_prepared
from flexbeams.scenarios.studies.axes import with_option
from flexbeams.scenarios.studies.dataset import Results
from flexbeams.scenarios.studies.planning import StudyPlan
from flexbeams.scenarios.studies.summary import WORST, worst_first

PAGE, FULL_RUNS, REPORT = "study.html", "runs", "report.html"
MOST_FULL = 8  # full runs that a study makes by itself


def full_run(plan: StudyPlan, number: int, animation: bool = False) -> Run:
    """One run of a study as a run of its scenario, with the study's measures as checks.

    Raises InputError for a number that the study does not have, FlexbeamsError where the run cannot start.
    """
    if not 0 <= number < plan.samples.runs:
        raise InputError("run", f"must be from 0 to {plan.samples.runs - 1}", number)
    scenario = plan.file.scenario.scenario
    if plan.file.study.signals is not None:
        scenario = replace(scenario, record=[*(scenario.record or []), *plan.file.study.signals.record])
    options, starts = scenario.design, dict(plan.settings.overrides)
    for axis, value in zip(plan.axes, plan.samples.values[number].tolist(), strict=True):
        if axis.option:
            options = with_option(options, axis.option, value)
        for target in axis.targets:
            start = value * target.factor
            variable = plan.prepared.declarations[target.instance].variables[target.variable]
            starts[f"{target.instance}.{target.variable}"] = start if variable.type == "Real" else int(start)
    file = replace(plan.file.scenario, scenario=replace(scenario, check=plan.checks, design=options))
    settings = replace(plan.settings, overrides=starts, record_animation=animation)
    return run_prepared(prepare_scenario(file, settings))


def write_full_run(plan: StudyPlan, number: int, folder: Path) -> Path:
    """Makes a full run and its report in folder/runs/<number>; returns the report."""
    run = full_run(plan, number, animation=True)
    place = folder / FULL_RUNS / str(number)
    with ResultFolder(place) as results:
        results.require_free(file_names([], True, ()))
        write_files(run, results, figures=False, report=True, formats=())
    return place / REPORT


def write_pages(
    plan: StudyPlan, results: Results, summary: dict[str, Any], folder: Path, notify: Callable[[str], None]
) -> Path:
    """Writes study.html, and before it the full runs of the worst samples that are not there yet."""
    measures = [_measure(plan, results, summary, k) for k in range(len(plan.checks))]
    links: dict[int, str] = {}
    for number in _shown(measures, results):
        report = folder / FULL_RUNS / str(number) / REPORT
        try:
            if not report.exists():
                write_full_run(plan, number, folder)
            links[number] = report.relative_to(folder).as_posix()
        except FlexbeamsError as error:
            notify(f"run {number} has no report: {error}")
    page = StudyPage(
        title=plan.file.study.title,
        description=plan.file.description,
        facts=_facts(plan, results, summary),
        runs=results.numbers,
        failures=[(f["run"], f["reason"]) for f in summary["failures"]],
        inputs=[
            PageInput(name=a.name, unit=a.unit, nominal=a.nominal, group=a.group, values=results.inputs[:, k])
            for k, a in enumerate(plan.axes)
        ],
        measures=measures,
        links=links,
        command=f"flexbeams study {plan.file.name} --full N",
    )
    write_study_page(page, folder / PAGE)
    return folder / PAGE


def _shown(measures: Iterable[PageMeasure], results: Results) -> list[int]:
    """Numbers of the runs that are made in full: of each measure the worst, then the second, up to MOST_FULL."""
    ranks = [[int(results.numbers[k]) for k in m.worst] for m in measures]
    ordered = [row[rank] for rank in range(WORST) for row in ranks if rank < len(row)]
    return list(dict.fromkeys(ordered))[:MOST_FULL]


def _measure(plan: StudyPlan, results: Results, summary: dict[str, Any], column: int) -> PageMeasure:
    check, values = plan.checks[column], results.measures[:, column]
    complete = np.flatnonzero(results.complete)
    found = summary["measures"][check.name].get("sensitivity", {"estimator": "none", "left_out": 0, "indices": {}})
    return PageMeasure(
        name=check.name,
        unit=check.unit,
        minimum=check.min,
        maximum=check.max,
        values=values,
        worst=complete[worst_first(check, values[complete])[:WORST]].tolist(),
        estimator=found["estimator"],
        left_out=found["left_out"],
        indices=[
            (group, i["first"], i["first_low"], i["first_high"], i["total"], i["total_low"], i["total_high"])
            for group, i in found["indices"].items()
        ],
    )


def _facts(plan: StudyPlan, results: Results, summary: dict[str, Any]) -> list[tuple[str, str]]:
    methods = {
        "lhs": "Latin hypercube",
        "sobol": "Sobol sequence",
        "saltelli": "Saltelli design on a Sobol sequence",
        "grid": "all points of a grid",
    }
    checked = summary["checked"]
    facts = [
        ("Scenario", f"{plan.prepared.file.name}: {plan.prepared.scenario.title}"),
        ("Inputs", f"{len(plan.axes)} in {len(plan.samples.groups)} groups"),
        ("Method", f"{methods[plan.samples.method]}, seed {plan.samples.seed}"),
        ("Steps of a run", f"{plan.prepared.steps} of {plan.prepared.step:g} s"),
        ("Version", str(summary["flexbeams"])),
    ]
    if plan.settings.overrides:
        facts.append(("In every run", json.dumps(dict(plan.settings.overrides))))
    if checked["runs"]:
        gap = checked["largest_difference"]
        text = f"in C; {checked['runs']} runs went through the FMI units as well: within {gap:.1g} of the signal"
        facts.append(("Batch kernel", text))
    return facts
