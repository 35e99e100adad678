"""The shipped scenarios and what a run leaves: results.csv, summary.json, the verdict."""

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.scenario_file import find_scenario, read_scenario, scenario_files
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.runs.scenario import run_scenario
from tests.helpers import STRUCTURES, design_of

pytestmark = pytest.mark.native

Write = Callable[[str, str], Path]
NAMES = (
    "step_response",
    "feedforward",
    "tracking",
    "disturbance_open_loop",
    "disturbance",
    "disturbance_tuned",
    "retarget",
    "high_fidelity",
    "high_fidelity_exact_statics",
    "mismatch",
    "offset_free",
    "offset_free_high_fidelity",
    "identification_steps",
    "identified",
    "identified_offset_free",
    "hysteresis",
    "hysteresis_compensated",
    "hysteresis_imperfect",
    "hysteresis_offset_free",
    "creep_uncompensated",
    "creep",
    "single_beam",
    "five_beams",
)
INSTANCES = ("feedforward", "controller", "compensator", "actuator", "plant")
SAMPLE = 2e-4
PLANT = """# A plant under constant voltages.
# It shows what the tests need.
title = "Voltages"
paper = "Fig. 0"
structure = "kiel"
stop_time = 0.1
[instance.plant]
unit = "BeamPlant"
[[input]]
to = "plant.u"
constant = [817.0, -770.0, -807.0, 781.0]
"""


def test_these_scenarios_ship() -> None:
    assert tuple(scenario_files()) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_shipped_scenario_holds_its_checks(at_run_folder: Path, name: str) -> None:
    run = run_scenario(name, Settings(record_animation=False), designs=[design_of(s) for s in STRUCTURES])
    assert run.passed, [(o.name, o.value, o.minimum, o.maximum) for o in run.outcomes if not o.passed]
    assert run.recording.complete
    assert run.outcomes
    assert any(o.minimum is not None or o.maximum is not None for o in run.outcomes)
    assert np.isfinite([o.value for o in run.outcomes]).all()


@pytest.mark.parametrize("name", NAMES)
def test_shipped_file_says_what_it_shows(name: str) -> None:
    scenario = read_scenario(find_scenario(name))
    assert find_scenario(name).read_text(encoding="utf-8").startswith("# ")
    assert list(scenario.instance) == [n for n in INSTANCES if n in scenario.instance]
    assert scenario.coupling == "jacobi"
    assert scenario.figure
    assert len({check.name for check in scenario.check}) == len(scenario.check)


# results.csv


