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
from fmpy.ssp.ssd import read_ssd, read_ssv

from flexbeams.plant.errors import InputError
from flexbeams.plant.structure import find_structure, read_structure
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.ssp import export_ssp
from flexbeams.scenarios.runs.package import run_package
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.instance import UnitInstance
from flexbeams.scenarios.simulation.recording import Recording
from flexbeams.scenarios.validation.package import package_problems
from tests.helpers import Export, exported_once

pytestmark = pytest.mark.native

STEP = 2e-4
STOPS = {"tracking": 1.2, "disturbance": 1.1, "retarget": 1.7}  # s: into the motions
SCENARIOS = (*STOPS, "high_fidelity", "step_response", "single_beam", "five_beams")
NS = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
}


@pytest.fixture(scope="module")
def export() -> Export:
    return exported_once(export_ssp, ".ssp")


def deviation(one: Recording, other: Recording) -> float:
    """Largest difference of a column of `one`, relative to its largest value."""
    places = [other.columns.index(c) for c in one.columns]
    error = np.max(np.abs(one.values - other.values[:, places]), axis=0)
    scale = np.max(np.abs(one.values), axis=0)
    assert np.all(error[scale == 0] == 0)
    return float(np.max(error[scale > 0] / scale[scale > 0]))


@pytest.mark.parametrize(
    ("scenario", "coupling"), [*((scenario, "jacobi") for scenario in STOPS), ("retarget", "gauss-seidel")]
)
def test_the_package_runs_as_its_scenario(
    scenario: str, coupling: Any, export: Export, short: Callable[..., Settings]
) -> None:
    stop = STOPS[scenario]
    package = run_package(export(scenario, stop_time=stop, coupling=coupling), short())
    own = run_scenario(scenario, short(stop_time=stop, coupling=coupling))
    assert package.recording.steps == own.recording.steps == round(stop / STEP)
    assert package.summary["coupling"] == coupling
    assert package.summary["design_id"] == own.design.design_id
    assert np.max(np.abs(own.recording.values[:, own.recording.columns.index("controller.u[1]")])) > 1
    assert deviation(own.recording, package.recording) <= 1e-12


@pytest.fixture(scope="module")
def changed(export: Export) -> Path:
    """A package with start values of its own."""
    return export(
        "mismatch",
        stop_time=0.1,
        overrides={
            "plant.beam[2].tip_mass": 0.033,
            "plant.strain_noise_std": 1e-7,
            "plant.noise_seed": 5.0,
            "controller.feedback": False,
            "plant.force": [0.0, 0.5, 0.0],
        },
    )


Values = dict[str, dict[str, float]]


def number(kind: str, text: str) -> float:
    return {"true": 1.0, "false": 0.0}[text] if kind == "Boolean" else float(text)


def start_values(path: Path, folder: Path) -> tuple[Values, Values, Values]:
    """Parameters by component: in the parameter set, in modelDescription.xml, in the kernel before initialisation."""
    sets, described, kernels = {}, {}, {}
    fmpy.extract(str(path), unzipdir=str(folder))
    for component in read_ssd(str(path)).system.elements:
        unit = Path(fmpy.extract(str(folder / component.source), unzipdir=str(folder / component.name)))
        description = fmpy.read_model_description(str(unit))
        parameters = [p for b in component.parameterBindings for v in b.parameterValues for p in v.parameters]
        sets[component.name] = {p.name: number(p.type, p.value) for p in parameters}
        described[component.name] = {
            v.name: number(v.type, v.start) for v in description.modelVariables if v.causality == "parameter"
        }
        with UnitInstance(component.name, unit, description, print) as instance:
            kernels[component.name] = {name: float(instance.get(name)) for name in sets[component.name]}
    return sets, described, kernels


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_start_values_are_equal_in_description_kernel_and_parameter_set(
    scenario: str, export: Export, tmp_path: Path
) -> None:
    sets, described, kernels = start_values(export(scenario, stop_time=STOPS.get(scenario, 0.01)), tmp_path)
    assert sets == described == kernels
    assert "plant" in sets
    assert all(sets.values())


def test_start_values_that_were_set_are_in_all_three(changed: Path, tmp_path: Path) -> None:
    sets, described, kernels = start_values(changed, tmp_path)
    assert sets == described == kernels
    wanted = {
        "plant": {"beam[2].tip_mass": 0.033, "strain_noise_std": 1e-7, "noise_seed": 5.0},
        "controller": {"feedback": 0.0},
        "source": {"force_constant.value[2]": 0.5},
    }
    for component, values in wanted.items():
        assert values.items() <= sets[component].items()
    springs = [value for name, value in sets["plant"].items() if name.startswith("spring")]
    nominal = read_structure(find_structure("kiel")).spring
    assert springs == pytest.approx([1.1 * s.stiffness for s in nominal])  # by the scenario


