"""Runs as a notebook uses them: arrays by name, units, checks, tables, pages, saving and loading."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexbeams as fb
from flexbeams.scenarios.results.folder import ResultFolder
from flexbeams.scenarios.runs.run_view import RunView
from tests.helpers import PUSHED_SCENARIO
from tests.native.workshop import needs_zig

CHECK = """[[check]]
name = "largest voltage"
measure = "largest"
of = "controller.u"
unit = "V"
max = 1e3
[[check]]
name = "range"
measure = "end_deviation"
of = "plant.y_pi"
unit = "m"
min = -1.0
max = 1.0
"""
pytestmark = [pytest.mark.native, needs_zig]


@pytest.fixture(scope="module")
def scenario(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("view") / "pushed.toml"
    path.write_text(PUSHED_SCENARIO.format(stop=0.2) + CHECK, encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def run(scenario: str) -> RunView:
    return fb.run(scenario)


def test_arrays_by_name(run: RunView) -> None:
    columns, values = run.recording.columns, run.recording.values
    assert run["plant.y_pm"].shape == (1001, 2)
    np.testing.assert_array_equal(run["plant.y_pm[2]"], values[:, columns.index("plant.y_pm[2]")])
    np.testing.assert_array_equal(run["plant.y_pm"][:, 1], run["plant.y_pm[2]"])
    assert run["controller.saturated"].shape == (1001,)
    assert set(run) == {name.partition("[")[0] for name in columns} | {"plant.w"}
    assert len(run) == len(list(run.keys()))
    assert "plant.y_pm[2]" in run
    assert "plant.y_pm[3]" not in run
    for name in run:
        assert run[name].flags.c_contiguous
        assert not run[name].flags.writeable
        assert len(run[name]) == len(run.time)
    assert not run.time.flags.writeable
    np.testing.assert_array_equal(
        run.final("plant.y_pm"), values[-1, [columns.index(f"plant.y_pm[{k}]") for k in (1, 2)]]
    )


def test_deflections_are_those_of_the_unit(run: RunView, scenario: str) -> None:
    """In every row, and where the scenario records them itself, with other columns unchanged."""
    assert run["plant.w"].shape == (1001, 1, 21)
    assert np.abs(run["plant.w"][:, 0, 0]).max() < 1e-15  # m, at the clamp
    text = Path(scenario).read_text(encoding="utf-8").replace("stop_time", 'record = ["plant.w"]\nstop_time', 1)
    path = Path(scenario).with_name("recorded.toml")
    path.write_text(text, encoding="utf-8")
    recorded = fb.run(path)
    np.testing.assert_array_equal(recorded["plant.w"], run["plant.w"])
    assert "plant.w[1,21]" in recorded.recording.columns
    assert "plant.w[1,21]" not in run.recording.columns
    np.testing.assert_array_equal(recorded["plant.y_pi"], run["plant.y_pi"])
    frames = run.recording.frames
    assert frames is not None
    np.testing.assert_array_equal(run["plant.w"][:: frames.every, 0], frames.deflections)


def test_units_checks_and_metrics(run: RunView) -> None:
    assert [run.units[name] for name in ("plant.u", "plant.u[1]", "plant.y_pm", "plant.w", "plant.w[1,2]")] == [
        "V", "V", "1", "m", "m",
    ]  # fmt: skip
    check = run.checks["largest voltage"]
    assert (check.limit, check.unit, check.passed) == (1e3, "V", True)
    assert check.value == np.abs(run["controller.u"]).max() == run.metrics["largest voltage"]
    assert run.checks["range"].limit == (-1.0, 1.0)
    assert run.passed
    assert "largest voltage" in repr(run)


def test_pandas_and_xarray(run: RunView) -> None:
    pytest.importorskip("pandas")
    pytest.importorskip("xarray")
    frame = run.to_pandas()
    assert frame.index.name == "time"
    assert list(frame.columns) == run.recording.columns
    assert frame.attrs["units"]["plant.u[1]"] == "V"
    np.testing.assert_array_equal(frame["plant.y_pi[1]"], run["plant.y_pi[1]"])
    data = run.to_xarray()
    assert data["plant.w"].dims == ("time", "beam", "station")
    assert data["plant.y_pm"].dims == ("time", "gauge")
    assert data["controller.saturated"].dims == ("time",)
    assert data["plant.u"].attrs["units"] == "V"
    assert data.time.attrs["units"] == "s"
    for name in run:
        np.testing.assert_array_equal(data[name].values, run[name])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"coupling": "gauss"}, "coupling must be 'jacobi' or 'gauss-seidel', got 'gauss'"),
        ({"basis": "seg"}, "basis must be 'clamped_free' or 'segment', got 'seg'"),
        ({"backend": "c"}, "backend must be 'native' or 'python', got 'c'"),
        ({"backend": np.array(["c", "d"])}, "backend must be 'native' or 'python', got array(['c', 'd'], dtype='<U1')"),
        ({"decimate": True}, "decimate must be an integer >= 1, got True"),
        ({"stop_time": "3"}, "stop_time must be a number, got '3'"),
        ({"step": True}, "step must be a number, got True"),
        ({"decimate": 1.5}, "decimate must be an integer >= 1, got 1.5"),
        ({"start": ["plant.u"]}, "start must be a dictionary of names and values, got ['plant.u']"),
        ({"design": "kiel"}, "design must be a dictionary of names and values, got 'kiel'"),
    ],
)
def test_arguments_of_a_wrong_type(options: Any, message: str) -> None:
    with pytest.raises(fb.FlexbeamsError) as caught:
        fb.run("single_beam", **options)
    assert str(caught.value) == message


def test_wrong_arguments_of_what_follows_a_run(run: RunView, tmp_path: Path) -> None:
    for options, message in (
        ({"formats": "csv"}, "formats must be a list, such as ['csv'], got 'csv'"),
        ({"formats": ["xlsx"]}, "formats must be of csv, parquet, mat, mf4, got 'xlsx'"),
    ):
        with pytest.raises(fb.FlexbeamsError) as caught:
            run.save(tmp_path / "out", **options)
        assert str(caught.value) == message
    for tolerance, message in (("a", "tolerance must be a number, got 'a'"), (-1, "tolerance must be > 0, got -1")):
        with pytest.raises(fb.FlexbeamsError) as caught:
            fb.compare(run, run, tolerance=tolerance)  # type: ignore[arg-type]
        assert str(caught.value) == message


def test_missing_libraries_are_named(run: RunView, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(
        fb.FlexbeamsError, match=r"to_pandas needs the package pandas \(pip install 'flexbeams\[pandas\]"
    ):
        run.to_pandas()


def test_saved_and_loaded(run: RunView, tmp_path: Path) -> None:
    folder = run.save(tmp_path / "saved", formats=("csv", "mat"))
    assert {"results.csv", "results.mat", "report.html", "summary.json"} <= {path.name for path in folder.iterdir()}
    loaded = fb.load(folder)
    np.testing.assert_array_equal(loaded["plant.u"], run["plant.u"])
    assert dict(loaded.checks) == dict(run.checks)
    assert loaded.metrics == run.metrics
    assert loaded.settings.coupling == run.settings.coupling
    assert loaded.passed
    assert fb.compare(run, loaded, folder / "results.csv", tolerance=1e-15).holds
    again = loaded.save(tmp_path / "again", formats=("parquet",), figures=False)
    assert {path.name for path in again.iterdir()} == {"results.parquet", "report.html", "summary.json"}
    assert (again / "report.html").read_bytes() == (folder / "report.html").read_bytes()
    third = fb.load(again)
    assert fb.compare(run, third, tolerance=1e-15).holds
    assert third.summary | {"files": None} == loaded.summary | {"files": None}
    assert third.save(again) == again  # over itself, in another format
    assert {path.name for path in again.iterdir()} == {"results.csv", "report.html", "summary.json"}
    assert fb.compare(run, fb.load(again), tolerance=1e-15).holds
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken/results.csv").write_text("mine")
    with pytest.raises(fb.FlexbeamsError, match=r"taken.results\.csv: is in the way and was not written by flexbeams"):
        loaded.save(tmp_path / "taken")
    with pytest.raises(fb.FlexbeamsError, match=r"is not a folder of results: it has no summary\.json"):
        fb.load(tmp_path)


def test_figures_of_a_loaded_run_are_noted_where_they_are_copied(
    run: RunView, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not while they are being copied: a run that is killed meanwhile leaves another run's figures there."""
    folder = run.save(tmp_path / "saved", report=False)
    summary = json.loads((folder / "summary.json").read_bytes())
    for name in ("a.png", "a.svg", "b.png"):
        (folder / name).write_text(name)
        summary["files"][name] = ""
    summary["drawings"] = {"a": "1", "b": "2"}
    (folder / "summary.json").write_text(json.dumps(summary))
    loaded = fb.load(folder)
    for figures, noted in ((True, {"a": "1"}), (False, {})):
        copy = loaded.save(tmp_path / f"copy {figures}", figures=figures)
        assert json.loads((copy / "summary.json").read_bytes())["drawings"] == noted
    monkeypatch.setattr(ResultFolder, "finish", lambda *_: None)  # killed before it ends
    copy = loaded.save(tmp_path / "killed")
    assert "drawings" not in json.loads((copy / "summary.json").read_bytes())


