"""Files of a run: results, summary, figures and report."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flexbeams.scenarios.definition.choices import Format
from flexbeams.scenarios.definition.schema import Figure
from flexbeams.scenarios.report.figure_plots import figure_plots
from flexbeams.scenarios.report.figure_process import FigureProcess
from flexbeams.scenarios.results.files import json_values, write_formats
from flexbeams.scenarios.results.folder import SUMMARY, ResultFolder
from flexbeams.scenarios.results.run import Run

REPORT = "report.html"


def summary_head(name: str, changed: Mapping[str, Any]) -> dict[str, Any]:
    """What summary.json says of a run that is not finished; `changed` as from changed_settings."""
    return {"scenario": name, "settings": json_values(dict(changed))}


def file_names(figures: Sequence[Figure], report: bool, formats: Sequence[Format]) -> list[str]:
    """Names of the files that a run writes."""
    drawn = [f"{figure.file}.{kind}" for figure in figures for kind in ("png", "svg")]
    return [SUMMARY, *(f"results.{kind}" for kind in formats), *([REPORT] if report else []), *drawn]


def write_run(
    run: Run, path: Path, *, figures: bool = True, report: bool = True, formats: Sequence[Format] = ("csv",)
) -> None:
    """Writes the files of a run into the folder `path`; InputError for a file in the way that no earlier run wrote."""
    with ResultFolder(path) as folder:
        folder.require_free(file_names(run.scenario.figure if figures else [], report, formats))
        write_files(run, folder, figures=figures, report=report, formats=formats)


def write_files(
    run: Run,
    folder: ResultFolder,
    *,
    figures: bool = True,
    report: bool = True,
    formats: Sequence[Format] = ("csv",),
    figure_process: FigureProcess | None = None,
) -> None:
    """Writes results.csv (or other formats), the scenario's figures, report.html and summary.json.

    Incomplete runs have neither report nor figures, packages no figures. Figures are drawn by the process if there is
    one. The rows of a long run that are in a file of the folder are gone then. Raises InputError for a file that cannot
    be written.
    """
    complete, summary = run.recording.complete, json_values(run.summary)
    folder.begin(summary_head(run.name, run.summary["settings"]))
    plots = figure_plots(run.scenario, run.recording, folder.path, run.open_loop) if figures and complete else []
    if plots and figure_process:
        figure_process.start(plots)
    write_formats(folder, run.recording, summary, formats)
    if report and complete:
        from flexbeams.scenarios.report.report import report_html

        folder.write(folder.path / REPORT, report_html(run).encode("utf-8", "replace"))
    if plots and figure_process:
        drawn = figure_process.wait()
    elif plots:
        from flexbeams.scenarios.report.figures import drawn_figures

        drawn = drawn_figures(plots)
    else:
        drawn = {}
    for path, content in drawn.items():
        folder.write(path, content)
    if run.recording.file is not None and run.recording.file.path is not None:
        run.recording.release()
    folder.finish(summary)
