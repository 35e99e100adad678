"""Co-simulation masters of others run the exported packages as they are, and agree with the runner."""

import io
import json
import math
import os
import re
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.bench_tables import show_masters
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.choices import Coupling
from flexbeams.scenarios.definition.scenario_file import find_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.ssp import export_ssp
from flexbeams.scenarios.masters.catalogue import MASTERS, RUNNER, find_master, installed_version
from flexbeams.scenarios.masters.isolation import MasterError, run_cycles, run_master
from flexbeams.scenarios.masters.tasks import private_folder, read_task
from flexbeams.scenarios.masters.trace import Trace, deviation
from flexbeams.scenarios.runs.package import run_package
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.recording import Recording

pytestmark = [pytest.mark.native, pytest.mark.masters]
CYCLES = 4 * int(os.environ.get("FLEXBEAMS_CYCLES", "2"))  # 50 for the full measurement: 200 cycles
STOPS = {"tracking": 1.2, "disturbance": 1.1, "retarget": 1.7, "five_units": 0.2}  # s: into the motions
WHOLE = {**STOPS, "tracking": 6.0}  # s, for one master: also a run to its end
if "FLEXBEAMS_WHOLE_RUNS" in os.environ:
    WHOLE = {"tracking": 6.0, "disturbance": 12.0, "retarget": 6.0, "five_units": 6.0}
TO_THE_END = next((name for name in ("libcosim", "Ecos") if installed_version(MASTERS[name])), "FMPy")  # a quick one
OWN_LOADERS = ("FMPy", "libcosim", "Ecos", "FMUContainer")  # the others load units by FMPy
STEP = 2e-4
OUTPUTS = (
    "light.y_pi",
    "heavy.y_pi",
    "plant.y_pi",
    "plant.y_pm",
    "controller.u",
    "controller.y_est",
    "compensator.u",
    "actuator.u_eff",
    "feedforward.u_ff",
    "feedforward.y_ref",
)
HEADER = 'title = "x"\nstructure = "single_beam"\nstop_time = 0.1\n'
TWINS = (
    HEADER
    + """[instance.light]
unit = "BeamPlant"
[instance.heavy]
unit = "BeamPlant"
start."beam[1].tip_mass" = 0.5
[[input]]
to = "light.u"
step = { time = 2e-4, value = 300.0 }
[[input]]
to = "heavy.u"
step = { time = 4e-4, value = 200.0 }
"""
)
ONE = HEADER + '[instance.plant]\nunit = "BeamPlant"\n[[input]]\nto = "plant.u"\n'
SMALL = {
    "twins": TWINS,
    "constant": ONE + "constant = 300.0\n",
    "later": ONE + f"step = {{ time = {STEP}, value = 300.0 }}\n",
}
FIVE_UNITS = (  # feedforward, controller, compensator, actuator, plant; an early start of the motion
    find_scenario("hysteresis_compensated").read_text(encoding="utf-8").replace("time = 1.0,", "time = 0.02,")
)


def needed(name: str) -> None:
    """Skips where a master is not installed."""
    if installed_version(MASTERS[name]) is None:
        pytest.skip(f"{MASTERS[name].distribution} is not installed")


class Works:
    """Packages and the runner's results, each made once."""

    def __init__(self, folder: Path, build_folder: Path) -> None:
        self.folder, self._build = folder, build_folder
        self._packages: dict[str, Path] = {}
        self._results: dict[tuple[str, Coupling, float], Recording] = {}

    def scenario(self, name: str) -> str:
        """A shipped scenario, or the file of a small one."""
        texts = {**SMALL, "five_units": FIVE_UNITS}
        if name not in texts:
            return name
        path = self.folder / f"{name}.toml"
        path.write_text(texts[name], encoding="utf-8")
        return str(path)

    def package(self, name: str) -> Path:
        """A scenario exported."""
        if name not in self._packages:
            self._packages[name] = export_ssp(
                self.scenario(name), self.folder / f"{name}.ssp", Settings(record_animation=False)
            )
        return self._packages[name]

    def reference(self, scenario: str, coupling: Coupling, stop_time: float) -> Recording:
        """The scenario, not the package, under the runner."""
        key = scenario, coupling, stop_time
        if key not in self._results:
            self._results[key] = run_scenario(
                self.scenario(scenario),
                Settings(record_animation=False, build_folder=self._build, coupling=coupling, stop_time=stop_time),
            ).recording
        return self._results[key]

    def run(self, package: Path, coupling: Coupling = "jacobi") -> Recording:
        """A package under the runner."""
        return run_package(
            package, Settings(record_animation=False, build_folder=self._build, coupling=coupling)
        ).recording


