"""Units from a design: which files they are made of, where they go, and when they are made again."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from flexbeams.controller.design import Design
from flexbeams.fmus.choices import Backend
from flexbeams.fmus.packaging.cache import is_sound, prepare_folder, record, toolchain_key
from flexbeams.fmus.packaging.native import NativeUnit, build_native_units
from flexbeams.fmus.packaging.python import PythonUnit, build_python_units, bundled_script, data_file
from flexbeams.fmus.packaging.single_file import single_file
from flexbeams.fmus.packaging.sources import sources_digest
from flexbeams.fmus.references.results import reference_results
from flexbeams.fmus.units.catalogue import CATALOGUE
from flexbeams.fmus.units.kind import UnitKind, with_real_flags
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.threads import one_thread


def build_units(
    kinds: Sequence[UnitKind],
    design: Design,
    model: BeamModel,
    folder: Path,
    *,
    backend: Backend = "native",
    platforms: Sequence[str] = ("host",),
    compiler: str = "zig",
    flags_as_real: bool = False,
    notify: Callable[[str], None] = lambda text: None,
) -> list[Path]:
    """Builds units into folder/<backend>/<kind>.fmu and returns the files.

    `model` is the plant's, of the design's structure and any basis. `platforms`, `compiler` and `notify` are for native
    units, see build_native_units. With `flags_as_real` Boolean outputs and locals are Real, 0 or 1. Raises BuildError
    where a tool is missing or fails, or a kind has no kernel of the backend.
    """
    files = {kind: folder / backend / f"{kind.name}.fmu" for kind in kinds}
    with one_thread():
        if backend == "native":
            native = [native_unit(kind, design, model, out) for kind, out in files.items()]
        else:
            contents = {kind: kind.contents(design, model) for kind in files}
    if backend == "native":
        native = [unit.with_real_flags() for unit in native] if flags_as_real else native
        return build_native_units(native, platforms, compiler, notify=notify, version=version("flexbeams"))
    units = [
        PythonUnit(
            kind=kind, interface=with_real_flags(interface) if flags_as_real else interface, data=data, out=files[kind]
        )
        for kind, (interface, data) in contents.items()
    ]
    return build_python_units(units, version=version("flexbeams"))


def native_unit(
    kind: UnitKind, design: Design, model: BeamModel, out: Path, starts: Mapping[str, float | int | bool] | None = None
) -> NativeUnit:
    """A native unit of a design to be built into `out`, with start values of its own in description and kernel.

    Reference results are of the design's start values: with others there are none.
    """
    interface, data = kind.contents(design, model)
    extra = {} if starts else reference_results(interface, kind.experiments(design, model))
    return NativeUnit(kind=kind, interface=interface.with_starts(starts or {}), data=data, extra=extra, out=out)


def unit_folder(design: Design, model: BeamModel, root: Path, compiler: str = "zig") -> Path:
    """Where the units of a design and a plant basis are kept between runs: a folder named by all they depend on."""
    actuator = repr(design.structure.actuator)  # on which design_id does not depend
    key = f"{design.design_id} {actuator} {model.basis} {model.order} {toolchain_key(compiler)} {_sources_key()}"
    digest = hashlib.sha256(key.encode()).hexdigest()
    return root / f"{design.design_id[:8]}-{model.basis}-{model.order}-{digest[:16]}"


def _sources_key() -> str:
    """The sources that units are made of, and the tool that packs those with the Python kernel."""
    return f"{version('pythonfmu')} {sources_digest('plant', 'controller', 'fmus')}"


def ensure_units(
    wanted: Mapping[str, tuple[UnitKind, BeamModel]],
    design: Design,
    root: Path,
    notify: Callable[[str], None],
    *,
    backend: Backend = "native",
    compiler: str = "zig",
) -> dict[str, Path]:
    """The file of each instance, given its kind and model, in the cache `root`.

    Units that are missing, stale or damaged are built first. Raises InputError for a cache that cannot be trusted.
    """
    files: dict[str, Path] = {}
    missing: dict[Path, tuple[BeamModel, dict[str, UnitKind]]] = {}
    for instance, (kind, model) in wanted.items():
        folder = unit_folder(design, model, root, compiler)
        if kind not in CATALOGUE:
            folder /= _own_digest(kind, design, model)
        files[instance] = folder / backend / f"{kind.name}.fmu"
        if not is_sound(files[instance], root):
            missing.setdefault(folder, (model, {}))[1][kind.name] = kind
    for folder, (model, kinds) in missing.items():
        listed = sorted(kinds.values(), key=lambda kind: CATALOGUE.index(kind) if kind in CATALOGUE else len(CATALOGUE))
        notify(f"building {', '.join(kind.name for kind in listed)}")
        prepare_folder(folder / backend, root)
        for file in build_units(listed, design, model, folder, backend=backend, compiler=compiler):
            record(file)
    return files


def _own_digest(kind: UnitKind, design: Design, model: BeamModel) -> str:
    """Name of a folder for a kind from outside this project, by all that a unit of it consists of."""
    interface, data = kind.contents(design, model)
    digest = hashlib.sha256(data_file(interface, data) + repr(kind.chapter).encode())
    if kind.native is not None:
        digest.update(f"{single_file(kind.name, [kind.native.source])}{kind.native.deferred}".encode())
    if kind.python is not None:
        digest.update(bundled_script(kind.python)[0].encode())
    for name, content in reference_results(interface, kind.experiments(design, model)).items():
        digest.update(name.encode() + content)
    return digest.hexdigest()[:16]
