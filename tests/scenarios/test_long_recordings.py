"""Recordings whose rows are in a file: the same results as in memory, readable while they grow and after a kill."""

import json
import re
import shutil
import time as clock
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flexbeams as fb
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.choices import Format
from flexbeams.scenarios.definition.schema import Check, Instance, Scenario, Sensor
from flexbeams.scenarios.report.comparison import comparison_html
from flexbeams.scenarios.results import differences, long_files
from flexbeams.scenarios.results.checks import Measurement, standard_metrics
from flexbeams.scenarios.results.compare import read_folder
from flexbeams.scenarios.results.decimation import thinned
from flexbeams.scenarios.results.files import write_results
from flexbeams.scenarios.results.folder import PARTIAL
from flexbeams.scenarios.runs import execution, room
from flexbeams.scenarios.simulation import recording as recordings
from flexbeams.scenarios.simulation.rates import hold, require_rates
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.row_file import LeftRows, RowFile
from flexbeams.scenarios.simulation.sensors import measure
from tests.helpers import command

COLUMNS = ["plant.y_pi[1]", "plant.y_pi[2]", "plant.δ"]
INSTANCES = {"plant": Instance(unit="BeamPlant")}
ROWS = 1001


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Everything is long, and a block has a few rows."""
    monkeypatch.setattr(execution, "MAX_BYTES_IN_MEMORY", 0)
    monkeypatch.setattr(recordings, "BLOCK_BYTES", 9000)


@pytest.fixture
def both() -> Iterator[tuple[Recording, Recording]]:
    """One decaying oscillation in memory and in a file."""
    time = np.arange(ROWS) * 1e-2
    values = np.exp(-0.7 * time)[:, None] * np.sin(np.outer(time, [3.0, 4.1, 5.3])) + [1.0, -2.0, 0.0]
    file = RowFile(COLUMNS)
    file.append(np.column_stack([time, values])[:400])
    file.append(np.column_stack([time, values])[400:])
    table = file.mapped()
    common = {"columns": COLUMNS, "wall_seconds": 1.0}
    yield (
        Recording(time=time, values=values, **common),  # type: ignore[arg-type]
        Recording(time=table[:, 0], values=table[:, 1:], file=file, **common),  # type: ignore[arg-type]
    )
    file.close()


def test_numpy_reads_the_file_while_it_grows(tmp_path: Path) -> None:
    path, rows = tmp_path / "rows.npy", np.random.default_rng(3).standard_normal((25, 1 + len(COLUMNS)))
    file = RowFile(COLUMNS, path)
    assert len(np.load(path)) == 0
    for k in range(25):
        file.append(rows[k : k + 1])
        found = np.load(path)
        assert found.dtype.names == ("time", *COLUMNS)
        np.testing.assert_array_equal(found["plant.δ"], rows[: k + 1, 3])
    np.testing.assert_array_equal(file.read(7, 19), rows[7:19])
    np.testing.assert_array_equal(file.mapped(), rows)
    file.close()
    assert not path.exists()


def test_rows_of_a_killed_run_are_read_where_they_are(tmp_path: Path) -> None:
    """The next run in their folder leaves them to who reads them."""
    path, rows = tmp_path / "rows.npy", np.column_stack([np.cumsum([1, 0.5, 0.25, 2]), np.ones((4, len(COLUMNS)))])
    RowFile(COLUMNS, path).append(rows)
    left = LeftRows(path)
    assert left.columns == COLUMNS
    assert left.least_interval == 0.25
    table = left.mapped()
    with pytest.raises(InputError, match="cannot be written"):
        left.append(rows)
    after = RowFile(COLUMNS, path)
    after.append(2 * rows)
    np.testing.assert_array_equal(table, rows)
    np.testing.assert_array_equal(left.read(1, 3), rows[1:3])
    left.close()
    after.close()


def test_rows_of_many_signals_are_read(tmp_path: Path) -> None:
    """NumPy itself refuses heads above 10,000 bytes; an archive of arrays is no file of rows."""
    columns, path = [f"plant.signal[{k}]" for k in range(1, 501)], tmp_path / "rows.npy"
    rows = np.random.default_rng(5).standard_normal((3, 1 + len(columns)))
    RowFile(columns, path).append(rows)
    left = LeftRows(path)
    assert left.columns == columns
    np.testing.assert_array_equal(left.read(0, 3), rows)
    np.testing.assert_array_equal(np.load(path, max_header_size=2**20)["plant.signal[500]"], rows[:, 500])
    left.close()
    with path.open("wb") as file:
        np.savez(file, time=rows)
    with pytest.raises(ValueError, match=r"^$"):
        LeftRows(path)


@pytest.mark.parametrize("written", [64, 200, 1000])
def test_rows_that_are_cut_off_are_not_counted(tmp_path: Path, written: int) -> None:
    """A process that is killed in the middle of writing a block leaves the rows before it."""
    path = tmp_path / "rows.npy"
    file = RowFile(COLUMNS, path)
    file.append(np.ones((5, 4)))
    with path.open("ab") as late:
        late.write(b"x" * written)
    np.testing.assert_array_equal(np.load(path)["time"], np.ones(5))
    file.close()


@pytest.mark.parametrize("block", [40, 1700, 2**20])
@pytest.mark.parametrize(
    "check",
    [
        {"measure": "largest", "reference": "start"},
        {"measure": "largest", "before": 3.0},
        {"measure": "end_deviation", "reference": [1.0, -2.0]},
        {"measure": "largest_change"},
        {"measure": "overshoot", "reference": [1.0, -2.0]},
        {"measure": "overshoot_percent", "reference": "end"},
        {"measure": "settling_time", "reference": "end", "share": 0.02},
        {"measure": "motion_settling_time", "reference": "end", "share": 0.02},
        {"measure": "open_loop_peak"},
        {"measure": "decay_time", "share": 0.1},
    ],
    ids=lambda check: "-".join(map(str, check.values())),
)
def test_checks_are_the_same_in_parts(
    both: tuple[Recording, Recording], check: dict[str, object], block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recordings, "BLOCK_BYTES", block)
    whole = Check(name="c", of="plant.y_pi", **{"after": 0.5, **check})  # type: ignore[arg-type]
    scenario = Scenario(title="", structure="kiel", stop_time=10.0, instance=INSTANCES, check=[whole])
    memory, file = (Measurement(scenario, "", r, r).outcomes()[0].value for r in both)
    assert memory == file
    assert memory > 0


def test_metrics_are_the_same_in_parts(both: tuple[Recording, Recording], small_blocks: None) -> None:
    memory, file = map(standard_metrics, both)
    assert memory == file


def test_a_thinned_recording_keeps_every_peak(
    both: tuple[Recording, Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    memory, file = both
    assert thinned(memory) is memory
    monkeypatch.setattr("flexbeams.scenarios.results.decimation._THINNED_BYTES", 2**14)
    kept = thinned(file)
    assert len(kept.time) < ROWS / 2
    rows = np.searchsorted(memory.time, kept.time)
    np.testing.assert_array_equal(kept.values, memory.values[rows])
    for k in range(3):
        assert {np.argmin(memory.values[:, k]), np.argmax(memory.values[:, k]), 0, ROWS - 1} <= set(rows.tolist())
    window = thinned(file, 2.0, 2.3)
    np.testing.assert_array_equal(window.values, memory.values[200:231])


def test_sensors_measure_block_after_block(both: tuple[Recording, Recording], small_blocks: None) -> None:
    sensors = [Sensor(of="plant.y_pi", delay=0.25, noise=0.01, resolution=0.005, seed=4)]
    for recording in both:
        measure(recording, sensors, 1e-2)
    memory, file = both
    np.testing.assert_array_equal(file.values, memory.values)


@pytest.mark.parametrize("every", [1, 3, 100, 5000])
def test_signals_have_rates_of_their_own(both: tuple[Recording, Recording], small_blocks: None, every: int) -> None:
    true = both[0].values.copy()
    for recording in both:
        hold(recording, {"plant.y_pi[2]": every, "plant.δ": 10})
        np.testing.assert_array_equal(recording.values[:, 0], true[:, 0])
        for column, steps in ((1, every), (2, 10)):
            rows = np.arange(ROWS) // steps * steps
            rows[-1] = ROWS - 1
            np.testing.assert_array_equal(recording.values[:, column], true[rows, column])


@pytest.mark.parametrize(
    ("rates", "decimate", "message"),
    [
        ({"plant.y_p": 10}, 1, "--record-every names a signal that is not recorded; did you mean 'plant.y_pi'"),
        (
            {"plant.y_pi": 7},
            2,
            "--record-every of plant.y_pi must be a multiple of 2, the steps from row to row, got 7",
        ),
        ({"plant.y_pi": 0}, 1, "--record-every of plant.y_pi must be a multiple of 1"),
    ],
)
def test_rates_without_rows_are_refused(rates: dict[str, int], decimate: int, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        require_rates(rates, COLUMNS, decimate)


@pytest.mark.native
@pytest.mark.parametrize(
    "options", [(), ("--decimate", "7", "--record-every", "plant.y_pm=70"), ("--decimate", "100000")]
)
def test_a_run_gives_the_same_files(
    options: tuple[str, ...], tmp_path: Path, small_blocks: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pyarrow")
    run = ["run", "tracking", "--stop-time", "0.3", "--format", "csv,parquet", *options, "--out"]
    status = main([*run, str(tmp_path / "file")])
    monkeypatch.setattr(execution, "MAX_BYTES_IN_MEMORY", 2**30)
    assert main([*run, str(tmp_path / "memory")]) == status
    names = sorted(path.name for path in (tmp_path / "memory").iterdir())
    assert sorted(path.name for path in (tmp_path / "file").iterdir()) == names
    for name in names:
        one, other = (tmp_path / folder / name for folder in ("file", "memory"))
        if name.endswith(("csv", "svg")):
            assert one.read_bytes() == other.read_bytes()
    import pyarrow.parquet

    tables = [pyarrow.parquet.read_table(tmp_path / folder / "results.parquet") for folder in ("file", "memory")]
    assert tables[0].equals(tables[1])


LONG = """title = "hours"
structure = "single_beam"
stop_time = 3600.0
[instance.plant]
unit = "BeamPlant"
"""


@pytest.mark.native
@pytest.mark.slow
def test_a_killed_run_leaves_its_rows(tmp_path: Path, write_scenario: Callable[[str, str], Path]) -> None:
    """The rows until the kill can be read by NumPy, and the next run replaces them."""
    path, out = write_scenario("hours", LONG), tmp_path / "out"
    short = ["run", str(path), "--out", str(out), "--stop-time", "0.01", "--no-report", "--no-figures"]
    assert main(short) == 0
    process = command("run", path, "--out", out, cwd=tmp_path)
    rows = out / PARTIAL
    deadline = clock.monotonic() + 60
    while clock.monotonic() < deadline and (not rows.exists() or rows.stat().st_size < 2**25):
        clock.sleep(0.02)
    process.kill()
    process.communicate()
    table = np.load(rows)
    assert len(table) > 10_000
    assert np.all(np.diff(table["time"]) > 0)
    assert json.loads((out / "summary.json").read_text())["unfinished"]
    killed = fb.load(out)
    assert repr(killed).endswith("s, incomplete")
    assert (dict(killed.checks), killed.metrics, killed.passed) == ({}, {}, False)
    again = fb.load(killed.save(tmp_path / "again"))
    np.testing.assert_array_equal(again["plant.y_pi"], killed["plant.y_pi"])
    left = read_folder(out, "killed").recording
    np.testing.assert_array_equal(left.time, table["time"])
    np.testing.assert_array_equal(left.values[:, left.columns.index("plant.y_pi[1]")], table["plant.y_pi[1]"])
    assert main(short) == 0
    assert not rows.exists()
    assert json.loads((out / "summary.json").read_text())["complete"]


@pytest.fixture
def folders(both: tuple[Recording, Recording], tmp_path: Path) -> list[Path]:
    """Two runs in each format; the second has other values, at other times as well."""
    memory, _ = both
    other = Recording(
        time=np.concatenate([memory.time[:500], memory.time[500:900:2] + 3e-3]),
        columns=COLUMNS,
        values=np.concatenate([memory.values[:500], memory.values[500:900:2]]) * 1.01,
        wall_seconds=1.0,
    )
    summary = dict.fromkeys(("scenario", "title", "coupling", "backend", "design_id"), "")
    more = {"checks": [], "metrics": {}, "timing": {}, "complete": True}
    names = []
    for name, recording in (("one", memory), ("two", other)):
        names.append(tmp_path / name)
        write_results(names[-1], recording, {**summary, **more})
    return names


@pytest.mark.parametrize("block", [300, 4000, 2**24])
def test_long_runs_are_compared_in_blocks(
    folders: list[Path], tmp_path: Path, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = fb.compare(*folders, tolerance=0.1)
    expected = {d.signal: d for d in whole.differences}
    page = comparison_html(whole, "a page")
    monkeypatch.setattr(long_files, "LARGE", 0)
    for module in (recordings, differences):
        monkeypatch.setattr(module, "BLOCK_BYTES", block)
    parts = fb.compare(*folders, tolerance=0.1)
    assert all(run.recording.file is not None for run in parts.runs)
    assert parts.spans == whole.spans
    for found in parts.differences:
        one = expected[found.signal]
        assert found.rms == pytest.approx(one.rms, rel=1e-12)
        assert replace(found, rms=one.rms) == one
    assert min(d.interpolated for d in parts.differences) > 0
    assert comparison_html(parts, "a page") == page


@pytest.mark.parametrize("kind", ["csv", "parquet", "mf4"])
def test_long_files_are_read_as_short_ones(
    both: tuple[Recording, Recording], tmp_path: Path, kind: Format, monkeypatch: pytest.MonkeyPatch
) -> None:
    require(kind)
    memory, _ = both
    write_results(tmp_path, memory, {}, [kind])
    assert long_files.read_long(tmp_path / f"results.{kind}") is None
    monkeypatch.setattr(long_files, "LARGE", 0)
    found = long_files.read_long(tmp_path / f"results.{kind}")
    assert found is not None
    assert found.columns == COLUMNS
    np.testing.assert_array_equal(found.time, memory.time)
    np.testing.assert_array_equal(found.values, memory.values)
    (tmp_path / f"results.{kind}").write_bytes(b"time,a\n1,2\nx" * 3)
    with pytest.raises(InputError, match="is not a readable file of results"):
        long_files.read_long(tmp_path / f"results.{kind}")


def test_csv_is_read_without_pyarrow(
    both: tuple[Recording, Recording], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    memory, _ = both
    memory.units, memory.units_row = dict.fromkeys(COLUMNS, "m"), True
    write_results(tmp_path, memory, {})
    monkeypatch.setattr(long_files, "LARGE", 0)
    monkeypatch.setattr(long_files, "_ROWS", 100)
    monkeypatch.setattr(long_files, "find_spec", lambda name: None)
    found = long_files.read_long(tmp_path / "results.csv")
    assert found is not None
    np.testing.assert_array_equal(found.values, memory.values)


def require(kind: Format) -> None:
    if package := {"parquet": "pyarrow", "mf4": "asammdf"}.get(kind):
        pytest.importorskip(package)


def test_a_file_of_rows_that_no_run_wrote_is_refused(
    tmp_path: Path, write_scenario: Callable[[str, str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / PARTIAL).write_text("mine")
    assert main(["run", str(write_scenario("hours", LONG)), "--out", str(out)]) == 2
    assert f"{PARTIAL}: is in the way" in capsys.readouterr().err
    assert (out / PARTIAL).read_text() == "mine"


@pytest.mark.parametrize(
    ("formats", "free", "refused"),
    [
        ("csv", 3.7, None),
        ("csv", 3.5, "must leave a recording that fits on the disk"),
        ("parquet", 2.3, None),
        ("csv,parquet", 4.7, "must leave a recording that fits on the disk"),
        ("mat", 9.0, "must leave at most 1.1 GB of recorded values for a MAT file"),
    ],
)
def test_room_counts_what_the_formats_take(
    formats: str, free: float, refused: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    from flexbeams.scenarios.definition.settings import Settings

    usage = shutil.disk_usage(".")
    steps = 2**27
    size = room.recorded_bytes(1, steps, 1)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=int(free * size)))
    scenario = Scenario(title="", structure="kiel", stop_time=1.0, instance=INSTANCES)
    settings = Settings(formats=tuple(formats.split(",")), results_folder=Path("results/x"))  # type: ignore[arg-type]
    if refused is None:
        room.require_room(scenario, 1, steps, settings, "s.toml")
        return
    with pytest.raises(InputError, match=f"s.toml: stop_time {refused}"):
        room.require_room(scenario, 1, steps, settings, "s.toml")
