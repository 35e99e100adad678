"""Signals of a scenario against their closed forms, and what a scenario may not ask of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.plant.validation import validate
from flexbeams.scenarios.definition.schema import Input, Scenario
from flexbeams.scenarios.definition.signals import Signal, require_sampled, signal_of
from flexbeams.scenarios.definition.time_table import read_time_table

STEP = 2e-4


def signal(folder: Path = Path(), **drive: Any) -> Signal:
    return signal_of(validate(Input, {"to": "plant.u", **drive}, "test.toml"), folder)


def times(stop: float, step: float = STEP) -> np.ndarray:
    return np.arange(round(stop / step) + 1) * step


EVERY_KIND: list[dict[str, Any]] = [
    {"constant": [3.0, -1.0]},
    {"step": {"time": 0.1, "value": [1.0, 2.0, 3.0]}},
    {"pulse": {"time": 0.1, "duration": 5e-3, "impulse": 0.04}},
    {"chirp": {"time": 0.05, "duration": 0.3, "amplitude": [2.0, 1.0], "start_frequency": 1.0, "stop_frequency": 90.0}},
    {"pseudo_random": {"amplitude": [1.0, 2.0, 3.0], "hold": 7e-4, "register": 5}},
    {"pseudo_random": {"time": 0.03, "amplitude": [1.0, 2.0], "hold": 7e-4, "kind": "levels"}},
    {"targets": [{"time": 0.0, "value": [1.0, 2.0]}, {"time": 0.2, "value": [0.0, 1.0]}]},
]


@pytest.mark.parametrize("drive", EVERY_KIND, ids=lambda d: next(iter(d)))
@pytest.mark.parametrize("block", [1, 7, 500])
def test_blocks_of_any_length_give_the_same_values(drive: dict[str, Any], block: int) -> None:
    time, source = times(0.4), signal(**drive)
    parts = [source.sample(time[k : k + block]) for k in range(0, len(time), block)]
    whole = source.sample(time)
    assert whole.shape == (len(time), source.width)
    np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_pulse_has_its_impulse() -> None:
    time = times(0.2, 1e-6)
    values = signal(pulse={"time": 0.1, "duration": 5e-3, "impulse": 0.04}).sample(time)[:, 0]
    assert np.trapezoid(values, time) == pytest.approx(0.04, rel=1e-6)
    assert not values[time < 0.1 - 1e-9].any()


@pytest.mark.parametrize("sweep", ["linear", "logarithmic"])
@pytest.mark.parametrize(("first", "last"), [(2.0, 50.0), (50.0, 2.0), (20.0, 20.0)])
def test_chirp_has_the_wanted_frequency_at_its_zeros(sweep: str, first: float, last: float) -> None:
    """The sine of the integral of f: between zeros it makes half a turn, so f is half the inverse of their distance."""
    duration, begin = 4.0, 0.5
    time = times(6.0, 1e-5)
    values = signal(
        chirp={
            "time": begin,
            "duration": duration,
            "amplitude": 3.0,
            "start_frequency": first,
            "stop_frequency": last,
            "sweep": sweep,
        }
    ).sample(time)[:, 0]
    assert np.max(np.abs(values)) == pytest.approx(3.0, rel=1e-3)
    assert not values[(time < begin - 1e-9) | (time >= begin + duration)].any()
    k = np.flatnonzero(values[:-1] * values[1:] < 0)
    zeros = time[k] - values[k] * np.diff(time)[k] / (values[k + 1] - values[k])
    share = ((zeros[:-1] + zeros[1:]) / 2 - begin) / duration
    wanted = first + (last - first) * share if sweep == "linear" else first * (last / first) ** share
    np.testing.assert_allclose(0.5 / np.diff(zeros), wanted, rtol=0.02)


def test_a_linear_chirp_may_begin_at_rest() -> None:
    values = signal(
        chirp={"time": 0.0, "duration": 1.0, "amplitude": 1.0, "start_frequency": 0.0, "stop_frequency": 10.0}
    ).sample(times(0.9))[:, 0]
    np.testing.assert_allclose(values, np.sin(2 * np.pi * 5.0 * times(0.9) ** 2), atol=1e-12)


def binary_period(seed: int, width: int = 3) -> np.ndarray:
    source = signal(pseudo_random={"amplitude": [1.0] * width, "hold": 1e-3, "register": 6, "seed": seed})
    return source.sample(np.arange(2 * 63) * 1e-3)


def test_a_binary_sequence_of_maximum_length_is_white() -> None:
    """Balanced up to one level, of period 2^n - 1, its cyclic autocorrelation -1 off zero; shifted for each element."""
    values = binary_period(seed=3)
    np.testing.assert_array_equal(values[:63], values[63:])
    assert set(np.unique(values)) == {-1.0, 1.0}
    for column in values[:63].T:
        assert abs(column.sum()) == 1
        correlation = [int(column @ np.roll(column, k)) for k in range(63)]
        assert correlation == [63] + [-1] * 62
    cross = values[:63].T @ values[:63]
    np.testing.assert_array_equal(cross, 64 * np.eye(3) - 1)


@pytest.mark.parametrize("kind", ["binary", "levels"])
def test_seeds_choose_the_sequence(kind: str) -> None:
    def of(seed: int) -> np.ndarray:
        return signal(pseudo_random={"amplitude": 1.0, "hold": 1e-3, "kind": kind, "seed": seed}).sample(times(0.5))

    np.testing.assert_array_equal(of(4), of(4))
    assert not np.array_equal(of(4), of(5))


def test_levels_are_uniform_held_and_independent_between_elements() -> None:
    source = signal(pseudo_random={"amplitude": [2.0, 1.0], "hold": 1e-3, "kind": "levels", "duration": 30.0})
    time = np.arange(31000) * 1e-3
    values = source.sample(time)
    assert not values[30000:].any()
    levels = values[:30000]
    np.testing.assert_array_equal(source.sample(time + 0.9e-3), values)
    bound = 5 / np.sqrt(len(levels))  # five standard deviations of a mean of 30,000
    for column, amplitude in zip(levels.T, (2.0, 1.0), strict=True):
        assert np.max(np.abs(column)) <= amplitude
        assert abs(column.mean()) < bound * amplitude
        assert np.mean(column**2) == pytest.approx(amplitude**2 / 3, rel=bound)
    assert abs(np.corrcoef(levels.T)[0, 1]) < bound
    assert abs(np.corrcoef(levels[1:, 0], levels[:-1, 0])[0, 1]) < bound


def test_levels_do_not_depend_on_the_step() -> None:
    source = signal(pseudo_random={"amplitude": 1.0, "hold": 1e-3, "kind": "levels"})
    np.testing.assert_array_equal(source.sample(times(0.4, 2e-4))[::5], source.sample(times(0.4, 1e-3)))


TABLE = 'time,force[1],"w[1,2]",force[2]\n0.1,1,10,-1\n0.2,3,20,-2\n\n0.4,2,30,-3\n'


@pytest.mark.parametrize(("hold", "expected"), [("zero", [1, 1, 1, 3, 2, 2]), ("linear", [1, 1, 2, 2.5, 2, 2])])
def test_a_table_holds_or_joins_its_rows(tmp_path: Path, hold: str, expected: list[float]) -> None:
    (tmp_path / "hammer.csv").write_text(TABLE)
    source = signal(tmp_path, table={"file": "hammer.csv", "hold": hold, "columns": ["force[1]"]})
    np.testing.assert_allclose(source.sample(np.array([0.0, 0.1, 0.15, 0.3, 0.4, 9.0]))[:, 0], expected)


def test_a_table_reaches_its_rows_in_spite_of_rounding(tmp_path: Path) -> None:
    """Row k of a table with the run's own times holds at step k, though k * step rounds otherwise than the text."""
    rows = 3000
    (tmp_path / "u.csv").write_text("time,u\n" + "".join(f"{k * 2 / 10000},{k}\n" for k in range(rows)))
    values = signal(tmp_path, table={"file": "u.csv"}).sample(np.arange(rows) * STEP)[:, 0]
    np.testing.assert_array_equal(values, np.arange(rows))


