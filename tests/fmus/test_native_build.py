"""Building native units: what is in them, compilers, platforms, equal bytes."""

import platform
import shutil
import struct
import subprocess
import sys
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.build import build_platform_binary
from fmpy.model_description import read_build_description
from fmpy.validation import validate_fmu
from lxml import etree

from flexbeams.fmus.documents.mathml import formula
from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.packaging import compilers
from flexbeams.fmus.packaging.binaries import binary_entries
from flexbeams.fmus.packaging.c_tables import panels
from flexbeams.fmus.packaging.compilers import PLATFORMS, chosen_platforms, find_compiler, host_platform
from flexbeams.fmus.packaging.native import HEADERS, build_native_units, unit_sources
from flexbeams.fmus.packaging.version_resource import version_resource
from flexbeams.fmus.units.native_kernel import NATIVE
from tests.compilations import compile_anew
from tests.helpers import ROOT, STRUCTURES, UNITS, Workshop, design_of
from tests.native.mach_o import ARM64, X86_64, read_library, universal
from tests.native.workshop import (
    FUNCTIONS,
    HARNESSES,
    INCLUDES,
    NATIVE_UNITS,
    STRICT,
    UNIT,
    ZIG,
    native_fmus,
    native_folder,
    native_unit,
    needs,
    needs_zig,
    run,
    source_file,
    source_folder,
    workspace,
)
from tests.units.loaded import loaded

pytestmark = [
    pytest.mark.native,
    pytest.mark.timeout(
        600
    ),  # once on a machine zig compiles the C libraries of all platforms: a CPU minute for Windows
]

on_linux = pytest.mark.skipif(sys.platform != "linux", reason="reads ELF")


@needs_zig
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_fmpy_has_no_complaint(unit: str) -> None:
    """FMPy takes seconds for the plant's many names; other structures and bases change no rule."""
    assert validate_fmu(str(native_fmus() / f"{unit}.fmu")) == []


@needs_zig
@pytest.mark.parametrize("unit", UNITS)
def test_the_variables_are_those_of_the_python_unit(workshop: Workshop, unit: str) -> None:
    """Names, references, start values, units, rules; what the unit can do differs."""
    trees = [
        ElementTree.parse(folder / "modelDescription.xml").getroot()
        for folder in (native_folder(unit), workshop.folder(unit))
    ]
    for part in ("UnitDefinitions", "LogCategories", "DefaultExperiment", "ModelVariables", "ModelStructure"):
        native, python = (ElementTree.tostring(tree.find(part)) for tree in trees)  # type: ignore[arg-type]
        assert native == python
    abilities = trees[0].find("CoSimulation")
    assert abilities is not None
    assert abilities.get("needsExecutionTool") == "false"
    assert abilities.get("canNotUseMemoryManagementFunctions") == "false"
    assert abilities.get("canInterpolateInputs") == ("true" if unit == "BeamPlant" else "false")
    assert abilities.get("canGetAndSetFMUstate") == abilities.get("canSerializeFMUstate") == "true"


