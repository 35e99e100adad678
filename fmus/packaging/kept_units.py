"""Units in the user's cache: where they are kept, and when they are made again."""

import hashlib
from collections.abc import Callable, Mapping
from pathlib import Path

from flexbeams.controller.design import Design
from flexbeams.fmus.choices import Backend
from flexbeams.fmus.packaging.cache import is_sound, prepare_folder, record, toolchain_key
from flexbeams.fmus.packaging.sources import sources_digest
from flexbeams.fmus.units.catalogue import CATALOGUE
from flexbeams.fmus.units.kind import UnitKind
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.versions import installed_version


def unit_folder(design: Design, model: BeamModel, root: Path, compiler: str = "zig") -> Path:
    """Where the units of a design and a plant basis are kept between runs: a folder named by all they depend on."""
    actuator = repr(design.structure.actuator)  # on which design_id does not depend
    key = f"{design.design_id} {actuator} {model.basis} {model.order} {toolchain_key(compiler)} {_sources_key()}"
    digest = hashlib.sha256(key.encode()).hexdigest()
    return root / f"{design.design_id[:8]}-{model.basis}-{model.order}-{digest[:16]}"


def _sources_key() -> str:
    """The sources that units are made of, and the tool that packs those with the Python kernel."""
    return f"{installed_version('pythonfmu')} {sources_digest('plant', 'controller', 'fmus')}"


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
    if missing:
        from flexbeams.fmus.packaging.build import build_units  # which takes longer to load than kept units
    for folder, (model, kinds) in missing.items():
        listed = sorted(kinds.values(), key=lambda kind: CATALOGUE.index(kind) if kind in CATALOGUE else len(CATALOGUE))
        notify(f"building {', '.join(kind.name for kind in listed)}")
        prepare_folder(folder / backend, root)
        for file in build_units(listed, design, model, folder, backend=backend, compiler=compiler, cache=root):
            record(file)
    return files


def _own_digest(kind: UnitKind, design: Design, model: BeamModel) -> str:
    """Name of a folder for a kind from outside this project, by all that a unit of it consists of."""
    from flexbeams.fmus.packaging.python import bundled_script, data_file
    from flexbeams.fmus.packaging.single_file import single_file
    from flexbeams.fmus.references.results import reference_results

    interface, data = kind.contents(design, model)
    digest = hashlib.sha256(data_file(interface, data) + repr(kind.chapter).encode())
    if kind.native is not None:
        digest.update(f"{single_file(kind.name, [kind.native.source])}{kind.native.deferred}".encode())
    if kind.python is not None:
        digest.update(bundled_script(kind.python)[0].encode())
    for name, content in reference_results(interface, kind.experiments(design, model)).items():
        digest.update(name.encode() + content)
    return digest.hexdigest()[:16]
