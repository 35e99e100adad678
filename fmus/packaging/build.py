"""Units from a design: which files they are made of, where they go, and when they are made again."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from flexbeams.controller.design import Design
from flexbeams.fmus.packaging.design_data import unit_data
from flexbeams.fmus.packaging.native import NativeUnit, build_native_units
from flexbeams.fmus.references.results import reference_results
from flexbeams.fmus.units.shipped import UNITS, interface_of
from flexbeams.plant.galerkin import BeamModel

Backend = Literal["native", "python"]
BACKENDS: tuple[Backend, ...] = ("native", "python")

_ROOT = Path(__file__).parents[2]
_KERNELS = {
    "BeamPlant": "beam_plant",
    "FlatnessFeedforward": "flatness_feedforward",
    "TrackingController": "tracking_controller",
}


def build_units(
    names: Sequence[str],
    design: Design,
    model: BeamModel,
    folder: Path,
    *,
    backend: Backend = "native",
    platforms: Sequence[str] = ("host",),
    compiler: str = "zig",
) -> list[Path]:
    """Builds units into folder/<backend>/<Unit>.fmu and returns the files.

    `model` is the plant's, of the design's structure and any basis. `platforms` and `compiler` are for native units,
    see fmus.native_backend.build_native_units. Raises BuildError where a tool is missing or fails.
    """
    parts = []
    for name in names:
        interface = interface_of(name, design, model)
        parts.append((interface, *unit_data(interface, design, model), folder / backend / f"{name}.fmu"))
    if backend == "native":
        return build_native_units(
            [
                NativeUnit(interface=i, data=d, meta=m, extra=reference_results(i, design, model), out=out)
                for i, d, m, out in parts
            ],
            platforms,
            compiler,
            version=version("flexbeams"),
        )
    from flexbeams.fmus.packaging.python import PythonUnit, build_python_units

    return build_python_units(
        [
            PythonUnit(
                interface=i,
                data=d,
                meta=m,
                out=out,
                kernel_file=_ROOT / "fmus" / "python" / f"{_KERNELS[i.unit_name]}.py",
            )
            for i, d, m, out in parts
        ],
        version=version("flexbeams"),
    )


def native_unit(
    name: str, design: Design, model: BeamModel, out: Path, starts: Mapping[str, float | int | bool] | None = None
) -> NativeUnit:
    """What a native unit is made of, with start values of its own in description and kernel; to be built into `out`.

    Reference results are of the design's start values: with others there are none.
    """
    interface = interface_of(name, design, model)
    data, meta = unit_data(interface, design, model)
    extra = {} if starts else reference_results(interface, design, model)
    return NativeUnit(interface=interface.with_starts(starts or {}), data=data, meta=meta, extra=extra, out=out)


def unit_folder(design: Design, model: BeamModel, root: Path, compiler: str = "zig") -> Path:
    """Where the units of a design and a plant basis are kept between runs: a folder named by all they depend on."""
    digest = hashlib.sha256(f"{design.design_id} {model.basis} {model.order} {compiler}".encode())
    for package in ("plant", "controller", "fmus"):
        for path in sorted(p for p in (_ROOT / package).rglob("*") if p.suffix in (".py", ".c", ".h")):
            digest.update(path.read_bytes())
    return root / f"{design.design_id[:8]}-{model.basis}-{model.order}-{digest.hexdigest()[:8]}"


def ensure_units(
    wanted: Mapping[str, tuple[str, BeamModel]],
    design: Design,
    root: Path,
    notify: Callable[[str], None],
    *,
    backend: Backend = "native",
    compiler: str = "zig",
) -> dict[str, Path]:
    """The file of each instance, given its unit and model; units that are missing or stale are built first."""
    files: dict[str, Path] = {}
    missing: dict[Path, tuple[BeamModel, set[str]]] = {}
    for instance, (unit, model) in wanted.items():
        folder = unit_folder(design, model, root, compiler)
        files[instance] = folder / backend / f"{unit}.fmu"
        if not files[instance].is_file():
            missing.setdefault(folder, (model, set()))[1].add(unit)
    for folder, (model, units) in missing.items():
        names = [name for name in UNITS if name in units]
        notify(f"building {', '.join(names)}")
        build_units(names, design, model, folder, backend=backend, compiler=compiler)
    return files