class Page(HTMLParser):
    """Tags that are open, and references to other files."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.count: dict[str, int] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.count[tag] = self.count.get(tag, 0) + 1
        self.links += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@needs_zig
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_contents_of_a_unit(unit: str) -> None:
    """Sources that are listed, binaries, a page on its own, a picture and the licence; nothing else."""
    with zipfile.ZipFile(native_fmus() / f"{unit}.fmu") as archive:
        names = archive.namelist()
        page = Page()
        page.feed(archive.read("documentation/index.html").decode())
        assert archive.read("model.png").startswith(b"\x89PNG\r\n\x1a\n")
        assert archive.read("documentation/licenses/LICENSE") == Path("LICENSE").read_bytes()
        guid = fmpy.read_model_description(native_folder(unit)).guid
        assert guid.encode() in archive.read(f"sources/{unit}_tables.h")
    assert names == sorted(names)
    assert page.open == []
    assert page.count["math"] >= 3
    assert page.count["tr"] > len(fmpy.read_model_description(native_folder(unit)).modelVariables)
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    listed = [node.get("name") for node in ElementTree.parse(native_folder(unit) / "modelDescription.xml").iter("File")]
    assert listed == [f"{unit}.c"]
    assert listed == [Path(n).name for n in names if n.endswith(".c")]  # some tools compile all that they find
    assert [n for n in names if n.endswith(".h")] == [f"sources/{unit}_tables.h"]  # those of FMI are the tool's
    host = host_platform()
    binaries = sorted(f"binaries/{folder}/{unit}{host.suffix}" for folder in (host.name, host.fmi2_folder))
    assert [n for n in names if n.startswith("binaries/")] == binaries
    assert {n.split("/")[0] for n in names} == {
        "binaries",
        "documentation",
        "model.png",
        "modelDescription.xml",
        "sources",
        "terminalsAndIcons",
    }


@pytest.mark.parametrize("unit", UNITS)
def test_arrays_are_terminals(unit: str) -> None:
    """Each array of inputs or outputs is one terminal; FMI 2.0.4 takes the schema from FMI 3.0."""
    folder = native_folder(unit)
    document = etree.parse(folder / "terminalsAndIcons" / "terminalsAndIcons.xml")
    etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "schema/fmi3/fmi3TerminalsAndIcons.xsd")).assertValid(
        document
    )
    terminals = {t.get("name"): [m.get("variableName") for m in t] for t in document.iter("Terminal")}
    arrays: dict[str, list[str]] = {}
    for v in fmpy.read_model_description(str(folder)).modelVariables:
        if v.causality in ("input", "output") and v.name.endswith("]"):
            arrays.setdefault(v.name.partition("[")[0], []).append(v.name)
    assert terminals == arrays
    for terminal in document.iter("Terminal"):
        assert [m.get("memberName") for m in terminal] == [str(k) for k in range(1, len(terminal) + 1)]


def test_the_guid_follows_the_contents() -> None:
    """Another design, another description, another GUID; the same, the same."""
    out = Path("unit.fmu")
    units = [native_unit("TrackingController", design_of(structure), out) for structure in STRUCTURES]
    texts = [unit_sources(unit)[1] for unit in (*units, units[0])] + [unit_sources(units[0], version="7")[1]]
    guids = [ElementTree.fromstring(text).get("guid") for text in texts]
    assert guids[3] == guids[0]
    assert len(set(guids)) == 4


@pytest.mark.parametrize(
    ("command", "check"),
    [
        pytest.param(("gcc", "-O2", "-c"), ("gcc", "-fsyntax-only"), marks=needs("gcc")),
        pytest.param(("clang", "-fsyntax-only"), ("clang", "-fsyntax-only"), marks=needs("clang")),
        pytest.param((*ZIG, "-O0", "-c", "-o", "out.o"), (), marks=needs_zig),  # takes one file at once
    ],
    ids=["gcc", "clang", "zig"],
)
def test_no_compiler_warns(command: tuple[str, ...], check: tuple[str, ...], tmp_path: Path) -> None:
    """The file of each unit, optimised by gcc, each file that it was made of on its own, and the harnesses."""
    loops = [ROOT / "scenarios" / name for name in ("simulation/native/stepper.c", "bench/native/bench.c")]
    parts = [*sorted(NATIVE.rglob("*.c")), *sorted(HARNESSES.glob("*.c")), *loops]
    flags = (*STRICT, '-DUNIT_GUID=""', *INCLUDES, f"-I{source_folder('FlatnessFeedforward')}")
    for path in map(source_file, NATIVE_UNITS):
        run([*command, *flags, str(path)], cwd=tmp_path)
    for files in [parts] if check else [[part] for part in parts]:
        run([*(check or command), *flags, *map(str, files)], cwd=tmp_path)


@needs("clang-format")
def test_c_files_are_formatted() -> None:
    """As .clang-format says; the headers of the standard stay as they came."""
    folders = [NATIVE, HARNESSES, ROOT / "scenarios" / "simulation", ROOT / "scenarios" / "bench"]
    files = [path for folder in folders for path in sorted(folder.rglob("*.[ch]")) if path.parent != HEADERS]
    assert len(files) > 30
    run(["clang-format", "--dry-run", "-Werror", *map(str, files)])


def glibc_versions(library: Path) -> set[tuple[int, ...]]:
    """Versions of the C library whose functions a library needs."""
    lines = run(["readelf", "--dyn-syms", "--wide", str(library)]).splitlines()
    texts = {line.rsplit("GLIBC_", 1)[1].split(")")[0].split()[0] for line in lines if "GLIBC_" in line}
    return {tuple(map(int, text.split("."))) for text in texts}


@needs_zig
@needs("nm")
@on_linux
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_a_library_shows_nothing_but_fmi(unit: str, tmp_path: Path) -> None:
    """All functions of FMI 2.0 and only these; no writable data; needs libc and libm of glibc 2.17."""
    library = native_folder(unit) / "binaries" / "linux64" / f"{unit}.so"
    shown = [line.split()[-1] for line in run(["nm", "-D", "--defined-only", str(library)]).splitlines()]
    assert sorted(shown) == FUNCTIONS
    dynamic = run(["readelf", "-d", "--wide", str(library)])
    needed = {line.split("[")[1].rstrip("]") for line in dynamic.splitlines() if "NEEDED" in line}
    assert {"libc.so.6"} <= needed <= {"libc.so.6", "libm.so.6"}
    assert max(glibc_versions(library)) <= (2, 17)
    if shutil.which("gcc"):
        run(["gcc", "-std=c99", "-fno-pic", f"-I{HEADERS}", "-c", str(source_file(unit))], cwd=tmp_path)
        symbols = run(["nm", *map(str, tmp_path.glob("*.o"))])
        writable = [line for line in symbols.splitlines() if len(line.split()) == 3 and line.split()[1] in "BbCDdSs"]
        assert writable == []


@pytest.fixture(scope="module")
def everywhere() -> Path:
    """A unit with binaries for all platforms."""
    out = workspace() / "all" / "TrackingController.fmu"
    build_native_units([native_unit("TrackingController", design_of(), out)], ["all"], version="1.2.3.dev4")
    fmpy.extract(str(out), unzipdir=str(out.with_suffix("")))
    return out.with_suffix("")


def library(unit: Path, platform: str) -> Path:
    """The controller's library in the extracted unit."""
    return unit / "binaries" / platform / f"TrackingController{PLATFORMS[platform].suffix}"


