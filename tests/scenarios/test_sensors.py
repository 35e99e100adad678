"""Sensors of recordings: delay, noise and resolution of what is recorded, and nothing of what the units exchange."""

import json
from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.schema import Sensor
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.results.reading import read_recording
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.simulation.sensors import Instrument, measure, require_sensors

TIME = 1e-3 * np.arange(1000)
WAVE = np.sin(20 * TIME)


def measured(name: str, values: Array, sensor: Sensor, time: Array, row_step: float) -> Array:
    return Instrument(name, sensor, row_step).shows(time, values, True)


def test_a_delay_shows_earlier_values_and_the_first_one_before() -> None:
    got = measured("a.x", WAVE + 1, Sensor(of="a.x", delay=7e-3), TIME, 1e-3)
    assert np.array_equal(got[7:], WAVE[:-7] + 1)
    assert np.all(got[:7] == 1.0)
    assert np.all(measured("a.x", WAVE, Sensor(of="a.x", delay=5.0), TIME, 1e-3) == 0.0)


def test_a_shorter_last_step_is_delayed_by_the_same_time() -> None:
    time = np.append(TIME[::10], TIME[-1])  # 0.99, then 0.999
    got = measured("a.x", 3 * time, Sensor(of="a.x", delay=0.02), time, 1e-2)
    assert got[2:] == pytest.approx(3 * (time[2:] - 0.02), rel=1e-12)


def test_noise_has_its_deviation_and_depends_on_name_and_seed_only() -> None:
    long = np.zeros(100_000)
    time = 1e-3 * np.arange(len(long))
    one = measured("a.x[1]", long, Sensor(of="a.x", noise=2e-6), time, 1e-3)
    assert np.std(one) == pytest.approx(2e-6, rel=0.01)
    assert abs(np.mean(one)) < 4 * 2e-6 / np.sqrt(len(long))
    assert np.array_equal(measured("a.x[1]", long[:50], Sensor(of="a.x", noise=2e-6), time[:50], 1e-3), one[:50])
    for name, seed in (("a.x[2]", 1), ("a.x[1]", 2)):
        other = measured(name, long, Sensor(of="a.x", noise=2e-6, seed=seed), time, 1e-3)
        assert abs(np.corrcoef(one, other)[0, 1]) < 0.02


def test_resolution_rounds_the_noisy_value() -> None:
    sensor = Sensor(of="a.x", noise=0.2, resolution=0.25)
    got = measured("a.x", WAVE, sensor, TIME, 1e-3)
    assert np.array_equal(got / 0.25, np.round(got / 0.25))
    noisy = measured("a.x", WAVE, Sensor(of="a.x", noise=0.2), TIME, 1e-3)
    assert np.max(np.abs(got - noisy)) <= 0.125 + 1e-12
    assert not np.any(np.signbit(got) & (got == 0))


def test_other_columns_stay() -> None:
    values = np.column_stack([WAVE, WAVE, WAVE])
    recording = Recording(time=TIME, columns=["a.x[1]", "a.x[2]", "a.y"], values=values.copy(), wall_seconds=0.0)
    measure(recording, [Sensor(of="a.x[2]", noise=0.1), Sensor(of="a.y", resolution=0.5)], 1e-3)
    changed = np.any(recording.values != values, axis=0)
    assert list(changed) == [False, True, True]


@pytest.mark.parametrize(
    ("sensor", "match"),
    [
        (Sensor(of="a.z"), r"f\.toml: sensor\[2\]\.of names a signal that is not recorded.*'a\.z'"),
        (Sensor(of="a.x[2]"), r"sensor\[2\]\.of must have no other sensor, got 'a\.x\[2\]'"),
        (Sensor(of="a.y", delay=0.0015), r"sensor\[2\]\.delay must be a whole number of recorded steps of 0\.001 s"),
    ],
)
def test_refusals(sensor: Sensor, match: str) -> None:
    columns = ["a.x[1]", "a.x[2]", "a.y"]
    with pytest.raises(InputError, match=match):
        require_sensors([Sensor(of="a.x"), sensor], columns, 1e-3, "f.toml")
    require_sensors([Sensor(of="a.x"), Sensor(of="a.y", delay=0.002)], columns, 1e-3, "f.toml")


SCENARIO = """
title = "A step, measured"
structure = "single_beam"
stop_time = 0.5
step = 1e-3

[instance.plant]
unit = "BeamPlant"
basis = "{basis}"

[[input]]
to = "plant.u"
step = {{ time = 0.05, value = 400.0 }}
"""
SENSORS = """
[[sensor]]
of = "plant.y_pi"
delay = 2e-3
noise = 2e-6
resolution = 1e-6

[[sensor]]
of = "plant.y_pm[1]"
noise = 1e-7
seed = 7
"""


@pytest.mark.native
@pytest.mark.parametrize("basis", ["clamped_free", "segment"])
def test_a_run_records_what_its_sensors_give(tmp_path: Path, basis: str) -> None:
    recordings = []
    for name, sensors in (("true", ""), ("measured", SENSORS)):
        file = tmp_path / f"{name}.toml"
        file.write_text(SCENARIO.format(basis=basis) + sensors)
        options = ["--no-report", "--no-figures", "--format", "csv,mat", "--out", str(tmp_path / name)]
        assert main(["run", str(file), *options]) == 0
        recordings.append(read_results(tmp_path / name / "results.csv"))
    true, got = recordings
    assert true.columns == got.columns
    for k, column in enumerate(true.columns):
        left = got.values[2:, k] - true.values[:-2, k] if "y_pi" in column else got.values[:, k] - true.values[:, k]
        if "y_pi" in column:
            assert np.std(left) == pytest.approx(np.hypot(2e-6, 1e-6 / np.sqrt(12)), rel=0.1)
        elif column == "plant.y_pm[1]":
            assert np.std(left) == pytest.approx(1e-7, rel=0.1)
        else:
            assert np.all(left == 0)
    summary = json.loads((tmp_path / "measured/summary.json").read_text())
    assert [(s["of"], s["noise"], s["seed"]) for s in summary["sensors"]] == [
        ("plant.y_pi", 2e-6, 1),
        ("plant.y_pm[1]", 1e-7, 7),
    ]
    matrix = read_recording(tmp_path / "measured/results.mat", {}, {})
    for k, column in enumerate(got.columns):
        assert np.array_equal(matrix.values[:, matrix.columns.index(column)], got.values[:, k])


@pytest.mark.native
def test_a_wrong_sensor_is_refused_and_the_file_runs_without_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a.toml"
    options = ["--no-report", "--no-figures", "--out", str(tmp_path / "out")]
    for table, message in (
        ('of = "plant.y_pi"\nnoise = -1.0', "sensor[1].noise must be >= 0, got -1.0"),
        (
            'of = "plant.u_pm"\nnoise = 1.0',
            "names a signal that is not recorded; did you mean 'plant.y_pm'",
        ),
        ('of = "plant.y_pi"\ngain = 2.0', "sensor[1].gain is not a known key"),
        ('of = "plant.y_pi"\ndelay = 1.5e-3', "sensor[1].delay must be a whole number of recorded steps of 0.001 s"),
    ):
        file.write_text(SCENARIO.format(basis="clamped_free") + f"[[sensor]]\n{table}\n")
        assert main(["run", str(file), *options]) == 2
        assert message in capsys.readouterr().err
        assert not (tmp_path / "out").exists()
    file.write_text(SCENARIO.format(basis="clamped_free"))
    assert main(["run", str(file), *options]) == 0