def test_start_values_change_the_unit_s_identity(changed: Path, export: Export) -> None:
    contents = []
    for path in (changed, export("tracking", stop_time=STOPS["tracking"])):
        with zipfile.ZipFile(path) as archive:
            contents.append(archive.read("resources/BeamPlant.fmu"))
    assert contents[0] != contents[1]


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_the_package_is_valid(scenario: str, export: Export, capsys: pytest.CaptureFixture[str]) -> None:
    path = export(scenario, stop_time=STOPS.get(scenario, 0.01))
    assert package_problems(path) == []
    assert main(["validate", str(path)]) == 0
    assert capsys.readouterr().out == f"{path}: valid\n"
    package = read_ssd(str(path), validate=True)  # against the schemas that FMPy ships
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
    assert "<ssd:SystemStructureDescription" in text  # tools that look for the prefix itself find it
    assert "<ssc:Real" in text
    root = structure(path)
    assert root.get("version") == "1.0"
    assert [child.tag.rpartition("}")[2] for child in root] == ["System", "Units", "DefaultExperiment"]
    experiment = root.find("ssd:DefaultExperiment", NS)
    assert experiment is not None
    assert (experiment.get("startTime"), experiment.get("stopTime")) == ("0.0", "1.2")
    assert [e.get("baseStepSize") for e in experiment.iterfind(".//{*}FixedStepAlgorithm")] == ["0.0002"]
    assert [e.get("stepSize") for e in root.iterfind(".//{*}FixedStepMaster")] == ["0.0002"]
    [information] = root.iterfind(".//{*}SimulationInformation")  # OMSimulator 3 takes 1 ms without these, silently
    assert information.attrib == {"name": "oms_ma_default", "method": "oms_ma", "fixedStepSize": "0.0002"}
    assert root.findall(".//ssd:Component/ssd:Annotations", NS) == []  # which OMSimulator 2 refuses
    assert root.findall(".//ssd:SystemGeometry", NS) == []  # likewise
    system = root.find("ssd:System", NS)
    assert system is not None
    assert system.find("ssd:Connectors", NS) is None
    components = system.findall("ssd:Elements/ssd:Component", NS)
    assert [c.get("name") for c in components] == ["feedforward", "controller", "plant", "source"]
    connectors = {
        (c.get("name"), k.get("name")): (k.get("kind"), k[0])
        for c in components
        for k in c.iterfind("ssd:Connectors/ssd:Connector", NS)
    }
    assert all(typed.tag == f"{{{NS['ssc']}}}Real" for _, typed in connectors.values())
    ends = []
    for wire in system.iterfind("ssd:Connections/ssd:Connection", NS):
        kind, start = connectors[wire.get("startElement"), wire.get("startConnector")]
        other, end = connectors[wire.get("endElement"), wire.get("endConnector")]
        assert (kind, other) == ("output", "input")
        assert start.get("unit") == end.get("unit") is not None
        assert [part.tag for part in wire] in ([], [f"{{{NS['ssd']}}}ConnectionGeometry"])  # no transformation
        ends.append((wire.get("endElement"), wire.get("endConnector")))
    # FMPy gives an input that nothing drives the value of another one: there is none
    assert sorted(ends) == sorted(key for key, (kind, _) in connectors.items() if kind == "input")


def corners(element: Any) -> list[float]:
    return [float(element.get(k)) for k in ("x1", "y1", "x2", "y2")]


