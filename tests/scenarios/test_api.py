"""The public names of `flexbeams`."""

import subprocess
from pathlib import Path

import numpy as np
import pytest

import flexbeams as fb
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.processes.children import python_command, python_environment
from flexbeams.scenarios.runs.scenario import run_scenario

HEAVY = ("numpy", "scipy", "click", "pydantic", "fmpy", "importlib.metadata")


def test_importing_the_package_imports_nothing_heavy() -> None:
    code = f"import sys, flexbeams; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run(
        python_command("-c", code), capture_output=True, text=True, check=True, env=python_environment()
    )
    assert done.stdout.strip() == "[]"


def test_every_public_name_is_there() -> None:
    assert set(fb.__all__) <= set(dir(fb))
    for name in fb.__all__:
        assert getattr(fb, name)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        fb.nothing  # noqa: B018


@pytest.mark.slow
def test_run_is_that_of_the_scenario(at_run_folder: Path) -> None:
    run = fb.run("step_response", start={"plant.beam[1].tip_mass": 0.03}, stop_time=1.1, decimate=10)
    settings = Settings(overrides={"plant.beam[1].tip_mass": 0.03}, stop_time=1.1, decimate=10)
    expected = run_scenario("step_response", settings).recording
    np.testing.assert_array_equal(run.recording.values, expected.values)
    assert run.recording.columns == expected.columns


def test_design_of_names_and_structures() -> None:
    by_name = fb.design("single_beam", reduced_modes=4)
    assert by_name.summary["reduced_order"] == 8
    assert fb.design(fb.structure("single_beam"), reduced_modes=4).design_id == by_name.design_id


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fb.run("trackin"), "'trackin' is neither a file nor a shipped scenario; did you mean 'tracking'?"),
        (lambda: fb.run("tracking", stop_time=-1.0), "--stop-time must be finite and > 0, got -1.0"),
        (lambda: fb.run("tracking", decimate=0), "--decimate must be >= 1, got 0"),
        (lambda: fb.structure("kil"), "'kil' is neither a file nor a shipped structure; did you mean 'kiel'?"),
        (lambda: fb.design(reduced_mode=4), "design: reduced_mode is not a known key; did you mean 'reduced_modes'?"),
        (lambda: fb.export("tracking", format="sspp"), "format must be one of ssp, "),  # type: ignore[arg-type]
        (lambda: fb.export("tracking", "a.fmu", parts=("plant",), format="ssp"), "--parts belongs to --format closed"),
        (lambda: fb.compare("results"), "RUN must be at least two folders of results, got 1"),
    ],
)
def test_mistakes(call: object, message: str) -> None:
    with pytest.raises(fb.FlexbeamsError) as caught:
        call()  # type: ignore[operator]
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_build_refuses_an_unknown_unit() -> None:
    with pytest.raises(fb.FlexbeamsError, match="UNIT is not a unit; did you mean 'BeamPlant'"):
        fb.build(fb.design("single_beam"), ["BeamPlan"])
