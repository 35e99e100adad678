"""The command: verbs, exit statuses, what goes to stdout and what to stderr."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexbeams.fmus.errors import BuildError, InterfaceError
from flexbeams.plant.errors import DesignError, FlexbeamsError, InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.scenario_file import first_comment, scenario_files
from flexbeams.scenarios.masters.isolation import MasterError
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.simulation.failure import UnitFailure
from flexbeams.scenarios.simulation.recording import step_times
from tests.helpers import UNITS, Workshop, command, design_of, python_environment

Write = Callable[[str, str], Path]
VERBS = ("design", "build", "run", "list", "validate")


def output(capsys: pytest.CaptureFixture[str], *arguments: object, status: int = 0) -> str:
    """Standard output of a command that must end with `status` and say nothing on standard error."""
    assert main([str(a) for a in arguments]) == status
    shown = capsys.readouterr()
    assert shown.err == ""
    return shown.out


@pytest.mark.parametrize("arguments", [["--help"], ["-h"], *([verb, "--help"] for verb in VERBS)])
def test_help(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    text = output(capsys, *arguments)
    assert text.startswith("Usage: flexbeams")
    assert max(map(len, text.splitlines())) <= 100
    if arguments[0] in ("--help", "-h"):
        assert all(re.search(rf"^  {verb} ", text, re.M) for verb in VERBS)


def test_nothing_asked_shows_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert output(capsys, status=2).startswith("Usage: flexbeams")


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    from importlib.metadata import version

    assert output(capsys, "--version").strip().endswith(version("flexbeams"))


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["frobnicate"], "No such command 'frobnicate'"),
        (["list", "--nonsense"], "No such option '--nonsense'"),
        (["run"], "Missing argument 'SCENARIO...'"),
        (["run", "unpacked/SystemStructure.ssd"], "is part of an unpacked SSP package; give the package, NAME.ssp"),
        (["new"], "Choose from: structure, scenario, study (see"),
        (["validate"], "Missing argument"),
        (["validate", "none.fmu"], "'none.fmu' does not exist"),
        (["design", "--basis", "modes"], "'modes' is not one of 'clamped_free', 'segment'"),
        (
            ["design", "--structure", "keil"],
            "--structure: structure 'keil' is neither a file nor a shipped structure; did you mean 'kiel'?",
        ),
        (
            ["build", "BeamPlan"],
            "UNIT is not a unit; did you mean 'BeamPlant'? (valid: BeamPlant, FlatnessFeedforward, "
            "TrackingController, MfcActuator, MfcCompensator), got 'BeamPlan'",
        ),
        (["build", "--backend", "fortran"], "'fortran' is not one of"),
        (["build", "--backend", "python", "--structure", "."], "--structure: structure '.' is neither a file"),
        (["build", "BeamPlant", "--backend", "python", "--out", "/proc/none"], "/proc/none"),
        (["design", "--out", "/proc/none/design.npz"], "/proc/none"),
    ],
)
def test_misuse_is_one_line_and_status_2(
    arguments: list[str], complaint: str, at_run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    [line] = shown.err.splitlines()
    assert line.startswith("flexbeams: ")
    assert complaint in line


def test_list_has_a_line_for_each_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    lines = output(capsys, "list").partition("\n\nStudies:\n")[0].splitlines()
    files = scenario_files()
    assert [line.split()[0] for line in lines] == list(files)
    for line, path in zip(lines, files.values(), strict=True):
        text = first_comment(path.read_text(encoding="utf-8"))
        assert line.endswith("  " + text)
        assert text.endswith(".")


# design


def test_design_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    """SI values: rad/s, 1/s, m/V; eigenvalues as pairs."""
    shown = json.loads(output(capsys, "design", "--json"))
    design = design_of()
    assert shown["design_id"] == design.design_id
    assert shown.items() >= json.loads(json.dumps(design.summary)).items()
    assert shown["loops"]["exact"]["margins"]["disk"]["alpha"] == pytest.approx(1.184, abs=1e-3)
    assert shown["units"]["frequencies"] == "rad/s"
    frequencies = np.array(shown["frequencies"])
    assert len(frequencies) == 30
    assert np.all(np.diff(frequencies) > 0)
    assert 10 < frequencies[0] < 20  # rad/s, not Hz
    assert len(shown["damping_ratios"]) == 30
    assert all(0 < ratio < 1 for ratio in shown["damping_ratios"][:10])
    assert len(shown["hankel_position"]) == len(shown["hankel_velocity"]) == 30
    assert shown["hankel_position"] == sorted(shown["hankel_position"], reverse=True)
    assert 0.80 <= shown["hankel_share"] <= 0.84
    eigenvalues = np.array(shown["reduced_eigenvalues"])
    assert eigenvalues.shape == (30, 2)
    assert np.all(eigenvalues[:, 0] < 0)
    np.testing.assert_allclose(
        np.sort(eigenvalues[:, 1]), np.sort(np.linalg.eigvals(design.arrays["A"]).imag), atol=1e-6
    )
    gain = np.array(shown["static_gain_pi"])  # m/V: (48) of the paper
    np.testing.assert_allclose(gain @ [817.0, -770.0, -807.0, 781.0], [-8e-3, 1e-3, 4e-3, -6e-3], rtol=1e-9)


@pytest.mark.parametrize(
    ("structure", "basis", "states"), [("single_beam", "clamped_free", 20), ("kiel", "segment", 176)]
)
def test_design_of_others(structure: str, basis: str, states: int, capsys: pytest.CaptureFixture[str]) -> None:
    shown = json.loads(output(capsys, "design", "--structure", structure, "--basis", basis, "--json"))
    assert shown["design_id"] == design_of(structure, basis).design_id
    assert shown["full_order"] == states
    assert len(shown["reduced_eigenvalues"]) == 10 * len(design_of(structure).structure.beam)


def test_design_of_a_scenario_with_other_options(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Structure and [design] of a scenario, options in its place, and a page."""
    page = tmp_path / "pages" / "one.html"
    sets = [
        "reduced_modes=4",
        "weights.kalman_q_total=100",
        "observer=offset_free",
        "uncertainty.patch[].piezo_ratio=0.2",
    ]
    options = [argument for text in sets for argument in ("--set", text)]
    assert main(["design", "--scenario", "single_beam", *options, "--report", str(page)]) == 0
    shown = capsys.readouterr()
    assert shown.err == f"report written to {page}\n"
    assert "1 beams, 1 patch pairs" in shown.out
    assert "reduced to 8" in shown.out
    assert "disk margin" in shown.out
    text = page.read_text(encoding="utf-8")
    assert "<h1>Design: single_beam</h1>" in text
    for value in ("100", "offset_free", "{&#39;patch[].piezo_ratio&#39;: 0.2}"):
        assert f"<dd>{value}</dd>" in text


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--set", "weights.kalman=1"], "--set: weights.kalman is not a known key"),
        (["--set", "observer=paper_free"], "--set: observer must be 'paper' or 'offset_free'"),
        (["--set", "voltage.limit=1"], "--set must be a key of [design], weights.NAME or uncertainty.NAME"),
        (["--set", "reduced_modes"], "must be KEY=VALUE, got 'reduced_modes'"),
        (["--scenario", "trackin"], "'trackin' is neither a file nor a shipped scenario; did you mean 'tracking'?"),
    ],
)
def test_design_refuses_options(options: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["design", *options]) == 2
    assert message in capsys.readouterr().err


