"""Native units for the tests, built where first asked for, and their sources compiled again with a harness."""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging.closed_loop import UNIT, ClosedLoop, Part, Wire, closed_loop_interface
from flexbeams.fmus.packaging.design_data import unit_data
from flexbeams.fmus.packaging.native import NativeUnit, build_native_units, unit_sources
from flexbeams.fmus.units.shipped import UNITS, interface_of
from flexbeams.plant.structure import find_structure, read_structure
from tests.helpers import design_of, extracted_once, made_once, session_folder

HARNESSES = Path(__file__).parent
NATIVE_UNITS = (*UNITS, UNIT)
STRICT = ("-std=c99", "-ffp-contract=off", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
ZIG = (sys.executable, "-m", "ziglang", "cc")
needs_zig = pytest.mark.skipif(find_spec("ziglang") is None, reason="the ziglang wheel is not installed")


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
    """A unit of a design, with the plant in the design's own basis."""
    if unit == UNIT:
        return closed_loop(design, out)
    part = _part(unit, unit, design)
    return NativeUnit(interface=part.interface, data=part.data, meta=part.meta, out=out)


def closed_loop(design: Design, out: Path) -> ClosedLoop:
    """All three units of a design in one, wired as in the scenario `tracking`."""
    parts = tuple(
        _part(name, unit, design)
        for name, unit in (
            ("feedforward", "FlatnessFeedforward"),
            ("controller", "TrackingController"),
            ("plant", "BeamPlant"),
        )
    )
    wires = [
        Wire(source=f"{owner}.{v.name}", to=f"{part.name}.{v.name}")
        for part in parts
        for owner, array in (("feedforward", "u_ff"), ("feedforward", "x_ref"), ("controller", "u"), ("plant", "y_pm"))
        for v in part.interface
        if v.causality == "input" and v.array == array
    ]
    return ClosedLoop(
        interface=closed_loop_interface(parts, wires, design.options.sample_time, 6.0, "Closed loop"),
        parts=parts,
        wires=tuple(wires),
        coupling="jacobi",
        out=out,
    )


def _part(name: str, unit: str, design: Design) -> Part:
    model = design.model()
    interface = interface_of(unit, design, model)
    data, meta = unit_data(interface, design, model)
    return Part(name=name, interface=interface, data=data, meta=meta)


@cache
def native_fmus(structure: str = "kiel", basis: str = "clamped_free") -> Path:
    """The folder with the FMUs."""

    def make(folder: Path) -> None:
        design = design_of(structure, basis)
        build_native_units([native_unit(unit, design, folder / f"{unit}.fmu") for unit in NATIVE_UNITS])

    return made_once(f"native/{structure}-{basis}", make)


@cache
def native_folder(unit: str, structure: str = "kiel", basis: str = "clamped_free") -> Path:
    """The folder that the FMU is extracted to."""
    return extracted_once(native_fmus(structure, basis) / f"{unit}.fmu")


@cache
def small_design() -> Design:
    """One beam with two modes: matrix exponentials that cost next to nothing."""
    return compute_design(read_structure(find_structure("single_beam")), DesignOptions(order=2, reduced_modes=1))


@cache
def source_folder(unit: str, small: bool = False) -> Path:
    """The folder with a unit's C files, of the small or the usual design."""
    design = small_design() if small else design_of()
    folder = workspace() / f"sources-{small}" / unit
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in unit_sources(native_unit(unit, design, folder))[0].items():
        (folder / name).write_bytes(content)
    return folder


def source_files(unit: str, small: bool = False) -> list[Path]:
    """The C files that are compiled, in the unit's folder."""
    folder = source_folder(unit, small)
    return [folder / name for name in native_unit(unit, small_design() if small else design_of(), folder).compiled()]


def compiled(harness: str, unit: str, *command: str, small: bool = False, more: Sequence[str] = ()) -> Path:
    """A harness of this folder linked with a unit's sources by a compiler and its flags."""
    sources = source_folder(unit, small)
    program = workspace() / f"{harness}-{unit}-{abs(hash((command, small)))}"
    files = [*source_files(unit, small), HARNESSES / f"{harness}.c"]
    run([*command, *STRICT, f"-I{sources}", *map(str, files), "-o", str(program), "-lm", *more])
    return program


def run(command: Sequence[str], **options: object) -> str:
    """What a command prints; fails the test where the command fails."""
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=600, **options)  # type: ignore[call-overload]
    assert done.returncode == 0, f"{' '.join(command)[:400]}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    return str(done.stdout)
