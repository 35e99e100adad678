"""`flexbeams compare` beside files of other tools: names, units, time grids, differences, verdict."""

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.results.compare import compare
from flexbeams.scenarios.results.differences import run_differences, setting_differences, signal_differences
from flexbeams.scenarios.results.files import read_results, write_results
from flexbeams.scenarios.results.reading import read_recording
from flexbeams.scenarios.simulation.recording import Recording

TIME = np.arange(101) * 1e-2
COLUMNS = ["plant.y_pi[1]", "plant.y_pi[2]", "plant.u[1]"]
VALUES = np.stack([1e-3 * np.sin(3 * TIME), 2e-3 * np.cos(2 * TIME), 100 * TIME], axis=1)
SUMMARY = {
    "scenario": "s",
    "title": "t",
    "structure": "kiel",
    "checks": [],
    "metrics": {},
    "timing": {"wall_s": 1.0},
    "coupling": "jacobi",
    "backend": "native",
    "design_id": "x",
    "complete": True,
    "set": {},
    "settings": {},
}


def run_folder_of(path: Path, columns: list[str] = COLUMNS, scale: float = 1.0, **changes: object) -> Path:
    values = scale * VALUES[:, : len(columns)]
    recording = Recording(time=TIME, columns=columns, values=values, wall_seconds=1.0)
    write_results(path, recording, {**SUMMARY, **changes})
    return path