def test_design_for_people(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["design", "--out", str(tmp_path / "new" / "kiel.npz")]) == 0
    shown = capsys.readouterr()
    assert shown.err == f"design written to {tmp_path / 'new' / 'kiel.npz'}\n"
    design = design_of()
    assert f"design {design.design_id}" in shown.out
    assert "3 beams, 4 patch pairs, 4 points of interest, 6 strain gauges, 37 parameters" in shown.out
    assert f"{design.summary['frequencies'][0]:.3f}" in shown.out
    from flexbeams.controller.design_file import read_design

    assert read_design(tmp_path / "new" / "kiel.npz").design_id == design.design_id


# build and validate


def test_build_of_single_units(tmp_path: Path, workshop: Workshop, capsys: pytest.CaptureFixture[str]) -> None:
    """Files go to OUT/<backend>/<Unit>.fmu and are those that others are built to."""
    text = output(
        capsys,
        "build",
        "TrackingController",
        "BeamPlant",
        "TrackingController",
        "--backend",
        "python",
        "--out",
        tmp_path,
    )
    files = [tmp_path / "python" / f"{unit}.fmu" for unit in ("TrackingController", "BeamPlant")]
    assert text.split() == [str(f) for f in files]
    assert sorted((tmp_path / "python").iterdir()) == sorted(files)
    for file in files:
        assert file.read_bytes() == workshop.fmu(file.stem).read_bytes()


