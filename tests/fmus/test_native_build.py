"""Building native units: what is in them, compilers, platforms, equal bytes."""

import shutil
import sys
import zipfile
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import fmpy
import numpy as np
import pytest
from fmpy.build import build_platform_binary
from fmpy.validation import validate_fmu

from flexbeams.fmus.documents.mathml import formula
from flexbeams.fmus.errors import BuildError
from flexbeams.fmus.packaging import compilers
from flexbeams.fmus.packaging.c_tables import panels, tables_source
from flexbeams.fmus.packaging.compilers import PLATFORMS, chosen_platforms, find_compiler, host_platform
from flexbeams.fmus.packaging.native import NativeUnit, build_native_units, unit_sources
from flexbeams.fmus.units.shipped import UNITS
from tests.helpers import STRUCTURES, Workshop, design_of
from tests.native.workshop import (
    HARNESSES,
    NATIVE_UNITS,
    STRICT,
    ZIG,
    native_fmus,
    native_folder,
    native_unit,
    needs,
    needs_zig,
    run,
    source_files,
    source_folder,
    workspace,
)
from tests.units.loaded import loaded

FUNCTIONS = sorted(
    name
    for name in {*dir(fmpy.fmi2.FMU2Slave), *dir(fmpy.fmi2.FMU2Model)}
    if name.startswith("fmi2") and name[4].isupper()
)


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
        assert guid.encode() in archive.read("sources/tables.c")
    assert names == sorted(names)
    assert page.open == []
    assert page.count["math"] >= 3
    assert page.count["tr"] > len(fmpy.read_model_description(native_folder(unit)).modelVariables)
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    listed = [node.get("name") for node in ElementTree.parse(native_folder(unit) / "modelDescription.xml").iter("File")]
    assert listed == [path.name for path in source_files(unit)]
    assert listed == [Path(n).name for n in names if n.endswith(".c")]  # some tools compile all that they find
    text = "".join(path.read_text() for path in source_files(unit))
    assert all(f'#include "{Path(n).name}"' in text for n in names if n.endswith(".inc"))
    host = host_platform()
    binaries = sorted(f"binaries/{folder}/{unit}{host.suffix}" for folder in host.folders)
    assert [n for n in names if n.startswith("binaries/")] == binaries
    assert {n.split("/")[0] for n in names} == {
        "binaries",
        "documentation",
        "model.png",
        "modelDescription.xml",
        "sources",
    }


def test_the_guid_follows_the_contents() -> None:
    """Another design, another description, another GUID; the same, the same."""
    out = Path("unit.fmu")
    units = [native_unit("TrackingController", design_of(structure), out) for structure in STRUCTURES]
    texts = [unit_sources(unit)[1] for unit in (*units, units[0])] + [unit_sources(units[0], version="7")[1]]
    guids = [ElementTree.fromstring(text).get("guid") for text in texts]
    assert guids[3] == guids[0]
    assert len(set(guids)) == 4


@pytest.mark.parametrize(
    "command",
    [
        pytest.param(("gcc",), marks=needs("gcc")),
        pytest.param(("clang",), marks=needs("clang")),
        pytest.param(ZIG, marks=needs_zig),
    ],
    ids=["gcc", "clang", "zig"],
)
def test_no_compiler_warns(command: tuple[str, ...], tmp_path: Path) -> None:
    """All sources of all units and the harnesses, in strict C99."""
    sources: dict[str, Path] = {}
    for unit in NATIVE_UNITS:
        for path in source_files(unit):
            sources[f"{unit}.c" if path.name == "tables.c" else path.name] = path
    includes = [f"-I{source_folder(unit)}" for unit in NATIVE_UNITS]
    harnesses = [HARNESSES / f"{name}.c" for name in ("life_cycle", "closed_loop", "run_library")]
    for path in [*sources.values(), *harnesses]:
        run([*command, *STRICT, "-O2", *includes, "-c", str(path), "-o", str(tmp_path / "out.o")])