@needs_zig
def test_all_platforms(everywhere: Path) -> None:
    """FMI 2.0's folders and the tuple folders; file formats by their first bytes."""
    starts = {
        "x86_64-linux": (b"\x7fELF", 18, b"\x3e\0"),
        "aarch64-linux": (b"\x7fELF", 18, b"\xb7\0"),
        "x86_64-windows": (b"MZ", 0, b"MZ"),
        "x86_64-darwin": (b"\xcf\xfa\xed\xfe", 4, b"\x07\0\0\x01"),
        "aarch64-darwin": (b"\xcf\xfa\xed\xfe", 4, b"\x0c\0\0\x01"),
    }
    assert starts.keys() == PLATFORMS.keys()
    assert sorted(path.name for path in (everywhere / "binaries").iterdir()) == sorted(
        ["linux64", "win64", "darwin64", *PLATFORMS]
    )
    for name, (magic, place, machine) in starts.items():
        content = library(everywhere, name).read_bytes()
        assert content.startswith(magic)
        assert content[place : place + len(machine)] == machine
        assert b"flexbeams-" not in content  # the temporary folder
        assert str(Path.cwd()).encode() not in content


@needs_zig
def test_the_folders_without_cpu(everywhere: Path) -> None:
    """linux64 has x86_64, and ARM where that is all; darwin64 has both, as they are."""
    by_folder = {path.name: next(path.iterdir()).read_bytes() for path in (everywhere / "binaries").iterdir()}
    assert by_folder["linux64"] == by_folder["x86_64-linux"]
    assert by_folder["win64"] == by_folder["x86_64-windows"]
    assert list(universal(by_folder["darwin64"])) == [X86_64, ARM64]
    assert list(universal(by_folder["darwin64"]).values()) == [
        by_folder[f"{cpu}-darwin"] for cpu in ("x86_64", "aarch64")
    ]
    for name, folder in (("aarch64-linux", "linux64"), ("aarch64-darwin", "darwin64"), ("x86_64-darwin", "darwin64")):
        own, path = PLATFORMS[name], f"Unit{PLATFORMS[name].suffix}"
        alone = binary_entries("Unit", {own: b"code", PLATFORMS["x86_64-windows"]: b"dll"})
        assert alone == {
            f"binaries/{name}/{path}": b"code",
            f"binaries/{folder}/{path}": b"code",
            "binaries/x86_64-windows/Unit.dll": b"dll",
            "binaries/win64/Unit.dll": b"dll",
        }


