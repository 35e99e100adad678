"""The cache of compiled code: what is damaged, or could have been changed by others, is not loaded."""

import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from flexbeams.controller.design import Design
from flexbeams.controller.options import DesignOptions
from flexbeams.fmus.packaging import build, cache, designs, kept_units
from flexbeams.fmus.packaging.compilers import Compiler, host_platform
from flexbeams.fmus.packaging.native import build_native_units
from flexbeams.fmus.units.beam_plant import BEAM_PLANT
from flexbeams.plant.errors import InputError
from flexbeams.plant.structure import Structure
from flexbeams.scenarios.cli.main import main
from tests.helpers import design_of
from tests.native.workshop import native_unit, needs_zig

posix = pytest.mark.skipif(os.name != "posix", reason="owners and modes are those of POSIX")


def damage(file: Path, how: str) -> None:
    if how == "empty":
        file.write_bytes(b"")
    elif how == "one bit":
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 1
        file.write_bytes(bytes(content))
    elif how == "cut":
        file.write_bytes(file.read_bytes()[:-1])
    elif how == "no hash":
        file.with_name(f"{file.name}.sha256").unlink()
    elif how == "hash cut":
        beside = file.with_name(f"{file.name}.sha256")
        beside.write_bytes(beside.read_bytes()[:20])
    elif how == "link":
        target = file.with_name("elsewhere")
        file.rename(target)
        file.symlink_to(target)
    elif how == "writable by others":
        file.chmod(0o666)
    elif how == "folder writable by others":
        file.parent.chmod(0o777)
    else:
        file.unlink()


@posix
@pytest.mark.parametrize(
    "how",
    ["empty", "one bit", "cut", "no hash", "hash cut", "link", "writable by others", "folder writable by others", "-"],
)
def test_a_file_is_sound_only_as_it_was_written(how: str, tmp_path: Path) -> None:
    root = tmp_path / "cache"
    file = root / "key" / "native" / "Unit.fmu"
    cache.keep(file, b"compiled code", root)
    assert cache.is_sound(file, root)
    damage(file, how)
    assert not cache.is_sound(file, root)
    cache.keep(file, b"compiled code", root)
    assert cache.is_sound(file, root)


def test_designs_are_kept_bit_by_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Computed once; again where options, structure or sources differ, or the file is damaged."""
    computed = []

    def compute(structure: Structure, options: DesignOptions) -> Design:
        computed.append(options)
        return design_of("single_beam")

    monkeypatch.setattr(designs, "compute_design", compute)
    root, made = tmp_path / "cache", design_of("single_beam")
    for _ in range(2):
        found = designs.cached_design(made.structure, made.options, root)
        assert (found.design_id, found.summary, found.options) == (made.design_id, made.summary, made.options)
        assert {name: a.tobytes() for name, a in found.arrays.items()} == {
            name: a.tobytes() for name, a in made.arrays.items()
        }
    assert len(computed) == 1
    [file] = cache.cached_files(root)
    damage(file, "one bit")
    designs.cached_design(made.structure, made.options, root)
    designs.cached_design(made.structure, replace(made.options, sample_time=1e-4), root)
    designs.cached_design(replace(made.structure, strain_gauge=made.structure.strain_gauge[1:]), made.options, root)
    monkeypatch.setattr(designs, "sources_digest", lambda *packages: "other")
    designs.cached_design(made.structure, made.options, root)
    assert len(computed) == 5
    assert cache.clear_cache(root) == 4


def test_without_a_cache_designs_are_computed(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file")
    made = design_of("single_beam")
    assert designs.cached_design(made.structure, made.options, tmp_path / "cache").design_id == made.design_id


def test_damaged_units_are_built_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One build of what is missing, none of what is there, one of what is damaged."""
    design = design_of("single_beam")
    model, builds = design.model(), []

    def build_units(kinds: Any, design: Any, model: Any, folder: Path, *, backend: str, **_: Any) -> list[Path]:
        builds.append(folder)
        file = folder / backend / f"{kinds[0].name}.fmu"
        file.write_bytes(b"a unit")
        return [file]

    monkeypatch.setattr(build, "build_units", build_units)

    def ensure() -> Path:
        notes: list[str] = []
        wanted = {"plant": (BEAM_PLANT, model)}
        return kept_units.ensure_units(wanted, design, tmp_path / "cache", notes.append)["plant"]

    file = ensure()
    assert ensure() == file
    assert len(builds) == 1
    damage(file, "cut")
    assert ensure() == file
    assert file.read_bytes() == b"a unit"
    assert len(builds) == 2


