"""Designs and units, each made once in a session, and a folder to run scenarios in."""

import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
import pytest

from flexbeams.controller.design import Design, DesignOptions, compute_design
from flexbeams.fmus.packaging.build import build_units
from flexbeams.fmus.units.shipped import UNITS
from flexbeams.plant.structure import Structure, find_structure, read_structure
from flexbeams.scenarios.definition.settings import Settings

STRUCTURES = ("single_beam", "kiel", "five_beams")
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

Export = Callable[..., Path]


@cache
def design_of(structure: str = "kiel", basis: str = "clamped_free") -> Design:
    """The design of a shipped structure with default options."""
    return compute_design(read_structure(find_structure(structure)), DesignOptions(basis=basis))  # type: ignore[arg-type]


class Workshop:
    """FMUs with the Python kernel by unit, structure and basis (of design and plant), built where first asked for."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def fmu(self, unit: str, structure: str = "kiel", basis: str = "clamped_free") -> Path:
        """The FMU's file."""
        folder = self._root / f"{structure}-{basis}"
        if not folder.exists():
            design = design_of(structure, basis)
            build_units(UNITS, design, design.model(), folder, backend="python")
        return folder / "python" / f"{unit}.fmu"

    def folder(self, unit: str, structure: str = "kiel", basis: str = "clamped_free") -> Path:
        """The folder that the FMU is extracted to."""
        file = self.fmu(unit, structure, basis)
        folder = file.with_suffix("")
        if not folder.exists():
            fmpy.extract(str(file), unzipdir=str(folder))
        return folder


@pytest.fixture(scope="session")
def workshop() -> Iterator[Workshop]:
    with tempfile.TemporaryDirectory(prefix="flexbeams_units_", ignore_cleanup_errors=True) as folder:
        yield Workshop(Path(folder))


@pytest.fixture(scope="session")
def run_folder() -> Iterator[Path]:
    """A folder to run the command in; units built there serve the whole session."""
    with tempfile.TemporaryDirectory(prefix="flexbeams_runs_", ignore_cleanup_errors=True) as folder:
        yield Path(folder)


@pytest.fixture
def short(run_folder: Path) -> Callable[..., Settings]:
    """Settings of a run with its units in the session's folder."""
    return lambda **settings: Settings(frames=False, build_folder=run_folder / "build/fmus", **settings)


def once_each(write: Callable[[str, Path, Settings], Path], suffix: str, folders: pytest.TempPathFactory) -> Export:
    """Exports a scenario, each with the same settings once."""
    made: dict[str, Path] = {}

    def export(scenario: str, **settings: Any) -> Path:
        key = f"{scenario} {settings}"
        if key not in made:
            out = folders.mktemp("export") / f"{Path(scenario).stem}{suffix}"
            made[key] = write(scenario, out, Settings(frames=False, **settings))
        return made[key]

    return export


@pytest.fixture
def at_run_folder(run_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The present directory is the folder for runs."""
    monkeypatch.chdir(run_folder)
    return run_folder


@pytest.fixture
def known_designs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs in this process take designs that the session has computed already."""

    def compute(structure: Structure, options: DesignOptions | None = None) -> Design:
        for name in STRUCTURES if options == DesignOptions() else ():
            if structure == read_structure(find_structure(name)):
                return design_of(name)
        return compute_design(structure, options)

    monkeypatch.setattr("flexbeams.scenarios.runs.scenario.compute_design", compute)


@pytest.fixture
def write_scenario(tmp_path: Path) -> Callable[[str, str], Path]:
    """A function that writes a scenario file of a name with a text."""

    def write(name: str, text: str) -> Path:
        path = tmp_path / f"{name}.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write
