"""Archives of others: what could do harm is refused in one line, and nothing is written but inside one folder."""

import io
import stat
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.importing.archives import CHUNK, ExtractionBudget
from flexbeams.scenarios.importing.xml_reading import read_document

Pack = Callable[..., Path]


def entry(name: str, mode: int = stat.S_IFREG | 0o644) -> zipfile.ZipInfo:
    info = zipfile.ZipInfo(name)
    info.create_system = 3
    info.external_attr = mode << 16
    return info


@pytest.fixture
def pack(tmp_path: Path) -> Pack:
    """Writes an archive of (name or ZipInfo, content) pairs and returns it, in a folder with nothing else."""

    def write(*entries: tuple[str | zipfile.ZipInfo, bytes], name: str = "bad.ssp", method: int = 8) -> Path:
        folder = tmp_path / "work"
        folder.mkdir(exist_ok=True)
        with zipfile.ZipFile(folder / name, "w", method) as archive:
            for where, content in entries:
                if isinstance(where, zipfile.ZipInfo):
                    where.compress_type = method
                archive.writestr(where, content)
        return folder / name

    return write


def tree(folder: Path) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))


HOSTILE = {
    "parent": ([("../evil.txt", b"x")], r"must hold entries with paths inside it, with / between folders, got '\.\./"),
    "deep_parent": ([("a/../../evil.txt", b"x")], "must hold entries with paths inside it"),
    "parent_at_end": ([("a/..", b"x")], "must hold entries with paths inside it"),
    "absolute": ([("/tmp/evil.txt", b"x")], "must hold entries with paths inside it"),
    "drive": ([("C:/evil.txt", b"x")], "must hold entries with paths inside it"),
    "drive_relative": ([("c:evil.txt", b"x")], "must hold entries with paths inside it"),
    "backslash": ([("..\\evil.txt", b"x")], "must hold entries with paths inside it"),
    "share": ([("\\\\host\\share\\evil.txt", b"x")], "must hold entries with paths inside it"),
    "current_folder": ([("./", b"")], "must hold entries with paths inside it"),
    "symlink": ([(entry("link", stat.S_IFLNK | 0o777), b"/etc/passwd")], "must hold files and folders only, no links"),
    "through_symlink": ([(entry("d", stat.S_IFLNK | 0o777), b"/tmp"), (entry("d/evil.txt"), b"x")], "no links"),
    "device": ([(entry("null", stat.S_IFCHR | 0o666), b"")], "must hold files and folders only"),
    "file_as_folder": ([("a", b"x"), ("a/b", b"y")], "must not hold a file and a folder of one name, got 'a/b'"),
    "many": ([(f"f{k}", b"") for k in range(20_001)], "must hold at most 20000 entries, got 20001"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_a_hostile_package_is_refused_in_one_line_and_writes_nothing(
    case: str, pack: Pack, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    entries, message = HOSTILE[case]
    path = pack(*entries)
    temporary = path.parent.parent / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    monkeypatch.chdir(path.parent)
    with pytest.raises(InputError, match=message):
        ExtractionBudget().check(path)
    assert main(["run", path.name]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert errors.startswith("flexbeams: bad.ssp: ")
    assert main(["validate", path.name]) == 1
    assert tree(path.parent) == ["bad.ssp"]
    assert tree(temporary) == []


@pytest.mark.parametrize("content", [b"", b"not an archive", b"PK\x03\x04 cut off"])
def test_what_is_no_archive_is_refused(content: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bad.ssp"
    path.write_bytes(content)
    assert main(["run", str(path)]) == 2
    assert capsys.readouterr().err == f"flexbeams: {path}: is not a readable archive: File is not a zip file\n"


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_an_entry_that_comes_twice_is_refused(pack: Pack) -> None:
    with pytest.raises(InputError, match=r"must hold each entry once, got 'a\.txt'"):
        ExtractionBudget().check(pack(("a.txt", b"1"), ("a.txt", b"2")))


def test_encrypted_and_unknown_entries_are_refused(pack: Pack) -> None:
    path = pack(("a.txt", b"1"), method=0)
    content = bytearray(path.read_bytes())
    central = content.index(b"PK\x01\x02")
    for offset, value, message in ((8, 1, "must not be encrypted"), (10, 97, "must be compressed by a known method")):
        changed = bytearray(content)
        changed[central + offset] = value
        path.write_bytes(changed)
        with pytest.raises(InputError, match=message):
            ExtractionBudget().check(path)


def test_sizes_that_an_archive_makes_up_do_not_get_through(pack: Pack, tmp_path: Path) -> None:
    path = pack(("a.txt", bytes(range(256)) * 8))
    content = bytearray(path.read_bytes())
    central = content.index(b"PK\x01\x02")
    for size in (100, 5000):  # less, and more, than there is
        changed = bytearray(content)
        changed[central + 24 : central + 28] = size.to_bytes(4, "little")
        path.write_bytes(changed)
        folder = tmp_path / f"out{size}"
        with pytest.raises(InputError, match="cannot be extracted"):
            ExtractionBudget().extract(path, folder)
        written = folder / "a.txt"
        assert not written.exists() or written.stat().st_size <= 2048


def test_a_damaged_entry_is_refused(pack: Pack, tmp_path: Path) -> None:
    path = pack(("a.txt", b"0123456789" * 20), method=0)
    content = path.read_bytes()
    path.write_bytes(content.replace(b"0123456789", b"0123456780", 1))
    with pytest.raises(InputError, match=r"cannot be extracted: Bad CRC-32 for file 'a\.txt'"):
        ExtractionBudget().extract(path, tmp_path / "out")


def test_archives_inside_one_another_share_an_allowance(pack: Pack, tmp_path: Path) -> None:
    inner = pack(("data", bytes(range(256)) * 400), name="inner.fmu", method=0)
    outer = pack(("inner.fmu", inner.read_bytes()), name="outer.ssp", method=0)
    budget = ExtractionBudget(size=150_000)
    budget.extract(outer, tmp_path / "outer")
    with pytest.raises(InputError, match=r"must be at most \d+ bytes when extracted .*, got 102400"):
        budget.extract(inner, tmp_path / "inner")
    assert not (tmp_path / "inner").exists()
    budget = ExtractionBudget(entries=1)
    budget.extract(outer, tmp_path / "again")
    with pytest.raises(InputError, match="must hold at most 0 entries, got 1"):
        budget.extract(inner, tmp_path / "inner")


def test_a_sound_archive_is_extracted_as_it_is(pack: Pack, tmp_path: Path) -> None:
    contents = {
        "modelDescription.xml": b"<a/>",
        "binaries/linux64/x.so": bytes(range(256)),
        "empty.txt": b"",
        "zeros": bytes(CHUNK),
    }
    path = pack((entry("binaries/", stat.S_IFDIR | 0o755), b""), *contents.items())
    folder = ExtractionBudget().extract(path, tmp_path / "out")
    assert {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()} == contents


def test_fmus_of_a_scenario_go_the_same_way(
    pack: Pack, write_scenario: Callable[[str, str], Path], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    description = b'<fmiModelDescription fmiVersion="2.0"><CoSimulation/></fmiModelDescription>'
    path = pack(("modelDescription.xml", description), ("../evil.txt", b"x"), name="bad.fmu")
    scenario = write_scenario(
        "theirs", f'title = "x"\nstructure = "kiel"\nstop_time = 0.1\n[instance.theirs]\nfmu = "{path}"\n'
    )
    assert main(["run", str(scenario), "--out", str(tmp_path / "out")]) == 2
    assert "instance.theirs.fmu must be an FMU (must hold entries with paths inside it" in capsys.readouterr().err
    assert not list(tmp_path.rglob("evil.txt"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b'<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "must have no document type declaration"),
        (b'<!DOCTYPE a SYSTEM "file:///etc/passwd"><a/>', "must have no document type declaration"),
        (b"<a><b></a>", "is not well-formed XML"),
        (b"", "is not well-formed XML"),
    ],
)
def test_documents_with_entities_are_refused(content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_document(content, "SystemStructure.ssd")


def test_entities_do_not_grow(pack: Pack, capsys: pytest.CaptureFixture[str]) -> None:
    laughs = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 10))
    document = f'<!DOCTYPE a [<!ENTITY l0 "ha">{laughs}]><a>&l9;</a>'.encode()
    path = pack(("SystemStructure.ssd", document))
    assert main(["run", str(path)]) == 2
    errors = capsys.readouterr().err
    assert errors.count("\n") == 1
    assert "SystemStructure.ssd: " in errors


def test_a_name_with_a_nul_byte_is_refused(tmp_path: Path) -> None:
    # zipfile keeps a name up to its NUL byte only, the full one counts
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("good.txt_evil", b"x")
    path = tmp_path / "nul.zip"
    path.write_bytes(buffer.getvalue().replace(b"good.txt_evil", b"good.txt\0evil"))
    with pytest.raises(InputError, match="must hold entries with paths inside it"):
        ExtractionBudget().check(path)


def test_a_large_archive_needs_an_option(pack: Pack, monkeypatch: pytest.MonkeyPatch) -> None:
    """However well it is compressed: a table of zeros is legal."""
    path = pack(("zeros", bytes(16 * CHUNK)))
    assert len(ExtractionBudget().check(path)) == 1
    monkeypatch.setenv("FLEXBEAMS_MAX_SIZE", "0.016")
    with pytest.raises(InputError, match=r"at most 16000000 bytes when extracted \(--max-size raises the limit\)"):
        ExtractionBudget().check(path)