def test_columns_by_array_and_order(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(TABLE)
    assert signal(tmp_path, table={"file": "t.csv"}).width == 3
    chosen = signal(tmp_path, table={"file": "t.csv", "columns": ["w", "force"]}).sample(np.array([0.2]))
    np.testing.assert_array_equal(chosen, [[20.0, 3.0, -2.0]])
    with pytest.raises(InputError, match=r"table.columns names no column .* did you mean 'force\[.\]'.*got 'forces'"):
        signal(tmp_path, table={"file": "t.csv", "columns": ["forces"]})
    with pytest.raises(InputError, match=r"table.file must be a file, got .*none.csv"):
        signal(tmp_path, table={"file": "none.csv"})


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "must have a header row"),
        ("time,u\n", "must have at least one row below the header"),
        ("time;u\n0;1\n", "row 1 has columns separated by semicolons; use commas, and points in decimal numbers"),
        ("time\n0\n", "row 1 must name the time and at least one more column, separated by commas, got 'time'"),
        ("0.0,1.0\n0.1,1.0\n", "row 1 must be a header that names the columns, got '0.0,1.0'"),
        ("time,u,u\n0,1,2\n", "row 1 must name each column once, got 'u'"),
        ("time,u\n0,1\n0.1\n", "row 3 must have 2 values as the header, got 1"),
        (
            "time,u\n0,1\n0.1,2,3\n",
            "row 3 must have 2 values as the header (decimal commas? write 0.5, not 0,5), got 3",
        ),
        ("time,u\n0,1\n0.1,abc\n", "row 3, column 'u' must be a finite number, got 'abc'"),
        ("# by hand\n\ntime,u\n0,1\n\n0.1,'0'\n", "row 6, column 'u' must be a finite number, got \"'0'\""),
        ('time,u\n0,"0,5"\n', "row 2, column 'u' has a decimal comma; write 0.5, not 0,5, got '0,5'"),
        ("time,u\n0,\n", "row 2, column 'u' must be a finite number, got ''"),
        ("time,u\n0,1\n\nnan,1\n", "row 4, column 'time' must be a finite number, got 'nan'"),
        ("time,u\n0,1e999\n", "row 2, column 'u' must be a finite number, got '1e999'"),
        ("time,u\n0,1\n0.1,1\n0.1,1\n", "row 4, column 'time' must be > 0.1, the time of the row before, got 0.1"),
    ],
)
def test_refused_tables_name_file_row_and_column(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "table.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refusal:
        read_time_table(path)
    assert str(refusal.value) == f"{path}: {complaint}"


def test_refused_table_files(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_bytes(b"time,u\n0,\xff\n")
    with pytest.raises(InputError, match="is not UTF-8 text"):
        read_time_table(path)
    path.write_bytes(b'time,u\n0,"' + b"1" * 200_000 + b'"\n')
    with pytest.raises(InputError, match="is not a CSV file: field larger than"):
        read_time_table(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_time_table(tmp_path)


CHIRP = {"time": 0.0, "duration": 1.0, "amplitude": 1.0, "start_frequency": 1.0, "stop_frequency": 9.0}


@pytest.mark.parametrize(
    ("drive", "complaint"),
    [
        ({}, r"must have exactly one of constant, .*table and targets, got 'none'"),
        ({"constant": 1.0, "chirp": CHIRP}, r"must have exactly one of .*, got 'constant, chirp'"),
        (
            {"chirp": {**CHIRP, "start_frequency": 0.0, "sweep": "logarithmic"}},
            r"chirp.start_frequency must be finite and > 0 for a logarithmic sweep, got 0.0",
        ),
        ({"chirp": {**CHIRP, "duration": 0.0}}, r"chirp.duration must be finite and > 0, got 0.0"),
        ({"chirp": {**CHIRP, "rate": 0.0}}, r"chirp.rate is not a known key; .*valid: time, duration"),
        ({"pseudo_random": {"amplitude": 1.0}}, r"pseudo_random.hold is missing"),
        ({"pseudo_random": {"amplitude": 1.0, "hold": 1.0, "seed": -1}}, r"pseudo_random.seed must be >= 0, got -1"),
        ({"pseudo_random": {"amplitude": 1.0, "hold": 1.0, "register": 40}}, r"pseudo_random.register must be <= 20"),
        ({"table": {"file": "a.csv", "hold": "cubic"}}, r"table.hold must be 'zero' or 'linear', got 'cubic'"),
    ],
)
def test_refused_inputs_name_the_key(drive: dict[str, Any], complaint: str) -> None:
    table = {
        "title": "t",
        "structure": "kiel",
        "stop_time": 1.0,
        "instance": {"plant": {"unit": "BeamPlant"}},
        "input": [{"to": "plant.u", **drive}],
    }
    with pytest.raises(InputError, match=r"^s.toml: input\[1\]\.?" + f".*{complaint}"):
        validate(Scenario, table, "s.toml")


@pytest.mark.parametrize(
    ("drive", "complaint"),
    [
        (
            {"chirp": {**CHIRP, "stop_frequency": 2600.0}},
            r"chirp.stop_frequency must be <= 2500 Hz, half the step rate",
        ),
        (
            {"pseudo_random": {"amplitude": 1.0, "hold": 1e-4}},
            r"pseudo_random.hold must be at least the step of 0.0002 s",
        ),
    ],
)
def test_signals_faster_than_the_steps_are_refused(drive: dict[str, Any], complaint: str) -> None:
    drive_ = validate(Input, {"to": "plant.u", **drive}, "s.toml")
    with pytest.raises(InputError, match=complaint):
        require_sampled(drive_, STEP)
    require_sampled(drive_, STEP / 2)


@pytest.mark.parametrize(
    ("header", "columns"),
    [
        ("time,u[4],u[3],u[2],u[1]", None),
        ("time,plant.u[4],plant.u[3],plant.u[2],plant.u[1]", None),
        ("u[4],u[3],time,u[2],u[1]", None),
        ("time,u[4],u[3],u[2],u[1]", ["u"]),
        ("time,u[12],u[11],u[3],u[2]", ["u"]),
    ],
)
def test_elements_follow_their_index(tmp_path: Path, header: str, columns: list[str] | None) -> None:
    """Not the order of the file's columns."""
    names = header.split(",")
    largest = next(name for name in names if name != "time")
    cells = ["4" if name == largest else "0" for name in names]
    (tmp_path / "t.csv").write_text(f"{header}\n{','.join(cells)}\n")
    table = {"file": "t.csv"} | ({"columns": columns} if columns else {})
    np.testing.assert_array_equal(signal(tmp_path, table=table).sample(np.zeros(1)), [[0, 0, 0, 4]])


def test_columns_with_other_names_go_by_order(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("time,b,a\n0,1,2\n")
    np.testing.assert_array_equal(signal(tmp_path, table={"file": "t.csv"}).sample(np.zeros(1)), [[1, 2]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("time,u[1],u[2],w\n0,1,2,3\n", "table.columns must choose columns: some of the file .* not, got 'w'"),
        ("time,u[1],u[3]\n0,1,2\n", r"table.columns must have one column for each element of plant.u, got 'u\[1\], u"),
        ("Time,u,t\n0,1,2\n", "row 1 must name one column time, got 'Time, t'"),
        ("time,u\n0,1_000\n", "row 2, column 'u' must be a finite number, got '1_000'"),
        ("time,u\n0,\u0663\n", "row 2, column 'u' must be a finite number"),
    ],
)
def test_ambiguous_tables_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "t.csv").write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        signal(tmp_path, table={"file": "t.csv"})


@pytest.mark.parametrize("start", [0.0, 0.01, 0.01013, 0.0104, 0.0499])
@pytest.mark.parametrize("duration", [5e-4, 5e-3])
def test_pulses_keep_their_impulse_at_any_step(tmp_path: Path, start: float, duration: float) -> None:
    """Point samples of 5 ms at steps of 2.5 ms would keep 79 % of it, of 0.5 ms between two samples nothing."""
    drive = validate(
        Input, {"to": "plant.force", "pulse": {"time": start, "duration": duration, "impulse": 1e-3}}, "test.toml"
    )
    for step in (2e-4, 5e-4, 1e-3, 2.5e-3, 5e-3, 0.05, 0.1):
        require_sampled(drive, step)
        values = signal_of(drive, tmp_path, step).sample(step * np.arange(round(0.5 / step) + 1))
        assert step * values.sum() == pytest.approx(1e-3, rel=0.005), step


def test_a_long_pulse_is_sampled_at_points(tmp_path: Path) -> None:
    pulse = {"time": 1.0, "duration": 5e-3, "impulse": 0.0358}
    drive = validate(Input, {"to": "plant.force", "pulse": pulse}, "test.toml")
    time = 2e-4 * np.arange(4990, 5040)
    values = signal_of(drive, tmp_path, 2e-4).sample(time)[:, 0]
    assert np.array_equal(values, signal(tmp_path, pulse=pulse).sample(time)[:, 0])
    assert values.max() == pytest.approx(np.pi * 0.0358 / (2 * 5e-3), rel=1e-2)


@pytest.mark.parametrize(
    ("header", "clock"),
    [("t,time,u", 1), ("Time,time,t", 1), ("u,T,v", 1), ("u,v,TIME", 2), ("a,b,c", 0), ("t,b,c", 0)],
)
def test_the_column_of_times(header: str, clock: int, tmp_path: Path) -> None:
    """The one called time, else the only one of another spelling, else the first."""
    path = tmp_path / "table.csv"
    rows = np.array([[5.0, 6.0, 7.0], [6.0, 7.0, 9.0]])
    path.write_text(f"{header}\n" + "\n".join(",".join(map(str, row)) for row in rows.tolist()) + "\n")
    table = read_time_table(path)
    assert table.time.tolist() == rows[:, clock].tolist()
    assert table.columns == [name for k, name in enumerate(header.split(",")) if k != clock]
    assert np.array_equal(table.values, np.delete(rows, clock, axis=1))


@pytest.mark.parametrize("header", ["Time,t,u", "T,t,u"])
def test_two_spellings_of_the_time_are_refused(header: str, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text(f"{header}\n0,1,2\n")
    with pytest.raises(InputError, match="row 1 must name one column time, got "):
        read_time_table(path)