@needs_zig
@needs("nm")
@pytest.mark.skipif(sys.platform != "linux", reason="reads ELF")
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_a_library_shows_nothing_but_fmi(unit: str, tmp_path: Path) -> None:
    """All functions of FMI 2.0 and only these; no writable data; needs libc and libm of glibc 2.17."""
    library = native_folder(unit) / "binaries" / "linux64" / f"{unit}.so"
    shown = [line.split()[-1] for line in run(["nm", "-D", "--defined-only", str(library)]).splitlines()]
    assert sorted(shown) == FUNCTIONS
    dynamic = run(["readelf", "-d", "--wide", str(library)])
    assert sorted(line.split("[")[1].rstrip("]") for line in dynamic.splitlines() if "NEEDED" in line) == [
        "libc.so.6",
        "libm.so.6",
    ]
    versions = {
        line.rsplit("GLIBC_", 1)[1].split(")")[0].split()[0]
        for line in run(["readelf", "--dyn-syms", "--wide", str(library)]).splitlines()
        if "GLIBC_" in line
    }
    assert all(tuple(map(int, version.split("."))) <= (2, 17) for version in versions)
    if shutil.which("gcc"):
        sources = map(str, source_files(unit))
        run(["gcc", "-std=c99", "-O2", "-fPIC", "-c", *sources], cwd=tmp_path)
        symbols = run(["nm", *map(str, tmp_path.glob("*.o"))])
        writable = [line for line in symbols.splitlines() if len(line.split()) == 3 and line.split()[1] in "BbCDdSs"]
        assert writable == []


@pytest.fixture(scope="module")
def everywhere() -> Path:
    """A unit with binaries for all platforms."""
    out = workspace() / "all" / "TrackingController.fmu"
    build_native_units([native_unit("TrackingController", design_of(), out)], ["all"])
    fmpy.extract(str(out), unzipdir=str(out.with_suffix("")))
    return out.with_suffix("")


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
        contents = {
            (everywhere / "binaries" / folder / f"TrackingController{PLATFORMS[name].suffix}").read_bytes()
            for folder in PLATFORMS[name].folders
        }
        assert len(contents) == 1
        content = contents.pop()
        assert content.startswith(magic)
        assert content[place : place + len(machine)] == machine
        assert b"flexbeams_" not in content  # the temporary folder
        assert str(Path.cwd()).encode() not in content


@needs_zig
@needs("objdump")
def test_the_windows_library(everywhere: Path) -> None:
    """Exports FMI alone, imports the C runtime of Windows alone."""
    library = everywhere / "binaries" / "win64" / "TrackingController.dll"
    try:
        text = run(["objdump", "-p", str(library)])
    except AssertionError:
        pytest.skip("this objdump does not read Windows libraries")
    table = text.split("[Ordinal/Name Pointer] Table")[1].strip().split("\n\n")[0]
    assert sorted(line.split()[-1] for line in table.splitlines() if "] " in line) == FUNCTIONS
    needed = [line.split("DLL Name: ")[1].lower() for line in text.splitlines() if "DLL Name" in line]
    assert needed
    assert all(name.startswith(("api-ms-win-crt-", "kernel32")) for name in needed)


@needs_zig
@pytest.mark.skipif(not any(map(shutil.which, ("llvm-nm", "llvm-nm-14"))), reason="not installed: llvm-nm")
@pytest.mark.parametrize("folder", ["x86_64-darwin", "aarch64-darwin"])
def test_the_mac_libraries(everywhere: Path, folder: str) -> None:
    nm = shutil.which("llvm-nm") or "llvm-nm-14"
    library = everywhere / "binaries" / folder / "TrackingController.dylib"
    shown = [line.split()[-1] for line in run([nm, "-g", "--defined-only", str(library)]).splitlines()]
    assert sorted(name.removeprefix("_") for name in shown if not name.startswith("__")) == FUNCTIONS