@posix
def test_a_cache_of_others_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = tmp_path / "cache"
    root.mkdir()
    for mode in (0o777, 0o720, 0o702):
        root.chmod(mode)
        with pytest.raises(InputError, match="must not be writable by others: its code would run"):
            cache.prepare_cache(root)
    root.chmod(0o700)
    cache.prepare_cache(root)
    monkeypatch.setattr(os, "getuid", lambda: root.stat().st_uid + 1)
    with pytest.raises(InputError, match="must belong to the user who runs flexbeams"):
        cache.prepare_cache(root)


def test_the_key_names_compiler_version_platform_and_package(monkeypatch: pytest.MonkeyPatch) -> None:
    design = design_of("single_beam")
    folders = {kept_units.unit_folder(design, design.model(), Path("cache"))}
    for name, value in (("compiler_version", "1.2"), ("host_name", "riscv-plan9"), ("installed_version", "9.9")):
        with monkeypatch.context() as patch:
            patch.setattr(cache, name, lambda *_, value=value: value)
            cache.toolchain_key.cache_clear()
            folders.add(kept_units.unit_folder(design, design.model(), Path("cache")))
    cache.toolchain_key.cache_clear()
    assert len(folders) == 4


def test_where_the_cache_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FLEXBEAMS_CACHE", "chosen")
    assert cache.cache_folder() == Path("chosen")
    assert cache.cache_folder("given") == Path("given")
    monkeypatch.delenv("FLEXBEAMS_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert cache.cache_folder().is_absolute()
    assert cache.cache_folder().name == "flexbeams"


def test_clearing_removes_what_was_written_and_nothing_else(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tmp_path / "cache"
    for name in ("key/native/A.fmu", "key/native/B.fmu", "stepper-0.so"):
        cache.keep(root / name, b"code", root)
    (root / "key" / "notes.txt").write_text("mine")
    (root / "stepper-of-mine.so").write_text("mine")
    assert main(["cache", "--cache", str(root)]) == 0
    assert capsys.readouterr().out == f"{root}: 3 files, 0.0 MB\n"
    assert main(["cache", "clear", "--cache", str(root)]) == 0
    assert capsys.readouterr().out == f"{root}: 3 files removed\n"
    left = sorted(str(p.relative_to(root)) for p in root.rglob("*") if p.is_file())
    assert left == ["key/notes.txt", "stepper-of-mine.so"]
    assert main(["cache", "--cache", str(tmp_path / "none")]) == 0
    shutil.rmtree(root)


@pytest.mark.native
def test_nothing_of_the_current_folder_runs_and_only_results_are_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A library planted under the name that the stepping loop would have in ./build/fmus."""
    from flexbeams.scenarios.simulation.native_stepper import stepper_library

    monkeypatch.chdir(tmp_path)
    planted = tmp_path / "build/fmus" / stepper_library(cache.cache_folder(), "zig").name
    planted.parent.mkdir(parents=True)
    planted.write_bytes(b"would fail to load")
    assert main(["run", "single_beam", "--stop-time", "0.01", "--no-figures", "--no-report"]) == 0
    assert {p.name for p in tmp_path.iterdir()} == {"build", "results"}
    assert [p.name for p in (tmp_path / "build").rglob("*") if p.is_file()] == [planted.name]


@needs_zig
@pytest.mark.native
def test_code_is_compiled_once_for_all_designs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Another design takes its tables only, to the same bytes as without a cache; damaged code is compiled again."""
    root, compiled = tmp_path / "cache", []
    make = Compiler.make

    def counted(compiler: Compiler, out: Path, *more: Any) -> None:
        compiled.append(out.name)
        make(compiler, out, *more)

    monkeypatch.setattr(Compiler, "make", counted)

    def built(structure: str, where: Path | None) -> bytes:
        compiled.clear()
        unit = native_unit("MfcActuator", design_of(structure), tmp_path / "MfcActuator.fmu")
        build_native_units([unit], cache=where)
        return unit.out.read_bytes()

    alone = built("kiel", None)
    assert built("kiel", root) == alone
    assert compiled == ["MfcActuator.o", f"MfcActuator{host_platform().suffix}"]
    other = built("five_beams", root)
    assert other != alone
    assert compiled == [f"MfcActuator{host_platform().suffix}"]
    (kept,) = root.glob("code/*.o")
    damage(kept, "one bit")
    assert built("kiel", root) == alone
    assert compiled == ["MfcActuator.o", f"MfcActuator{host_platform().suffix}"]
    assert cache.is_sound(kept, root)


@needs_zig
@pytest.mark.native
def test_units_are_built_where_no_cache_can_be(tmp_path: Path) -> None:
    """Only a run needs one."""
    (tmp_path / "cache").write_bytes(b"a file")
    unit = native_unit("MfcActuator", design_of(), tmp_path / "MfcActuator.fmu")
    build_native_units([unit], cache=tmp_path / "cache")
    assert unit.out.is_file()
    assert (tmp_path / "cache").read_bytes() == b"a file"