def csv_file(path: Path, header: str, *columns: np.ndarray, separator: str = ",") -> Path:
    rows = [separator.join(repr(float(v)) for v in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_a_coarser_file_in_other_names_and_units(tmp_path: Path) -> None:
    """Every fifth row; millimetres and milliseconds; exact where times agree but for rounding."""
    run = run_folder_of(tmp_path / "run")
    time = TIME[::5] * 1e3 * (1 + 1e-15)
    file = csv_file(tmp_path / "a.csv", "time,y[1],y[2]", time, VALUES[::5, 0] * 1e3, VALUES[::5, 1] * 1e3)
    comparison = compare([run, file], {"y": "plant.y_pi"}, {"y": "mm", "time": "ms"})
    assert comparison.signals == COLUMNS[:2]
    assert comparison.left_out == ["plant.u"]
    found = signal_differences(run_differences(comparison))
    assert {d.signal for d in found} == set(COLUMNS[:2])
    for difference in found:
        assert difference.relative < 1e-14
        assert (difference.rows, difference.interpolated) == (21, 0)


def test_the_largest_difference_is_found_where_it_is(tmp_path: Path) -> None:
    run = run_folder_of(tmp_path / "run")
    values = VALUES.copy()
    values[40, 1] += 1e-12
    values[70, 2] += 2e-9
    file = csv_file(tmp_path / "a.csv", "Time [s];y_pi[1];y_pi[2];u[1]", TIME, *values.T, separator=";")
    found = signal_differences(run_differences(compare([run, file])))
    assert [(d.signal, round(d.time, 9)) for d in found[:2]] == [("plant.y_pi[2]", 0.4), ("plant.u[1]", 0.7)]
    assert found[0].largest == pytest.approx(1e-12, rel=1e-3)
    assert found[0].relative == pytest.approx(1e-12 / np.abs(VALUES[:, 1]).max(), rel=1e-3)
    assert found[0].rms == pytest.approx(1e-12 / np.sqrt(101), rel=1e-3)
    assert found[2].largest == 0


def test_times_between_rows_are_interpolated(tmp_path: Path) -> None:
    run = run_folder_of(tmp_path / "run")
    time = TIME[:-1] + 3e-3
    file = csv_file(tmp_path / "a.csv", "t,plant.u[1]", time, 100 * time)
    [difference] = signal_differences(run_differences(compare([run, file])))
    assert difference.relative < 1e-12  # of a straight line
    assert difference.interpolated == difference.rows == 99


def test_settings_that_differ_stand_first(tmp_path: Path) -> None:
    first = run_folder_of(tmp_path / "first")
    other = run_folder_of(
        tmp_path / "other", scale=1.1, coupling="gauss-seidel", set={"plant.beam[1].tip_mass": 0.03}, design_id="x"
    )
    comparison = compare([first, other])
    assert setting_differences(comparison) == [
        ("coupling", ["jacobi", "gauss-seidel"]),
        ("plant.beam[1].tip_mass", ["", "0.03"]),
    ]
    assert all(d.relative == pytest.approx(0.1) for d in signal_differences(run_differences(comparison)))


def test_what_is_common_is_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = run_folder_of(tmp_path / "first")
    other = run_folder_of(tmp_path / "other", columns=["plant.y_pi[1]", "plant.y_pi[3]"])
    third = run_folder_of(tmp_path / "third")
    assert (
        main(["compare", *map(str, (first, other, third)), "--out", str(tmp_path / "out"), "--tolerance", "1e-9"]) == 0
    )
    shown = capsys.readouterr()
    assert "not in every run, left out: plant.y_pi, plant.u" in shown.err
    assert "all signals are equal (101 common times, 0 to 1 s)" in shown.out
    page = (tmp_path / "out/compare.html").read_text()
    assert "Difference of other from first" in page
    assert "Difference of third from first" in page


def test_tolerance_decides_the_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["compare", str(run_folder_of(tmp_path / "a")), str(run_folder_of(tmp_path / "b", scale=1 + 1e-6))]
    arguments += ["--out", str(tmp_path / "out"), "--json", "--tolerance"]
    for tolerance, status in (("1.1e-6", 0), ("0.9e-6", 1)):
        assert main([*arguments, tolerance]) == status
        figures = json.loads(capsys.readouterr().out)
        assert figures["holds"] is (status == 0)
        assert figures["runs"] == ["a", "b"]
        assert [s["relative"] for s in figures["signals"]] == pytest.approx([1e-6, 1e-6, 1e-6])
    assert not (tmp_path / "out").exists()


def with_units(path: Path, scale: float = 1.0, **units: str) -> Path:
    """A run whose signals declare units of measurement."""
    named = [f"plant.{name}" for name in units]
    values = scale * VALUES[:, : len(named)]
    recording = Recording(time=TIME, columns=named, values=values, wall_seconds=1.0)
    signals = {n: {"unit": u, "description": ""} for n, u in zip(named, units.values(), strict=True)}
    write_results(path, recording, {**SUMMARY, "signals": signals})
    return path


@pytest.mark.parametrize(
    ("begin", "end", "share", "noted", "holds"),
    [
        (0.0, 0.1, 0.1, True, False),  # a sliver
        (0.9, 1.9, 0.1, True, False),  # of two that are both long
        (0.0, 0.49, 0.49, True, False),
        (0.0, 0.5, 0.5, True, True),
        (0.25, 0.98, 0.73, True, True),
        (0.0, 0.99, 0.99, False, True),
        (0.0, 1.0, 1.0, False, True),
        (0.0, 2.0, 0.5, True, True),  # of the longer one
        (0.0, 2.1, 1 / 2.1, True, False),
    ],
)
def test_the_compared_span_is_told_and_judged(
    begin: float, end: float, share: float, noted: bool, holds: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = run_folder_of(tmp_path / "run")
    time = np.arange(round(begin * 100), round(end * 100) + 1) * 1e-2
    file = csv_file(tmp_path / "a.csv", "time,u[1]", time, 100 * time)
    arguments = ["compare", str(run), str(file), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--json", "--tolerance", "1e-9"]) == (0 if holds else 1)
    shown = capsys.readouterr()
    figures = json.loads(shown.out)
    [span] = figures["spans"]
    last = min(end, 1.0)
    assert (span["run"], span["begin"], span["end"]) == ("a.csv", pytest.approx(begin), pytest.approx(last))
    assert span["share"] == pytest.approx(share)
    assert figures["holds"] is holds
    text = f"a.csv: only {100 * share:.3g} % of the longer recording is compared, {begin:g} to {last:g} s"
    assert (text in shown.err) is noted
    assert main(arguments) == 0  # without a verdict
    shown = capsys.readouterr()
    assert f"common times, {begin:g} to {last:g} s" in shown.out
    assert (text in shown.err) is noted


def test_one_sliver_among_several_runs_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole, other = run_folder_of(tmp_path / "whole"), run_folder_of(tmp_path / "other")
    sliver = csv_file(tmp_path / "a.csv", "time,u[1]", TIME[:5], 100 * TIME[:5])
    arguments = ["--out", str(tmp_path / "out"), "--tolerance", "1e-9"]
    assert main(["compare", str(whole), str(other), *arguments]) == 0
    capsys.readouterr()
    assert main(["compare", str(whole), str(other), str(sliver), *arguments]) == 1
    assert "a.csv is compared for less than 50% of the longer recording: FAILED" in capsys.readouterr().out


def test_units_of_measurement_of_runs_and_files_are_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Converted to those of the first run with a note, or refused; --unit is one of the signal's quantity."""
    first = with_units(tmp_path / "first", x="mm", z="degC")
    notes: list[str] = []
    other = with_units(tmp_path / "other", 1e-3, x="m")
    [difference] = signal_differences(run_differences(compare([first, other], notify=notes.append)))
    assert difference.relative < 1e-14
    assert notes == ["other: plant.x is converted from m to mm"]
    file = csv_file(tmp_path / "a.csv", "time,x,z", TIME, VALUES[:, 0] * 1e3, VALUES[:, 1])
    found = signal_differences(run_differences(compare([first, file], units={"x": "µm"})))
    assert all(d.relative < 1e-14 for d in found)
    with pytest.raises(
        InputError, match=r"units 's' and 'mm' are of different quantities: plant\.x of a\.csv and first"
    ):
        compare([first, file], units={"x": "ms"})
    with pytest.raises(InputError, match="--unit of time must be one of time, such as ms, got 'mm'"):
        compare([first, file], units={"time": "mm"})
    kelvin = with_units(tmp_path / "kelvin", z="K")
    with pytest.raises(InputError, match=r"'degC' cannot be compared, 'K' has no definition: plant\.z of kelvin"):
        compare([first, kelvin])
    assert main(["compare", str(first), str(other), "--json"]) == 0
    assert "other: plant.x is converted from m to mm" in capsys.readouterr().err


def test_a_row_of_units_is_read(tmp_path: Path) -> None:
    run = with_units(tmp_path / "run", x="mm")
    rows = [f"{1e3 * t!r},{1e-3 * x!r}" for t, x in zip(TIME.tolist(), VALUES[:, 0].tolist(), strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["time,plant.x", "ms,m", *rows]) + "\n")
    [difference] = signal_differences(run_differences(compare([run, tmp_path / "a.csv"])))
    assert difference.relative < 1e-14
    assert difference.rows == 101


def test_columns_that_are_no_numbers_are_named(tmp_path: Path) -> None:
    """In every format; true and false are numbers."""
    flags = TIME > 0.5
    kinds = ["csv", "mat"]
    lines = [f"{t!r},{str(b).lower()},on" for t, b in zip(TIME.tolist(), flags.tolist(), strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["time,flag,mode", *lines]) + "\n")
    from scipy.io import savemat

    mode = np.array(["on"] * len(TIME), dtype=object)
    savemat(tmp_path / "a.mat", {"time": TIME, "flag": flags, "mode": mode, "short": TIME[:5], "s": {"c": TIME * 1j}})
    if importlib.util.find_spec("pyarrow"):
        import pyarrow
        import pyarrow.parquet

        columns = {"time": TIME, "flag": flags, "mode": ["on"] * len(TIME)}
        pyarrow.parquet.write_table(pyarrow.table(columns), tmp_path / "a.parquet")
        kinds.append("parquet")
    if importlib.util.find_spec("asammdf"):
        from asammdf import MDF, Signal

        with MDF(version="4.10") as file:
            file.append([Signal(flags.astype(np.uint8), TIME, name="flag", unit="1")])
            file.append([Signal(TIME[::10], TIME[::10], name="mode")])
            file.save(tmp_path / "a.mf4")
        kinds.append("mf4")
    for kind in kinds:
        notes: list[str] = []
        read = read_recording(tmp_path / f"a.{kind}", {}, {}, notes.append)
        assert (read.columns, read.values[:, 0].tolist()) == (["flag"], flags.astype(float).tolist())
        names = "mode, short, s.c" if kind == "mat" else "mode"
        assert notes == [f"{tmp_path}/a.{kind}: not read, since no numbers over the time: {names}"]


def refuse(name: str) -> float:
    raise AssertionError(f"{name} is not JSON")


def test_json_has_no_infinities(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A signal that is zero in the first run, and one that is no number, are infinitely different: null."""
    first = run_folder_of(tmp_path / "a", columns=["plant.u[1]", "plant.u[2]"], scale=0.0)
    values = np.stack([np.ones(101), np.full(101, np.nan)], axis=1)
    file = csv_file(tmp_path / "b.csv", "time,u[1],u[2]", TIME, *values.T)
    assert main(["compare", str(first), str(file), "--json", "--tolerance", "1e6"]) == 1
    figures = json.loads(capsys.readouterr().out, parse_constant=refuse)
    assert [(s["signal"], s["largest"], s["relative"]) for s in figures["signals"]] == [
        ("plant.u[1]", 1.0, None),
        ("plant.u[2]", None, None),
    ]
    assert figures["holds"] is False


@pytest.mark.parametrize("kind", ["parquet", "mat"])
def test_every_format_of_a_run_is_read_back(kind: str, tmp_path: Path) -> None:
    if kind == "parquet":
        pytest.importorskip("pyarrow")
    recording = Recording(time=TIME, columns=COLUMNS, values=VALUES, wall_seconds=1.0)
    write_results(tmp_path / "run", recording, SUMMARY, [kind])  # type: ignore[list-item]
    read = read_recording(tmp_path / f"run/results.{kind}", {}, {})
    order = [read.columns.index(name) for name in COLUMNS]
    np.testing.assert_array_equal(read.values[:, order], VALUES)
    np.testing.assert_array_equal(read.time, TIME)
    assert (
        signal_differences(run_differences(compare([run_folder_of(tmp_path / "csv"), tmp_path / "run"])))[0].largest
        == 0
    )


@pytest.mark.skipif(importlib.util.find_spec("asammdf") is None, reason="needs the extra mf4")
def test_mf4_files_are_read(tmp_path: Path) -> None:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.append([Signal(VALUES[:, k], TIME, name=f"y{k}") for k in range(2)])
        file.save(tmp_path / "a.mf4")
    read = read_recording(tmp_path / "a.mf4", {"y0": COLUMNS[0], "y1": COLUMNS[1]}, {"y1": "mm"})
    np.testing.assert_array_equal(read.time, TIME)
    np.testing.assert_allclose(read.values, VALUES[:, :2] * [1, 1e-3], rtol=1e-15)


def events(path: Path) -> Path:
    return csv_file(path, "time,x", np.array([0, 1, 1, 2.0]), np.array([0, 1, 5, 6.0]))


def test_the_last_row_of_a_time_holds(tmp_path: Path) -> None:
    read = read_recording(events(tmp_path / "a.csv"), {}, {})
    np.testing.assert_array_equal(read.time, [0, 1, 2])
    np.testing.assert_array_equal(read.values[:, 0], [0, 5, 6])


@pytest.mark.parametrize(
    ("name", "content", "options", "message"),
    [
        ("a.csv", b"x,y\n0,1\n1,2\n", {}, "must have a column named time or t"),
        ("a.csv", b"time,y\n1,1\n0,2\n", {}, "must have ascending times"),
        ("a.csv", b"time,y\n0,1\n", {}, "must have ascending times, at least two"),
        ("a.csv", b"time,y,y\n0,1,1\n1,2,3\n", {}, "one name for each column"),
        ("a.csv", b"time,q\n0,secret\n1,secret\n", {}, "must record the same signals"),
        ("a.csv", b"secret", {}, "is not a CSV file of numbers"),
        ("a.csv", b"time,y\n0,1\n1,secret\n", {}, "column 2 must hold numbers alone, its row 2 does not"),
        ("a.parquet", b"secret", {}, "is not a readable Parquet file"),
        ("a.mat", b"secret", {}, "is not a readable MAT file"),
        ("a.xlsx", b"secret", {}, "must be a folder of results or a file .csv, .parquet"),
        ("a.csv", b"time,y\n0,1\n1,2\n", {"names": {"z": "plant.u"}}, "--map names no column of"),
        ("a.csv", b"time,y\n0,1\n1,2\n", {"units": {"y": "ft"}}, "--unit of y must be a known unit"),
        ("a.csv", b"time,a,b\n0,1,1\n1,2,2\n", {"names": {"a": "x", "b": "x"}}, "--map must not give two columns"),
        ("a.csv", b"time,q\n0,1\n1,2\n", {}, "must record the same signals"),
        ("a.csv", b"time,u[1]\n5,1\n6,2\n", {}, "must overlap in time: they are of 0 to 1 s and 5 to 6 s"),
    ],
)
def test_bad_files_are_refused(
    name: str, content: bytes, options: dict[str, dict[str, str]], message: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    if name.endswith("parquet"):
        pytest.importorskip("pyarrow")
    with pytest.raises(InputError, match=message) as raised:
        signal_differences(run_differences(compare([run_folder_of(tmp_path / "run"), tmp_path / name], **options)))
    assert "secret" not in str(raised.value)


def test_options_for_files_need_a_file(tmp_path: Path) -> None:
    folders = [run_folder_of(tmp_path / "a"), run_folder_of(tmp_path / "b")]
    with pytest.raises(InputError, match="--map is for files of other tools"):
        compare(folders, {"y": "plant.y_pi"})


@pytest.mark.native
def test_fmpy_simulates_the_exported_loop_as_the_runner_does(
    tmp_path: Path, at_run_folder: Path, known_designs: None, capsys: pytest.CaptureFixture[str]
) -> None:
    """At another output interval; then a run with another tip mass, whose largest difference is named."""
    from fmpy import simulate_fmu
    from fmpy.util import write_csv

    options: list[str] = ["single_beam", "--stop-time", "1.4", "--set", "plant.force=0.02"]
    assert main(["export", *options, "--with-signals", "-o", str(tmp_path / "loop.fmu")]) == 0
    quick: Callable[..., list[str]] = lambda out, *more: [  # noqa: E731
        *("run", *options, "--no-report", "--no-figures", "--out", str(tmp_path / out)),
        *more,
    ]
    assert main(quick("run")) in (0, 1)  # the checks are not those of a pushed beam
    result = simulate_fmu(str(tmp_path / "loop.fmu"), stop_time=1.4, output_interval=1e-3)
    write_csv(str(tmp_path / "fmpy.csv"), result)
    capsys.readouterr()
    compared = ["compare", str(tmp_path / "run"), str(tmp_path / "fmpy.csv"), "--map", "u=plant.u", "--json"]
    assert main([*compared, "--tolerance", "1e-9"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert {"plant.y_pi[1]", "plant.u[1]"} <= {s["signal"] for s in figures["signals"]}
    assert all(s["rows"] == 1401 and s["interpolated"] == 0 for s in figures["signals"])
    text = (tmp_path / "fmpy.csv").read_text().splitlines()
    read = read_results(tmp_path / "run/results.csv")
    peak = np.abs(read.values[:, read.columns.index("plant.y_pi[1]")]).max()
    column = text[0].replace('"', "").split(",").index("y_pi[1]")
    row = text[1300].split(",")
    row[column] = repr(float(row[column]) + 2e-9 * float(peak))
    (tmp_path / "fmpy.csv").write_text("\n".join([*text[:1300], ",".join(row), *text[1301:]]) + "\n")
    assert main([*compared, "--tolerance", "1e-9"]) == 1
    worst = json.loads(capsys.readouterr().out)["signals"][0]
    assert (worst["signal"], round(worst["time"], 6)) == ("plant.y_pi[1]", 1.299)
    assert worst["relative"] == pytest.approx(2e-9, rel=0.01)
    assert main(quick("heavy", "--set", "plant.beam[1].tip_mass=0.03")) in (0, 1)
    capsys.readouterr()
    assert main(["compare", str(tmp_path / "run"), str(tmp_path / "heavy"), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert shown.index("plant.beam[1].tip_mass") < shown.index("differences from run")
    assert "largest relative difference: " in shown
