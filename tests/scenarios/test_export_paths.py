"""The format of an export follows from the file's suffix; contradictions and missing folders are refused."""

from pathlib import Path

import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.api import exports
from flexbeams.scenarios.cli.main import main


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The writers that an export calls, which write nothing."""
    called: list[str] = []

    class Writers:
        def __getattr__(self, name: str) -> object:
            def write(scenario: str, out: Path, *_: object, **__: object) -> Path:
                called.append(name)
                return out

            return write

    monkeypatch.setattr(exports, "import_module", lambda name: Writers())
    return called


@pytest.mark.parametrize(
    ("file", "writer"),
    [
        ("a.ssp", "export_ssp"),
        ("a.SSP", "export_ssp"),
        ("a.fmu", "export_closed_loop"),
        ("folder", "export_osp"),
        ("a.zip", "export_osp"),
        ("there.v2", "export_osp"),
        (None, "export_ssp"),
    ],
)
def test_the_format_follows_from_the_suffix(
    file: str | None, writer: str, written: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.v2").mkdir()
    exports.export("tracking", file)
    assert written == [writer]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["-o", "a.txt"], "--out must end with .ssp or .fmu, or be a folder or FILE.zip, where --format is not given"),
        (["-o", "a.fmu", "--format", "ssp"], "--out must end with .ssp for --format ssp, got 'a.fmu'"),
        (["-o", "a.ssp", "--format", "closed-loop"], "--out must end with .fmu for --format closed-loop"),
        (["-o", "a.zip", "--format", "container"], "--out must end with .fmu for --format container"),
        (["-o", "a.fmu", "--format", "ospsystem"], "--out must be a folder, or FILE.zip, for --format ospsystem"),
        (["-o", "none/a.ssp"], "--out must be in a folder that exists, got 'none/a.ssp'"),
        (["-o", "none/a", "--format", "ospsystem"], "--out must be in a folder that exists"),
        (["-o", "a.ssp/b.ssp"], "--out must be in a folder that exists"),
    ],
)
def test_contradictions_are_refused(
    arguments: list[str],
    message: str,
    written: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.ssp").touch()
    assert main(["export", "tracking", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not written
    with pytest.raises(InputError):
        exports.export("tracking", "none/x.ssp")