@needs_zig
@needs("readelf")
def test_the_arm_library(everywhere: Path) -> None:
    """Needs glibc 2.17, the first for 64-bit ARM."""
    assert glibc_versions(library(everywhere, "aarch64-linux")) == {(2, 17)}


@needs_zig
@needs("objdump")
def test_the_windows_library(everywhere: Path) -> None:
    """Exports FMI alone, imports the C runtime of Windows 10 alone, says which version it is."""
    dll = library(everywhere, "x86_64-windows")
    content = dll.read_bytes()
    assert all(text.encode("utf-16-le") in content for text in ("FileVersion\0", "1.2.3.dev4\0", f"{dll.name}\0"))
    assert b"\xbd\x04\xef\xfe" + struct.pack("<5I", 1 << 16, 1 << 16 | 2, 3 << 16, 1 << 16 | 2, 3 << 16) in content
    try:
        text = run(["objdump", "-p", str(dll)])
    except AssertionError:
        pytest.skip("this objdump does not read Windows libraries")
    table = text.split("[Ordinal/Name Pointer] Table")[1].strip().split("\n\n")[0]
    assert sorted(line.split()[-1] for line in table.splitlines() if "] " in line) == FUNCTIONS
    needed = [line.split("DLL Name: ")[1].lower() for line in text.splitlines() if "DLL Name" in line]
    assert needed
    assert all(name.startswith(("api-ms-win-crt-", "kernel32")) for name in needed)
    versions = dict(line.split()[:2] for line in text.splitlines() if line.startswith(("Major", "Minor")))
    assert max(int(versions["MajorOSystemVersion"]), int(versions["MajorSubsystemVersion"])) <= 10


RESOURCE = """1 VERSIONINFO
FILEVERSION 1,2,3,0
PRODUCTVERSION 1,2,3,0
FILEOS 0x40004
FILETYPE 2
BEGIN
    BLOCK "StringFileInfo"
    BEGIN
        BLOCK "040904B0"
        BEGIN
            VALUE "CompanyName", "flexbeams contributors"
            VALUE "FileDescription", "TrackingController, FMI 2.0 co-simulation unit"
            VALUE "FileVersion", "1.2.3.dev4"
            VALUE "InternalName", "TrackingController"
            VALUE "LegalCopyright", "flexbeams contributors, BSD-2-Clause"
            VALUE "OriginalFilename", "TrackingController.dll"
            VALUE "ProductName", "flexbeams"
            VALUE "ProductVersion", "1.2.3.dev4"
        END
    END
    BLOCK "VarFileInfo"
    BEGIN
        VALUE "Translation", 0x409, 1200
    END
END
"""


