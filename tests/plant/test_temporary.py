"""Temporary folders and whole files: what a killed process leaves is removed by the next one, nothing else is."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from flexbeams.plant.archive import write_whole
from flexbeams.plant.locks import Lock
from flexbeams.plant.temporary import sweep_temporary_folders, temporary_folder
from tests.helpers import python_environment

pytestmark = pytest.mark.skipif(os.name != "posix", reason="processes are killed by SIGKILL")


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def killed(program: str, folder: Path) -> None:
    """Runs a program until it prints a line, and kills it."""
    environment = python_environment(TMPDIR=str(folder))
    process = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, env=environment)
    assert process.stdout is not None
    assert process.stdout.readline()
    process.send_signal(signal.SIGKILL)
    process.communicate()


def test_folders_of_killed_processes_are_removed(temporary: Path) -> None:
    killed(
        "import time; from flexbeams.plant.temporary import temporary_folder\n"
        "with temporary_folder() as folder:\n    print(folder, flush=True); time.sleep(60)",
        temporary,
    )
    [left] = temporary.iterdir()
    (temporary / "flexbeams-mine").mkdir()
    (temporary / "flexbeams-notes.txt.tmp").mkdir()
    (temporary / "flexbeams-link0000.tmp").symlink_to(temporary / "flexbeams-mine", target_is_directory=True)
    with temporary_folder() as used:
        (used / "file").write_text("in use")
        sweep_temporary_folders()
        assert (used / "file").is_file()
    assert not left.exists()
    assert sorted(p.name for p in temporary.iterdir()) == [
        "flexbeams-link0000.tmp",
        "flexbeams-mine",
        "flexbeams-notes.txt.tmp",
    ]


def test_a_lock_has_one_holder(tmp_path: Path) -> None:
    with Lock(tmp_path) as first:
        assert first.held
        with Lock(tmp_path) as second:
            assert not second.held
    with Lock(tmp_path) as third:
        assert third.held


def test_half_written_files_of_killed_processes_are_removed(tmp_path: Path) -> None:
    """The draft of a writer that is alive stays, as does a file of another name."""
    killed(
        "import time, os, flexbeams.plant.archive as a\n"
        "from pathlib import Path\n"
        "def stop(*_):\n    print('written', flush=True); time.sleep(60)\n"
        "Path.replace = stop\n"
        f"a.write_whole(Path({str(tmp_path / 'results.csv')!r}), b'new')",
        tmp_path,
    )
    [draft] = tmp_path.iterdir()
    (tmp_path / ".other.csv.1.tmp").write_text("mine")
    alive = tmp_path / ".results.csv.2.tmp"
    alive.write_text("being written")
    with Lock(alive):
        write_whole(tmp_path / "results.csv", b"newer")
    assert not draft.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == [".other.csv.1.tmp", ".results.csv.2.tmp", "results.csv"]
    assert (tmp_path / "results.csv").read_bytes() == b"newer"
