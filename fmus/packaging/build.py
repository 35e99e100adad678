"""Units from a design: which files they are made of."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from flexbeams.controller.design import Design
from flexbeams.fmus.choices import Backend
from flexbeams.fmus.packaging.native import NativeUnit, build_native_units
from flexbeams.fmus.packaging.python import PythonUnit, build_python_units
from flexbeams.fmus.references.results import reference_results
from flexbeams.fmus.units.kind import UnitKind, with_real_flags
from flexbeams.plant.galerkin import BeamModel
from flexbeams.plant.threads import one_thread
from flexbeams.plant.versions import installed_version


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
    cache: Path | None = None,
    notify: Callable[[str], None] = lambda text: None,
) -> list[Path]:
    """Builds units into folder/<backend>/<kind>.fmu and returns the files.

    `model` is the plant's, of the design's structure and any basis. `platforms`, `compiler`, `cache` and `notify` are
    for native units, see build_native_units. With `flags_as_real` Boolean outputs and locals are Real, 0 or 1. Raises
    BuildError where a tool is missing or fails, or a kind has no kernel of the backend.
    """
    files = {kind: folder / backend / f"{kind.name}.fmu" for kind in kinds}
    with one_thread():
        if backend == "native":
            native = [native_unit(kind, design, model, out) for kind, out in files.items()]
        else:
            contents = {kind: kind.contents(design, model) for kind in files}
    if backend == "native":
        native = [unit.with_real_flags() for unit in native] if flags_as_real else native
        return build_native_units(
            native, platforms, compiler, cache=cache, notify=notify, version=installed_version("flexbeams")
        )
    units = [
        PythonUnit(
            kind=kind, interface=with_real_flags(interface) if flags_as_real else interface, data=data, out=files[kind]
        )
        for kind, (interface, data) in contents.items()
    ]
    return build_python_units(units, version=installed_version("flexbeams"))


def native_unit(
    kind: UnitKind, design: Design, model: BeamModel, out: Path, starts: Mapping[str, float | int | bool] | None = None
) -> NativeUnit:
    """A native unit of a design to be built into `out`, with start values of its own in description and kernel.

    Reference results are of the design's start values: with others there are none.
    """
    interface, data = kind.contents(design, model)
    extra = {} if starts else reference_results(interface, kind.experiments(design, model))
    return NativeUnit(kind=kind, interface=interface.with_starts(starts or {}), data=data, extra=extra, out=out)