@needs("llvm-rc")
def test_a_resource_compiler_gives_the_version_information(tmp_path: Path) -> None:
    interface = native_unit("TrackingController", design_of(), tmp_path).interface
    (tmp_path / "version.rc").write_text(RESOURCE)
    run(["llvm-rc", "/FO", str(tmp_path / "version.res"), str(tmp_path / "version.rc")])
    own = version_resource(interface, "TrackingController.dll", "1.2.3.dev4")
    assert own == (tmp_path / "version.res").read_bytes()


@needs_zig
@pytest.mark.parametrize("cpu", [X86_64, ARM64])
def test_the_mac_libraries(everywhere: Path, cpu: int) -> None:
    """Export FMI alone, from macOS 11 on; signed for ARM, which demands it."""
    mac = read_library(universal((everywhere / "binaries/darwin64/TrackingController.dylib").read_bytes())[cpu])
    assert (mac.cpu, mac.oldest_macos) == (cpu, (11, 0))
    assert mac.exports == sorted(f"_{name}" for name in FUNCTIONS)
    assert mac.signed == (cpu == ARM64)


@needs_zig
@needs("llvm-objdump")
@pytest.mark.parametrize("platform", ["x86_64-darwin", "aarch64-darwin"])
def test_another_reader_finds_the_exports_of_the_mac_libraries(everywhere: Path, platform: str) -> None:
    """With the addresses of the symbol table."""
    path = library(everywhere, platform)
    lines = run(["llvm-objdump", "--macho", "--exports-trie", str(path)]).split("Exports trie:")[1].split("\n")
    exports = {line.split()[1]: int(line.split()[0], 16) for line in lines if line.strip()}
    symbols = run(["llvm-objdump", "--macho", "--syms", str(path)]).splitlines()
    addresses = {line.split()[-1]: int(line.split()[0], 16) for line in symbols if " g " in line}
    assert exports.keys() == {f"_{name}" for name in FUNCTIONS}
    assert exports.items() <= addresses.items()


def assert_equal_bytes(units: Sequence[str], platforms: Sequence[str], folder: Path) -> None:
    """Of units that are built together, and one by one into a folder with spaces, in another order."""
    first, other = folder / "first", folder / "a folder with spaces"
    build_native_units([native_unit(unit, design_of(), first / f"{unit}.fmu") for unit in units], platforms)
    other.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(other))
        patch.setattr("tempfile.tempdir", None)
        patch.chdir(other)
        for unit in reversed(units):
            out = other / f"{unit}.fmu"
            build_native_units([native_unit(unit, design_of(), out)], [*reversed(platforms), platforms[0]])
            assert out.read_bytes() == (first / out.name).read_bytes()
    assert sorted(path.name for path in other.iterdir()) == sorted(f"{unit}.fmu" for unit in units)


@needs_zig
def test_equal_inputs_give_equal_archives(tmp_path: Path) -> None:
    """Of every unit, around binaries that are compiled once."""
    assert_equal_bytes(NATIVE_UNITS, ["host"], tmp_path)


@needs_zig
@pytest.mark.usefixtures("own_compilations")
def test_equal_inputs_give_equal_binaries(tmp_path: Path) -> None:
    """Of several platforms, compiled anew: a small unit and one with long tables."""
    assert_equal_bytes(["MfcActuator", "FlatnessFeedforward"], ["aarch64-linux", "host"], tmp_path)


@needs("gcc")
@pytest.mark.skipif(sys.platform != "linux", reason="gcc builds for Linux here")
def test_a_compiler_of_the_system(tmp_path: Path) -> None:
    """Gives the results of the wheel's to the last bit."""
    out = tmp_path / "BeamPlant.fmu"
    build_native_units([native_unit("BeamPlant", design_of(), out)], compiler="gcc")
    fmpy.extract(str(out), unzipdir=str(out.with_suffix("")))
    ends = []
    for folder in (out.with_suffix(""), native_folder("BeamPlant")):
        with loaded(folder) as plant:
            plant.begin(**{"beam[1].density": 1700.0})
            for k in range(200):
                plant.advance(2e-4, u=300.0 * np.sin(k / 20), force=0.01)
            ends.append(plant.everything())
    assert (ends[0] == ends[1]).all()
    with pytest.raises(BuildError, match=r"gcc builds for .* only, x86_64-windows takes the compiler zig"):
        build_native_units([native_unit("BeamPlant", design_of(), out)], ["x86_64-windows"], "gcc")


