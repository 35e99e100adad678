"""Results in each format, read back by the readers of others; and recordings of every N-th step."""

import json
import subprocess
import sys
from collections.abc import Callable
from decimal import Decimal
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat

from flexbeams.fmus.packaging.python import build_python_units
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.results import formats
from flexbeams.scenarios.results.files import read_results, write_results
from flexbeams.scenarios.results.formats import matlab_names, require_formats, write_mat, write_mf4, write_parquet
from flexbeams.scenarios.simulation.recording import Recording, step_times
from tests.units.lag_interface import lag_unit

COLUMNS = [
    "plant.y_pi[1]",
    "plant.y_pi[2]",
    "plant.energy",
    "plant.w[1,2]",
    "plant.w[3,2]",
    "plant.beam[2].tip_mass",
    "_unit.end",
    "_unit.x'",
    "time.u[1]",
]
SUMMARY = {"scenario": "tracking", "title": "a title", "complete": True, "decimate": 3, "metrics": {"a": None}}


@pytest.fixture
def recording() -> Recording:
    values = np.random.default_rng(1).standard_normal((7, len(COLUMNS)))
    return Recording(time=np.arange(7) * 2e-4, columns=COLUMNS, values=values, wall_seconds=0.1)


def written(write: Callable[..., None], path: Path, recording: Recording, summary: dict[str, Any]) -> None:
    with path.open("wb") as file:
        write(file, recording, summary)


def test_parquet_holds_the_columns_of_the_csv(tmp_path: Path, recording: Recording) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    written(write_parquet, tmp_path / "results.parquet", recording, SUMMARY)
    table = parquet.read_table(tmp_path / "results.parquet")
    assert table.column_names == ["time", *COLUMNS]
    np.testing.assert_array_equal(
        np.stack([c.to_numpy() for c in table.columns], axis=1), np.column_stack([recording.time, recording.values])
    )
    assert json.loads(table.schema.metadata[b"flexbeams"]) == SUMMARY


def test_mat_holds_a_struct_for_each_instance(tmp_path: Path, recording: Recording) -> None:
    written(write_mat, tmp_path / "results.mat", recording, SUMMARY)
    file = loadmat(tmp_path / "results.mat", simplify_cells=False)
    np.testing.assert_array_equal(file["time"], recording.time[:, None])
    plant = file["plant"][0, 0]
    assert plant.dtype.names == ("y_pi", "energy", "w", "beam_tip_mass")
    np.testing.assert_array_equal(plant["y_pi"], recording.values[:, :2])
    np.testing.assert_array_equal(plant["energy"], recording.values[:, 2:3])
    np.testing.assert_array_equal(plant["w"], recording.values[:, 3:5])
    names = file["columns"][0, 0]["plant"][0, 0]["w"]
    assert [str(cell[0]) for cell in names.ravel()] == ["plant.w[1,2]", "plant.w[3,2]"]
    # Names that MATLAB refuses, and one that is taken by the time
    assert file["x_unit"][0, 0].dtype.names == ("end_2", "x_")
    np.testing.assert_array_equal(file["time_2"][0, 0]["u"], recording.values[:, 8:])
    run = file["run"][0, 0]
    assert (str(run["title"][0]), int(run["decimate"][0, 0]), bool(run["complete"][0, 0])) == ("a title", 3, True)