@pytest.fixture(scope="module")
def works(tmp_path_factory: pytest.TempPathFactory, run_folder: Path) -> Works:
    return Works(tmp_path_factory.mktemp("masters"), run_folder / "build/fmus")


def chosen(trace: Trace, arrays: tuple[str, ...]) -> Trace:
    """The trace with some arrays only."""
    places = [k for k, column in enumerate(trace.columns) if column.split("[")[0] in arrays]
    return replace(trace, columns=[trace.columns[k] for k in places], values=trace.values[:, places])


@pytest.fixture(scope="module")
def traces(works: Works) -> Callable[[str], dict[str, Trace]]:
    """What a master makes of all packages, run one after another in one process."""
    made: dict[str, dict[str, Trace]] = {}

    def run(name: str) -> dict[str, Trace]:
        if name not in made:
            tasks = {
                scenario: read_task(
                    works.package(scenario), stop_time=(WHOLE if name == TO_THE_END else STOPS).get(scenario)
                )
                for scenario in (*STOPS, *SMALL)
            }
            done = run_cycles(
                name,
                [
                    replace(task, signals=tuple(s for s in task.signals if s.split("[")[0] in OUTPUTS))
                    for task in tasks.values()
                ],
            )
            made[name] = dict(zip(tasks, done.traces, strict=True))
        return made[name]

    return run


@pytest.mark.parametrize("scenario", STOPS)
@pytest.mark.parametrize("name", MASTERS)
def test_a_master_agrees_with_the_runner_of_its_coupling(
    name: str, scenario: str, works: Works, traces: Callable[[str], dict[str, Trace]]
) -> None:
    needed(name)
    coupling: Coupling = MASTERS[name].coupling
    stop = (WHOLE if name == TO_THE_END else STOPS)[scenario]
    reference, trace = works.reference(scenario, coupling, stop), traces(name)[scenario]
    assert len(trace.columns) == 4 + 6 + 4 * (6 if scenario == "five_units" else 4)
    assert round(trace.time[-1] / STEP) == reference.steps == round(stop / STEP)
    assert len(trace.time) == len(trace.values) >= reference.steps
    assert deviation(trace, reference) <= 1e-9
    # Labels a row early, as FMPy writes them, or the other coupling are other results: the test can tell
    assert deviation(replace(trace, time=np.maximum(trace.time - STEP, 0.0)), reference) > 1e-4
    other: Coupling = "gauss-seidel" if coupling == "jacobi" else "jacobi"
    assert deviation(trace, works.reference(scenario, other, stop)) > 1e-5


@pytest.mark.parametrize("name", MASTERS)
def test_units_of_one_name_live_side_by_side(
    name: str, works: Works, traces: Callable[[str], dict[str, Trace]]
) -> None:
    needed(name)
    with zipfile.ZipFile(works.package("twins")) as archive:
        assert {"resources/BeamPlant_light.fmu", "resources/BeamPlant_heavy.fmu"} <= set(archive.namelist())
    trace = traces(name)["twins"]
    light, heavy = trace.values.T
    assert np.max(np.abs(light - heavy)) > 0.1 * np.max(np.abs(heavy))
    assert deviation(trace, works.run(works.package("twins"), MASTERS[name].coupling)) <= 1e-9


@pytest.mark.parametrize("name", MASTERS)
def test_where_values_are_passed_on_before_the_first_step(
    name: str, works: Works, traces: Callable[[str], dict[str, Trace]]
) -> None:
    """Where they are not, a voltage from the start on counts from the second step on."""
    needed(name)
    trace, late = traces(name)["constant"], MASTERS[name].delayed_start
    assert deviation(trace, works.run(works.package("later" if late else "constant"))) <= 1e-9
    assert deviation(trace, works.run(works.package("constant" if late else "later"))) > 1e-2


