"""The verb identify: options, tables, files and refusals."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import flexbeams as fb
from flexbeams.plant.galerkin import beam_model
from flexbeams.plant.identification.experiment import sensor_names
from flexbeams.plant.statespace import static_gains
from flexbeams.plant.static_maps import read_static_maps
from flexbeams.plant.structure import STRUCTURES_FOLDER, read_structure
from flexbeams.scenarios.cli.main import main
from tests.plant.identification.data import PATTERNS, kiel, measured, steps

SHIPPED = STRUCTURES_FOLDER / "single_beam.toml"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three recordings of the shipped beam and a start that is off."""
    folder = tmp_path_factory.mktemp("rig")
    structure = read_structure(SHIPPED)
    sensors = sensor_names(structure)
    experiments = steps(np.array([[700.0], [-400.0], [250.0]]), len(sensors), rows=900, step=5e-3)
    data = measured(beam_model(structure), structure.parameters(), experiments, 0.003, 1)
    for number, experiment in enumerate(data, 1):
        table = np.column_stack([experiment.time, experiment.voltages, experiment.outputs])
        header = ",".join(["time", "plant.u[1]", *(f"plant.{name}" for name in sensors)])
        np.savetxt(folder / f"step{number}.csv", table, delimiter=",", header=header, comments="", fmt="%.17g")
    text, changed = re.subn(
        r"youngs_modulus = 6\.0e10 +# assumed",
        "youngs_modulus = 6.9e10 # assumed, from the supplier",
        SHIPPED.read_text(encoding="utf-8"),
    )
    assert changed == 1
    (folder / "start.toml").write_text(text, encoding="utf-8")
    return folder


def run(*arguments: object) -> int:
    return main([str(a) for a in arguments])


