"""What test files share: a folder of the session, designs and units made once in it, scenarios, processes."""

import atexit
import hashlib
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
from filelock import FileLock

from flexbeams.controller.design import Design, compute_design
from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging.build import build_units
from flexbeams.fmus.units.catalogue import CATALOGUE
from flexbeams.plant.structure import Structure, find_structure, read_structure
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.masters.isolation import resident_bytes

ROOT = Path(__file__).parents[1]
SESSION = "FLEXBEAMS_TEST_SESSION"  # environment variable with the session's folder
UNITS = tuple(kind.name for kind in CATALOGUE)
STRUCTURES = ("single_beam", "kiel", "five_beams")
# Cycles of loading and unloading where memory is watched; 50 for the full measurement: 200 of them
CYCLES = int(os.environ.get("FLEXBEAMS_CYCLES", "15"))
ALLOCATOR_NOISE = 4_000_000  # bytes; units that stay loaded or allocated would take several times as much
# The connections of a closed loop, of instances feedforward, controller and plant
LOOP_WIRES = """[[connection]]
from = "feedforward.u_ff"
to = "controller.u_ff"
[[connection]]
from = "feedforward.x_ref"
to = "controller.x_ref"
[[connection]]
from = "controller.u"
to = "plant.u"
[[connection]]
from = "plant.y_pm"
to = "controller.y_pm"
"""
# A small scenario with a target and a push on one beam, up to a stop time
PUSHED_SCENARIO = (
    """title = "one beam, pushed"
structure = "single_beam"
stop_time = {stop}
[instance.feedforward]
unit = "FlatnessFeedforward"
start.preview = 2e-4
[instance.controller]
unit = "TrackingController"
[instance.plant]
unit = "BeamPlant"
"""
    + LOOP_WIRES
    + """[[input]]
to = "plant.force"
pulse = {{ time = 0.02, duration = 5e-3, impulse = 0.01 }}
[[input]]
to = "feedforward.y_target"
targets = [{{ time = 0.01, value = [1e-3] }}]
"""
)

BuiltUnits = Callable[..., Path]  # unit, structure, basis: the folder that the FMU is extracted to
Export = Callable[..., Path]
Write = Callable[[str, str], Path]


@cache
def session_folder() -> Path:
    """The folder of this test session, one for all its worker processes; it goes when the session ends."""
    if SESSION not in os.environ:
        folder = tempfile.mkdtemp(prefix="flexbeams_tests_")
        os.environ[SESSION] = folder
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(os.environ[SESSION])


def made_once(name: str, make: Callable[[Path], object]) -> Path:
    """The folder of a name within the session's, which `make` fills for the first that asks, whatever the process."""
    folder = session_folder() / name
    folder.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(f"{folder}.lock"):
        if not folder.exists():
            draft = folder.with_name(f"{folder.name}.draft")
            shutil.rmtree(draft, ignore_errors=True)
            draft.mkdir()
            make(draft)
            draft.rename(folder)
    return folder


def computed_once(structure: Structure, options: DesignOptions | None = None) -> Design:
    """compute_design, once in the session for a structure and its options."""

    def make(folder: Path) -> None:
        (folder / "design.pickle").write_bytes(pickle.dumps(compute_design(structure, options)))

    key = hashlib.sha256(repr((structure, options or DesignOptions())).encode()).hexdigest()
    design = pickle.loads((made_once(f"designs/{key[:32]}", make) / "design.pickle").read_bytes())
    assert isinstance(design, Design)
    return design


@cache
def design_of(structure: str = "kiel", basis: str = "clamped_free") -> Design:
    """The design of a shipped structure with default options."""
    options = DesignOptions(basis=basis)  # type: ignore[arg-type]
    return computed_once(read_structure(find_structure(structure)), options)


class Workshop:
    """FMUs with the Python kernel by unit, structure and basis (of design and plant), built where first asked for."""

    def fmu(self, unit: str, structure: str = "kiel", basis: str = "clamped_free") -> Path:
        """The FMU's file."""

        def make(folder: Path) -> None:
            design = design_of(structure, basis)
            kinds = [kind for kind in CATALOGUE if kind.is_made_by(design)]
            build_units(kinds, design, design.model(), folder, backend="python")

        return made_once(f"python/{structure}-{basis}", make) / "python" / f"{unit}.fmu"

    def folder(self, unit: str, structure: str = "kiel", basis: str = "clamped_free") -> Path:
        """The folder that the FMU is extracted to."""
        return extracted_once(self.fmu(unit, structure, basis))


def extracted_once(file: Path) -> Path:
    """The folder with the contents of an FMU of the session; extracted again, a loaded library would lose its pages."""
    name = file.with_suffix("").relative_to(session_folder())
    return made_once(f"extracted/{name.as_posix()}", lambda folder: fmpy.extract(str(file), unzipdir=str(folder)))


def exported_once(write: Callable[[str, Path, Settings], Path], suffix: str) -> Export:
    """Exports a scenario, each with the same settings once."""

    def export(scenario: str, **settings: Any) -> Path:
        name = f"{Path(scenario).stem}{suffix}"
        source = Path(scenario).read_text() if Path(scenario).is_file() else scenario
        digest = hashlib.sha256(f"{write.__name__} {source} {settings}".encode()).hexdigest()[:16]
        made = made_once(
            f"exports/{digest}",
            lambda folder: write(scenario, folder / name, Settings(record_animation=False, **settings)),
        )
        return made / name

    return export


def with_shared_units(folder: Path) -> Path:
    """The folder, in which units that runs build serve the whole session, where links to folders can be made."""
    shared = session_folder() / "build"
    shared.mkdir(exist_ok=True)
    with suppress(OSError):
        (folder / "build").symlink_to(shared, target_is_directory=True)
    return folder


def resident() -> int:
    """Bytes of memory in use, on Linux."""
    found = resident_bytes()
    assert found is not None
    return found


def python_environment(**more: str) -> dict[str, str]:
    """The environment of a process that imports this checkout's package."""
    return {**os.environ, "PYTHONPATH": str(ROOT), **more}


def command(*arguments: object, cwd: Path, **options: Any) -> "subprocess.Popen[str]":
    """The command `flexbeams` in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "flexbeams", *map(str, arguments)],
        cwd=cwd,
        env=python_environment(),
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        **options,
    )
