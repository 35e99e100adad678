"""Units from a design: which files they are made of, where they go, and when they are made again."""

import hashlib
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from controller.design import Design
from fmus.data import unit_data
from fmus.interface import UNITS, interface_of
from fmus.python_backend import PythonUnit, build_python_units
from plant.galerkin import BeamModel

Backend = Literal["native", "python"]

_ROOT = Path(__file__).parent.parent
_KERNELS = {"BeamPlant": "beam_plant", "FlatnessFeedforward": "flatness_feedforward",
            "TrackingController": "tracking_controller"}


def build_units(names: Sequence[str], design: Design, model: BeamModel, folder: Path) -> list[Path]:
    """Builds units with the Python kernel into folder/python/<Unit>.fmu and returns the files.

    `model` is the plant's, of the design's structure and any basis. Raises BuildError where pythonfmu fails.
    """
    units = []
    for name in names:
        interface = interface_of(name, design, model)
        arrays, meta = unit_data(interface, design, model)
        kernel_file = _ROOT / "fmus" / "python" / f"{_KERNELS[name]}.py"
        units.append(PythonUnit(interface=interface, data=arrays, meta=meta, kernel_file=kernel_file,
                                out=folder / "python" / f"{name}.fmu"))
    return build_python_units(units, version=version("flexbeams"))


def unit_folder(design: Design, model: BeamModel, root: Path) -> Path:
    """Where the units of a design and a plant basis are kept between runs: a folder named by all they depend on."""
    digest = hashlib.sha256(f"{design.design_id} {model.basis} {model.order}".encode())
    for package in ("plant", "controller", "fmus"):
        for path in sorted((_ROOT / package).rglob("*.py")):
            digest.update(path.read_bytes())
    return root / f"{design.design_id[:8]}-{model.basis}-{model.order}-{digest.hexdigest()[:8]}"


def ensure_units(names: Sequence[str], design: Design, model: BeamModel, root: Path,
                 report: Callable[[str], None]) -> dict[str, Path]:
    """The units' files, those that are missing or stale built first."""
    folder = unit_folder(design, model, root)
    files = {name: folder / "python" / f"{name}.fmu" for name in names}
    missing = [name for name in UNITS if name in files and not files[name].is_file()]
    if missing:
        report(f"building {', '.join(missing)}")
        build_units(missing, design, model, folder)
    return files
