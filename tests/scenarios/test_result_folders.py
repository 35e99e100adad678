"""Folders of results: nothing of the user's is touched, other settings go beside, one run writes at a time."""

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.variants import changed_settings, variant_suffix
from flexbeams.scenarios.results.folder import ResultFolder
from flexbeams.scenarios.runs.package import ExtractedPackage

Write = Callable[[str, str], Path]
RUN = ["run", "single_beam", "--stop-time", "0.01", "--no-figures"]


def digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def earlier_run(folder: Path, **files: str) -> None:
    """A folder as a run leaves it, with files of these contents."""
    with ResultFolder(folder) as results:
        results.begin({"scenario": "s", "settings": {}})
        for name, content in files.items():
            results.write(folder / name.replace("_", "."), content.encode())
        results.finish({"scenario": "s", "settings": {}})


@pytest.mark.parametrize("name", ["results.csv", "results.mat", "report.html", "figure.png", "summary.json"])
def test_a_file_that_no_run_wrote_is_refused_by_name(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("mine")
    with ResultFolder(tmp_path) as results, pytest.raises(InputError, match=f"{name}: is in the way"):
        results.require_free(["results.csv", "results.mat", "report.html", "figure.png", "summary.json"])
    assert (tmp_path / name).read_text() == "mine"


@pytest.mark.parametrize(
    "summary",
    [
        "[]",
        "{}",
        "not JSON",
        '{"flexbeams": "1"}',
        '{"flexbeams": "1", "files": []}',
        '{"flexbeams":1,"files":{"a":1}}',
    ],
)
def test_a_summary_of_another_program_is_refused(summary: str, tmp_path: Path) -> None:
    (tmp_path / "summary.json").write_text(summary)
    with ResultFolder(tmp_path) as results, pytest.raises(InputError, match=r"summary\.json: is in the way"):
        results.require_free([])


def test_only_files_of_the_earlier_run_are_replaced_or_removed(tmp_path: Path) -> None:
    earlier_run(tmp_path, results_csv="1", report_html="old")
    (tmp_path / "results.mat").write_text("mine, and not in the way of a CSV file")
    with ResultFolder(tmp_path) as results:
        results.require_free(["results.csv"])
        results.begin({})
        results.write(tmp_path / "results.csv", b"2")
        results.finish({})
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results.csv", "results.mat", "summary.json"]
    assert json.loads((tmp_path / "summary.json").read_text())["files"] == {"results.csv": digest("2")}


@pytest.mark.parametrize("change", [None, "edited", "old"])
def test_a_figure_is_kept_as_it_is_now(change: str | None, tmp_path: Path) -> None:
    """Not where it was removed or edited while the run computed."""
    earlier_run(tmp_path, report_html="old")
    path = tmp_path / "report.html"
    with ResultFolder(tmp_path) as results:
        results.require_free([])
        results.begin({})
        path.unlink()
        if change is not None:
            path.write_text(change)
        assert results.keep([path.name]) == (change == "old")


@pytest.mark.parametrize("name", ["results.csv", "report.html"])
def test_a_file_that_was_edited_since_is_kept(name: str, tmp_path: Path) -> None:
    earlier_run(tmp_path, results_csv="1", report_html="old")
    (tmp_path / name).write_text("edited")
    with ResultFolder(tmp_path) as results, pytest.raises(InputError, match=f"{name}: .* was changed after a run"):
        results.require_free(["results.csv"])


def test_names_in_a_summary_do_not_lead_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    folder = tmp_path / "results"
    earlier_run(folder)
    summary = json.loads((folder / "summary.json").read_text())
    for name in ("../mine.txt", str(tmp_path / "mine.txt")):
        summary["files"][name] = digest("mine")
    (folder / "summary.json").write_text(json.dumps(summary))
    with ResultFolder(folder) as results:
        results.require_free([])
        results.begin({})
        results.finish({})
    assert (tmp_path / "mine.txt").read_text() == "mine"


@pytest.mark.parametrize("after", range(5))
def test_a_run_that_was_killed_leaves_files_that_the_next_one_knows(after: int, tmp_path: Path) -> None:
    """Killed after each of its writes in turn, with an earlier run's files half replaced; and a second time."""
    names = ["results.csv", "report.html"]
    earlier_run(tmp_path, results_csv="1", report_html="old")
    for content in ("2", "3"):
        results = ResultFolder(tmp_path)
        results.require_free(names)
        writes = [
            lambda results=results: results.begin({}),
            *(lambda results=results, n=n, c=content: results.write(tmp_path / n, c.encode()) for n in names),
            lambda results=results: results.finish({}),
        ]
        for write in writes[:after]:
            write()
        results.__exit__(None, None, None)
    with ResultFolder(tmp_path) as results:
        results.require_free(names)


def test_one_run_at_a_time(tmp_path: Path, capsys: pytest.CaptureFixture[str], at_run_folder: Path) -> None:
    with ResultFolder(tmp_path):
        with pytest.raises(InputError, match="is in use by another run"):
            ResultFolder(tmp_path)
        assert main([*RUN, "--no-report", "--out", str(tmp_path)]) == 2
    assert capsys.readouterr().err == f"flexbeams: {tmp_path}: is in use by another run; wait for it, or use --out\n"
    with ResultFolder(tmp_path):
        pass


@pytest.mark.parametrize(
    ("options", "suffix"),
    [
        ({}, ""),
        ({"coupling": "jacobi", "structure": "kiel", "stop_time": 6.0}, ""),  # the scenario's own
        ({"coupling": "gauss-seidel"}, "-gauss-seidel"),
        ({"basis": "segment", "backend": "python"}, "-segment-python"),
        ({"structure": "rigs/my rig.toml"}, "-myrig"),
        ({"stop_time": 2.0, "step": 1e-3, "decimate": 10}, "-stop_time=2-step=0.001-decimate=10"),
        (
            {"overrides": {"plant.beam[1].tip_mass": 0.03, "plant.u": [1.0, 0]}},
            "-plant.beam1.tip_mass=0.03-plant.u=1,0",
        ),
        ({"overrides": {"controller.feedback": False}}, "-controller.feedback=false"),
        ({"overrides": {"../../x": 1.0}}, "-....x=1"),
    ],
)
def test_settings_other_than_the_scenarios_name_the_folder(options: dict[str, Any], suffix: str) -> None:
    changed = changed_settings(Settings(**options), load_scenario("tracking").scenario)
    assert variant_suffix(changed) == suffix


def test_long_suffixes_stay_different() -> None:
    suffixes = {variant_suffix({"set": {f"plant.beam[{k}].tip_mass": v for k in range(9)}}) for v in (0.1, 0.2)}
    assert len(suffixes) == 2
    assert all(len(suffix) == 80 for suffix in suffixes)


@pytest.mark.native
def test_a_run_with_other_settings_goes_beside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = [*RUN, "--no-report"]
    assert main(arguments) == 0
    assert main([*arguments, "--coupling", "gauss-seidel"]) == 0
    assert {p.name for p in (tmp_path / "results").iterdir()} == {
        "single_beam-stop_time=0.01",
        "single_beam-gauss-seidel-stop_time=0.01",
    }
    assert main([*arguments, "--out", "here"]) == 0
    capsys.readouterr()
    assert main([*arguments, "--coupling", "gauss-seidel", "--out", "here"]) == 0
    assert "here: replaces a run of single_beam with stop_time 0.01\n" in capsys.readouterr().err
    summary = json.loads((tmp_path / "here/summary.json").read_text())
    assert summary["settings"] == {"coupling": "gauss-seidel", "stop_time": 0.01}
    assert (summary["schema_version"], summary["structure"], summary["stop_time"]) == (1, "single_beam", 0.01)
    content = (tmp_path / "here/results.csv").read_bytes()
    assert summary["files"] == {"results.csv": hashlib.sha256(content).hexdigest()}
    (tmp_path / "here/report.html").write_text("mine")
    assert main([*RUN, "--out", "here"]) == 2
    assert "here/report.html: is in the way and was not written by flexbeams" in capsys.readouterr().err
    assert (tmp_path / "here/results.csv").read_bytes() == content
    # A folder of the default name that holds another run
    (tmp_path / "here/report.html").unlink()
    (tmp_path / "here").rename(tmp_path / "results/single_beam-stop_time=0.01-decimate=5")
    assert main([*arguments, "--decimate", "5"]) == 2
    assert "holds a run of single_beam with coupling gauss-seidel" in capsys.readouterr().err


def test_a_package_goes_beside_the_scenario_of_its_name() -> None:
    scenario = load_scenario("tracking")
    package = ExtractedPackage(file=Path("tracking.ssp"), package=None, descriptions={}, budget=None)  # type: ignore[arg-type]
    assert package.name == scenario.name
    assert (scenario.folder_name, package.folder_name) == ("tracking", "tracking-ssp")


@pytest.mark.native
def test_a_package_and_a_scenario_of_one_name_are_told_apart(
    tmp_path: Path, at_run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "out"), "--no-report", "--no-figures"]
    package = tmp_path / "single_beam.ssp"
    assert main(["export", "single_beam", "--stop-time", "0.01", "-o", str(package)]) == 0
    assert main(["run", str(package), *out]) == 0
    capsys.readouterr()
    assert main(["run", str(package), *out]) == 0
    assert "replaces" not in capsys.readouterr().err
    assert main(["run", "single_beam", *out, "--set", "plant.beam[1].density=-1"]) == 2
    assert "replaces" not in capsys.readouterr().err
    assert main(["run", "single_beam", *out]) == 0
    note = f"{tmp_path}/out: replaces a run of the package single_beam with its own settings\n"
    assert note in capsys.readouterr().err
    assert main(["run", str(package), *out]) == 0
    assert "replaces a run of the scenario single_beam with its own settings\n" in capsys.readouterr().err
    assert json.loads((tmp_path / "out/summary.json").read_text())["kind"] == "package"


@pytest.mark.native
@pytest.mark.usefixtures("at_run_folder")
def test_a_figure_is_drawn_again_where_its_curves_or_files_changed(tmp_path: Path) -> None:
    """The files of the earlier run stay where they are all there and would be the same."""
    out = tmp_path / "out"

    def drawn(stop_time: str) -> dict[str, tuple[bytes, int]]:
        assert main(["run", "single_beam", "--stop-time", stop_time, "--no-report", "--out", str(out)]) in (0, 1)
        files = sorted(p for p in out.iterdir() if p.suffix in (".png", ".svg"))
        listed = json.loads((out / "summary.json").read_bytes())["files"]
        assert {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in files}.items() <= listed.items()
        return {p.suffix: (p.read_bytes(), p.stat().st_mtime_ns) for p in files}

    first = drawn("0.52")
    assert drawn("0.52") == first
    next(out.glob("*.png")).unlink()
    again = drawn("0.52")
    assert {kind: content for kind, (content, _) in again.items()} == {kind: c for kind, (c, _) in first.items()}
    assert all(again[kind][1] > first[kind][1] for kind in first)
    longer = drawn("0.54")
    assert all(longer[kind][0] != first[kind][0] for kind in first)
