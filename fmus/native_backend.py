"""Packs a unit's C kernel and its tables into a native unit: sources, binaries and documentation.

The mathematics in fmus/native does not depend on a design: what a design changes is one generated file, tables.c, so
that a compiler with a cache makes a unit of a new design in a moment.
"""

import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from fmus.compilers import Compiler, Platform, chosen_platforms, find_compiler
from fmus.description import content_guid, model_description
from fmus.documentation import documentation_page
from fmus.errors import BuildError
from fmus.picture import model_picture
from fmus.tables import tables_source
from fmus.variables import Interface
from plant.archive import write_whole, zip_bytes

_NATIVE = Path(__file__).parent / "native"
_SHARED = ("fmi2.c", "fmi2_model_exchange.c", "fmi2_state.c", "fmi2_values.c", "instance.c", "linear_algebra.c",
           "text.c", "fmi2FunctionTypes.h", "fmi2Functions.h", "fmi2TypesPlatform.h", "instance.h",
           "linear_algebra.h", "text.h", "unit.h")
_OWN = {
    "BeamPlant": ("beam_plant.c", "beam_plant.h", "matrix_exponential.c"),
    "FlatnessFeedforward": ("flatness_feedforward.c", "flatness_feedforward.h", "planner.c", "planner.h",
                            "transition.c", "transition.h"),
    "TrackingController": ("tracking_controller.c", "tracking_controller.h"),
    "SignalSource": ("signal_source.c", "signal_source.h", "philox.c", "philox.h"),
}
_INTERPOLATING = ("BeamPlant",)
_JOBS = 2  # compilations at once


@dataclass(frozen=True, kw_only=True)
class NativeUnit:
    """What one unit is made of; data and meta are those of fmus.data.unit_data."""

    interface: Interface
    data: Mapping[str, ArrayLike]
    meta: Mapping[str, Any] = field(default_factory=dict)
    extra: Mapping[str, bytes] = field(default_factory=dict)  # further files: path in the archive to content
    out: Path


def build_native_units(units: Sequence[NativeUnit], platforms: Sequence[str] = ("host",), compiler: str = "zig",
                       **attributes: str) -> list[Path]:
    """Build units with binaries for `platforms` (host, all or names of fmus.compilers.PLATFORMS); returns their files.

    `compiler` is zig or a command of the system. `attributes` (version, license) go into modelDescription.xml. Equal
    arguments give equal bytes. Raises BuildError where there is no compiler or it fails.
    """
    targets, tool = chosen_platforms(platforms), find_compiler(compiler)
    with tempfile.TemporaryDirectory(prefix="flexbeams_") as temporary, ThreadPoolExecutor(_JOBS) as pool:
        jobs = []
        for k, unit in enumerate(units):
            sources, description = unit_sources(unit, **attributes)
            binaries = {}
            for target in targets:
                folder = Path(temporary) / f"{k}-{target.name}"
                folder.mkdir()
                binaries[target] = pool.submit(_compiled, unit.interface.unit_name, sources, folder, target, tool)
            jobs.append((unit, sources, description, binaries))
        for unit, sources, description, binaries in jobs:
            entries = {"modelDescription.xml": description, **_documents(unit.interface), **unit.extra}
            entries |= {f"sources/{name}": content for name, content in sources.items()}
            for target, binary in binaries.items():
                for folder_name in target.folders:
                    entries[f"binaries/{folder_name}/{unit.interface.unit_name}{target.suffix}"] = binary.result()
            write_whole(unit.out, zip_bytes(entries))
    return [unit.out for unit in units]


def unit_sources(unit: NativeUnit, **attributes: str) -> tuple[dict[str, bytes], bytes]:
    """All C files of a unit by name, tables.c among them, and modelDescription.xml.

    The GUID is a hash of the description and of all C files.
    """
    name = unit.interface.unit_name
    if name not in _OWN:
        raise BuildError(f"{name}: there is no native unit of this name")
    interface = replace(unit.interface, can_interpolate_inputs=name in _INTERPOLATING)
    sources = {file: (_NATIVE / file).read_bytes() for file in (*_SHARED, *_OWN[name])}
    compiled = sorted([file for file in sources if file.endswith(".c")] + ["tables.c"])
    unnamed = tables_source(interface, unit.data, unit.meta, "").encode()
    guid = content_guid(model_description(interface, source_files=compiled, **attributes),
                        *(sources[file] for file in sorted(sources)), unnamed)
    sources["tables.c"] = tables_source(interface, unit.data, unit.meta, guid).encode()
    return sources, model_description(interface, guid=guid, source_files=compiled, **attributes)


def _compiled(name: str, sources: Mapping[str, bytes], folder: Path, target: Platform, tool: Compiler) -> bytes:
    """The shared library. Only tables.c is written anew: compiler caches know files by their path."""
    (folder / "tables.c").write_bytes(sources["tables.c"])
    files = [folder / file if file == "tables.c" else _NATIVE / file for file in sorted(sources) if file.endswith(".c")]
    library = folder / f"{name}{target.suffix}"
    tool.build(library, files, _NATIVE, target)
    return library.read_bytes()


def _documents(interface: Interface) -> dict[str, bytes]:
    picture = model_picture(interface)
    return {
        "documentation/index.html": documentation_page(interface, picture).encode(),
        "documentation/licenses/LICENSE": (_NATIVE / "LICENSE").read_bytes(),
        "model.png": picture,
    }