@pytest.fixture(scope="module")
def tracking(run_folder: Path) -> tuple[Run, Path]:
    """A run of `tracking` by the command line in a folder, and the same in memory."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(run_folder)
        assert main(["run", "tracking", "--out", "tracked", "--no-figures", "--no-report"]) == 0
        return run_scenario("tracking", Settings(record_animation=False), designs=[design_of()]), run_folder / "tracked"


def test_columns_are_every_output_but_x_ref_and_the_plants_inputs(tracking: tuple[Run, Path]) -> None:
    header = (tracking[1] / "results.csv").read_text().partition("\n")[0]
    assert header.split(",") == ["time"] + [
        f"{owner}.{name}" + (f"[{k}]" if count else "")
        for owner, name, count in (
            ("feedforward", "u_ff", 4),
            ("feedforward", "y_ref", 4),
            ("feedforward", "moving", 0),
            ("controller", "u", 4),
            ("controller", "y_est", 4),
            ("controller", "saturated", 0),
            ("plant", "u", 4),
            ("plant", "force", 3),
            ("plant", "y_pi", 4),
            ("plant", "y_pm", 6),
        )
        for k in range(1, max(count, 1) + 1)
    ]


def test_row_k_holds_the_values_at_k_steps(tracking: tuple[Run, Path]) -> None:
    """From the initial state on; doubles survive bit for bit."""
    run, folder = tracking
    with (folder / "results.csv").open(newline="") as file:
        rows = [[float(cell) for cell in row] for row in list(csv.reader(file))[1:]]
    table = np.array(rows)
    np.testing.assert_array_equal(table[:, 0], np.arange(30001) / 5000)
    np.testing.assert_array_equal(table[:, 1:], run.recording.values)
    assert not table[0].any()
    # The plant's input of a row is the controller's output of that row
    columns = ["time", *run.recording.columns]
    u = [columns.index(f"controller.u[{k}]") for k in range(1, 5)]
    np.testing.assert_array_equal(table[:, [columns.index(f"plant.u[{k}]") for k in range(1, 5)]], table[:, u])
    again = read_results(folder / "results.csv")
    assert again.columns == run.recording.columns
    np.testing.assert_array_equal(again.values, run.recording.values)
    np.testing.assert_array_equal(again.time, run.recording.time)


def test_summary(tracking: tuple[Run, Path]) -> None:
    run, folder = tracking
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["scenario"] == "tracking"
    assert summary["design_id"] == design_of().design_id
    assert (summary["coupling"], summary["backend"], summary["complete"]) == ("jacobi", "native", True)
    assert [set(check) for check in summary["checks"]] == [{"name", "value", "limit", "unit", "paper", "passed"}] * 4
    assert [(c["name"], c["value"], c["limit"]) for c in summary["checks"]] == [
        (o.name, o.value, o.maximum) for o in run.outcomes
    ]
    assert all(c["passed"] is True for c in summary["checks"])
    timing = summary["timing"]
    assert timing["steps"] == 30000
    assert timing["real_time_factor"] == pytest.approx(6.0 / timing["wall_s"])
    y = run.recording.values[:, run.recording.columns.index("plant.y_pi[2]")]
    assert summary["metrics"]["plant.y_pi[2].end"] == y[-1]
    assert summary["metrics"]["plant.y_pi[2].largest"] == np.abs(y).max()
    assert summary["metrics"]["settled after"] == run.outcomes[2].value


def test_runs_are_repeatable(tracking: tuple[Run, Path], tmp_path: Path, at_run_folder: Path) -> None:
    """The same bytes again."""
    assert main(["run", "tracking", "--out", str(tmp_path), "--no-figures", "--no-report"]) == 0
    assert (tmp_path / "results.csv").read_bytes() == (tracking[1] / "results.csv").read_bytes()


# More of a scenario, and less


def results(path: Path, *options: object, out: Path, status: int = 0) -> dict[str, np.ndarray]:
    """Runs a scenario and returns the columns of its results."""
    assert main(["run", str(path), "--out", str(out), "--no-figures", "--no-report", *map(str, options)]) == status
    recording = read_results(out / "results.csv")
    return {"time": recording.time, **dict(zip(recording.columns, recording.values.T, strict=True))}


def summary_of(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "summary.json").read_text()))


def test_record_adds_states_parameters_and_inputs(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    """Columns in the order of the variables; a name with a comma is quoted."""
    text = PLANT.replace(
        "[instance.plant]",
        'record = ["plant.energy", "plant.w", "plant.spring[2].stiffness", '
        '"plant.noise_seed", "plant.time"]\n[instance.plant]',
    )
    found = results(write_scenario("more", text), out=tmp_path)
    assert '"plant.w[3,21]"' in (tmp_path / "results.csv").read_text().partition("\n")[0]
    assert list(found)[:3] == ["time", "plant.time", "plant.u[1]"]
    assert list(found)[-4:] == ["plant.w[3,21]", "plant.energy", "plant.spring[2].stiffness", "plant.noise_seed"]
    np.testing.assert_allclose(found["plant.time"], found["time"], rtol=1e-14)
    assert set(found["plant.spring[2].stiffness"]) == {10.4}
    assert found["plant.energy"][0] == 0
    assert np.all(found["plant.energy"][1:] > 0)


def test_recorded_inputs_that_nothing_drives(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    """They hold their start values: those of the unit, of the scenario, of --set."""
    text = PLANT[: PLANT.index("[[input]]")] + "start.u = [1.0, 2.0, 3.0, 4.0]\n"
    found = results(write_scenario("open", text), "--set", "plant.force[2]=0.25", out=tmp_path)
    assert [found[f"plant.u[{k}]"].tolist() for k in range(1, 5)] == [[float(k)] * 501 for k in range(1, 5)]
    assert set(found["plant.force[2]"]) == {0.25}
    assert found["plant.y_pi[3]"][-1] > 1e-4


def test_step_and_start_values_of_a_scenario(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    """At rest under the voltages that are applied, at a coarse step: nothing moves."""
    text = PLANT.replace("stop_time", "step = 0.01\nstop_time").replace(
        '"BeamPlant"', '"BeamPlant"\nstart.start_at_rest_under = [817.0, -770.0, -807.0, 781.0]'
    )
    found = results(write_scenario("rest", text), out=tmp_path)
    np.testing.assert_allclose(found["time"], 0.01 * np.arange(11), rtol=1e-15)
    for k, y in enumerate((-8e-3, 1e-3, 4e-3, -6e-3), 1):
        np.testing.assert_allclose(found[f"plant.y_pi[{k}]"], y, rtol=1e-7)  # (48) of the paper


def test_coupling_by_option(at_run_folder: Path, tmp_path: Path) -> None:
    """Gauss-Seidel saves the sample between feedforward and controller, and that between controller and plant."""
    both = {
        coupling: results(
            Path("tracking"), "--stop-time", "1.5", "--coupling", coupling, out=tmp_path / coupling, status=1
        )
        for coupling in ("jacobi", "gauss-seidel")
    }
    for coupling in both:
        assert summary_of(tmp_path / coupling)["coupling"] == coupling
    y = {coupling: found["plant.y_pi[1]"] for coupling, found in both.items()}
    shift = {lag: np.abs(y["jacobi"][lag:] - y["gauss-seidel"][: len(y["jacobi"]) - lag]).max() for lag in range(4)}
    assert min(shift, key=lambda lag: shift[lag]) == 2
    assert shift[2] < 0.05 * shift[0]


def test_basis_by_option(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    """Design and plant change; the segment basis knows the exact static deflection."""
    text = PLANT.replace('"BeamPlant"', '"BeamPlant"\nstart.start_at_rest_under = [817.0, -770.0, -807.0, 781.0]')
    found = results(write_scenario("basis", text), "--basis", "segment", out=tmp_path)
    assert summary_of(tmp_path)["design_id"] == design_of("kiel", "segment").design_id
    exact = np.linalg.pinv(design_of("kiel", "segment").arrays["static_inverse"]) @ [817.0, -770.0, -807.0, 781.0]
    np.testing.assert_allclose([found[f"plant.y_pi[{k}]"][-1] for k in range(1, 5)], exact, rtol=1e-6)
    assert not np.allclose(exact, [-8e-3, 1e-3, 4e-3, -6e-3], rtol=0.02)


def test_structure_by_option(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    from flexbeams.plant.structure import find_structure

    softer = find_structure("kiel").read_text(encoding="utf-8").replace("stiffness = 7.53", "stiffness = 1.0")
    (tmp_path / "softer.toml").write_text(softer, encoding="utf-8")
    path = write_scenario("structure", PLANT)
    here = results(path, out=tmp_path / "shipped")
    there = results(path, "--structure", tmp_path / "softer.toml", out=tmp_path / "own")
    # Also beside the scenario, by name
    own = write_scenario("own", PLANT.replace('"kiel"', '"softer.toml"'))
    np.testing.assert_array_equal(results(own, out=tmp_path / "file")["plant.y_pi[1]"], there["plant.y_pi[1]"])
    assert np.abs(here["plant.y_pi[1]"] - there["plant.y_pi[1]"]).max() > 1e-5
    assert summary_of(tmp_path / "shipped")["design_id"] != summary_of(tmp_path / "own")["design_id"]


def test_set_by_option_is_as_in_the_scenario(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    """--set comes last: after factors and start values of the file."""
    path = write_scenario(
        "set",
        PLANT.replace(
            '"BeamPlant"', '"BeamPlant"\nscale."spring[].stiffness" = 2.0\nstart."spring[1].stiffness" = 3.0'
        ),
    )
    found = results(
        path, "--set", "plant.spring[2].stiffness=4", "--set", "plant.beam[].tip_mass=0.05", out=tmp_path / "a"
    )
    same = write_scenario(
        "same",
        PLANT.replace(
            '"BeamPlant"',
            '"BeamPlant"\nstart = {"spring[1].stiffness" = 3.0, "spring[2].stiffness" = 4.0, '
            '"beam[1].tip_mass" = 0.05, "beam[2].tip_mass" = 0.05, "beam[3].tip_mass" = 0.05}',
        ),
    )
    expected = results(same, out=tmp_path / "b")
    for name, values in found.items():
        np.testing.assert_array_equal(values, expected[name])
    assert summary_of(tmp_path / "a")["set"] == {"plant.spring[2].stiffness": 4.0, "plant.beam[].tip_mass": 0.05}


# The verdict


def test_failed_check_is_named(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    checks = "".join(
        f'[[check]]\nname = "{name}"\nmeasure = "largest"\nof = "plant.u"\nunit = "V"\n{limit}\n'
        for name, limit in (("low [m] enough", "max = 800.0"), ("high enough", "min = 800.0"), ("only told", ""))
    )
    path = write_scenario("verdict", PLANT + checks)
    assert main(["run", str(path), "--out", str(tmp_path / "a[/b]"), "--no-figures", "--no-report"]) == 1
    shown = capsys.readouterr().out
    rows = {
        cells[0].strip(): [c.strip() for c in cells[1:]]
        for line in shown.splitlines()
        if len(cells := line.split("│")[1:-1]) == 5
    }
    assert rows == {
        "low [m] enough": ["817 V", "<= 800 V", "", "FAILED"],
        "high enough": ["817 V", ">= 800 V", "", "ok"],
        "only told": ["817 V", "", "", ""],
    }
    assert "verdict: Voltages (paper: Fig. 0)" in shown
    assert f"results in {tmp_path / 'a[/b]'}" in shown
    assert [c["passed"] for c in summary_of(tmp_path / "a[/b]")["checks"]] == [False, True, True]


def test_measures_on_a_known_response(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    """Each measure of a check on the run's own columns, against what numpy makes of them."""
    kinds = {
        "largest": 'measure = "largest"\nof = "plant.y_pi"\npoints = [2, 4]\nafter = 0.02\nbefore = 0.05',
        "end": 'measure = "end_deviation"\nof = "plant.y_pi[3]"\nreference = [4e-3]',
        "change": 'measure = "largest_change"\nof = "plant.y_pm"',
        "overshoot": 'measure = "overshoot"\nof = "plant.y_pi"\nreference = [-1e-3, 1e-3, 1e-3, -1e-3]',
        "percent": 'measure = "overshoot_percent"\nof = "plant.y_pi[1]"\nreference = [-1e-3]',
        "from start": 'measure = "largest"\nof = "plant.y_pi"\nreference = "start"\nafter = 0.05',
        "from end": 'measure = "largest"\nof = "plant.y_pi"\nreference = "end"',
        "settled": 'measure = "settling_time"\nof = "plant.y_pi[1]"\nreference = "end"\nshare = 0.1\nafter = 0.01',
    }
    text = PLANT + "".join(f'[[check]]\nname = "{name}"\n{rest}\n' for name, rest in kinds.items())
    found = results(write_scenario("measures", text), out=tmp_path)
    value = {c["name"]: c["value"] for c in summary_of(tmp_path)["checks"]}
    time, y = found["time"], np.array([found[f"plant.y_pi[{k}]"] for k in range(1, 5)])
    window = (time >= 0.02 - 1e-9) & (time <= 0.05 + 1e-9)
    late = time >= 0.05 - 1e-9
    deviation = np.abs(y[0] - y[0, -1])
    assert value == pytest.approx(
        {
            "largest": np.abs(y[[1, 3]][:, window]).max(),
            "end": abs(y[2, -1] - 4e-3),
            "change": max(np.abs(np.diff(found[f"plant.y_pm[{k}]"])).max() for k in range(1, 7)),
            "overshoot": max(max(0.0, (s * y[k] - 1e-3).max()) for k, s in enumerate((-1, 1, 1, -1))),
            "percent": 100 * ((-y[0]).max() - 1e-3) / 1e-3,
            "from start": np.abs(y[:, late] - y[:, late][:, :1]).max(),
            "from end": np.abs(y - y[:, -1:]).max(),
            "settled": time[np.flatnonzero(deviation > 0.1 * abs(y[0, -1]))[-1]] - 0.01,
        },
        rel=1e-12,
    )