def damaged(package: Path, out: Path, change: Callable[[str, bytes], bytes]) -> Path:
    """A copy with changed contents of its BeamPlants."""
    with zipfile.ZipFile(package) as archive, zipfile.ZipFile(out, "w") as copy:
        for name in archive.namelist():
            content = archive.read(name)
            if "BeamPlant" in name:
                buffer = io.BytesIO()
                with zipfile.ZipFile(io.BytesIO(content)) as fmu, zipfile.ZipFile(buffer, "w") as changed:
                    for inner in fmu.namelist():
                        changed.writestr(inner, change(inner, fmu.read(inner)))
                content = buffer.getvalue()
            copy.writestr(name, content)
    return out


@pytest.mark.parametrize("name", OWN_LOADERS)
def test_what_a_master_cannot_load_is_an_error_here_and_no_crash(name: str, works: Works, tmp_path: Path) -> None:
    needed(name)
    package = works.package("constant")
    broken = damaged(package, tmp_path / "broken.ssp", lambda inner, content: b"" if "binaries/" in inner else content)
    with pytest.raises(MasterError, match=f"{name} ended with status"):
        run_master(name, broken)
    stranger = damaged(
        package,
        tmp_path / "stranger.ssp",
        lambda inner, content: (
            re.sub(rb'guid="[^"]*"', b'guid="{another}"', content) if inner == "modelDescription.xml" else content
        ),
    )
    with pytest.raises(MasterError, match=f"{name} ended with status 1, last output: .*(instantiate|refused|guid)"):
        run_master(name, stranger)  # which its unit refuses


def test_a_container_takes_components_named_as_its_own_variables(works: Works, tmp_path: Path) -> None:
    needed("FMUContainer")
    package = tmp_path / "renamed.ssp"
    with zipfile.ZipFile(works.package("constant")) as archive, zipfile.ZipFile(package, "w") as copy:
        for name in archive.namelist():
            copy.writestr(name, archive.read(name).replace(b'"source"', b'"signalsource"'))
    trace = run_master("FMUContainer", package)
    assert {"signalsource.u[1]", "plant.y_pi[1]"} <= set(trace.columns)
    assert deviation(trace, works.run(package)) <= 1e-9
    assert list(tmp_path.iterdir()) == [package]  # nothing is left beside it


@pytest.mark.parametrize("name", MASTERS)
def test_memory_is_flat_over_loading_and_unloading(name: str, works: Works) -> None:
    """Two packages by turns, whose units have the same names and other contents, in one process."""
    needed(name)
    tasks = [read_task(works.package(scenario), stop_time=10 * STEP) for scenario in ("constant", "twins")]
    cycles = run_cycles(name, tasks, CYCLES)
    assert cycles.repeated
    assert len(cycles.stepping) == CYCLES
    if sys.platform.startswith("linux"):
        kept = MASTERS[name].leaked_bytes * len(tasks) * CYCLES
        assert cycles.resident[-1] - cycles.resident[0] < 4_000_000 + kept


def test_the_runner_stands_beside_them(works: Works, at_run_folder: Path) -> None:
    trace = chosen(run_master(RUNNER.name, works.package("tracking"), stop_time=STOPS["tracking"]), OUTPUTS)
    assert deviation(trace, works.reference("tracking", "jacobi", STOPS["tracking"])) <= 1e-12


# What stands around them


def test_a_task_is_what_the_package_says(works: Works, tmp_path: Path) -> None:
    task = read_task(works.package("tracking"))
    assert (task.step, task.steps) == (STEP, 30_000)
    assert task.components == ("feedforward", "controller", "plant", "source")
    assert {s.split("[")[0] for s in task.signals} == {
        *(name for name in OUTPUTS if name.split(".")[0] in task.components),
        "feedforward.x_ref",
        "source.y_target",
        "source.force",
    }
    other = read_task(works.package("tracking"), step=1e-3, stop_time=0.1, signals=["plant.y_pi[1]"])
    assert (other.step, other.steps, other.signals) == (1e-3, 100, ("plant.y_pi[1]",))
    with zipfile.ZipFile(works.package("tracking")) as archive, zipfile.ZipFile(tmp_path / "a.ssp", "w") as copy:
        for name in archive.namelist():
            copy.writestr(name, re.sub(b' stopTime="[^"]*"', b"", archive.read(name)))
    with pytest.raises(InputError, match=r"a\.ssp: must have a stop time and a step"):
        read_task(tmp_path / "a.ssp")