@needs_zig
def test_equal_inputs_give_equal_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the order, the folder and the number of units."""
    first = tmp_path / "first"
    build_native_units(
        [native_unit(unit, design_of(), first / f"{unit}.fmu") for unit in NATIVE_UNITS], ["aarch64-linux", "host"]
    )
    other = tmp_path / "a folder with spaces"
    other.mkdir()
    monkeypatch.setenv("TMPDIR", str(other))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.chdir(other)
    for unit in reversed(NATIVE_UNITS):
        build_native_units([native_unit(unit, design_of(), other / f"{unit}.fmu")], ["host", "aarch64-linux", "host"])
        assert (other / f"{unit}.fmu").read_bytes() == (first / f"{unit}.fmu").read_bytes()
    assert sorted(path.name for path in other.iterdir()) == sorted(f"{unit}.fmu" for unit in NATIVE_UNITS)


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
@pytest.mark.parametrize("unit", NATIVE_UNITS)
def test_fmpy_compiles_the_sources(unit: str, tmp_path: Path) -> None:
    """`fmpy compile` on the shipped unit: same values from the new binary."""
    folder = tmp_path / unit
    shutil.copytree(native_folder(unit), folder)
    shutil.rmtree(folder / "binaries")
    build_platform_binary(folder, cmake_options={"CMAKE_GENERATOR": "Ninja"})
    ends = []
    for place in (folder, native_folder(unit)):
        with loaded(place) as one:
            ends.append(one.begin().advance(2e-4).everything())
    np.testing.assert_allclose(ends[0], ends[1], rtol=1e-14)


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
    script.write_text("#!/bin/sh\necho 'tables.c:1: note' >&2\necho 'tables.c:2: error: broken' >&2\nexit 1\n")
    script.chmod(0o755)
    unit = native_unit("TrackingController", design_of(), tmp_path / "unit.fmu")
    with pytest.raises(BuildError, match=r"^TrackingController.so for \S+ cannot be compiled: tables.c:2: error: b"):
        build_native_units([unit], compiler=str(script))
    assert not unit.out.exists()
    script.write_text("#!/nowhere/sh\n")
    with pytest.raises(BuildError, match="cc cannot be run: No such file"):
        build_native_units([unit], compiler=str(script))


def test_extra_files_go_into_the_unit(tmp_path: Path) -> None:
    unit = native_unit("TrackingController", design_of(), tmp_path / "unit.fmu")
    extra = NativeUnit(
        interface=unit.interface,
        data=unit.data,
        meta=unit.meta,
        out=unit.out,
        extra={"extra/org.example/results.csv": b"time\n"},
    )
    build_native_units([extra])
    with zipfile.ZipFile(unit.out) as archive:
        assert archive.read("extra/org.example/results.csv") == b"time\n"


def test_tables_hold_every_digit(tmp_path: Path) -> None:
    """The numbers in tables.c are those of the design: all of them, read back by a compiler where there is one."""
    unit = native_unit("TrackingController", design_of(), tmp_path / "unit.fmu")
    text = tables_source(unit.interface, unit.data, unit.meta, "{guid}")
    start = text.index("controller_estimates[] = {")
    numbers = text[start : text.index("};", start)].split("{")[1].replace(",", " ").split()
    outputs = np.hstack([unit.data["H_pi"], unit.data["D_pi"]])
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
    other = NativeUnit(interface=replace(unit.interface, unit_name="Lag"), data=unit.data, meta=unit.meta, out=unit.out)
    with pytest.raises(BuildError, match="Lag: there is no native unit of this name"):
        build_native_units([other])
    broken = NativeUnit(
        interface=unit.interface,
        data={**unit.data, "feedback_gain": np.full((4, 30), np.nan)},
        meta=unit.meta,
        out=unit.out,
    )
    with pytest.raises(BuildError, match="controller_regulator must be finite"):
        build_native_units([broken])


def test_formulas() -> None:
    assert formula("dot x_k^2 = A^{-1} x ; y") == (
        '<math display="block"><mrow><msubsup><mover accent="false"><mi>x</mi><mo>&#x02D9;</mo></mover><mi>k</mi>'
        "<mn>2</mn></msubsup><mo>=</mo><msup><mi>A</mi><mrow><mo>-</mo><mn>1</mn></mrow></msup><mi>x</mi>"
        '<mspace width="2em"/><mi>y</mi></mrow></math>'
    )
