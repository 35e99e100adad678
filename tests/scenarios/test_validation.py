"""What `flexbeams validate` names in third-party FMUs and packages, and what it leaves alone."""

import os
import signal
import sys
import time
import zipfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest

from flexbeams.fmus.packaging.compilers import host_platform
from flexbeams.fmus.references.results import FOLDER
from flexbeams.scenarios.cli.main import main
from tests.helpers import command
from tests.scenarios.test_foreign_packages import Shop
from tests.scenarios.test_foreign_units import GAIN, RULES
from tests.units.foreign.unit import ForeignUnit

pytestmark = pytest.mark.native


def unit(**changes: str) -> ForeignUnit:
    """The unit with attributes of its first variable, gain."""
    return ForeignUnit(variables=[replace(GAIN[0], **changes), *GAIN[1:]], rules=RULES)  # type: ignore[arg-type]


def lines(path: Path, status: int, capsys: pytest.CaptureFixture[str], *options: str) -> list[str]:
    assert main(["validate", str(path), *options]) == status
    return [line.removeprefix(f"{path}: ") for line in capsys.readouterr().out.splitlines()]


PROBLEMS = {
    "bounds": (unit(attributes='min="5" max="1"'), "gain has min 5 above max 1"),
    "start": (unit(attributes='min="3"'), "gain has the start value 2, which is not from 3 to inf"),
    "nominal": (unit(attributes='nominal="0"'), "gain has the nominal value 0"),
}


