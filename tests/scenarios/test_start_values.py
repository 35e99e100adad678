"""`flexbeams run --set`: one variable, an array or a family of parameters, and inputs that nothing drives."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.structure import find_structure, read_structure
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.results.files import read_results

pytestmark = pytest.mark.native

PLANT = """title = "at rest"
structure = "kiel"
stop_time = 0.02
[instance.plant]
unit = "BeamPlant"
[[input]]
to = "plant.u[1]"
step = { time = 0.01, value = 300.0 }
"""


@pytest.fixture
def run(at_run_folder: Path, tmp_path: Path, write_scenario: Callable[[str, str], Path]) -> Callable[..., bytes]:
    """Runs the plant with --set options; returns results.csv."""
    path = write_scenario("set", PLANT)

    def run(*values: str) -> bytes:
        options = [part for value in values for part in ("--set", value)]
        assert main(["run", str(path), "--out", str(tmp_path), "--no-figures", "--no-report", *options]) == 0
        return (tmp_path / "results.csv").read_bytes()

    return run


def test_a_family_sets_each_of_its_parameters(run: Callable[..., bytes]) -> None:
    beams = range(1, len(read_structure(find_structure("kiel")).beam) + 1)
    family = run("plant.beam[].tip_mass=0.05")
    assert family == run(*[f"plant.beam[{k}].tip_mass=0.05" for k in beams])
    assert family != run()
    assert run("plant.beam[].tip_mass=0.05,0.06,0.07") == run("plant.beam[].tip_mass=[0.05, 0.06, 0.07]")


def test_an_array_is_set_by_its_name(run: Callable[..., bytes]) -> None:
    whole = run("plant.start_at_rest_under=100,-200,0,50")
    assert whole == run(
        "plant.start_at_rest_under[1]=100", "plant.start_at_rest_under[2]=-200", "plant.start_at_rest_under[4]=50"
    )
    assert whole != run()


def test_the_later_option_wins(run: Callable[..., bytes]) -> None:
    assert run("plant.beam[].tip_mass=0.05", "plant.beam[2].tip_mass=0.02") == run(
        "plant.beam[1].tip_mass=0.05", "plant.beam[3].tip_mass=0.05", "plant.beam[2].tip_mass=0.02"
    )


def test_an_input_that_nothing_drives_holds_its_value(run: Callable[..., bytes], tmp_path: Path) -> None:
    run("plant.force[2]=0.25", "plant.u[3]=40")
    recording = read_results(tmp_path / "results.csv")
    for name, value in (("plant.force[1]", 0.0), ("plant.force[2]", 0.25), ("plant.u[3]", 40.0)):
        np.testing.assert_array_equal(recording.values[:, recording.columns.index(name)], value)
    assert np.max(np.abs(recording.values[:, recording.columns.index("plant.y_pi[3]")])) > 1e-6
    assert json.loads((tmp_path / "summary.json").read_text())["set"] == {"plant.force[2]": 0.25, "plant.u[3]": 40.0}


@pytest.mark.parametrize(
    ("value", "complaint"),
    [
        ("plant.u[1]=5", "--set must not set an input that the scenario drives, got 'plant.u[1]'"),
        ("plant.u=5", "--set must not set an input that the scenario drives, got 'plant.u'"),
        ("plant.u[]=5", "--set must not set an input that the scenario drives, got 'plant.u[]'"),
        ("plant.beam[].tip_mass=1,2", "--set plant.beam[].tip_mass must have 3 values, got [1.0, 2.0]"),
        ("plant.beam[1].tip_mass=-1", "--set plant.beam[1].tip_mass must be from 0.0 to 10000.0, got -1.0"),
        (
            "plant.beam[].mass=1",
            "--set plant.beam[].mass is not a variable; did you mean 'beam[].tip_mass'? (valid: u,",
        ),
        ("plant.y_pi[1]=1", "--set plant.y_pi[1] is not settable, got 'y_pi[1]'"),
        ("plant.noise_seed=1.5", "--set plant.noise_seed must be of type Integer, got 1.5"),
        ("plnt.u[2]=1", "--set names an unknown instance 'plnt'; did you mean 'plant'?"),
        ("plant.u[2]=1,,2", "--set plant.u[2] must be of type Real, got '1,,2'"),
        ("plant.u[2]=1,inf", "plant.u[2] must be finite, got '1,inf'"),
        ("plant=1", "must be INSTANCE.VARIABLE=VALUE, got 'plant=1'"),
    ],
)
def test_refused_values(
    at_run_folder: Path,
    tmp_path: Path,
    write_scenario: Callable[[str, str], Path],
    value: str,
    complaint: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = write_scenario("set", PLANT)
    assert main(["run", str(path), "--out", str(tmp_path / "out"), "--set", value]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert complaint in errors[-1]
    assert all(line.startswith("building") for line in errors[:-1])