TARGETS = """title = "Targets"
structure = "kiel"
stop_time = 0.4
[instance.feedforward]
unit = "FlatnessFeedforward"
[[input]]
to = "feedforward.y_target"
targets = [{ time = 0.1, value = [-1e-3, 0.0, 2e-3, 0.0] }, { time = 0.3, value = [0.0, 0.0, 0.0, 5e-3] }]
"""


@pytest.mark.parametrize(
    ("check", "value"),
    [
        ("", 5e-3),
        ("before = 0.3", 2e-3),
        ("before = 0.1", 0.0),
        ("points = [4]", 5e-3),
        ("points = [3]\nbefore = 0.25", 2e-3),
    ],
)
def test_check_against_the_target_in_force(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write, check: str, value: float
) -> None:
    """The one that holds at the end of the window; seen here against a reference that has not moved yet."""
    text = TARGETS.replace('"FlatnessFeedforward"', '"FlatnessFeedforward"\nstart.transition_time = 1000.0')
    path = write_scenario(
        "target",
        text + '[[check]]\nname = "c"\nmeasure = "end_deviation"\nof = "feedforward.y_ref"\n'
        f'reference = "target"\n{check}\n',
    )
    results(path, out=tmp_path)
    assert summary_of(tmp_path)["checks"][0]["value"] == pytest.approx(value, abs=1e-9)


