"""Data files: what is read, and one line for each way in which they can be wrong."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.plant.identification.experiment import Experiment, sensor_names
from flexbeams.plant.identification.plausibility import require_plausible
from flexbeams.plant.identification.reading import Column, Reading, read_experiment
from flexbeams.plant.identification.static import static_maps_of
from flexbeams.plant.statespace import static_gains
from tests.plant.identification.data import PATTERNS, kiel, measured, responses, steps

STRUCTURE, MODEL = kiel()
NAMES = sensor_names(STRUCTURE)


def write(path: Path, experiment: Experiment, prefix: str = "plant.") -> Path:
    header = ["time", *(f"{prefix}u[{k}]" for k in range(1, 5)), *(prefix + NAMES[s] for s in experiment.sensors)]
    table = np.column_stack([experiment.time, experiment.voltages, experiment.outputs])
    np.savetxt(path, table, delimiter=",", header=",".join(header), comments="", fmt="%.17g")
    return path


@pytest.fixture(scope="module")
def data() -> list[Experiment]:
    return measured(MODEL, STRUCTURE.parameters(), steps(PATTERNS, 10), 0.002, 1)


def test_a_written_experiment_reads_back(tmp_path: Path, data: list[Experiment]) -> None:
    got = read_experiment(write(tmp_path / "a.csv", data[0]), STRUCTURE)
    assert got.name == "a"
    assert got.step == pytest.approx(data[0].step, rel=1e-12)
    assert np.array_equal(got.voltages, data[0].voltages)
    assert np.array_equal(got.outputs, data[0].outputs)
    assert got.sensors == tuple(range(10))
    assert got.forces is None
    assert np.array_equal(got.rest_voltages, np.zeros(4))


def test_columns_are_mapped_scaled_and_may_be_fewer(tmp_path: Path, data: list[Experiment]) -> None:
    path = write(tmp_path / "a.csv", replace(data[0], outputs=1e3 * data[0].outputs[:, [0, 5]], sensors=(0, 5)), "rig.")
    mapping = {"y_pi[1]": Column(name="rig.y_pi[1]", factor=1e-3), "y_pm[2]": Column(name="y_pm[2]", factor=-1e-3)}
    got = read_experiment(path, STRUCTURE, Reading(columns=mapping, begin=1.0, end=2.0))
    assert got.sensors == (0, 5)
    assert got.rows == 401
    assert got.first_counted == 200
    assert np.allclose(got.outputs, data[0].outputs[:401, [0, 5]] * [1, -1], rtol=1e-12)


def test_rest_under_the_first_voltages(tmp_path: Path) -> None:
    experiment = steps(PATTERNS[:1], 10)[0]
    voltages = experiment.voltages + [300.0, 0, 100, 0]
    held = replace(experiment, voltages=voltages, rest_voltages=voltages[0])
    at_once = replace(experiment, voltages=np.tile(voltages[-1], (experiment.rows, 1)))
    for case, rest in ((held, voltages[0]), (at_once, np.zeros(4))):
        outputs = responses(MODEL, STRUCTURE.parameters(), [case])[0]
        got = read_experiment(write(tmp_path / "a.csv", replace(case, outputs=outputs)), STRUCTURE)
        assert np.array_equal(got.rest_voltages, rest)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda t: t.replace("plant.u[3]", "plant.v"), r"a\.csv: column 'u\[3\]' is missing"),
        (lambda t: t.replace("time", "t", 1), "column 'time' is missing"),
        (lambda t: t.replace("plant.u[2]", "plant.u[1]", 1), r"row 1 must name each column once, got 'plant.u\[1\]'"),
        (lambda t: t.replace(",", ";"), "separated by semicolons"),
        (lambda t: _cell(t, 7, 5, "nan"), r"row 7, column 'plant.y_pi\[1\]' must be a finite number, got 'nan'"),
        (lambda t: _cell(t, 9, 2, "off"), r"row 9, column 'plant.u\[2\]' must be a finite number, got 'off'"),
        (lambda t: _cell(t, 4, 6, '"0,5"'), r"row 4, column 'plant.y_pi\[2\]' has a decimal comma"),
        (lambda t: _cell(t, 4, 6, "0,5"), r"row 4 must have 15 values as the header \(decimal commas\?.*got 16"),
        (lambda t: "# rig\n\n" + _cell(t, 30, 0, "0.1"), "row 32, column 'time' must increase"),
        (lambda t: "# rig\n\n" + _cell(t, 30, 0, "0.1371"), "row 32, column 'time' must have even steps"),
        (lambda t: _cell(t, 30, 0, "0.1"), "row 30, column 'time' must increase"),
        (lambda t: _cell(t, 30, 0, "0.1371"), "row 30, column 'time' must have even steps of 0.005 s"),
        (lambda t: "\n".join(t.splitlines()[:10]), "at least 20 rows that count, got 9"),
        (lambda t: t.splitlines()[0], "must have at least one row below the header"),
    ],
)
def test_faults_of_a_file_are_named(tmp_path: Path, data: list[Experiment], change: object, match: str) -> None:
    path = write(tmp_path / "a.csv", data[0].first(60))
    path.write_text(change(path.read_text()))  # type: ignore[operator]
    with pytest.raises(InputError, match=match):
        read_experiment(path, STRUCTURE)


def _cell(text: str, row: int, column: int, value: str) -> str:
    lines = text.splitlines()
    cells = lines[row - 1].split(",")
    cells[column] = value
    lines[row - 1] = ",".join(cells)
    return "\n".join(lines)


def changed(data: list[Experiment], sensors: list[int], to: object) -> list[Experiment]:
    """The experiments with other values of some sensors."""
    out = []
    for experiment in data:
        outputs = experiment.outputs.copy()
        outputs[:, sensors] = to(outputs[:, sensors])  # type: ignore[operator]
        out.append(replace(experiment, outputs=outputs))
    return out


def test_good_data_pass_from_a_start_far_off(data: list[Experiment]) -> None:
    free = list(STRUCTURE.parameters())
    rng = np.random.default_rng(2)
    require_plausible(STRUCTURE, data, free)
    for _ in range(5):
        start = {name: v * np.exp(rng.uniform(-0.4, 0.4)) for name, v in STRUCTURE.parameters().items()}
        require_plausible(STRUCTURE.with_parameters(start), data, free)
    _, exact = kiel("segment")
    require_plausible(STRUCTURE, measured(exact, STRUCTURE.parameters(), steps(PATTERNS, 10), 0.002, 1), free)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (
            lambda d: changed(d, [4, 6], lambda y: y[:, ::-1]),
            r"'y_pm\[1\]' and 'y_pm\[3\]' are exchanged.*times better",
        ),
        (lambda d: changed(d, [0, 3], lambda y: y[:, ::-1]), r"'y_pi\[1\]' and 'y_pi\[4\]' are exchanged"),
        (lambda d: changed(d, [2], lambda y: -y), r"'y_pi\[3\]' has the wrong sign.*--map 'y_pi\[3\]=y_pi\[3\]\*-1'"),
        (lambda d: changed(d, [4], lambda y: -y), r"'y_pm\[1\]' has the wrong sign"),
        (lambda d: changed(d, [1], lambda y: 1e3 * y), r"'y_pi\[2\]' is .* wrong unit.*y_pi\[2\]\*0\.001'"),
        (lambda d: changed(d, [6], lambda y: 1e6 * y), r"'y_pm\[3\]' is .* wrong unit.*y_pm\[3\]\*1e-06'"),
        (lambda d: changed(d, [5], lambda y: 0 * y + 1), r"'y_pm\[2\]' never changes"),
        (lambda d: changed(d, [2], lambda y: np.clip(y, -2e-3, 2e-3)), r"'y_pi\[3\]' stays at its extreme.*clipped"),
        (lambda d: [replace(e, step=0.03) for e in d], "column 'time' is too coarse: .* samples a period of mode 3"),
        (lambda d: [e.first(80) for e in d], r"is too short: 0\.1.* s after the first excitation"),
        (
            lambda d: [replace(e, voltages=e.voltages * [1, 1, 0, 1]) for e in d],
            r"column 'u\[3\]' never changes in any file, .* --fix patch\[3\]\.piezo_ratio",
        ),
        (
            lambda d: [replace(e, voltages=e.voltages * [1, 1, 0, 1] + [0, 0, 200, 0]) for e in d],
            r"column 'u\[3\]' is 200 V in every row of all files: patch\[3\]\.piezo_ratio cannot be told from",
        ),
    ],
)
def test_implausible_data_are_named(data: list[Experiment], change: object, match: str) -> None:
    with pytest.raises(InputError, match=match):
        require_plausible(STRUCTURE, change(data), list(STRUCTURE.parameters()))  # type: ignore[operator]


def test_static_gains_within_their_intervals() -> None:
    slow = STRUCTURE.with_parameters({n: 8 * v for n, v in STRUCTURE.parameters().items() if n.endswith("damping")})
    experiments = steps(800 * np.vstack([np.eye(4), PATTERNS / 800]), 10, rows=1600)
    wanted = np.vstack(static_gains(MODEL, MODEL.assemble()))
    inside = []
    for seed in range(4):
        data = measured(MODEL, slow.parameters(), experiments, 0.002, seed)
        maps = static_maps_of(data, pairs=4, points=4, gauges=6)
        assert maps.deflection_interval is not None
        assert maps.strain_interval is not None
        got, half = (
            np.vstack([maps.deflection, maps.strain]),
            np.vstack([maps.deflection_interval, maps.strain_interval]),
        )
        size = np.max(np.abs(wanted), axis=1, keepdims=True)
        assert np.max(np.abs(got - wanted) / size) < 0.005
        assert np.max(half / size) < 0.01
        inside.append(np.mean(np.abs(got - wanted) < half))
    assert np.mean(inside) > 0.9


@pytest.mark.parametrize(("plateau", "noise"), [(5.0, 0.0), (5.0, 0.002), (9.0, 0.001)])
def test_intervals_of_one_record_with_as_many_steps_as_pairs(plateau: float, noise: float) -> None:
    """No plateau is left over to show scatter, and oscillations last longer than a plateau."""
    wanted = np.vstack(static_gains(MODEL, MODEL.assemble()))
    inside = []
    for seed in range(3):
        rows = int(plateau * (1 + 0.07 * seed) / 5e-3)
        voltages = np.vstack([np.zeros((80, 4)), *(np.tile(pattern, (rows, 1)) for pattern in PATTERNS)])
        record = replace(steps(PATTERNS[:1], 10, rows=len(voltages))[0], voltages=voltages)
        maps = static_maps_of(
            measured(MODEL, STRUCTURE.parameters(), [record], noise, seed), pairs=4, points=4, gauges=6
        )
        assert maps.deflection_interval is not None
        assert maps.strain_interval is not None
        half = np.vstack([maps.deflection_interval, maps.strain_interval])
        inside.append(np.abs(np.vstack([maps.deflection, maps.strain]) - wanted) < half)
        assert np.max(half / np.max(np.abs(wanted), axis=1, keepdims=True)) < 0.015
    assert np.mean(inside) > 0.93


def test_pairs_that_never_move_alone_have_no_gains(data: list[Experiment]) -> None:
    with pytest.raises(InputError, match="do not tell 4 pairs and the offsets apart"):
        static_maps_of(data[:1], pairs=4, points=4, gauges=6)
