"""A scenario's SSP package: valid, complete, the same in other tools as here."""

import hashlib
import zipfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssd, read_ssv

from plant.errors import InputError
from plant.structure import find_structure, read_structure
from scenarios.cli import main
from scenarios.cosimulation import Recording
from scenarios.instance import UnitInstance
from scenarios.run import run_scenario
from scenarios.settings import Settings
from scenarios.ssp_check import package_problems
from scenarios.ssp_export import export_ssp
from scenarios.ssp_run import run_package

STEP = 2e-4
STOPS = {"tracking": 1.2, "disturbance": 1.1, "retarget": 1.7}   # s: into the motions
NS = {"ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
      "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
      "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues"}

Export = Callable[..., Path]


@pytest.fixture(scope="module")
def export(tmp_path_factory: pytest.TempPathFactory) -> Export:
    """Exports a scenario, each with the same settings once."""
    made: dict[str, Path] = {}

    def write(scenario: str, **settings: Any) -> Path:
        key = f"{scenario} {settings}"
        if key not in made:
            out = tmp_path_factory.mktemp("export") / f"{Path(scenario).stem}.ssp"
            made[key] = export_ssp(scenario, out, Settings(frames=False, **settings))
        return made[key]
    return write


@pytest.fixture
def short(run_folder: Path) -> Callable[..., Settings]:
    """Settings of a run with its units in the session's folder."""
    return lambda **settings: Settings(frames=False, build_folder=run_folder / "build/fmus", **settings)


def deviation(one: Recording, other: Recording) -> float:
    """Largest difference of a column of `one`, relative to its largest value."""
    places = [other.columns.index(c) for c in one.columns]
    error = np.max(np.abs(one.values - other.values[:, places]), axis=0)
    scale = np.max(np.abs(one.values), axis=0)
    assert np.all(error[scale == 0] == 0)
    return float(np.max(error[scale > 0] / scale[scale > 0]))


@pytest.mark.parametrize("coupling", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("scenario", STOPS)
def test_the_package_runs_as_its_scenario(scenario: str, coupling: Any, export: Export,
                                          short: Callable[..., Settings]) -> None:
    stop = STOPS[scenario]
    package = run_package(export(scenario, stop_time=stop, coupling=coupling), short())
    own = run_scenario(scenario, short(stop_time=stop, coupling=coupling))
    assert package.recording.steps == own.recording.steps == round(stop / STEP)
    assert package.summary["coupling"] == coupling
    assert package.summary["design_id"] == own.design.design_id
    assert np.max(np.abs(own.recording.values[:, own.recording.columns.index("controller.u[1]")])) > 1
    assert deviation(own.recording, package.recording) <= 1e-12


def fmpy_rows(table: Any, names: list[str]) -> tuple[Any, Any]:
    """FMPy's result as it should be labelled: the row at the time before a step holds the values after it."""
    return table["time"] + STEP, np.column_stack([table[n] for n in names])


@pytest.mark.parametrize("scenario", STOPS)
def test_fmpy_agrees_with_the_reference_of_its_coupling(scenario: str, export: Export,
                                                       short: Callable[..., Settings]) -> None:
    stop = STOPS[scenario]
    reference = run_scenario(scenario, short(stop_time=stop, coupling="jacobi")).recording
    table = simulate_ssp(str(export(scenario, stop_time=stop)), stop_time=stop, step_size=STEP)
    names = [c for c in reference.columns if c in table.dtype.names and not c.startswith(("plant.u[", "plant.force["))]
    assert {n.split("[")[0] for n in names} == {"plant.y_pi", "plant.y_pm", "controller.u", "controller.y_est",
                                               "feedforward.u_ff", "feedforward.y_ref"}
    places = [reference.columns.index(n) for n in names]
    # Every connector begins at 0 there, whatever the units say; here they do begin so.
    assert not reference.values[0, places].any()
    time, values = fmpy_rows(table, names)
    # It adds up its steps, and makes one more where the sum falls short of the stop time.
    steps = reference.steps
    assert len(time) in (steps, steps + 1)
    assert time[:steps] == pytest.approx(reference.time[1:], rel=1e-10)
    expected = reference.values[1:, places]
    scale = np.max(np.abs(expected), axis=0)
    assert np.max(np.abs(values[:steps] - expected) / np.where(scale > 0, scale, 1.0)) <= 1e-9


def test_fmpy_starts_constants_a_step_late(write_scenario: Callable[[str, str], Path], export: Export,
                                           short: Callable[..., Settings]) -> None:
    """FMPy exchanges nothing before the first step: a voltage from the start on counts from the second step on."""
    text = ('title = "x"\nstructure = "single_beam"\nstop_time = 0.2\n[instance.plant]\nunit = "BeamPlant"\n[[input]]\n'
            'to = "plant.u"\n')
    constant = write_scenario("constant", text + "constant = 300.0\n")
    later = write_scenario("later", text + f"step = {{ time = {STEP}, value = 300.0 }}\n")
    table = simulate_ssp(str(export(str(constant))), stop_time=0.2, step_size=STEP)
    reference = run_scenario(str(later), short()).recording
    names = [c for c in reference.columns if c.startswith("plant.y_")]
    expected = reference.values[1:, [reference.columns.index(n) for n in names]]
    values = fmpy_rows(table, names)[1][:len(expected)]
    assert np.max(np.abs(expected)) > 1e-4
    assert values == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.max(np.abs(expected)))
    own = run_package(export(str(constant)), short()).recording
    assert deviation(run_scenario(str(constant), short()).recording, own) <= 1e-12


