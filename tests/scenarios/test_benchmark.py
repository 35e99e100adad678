"""`flexbeams study benchmark` with a controller of one's own: a class, an FMU, and faults of theirs."""

import json
from pathlib import Path

import pytest

from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.runs.prepare import prepare_scenario
from flexbeams.scenarios.runs.scenario import unit_files
from flexbeams.scenarios.studies import benchmark
from flexbeams.scenarios.studies.benchmark import CASES

pytestmark = pytest.mark.native

PUBLISHED = """import numpy as np

class Published:
    def __init__(self, design):
        self.a, self.gain, self.x = design.arrays, design.integral_gain, None
        self.integral = np.zeros(len(self.a["feedback_gain"]))

    def __call__(self, y, x_ref, u_ff):
        a = self.a
        if self.x is None:
            self.x, self.u = x_ref.copy(), u_ff.copy()
        gap = y - a["H_pm"] @ self.x - a["D_pm"] @ self.u
        self.x = a["A_d"] @ self.x + a["B_d"] @ self.u + a["estimator_gain"] @ gap
        error = x_ref - self.x
        growth = a["static_inverse"] @ (a["H_pi"] @ error + a["D_pi"] @ (u_ff - self.u))
        self.u = u_ff + a["feedback_gain"] @ error + self.integral
        self.integral += self.gain * growth
        return self.u

class Broken:
    def __init__(self, design):
        pass

    def __call__(self, y, x_ref, u_ff):
        return {}["u"]

class Short(Broken):
    def __call__(self, y, x_ref, u_ff):
        return [1.0]

class Huge(Broken):
    def __call__(self, y, x_ref, u_ff):
        return [10**400] * 4

class Text(Broken):
    def __call__(self, y, x_ref, u_ff):
        return "u_ff"
"""


@pytest.fixture
def one_case(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmark, "CASES", (CASES[2],))  # with errors of the model
    monkeypatch.setattr(benchmark, "CANDIDATES", ("none", "feedforward", "published"))


@pytest.mark.usefixtures("one_case")
def test_a_class_and_a_unit_stand_in_for_the_controller(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.py"
    file.write_text(PUBLISHED)
    fmu = unit_files(prepare_scenario(load_scenario("mismatch"), Settings(record_animation=False)), print)["controller"]
    capsys.readouterr()
    for controller, tolerance in ((f"{file}:Published", 1e-9), (fmu, 0.0)):
        arguments = ("--controller", str(controller), "--stop-time", "1.2", "--out", str(tmp_path / "out"), "--json")
        assert main(["study", "benchmark", *arguments]) == 0
        record = json.loads(capsys.readouterr().out)
        assert json.loads((tmp_path / "out/benchmark.json").read_text()) == record
        results = record["results"]["model errors"]
        assert results["mine"] == pytest.approx(results["published"], rel=tolerance, abs=1e-12)
        assert results["feedforward"] != results["published"]
        assert results["none"]["largest voltage"] == 0.0
        page = (tmp_path / "out/benchmark.html").read_text()
        assert str(controller) in page
        assert page.count("<tr>") == 1 + len(results)


@pytest.mark.usefixtures("one_case")
@pytest.mark.parametrize(
    ("controller", "message"),
    [
        ("mine.py:Broken", "/mine.py: 'u'"),
        ("mine.py:Text", "must give 4 finite voltages, got 'u_ff'"),
        ("mine.py:Short", "must give 4 finite voltages, got '[1.0]'"),
        ("mine.py:Huge", "must give 4 finite voltages, got '[10000"),
        ("mine.py:None_", "--controller has no class None_"),
        ("mine.py", "must name the class of a Python file: FILE.py:Class"),
        ("other.py:Mine", "must be FILE.fmu or FILE.py:Class, of a file that exists"),
    ],
)
def test_faults_of_a_controller_take_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], controller: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(benchmark, "CANDIDATES", ())
    (tmp_path / "mine.py").write_text(PUBLISHED)
    assert main(["study", "benchmark", "--controller", controller, "--stop-time", "1.1"]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("flexbeams: ")
    assert message in last
