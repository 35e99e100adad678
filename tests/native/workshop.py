"""Native units for the tests, built where first asked for, and their sources compiled again with a harness."""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import pytest

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging.closed_loop import ClosedLoop, closed_loop_unit
from flexbeams.fmus.packaging.native import HEADERS, NativeUnit, build_native_units, compiled_file, unit_sources
from flexbeams.fmus.units.beam_plant import BEAM_PLANT
from flexbeams.fmus.units.catalogue import CATALOGUE
from flexbeams.fmus.units.closed_loop import CLOSED_LOOP, LoopPart, LoopWire
from flexbeams.fmus.units.flatness_feedforward import FLATNESS_FEEDFORWARD
from flexbeams.fmus.units.native_kernel import NATIVE
from flexbeams.fmus.units.tracking_controller import TRACKING_CONTROLLER
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import UNITS, design_of, extracted_once, made_once, session_folder

HARNESSES = Path(__file__).parent
FUNCTIONS = sorted(
    name
    for name in {*dir(fmpy.fmi2.FMU2Slave), *dir(fmpy.fmi2.FMU2Model)}
    if name.startswith("fmi2") and name[4].isupper()
)  # of FMI 2.0
UNIT = CLOSED_LOOP.name
NATIVE_UNITS = (*UNITS, UNIT)
STRICT = (
    "-std=c99",
    "-ffp-contract=off",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wshadow",
    "-Wundef",
    "-Werror",
)
INCLUDES = tuple(f"-I{folder}" for folder in (NATIVE, NATIVE / "fmi", NATIVE / "numerics", NATIVE / "units", HEADERS))
ZIG = (sys.executable, "-m", "ziglang", "cc")
needs_zig = pytest.mark.native


def needs(*tools: str) -> pytest.MarkDecorator:
    """Skips a test where a program is not installed."""
    missing = [tool for tool in tools if shutil.which(tool) is None]
    return pytest.mark.skipif(bool(missing), reason=f"not installed: {', '.join(missing)}")


@cache
def workspace() -> Path:
    """A folder of this process within that of the session."""
    folder = session_folder() / f"native-{os.getpid()}"
    folder.mkdir()
    return folder


def native_unit(unit: str, design: Design, out: Path) -> NativeUnit:
    """A unit of a design without reference results, with the plant in the design's own basis."""
    if unit == UNIT:
        return closed_loop(design, out)
    kind = next(kind for kind in CATALOGUE if kind.name == unit)
    interface, data = kind.contents(design, design.model())
    return NativeUnit(kind=kind, interface=interface, data=data, out=out)


def closed_loop(design: Design, out: Path) -> ClosedLoop:
    """All three units of a design in one, wired as in the scenario `tracking`."""
    kinds = {"feedforward": FLATNESS_FEEDFORWARD, "controller": TRACKING_CONTROLLER, "plant": BEAM_PLANT}
    parts = []
    for name, kind in kinds.items():
        interface, data = kind.contents(design, design.model())
        parts.append(LoopPart(name=name, kind=kind, interface=interface, data=data))
    wires = [
        LoopWire(source=f"{owner}.{v.name}", to=f"{part.name}.{v.name}")
        for part in parts
        for owner, array in (("feedforward", "u_ff"), ("feedforward", "x_ref"), ("controller", "u"), ("plant", "y_pm"))
        for v in part.interface
        if v.causality == "input" and v.array == array
    ]
    step = design.options.sample_time
    return closed_loop_unit(parts, wires, "jacobi", step=step, stop_time=6.0, description="Closed loop", out=out)


@cache
def native_fmus() -> Path:
    """The folder with the FMUs of the usual design."""

    def make(folder: Path) -> None:
        build_native_units([native_unit(unit, design_of(), folder / f"{unit}.fmu") for unit in NATIVE_UNITS])

    return made_once("native/kiel", make)


@cache
def native_folder(unit: str, structure: str = "kiel", basis: str = "clamped_free") -> Path:
    """The folder that an FMU is extracted to; those of other designs are built one by one."""
    if (structure, basis) == ("kiel", "clamped_free"):
        return extracted_once(native_fmus() / f"{unit}.fmu")

    def make(folder: Path) -> None:
        build_native_units([native_unit(unit, design_of(structure, basis), folder / f"{unit}.fmu")])

    return extracted_once(made_once(f"native/{structure}-{basis}-{unit}", make) / f"{unit}.fmu")


@cache
def small_design() -> Design:
    """One beam with two modes: matrix exponentials that cost next to nothing."""
    return compute_design(read_structure(find_structure("single_beam")), DesignOptions(order=2, reduced_modes=1))


@cache
def source_folder(unit: str, small: bool = False) -> Path:
    """The folder with a unit's sources, of the small or the usual design."""
    design = small_design() if small else design_of()
    folder = workspace() / f"sources-{small}" / unit
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in unit_sources(native_unit(unit, design, folder))[0].items():
        (folder / name).write_bytes(content)
    return folder


def source_file(unit: str, small: bool = False) -> Path:
    """The C file that is compiled, in the unit's folder."""
    return source_folder(unit, small) / compiled_file(unit)


@cache
def guid_of(unit: str, small: bool = False) -> str:
    """The GUID of the sources."""
    design = small_design() if small else design_of()
    return ElementTree.fromstring(unit_sources(native_unit(unit, design, Path()))[1]).get("guid") or ""


def compiled(harness: str, unit: str, *command: str, small: bool = False, more: Sequence[str] = ()) -> Path:
    """A harness of this folder linked with a unit's sources by a compiler and its flags."""
    program = workspace() / f"{harness}-{unit}-{abs(hash((command, small)))}"
    files = [source_file(unit, small), HARNESSES / f"{harness}.c"]
    names = [f'-DUNIT_GUID="{guid_of(unit, small)}"', "-DFMI2_OVERRIDE_FUNCTION_PREFIX"]
    run([*command, *STRICT, *names, *INCLUDES, *map(str, files), "-o", str(program), "-lm", *more])
    return program


def run(command: Sequence[str], **options: object) -> str:
    """What a command prints; fails the test where the command fails."""
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=600, **options)  # type: ignore[call-overload]
    assert done.returncode == 0, f"{' '.join(command)[:400]}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    return str(done.stdout)