def test_json_and_the_structure_file(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = read_structure(SHIPPED).parameters()
    mass = truth["beam[1].tip_mass"]
    known = f"beam[1].tip_mass={mass!r}" if mass > 0 else f"beam[1].density={truth['beam[1].density']!r}"
    files = [rig / "step1.csv", rig / "step2.csv"]
    arguments = ["--structure", rig / "start.toml", "--known", known, "--hold-back", rig / "step3.csv", "--json"]
    assert run("identify", *files, *arguments, "--out", rig / "result.toml") == 0
    shown = capsys.readouterr()
    assert "fitting all rows" in shown.err
    result = json.loads(shown.out)
    modulus = result["parameters"]["beam[1].youngs_modulus"]
    assert modulus["status"] == "fitted"
    assert modulus["unit"] == "Pa"
    assert modulus["value"] == pytest.approx(truth["beam[1].youngs_modulus"], rel=0.02)
    assert [e["held_back"] for e in result["experiments"]] == [False, False, True]
    assert max(result["experiments"][2]["relative_residual"].values()) < 0.05
    assert len(result["modes"]["identified"]) == len(result["modes"]["start"]) > 3
    assert np.all(np.array(result["feedforward_end_error"]["half_width"]) < 1e-4)
    text = (rig / "result.toml").read_text(encoding="utf-8")
    written = read_structure(rig / "result.toml").parameters()
    for name, entry in result["parameters"].items():
        assert written[name] == pytest.approx(entry["value"], rel=1e-8)
    line = next(line for line in text.splitlines() if line.startswith("youngs_modulus"))
    assert "# fitted (+-" in line
    assert line.endswith("%); from the supplier")
    assert text.splitlines()[0] == (rig / "start.toml").read_text(encoding="utf-8").splitlines()[0]
    page = (rig / "identify.html").read_text(encoding="utf-8")
    assert all(f"{name}</th>" in page for name in result["parameters"])
    assert "step3 (held back)" in page
    assert page.count("<polyline") == 2 * len(result["sensors"])
    assert "http://" not in page.replace("http://www.w3.org", "")
    statuses = [entry["status"] for entry in result["parameters"].values()]
    assert text.count("assumed (undetermined by data)") == statuses.count("assumed")


def test_the_table_names_what_is_known(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--structure", rig / "start.toml", "--fix", "*.density", "--window", "0:4", "--weight", "y_pm[]=0.5"]
    assert run("identify", rig / "step1.csv", rig / "step2.csv", *arguments) == 0
    text = capsys.readouterr().out
    assert "patch[1].viscous_damping" in text
    assert " known " in text
    assert "Residual over signal" in text
    assert "Predicted end error" in text


def test_static_gains_for_a_design(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    structure = read_structure(SHIPPED)
    files = [rig / f"step{k}.csv" for k in (1, 2, 3)]
    assert run("identify", "static", *files, "--structure", SHIPPED, "--out", rig / "maps.csv") == 0
    assert capsys.readouterr().out.strip() == str(rig / "maps.csv")
    points, gauges = len(structure.point_of_interest), len(structure.strain_gauge)
    maps = read_static_maps(rig / "maps.csv", pairs=1, points=points, gauges=gauges)
    model = beam_model(structure)
    deflection, _ = static_gains(model, model.assemble())
    assert np.allclose(maps.deflection, deflection, rtol=0.05)
    assert maps.deflection_interval is not None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "common factor only"),
        (["--known", "beam[1].tip_mas=1"], "--known: beam[1].tip_mas is not a parameter; did you mean"),
        (["--known", "beam[1].tip_mass"], "--known must read NAME=VALUE"),
        (["--known", "beam[1].tip_mass=heavy"], "--known must have a finite number"),
        (["--known", "beam[1].density=-1"], "beam[1].density must be finite and > 0"),
        (["--prior", "beam[1].density=0"], "--prior must be > 0 percent"),
        (["--bounds", "beam[1].density=1:2"], "bounds of beam[1].density must enclose its start"),
        (["--weight", "y_mp[1]=1"], "--weight y_mp[1] is not a sensor; did you mean 'y_pm[1]'"),
        (["--weight", "y_pm[1]=0"], "--weight must be > 0"),
        (["--delay", "y_pm[1]=-1"], "--delay must be >= 0"),
        (["--map", "u[1]=voltage*1000"], "column 'voltage' is missing"),
        (["--window", "0:0.05"], "at least 20 rows that count"),
        (["--steps", "paper"], "--steps paper needs files recorded with the springs taken off: give --uncoupled"),
        (["--structure", "nowhere.toml"], "is neither a file nor a shipped structure"),
    ],
)
def test_refusals_are_one_line(
    rig: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    start = [] if "--structure" in arguments else ["--structure", str(rig / "start.toml")]
    assert run("identify", rig / "step1.csv", *start, *arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert message in shown.err
    assert len(shown.err.strip().splitlines()) == 1


def test_the_papers_steps_take_uncoupled_files_and_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    structure, model = kiel()
    truth = structure.parameters()
    names = [f"plant.{name}" for name in sensor_names(structure)]
    for name, springs in (("off", 0.0), ("on", 1.0)):
        values = {n: v * springs if n.startswith("spring[") else v for n, v in truth.items()}
        [e] = measured(model, values, steps(PATTERNS[:1], 10, rows=900), 0.002, 1)
        table = np.column_stack([e.time, e.voltages, e.outputs])
        header = ",".join(["time", *(f"u[{k}]" for k in range(1, 5)), *names])
        np.savetxt(tmp_path / f"{name}.csv", table, delimiter=",", header=header, comments="", fmt="%.17g")
    text = (STRUCTURES_FOLDER / "kiel.toml").read_text(encoding="utf-8").replace("stiffness = 7.53", "stiffness = 9.0")
    (tmp_path / "start.toml").write_text(text, encoding="utf-8")
    free = ["--free", "beam[].structural_damping", "--free", "spring[].stiffness", "--basis", "clamped_free"]
    files = [tmp_path / "on.csv", "--uncoupled", tmp_path / "off.csv", "--structure", tmp_path / "start.toml"]
    assert run("identify", *files, "--steps", "paper", *free, "--out", tmp_path / "r.toml", "--json") == 0
    shown = capsys.readouterr()
    assert "dynamic set, pass 1" in shown.err
    result = json.loads(shown.out)
    assert "the paper's two steps" in result["start"]["method"]
    spring = result["parameters"]["spring[1].stiffness"]
    assert abs(np.log(spring["value"] / truth["spring[1].stiffness"])) < 3 * spring["deviation"] < 0.12
    written = read_structure(tmp_path / "r.toml").parameters()
    assert written["spring[1].stiffness"] == pytest.approx(7.53, rel=0.02)
    assert written["beam[2].structural_damping"] == pytest.approx(truth["beam[2].structural_damping"], rel=0.05)
    assert run("identify", *files[:1], *files[3:], "--steps", "paper", *free) == 2
    assert "give --uncoupled" in capsys.readouterr().err


def test_nothing_left_to_fit(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = rig / "step1.csv"
    assert run("identify", file, "--hold-back", file, "--structure", rig / "start.toml") == 2
    assert "--hold-back must leave at least one file to fit" in capsys.readouterr().err


def test_wrong_arguments_of_the_function(rig: Path) -> None:
    for files, options, message in (
        ([], {}, "files must be at least one CSV file"),
        ([rig / "step1.csv"], {"steps": "both"}, "steps must be 'all' or 'paper', got 'both'"),
        ([rig / "step1.csv"], {"loss": "huber"}, "loss must be 'soft_l1' or 'linear', got 'huber'"),
    ):
        with pytest.raises(fb.FlexbeamsError) as caught:
            fb.identify(*files, **options)  # type: ignore[arg-type]
        assert str(caught.value) == message


def test_help_names_both_ways(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("identify", "--help") == 0
    text = capsys.readouterr().out
    assert "parameters" in text
    assert "static" in text


def test_the_function_gives_what_the_command_gives(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files, stages, evaluations = [rig / "step1.csv", rig / "step2.csv"], [], []
    result = fb.identify(
        *files,
        structure=rig / "start.toml",
        fixed=["*.density", "patch[].structural_damping"],
        weights={"y_pm[]": 0.5},
        window=(None, 4.0),
        out=rig / "by_function.toml",
        notify=stages.append,
        progress=lambda done, most: evaluations.append((done, most)),
    )
    options = ["--fix", "*.density", "--fix", "patch[].structural_damping", "--weight", "y_pm[]=0.5", "--window", ":4"]
    assert run("identify", *files, "--structure", rig / "start.toml", *options, "--out", rig / "by_verb.toml") == 0
    assert (rig / "by_verb.toml").read_bytes() == (rig / "by_function.toml").read_bytes()
    assert f"fitting {stages[-1]}" in capsys.readouterr().err
    assert stages[-1] == "all rows"
    assert all(0 < done <= most for done, most in evaluations)
    assert sum(done == 1 for done, _ in evaluations) >= len(stages)
    written = fb.structure(rig / "by_function.toml").parameters()
    assert written == pytest.approx(result.structure.parameters(), rel=1e-8)


def test_known_offsets_are_taken_off(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = np.loadtxt(rig / "step1.csv", delimiter=",", skiprows=1)
    header = (rig / "step1.csv").read_text(encoding="utf-8").splitlines()[0]
    table[:, header.split(",").index("plant.y_pi[1]")] += 2e-3
    np.savetxt(rig / "shifted.csv", table, delimiter=",", header=header, comments="", fmt="%.17g")
    options = ["--structure", rig / "start.toml", "--free", "beam[].youngs_modulus", "--free", "patch[].piezo_ratio"]
    values = []
    for file, offset in (("step1.csv", []), ("shifted.csv", ["--offset", "y_pi[1]=2e-3"]), ("shifted.csv", [])):
        assert run("identify", rig / file, *options, *offset, "--json") == 0
        values.append(json.loads(capsys.readouterr().out)["parameters"]["patch[1].piezo_ratio"]["value"])
    assert values[1] == pytest.approx(values[0], rel=1e-7)
    assert abs(values[2] / values[0] - 1) > 1e-3
    assert run("identify", rig / "step1.csv", *options, "--offset", "y_pu[1]=1") == 2
    assert "--offset y_pu[1] is not a sensor" in capsys.readouterr().err