@pytest.fixture(scope="module")
def changed(export: Export) -> tuple[Path, Path]:
    """A package with start values of its own, and the folder that it is extracted to."""
    path = export("mismatch", stop_time=0.1,
                  values={"plant.beam[2].tip_mass": 0.033, "plant.strain_noise_std": 1e-7, "plant.noise_seed": 5.0,
                          "controller.feedback": False, "plant.force": [0.0, 0.5, 0.0]})
    return path, Path(fmpy.extract(str(path), unzipdir=str(path.parent / "extracted")))


def test_start_values_are_equal_in_description_kernel_and_parameter_set(changed: tuple[Path, Path]) -> None:
    package = read_ssd(str(changed[0]))
    wanted = {"plant": {"beam[2].tip_mass": 0.033, "strain_noise_std": 1e-7, "noise_seed": 5.0},
              "controller": {"feedback": 0.0}, "source": {"force_constant.value[2]": 0.5}}
    for component in package.system.elements:
        folder = Path(fmpy.extract(str(changed[1] / component.source)))
        description = fmpy.read_model_description(str(folder))
        sets = component.parameterBindings[0].parameterValues[0].parameters
        values = {p.name: {"true": 1.0, "false": 0.0}.get(p.value) if p.type == "Boolean" else float(p.value)
                  for p in sets}
        own = {v.name: {"true": 1.0, "false": 0.0}[v.start] if v.type == "Boolean" else float(v.start)
               for v in description.modelVariables if v.causality == "parameter"}
        assert values == own
        assert wanted.get(component.name, {}).items() <= values.items()
        with UnitInstance(component.name, folder, description, print) as unit:
            assert {name: float(unit.get(name)) for name in values} == values
    plant = next(c for c in package.system.elements if c.name == "plant")
    springs = {p.name: float(p.value) for p in plant.parameterBindings[0].parameterValues[0].parameters
               if p.name.startswith("spring")}
    nominal = read_structure(find_structure("kiel")).spring
    assert list(springs.values()) == pytest.approx([1.1 * s.stiffness for s in nominal])   # by the scenario


