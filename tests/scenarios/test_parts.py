"""Some units of a scenario as one unit, its signals inside or in a file beside it, flags as Real."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.util import read_csv

from flexbeams.plant.basis import Array
from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.closed_loop import export_closed_loop
from flexbeams.scenarios.runs.scenario import run_scenario
from tests.native.workshop import needs_zig, workspace
from tests.units.loaded import loaded

pytestmark = needs_zig
STEP = 2e-4
STOPS = {"tracking": 1.2, "single_beam": 1.2, "five_beams": 1.2, "disturbance": 1.1}  # s, into the motions
WITH_RIG = """title = "x"
structure = "{structure}"
stop_time = {stop}
[instance.rig]
fmu = "rig.fmu"
[instance.plant]
unit = "BeamPlant"
[[connection]]
from = "rig.u"
to = "plant.u"
[[connection]]
from = "plant.y_pm"
to = "rig.y_pm"
"""
STRUCTURES = {"tracking": "kiel", "single_beam": "single_beam", "five_beams": "five_beams"}


def settings(**changed: Any) -> Settings:
    return Settings(record_animation=False, build_folder=workspace() / "build", **changed)


def exported(folder: Path, scenario: str, **options: Any) -> Path:
    return export_closed_loop(scenario, folder / "rig.fmu", settings(stop_time=STOPS[scenario]), **options)


def expected(scenario: str) -> dict[str, Array]:
    recording = run_scenario(scenario, settings(stop_time=STOPS[scenario])).recording
    return dict(zip(recording.columns, recording.values.T, strict=True))


@pytest.mark.parametrize("scenario", STRUCTURES)
def test_feedforward_and_controller_beside_the_plant(
    scenario: str, tmp_path: Path, write_scenario: Callable[[str, str], Path]
) -> None:
    """What the rig of the paper needs: strains and targets in, voltages out; it moves a plant as the three units do."""
    rig = exported(tmp_path, scenario, parts=["controller", "feedforward"], with_signals=True)
    description = fmpy.read_model_description(str(rig))
    assert description.modelName == "BeamFeedforwardController"
    arrays: dict[str, set[str]] = {}
    for v in description.modelVariables:
        arrays.setdefault(v.causality, set()).add(v.name.partition("[")[0])
    assert arrays["input"] == {"y_pm"}
    assert {"u", "y_est", "y_ref", "u_ff", "moving", "saturated", "y_target"} == arrays["output"]
    assert "feedforward.transition_time" in arrays["parameter"]
    text = WITH_RIG.format(structure=STRUCTURES[scenario], stop=STOPS[scenario])
    path = write_scenario("outer", text)
    (path.parent / "rig.fmu").write_bytes(rig.read_bytes())
    recording = run_scenario(str(path), settings()).recording
    wanted = expected(scenario)
    for name in (c for c in wanted if c.startswith(("plant.y_pi", "controller.u["))):
        own = recording.values[:, recording.columns.index(name.replace("controller.", "rig."))]
        assert np.max(np.abs(wanted[name])) > 0
        np.testing.assert_allclose(own, wanted[name], rtol=0, atol=1e-12 * np.max(np.abs(wanted[name])))


@pytest.mark.parametrize("scenario", ["tracking", "disturbance"])
def test_the_whole_loop_with_its_signals_inside(scenario: str, tmp_path: Path) -> None:
    loop = exported(tmp_path, scenario, with_signals=True)
    assert not (tmp_path / "rig_in.csv").exists()
    wanted = expected(scenario)
    outputs = [f"y_pi[{k}]" for k in (1, 2, 3, 4)]
    result = fmpy.simulate_fmu(
        str(loop), stop_time=STOPS[scenario], step_size=STEP, output_interval=STEP, output=outputs
    )
    for name in outputs:
        scale = np.max(np.abs(wanted[f"plant.{name}"]))
        np.testing.assert_allclose(result[name], wanted[f"plant.{name}"], rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("scenario", ["tracking", "disturbance"])
def test_the_file_beside_the_unit_has_its_signals(
    scenario: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As FMPy's command reads it; the rows are few, their times increase, and those between steps do not matter."""
    out = tmp_path / "loop.fmu"
    assert main(["export", scenario, "-o", str(out), "--stop-time", str(STOPS[scenario])]) == 0
    file = tmp_path / "loop_in.csv"
    assert str(file) in capsys.readouterr().err
    signals = read_csv(str(file))
    assert np.all(np.diff(signals["time"]) > 0)
    assert signals["time"][[0, -1]].tolist() == [0.0, STOPS[scenario]]
    if scenario == "tracking":
        assert len(signals) == 4
        assert signals.dtype.names == ("time", *(f"y_target[{k}]" for k in (1, 2, 3, 4)))
    outputs = [f"y_pi[{k}]" for k in (1, 2, 3, 4)]
    done = subprocess.run(
        [sys.executable, "-m", "fmpy", "simulate", str(out), "--input-file", str(file), "--output-file"]
        + [str(tmp_path / "out.csv"), "--stop-time", str(STOPS[scenario]), "--output-interval", str(STEP)]
        + ["--output-variables", *outputs],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result, wanted = read_csv(str(tmp_path / "out.csv")), expected(scenario)
    for name in outputs:
        scale = np.max(np.abs(wanted[f"plant.{name}"]))
        assert scale > 0
        np.testing.assert_allclose(result[name], wanted[f"plant.{name}"], rtol=0, atol=1e-12 * scale)


def test_parts_without_signals_and_with_two_names(tmp_path: Path) -> None:
    rig = exported(tmp_path, "tracking", parts=["feedforward", "plant"])
    names = {v.name: v.causality for v in fmpy.read_model_description(str(rig)).modelVariables}
    assert names["u[1]"] == names["y_target[1]"] == names["force[1]"] == "input"
    assert names["u_ff[1]"] == names["x_ref[30]"] == "output"  # for a controller outside
    assert (tmp_path / "rig_in.csv").read_text().startswith('"time","y_target[1]"')
    plants = exported(tmp_path, "tracking", parts=["plant"])
    assert not any(
        "." in v.name
        for v in fmpy.read_model_description(str(plants)).modelVariables
        if v.causality in ("input", "output")
    )


def test_flags_as_real(tmp_path: Path) -> None:
    """A host that reads and writes everything as Real goes through all of it."""
    loop = exported(tmp_path, "tracking", flags_as_real=True)
    fmpy.extract(str(loop), unzipdir=str(tmp_path / "loop"))
    with loaded(tmp_path / "loop") as unit:
        outputs = [
            v.valueReference
            for v in unit.variables.values()
            if v.causality == "output" or (v.causality == "local" and v.type == "Real")
        ]
        flags = [unit.variables[n].valueReference for n in ("moving", "saturated")]
        assert {unit.variables[n].type for n in ("moving", "saturated")} == {"Real"}
        unit.begin()
        seen = set()
        for k in range(1000):
            unit.advance(STEP, y_target=[-8e-3 * (k > 10), 0.0, 0.0, 0.0])
            unit.call("getReal", outputs)
            seen.add(tuple(unit.call("getReal", flags)))
        assert {flag[0] for flag in seen} == {0.0, 1.0}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--parts", "feedforward,control"], "--parts must name instances of the scenario; did you mean 'controller'"),
        (
            ["--parts", "plant", "--format", "ssp"],
            "--parts belongs to --format closed-loop, not ssp",
        ),
        (
            ["--ssp-version", "2.0", "--format", "closed-loop"],
            "--ssp-version belongs to --format ssp, not closed-loop",
        ),
    ],
)
def test_mistakes(arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "tracking", *arguments, "-o", str(tmp_path / "x.fmu")]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_part(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--parts must name instances of the scenario"):
        exported(tmp_path, "tracking", parts=["rig"])
