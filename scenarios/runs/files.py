"""Files of a run: results, summary, figures and report."""

from collections.abc import Sequence
from pathlib import Path

from flexbeams.plant.archive import remove_file
from flexbeams.scenarios.definition.choices import Format
from flexbeams.scenarios.report.figure_plots import figure_plots
from flexbeams.scenarios.report.figure_process import FigureProcess
from flexbeams.scenarios.results.files import write_results
from flexbeams.scenarios.results.run import Run


def write_run(
    run: Run,
    folder: Path,
    *,
    figures: bool = True,
    report: bool = True,
    formats: Sequence[Format] = ("csv",),
    figure_process: FigureProcess | None = None,
) -> None:
    """Writes results.csv (or other formats), summary.json, the scenario's figures and report.html.

    Report, figures, and results in other formats, of an earlier run are removed. Incomplete runs have neither report
    nor figures, packages no report. Figures are drawn by the process if there is one. Raises InputError for a file that
    cannot be written.
    """
    for name in ("report.html", *(f"{f.file}.{kind}" for f in run.scenario.figure for kind in ("png", "svg"))):
        remove_file(folder / name)
    complete = run.recording.complete
    plots = figure_plots(run.scenario, run.recording, folder, run.open_loop) if figures and complete else []
    if plots and figure_process:
        figure_process.start(plots)
    write_results(folder, run.recording, run.summary, formats)
    if report and complete and run.design is not None:
        from flexbeams.scenarios.report.report import write_report

        write_report(run, folder)
    if plots and figure_process:
        figure_process.wait()
    elif plots:
        from flexbeams.scenarios.report.figures import write_figures

        write_figures(plots)