def test_start_values_change_the_unit_s_identity(changed: tuple[Path, Path], export: Export) -> None:
    with zipfile.ZipFile(export("tracking", stop_time=STOPS["tracking"])) as other:
        theirs = other.read("resources/BeamPlant.fmu")
    assert (changed[1] / "resources/BeamPlant.fmu").read_bytes() != theirs


@pytest.mark.parametrize("scenario", [*STOPS, "high_fidelity"])
def test_the_package_is_valid(scenario: str, export: Export, capsys: pytest.CaptureFixture[str]) -> None:
    path = export(scenario, stop_time=STOPS.get(scenario, 0.01))
    assert package_problems(path) == []
    assert main(["validate", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: valid\n"
    package = read_ssd(str(path), validate=True)   # against the schemas that FMPy ships
    for component in package.system.elements:
        read_ssv(str(path), f"resources/{component.name}.ssv", validate=True)


def structure(path: Path) -> ElementTree.Element:
    with zipfile.ZipFile(path) as archive:
        return ElementTree.fromstring(archive.read("SystemStructure.ssd"))


def test_the_package_keeps_to_what_all_tools_read(export: Export) -> None:
    path = export("tracking", stop_time=STOPS["tracking"])
    with zipfile.ZipFile(path) as archive:
        names, text = archive.namelist(), archive.read("SystemStructure.ssd").decode()
    assert names == sorted(names)
    assert all(n == "SystemStructure.ssd" or n.startswith("resources/") for n in names)
    assert "<ssd:SystemStructureDescription" in text   # tools that look for the prefix itself find it
    assert "<ssc:Real" in text
    root = structure(path)
    assert root.get("version") == "1.0"
    assert [child.tag.rpartition("}")[2] for child in root] == ["System", "Units", "DefaultExperiment"]
    experiment = root.find("ssd:DefaultExperiment", NS)
    assert experiment is not None
    assert (experiment.get("startTime"), experiment.get("stopTime")) == ("0.0", "1.2")
    assert [e.get("baseStepSize") for e in experiment.iterfind(".//{*}FixedStepAlgorithm")] == ["0.0002"]
    assert [e.get("stepSize") for e in root.iterfind(".//{*}FixedStepMaster")] == ["0.0002"]
    system = root.find("ssd:System", NS)
    assert system is not None
    assert system.find("ssd:Connectors", NS) is None
    components = system.findall("ssd:Elements/ssd:Component", NS)
    assert [c.get("name") for c in components] == ["feedforward", "controller", "plant", "source"]
    connectors = {(c.get("name"), k.get("name")): (k.get("kind"), k[0]) for c in components
                  for k in c.iterfind("ssd:Connectors/ssd:Connector", NS)}
    assert all(typed.tag == f"{{{NS['ssc']}}}Real" for _, typed in connectors.values())
    ends = []
    for wire in system.iterfind("ssd:Connections/ssd:Connection", NS):
        kind, start = connectors[wire.get("startElement"), wire.get("startConnector")]
        other, end = connectors[wire.get("endElement"), wire.get("endConnector")]
        assert (kind, other) == ("output", "input")
        assert start.get("unit") == end.get("unit") is not None
        assert len(wire) == 0   # no transformation
        ends.append((wire.get("endElement"), wire.get("endConnector")))
    # FMPy gives an input that nothing drives the value of another one: there is none
    assert sorted(ends) == sorted(key for key, (kind, _) in connectors.items() if kind == "input")


@pytest.mark.parametrize("scenario", ["tracking", "disturbance"])
def test_the_diagram_is_tidy(scenario: str, export: Export) -> None:
    system = structure(export(scenario, stop_time=STOPS[scenario])).find("ssd:System", NS)
    assert system is not None

    def corners(element: Any) -> list[float]:
        return [float(element.get(k)) for k in ("x1", "y1", "x2", "y2")]

    canvas = corners(system.find("ssd:SystemGeometry", NS))
    blocks = {}
    for component in system.iterfind("ssd:Elements/ssd:Component", NS):
        x1, y1, x2, y2 = blocks[component.get("name")] = corners(component.find("ssd:ElementGeometry", NS))
        assert canvas[0] < x1 < x2 < canvas[2]
        assert canvas[1] < y1 < y2 < canvas[3]
        places = []
        for connector in component.iterfind("ssd:Connectors/ssd:Connector", NS):
            place = connector.find("ssd:ConnectorGeometry", NS)
            assert place is not None
            assert float(place.get("x", "")) == (0.0 if connector.get("kind") == "input" else 1.0)
            assert 0 < float(place.get("y", "")) < 1
            places.append((place.get("x"), place.get("y")))
        assert len(set(places)) == len(places)
    order = sorted(blocks, key=lambda name: blocks[name][0])
    assert order == ["source", "feedforward", "controller", "plant"]
    assert all(blocks[a][2] < blocks[b][0] for a, b in pairwise(order))


def test_equal_exports_have_equal_bytes(export: Export, tmp_path: Path) -> None:
    first = export("disturbance", stop_time=STOPS["disturbance"])
    again = export_ssp("disturbance", tmp_path / "again.ssp",
                       Settings(frames=False, stop_time=STOPS["disturbance"]))
    assert hashlib.sha256(again.read_bytes()).digest() == hashlib.sha256(first.read_bytes()).digest()


def test_units_carry_the_platforms_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "step.ssp"
    assert main(["export", "step_response", "--format", "ssp", "-o", str(path), "--structure", "kiel", "--platform",
                 "x86_64-linux", "--platform", "aarch64-linux", "--set", "plant.beam[1].tip_mass=0.011", "--coupling",
                 "gauss-seidel", "--stop-time", "0.5"]) == 0
    assert capsys.readouterr().out == f"{path}\n"
    with zipfile.ZipFile(path) as archive:
        for name in ("BeamPlant", "SignalSource"):
            with archive.open(f"resources/{name}.fmu") as file, zipfile.ZipFile(file) as fmu:
                folders = {n.split("/")[1] for n in fmu.namelist() if n.startswith("binaries/")}
                assert folders == {"linux64", "x86_64-linux", "aarch64-linux"}
    assert package_problems(path) == []


def test_fmus_that_a_scenario_brings_along_go_into_the_package(export: Export, tmp_path: Path,
                                                               write_scenario: Callable[[str, str], Path],
                                                               short: Callable[..., Settings]) -> None:
    with zipfile.ZipFile(export("tracking", stop_time=STOPS["tracking"])) as archive:
        (tmp_path / "theirs.fmu").write_bytes(archive.read("resources/BeamPlant.fmu"))
    text = ('title = "x"\nstructure = "kiel"\nstop_time = 0.1\n[instance.theirs]\nfmu = "theirs.fmu"\n{start}\n'
            '[instance.ours]\nunit = "BeamPlant"\n[[input]]\nto = "theirs.u"\nconstant = [1.0, 2.0, 3.0, 4.0]\n'
            '[[input]]\nto = "ours.u"\nconstant = [1.0, 2.0, 3.0, 4.0]\n')
    scenario = write_scenario("both", text.format(start=""))
    path = export(str(scenario))
    assert package_problems(path) == []
    recording = run_package(path, short()).recording
    assert deviation(run_scenario(str(scenario), short()).recording, recording) == 0
    mine, theirs = ([c for c in recording.columns if c.startswith(f"{n}.y_pi")] for n in ("ours", "theirs"))
    assert np.array_equal(recording.values[:, [recording.columns.index(c) for c in mine]],
                          recording.values[:, [recording.columns.index(c) for c in theirs]])
    scenario.write_text(text.format(start="start.noise_seed = 3"))
    with pytest.raises(InputError, match=r"instance\.theirs must keep the start values of its FMU in a package"):
        export_ssp(str(scenario), tmp_path / "bad.ssp", Settings(frames=False))
    assert not (tmp_path / "bad.ssp").exists()
