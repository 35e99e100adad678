"""`flexbeams compare`: what may lie side by side, the tables, the page and the figure."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.report.comparison import write_comparison
from flexbeams.scenarios.results.compare import check_table, compare, metric_table
from flexbeams.scenarios.results.files import read_results, write_results
from flexbeams.scenarios.runs.files import write_run
from flexbeams.scenarios.runs.scenario import run_scenario

pytestmark = pytest.mark.native


@pytest.fixture(scope="module")
def runs(run_folder, tmp_path_factory) -> dict[str, Path]:
    """Folders of short runs by scenario."""
    root = tmp_path_factory.mktemp("runs")
    settings = Settings(build_folder=run_folder / "build/fmus", stop_time=2.5)
    for name in ("feedforward", "tracking", "single_beam"):
        write_run(run_scenario(name, settings), root / name, figures=False, report=False)
    return {path.name: path for path in root.iterdir()}


def altered(folder: Path, to: Path, **changes: object) -> Path:
    """A copy of a run with keys of its summary changed."""
    recording = read_results(folder / "results.csv")
    write_results(to, recording, {**json.loads((folder / "summary.json").read_text()), **changes})
    return to


def test_signals_of_every_run_are_compared(runs):
    comparison = compare([runs["feedforward"], runs["tracking"]])
    assert [run.label for run in comparison.runs] == ["feedforward", "tracking"]
    assert "plant.y_pi" in comparison.arrays
    assert "controller.u" in comparison.left_out


def test_checks_stand_side_by_side(runs):
    table = dict(check_table(compare([runs["feedforward"], runs["tracking"]])))
    summary = json.loads((runs["tracking"] / "summary.json").read_text())
    assert {c["name"] for c in summary["checks"]} <= set(table)
    assert table["settled after"][1] == {"measured": "0.7612 s", "paper": "2 s", "verdict": "holds"}
    assert table["largest error from T on"][0]["measured"] == ""


def test_metrics_stand_side_by_side(runs):
    table = dict(metric_table(compare([runs["feedforward"], runs["tracking"]])))
    assert table["plant.y_pi[1].end"][0] == "-8 mm"
    assert table["controller.u[1].largest"][0] == ""
    assert table["controller.u[1].largest"][1].endswith(" V")


def test_page_and_figure_hold_every_run(runs, tmp_path):
    written = write_comparison(compare([runs["feedforward"], runs["tracking"]]), tmp_path)
    assert [path.name for path in written] == ["compare.html", "compare.png", "compare.svg"]
    page = written[0].read_text()
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    assert data["groups"][0]["title"] == "plant.y_pi"
    assert "<p>tracking: compared 0 to 2.5 s of 2.5 s</p>" in page
    assert [c["label"] for c in data["groups"][0]["panels"][0]["curves"]] == ["feedforward", "tracking"]
    svg = written[2].read_text()
    assert "feedforward" in svg
    assert "tracking" in svg


def test_equal_comparisons_give_equal_files(runs, tmp_path):
    once, again = (
        write_comparison(compare([runs["feedforward"], runs["tracking"]]), tmp_path / name) for name in ("a", "b")
    )
    assert [p.read_bytes() for p in once] == [p.read_bytes() for p in again]


def test_runs_of_different_steps_keep_their_own_values(runs, tmp_path):
    coarse = read_results(runs["tracking"] / "results.csv")
    coarse = replace(coarse, time=coarse.time[::7], values=coarse.values[::7])
    write_results(tmp_path / "coarse", coarse, json.loads((runs["tracking"] / "summary.json").read_text()))
    comparison = compare([runs["tracking"], tmp_path / "coarse"])
    assert len(comparison.runs[1].recording.time) < len(comparison.runs[0].recording.time)
    assert write_comparison(comparison, tmp_path)[0].stat().st_size < 1_500_000


def test_folders_of_one_name_are_told_apart(runs, tmp_path):
    other = altered(runs["tracking"], tmp_path / "tracking")
    labels = [run.label for run in compare([runs["tracking"], other]).runs]
    assert labels == [str(runs["tracking"]), str(other)]


def test_hostile_names_stay_texts(runs, tmp_path):
    hostile = "<script>alert(1)</script>"
    other = altered(runs["tracking"], tmp_path / "other", title=hostile)
    page = write_comparison(compare([runs["tracking"], other]), tmp_path)[0].read_text()
    assert hostile not in page
    assert "&lt;script&gt;alert(1)" in page


def test_command_prints_tables_and_files(runs, tmp_path, capsys):
    status = main(["compare", str(runs["feedforward"]), str(runs["tracking"]), "--out", str(tmp_path / "out")])
    out, err = capsys.readouterr()
    assert status == 0
    assert "settled after" in out
    assert "plant.y_pi[1].end" in out
    assert str(tmp_path / "out" / "compare.html") in out
    assert "controller.u" in err


def broken_summary(runs: dict[str, Path], root: Path) -> Path:
    folder = altered(runs["tracking"], root / "broken")
    (folder / "summary.json").write_text("{")
    return folder


def other_json(runs: dict[str, Path], root: Path) -> Path:
    folder = altered(runs["tracking"], root / "other")
    (folder / "summary.json").write_text('{"scenario": "x"}')
    return folder


def no_results(runs: dict[str, Path], root: Path) -> Path:
    folder = altered(runs["tracking"], root / "bare")
    (folder / "results.csv").unlink()
    return folder


def no_table(runs: dict[str, Path], root: Path) -> Path:
    folder = altered(runs["tracking"], root / "text")
    (folder / "results.csv").write_text("time,plant.y_pi[1]\n0.0,one\n")
    return folder


def foreign_signals(runs: dict[str, Path], root: Path) -> Path:
    folder = altered(runs["tracking"], root / "foreign")
    (folder / "results.csv").write_text("time,other.y\n0.0,1.0\n1.0,2.0\n")
    return folder


@pytest.mark.parametrize(
    ("make", "rule"),
    [
        (lambda runs, root: root / "nowhere", "has no summary.json"),
        (broken_summary, "is not a summary of a run"),
        (other_json, "title is missing"),
        (no_results, r"has no results\.csv or other results"),
        (no_table, "is not a CSV file of numbers"),
        (foreign_signals, "share none"),
        (lambda runs, root: runs["tracking"], "must be different folders"),
    ],
)
def test_unfit_run_is_refused_in_one_line(runs, tmp_path, capsys, make, rule):
    other = make(runs, tmp_path)
    with pytest.raises(InputError, match=rule):
        compare([runs["tracking"], other])
    assert main(["compare", str(runs["tracking"]), str(other), "--out", str(tmp_path / "out")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_one_run_is_refused(runs):
    with pytest.raises(InputError, match="at least two"):
        compare([runs["tracking"]])


def test_read_results_are_those_written(runs):
    recording = read_results(runs["tracking"] / "results.csv")
    assert recording.time[-1] == 2.5
    assert np.isfinite(recording.values).all()
