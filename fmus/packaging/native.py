"""Packs a unit's C kernel and its tables into a native unit: sources, binaries and documentation.

The mathematics in fmus/native does not depend on a design; a design changes one generated file, the tables.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from flexbeams.fmus.documents.build_files import build_description, cmake_lists
from flexbeams.fmus.documents.description import content_guid, model_description
from flexbeams.fmus.documents.documentation import documentation_page
from flexbeams.fmus.documents.picture import model_picture
from flexbeams.fmus.documents.terminals import PATH as TERMINALS
from flexbeams.fmus.documents.terminals import terminals_document
from flexbeams.fmus.interface.variables import Interface
from flexbeams.fmus.packaging.binaries import binary_entries
from flexbeams.fmus.packaging.c_tables import description_tables, heading, kernel_data
from flexbeams.fmus.packaging.compilers import Compiler, Platform, chosen_platforms, find_compiler
from flexbeams.fmus.packaging.kept_code import code_object
from flexbeams.fmus.packaging.mac_exports import fmi_exports
from flexbeams.fmus.packaging.single_file import single_file
from flexbeams.fmus.packaging.version_resource import version_resource
from flexbeams.fmus.units.kind import UnitKind, with_real_flags
from flexbeams.fmus.units.native_kernel import NATIVE, UnitData
from flexbeams.plant.archive import write_whole, zip_bytes
from flexbeams.plant.temporary import temporary_folder

HEADERS = NATIVE / "headers"  # of FMI 2.0
_JOBS = 2  # compilations at once
_DEFINITIONS = ("FMI2_OVERRIDE_FUNCTION_PREFIX",)  # the functions of a shared library have FMI's plain names


@dataclass(frozen=True, kw_only=True)
class NativeUnit:
    """A unit to be built with the C kernel of its kind into the file `out`."""

    kind: UnitKind
    interface: Interface
    data: UnitData
    extra: Mapping[str, bytes] = field(default_factory=dict)  # further files: path in the archive to content
    out: Path

    def __post_init__(self) -> None:
        interface = replace(
            self.interface,
            can_interpolate_inputs=self.kind.require_native().interpolates_inputs,
            provides_directional_derivative=self.provides_derivatives(),
        )
        object.__setattr__(self, "interface", interface)

    def with_real_flags(self) -> "NativeUnit":
        """The unit with Boolean outputs declared as Real, and without reference results, which have them as Boolean."""
        return replace(self, interface=with_real_flags(self.interface), extra={})

    def provides_derivatives(self) -> bool:
        """Whether it has directional derivatives."""
        return self.kind.require_native().provides_derivatives

    def kernels(self) -> list[Path]:
        """The C files of its mathematics."""
        return [self.kind.require_native().source]

    def tables(self, guid: str) -> str:
        """The C text of the numbers of the design, of the variables and of the GUID."""
        hooks = self.kind.require_native().hooks
        description = description_tables(self.interface, guid, hooks, "unit_data", self.deferred())
        return "\n".join([heading(self.interface), *self.numbers, *description])

    @cached_property
    def numbers(self) -> list[str]:
        """The C text of the data of its mathematics; takes seconds for many beams."""
        return kernel_data("unit_data", self.kind.require_native(), self.interface, self.data)

    def deferred(self) -> Collection[str]:
        """Arrays that are computed when read."""
        return self.kind.require_native().deferred

    def picture(self) -> bytes:
        """model.png."""
        return model_picture(self.interface)

    def page(self, picture: bytes) -> str:
        """documentation/index.html."""
        return documentation_page(self.interface, picture, self.kind.chapter)


def build_native_units(
    units: Sequence[NativeUnit],
    platforms: Sequence[str] = ("host",),
    compiler: str = "zig",
    *,
    cache: Path | None = None,
    notify: Callable[[str], None] = lambda text: None,
    **attributes: str,
) -> list[Path]:
    """Build units with binaries for `platforms` (host, all or names of fmus.compilers.PLATFORMS); returns their files.

    `compiler` is zig or a command of the system. `attributes` (version, license) go into modelDescription.xml. Equal
    arguments give equal bytes. Code that does not depend on a design is kept in `cache`, if one is given. `notify` gets
    a line for each binary of several platforms. Raises BuildError where there is no compiler or it fails.
    """
    targets, tool = chosen_platforms(platforms), find_compiler(compiler)
    with temporary_folder() as temporary, ThreadPoolExecutor(_JOBS) as pool:
        contents = [unit_sources(unit, **attributes) for unit in units]
        places: dict[tuple[int, Platform], Path] = {}
        codes: dict[tuple[bytes, Platform], Future[Path]] = {}  # of equal sources once, and all before one is linked
        for k, (files, _) in enumerate(contents):
            for target in targets:
                source = places[k, target] = _written(files, units[k], temporary / f"{k}-{target.name}")
                if (files[source.name], target) not in codes:
                    made = pool.submit(code_object, source, [HEADERS], tool, target, _DEFINITIONS, cache)
                    codes[files[source.name], target] = made
        libraries = {}
        for (k, target), source in places.items():
            code, version = codes[contents[k][0][source.name], target], attributes.get("version", "")
            libraries[k, target] = pool.submit(_linked, units[k], source, code, target, tool, version)
        for k, (unit, (files, description)) in enumerate(zip(units, contents, strict=True)):
            entries = {"modelDescription.xml": description, **_documents(unit), **unit.extra}
            entries |= {f"sources/{name}": content for name, content in files.items()}
            compiled = {}
            for target in targets:
                if len(targets) > 1:
                    notify(f"compiling {unit.interface.unit_name} for {target.name}")
                compiled[target] = libraries[k, target].result()
            entries |= binary_entries(unit.interface.unit_name, compiled)
            write_whole(unit.out, zip_bytes(entries))
    return [unit.out for unit in units]


def unit_sources(unit: NativeUnit, **attributes: str) -> tuple[dict[str, bytes], bytes]:
    """The files of a unit's folder `sources` by name, and modelDescription.xml.

    The GUID is a hash of the description and of the C files.
    """
    name = unit.interface.unit_name
    compiled = compiled_file(name)
    code, tables = single_file(name, unit.kernels()), f"{name}_tables.h"
    guid = content_guid(
        model_description(unit.interface, source_files=[compiled], **attributes),
        code.encode(),
        unit.tables("").encode(),
    )
    description = model_description(unit.interface, guid=guid, source_files=[compiled], **attributes)
    sources = {
        compiled: code.encode(),
        tables: unit.tables(guid).encode(),
        "buildDescription.xml": build_description(name, compiled),
        "CMakeLists.txt": cmake_lists(name, compiled),
    }
    return sources, description


def compiled_file(unit: str) -> str:
    """The one file of a unit's sources that is compiled."""
    return f"{unit}.c"