@needs_zig
@needs("cmake", "ninja")
@pytest.mark.parametrize("unit", ["TrackingController", UNIT])
def test_fmpy_compiles_the_sources(unit: str, tmp_path: Path) -> None:
    """`fmpy compile` on a shipped unit and on a loop: same values from the new binary."""
    folder = tmp_path / unit
    shutil.copytree(native_folder(unit), folder)
    shutil.rmtree(folder / "binaries")
    build_platform_binary(folder, cmake_options={"CMAKE_GENERATOR": "Ninja"})
    ends = []
    for place in (folder, native_folder(unit)):
        with loaded(place) as one:
            ends.append(one.begin().advance(2e-4).everything())
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-14)


@needs_zig
@on_linux
@pytest.mark.parametrize("unit", NATIVE_UNITS)
@pytest.mark.parametrize("compiler", [pytest.param(name, marks=needs(name)) for name in ("gcc", "clang", "tcc")])
def test_other_compilers_give_the_same(compiler: str, unit: str, tmp_path: Path) -> None:
    """Small ones without optimisation too, which take no infinite constants."""
    folder = tmp_path / unit
    shutil.copytree(native_folder(unit), folder)
    library = folder / "binaries" / "linux64" / f"{unit}.so"
    flags = ["-std=c99", "-fPIC", "-shared", "-DFMI2_OVERRIDE_FUNCTION_PREFIX", f"-I{HEADERS}"]
    run([compiler, *flags, str(folder / "sources" / f"{unit}.c"), "-o", str(library), "-lm"])
    ends = []
    for place in (folder, native_folder(unit)):
        with loaded(place) as one:
            ends.append(one.begin().advance(2e-4).everything())
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-12)


@needs_zig
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_the_build_description(unit: str) -> None:
    """Valid by the schema of FMI 3.0, to which FMI 2.0.4 refers; one file that defines its prefix itself."""
    (configuration,) = read_build_description(native_folder(unit))
    assert configuration.modelIdentifier == unit
    (files,) = configuration.sourceFileSets
    assert (files.language, files.sourceFiles, files.preprocessorDefinitions) == ("C99", [f"{unit}.c"], [])


@needs_zig
@needs("cmake", "ninja", "nm")
@pytest.mark.parametrize(("shared", "prefix"), [("ON", ""), ("OFF", "BeamClosedLoop_")])
def test_cmake_builds_the_sources(shared: str, prefix: str, tmp_path: Path) -> None:
    """A shared library with the plain names, a static one with the prefixed names."""
    sources = native_folder("BeamClosedLoop") / "sources"
    options = [f"-DFMI2_HEADERS={HEADERS}", f"-DBUILD_SHARED_LIBS={shared}", "-DCMAKE_C_FLAGS=-Wall -Wextra -Werror"]
    run(["cmake", "-G", "Ninja", "-S", str(sources), "-B", str(tmp_path), *options])
    run(["cmake", "--build", str(tmp_path)])
    (library,) = [path for path in tmp_path.iterdir() if path.suffix in (".so", ".a")]
    assert library.stem.removeprefix("lib") == "BeamClosedLoop"
    flags = ["-D"] if shared == "ON" else ["-g"]
    names = [
        line.split()[-1] for line in run(["nm", *flags, "--defined-only", str(library)]).splitlines() if " T " in line
    ]
    assert sorted(names) == [f"{prefix}{name}" for name in FUNCTIONS]


