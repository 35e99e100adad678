"""Wiring files for tools without SSP: every connection of the package, in each tool's syntax."""

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import pytest

from flexbeams.scenarios.cli.main import main
from tests.native.workshop import needs_zig

pytestmark = needs_zig
TOOLS = ("veos", "simulink", "dymola", "mastersim", "te1420")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wiring") / "tracking"
    arguments = [text for tool in TOOLS for text in ("--wiring", tool)]
    assert main(["export", "tracking", *arguments, "-o", str(out)]) == 0
    return out


@pytest.fixture(scope="module")
def links(folder: Path) -> set[tuple[str, str]]:
    """Output and input of every connection, <component>.<variable>, by the declarations of the units."""
    wires = [("feedforward", "u_ff", "controller", "u_ff", 4), ("feedforward", "x_ref", "controller", "x_ref", 30)]
    wires += [("controller", "u", "plant", "u", 4), ("plant", "y_pm", "controller", "y_pm", 6)]
    wires += [("source", "y_target", "feedforward", "y_target", 4), ("source", "force", "plant", "force", 3)]
    sizes = {
        name: fmpy.read_model_description(str(folder / f"{unit}.fmu")).modelVariables
        for name, unit in (("plant", "BeamPlant"), ("controller", "TrackingController"))
    }
    gauges = sum(v.name.startswith("y_pm[") for v in sizes["plant"])
    return {
        (f"{start}.{output}[{k}]", f"{end}.{target}[{k}]")
        for start, output, end, target, count in wires
        for k in range(1, 1 + (gauges if output == "y_pm" else count))
    }


def test_the_units_are_there(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} == {
        "BeamPlant.fmu",
        "FlatnessFeedforward.fmu",
        "TrackingController.fmu",
        "SignalSource.fmu",
        "connections.json",
        "make_tracking.m",
        "tracking.mo",
        "tracking.msim",
        "flexbeams.xml",
    }


def test_veos(folder: Path, links: set[tuple[str, str]]) -> None:
    [package] = json.loads((folder / "connections.json").read_text())["CommunicationPackages"]
    assert package["PackageType"] == "StandardCommunicationPackage"
    found = {
        tuple(c[f"{end}SignalReference"].lstrip("/").replace("/", ".") for end in ("Out", "In"))
        for c in package["SignalConnections"]
    }
    assert found == links


def test_mastersim(folder: Path, links: set[tuple[str, str]]) -> None:
    text = (folder / "tracking.msim").read_text()
    assert set(re.findall(r"^graph (\S+) (\S+)$", text, re.MULTILINE)) == links
    blocks = re.findall(r'^simulator \d+ \d+ (\w+) #[0-9a-f]{8} "([^"]+)"$', text, re.MULTILINE)
    assert {name for name, _ in blocks} == {"plant", "feedforward", "controller", "source"}
    assert all((folder / file).is_file() for _, file in blocks)
    for key, value in (
        ("tEnd", "6.0 s"),
        ("hStart", "0.0002 s"),
        ("adjustStepSize", "no"),
        ("MasterMode", "GAUSS_JACOBI"),
    ):
        assert re.search(rf"^{key} +{re.escape(value)}$", text, re.MULTILINE), key


def test_dymola(folder: Path, links: set[tuple[str, str]]) -> None:
    text = (folder / "tracking.mo").read_text()
    assert text.startswith('model tracking "')
    assert text.endswith("end tracking;\n")
    assert set(re.findall(r"^  connect\((\S+), (\S+)\);$", text, re.MULTILINE)) == links
    components = dict(
        re.findall(r"^  (\w+)_fmu (\w+)\(fmi_CommunicationStepSize=0\.0002, fmi_StopTime=6\.0\);$", text, re.MULTILINE)
    )
    assert components == {
        "BeamPlant": "plant",
        "FlatnessFeedforward": "feedforward",
        "TrackingController": "controller",
        "SignalSource": "source",
    }
    assert all(
        f'importFMU(fileName="{unit}.fmu", integrate=false, modelName="{unit}_fmu");' in text for unit in components
    )


def test_simulink(folder: Path, links: set[tuple[str, str]]) -> None:
    """The numbers of ports are those of the units' declarations, by element."""
    text = (folder / "make_tracking.m").read_text()
    blocks = dict(re.findall(r"\[model '/(\w+)'\], 'FMUName', '(\w+)\.fmu'", text))
    ports = {}
    for name, unit in blocks.items():
        variables = fmpy.read_model_description(str(folder / f"{unit}.fmu")).modelVariables
        ports[name] = {kind: [v.name for v in variables if v.causality == kind] for kind in ("input", "output")}
    pattern = (
        r"connect_arrays\(model, '(\w+)', struct\('array', \d+, 'elements', (\d+):(\d+)\), "
        r"'(\w+)', struct\('array', \d+, 'elements', (\d+):(\d+)\)\);"
    )
    found = set()
    for start, a, b, end, c, d in re.findall(pattern, text):
        outputs = ports[start]["output"][int(a) - 1 : int(b)]
        inputs = ports[end]["input"][int(c) - 1 : int(d)]
        found |= {(f"{start}.{o}", f"{end}.{i}") for o, i in zip(outputs, inputs, strict=True)}
    assert found == links
    assert text.count("function ") == 1
    assert text.rstrip().endswith("end")


def test_te1420(folder: Path) -> None:
    """The elements of Beckhoff's template, and the tool that the descriptions name."""
    root = ElementTree.parse(folder / "flexbeams.xml").getroot()
    assert root.tag == "CustomConfigurations"
    [configuration] = root
    assert [element.tag for element in configuration] == [
        "ToolName",
        "AdditionalInclude",
        "PreprocessorDefinitions",
        "ExcludedFromBuild",
    ]
    description = fmpy.read_model_description(str(folder / "BeamPlant.fmu"))
    assert configuration[0].text == description.generationTool


def test_mistakes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()
    assert main(["export", "tracking", "--wiring", "veos", "-o", str(tmp_path / "file")]) == 2
    assert "must be a folder, or FILE.zip" in capsys.readouterr().err
    assert main(["export", "tracking", "--wiring", "veos", "--format", "ssp"]) == 2
    assert "--wiring belongs to --format wiring" in capsys.readouterr().err
    assert main(["export", "tracking", "--format", "wiring"]) == 2
    assert "--wiring" in capsys.readouterr().err