@pytest.mark.parametrize("case", PROBLEMS)
def test_values_that_break_a_rule_are_named(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fmu, complaint = PROBLEMS[case]
    assert lines(fmu.write(tmp_path / "unit.fmu"), 1, capsys) == [complaint]


@pytest.mark.parametrize("attributes", ['min="2"', 'max="2"', 'min="2" max="2"', 'nominal="-1"'])
def test_values_at_their_bounds_are_valid(attributes: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert lines(unit(attributes=attributes).write(tmp_path / "unit.fmu"), 0, capsys) == ["valid"]


def changed(path: Path, old: str, new: str, **entries: bytes | None) -> Path:
    """The FMU with a text of its description replaced, and other entries."""
    with zipfile.ZipFile(path) as archive:
        contents: dict[str, bytes | None] = {n: archive.read(n) for n in archive.namelist()}
    text = (contents["modelDescription.xml"] or b"").decode()
    assert old in text
    contents["modelDescription.xml"] = text.replace(old, new).encode()
    contents |= entries
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in contents.items():
            if content is not None:
                archive.writestr(name, content)
    return path


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('fmiVersion="2.0"', 'fmiVersion="1.0"', "is of FMI 1.0; only FMI 2.0 is supported"),
        ('fmiVersion="2.0"', 'fmiVersion="3.0"', "is of FMI 3.0; only FMI 2.0 is supported"),
        ("<fmiModelDescription", "<!DOCTYPE a><fmiModelDescription", "must have no document type declaration"),
        ('modelIdentifier="foreign"', 'modelIdentifier="../foreign"', "modelIdentifier must be a C identifier"),
    ],
)
def test_descriptions_that_are_refused(
    old: str, new: str, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    [line] = lines(changed(unit().write(tmp_path / "unit.fmu"), old, new), 1, capsys)
    assert complaint in line


def test_binaries_for_other_machines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    platform = host_platform()
    place = f"binaries/{platform.name}/foreign{platform.suffix}"
    path = changed(unit().write(tmp_path / "unit.fmu"), "foreign", "foreign", **{place: None, "binaries/win64/a": b"x"})
    valid, note = lines(path, 0, capsys)
    assert valid == "valid"
    assert note.startswith("note: has no binary for this machine")
    assert note.endswith("only for win64")
    if platform.suffix == ".so":
        other = bytearray(64)
        other[:4], other[18] = b"\x7fELF", 0xF3
        path = changed(unit().write(tmp_path / "unit.fmu"), "foreign", "foreign", **{place: bytes(other)})
        [line] = lines(path, 1, capsys)
        assert line.startswith(f"{place} is for riscv, not for ")


def test_a_table_of_zeros_is_legal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = unit().write(tmp_path / "unit.fmu", resources__table=bytes(16_000_000))
    assert lines(path, 0, capsys) == ["valid"]
    [line] = lines(path, 1, capsys, "--max-size", "0.01")
    assert line.startswith("must be at most 10000000 bytes when extracted (--max-size raises the limit)")


def test_times_that_a_run_refuses_are_named(
    tmp_path: Path, run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shop = Shop(tmp_path, run_folder / "build/fmus")
    assert lines(shop.package({"g": (unit(), "")}), 0, capsys) == ["valid"]
    [line] = lines(shop.package({"g": (unit(), "")}, stop="0.0153"), 1, capsys)
    assert "stop_time must be a whole number of steps of 0.01 s" in line


REFERENCES = {
    f"extra__{FOLDER.removeprefix('extra/')}__fmi-ls-manifest.xml": b"<fmiReferences>"
    b'<Related type="text/csv" source="y.csv" role="result"/></fmiReferences>',
    f"extra__{FOLDER.removeprefix('extra/')}__y.csv": b"time,seen\n0,0\n0.01,0.01\n0.02,0.02\n",
}


def referenced(path: Path, *rules: str) -> Path:
    """A clock with reference results."""
    seen = [v for v in GAIN if v.name == "seen"]
    clock = ForeignUnit(variables=seen, rules=["clock 5", *rules])
    return clock.write(path, **REFERENCES)


@pytest.mark.parametrize(
    ("rule", "complaint"),
    [
        ("crash step", "the code of a unit crashed (SIGABRT)"),
        ("exit instantiate", "the code of a unit ended its process with the exit status 0"),
        ("hang step", "the code of a unit did not return within 3 s"),
    ],
)
@pytest.mark.skipif(sys.platform == "win32", reason="no signals")
def test_code_that_ends_or_hangs_is_one_line_and_other_files_are_checked(
    rule: str, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad, good = referenced(tmp_path / "bad.fmu", rule), referenced(tmp_path / "good.fmu")
    patience = ["--patience", "3"] if "hang" in rule else []
    assert main(["validate", str(bad), str(good), *patience]) == 2
    shown = capsys.readouterr()
    assert shown.err.splitlines() == [f"flexbeams: {bad}: {complaint}"]
    assert shown.out.splitlines() == [f"{good}: valid", f"{good}: reference y.csv: agrees exactly"]
    assert main(["validate", str(bad), "--no-run"]) == 0


def test_a_truncated_library_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It may not load, or end its process with SIGBUS."""
    path = referenced(tmp_path / "unit.fmu")
    platform = host_platform()
    place = f"binaries/{platform.name}/foreign{platform.suffix}"
    with zipfile.ZipFile(path) as archive:
        library = archive.read(place)
    for share in (0.1, 0.5):
        changed(path, "foreign", "foreign", **{place: library[: int(share * len(library))]})
        assert main(["validate", str(path)]) in (1, 2)
        shown = capsys.readouterr()
        [line] = [k for k in (shown.err + shown.out).splitlines() if not k.endswith(": valid")]
        assert "crashed" in line or "is not checked" in line
    changed(path, "foreign", "foreign", **{place: library})
    assert main(["validate", str(path)]) == 0


def test_results_that_are_no_numbers_disagree(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = referenced(tmp_path / "unit.fmu", "map R 5 6 nan")
    line = lines(path, 1, capsys)[-1]
    assert line == "reference y.csv: seen at 0 s must be 0.0 to 1e-06, got nan"


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_ctrl_c_ends_a_validation_that_hangs(ctrl_c: None, tmp_path: Path) -> None:
    bad = referenced(tmp_path / "bad.fmu", "hang step")
    process = command("validate", bad, cwd=tmp_path, start_new_session=True)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    deadline = time.monotonic() + 60.0
    while not (workers := [pid for pid in children.read_text().split() if "spawn_main" in command_line(pid)]):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(1.5)  # until the unit hangs
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors.strip()) == (130, "flexbeams: interrupted")
    while any(map(command_line, workers)):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def command_line(pid: str) -> str:
    """Empty for a process that has ended."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_text()
    return ""