def test_page_is_the_report_and_needs_nothing_from_outside(run: RunView, tmp_path: Path) -> None:
    page = run._repr_html_()
    assert page.startswith('<iframe srcdoc="<!doctype html>'.replace("<!", "&lt;!").replace("html>", "html&gt;")[:20])
    assert page.count("<iframe") == page.count("</iframe>") == 1
    assert "Motion" in page
    assert "largest voltage" in page
    assert "src=&quot;http" not in page
    loaded = fb.load(run.save(tmp_path / "saved", figures=False))
    assert "largest voltage" in loaded._repr_html_()


def test_what_is_not_recorded_is_a_key_error(run: RunView) -> None:
    with pytest.raises(KeyError) as caught:
        run["plant.y_pii"]
    assert str(caught.value).startswith("plant.y_pii is not recorded; did you mean 'plant.y_pi'")
    assert isinstance(caught.value, fb.FlexbeamsError)
    assert run.get("plant.y_pii") is None


def test_comparison_of_runs(run: RunView, scenario: str) -> None:
    other = fb.run(scenario, coupling="gauss-seidel", design={"weights": {"lqr_input": 0.02}}, backend="python")
    assert other.summary["design_id"] != run.summary["design_id"]
    comparison = fb.compare(run, other, tolerance=1e-12)
    assert not comparison.holds
    largest = comparison.differences[0]
    gap = np.abs(other[largest.signal] - run[largest.signal])
    assert largest.largest == gap.max()
    assert comparison.settings["coupling"] == ["jacobi", "gauss-seidel"]
    assert "iframe" in comparison._repr_html_()
    assert fb.compare(run, other).holds
