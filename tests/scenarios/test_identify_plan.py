"""`flexbeams identify --plan`: the scenario that it writes runs, and its results give what was expected."""

import json
from pathlib import Path

import numpy as np
import pytest

import flexbeams as fb
from flexbeams.scenarios.api.plans import plan_experiment
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.results.files import read_results

TRUTH = fb.structure("single_beam").parameters()
KNOWN = {"beam[1].tip_mass": TRUTH["beam[1].tip_mass"]}


def run(*arguments: object) -> int:
    return main([str(a) for a in arguments])


@pytest.mark.slow
@pytest.mark.native
@pytest.mark.parametrize("signals", ["steps", "both"])
def test_plan_record_and_fit(tmp_path: Path, capsys: pytest.CaptureFixture[str], signals: str) -> None:
    file = tmp_path / "experiment.toml"
    known = ["--known", f"beam[1].tip_mass={KNOWN['beam[1].tip_mass']}"]
    options = ["--structure", "single_beam", *known, "--signals", signals, "--segments", 2, "--step", 4e-3, "--json"]
    assert run("identify", "--plan", *options, "--out", file) == 0
    shown = capsys.readouterr()
    plan = json.loads(shown.out)
    assert f"scenario written to {file}" in shown.err
    assert plan["mean_deviations"]["the plan"] <= min(plan["mean_deviations"].values())
    assert plan["largest_deflection"] <= 0.04 * (1 + 1e-9)
    assert run("run", file, "--no-report", "--no-figures", "--out", tmp_path / "data") == 0
    recorded = read_results(tmp_path / "data/results.csv")
    voltages = np.loadtxt(tmp_path / "experiment_voltages.csv", delimiter=",", skiprows=1)
    column = recorded.values[:, recorded.columns.index("plant.u[1]")]
    assert column[np.rint(voltages[:, 0] / 4e-3).astype(int)] == pytest.approx(voltages[:, 1], rel=1e-12)
    result = fb.identify(tmp_path / "data/results.csv", structure="single_beam", known=KNOWN)
    for parameter in result.fitted:
        assert abs(np.log(parameter.value / TRUTH[parameter.name])) < 4.5 * parameter.deviation
        assert parameter.deviation == pytest.approx(plan["deviations"][parameter.name], rel=0.25)


def test_equal_seeds_give_equal_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        plan_experiment(
            "single_beam", known=KNOWN, segments=2, step=5e-3, signals="steps", out=tmp_path / name / "one plan.toml"
        )
    for file in ("one plan.toml", "one plan_voltages.csv"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    text = (tmp_path / "a/one plan.toml").read_text()
    assert text.startswith("# ")
    assert 'structure = "single_beam"' in text


@pytest.mark.native
def test_a_structure_file_is_named_from_the_scenario_and_noise_by_sensor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig/mine.toml").write_text(
        (Path(fb.__file__).parents[1] / "plant/structures/single_beam.toml").read_text()
    )
    options = ["--known", "beam[1].tip_mass=0.025", "--noise", "y_pm[]=1e-6", "--noise", "y_pi[1]=1e-5"]
    options += ["--structure", tmp_path / "rig/mine.toml", "--limit", 300, "--deflection-limit", 0.002]
    options += ["--segments", 1, "--step", 5e-3, "--criterion", "A", "--signals", "sweeps"]
    assert run("identify", "plan", *options, "--out", tmp_path / "e.toml") == 0
    shown = capsys.readouterr().out
    assert "sweep to" in shown
    assert "largest deflection" in shown
    text = (tmp_path / "e.toml").read_text()
    assert 'structure = "rig/mine.toml"' in text
    assert 'of = "plant.y_pi[1]"\nnoise = 1e-5' in text.replace("1e-05", "1e-5")
    assert 'of = "plant.y_pm[2]"\nnoise = 1e-6' in text.replace("1e-06", "1e-6")
    assert np.max(np.abs(np.loadtxt(tmp_path / "e_voltages.csv", delimiter=",", skiprows=1)[:, 1])) <= 300
    assert run("run", tmp_path / "e.toml", "--no-report", "--no-figures", "--out", tmp_path / "data") == 0
    recorded = read_results(tmp_path / "data/results.csv")
    deflection = recorded.values[:, recorded.columns.index("plant.y_pi[1]")]
    assert 0.0015 < np.max(np.abs(deflection)) < 0.0021


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "weigh one part and give it, for example --known beam[1].tip_mass=0.025"),
        (["--known", "beam[1].tip_mass=0.025", "--limit", "0"], "--limit must be finite and > 0, got 0.0"),
        (["--known", "beam[1].tip_mass=0.025", "--step", "nan"], "--step must be finite and > 0"),
        (
            ["--known", "beam[1].tip_mass=0.025", "--deflection-limit", "-1"],
            "--deflection-limit must be finite",
        ),
        (["--known", "beam[1].tip_mass=0.025", "--noise", "y_mp[]=1"], "--noise y_mp[] is not a sensor"),
        (["--known", "beam[1].tip_mass=0.025", "--noise", "y_pm[]=0"], "--noise must be > 0"),
        (["--known", "beam[1].tip_mass=0.025", "--free", "beam[1].stiffness"], "--free: beam[1].stiffness is not a"),
        (["--known", "beam[1].tip_mass=0.025", "--segment-time", "0.001"], "--segment-time must be at least"),
    ],
)
def test_refusals_leave_nothing_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    out = tmp_path / "e.toml"
    assert run("identify", "--plan", "--structure", "single_beam", "--segments", 1, *arguments, "--out", out) == 2
    error = capsys.readouterr().err
    assert message in error
    assert not list(tmp_path.iterdir())
