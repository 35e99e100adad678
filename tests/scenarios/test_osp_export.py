"""A scenario in the configuration of the Open Simulation Platform: valid, complete, the same as the package."""

import zipfile
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import pytest
from fmpy import read_model_description
from lxml import etree

from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.exporting.osp import export_osp
from flexbeams.scenarios.importing.osp import OSP_STRUCTURE
from flexbeams.scenarios.masters.isolation import run_master
from flexbeams.scenarios.masters.tasks import read_task
from flexbeams.scenarios.masters.trace import deviation
from flexbeams.scenarios.runs.scenario import run_scenario

pytestmark = pytest.mark.native
STOP, STEP = 1.2, 2e-4  # s
NS = {"o": OSP_STRUCTURE}
VALUES = {"plant.noise_seed": 5.0, "plant.strain_noise_std": 1e-8}


@pytest.fixture(scope="module")
def osp(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a scenario with start values of its own."""
    return export_osp(
        "tracking",
        tmp_path_factory.mktemp("osp") / "tracking",
        Settings(record_animation=False, stop_time=STOP, overrides=dict(VALUES)),
    )


@pytest.mark.masters
def test_libcosim_runs_it_as_the_runner_runs_the_scenario(osp: Path, run_folder: Path) -> None:
    pytest.importorskip("libcosimpy")
    structure = osp / "OspSystemStructure.xml"
    task = read_task(structure)
    assert (task.step, task.steps, task.components) == (STEP, 6000, ("feedforward", "controller", "plant", "source"))
    shown = [signal for signal in task.signals if signal.startswith(("plant.", "controller."))]
    trace = run_master("libcosim", structure, signals=shown)
    assert trace.values.shape == (6001, 4 + 6 + 4 + 4)
    own = run_scenario(
        "tracking",
        Settings(
            record_animation=False, build_folder=run_folder / "build/fmus", stop_time=STOP, overrides=dict(VALUES)
        ),
    ).recording
    assert deviation(trace, own) <= 1e-9


def test_it_is_valid(osp: Path) -> None:
    """By the schema that libcosim holds and checks it by."""
    pytest.importorskip("libcosimpy")
    spec = find_spec("libcosimpy")
    assert spec is not None
    assert spec.origin is not None
    library = next(Path(spec.origin).parent.glob("libcosimc/*cosimc.*")).read_bytes()
    at = library.index(f'targetNamespace="{OSP_STRUCTURE}"'.encode())
    begin, end = library.rindex(b"<xs:schema", 0, at), library.index(b"</xs:schema>", at) + len(b"</xs:schema>")
    schema = etree.XMLSchema(etree.fromstring(library[begin:end]))
    root = etree.parse(osp / "OspSystemStructure.xml").getroot()
    assert schema.validate(root), schema.error_log
    del root.find(".//o:Simulator", NS).attrib["source"]
    assert not schema.validate(root)


def test_it_says_what_the_units_say(osp: Path) -> None:
    root = etree.parse(osp / "OspSystemStructure.xml").getroot()
    assert [root.findtext(f"o:{key}", namespaces=NS) for key in ("StartTime", "EndTime", "BaseStepSize")] == [
        "0.0",
        "1.2",
        "0.0002",
    ]
    variables = {}
    for simulator in root.iterfind(".//o:Simulator", NS):
        description = read_model_description(str(osp / simulator.get("source")))
        variables[simulator.get("name")] = {v.name: v for v in description.modelVariables}
        values = {
            v.get("variable"): (v[0].tag.rpartition("}")[2], v[0].get("value"))
            for v in simulator.iterfind(".//o:InitialValue", NS)
        }
        assert values == {v.name: (v.type, v.start) for v in description.modelVariables if v.causality == "parameter"}
    assert list(variables) == ["feedforward", "controller", "plant", "source"]
    driven = []
    for wire in root.iterfind(".//o:VariableConnection", NS):
        ends = [variables[v.get("simulator")][v.get("name")] for v in wire]
        assert [v.causality for v in ends] == ["output", "input"]
        assert ends[0].unit == ends[1].unit
        driven.append((wire[1].get("simulator"), wire[1].get("name")))
    assert sorted(driven) == sorted(
        (unit, name) for unit, found in variables.items() for name, v in found.items() if v.causality == "input"
    )


def test_folder_and_archive_hold_the_same(
    tmp_path: Path, write_scenario: Callable[[str, str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = write_scenario(
        "constant",
        'title = "x"\nstructure = "single_beam"\nstop_time = 0.1\n[instance.plant]\n'
        'unit = "BeamPlant"\n[[input]]\nto = "plant.u"\nconstant = 300.0\n',
    )
    folder, archive, taken = tmp_path / "folder", tmp_path / "archive.zip", tmp_path / "taken"
    arguments = ["export", str(scenario), "--format", "ospsystem", "-o"]
    for out in (folder, archive):
        assert main([*arguments, str(out)]) == 0
        assert capsys.readouterr().out == f"{out}\n"
    with zipfile.ZipFile(archive) as entries:
        assert {n: entries.read(n) for n in entries.namelist()} == {p.name: p.read_bytes() for p in folder.iterdir()}
        assert set(entries.namelist()) == {"OspSystemStructure.xml", "BeamPlant.fmu", "SignalSource.fmu"}
    taken.write_text("")
    assert main([*arguments, str(taken)]) == 2
    assert "--out must be a folder, or FILE.zip, got" in capsys.readouterr().err
    assert main(["export", "tracking", "--format", "ssp", "-o", str(tmp_path)]) == 2
    assert "must be a regular file or a new path" in capsys.readouterr().err
