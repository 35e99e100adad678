"""The pages about other tools: sections, commands, snippets and the figures that they give."""

import re
import shlex
import subprocess
import sys
import textwrap
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave

from flexbeams.scenarios.cli.main import commands, main
from tests.helpers import ROOT, python_environment

FOLDER = ROOT / "fmus/guides"
TOOLS = tuple(sorted(path.stem for path in FOLDER.iterdir() if path.name != "README.md"))
SECTIONS = ["What to import", "How", "Step and solver", "What to expect", "Known limits"]
RUN_HERE = {"ecos": "ecospy", "fmpy": "fmpy", "libcosim": "libcosimpy"}  # page: module
TARGET = (-8e-3, 1e-3, 4e-3, -6e-3)  # m, from 1 s on
STEP, STOP = 2e-4, 2.3  # s

Make = Callable[[str], None]


def page(tool: str) -> str:
    """The text of a page."""
    return (FOLDER / f"{tool}.md").read_text(encoding="utf-8")


def fenced(tool: str, language: str) -> list[str]:
    """Its fenced blocks of a language, those in lists without their indent."""
    pattern = rf"^( *)```{language}\n(.*?)^\1```"
    return [textwrap.dedent(m.group(2)) for m in re.finditer(pattern, page(tool), re.DOTALL | re.MULTILINE)]


def lines_of(tool: str) -> list[str]:
    """Commands to make what is imported: shell blocks hold nothing else."""
    return [line for block in fenced(tool, "sh") for line in block.splitlines()]


def spans(tool: str) -> list[str]:
    """Commands within sentences."""
    text = re.sub(r"^ *```.*?^ *```", "", page(tool), flags=re.DOTALL | re.MULTILINE)
    return [" ".join(span.split()) for span in re.findall(r"`(flexbeams [^`]+)`", text)]


@pytest.fixture(scope="module")
def done() -> set[str]:
    """Commands that have run."""
    return set()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where commands and snippets of all pages run."""
    return tmp_path_factory.mktemp("tool_pages")


@pytest.fixture
def make(done: set[str], folder: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Runs a command of a page, each once."""
    monkeypatch.chdir(folder)

    def run(line: str) -> None:
        if line not in done:
            assert main(shlex.split(line)[1:]) == 0
            done.add(line)

    return run


def test_the_table_names_every_page() -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| \[[^\]]+\]\((\w+)\.md\)", text, re.MULTILINE)) == set(TOOLS)
    rows = [line.strip("|").split("|") for line in text.splitlines() if line.startswith("|")]
    assert {len(row) for row in rows} == {6}
    assert len(TOOLS) == 22


@pytest.mark.parametrize("tool", TOOLS)
def test_a_page_has_the_sections_and_says_whether_it_was_run(tool: str) -> None:
    text = page(tool)
    title, empty, status, *_ = text.splitlines()
    assert title.startswith("# ")
    assert empty == ""
    by_tests = tool in RUN_HERE or tool == "c_host"
    assert status.startswith("Run here: yes, by tests/" if by_tests else "Not run here; written from ")
    assert re.findall(r"^## (.*)", text, re.MULTILINE) == SECTIONS
    assert max(map(len, text.splitlines())) <= 120
    assert "-8.000" in text.split("## What to expect")[1]
    assert "817.0" in text.split("## What to expect")[1]
    assert "\nSources: " in text.split("## Known limits")[1]


@pytest.mark.parametrize("tool", TOOLS)
def test_a_page_names_only_files_that_exist(tool: str) -> None:
    text = page(tool)
    for target in re.findall(r"\]\((?!https://)([^)#]+)\)", text):
        assert (FOLDER / target).exists(), target
    for name in re.findall(r"\btests/[\w/]+\.py", text):
        assert (ROOT / name).exists(), name


@pytest.mark.parametrize(("tool", "line"), [(tool, line) for tool in TOOLS for line in (*lines_of(tool), *spans(tool))])
def test_a_command_of_a_page_parses(tool: str, line: str) -> None:
    program, verb, *arguments = shlex.split(line)
    assert program == "flexbeams"
    command = commands.commands[verb]
    with command.make_context(verb, arguments) as context:
        assert context.params


@pytest.mark.parametrize("tool", [tool for tool in TOOLS if tool not in RUN_HERE])
def test_python_that_is_not_run_is_python_at_least(tool: str) -> None:
    for text in fenced(tool, "python"):
        compile(text, tool, "exec")