@needs("cmake", "ninja", "gcc")
@pytest.mark.skipif(platform.machine() != "x86_64", reason="this is not x86-64")
@pytest.mark.parametrize(("bits", "by_sse"), [("-m32", True), ("-m64", False)])
def test_cmake_keeps_32_bit_units_off_the_x87(bits: str, by_sse: bool, tmp_path: Path) -> None:
    """By a flag, which no other machine gets; its registers are longer than doubles."""
    options = [f"-DFMI2_HEADERS={HEADERS}", "-DCMAKE_C_COMPILER=gcc", f"-DCMAKE_C_FLAGS={bits}"]
    options += ["-DCMAKE_TRY_COMPILE_TARGET_TYPE=STATIC_LIBRARY", "-DCMAKE_EXPORT_COMPILE_COMMANDS=ON"]
    run(["cmake", "-G", "Ninja", "-S", str(source_folder("TrackingController")), "-B", str(tmp_path), *options])
    assert ("-msse2 -mfpmath=sse" in (tmp_path / "compile_commands.json").read_text()) == by_sse


@needs("cmake", "ninja")
def test_cmake_says_where_headers_are_missing(tmp_path: Path) -> None:
    done = subprocess.run(
        ["cmake", "-G", "Ninja", "-S", str(source_folder("TrackingController")), "-B", str(tmp_path)],
        capture_output=True,
        text=True,
    )
    assert done.returncode != 0
    assert "FMI2_HEADERS must be the folder with fmi2Functions.h" in " ".join(done.stderr.split())


@pytest.mark.parametrize(
    ("names", "text"),
    [
        (["linux"], "platform must be host, all or one of x86_64-linux, .*, got 'linux'"),
        ([], "platform must be given at least once"),
    ],
)
def test_unknown_platforms_are_refused(names: list[str], text: str) -> None:
    with pytest.raises(BuildError, match=text):
        chosen_platforms(names)


def test_platforms_are_chosen_once() -> None:
    assert [p.name for p in chosen_platforms(["host", host_platform().name])] == [host_platform().name]
    assert [p.name for p in chosen_platforms(["host", "all"])] == sorted(PLATFORMS)


def test_a_machine_without_units_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "riscv64")
    with pytest.raises(BuildError, match="native units are not built for riscv64-linux; choose among x86_64-linux"):
        host_platform()


