"""Binaries for other platforms, under emulators, give the values of x86-64 Linux and take over each other's states."""

import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import fmpy
import numpy as np
import pytest

from flexbeams.fmus.packaging.compilers import PLATFORMS
from flexbeams.fmus.packaging.native import HEADERS, build_native_units
from flexbeams.plant.basis import Array
from tests.helpers import design_of
from tests.native.processors import ARM64, HERE, RISCV64, X86_32, Processor
from tests.native.workshop import (
    HARNESSES,
    NATIVE_UNITS,
    STRICT,
    UNIT,
    ZIG,
    native_folder,
    native_unit,
    needs_zig,
    run,
    source_file,
    workspace,
)

pytestmark = [
    pytest.mark.native,
    pytest.mark.timeout(900),  # a machine's first test compiles zig's C libraries of all platforms
    pytest.mark.skipif(platform.machine() != "x86_64" or sys.platform != "linux", reason="this is not x86-64 Linux"),
]
LINUX = "x86_64-linux"
WINE = next(filter(None, map(shutil.which, ("wine", "wine64", "/usr/lib/wine/wine64"))), None)
STEPS = 500
# Largest difference by signal, relative to its largest value: exp, exp2 and pow of C libraries differ in the last digit
TOLERANCE = 1e-12


@dataclass
class Emulator:
    """How programs of a platform run here."""

    command: Sequence[str] = ()
    environment: dict[str, str] = field(default_factory=dict)
    root: str = ""  # in front of this machine's paths

    def path(self, file: Path) -> str:
        """A path as the programs take it."""
        return self.root + (str(file).replace("/", "\\") if self.root else str(file))

    def run(self, *arguments: str) -> str:
        """What a program prints. Through a file: Wine's servers keep a pipe open for seconds."""
        command, environment = [*self.command, *arguments], os.environ | self.environment
        output, errors = workspace() / "output", workspace() / "errors"
        with output.open("w") as printed, errors.open("w") as complaints:
            done = subprocess.run(command, stdout=printed, stderr=complaints, timeout=300, env=environment)
        assert done.returncode == 0, f"{' '.join(command)[:300]}: {done.returncode}\n{errors.read_text()[-2000:]}"
        return output.read_text()


@pytest.fixture(scope="module")
def emulators() -> Iterator[dict[str, Emulator]]:
    """Those that are installed, by platform."""
    found = {LINUX: Emulator()}
    if ARM64.is_here:
        found["aarch64-linux"] = Emulator(command=ARM64.through)
    prefix = {"WINEPREFIX": str(workspace() / "wine"), "WINEDEBUG": "-all", "WINEDLLOVERRIDES": "mscoree,mshtml="}
    if WINE is not None:
        wine = Emulator(command=(WINE,), environment=prefix, root="Z:")
        with suppress(AssertionError, OSError, subprocess.TimeoutExpired):  # it has no 64-bit part, or no right to run
            wine.run("cmd", "/c", "exit")
            found["x86_64-windows"] = wine
    yield found
    server = next(filter(None, map(shutil.which, ("wineserver", "/usr/lib/wine/wineserver64"))), None)
    if Path(prefix["WINEPREFIX"]).is_dir():
        if server is not None:
            subprocess.run([server, "-k"], env=os.environ | prefix, check=False, timeout=60)
        shutil.rmtree(prefix["WINEPREFIX"], ignore_errors=True)  # some 700 MB


@pytest.fixture(scope="module")
def units(emulators: dict[str, Emulator]) -> dict[str, Path]:
    """The folders of units with binaries for the foreign platforms that run here, and run_library for each platform."""
    folder = workspace() / "foreign"
    folder.mkdir()
    if foreign := [name for name in emulators if name != LINUX]:
        build_native_units([native_unit(unit, design_of(), folder / f"{unit}.fmu") for unit in NATIVE_UNITS], foreign)
    for name in emulators:
        more = ["-ldl"] if name.endswith("linux") else []
        source, program = str(HARNESSES / "run_library.c"), str(folder / f"{name}.exe")
        # stripped like the units: for others zig compiles its libraries again
        flags = ["-mcpu=baseline", "-O2", "-g0", "-s", "-std=c99", "-Wall", "-Werror", f"-I{HEADERS}"]
        run([*ZIG, "-target", PLATFORMS[name].target, *flags, source, "-o", program, *more])
    return {file.stem: Path(fmpy.extract(str(file), str(file.with_suffix("")))) for file in folder.glob("*.fmu")}


@dataclass(frozen=True)
class Steps:
    """Start time and lengths of steps that take turns, s."""

    start: float = 0.0
    lengths: tuple[float, ...] = (2e-4,)


def trace(emulator: Emulator, name: str, unit: Path, state: Path, steps: Steps, *more: str) -> Array:
    """What run_library prints for a unit's library: a row of all Real variables after every 50th step."""
    description = fmpy.read_model_description(unit, validate=False)
    inputs = [v.valueReference for v in description.modelVariables if v.causality == "input"]
    reals = [v.valueReference for v in description.modelVariables if v.type == "Real"]
    listed = [",".join(map(str, references)) for references in (inputs, reals)]
    library = next(((native_folder(unit.name) if name == LINUX else unit) / "binaries" / name).iterdir())
    program = str(unit.parent / f"{name}.exe")
    lengths = ",".join(map(repr, steps.lengths))
    arguments = (description.guid, str(STEPS), lengths, *listed, repr(steps.start), emulator.path(state), *more)
    text = emulator.run(program, emulator.path(library), *arguments)
    return np.array([line.split() for line in text.splitlines()], dtype=float)


