"""Measuring: the bare loops do the units' arithmetic, and the verb gives every figure."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexbeams.controller.planner import PLANNING_TICKS
from flexbeams.fmus.packaging.cache import cache_folder
from flexbeams.plant.basis import Array
from flexbeams.plant.structure import find_structure, read_structure
from flexbeams.scenarios.bench.growth import repeat_beams
from flexbeams.scenarios.bench.identification import Case, measure_identification
from flexbeams.scenarios.bench.plant_forms import dense_plant
from flexbeams.scenarios.bench.unit_loops import Loop
from flexbeams.scenarios.bench.workbench import Workbench
from flexbeams.scenarios.cli.bench_tables import show_identification, show_samples
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.studies.costs import sample_costs
from tests.helpers import design_of

pytestmark = pytest.mark.native

STEPS = 6_000  # past the start of the transition at 1 s


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workbench]:
    with Workbench(STEPS, build_folder=tmp_path_factory.mktemp("units")) as made:
        yield made


def outputs(loop: Loop, rows: Array) -> dict[str, Array]:
    """The arrays of a unit on its own after a step for each row."""
    loop.start()
    loop.advance(rows)
    unit = loop.instances["unit"]
    arrays: dict[str, list[float]] = {}
    for name, variable in unit.variables.items():
        if variable.causality in ("output", "local") and variable.type == "Real" and name.endswith("]"):
            arrays.setdefault(name.partition("[")[0], []).append(float(unit.get(name)))
    return {name: np.array(values) for name, values in arrays.items()}


def assert_near(actual: Array, expected: Array) -> None:
    """1e-9 of the largest element."""
    assert np.abs(expected).max() > 0
    np.testing.assert_allclose(actual, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_plant(bench: Workbench) -> None:
    rows = np.random.default_rng(1).uniform(-1, 1, (700, 7)) * np.r_[np.full(4, 500.0), np.full(3, 0.1)]
    bare, numpy = bench.bare(), bench.numpy()
    bare.plant(rows)
    for row in rows:
        numpy.plant_step(row)
    unit = outputs(bench.unit_loop("plant", ("u", "force"), rows), rows)
    assert_near(bare["y"][:4], unit["y_pi"])
    assert_near(bare["y"][4:], unit["y_pm"])
    assert_near(numpy.y, bare["y"])


def test_controller_within_and_beyond_the_voltage_limit(bench: Workbench) -> None:
    for size in (200.0, 4000.0):
        rows = np.random.default_rng(2).normal(size=(300, 40))
        rows[:, :4] = np.clip(size * rows[:, :4], -9e3, 9e3)  # within the range of the input
        rows[:, 34:] *= 1e-6
        rows[0] = 0.0
        bare, numpy = bench.bare(), bench.numpy()
        bare.controller(rows)
        for row in rows:
            numpy.controller_step(row[:4], row[4:34], row[34:])
        unit = outputs(bench.unit_loop("controller", ("u_ff", "x_ref", "y_pm"), rows), rows)
        for name, other in (("x_est", numpy.x_est), ("u", numpy.u), ("y_est", numpy.y_est)):
            assert_near(bare[name], unit[name])
            assert_near(other, unit[name])


@pytest.mark.parametrize("end", [400, 5_500])
def test_feedforward_under_way_and_arrived(bench: Workbench, end: int) -> None:
    """Three transitions, superposed at first."""
    rows = np.zeros((end, 4))
    for k, begin in enumerate((3, 40, 200)):
        rows[begin:] += np.array([-2e-3, 1e-4 * k, 1e-3, -2e-3])
    starts = {"transition_time": 0.9, "preview": 2e-4}
    transitions = bench.transitions(rows, starts)
    np.testing.assert_array_equal(transitions.begins, [3, 40 + PLANNING_TICKS, 200 + PLANNING_TICKS])
    bare, numpy = bench.bare(transitions), bench.numpy(transitions)
    bare.feedforward(0, end)
    for k in range(end):
        numpy.feedforward_step(k)
    unit = outputs(bench.unit_loop("feedforward", ("y_target",), rows, starts), rows)
    for name, other in (("u_ff", numpy.u_ff), ("x_ref", numpy.x_ref), ("y_ref", numpy.y_ref)):
        assert_near(bare[name], unit[name])
        assert_near(other, unit[name])


def test_closed_loop(bench: Workbench) -> None:
    """The loops of units, bare and of numpy end where the runner does, in the middle of the transition."""
    recorded = bench.closed_run()
    units = bench.closed_loop(recorded=False)
    units.advance_from_start(bench.closed_rows(bench.targets()))
    assert units.instances["plant"].get("y_pi[2]") == recorded["plant.y_pi[2]"][-1]
    transitions = bench.closed_transitions()
    bare, numpy = bench.bare(transitions), bench.numpy(transitions)
    bare.closed(STEPS)
    for k in range(STEPS):
        numpy.closed_step(k)
    assert recorded["feedforward.moving"][-1] == 1.0
    for name, values, other in (
        ("plant.y_pi", bare["y"][:4], numpy.y[:4]),
        ("controller.u", bare["u"], numpy.u),
        ("controller.y_est", bare["y_est"], numpy.y_est),
    ):
        expected = np.array([v[-1] for column, v in recorded.items() if column.startswith(f"{name}[")])
        assert_near(values, expected)
        assert_near(other, expected)


def test_the_dense_plant_is_the_modal_one(bench: Workbench, tmp_path: Path) -> None:
    """The same outputs, up to rounding of the two forms, from a library that never takes the modal one."""
    rows = np.random.default_rng(3).uniform(-1, 1, (300, 7)) * np.r_[np.full(4, 500.0), np.full(3, 0.1)]
    file = dense_plant(bench.plant_file, tmp_path / "BeamPlant.fmu", bench.compiler)
    dense = outputs(bench.file_loop(file, ("u", "force"), rows, folder="dense"), rows)
    modal = outputs(bench.unit_loop("plant", ("u", "force"), rows), rows)
    for name in ("y_pi", "y_pm", "w"):
        assert_near(dense[name], modal[name])
        assert not np.array_equal(dense[name], modal[name])


def test_single_steps_are_those_of_the_block(bench: Workbench) -> None:
    rows = np.random.default_rng(4).uniform(-300, 300, (200, 7))
    whole = outputs(bench.unit_loop("plant", ("u", "force"), rows), rows)
    loop = bench.unit_loop("plant", ("u", "force"), rows)
    loop.start()
    durations = loop.stepper.durations(0, rows)
    assert durations.shape == (200,)
    assert np.all(durations > 0)
    assert loop.stepper.done == 200
    np.testing.assert_array_equal([loop.instances["unit"].get(f"y_pi[{k}]") for k in (1, 2, 3, 4)], whole["y_pi"])


def test_rows_of_beams() -> None:
    kiel = read_structure(find_structure("kiel"))
    assert repeat_beams(kiel, 3) == replace(kiel, actuator=None)
    five = repeat_beams(kiel, 5)
    assert [s.between for s in five.spring] == [(1, 2), (2, 3), (3, 4), (4, 5)]
    assert [p.beam for p in five.patch] == [1, 2, 2, 3, 4, 5, 5]


def test_json_of_the_verb(
    at_run_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("flexbeams.scenarios.bench.measure.BEAMS", (1, 2))
    assert main(["bench", "--steps", "40", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["steps"] == 40
    assert figures["design_id"] == design_of("kiel").design_id
    assert [loop["name"] for loop in figures["loops"]] == [
        "plant",
        "feedforward, moving",
        "feedforward, at rest",
        "controller",
        "closed loop",
    ]
    for loop in figures["loops"]:
        for variant in ("bare", "fmi", "runner", "numpy"):
            assert loop[variant].keys() == {"seconds", "us_per_step", "ratio"}
            assert loop[variant]["us_per_step"] == pytest.approx(1e6 * loop[variant]["seconds"] / 40)
    assert [t["transitions"] for t in figures["transitions"]] == [1, 8]
    assert figures["real_time"].keys() == {"steps", "median", "p99", "p99.99", "max", "limit", "over_limit"}
    assert [(g["beams"], g["states"], g["reduced_states"]) for g in figures["growth"]] == [(1, 20, 10), (2, 40, 20)]
    for grown in figures["growth"]:
        for unit in ("plant", "controller"):
            assert grown[unit].keys() == {"bare_us_per_step", "fmi_us_per_step", "ratio"}
    assert [f["cost"] for f in figures["plant_forms"]] == ["step", "step of a new length", "initialisation"]
    assert all(f["modal_us"] > 0 and f["dense_us"] > 0 for f in figures["plant_forms"])
    callers = figures["callers"]
    assert callers.keys() == {"units", "simulation", "overhead", "environment"}
    assert callers["simulation"] > callers["units"] > 0
    assert callers["overhead"] == pytest.approx(callers["simulation"] - callers["units"])
    assert callers["environment"] is None or callers["environment"] > callers["units"]
    assert len(figures["targets"]) == 8
    assert all(t["met"] == (t["measured"] <= t["limit"]) for t in figures["targets"])


def test_table_of_the_verb(
    at_run_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("flexbeams.scenarios.bench.measure.BEAMS", (1,))
    assert main(["bench", "--steps", "10"]) == 0
    shown = capsys.readouterr().out
    for text in (
        "closed loop",
        "FMI functions",
        "numpy",
        "growth",
        "dense",
        "targets",
        "from Python",
        "at most",
        "of 33",
        "from Python",
        "p99.99",
    ):
        assert text in shown


def test_steps_must_be_positive(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--steps", "0"]) == 2
    assert "x>=1" in capsys.readouterr().err


@pytest.mark.slow
def test_identifications_are_timed(capsys: pytest.CaptureFixture[str]) -> None:
    case = Case(structure="single_beam", seconds=2.0)
    fits = measure_identification([case])
    [figures] = fits["fits"]
    assert figures["structure"] == "single_beam"
    assert figures["parameters"] == 10
    assert figures["rows"] == 8000
    assert figures["cpu_s"] > 0
    assert figures["found"] >= 5
    show_identification(fits)
    assert "single_beam" in capsys.readouterr().out


def test_samples_of_a_study_cost_what_they_take(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyarrow")
    figures = sample_costs("zig", cache_folder(None), print, rounds=1)
    run = figures["run"]["seconds"]
    assert figures["steps"] == 30_000
    for name in ("units", "batch"):
        assert figures[name]["ratio"] == pytest.approx(figures[name]["seconds"] / run)
    show_samples(figures)
    assert f"{1e3 * figures['batch']['seconds']:.2f}" in capsys.readouterr().out
