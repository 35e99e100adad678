"""The page of the native kernels: its example runs as printed, on several machines; its sizes are measured."""

import json
import os
import platform
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flexbeams.fmus.packaging.native import HEADERS
from flexbeams.fmus.units.native_kernel import NATIVE
from tests.helpers import design_of
from tests.native.processors import ARM32, HERE, RISCV64, X86_32, Processor
from tests.native.workshop import (
    HARNESSES,
    INCLUDES,
    NATIVE_UNITS,
    guid_of,
    native_fmus,
    native_unit,
    needs,
    run,
    source_file,
)

PAGE = (NATIVE / "README.md").read_text(encoding="utf-8")
TARGET = [-8e-3, 1e-3, 4e-3, -6e-3]  # m
on_x86_linux = pytest.mark.skipif(
    platform.machine() != "x86_64" or sys.platform != "linux", reason="this is not x86-64 Linux"
)
pytestmark = pytest.mark.native


def block(language: str) -> str:
    """The page's one block of a language."""
    (text,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return str(text)


@needs("cc", "unzip", "sh")
def test_the_commands_build_the_example(tmp_path: Path) -> None:
    """As printed, but for `flexbeams build`: the units lie where it puts them."""
    (tmp_path / "rig.c").write_text(block("c"))
    (tmp_path / "units").mkdir()
    (tmp_path / "units" / "native").symlink_to(native_fmus())
    (tmp_path / "flexbeams").write_text("#!/bin/sh\nexit 0\n")
    (tmp_path / "flexbeams").chmod(0o755)
    environment = os.environ | {"FMI2_HEADERS": str(HEADERS), "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    run(["sh", "-e", "-c", block("sh")], cwd=tmp_path, env=environment)
    printed = run([str(tmp_path / "rig")])
    assert printed.splitlines()[0].startswith("y_pi[1] = ")
    np.testing.assert_allclose(numbers(printed), TARGET, rtol=0, atol=1e-6)


def test_value_references_of_the_example() -> None:
    """Those of modelDescription.xml, with the sizes of the arrays."""
    sizes = {name: int(value) for name, value in re.findall(r"(POINTS|VOLTAGES|GAUGES|STATES) = (\d+)", block("c"))}
    lines = re.findall(r"^enum \{ (.*?) \};\s+/\* (\w+) \*/$", block("c"), re.MULTILINE)
    assert [unit for _, unit in lines] == ["FlatnessFeedforward", "TrackingController", "BeamPlant"]
    for entries, unit in lines:
        interface = native_unit(unit, design_of(), Path()).interface
        for name, value in (entry.split(" = ") for entry in entries.split(", ")):
            array = re.sub(r"_(in|out)$", "", name.lower())
            references = interface.references(array)
            assert references.start == int(value), (unit, name)
            kind = {"y_target": "POINTS", "y_pi": "POINTS", "x_ref": "STATES", "y_pm": "GAUGES"}.get(array, "VOLTAGES")
            assert len(references) == sizes[kind]


def numbers(printed: str) -> list[float]:
    """The deflections that the example prints, m."""
    return [float(line.split()[2]) for line in printed.splitlines()]


def deflections(processor: Processor, folder: Path) -> list[float]:
    """What the example prints with the three units, built by zig for a processor."""
    (folder / "rig.c").write_text(block("c"))
    flags = ["-std=c99", "-O2", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Wshadow", "-Werror"]
    names = {"FEEDFORWARD": "FlatnessFeedforward", "CONTROLLER": "TrackingController", "PLANT": "BeamPlant"}
    guids = [f'-D{name}_GUID="{guid_of(unit)}"' for name, unit in names.items()]
    sources = [str(folder / "rig.c"), *(str(source_file(unit)) for unit in names.values())]
    program = folder / f"rig-{processor.target}"
    run([*processor.compiler, *flags, f"-I{HEADERS}", *guids, *sources, "-o", str(program), "-lm"])
    return numbers(run([*processor.through, str(program)]))


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> list[float]:
    """What the example prints on this machine."""
    return deflections(HERE, tmp_path_factory.mktemp("here"))


@on_x86_linux
@pytest.mark.parametrize(
    "processor", [pytest.param(other, marks=other.needed, id=other.target) for other in (ARM32, X86_32, RISCV64)]
)
def test_the_example_on_other_machines(processor: Processor, here: list[float], tmp_path: Path) -> None:
    """Without a warning, and to 1e-12 of the largest deflection that of this machine."""
    np.testing.assert_allclose(deflections(processor, tmp_path), here, rtol=0, atol=1e-12 * max(map(abs, here)))


@ARM32.needed
@needs("readelf")
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_sizes_on_arm(unit: str, tmp_path: Path) -> None:
    """Code, tables, heap and stack of the page's table, to 10 %; alignment moves the stack by up to 64 bytes."""
    row = next(line for line in PAGE.splitlines() if line.startswith(f"| `{unit}`") and line.count("|") == 6)
    code, tables, heap, stack = (int(cell.replace(",", "")) for cell in row.split("|")[2:6])
    compiler = [*ARM32.compiler, "-std=c99", "-O2", "-ffp-contract=off", *INCLUDES]
    definitions = [f'-DUNIT_GUID="{guid_of(unit)}"', "-DFMI2_OVERRIDE_FUNCTION_PREFIX"]
    run([*compiler, "-c", str(source_file(unit)), "-o", str(tmp_path / "unit.o")])
    program = tmp_path / "footprint"
    harness = str(HARNESSES / "footprint.c")
    run([*compiler, *definitions, str(source_file(unit)), harness, "-o", str(program), "-lm"])
    used = json.loads(run([*ARM32.through, str(program)]))
    sections = section_sizes(tmp_path / "unit.o")
    assert code == pytest.approx(sections[".text"], rel=0.1)
    assert tables == pytest.approx(sections[".rodata"], rel=0.1)
    assert heap == pytest.approx(used["heap"], rel=0.1)
    assert stack == pytest.approx(used["stack"], rel=0.1, abs=64)
    (line_of_log,) = re.findall(r"A line for the log takes (\S+) KB of stack", PAGE)
    assert used["stack_of_log"] == pytest.approx(1000 * float(line_of_log), rel=0.1)


def section_sizes(file: Path) -> dict[str, int]:
    """Bytes of code and constants in an object file."""
    text = subprocess.run(["readelf", "-S", "-W", str(file)], capture_output=True, text=True, check=True).stdout
    sizes = {".text": 0, ".rodata": 0}
    for name, size in re.findall(r"\] (\.\S+)\s+PROGBITS\s+[0-9a-f]+ [0-9a-f]+ ([0-9a-f]+)", text):
        for kind in sizes:
            if name.startswith(kind):
                sizes[kind] += int(size, 16)
    return sizes