def test_unknown_masters_are_refused() -> None:
    with pytest.raises(InputError, match=r"must be a known one; did you mean 'Ecos'\? .*, got 'Ecoss'"):
        find_master("Ecoss")


def test_deviation_is_relative_to_each_signal() -> None:
    recording = Recording(
        time=np.array([0.0, 0.1, 0.2]),
        columns=["a", "b", "c"],
        wall_seconds=1.0,
        values=np.array([[0.0, 0.0, 0.0], [1.0, 100.0, 0.0], [2.0, -200.0, 0.0]]),
    )
    trace = Trace(
        time=np.array([0.1, 0.2]),
        columns=["b", "a", "c"],
        loading=None,
        stepping=1.0,
        values=np.array([[100.0, 1.0, 0.0], [-200.2, 2.0, 0.0]]),
    )
    assert deviation(trace, recording) == pytest.approx(1e-3)
    assert deviation(replace(trace, values=trace.values + [0.0, 0.0, 1e-30]), recording) == float("inf")


def test_a_private_folder_takes_temporary_files_and_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TMP", raising=False)
    before = tempfile.gettempdir()
    with private_folder() as folder:
        assert Path(tempfile.mkdtemp()).parent == folder
        assert os.environ["TMPDIR"] == os.environ["TMP"] == str(folder)
    assert not folder.exists()
    assert tempfile.gettempdir() == before
    assert "TMP" not in os.environ


def test_every_fault_has_a_name_and_sentences() -> None:
    for master in MASTERS.values():
        assert len({fault.name for fault in master.faults}) == len(master.faults) >= 4
        assert all(text.endswith(".") for fault in master.faults for text in (fault.description, fault.remedy))


def test_the_verb_lists_masters(
    at_run_folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here = next((name for name in ("libcosim", "Ecos") if installed_version(MASTERS[name])), "FMPy")
    away = "sofirpy"
    monkeypatch.setattr("flexbeams.scenarios.bench.masters.MASTERS", {name: MASTERS[name] for name in (here, away)})
    monkeypatch.setattr(
        "flexbeams.scenarios.bench.masters.installed_version",
        lambda master: None if master.name == away else installed_version(master),
    )
    monkeypatch.setattr("flexbeams.scenarios.bench.masters.REPEATED_BELOW", 0.0)
    assert main(["bench", "--masters", "--steps", "5100", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["missing"] == [away]
    runner, other = figures["masters"]
    assert (runner["name"], other["name"]) == ("runner", here)
    assert runner["deviation"] is None
    assert other["deviation"] <= 1e-9
    for key in ("recorded", "silent"):
        assert runner[f"{key}_ratio"] == 1.0
        assert other[f"{key}_ratio"] == pytest.approx(other[f"{key}_s"] / runner[f"{key}_s"])
    show_masters(figures)
    shown = capsys.readouterr().out
    for text in ("runner", here, f"not installed, or failed: {away}", "x runner"):
        assert text in shown


@pytest.mark.parametrize(
    ("settings", "rule"),
    [
        ({"stop_time": -1.0}, "stop_time must be a whole number of steps"),
        ({"stop_time": math.nan}, "stop_time must be a whole number of steps"),
        ({"stop_time": 0.01, "step": 3e-3}, "stop_time must be a whole number of steps of 0.003 s"),
        ({"step": math.inf}, "step must be finite and > 0"),
        ({"signals": ["plant.energy"]}, "signals must be Real outputs of the package"),
    ],
)
def test_what_no_master_is_asked_for(works: Works, settings: dict[str, Any], rule: str) -> None:
    with pytest.raises(InputError, match=re.escape(rule)):
        read_task(works.package("constant"), **settings)


def test_files_that_are_no_packages(tmp_path: Path) -> None:
    (tmp_path / "text").write_text("no XML")
    for file in (tmp_path, tmp_path / "absent.xml", tmp_path / "text"):
        with pytest.raises(InputError, match=r"must be an SSP package or OspSystemStructure\.xml"):
            read_task(file)