def test_check_of_one_element_against_its_target(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    text = TARGETS.replace('"FlatnessFeedforward"', '"FlatnessFeedforward"\nstart.transition_time = 1000.0')
    path = write_scenario(
        "target",
        text + '[[check]]\nname = "c"\nmeasure = "end_deviation"\nreference = "target"\n'
        'of = "feedforward.y_ref[3]"\nbefore = 0.2\n',
    )
    results(path, out=tmp_path)
    assert summary_of(tmp_path)["checks"][0]["value"] == pytest.approx(2e-3, abs=1e-9)


def test_checks_that_a_shorter_run_does_not_reach(
    at_run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are left out, and that is told; the target in force is the one at the new end."""
    found = results(Path("tracking"), "--stop-time", "0.5", out=tmp_path)
    shown = capsys.readouterr()
    assert shown.err.splitlines()[-2:] == [
        "check 'largest error from T on' is left out: it looks at 1.9 s",
        "check 'settled after' is left out: it looks at 1 s",
    ]
    assert [c["name"] for c in summary_of(tmp_path)["checks"]] == ["error at the end", "largest voltage"]
    assert found["time"][-1] == 0.5


def test_without_static_correction_the_run_shows_the_papers_offset(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write
) -> None:
    """The feedforward alone lands some tenths of a millimetre off, the filter pulls further; the checks tell."""
    letter = '[design]\nstatic_correction = false\nstatic_gain = "reduced"\n[instance.feedforward]'
    error = {}
    for name in ("feedforward", "tracking"):
        text = find_scenario(name).read_text(encoding="utf-8").replace("[instance.feedforward]", letter)
        results(write_scenario(name, text), out=tmp_path / name, status=1)
        checks = {c["name"]: c for c in summary_of(tmp_path / name)["checks"]}
        assert checks["error at the end"]["passed"] is False
        error |= {
            name: checks["error at the end"]["value"],
            "after T": checks.get("largest error from T on", {}).get("value"),
        }
    assert 1e-4 < error["feedforward"] < 5e-4
    assert 1e-4 < error["tracking"] < error["after T"] < 1.5e-3
    assert error["after T"] > error["feedforward"]


def test_what_units_say_is_passed_on(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    """A transition stretched to keep the limit; a target that is in reach at rest but not on the way."""
    path = write_scenario(
        "stretched",
        TARGETS.replace("start.", "").replace(
            '"FlatnessFeedforward"', '"FlatnessFeedforward"\nstart.transition_time = 0.1'
        ),
    )
    results(path, out=tmp_path)
    notes = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("building")]
    assert len(notes) == 2
    for note, start in zip(notes, ("0.125", "0.325"), strict=True):
        assert re.fullmatch(
            rf"feedforward: the transition at {start} s is stretched from 0.1 s to 0\.\d+ s to stay "
            r"within 1000\.0 V",
            note,
        )


def test_figures_of_a_mismatched_plant_differ_from_the_nominal_ones(at_run_folder: Path) -> None:
    """`mismatch` changes the plant only: the design is the nominal one, the error is that of the model."""
    run = run_scenario("mismatch", Settings(record_animation=False), designs=[design_of()])
    assert run.design.design_id == design_of().design_id
    value = {o.name: o.value for o in run.outcomes}
    assert 1e-4 < value["error at the end"] < 5e-3


def test_decay_is_sooner_than_the_open_loops(at_run_folder: Path) -> None:
    run = run_scenario("disturbance", Settings(record_animation=False), designs=[design_of()])
    value = {o.name: o.value for o in run.outcomes}
    alone = run_scenario("disturbance_open_loop", Settings(record_animation=False), designs=[design_of()])
    decay = next(o.value for o in alone.outcomes if o.name.startswith("decay"))
    factor = decay / value["decay to 2 % of the open loop's peak"]
    assert value["sooner than the open loop by a factor"] == pytest.approx(factor)
    assert value["open loop's peak"] == next(o.value for o in alone.outcomes if o.name == "largest deflection")


def test_names_of_any_kind(at_run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Letters beyond ASCII, blanks, and what rich would take for markup."""
    path = tmp_path / "a [b] ü.toml"
    text = PLANT.replace('"Voltages"', '"Größe [m] [/b] 𝜑"').replace("plant.u", "plänt.u")
    path.write_text(text.replace("[instance.plant]", '[instance."plänt"]'), encoding="utf-8")
    out = tmp_path / "o [/x] ü"
    assert main(["run", str(path), "--out", str(out)]) == 0
    shown = capsys.readouterr().out
    assert shown.startswith("a [b] ü: Größe [m] [/b] 𝜑 (paper: Fig. 0)\n")
    assert shown.endswith(f"; results in {out}\n")
    assert summary_of(out)["title"] == "Größe [m] [/b] 𝜑"
    assert read_results(out / "results.csv").columns[0] == "plänt.u[1]"


def test_new_run_replaces_figures_of_an_earlier_one(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    """Nothing of another run is left beside the new results."""
    path = write_scenario("again", PLANT + '[[figure]]\nfile = "own"\nrows = [["plant.y_pi"]]\n')
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "own.png",
        "own.svg",
        "report.html",
        "results.csv",
        "summary.json",
    ]
    assert main(["run", str(path), "--out", str(tmp_path / "out"), "--no-figures", "--no-report"]) == 0
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["results.csv", "summary.json"]
