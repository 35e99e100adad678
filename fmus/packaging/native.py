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

from flexbeams.fmus.documents.description import content_guid, model_description
from flexbeams.fmus.documents.documentation import documentation_page
from flexbeams.fmus.documents.picture import model_picture
from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.interface.variables import Interface
from flexbeams.fmus.packaging.c_tables import tables_source
from flexbeams.fmus.packaging.compilers import Compiler, Platform, chosen_platforms, find_compiler
from flexbeams.plant.archive import write_whole, zip_bytes

_NATIVE = Path(__file__).parents[1] / "native"
FMI_FILES = (
    "fmi2.c",
    "fmi2_model_exchange.c",
    "fmi2_state.c",
    "fmi2_values.c",
    "instance.c",
    "text.c",
    "fmi2FunctionTypes.h",
    "fmi2Functions.h",
    "fmi2TypesPlatform.h",
    "instance.h",
    "text.h",
    "unit.h",
)
_LINEAR_ALGEBRA = ("linear_algebra.c", "linear_algebra.h")
_OWN = {
    "BeamPlant": ("beam_plant.c", "beam_plant.h", "matrix_exponential.c"),
    "FlatnessFeedforward": (
        "flatness_feedforward.c",
        "flatness_feedforward.h",
        "planner.c",
        "planner.h",
        "transition.c",
        "transition.h",
    ),
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

    def __post_init__(self) -> None:
        interpolates = self.interface.unit_name in _INTERPOLATING
        object.__setattr__(self, "interface", replace(self.interface, can_interpolate_inputs=interpolates))

    def files(self) -> tuple[str, ...]:
        """The files of fmus/native that are among its sources."""
        return (*FMI_FILES, *mathematics_files(self.interface.unit_name))

    def tables(self, guid: str) -> dict[str, str]:
        """The sources that are generated, by name; tables.c has the GUID."""
        return {"tables.c": tables_source(self.interface, self.data, self.meta, guid)}

    def compiled(self) -> list[str]:
        """The sources that are compiled; others are included."""
        return sorted([file for file in self.files() if file.endswith(".c")] + ["tables.c"])

    def picture(self) -> bytes:
        """model.png."""
        return model_picture(self.interface)

    def page(self, picture: bytes) -> str:
        """documentation/index.html."""
        return documentation_page(self.interface, picture)


def mathematics_files(unit: str) -> tuple[str, ...]:
    """The files of fmus/native with the mathematics of a unit; BuildError for a name that no native unit has."""
    if unit not in _OWN:
        raise BuildError(f"{unit}: there is no native unit of this name")
    return (*_OWN[unit], *_LINEAR_ALGEBRA)


def native_source(file: str) -> str:
    """A file of fmus/native."""
    return (_NATIVE / file).read_text(encoding="utf-8")


def build_native_units(
    units: Sequence[NativeUnit], platforms: Sequence[str] = ("host",), compiler: str = "zig", **attributes: str
) -> list[Path]:
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
                binaries[target] = pool.submit(_compiled, unit, sources, folder, target, tool)
            jobs.append((unit, sources, description, binaries))
        for unit, sources, description, binaries in jobs:
            entries = {"modelDescription.xml": description, **_documents(unit), **unit.extra}
            entries |= {f"sources/{name}": content for name, content in sources.items()}
            for target, binary in binaries.items():
                for folder_name in target.folders:
                    entries[f"binaries/{folder_name}/{unit.interface.unit_name}{target.suffix}"] = binary.result()
            write_whole(unit.out, zip_bytes(entries))
    return [unit.out for unit in units]


def unit_sources(unit: NativeUnit, **attributes: str) -> tuple[dict[str, bytes], bytes]:
    """All C files of a unit by name, the generated ones among them, and modelDescription.xml.

    The GUID is a hash of the description and of all C files.
    """
    kept = {file: (_NATIVE / file).read_bytes() for file in unit.files()}
    compiled, unnamed = unit.compiled(), unit.tables("")
    guid = content_guid(
        model_description(unit.interface, source_files=compiled, **attributes),
        *(kept[file] for file in sorted(kept)),
        *(unnamed[file].encode() for file in sorted(unnamed)),
    )
    sources = kept | {file: text.encode() for file, text in unit.tables(guid).items()}
    return sources, model_description(unit.interface, guid=guid, source_files=compiled, **attributes)


def _compiled(unit: NativeUnit, sources: Mapping[str, bytes], folder: Path, target: Platform, tool: Compiler) -> bytes:
    """The shared library. Only what is generated is written anew: compiler caches know files by their path."""
    generated = sources.keys() - set(unit.files())
    for file in generated:
        (folder / file).write_bytes(sources[file])
    library = folder / f"{unit.interface.unit_name}{target.suffix}"
    tool.build(
        library, [(folder if file in generated else _NATIVE) / file for file in unit.compiled()], _NATIVE, target
    )
    return library.read_bytes()


def _documents(unit: NativeUnit) -> dict[str, bytes]:
    picture = unit.picture()
    return {
        "documentation/index.html": unit.page(picture).encode(),
        "documentation/licenses/LICENSE": (_NATIVE / "LICENSE").read_bytes(),
        "model.png": picture,
    }