@pytest.mark.parametrize("scenario", ["tracking", "disturbance", "five_beams"])
def test_the_diagram_is_tidy(scenario: str, export: Export) -> None:
    system = structure(export(scenario, stop_time=STOPS.get(scenario, 0.01))).find("ssd:System", NS)
    assert system is not None
    assert system.find("ssd:SystemGeometry", NS) is None  # which OMSimulator 2 refuses
    blocks, places = {}, {}
    for component in system.iterfind("ssd:Elements/ssd:Component", NS):
        x1, y1, x2, y2 = blocks[component.get("name")] = corners(component.find("ssd:ElementGeometry", NS))
        assert 0 < x1 < x2
        assert 0 < y1 < y2
        for connector in component.iterfind("ssd:Connectors/ssd:Connector", NS):
            place = connector.find("ssd:ConnectorGeometry", NS)
            assert place is not None
            x, y = float(place.get("x", "")), float(place.get("y", ""))
            assert x == (0.0 if connector.get("kind") == "input" else 1.0)
            assert 0 < y < 1
            places[component.get("name"), connector.get("name")] = x1 + x * (x2 - x1), y1 + y * (y2 - y1)
    assert len(set(places.values())) == len(places)
    order = sorted(blocks, key=lambda name: blocks[name][0])
    assert order == ["source", "feedforward", "controller", "plant"]
    assert all(blocks[a][2] < blocks[b][0] for a, b in pairwise(order))
    segments, bent = [], 0
    for wire in system.iterfind("ssd:Connections/ssd:Connection", NS):
        geometry = wire.find("ssd:ConnectionGeometry", NS)
        points = (
            []
            if geometry is None
            else list(zip(*(map(float, geometry.get(f"points{axis}", "").split()) for axis in "XY"), strict=True))
        )
        bent += geometry is not None
        way = [
            places[wire.get("startElement"), wire.get("startConnector")],
            *points,
            places[wire.get("endElement"), wire.get("endConnector")],
        ]
        assert all(x > 0 and y > 0 for x, y in way)
        segments += list(pairwise(way))
        # Upright or level around blocks, so that the extent of a segment is all it needs
        assert geometry is None or all(np.isclose(a, b, atol=1e-3).any() for a, b in pairwise(way))
    assert 0 < bent < len(segments)
    for (x1, y1), (x2, y2) in segments:
        for left, low, right, high in blocks.values():
            assert (
                max(x1, x2) <= left + 1e-3 or min(x1, x2) >= right - 1e-3 or max(y1, y2) <= low or min(y1, y2) >= high
            )
    # No two on one another
    levels = sorted((y1, min(x1, x2), max(x1, x2)) for (x1, y1), (x2, y2) in segments if y1 == y2 and x1 != x2)
    assert all(a[0] != b[0] or a[2] <= b[1] for a, b in pairwise(levels))


def test_equal_exports_have_equal_bytes(export: Export, tmp_path: Path) -> None:
    first = export("disturbance", stop_time=STOPS["disturbance"])
    again = export_ssp(
        "disturbance", tmp_path / "again.ssp", Settings(record_animation=False, stop_time=STOPS["disturbance"])
    )
    assert hashlib.sha256(again.read_bytes()).digest() == hashlib.sha256(first.read_bytes()).digest()


def test_units_carry_the_platforms_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "step.ssp"
    assert (
        main(
            [
                "export",
                "step_response",
                "--format",
                "ssp",
                "-o",
                str(path),
                "--structure",
                "kiel",
                "--platform",
                "x86_64-linux",
                "--platform",
                "aarch64-linux",
                "--set",
                "plant.beam[1].tip_mass=0.011",
                "--coupling",
                "gauss-seidel",
                "--stop-time",
                "0.5",
            ]
        )
        == 0
    )
    assert capsys.readouterr().out == f"{path}\n"
    with zipfile.ZipFile(path) as archive:
        for name in ("BeamPlant", "SignalSource"):
            with archive.open(f"resources/{name}.fmu") as file, zipfile.ZipFile(file) as fmu:
                folders = {n.split("/")[1] for n in fmu.namelist() if n.startswith("binaries/")}
                assert folders == {"linux64", "x86_64-linux", "aarch64-linux"}
    assert package_problems(path) == []


def test_fmus_that_a_scenario_brings_along_go_into_the_package(
    export: Export, tmp_path: Path, write_scenario: Callable[[str, str], Path], short: Callable[..., Settings]
) -> None:
    with zipfile.ZipFile(export("tracking", stop_time=STOPS["tracking"])) as archive:
        (tmp_path / "theirs.fmu").write_bytes(archive.read("resources/BeamPlant.fmu"))
    text = (
        'title = "x"\nstructure = "kiel"\nstop_time = 0.1\n[instance.theirs]\nfmu = "theirs.fmu"\n{start}\n'
        '[instance.ours]\nunit = "BeamPlant"\n[[input]]\nto = "theirs.u"\nconstant = [1.0, 2.0, 3.0, 4.0]\n'
        '[[input]]\nto = "ours.u"\nconstant = [1.0, 2.0, 3.0, 4.0]\n'
    )
    scenario = write_scenario("both", text.format(start=""))
    path = export(str(scenario))
    assert package_problems(path) == []
    recording = run_package(path, short()).recording
    assert deviation(run_scenario(str(scenario), short()).recording, recording) == 0
    mine, theirs = ([c for c in recording.columns if c.startswith(f"{n}.y_pi")] for n in ("ours", "theirs"))
    assert np.array_equal(
        recording.values[:, [recording.columns.index(c) for c in mine]],
        recording.values[:, [recording.columns.index(c) for c in theirs]],
    )
    scenario.write_text(text.format(start="start.noise_seed = 3"))
    with pytest.raises(InputError, match=r"instance\.theirs must keep the start values of its FMU in a package"):
        export_ssp(str(scenario), tmp_path / "bad.ssp", Settings(record_animation=False))
    assert not (tmp_path / "bad.ssp").exists()
