"""Files of a run: results, summary, figures and report."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexbeams.scenarios.definition.choices import Format
from flexbeams.scenarios.definition.schema import Figure
from flexbeams.scenarios.report.drawings import drawing_hash
from flexbeams.scenarios.report.figure_plots import figure_plots
from flexbeams.scenarios.report.overview import OVERVIEW, overview_plot
from flexbeams.scenarios.report.plots import FILES, Plot
from flexbeams.scenarios.results.decimation import thinned
from flexbeams.scenarios.results.files import json_values, write_formats
from flexbeams.scenarios.results.folder import CLAIM, SUMMARY, ResultFolder
from flexbeams.scenarios.results.run import Kind, Run

if TYPE_CHECKING:
    from flexbeams.scenarios.report.figure_process import FigureProcess
    from flexbeams.scenarios.results.compare import FinishedRun

REPORT = "report.html"
TEXTS = ("coupling", "backend", "design_id")  # entries of summary.json that a run which was killed has not noted


def summary_head(kind: Kind, name: str, changed: Mapping[str, Any]) -> dict[str, Any]:
    """What summary.json says of a run that is not finished; `changed` as from changed_settings."""
    return {"kind": kind, "scenario": name, "settings": json_values(dict(changed))}


def figure_names(figures: Sequence[Figure] | None) -> list[str]:
    """Names of the figures of a scenario, or of a package, which has none of its own (None)."""
    return [OVERVIEW] if figures is None else [figure.file for figure in figures]


def file_names(figures: Sequence[str], report: bool, formats: Sequence[Format]) -> list[str]:
    """Names of the files that a run writes."""
    return [SUMMARY, *(f"results.{kind}" for kind in formats), *([REPORT] if report else []), *_drawn_names(figures)]


def _drawn_names(figures: Sequence[str]) -> list[str]:
    return [f"{name}.{kind}" for name in figures for kind in FILES]


def write_run(
    run: Run, path: Path, *, figures: bool = True, report: bool = True, formats: Sequence[Format] = ("csv",)
) -> None:
    """Writes the files of a run into the folder `path`; InputError for a file in the way that no earlier run wrote."""
    with ResultFolder(path) as folder:
        names = figure_names(None if run.kind == "package" else run.scenario.figure) if figures else []
        folder.require_free(file_names(names, report, formats))
        write_files(run, folder, figures=figures, report=report, formats=formats)


def write_files(
    run: Run,
    folder: ResultFolder,
    *,
    figures: bool = True,
    report: bool = True,
    formats: Sequence[Format] = ("csv",),
    figure_process: "FigureProcess | None" = None,
) -> None:
    """Writes results.csv (or other formats), figures, report.html and summary.json.

    Incomplete runs have neither report nor figures. Figures are those of the scenario, or one of all signals for a
    package; they are drawn by the process if there is one. Those that an earlier run drew in the folder with the same
    content stay. The rows of a long run that are in a file of the folder are gone then. Raises InputError for a file
    that cannot be written.
    """
    complete, summary = run.recording.complete, json_values(run.summary)
    folder.begin(summary_head(run.kind, run.name, run.summary["settings"]))
    plots = _plots(run, folder.path) if figures and complete else []
    drawings = {plot.stem.name: drawing_hash(plot) for plot in plots}
    plots = [plot for plot in plots if not _kept(folder, plot.stem.name, drawings)]
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
    folder.finish({**summary, "drawings": drawings})


def _kept(folder: ResultFolder, figure: str, drawings: Mapping[str, str]) -> bool:
    """Keeps a figure's files of the earlier run in the folder where that run drew the same."""
    same = folder.earlier.get("drawings", {}).get(figure) == drawings[figure]
    return same and folder.keep(_drawn_names([figure]))


def write_loaded(
    run: "FinishedRun", path: Path, *, figures: bool = True, report: bool = True, formats: Sequence[Format] = ("csv",)
) -> None:
    """Writes a run that was loaded into the folder `path`: its results, and copies of its figures and report.

    Raises InputError for a file in the way that no earlier run wrote.
    """
    copied = [
        name
        for name in run.summary.get("files", {})
        if Path(name).name == name
        and ((report and name == REPORT) or (figures and name.endswith((".png", ".svg"))))
        and (run.folder / name).is_file()
    ]
    known = {k: v for k, v in run.summary.items() if k not in CLAIM}
    summary = {**dict.fromkeys(TEXTS, ""), "title": run.label, "checks": [], "metrics": {}, "timing": {}, **known}
    with ResultFolder(path) as folder:
        folder.require_free([*file_names([], False, formats), *copied])
        drawings = summary.pop("drawings", {})
        folder.begin(summary)
        write_formats(folder, run.recording, summary, formats)
        for name in copied:
            folder.write(path / name, (run.folder / name).read_bytes())
        drawn = {name: drawings[name] for name in drawings if {*_drawn_names([name])} <= {*copied}}
        folder.finish({**summary, "drawings": drawn})


def _plots(run: Run, folder: Path) -> list[Plot]:
    if run.kind == "scenario":
        return figure_plots(run.scenario, run.recording, folder, run.open_loop)
    plot = overview_plot(thinned(run.recording), run.scenario.title, folder)
    return [] if plot is None else [plot]