@pytest.mark.parametrize("tool", RUN_HERE)
@pytest.mark.native
@pytest.mark.masters
def test_the_snippet_of_a_page_prints_what_the_page_says(tool: str, make: Make, folder: Path) -> None:
    if find_spec(RUN_HERE[tool]) is None:
        pytest.skip(f"{RUN_HERE[tool]} is not installed")
    for line in lines_of(tool):
        make(line)
    [text], [expected] = fenced(tool, "python"), fenced(tool, "text")
    ended = subprocess.run(
        [sys.executable, "-c", text],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=python_environment(TMPDIR=str(folder)),
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout == expected


@contextmanager
def unit(file: Path, folder: Path) -> Iterator[tuple[Any, Callable[[str], list[int]]]]:
    """An initialised unit, and the value references of an array of it."""
    extracted = fmpy.extract(str(file), unzipdir=str(folder / file.stem))
    description = fmpy.read_model_description(str(extracted))
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=extracted,
        instanceName=file.stem,
        modelIdentifier=description.coSimulation.modelIdentifier,
    )
    slave.instantiate()
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    try:
        yield (
            slave,
            lambda array: [v.valueReference for v in description.modelVariables if v.name.split("[")[0] == array],
        )
    finally:
        slave.terminate()
        slave.freeInstance()


def loop_errors(package: Path, folder: Path, delays: int) -> tuple[float, float]:
    """Of the tracking scenario: largest error from 1.9 s on (m), largest voltage (V).

    All units take the values of t_k, then step; each connection has as many unit delays on top.
    """
    with zipfile.ZipFile(package) as archive:
        archive.extractall(folder)
    with ExitStack() as stack:
        units = {
            name: stack.enter_context(unit(folder / f"resources/{name}.fmu", folder))
            for name in ("FlatnessFeedforward", "TrackingController", "BeamPlant")
        }
        (feedforward, of_feedforward), (controller, of_controller), (plant, of_plant) = units.values()
        wires = [
            (source, of_source(array), end, of_end(array))
            for source, of_source, end, of_end, array in (
                (feedforward, of_feedforward, controller, of_controller, "u_ff"),
                (feedforward, of_feedforward, controller, of_controller, "x_ref"),
                (controller, of_controller, plant, of_plant, "u"),
                (plant, of_plant, controller, of_controller, "y_pm"),
            )
        ]
        lines = [[[0.0] * len(outputs)] * delays for _, outputs, _, _ in wires]
        target, deflections, voltages = of_feedforward("y_target"), of_plant("y_pi"), of_controller("u")
        error = voltage = 0.0
        for k in range(round(STOP / STEP)):
            for line, (source, outputs, _, _) in zip(lines, wires, strict=True):
                line.append(source.getReal(outputs))
            for line, (_, _, end, inputs) in zip(lines, wires, strict=True):
                end.setReal(inputs, line.pop(0))
            feedforward.setReal(target, TARGET if k >= round(1.0 / STEP) else (0.0,) * 4)
            for slave, _ in units.values():
                slave.doStep(k * STEP, STEP)
            voltage = max(voltage, np.max(np.abs(controller.getReal(voltages))))
            if k + 1 >= round(1.9 / STEP):
                error = max(error, np.max(np.abs(np.subtract(plant.getReal(deflections), TARGET))))
    return float(error), float(voltage)


@pytest.mark.parametrize(("delays", "bound"), [(0, 0.35e-6), (1, 0.4e-6)])
@pytest.mark.native
def test_errors_and_voltages_of_single_units_are_as_the_pages_say(
    delays: int, bound: float, make: Make, folder: Path, tmp_path: Path
) -> None:
    make(lines_of("ecos")[0])
    error, voltage = loop_errors(folder / "tracking.ssp", tmp_path, delays)
    assert 0.9 * bound < error < bound
    assert voltage == pytest.approx(817.0, abs=0.1)


@pytest.mark.native
def test_single_units_list_all_their_sources(make: Make, folder: Path, tmp_path: Path) -> None:
    make(lines_of("ecos")[0])
    with zipfile.ZipFile(folder / "tracking.ssp") as archive:
        files = [Path(archive.extract(name, tmp_path)) for name in archive.namelist() if name.endswith(".fmu")]
    for file in files:
        with zipfile.ZipFile(file) as archive:
            present = {Path(name).name for name in archive.namelist() if re.fullmatch(r"sources/\w+\.c", name)}
            description = ElementTree.fromstring(archive.read("modelDescription.xml"))
        assert [entry.get("name") for entry in description.iter("File")] == sorted(present)