@pytest.mark.native
def test_build_of_all_for_another_structure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = output(
        capsys, "build", "--backend", "all", "--structure", "single_beam", "--basis", "segment", "--out", tmp_path
    )
    assert sorted(text.split()) == sorted(
        str(tmp_path / kind / f"{unit}.fmu") for kind in ("native", "python") for unit in UNITS
    )
    for line in text.split():
        with zipfile.ZipFile(line) as archive:
            assert design_of("single_beam", "segment").design_id.encode() in archive.read("modelDescription.xml")
    checked = output(capsys, "validate", "--no-run", *text.split())
    assert checked.splitlines() == [f"{line}: valid" for line in text.split()]


def test_validate_tells_what_is_wrong(tmp_path: Path, workshop: Workshop, capsys: pytest.CaptureFixture[str]) -> None:
    good = workshop.fmu("FlatnessFeedforward")
    bad = tmp_path / "bad.fmu"
    with zipfile.ZipFile(good) as source, zipfile.ZipFile(bad, "w") as archive:
        for name in source.namelist():
            content = source.read(name)
            if name == "modelDescription.xml":
                content = content.replace(b'causality="input"', b'causality="inptu"', 1)
            archive.writestr(name, content)
    no_archive = tmp_path / "text.fmu"
    no_archive.write_text("nothing")
    lines = output(capsys, "validate", good, bad, no_archive, status=1).splitlines()
    assert lines[0] == f"{good}: valid"
    assert all(line.startswith(f"{bad}: ") for line in lines[1:-1])
    assert "inptu" in lines[1]
    assert lines[-1].startswith(f"{no_archive}: ")
    assert lines[-1].endswith("File is not a zip file")


# run


@pytest.mark.native
def test_run_writes_where_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By default results/<scenario>, and what differs; the scenario's name is that of the file."""
    monkeypatch.chdir(tmp_path)
    shutil.copyfile(scenario_files()["single_beam"], tmp_path / "mine.toml")
    assert main(["run", "mine.toml", "--stop-time", "0.1", "--no-figures", "--no-report"]) == 0
    assert sorted(p.name for p in (tmp_path / "results" / "mine-stop_time=0.1").iterdir()) == [
        "results.csv",
        "summary.json",
    ]
    assert "; results in results/mine-stop_time=0.1" in capsys.readouterr().out.replace(os.sep, "/")
    assert json.loads((tmp_path / "results/mine-stop_time=0.1/summary.json").read_text())["scenario"] == "mine"