def test_mat_files_of_one_recording_are_equal(
    tmp_path: Path, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(write_mat, tmp_path / "a.mat", recording, SUMMARY)
    monkeypatch.setattr("time.asctime", lambda *_: "another day")
    written(write_mat, tmp_path / "b.mat", recording, SUMMARY)
    assert (tmp_path / "a.mat").read_bytes() == (tmp_path / "b.mat").read_bytes()


def test_matlab_names_are_valid_and_different() -> None:
    names = ["y_pi", "a.b", "a_b", "a b", "while", "1st", "größe", "n" * 80, "n" * 90, "", "run"]
    chosen = matlab_names(names, taken=["run"])
    assert list(chosen) == names
    assert len(set(chosen.values())) == len(names)
    for name in chosen.values():
        assert name.isascii()
        assert name.isidentifier()
        assert name[0].isalpha()
        assert len(name) <= 63
        assert name not in ("while", "run")
    assert chosen["y_pi"] == "y_pi"


def test_arrays_beyond_a_mat_file_are_refused(
    tmp_path: Path, recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(formats, "_MAX_ARRAY_BYTES", 2 * 7 * 8 - 1)
    with pytest.raises(InputError, match=r"results.mat: must have arrays of less than 2 GiB .*--decimate"):
        write_results(tmp_path, recording, SUMMARY, ["mat"])
    assert [p.name for p in tmp_path.iterdir()] == ["summary.json"]
    assert json.loads((tmp_path / "summary.json").read_text())["unfinished"]


def test_a_missing_package_is_named(
    monkeypatch: pytest.MonkeyPatch, at_run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(formats, "find_spec", lambda name: None)
    require_formats(["csv", "mat"])
    assert main(["run", "step_response", "--format", "parquet"]) == 2
    assert capsys.readouterr().err == (
        "flexbeams: --format parquet needs the package pyarrow (pip install 'flexbeams[formats]')\n"
    )


def test_results_of_other_formats_go(tmp_path: Path, recording: Recording) -> None:
    """A folder holds one run: what an earlier one left in a format that this one does not write would belie it."""
    write_results(tmp_path, recording, SUMMARY, ["csv", "mat"])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results.csv", "results.mat", "summary.json"]
    write_results(tmp_path, recording, SUMMARY)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results.csv", "summary.json"]
    np.testing.assert_array_equal(read_results(tmp_path / "results.csv").values, recording.values)


PLANT = """title = "noise"
structure = "single_beam"
stop_time = 0.2
[instance.plant]
unit = "BeamPlant"
[[input]]
to = "plant.u"
pseudo_random = { amplitude = 100.0, hold = 1e-3, kind = "levels" }
[[check]]
name = "largest"
measure = "largest"
of = "plant.u"
max = 100.0
"""


def run(path: Path, out: Path, *options: str) -> int:
    return main(["run", str(path), "--out", str(out), "--no-figures", "--no-report", *options])


@pytest.mark.native
def test_the_command_writes_the_formats_asked_for(
    at_run_folder: Path, tmp_path: Path, write_scenario: Callable[[str, str], Path]
) -> None:
    pytest.importorskip("pyarrow")
    path = write_scenario("noise", PLANT)
    assert run(path, tmp_path / "a", "--format", "mat,parquet", "--format", "csv") == 0
    assert {p.suffix for p in (tmp_path / "a").iterdir()} == {".csv", ".json", ".mat", ".parquet"}
    assert run(path, tmp_path / "b") == 0
    assert {p.suffix for p in (tmp_path / "b").iterdir()} == {".csv", ".json"}
    assert (tmp_path / "a/results.csv").read_bytes() == (tmp_path / "b/results.csv").read_bytes()
    assert main(["run", str(path), "--format", "xlsx"]) == 2


@pytest.mark.parametrize("every", [1, 7, 500, 1000, 4000])
def test_decimated_rows_are_those_of_the_whole_run(
    at_run_folder: Path, tmp_path: Path, every: int, write_scenario: Callable[[str, str], Path]
) -> None:
    path = write_scenario("noise", PLANT)
    run(path, tmp_path / "whole")
    assert run(path, tmp_path / "few", "--decimate", str(every)) == 0
    whole, few = (read_results(tmp_path / name / "results.csv") for name in ("whole", "few"))
    kept = [*range(0, 1000, every), 1000]
    np.testing.assert_array_equal(few.time, whole.time[kept])
    np.testing.assert_array_equal(few.values, whole.values[kept])
    summary = json.loads((tmp_path / "few/summary.json").read_text())
    assert (summary["decimate"], summary["timing"]["steps"]) == (every, 1000)
    assert summary["checks"][0]["value"] == np.max(np.abs(few.values[:, whole.columns.index("plant.u[1]")]))


@pytest.fixture(scope="module")
def lag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A unit that refuses u[3] > 1e6."""
    return build_python_units([lag_unit(tmp_path_factory.mktemp("lag") / "lag.fmu")])[0]


LAG = """title = "a unit that fails"
structure = "single_beam"
step = 1e-3
stop_time = 0.2
record = ["lag.u"]
[instance.lag]
fmu = "{fmu}"
[[input]]
to = "lag.u"
table = {{ file = "u.csv" }}
"""


@pytest.mark.parametrize("every", [1, 50, 124, 1000])
def test_a_failed_run_keeps_its_last_row(
    at_run_folder: Path, tmp_path: Path, lag: Path, every: int, write_scenario: Callable[[str, str], Path]
) -> None:
    """The step that fails may lie between two rows; what the unit had before it is the last row all the same."""
    (tmp_path / "u.csv").write_text("time,u1,u2,u3\n0,1,2,3\n0.1234,4,5,2e6\n")
    path = write_scenario("failing", LAG.format(fmu=lag.as_posix()))
    assert run(path, tmp_path / "out", "--decimate", str(every)) == 2
    left = read_results(tmp_path / "out/results.csv")
    steps = [*range(0, 124, every), 124]
    np.testing.assert_array_equal(left.time, np.array(steps) / 1000)
    np.testing.assert_array_equal(left.values[:, left.columns.index("lag.ticks")], 2 * np.array(steps))
    np.testing.assert_array_equal(left.values[:, left.columns.index("lag.u[3]")], [3.0] * (len(steps) - 1) + [2e6])
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert (summary["complete"], summary["timing"]["steps"]) == (False, 124)
    assert "u[3] must be <= 1e6" in summary["error"]


def test_formats_are_imported_where_they_are_used() -> None:
    code = (
        "import sys, flexbeams.scenarios.results.files; print([m for m in ('pyarrow', 'scipy.io') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


SIGNALS = {name: {"unit": "m", "description": f"what {name} is"} for name in COLUMNS}


def test_parquet_and_mat_have_units_and_descriptions(tmp_path: Path, recording: Recording) -> None:
    summary = {**SUMMARY, "signals": SIGNALS}
    written(write_mat, tmp_path / "a.mat", recording, summary)
    file = loadmat(tmp_path / "a.mat", simplify_cells=True)
    assert list(file["units"]["plant"]["w"]) == ["m", "m"]
    assert list(file["descriptions"]["plant"]["w"]) == ["what plant.w[1,2] is", "what plant.w[3,2] is"]
    parquet = pytest.importorskip("pyarrow.parquet")
    written(write_parquet, tmp_path / "a.parquet", recording, summary)
    schema = parquet.read_schema(tmp_path / "a.parquet")
    assert schema.field("time").metadata[b"unit"] == b"s"
    for name in COLUMNS:
        assert schema.field(name).metadata == {b"unit": b"m", b"description": f"what {name} is".encode()}


@pytest.mark.skipif(find_spec("asammdf") is None, reason="needs the extra mf4")
def test_mf4_has_a_channel_with_unit_for_each_column(tmp_path: Path, recording: Recording) -> None:
    from asammdf import MDF

    written(write_mf4, tmp_path / "a.mf4", recording, {**SUMMARY, "signals": SIGNALS})
    with MDF(tmp_path / "a.mf4") as file:
        for k, name in enumerate(COLUMNS):
            channel = file.get(name)
            np.testing.assert_array_equal(channel.samples, recording.values[:, k])
            np.testing.assert_array_equal(channel.timestamps, recording.time)
            assert channel.unit == "m"
            assert f"what {name} is" in channel.comment


@pytest.mark.parametrize("step", [2e-4, 1e-3, 0.1, 7e-5, 0.25, 1.0, 3.0, 1 / 3])
def test_times_are_decimal(step: float) -> None:
    """The shortest decimal of each, for steps that are decimals themselves."""
    numbers = np.arange(30001)
    times = step_times(numbers, step)
    np.testing.assert_allclose(times, numbers * step, rtol=1e-15)
    if step != 1 / 3:
        assert times.tolist() == [float(Decimal(repr(step)) * k) for k in numbers.tolist()]


@pytest.mark.native
def test_a_run_says_everything_as_json(at_run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["run", "single_beam", "--stop-time", "0.01", "--no-report", "--no-figures", "--json"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    [run] = json.loads(capsys.readouterr().out)
    assert (run["scenario"], run["status"], run["folder"]) == ("single_beam", 0, str(tmp_path))
    assert run["summary"] == json.loads((tmp_path / "summary.json").read_text())
    signals = run["summary"]["signals"]
    assert signals["plant.y_pi[1]"]["unit"] == "m"
    assert signals["plant.u[1]"]["unit"] == "V"
    assert all(entry["description"] for entry in signals.values())
    assert list(signals) == read_results(tmp_path / "results.csv").columns
    lines = (tmp_path / "results.csv").read_text().splitlines()
    assert [line.partition(",")[0] for line in lines[1:5]] == ["0.0", "0.0002", "0.0004", "0.0006"]