def _written(files: Mapping[str, bytes], unit: NativeUnit, folder: Path) -> Path:
    """The file to compile, beside the others in a new folder."""
    folder.mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return folder / compiled_file(unit.interface.unit_name)


def _linked(
    unit: NativeUnit, source: Path, code: Future[Path], target: Platform, tool: Compiler, version: str
) -> bytes:
    """The shared library: tables, and code once that is compiled; on Windows with the version that it shows."""
    library = source.with_suffix(target.suffix)
    files = [source, code.result()]
    if tool.is_zig and target.suffix == ".dll":
        files.append(source.with_suffix(".res"))
        files[-1].write_bytes(version_resource(unit.interface, library.name, version))
    tool.build(library, files, [HEADERS], target, [*_DEFINITIONS, "TABLES_ONLY"])
    content = library.read_bytes()
    return fmi_exports(content) if target.suffix == ".dylib" else content


def _documents(unit: NativeUnit) -> dict[str, bytes]:
    picture = unit.picture()
    documents = {
        "documentation/index.html": unit.page(picture).encode(),
        "documentation/licenses/LICENSE": (NATIVE / "LICENSE").read_bytes(),
        "model.png": picture,
    }
    if terminals := terminals_document(unit.interface):
        documents[TERMINALS] = terminals
    return documents