@pytest.mark.native
def test_run_leaves_units_that_are_built_alone(
    at_run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["run", "single_beam", "--stop-time", "0.01", "--out", str(tmp_path), "--no-figures", "--no-report"]
    main(arguments)
    capsys.readouterr()
    assert main(arguments) == 0
    assert "building" not in capsys.readouterr().err


@pytest.mark.native
def test_exit_status_of_the_process(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    """0, 1 and 2, results on stdout, complaints on stderr."""
    text = scenario_files()["single_beam"].read_text()
    good = write_scenario("good", text)
    failing = write_scenario("failing", text.replace("max = 1000.0", "max = 0.1"))
    broken = write_scenario("broken", text.replace("stop_time", "stop_tim"))
    for path, status in ((good, 0), (failing, 1), (broken, 2)):
        process = command(
            "run", path, "--stop-time", "3.0", "--out", tmp_path, "--no-figures", "--no-report", cwd=at_run_folder
        )
        out, errors = process.communicate(timeout=120)
        assert process.returncode == status, errors
        assert bool(out) == (status < 2)
        assert ("broken.toml: stop_tim is not a known key" in errors) == (status == 2)
        assert "Traceback" not in errors


@pytest.mark.parametrize(
    "arguments", [["design"], ["run", "single_beam", "--stop-time", "0.01", "--no-figures", "--no-report"]]
)
@pytest.mark.native
def test_terminal_that_knows_ascii_only(
    arguments: list[str], at_run_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONIOENCODING", "ascii")
    out, errors = (process := command(*arguments, cwd=at_run_folder)).communicate(timeout=120)
    assert process.returncode == 0, errors
    assert "?" in out
    assert out.isascii()


@pytest.mark.skipif(os.name == "nt", reason="signals as POSIX has them")
@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.slow
def test_ctrl_c_between_python_units(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    """It may come while a unit computes, in the same interpreter: the run ends with 130 and what it has."""
    path = write_scenario(
        "long", scenario_files()["single_beam"].read_text().replace("stop_time = 6.0", "stop_time = 400.0")
    )
    main(
        [
            "run",
            str(path),
            "--stop-time",
            "0.01",
            "--backend",
            "python",
            "--out",
            str(tmp_path / "first"),
            "--no-figures",
            "--no-report",
        ]
    )
    process = command(
        "run", path, "--backend", "python", "--out", tmp_path / "out", "--no-figures", "--no-report", cwd=at_run_folder
    )
    for _ in range(300):
        # Units are loaded right before the first step
        if process.poll() is not None or "BeamPlant." in mapped(process.pid):
            break
        time.sleep(0.1)
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert re.search(r"^flexbeams: interrupted at \d", errors, re.M)
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    recording = read_results(tmp_path / "out/results.csv")
    assert summary["complete"] is False
    assert summary["checks"] == []
    assert 0 < summary["timing"]["steps"] == len(recording.time) - 1 < 2_000_000
    assert np.isfinite(recording.values).all()
    np.testing.assert_array_equal(recording.time, step_times(np.arange(len(recording.time)), 2e-4))


def mapped(pid: int) -> str:
    """Files mapped into a process, where the system tells."""
    try:
        return Path(f"/proc/{pid}/maps").read_text()
    except OSError:
        return ""


# errors


def test_a_user_error_shows_its_trace_on_demand(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FLEXBEAMS_DEBUG", "1")
    assert main(["run", "trackin"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines[0].startswith("Traceback")
    assert lines[-1].startswith("flexbeams: scenario 'trackin' is neither a file nor a shipped scenario")
    monkeypatch.setenv("FLEXBEAMS_DEBUG", "0")
    assert main(["run", "trackin"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_all_errors_of_the_project_have_one_root() -> None:
    errors = (DesignError, InputError, InterfaceError, BuildError, UnitFailure, MasterError)
    for kind in errors:
        assert issubclass(kind, FlexbeamsError)
    assert [kind for kind in errors if issubclass(kind, ValueError)] == [InputError]


@pytest.mark.parametrize(
    ("code", "absent"),
    [
        ("import flexbeams.scenarios.cli.main", ["numpy", "scipy", "pydantic"]),
        ("import flexbeams.scenarios.runs.job", ["scipy", "matplotlib", "pyarrow"]),
    ],
)
def test_commands_start_without_what_they_do_not_need(code: str, absent: list[str]) -> None:
    """Help needs no arrays; a run whose units are kept needs no scipy."""
    found = subprocess.run(
        [sys.executable, "-c", f"{code}; import sys; print([m for m in {absent!r} if m in sys.modules])"],
        capture_output=True,
        text=True,
        check=True,
        env=python_environment(),
    )
    assert found.stdout.strip() == "[]"


@pytest.mark.native
def test_a_run_loads_and_makes_only_what_is_not_there(at_run_folder: Path, tmp_path: Path) -> None:
    """With units and figures kept, modules that build, design, draw, report or read packages stay away."""
    arguments = ["run", "single_beam", "--stop-time", "0.01", "--no-report", "--out", str(tmp_path / "out")]
    assert main(arguments) in (0, 1)
    unused = [
        "scipy",
        "matplotlib",
        "jinja2",
        "pyarrow",
        "numpy.ma",
        "rich.progress",
        "concurrent.futures",
        "flexbeams.controller.computation",
        "flexbeams.fmus.packaging.native",
        "flexbeams.scenarios.importing.ssp",
        "flexbeams.scenarios.report.figure_process",
    ]
    code = f"from flexbeams.scenarios.cli.main import main; main({arguments!r})"
    code += f"; import sys; sys.exit(str([m for m in {unused!r} if m in sys.modules]))"
    found = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=False,
        cwd=at_run_folder,
        env=python_environment(),
    )
    assert found.stderr.splitlines()[-1] == "[]"