def test_missing_compilers_say_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(BuildError, match=r"the compiler gcc-99 is missing: install it .* or pip install ziglang"):
        find_compiler("gcc-99")
    monkeypatch.setattr(compilers.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(BuildError, match="the compiler zig is missing: pip install ziglang"):
        find_compiler()


@pytest.mark.skipif(sys.platform == "win32", reason="a shell script is the compiler")
def test_a_failing_compiler_is_reported_in_one_line(tmp_path: Path) -> None:
    script = tmp_path / "cc"
    script.write_text(
        "#!/bin/sh\necho 'Unit_tables.h:1: note' >&2\necho 'Unit_tables.h:2: error: broken' >&2\nexit 1\n"
    )
    script.chmod(0o755)
    unit = native_unit("TrackingController", design_of(), tmp_path / "unit.fmu")
    with pytest.raises(
        BuildError, match=r"^TrackingController.o for \S+ cannot be compiled: Unit_tables.h:2: error: b"
    ):
        build_native_units([unit], compiler=str(script))
    assert not unit.out.exists()
    script.write_text("#!/nowhere/sh\n")
    with pytest.raises(BuildError, match="cc cannot be run: No such file"):
        build_native_units([unit], compiler=str(script))


@needs_zig
@pytest.mark.skipif(sys.platform == "win32", reason="the folder is that of POSIX")
def test_a_user_without_a_home_can_compile(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Zig has no folder of the user's then, and in some of them never ends."""
    source, library = tmp_path / "one.c", tmp_path / "one.so"
    source.write_text("int one(void);\nint one(void) { return 1; }\n")
    for name in ("XDG_CACHE_HOME", "ZIG_GLOBAL_CACHE_DIR"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("HOME", str(source / "home"))
    compilers.zig_environment.cache_clear()
    try:
        (folder,) = compilers.zig_environment().values()
        compile_anew(find_compiler("zig"), library, ["-shared"], [], [], [source], host_platform())
        assert library.is_file()
        assert any(Path(folder).iterdir())
        monkeypatch.setenv("HOME", str(tmp_path))
        compilers.zig_environment.cache_clear()
        assert compilers.zig_environment() == {}
    finally:
        compilers.zig_environment.cache_clear()


def test_extra_files_go_into_the_unit(tmp_path: Path) -> None:
    unit = native_unit("TrackingController", design_of(), tmp_path / "unit.fmu")
    build_native_units([replace(unit, extra={"extra/org.example/results.csv": b"time\n"})])
    with zipfile.ZipFile(unit.out) as archive:
        assert archive.read("extra/org.example/results.csv") == b"time\n"


def test_tables_hold_every_digit(tmp_path: Path) -> None:
    """The numbers in tables.c are those of the design: all of them, read back by a compiler where there is one."""
    unit = native_unit("TrackingController", design_of(), tmp_path / "unit.fmu")
    text = unit.tables("{guid}")
    start = text.index("data_estimates[] ALIGNED = {")
    numbers = text[start : text.index("};", start)].split("{")[1].replace(",", " ").split()
    outputs = np.hstack([design_of().arrays[name] for name in ("H_pi", "D_pi")])
    np.testing.assert_array_equal([float.fromhex(n) for n in numbers], panels(outputs))


def test_panels() -> None:
    """Rows in groups of eight, each group column by column, zeros at the end."""
    matrix = np.arange(1.0, 11.0 * 3 + 1).reshape(11, 3)
    stored = panels(matrix).reshape(2, 3, 8)
    for i in range(16):
        row = matrix[i] if i < 11 else np.zeros(3)
        np.testing.assert_array_equal(stored[i // 8, :, i % 8], row)


def test_unknown_units_and_bad_tables_are_refused(tmp_path: Path) -> None:
    unit = native_unit("TrackingController", design_of(), tmp_path / "unit.fmu")
    python_only = replace(unit.kind, name="Lag", native=None)
    with pytest.raises(BuildError, match="Lag: there is no native unit of this kind"):
        replace(unit, kind=python_only)
    arrays = {**unit.data.arrays, "regulator": np.full((8, 34), np.nan)}
    broken = replace(unit, data=replace(unit.data, arrays=arrays))
    with pytest.raises(BuildError, match="data_regulator must be finite"):
        build_native_units([broken])


def test_formulas() -> None:
    assert formula("dot x_k^2 = A^{-1} x ; y") == (
        '<math display="block"><mrow><msubsup><mover accent="false"><mi>x</mi><mo>&#x02D9;</mo></mover><mi>k</mi>'
        "<mn>2</mn></msubsup><mo>=</mo><msup><mi>A</mi><mrow><mo>-</mo><mn>1</mn></mrow></msup><mi>x</mi>"
        '<mspace width="2em"/><mi>y</mi></mrow></math>'
    )


def test_each_target_of_several_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A line for each binary before it is waited for; none for the only one."""
    from flexbeams.fmus.packaging import native

    monkeypatch.setattr(native, "code_object", lambda *_: Path())
    monkeypatch.setattr(native, "_linked", lambda *_: b"binary")
    unit = native_unit("BeamPlant", design_of("single_beam"), tmp_path / "BeamPlant.fmu")
    notes: list[str] = []
    native.build_native_units([unit], ["x86_64-linux"], notify=notes.append)
    assert notes == []
    native.build_native_units([unit], ["x86_64-linux", "aarch64-linux"], notify=notes.append)
    assert notes == ["compiling BeamPlant for aarch64-linux", "compiling BeamPlant for x86_64-linux"]