MIXED = (2e-4, 7e-5, 1e-3, 3.3e-4)


@needs_zig
@pytest.mark.parametrize(
    ("name", "steps"),
    [
        ("aarch64-linux", Steps()),
        ("aarch64-linux", Steps(-1e9, MIXED)),
        ("aarch64-linux", Steps(2e9, MIXED)),
        ("x86_64-windows", Steps()),
    ],
)
def test_values_and_states_are_those_of_x86_linux(
    name: str, steps: Steps, emulators: dict[str, Emulator], units: dict[str, Path]
) -> None:
    """Of each unit and of the closed loop, also from the other platform's state halfway, in a process of its own."""
    if name not in emulators:
        pytest.skip(
            "Wine is missing or does not start"
            if name.endswith("windows")
            else "not installed: qemu-user, libc6-arm64-cross"
        )
    assert sorted(units) == sorted(NATIVE_UNITS)
    for unit, folder in units.items():
        states = {platform: folder / f"{platform}.state" for platform in (LINUX, name)}
        here = trace(emulators[LINUX], LINUX, folder, states[LINUX], steps)
        there = trace(emulators[name], name, folder, states[name], steps)
        assert here.shape[0] == STEPS // 50
        assert states[LINUX].stat().st_size == states[name].stat().st_size
        np.testing.assert_array_equal(
            trace(emulators[LINUX], LINUX, folder, states[LINUX], steps, "load"), here[len(here) // 2 :]
        )
        taken_over = trace(emulators[name], name, folder, states[LINUX], steps, "load")
        given_away = trace(emulators[LINUX], LINUX, folder, states[name], steps, "load")
        largest = np.maximum(np.max(np.abs(here), axis=0), 1e-300)
        assert np.max(largest) > 1e-6
        differences = [np.max(np.abs(there - here) / largest)]
        differences += [np.max(np.abs(part - here[-len(part) :]) / largest) for part in (taken_over, given_away)]
        assert len(taken_over) == len(given_away) == STEPS // 100
        print(unit, name, steps.start, *(f"{difference:.1e}" for difference in differences))
        assert max(differences) <= TOLERANCE, unit


def linked_trace(unit: str, processor: Processor, steps: Steps) -> Array:
    """What run_library prints for a unit that is linked into it, on a processor without a library of its own."""
    folder = native_folder(unit)
    description = fmpy.read_model_description(folder, validate=False)
    inputs, reals = (
        ",".join(str(v.valueReference) for v in description.modelVariables if chosen(v))
        for chosen in (lambda v: v.causality == "input", lambda v: v.type == "Real")
    )
    program = workspace() / f"linked-{unit}-{processor.target}"
    sources = [str(HARNESSES / "run_library.c"), str(folder / "sources" / f"{unit}.c")]
    flags = ["-DLINKED", "-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-O2", *STRICT, f"-I{HEADERS}"]
    run([*processor.compiler, "-mcpu=baseline", *flags, *sources, "-o", str(program), "-lm"])
    lengths, state = ",".join(map(repr, steps.lengths)), str(workspace() / "linked.state")
    arguments = ["-", description.guid, str(STEPS), lengths, inputs, reals, repr(steps.start), state]
    text = run([*processor.through, str(program), *arguments])
    return np.array([line.split() for line in text.splitlines()], dtype=float)


@needs_zig
@pytest.mark.timeout(0)
@pytest.mark.skipif(
    "FLEXBEAMS_CPUS" not in os.environ, reason="FLEXBEAMS_CPUS is not set: test_native_readme is shorter"
)
@pytest.mark.parametrize(
    "processor", [pytest.param(other, marks=other.needed, id=other.target) for other in (X86_32, RISCV64)]
)
def test_values_on_other_cpus(processor: Processor) -> None:
    """Of the closed loop on 32-bit x86 and 64-bit RISC-V: within 1e-12 of each signal's largest value."""
    steps = Steps(1.7e9, MIXED)
    here, there = linked_trace(UNIT, HERE, steps), linked_trace(UNIT, processor, steps)
    assert np.ptp(here, axis=0).max() > 0
    largest = np.maximum(np.max(np.abs(here), axis=0), 1e-300)
    print(processor.target, f"{np.max(np.abs(there - here) / largest):.1e}")
    assert np.max(np.abs(there - here) / largest) <= TOLERANCE


@needs_zig
@pytest.mark.parametrize(
    "target",
    [
        *(PLATFORMS[name].target for name in ("aarch64-linux", "x86_64-windows", "aarch64-darwin")),
        X86_32.target,
        RISCV64.target,
    ],
)
def test_sources_have_no_warning(target: str, tmp_path: Path) -> None:
    for unit in NATIVE_UNITS:
        files = [f"-I{HEADERS}", "-c", str(source_file(unit))]
        run([*ZIG, "-target", target, *STRICT, "-O0", *files, "-o", str(tmp_path / "unit.o")])
