"""How commands end: signals, full disks, closed pipes, errors of the program; what reaches the terminal."""

import errno
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.errors import FlexbeamsError, InputError
from flexbeams.plant.text import printable, quoted
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.processes.interrupt import ignore_interrupts_in_children
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.simulation.recording import Recording
from tests.helpers import command, python_environment

Write = Callable[[str, str], Path]
posix = pytest.mark.skipif(os.name != "posix", reason="signals and devices of POSIX")
LONG = """title = "long"
structure = "single_beam"
stop_time = 2000.0
[instance.plant]
unit = "BeamPlant"
[[input]]
to = "plant.u"
constant = 10.0
"""


def failing(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    """The verb `list` raises an error."""

    def fail() -> None:
        raise error

    monkeypatch.setattr("flexbeams.scenarios.definition.scenario_file.scenario_files", fail)


def wait_for_units(process: "subprocess.Popen[str]") -> None:
    """Until the run has loaded its units, right before the first step."""
    for _ in range(300):
        if process.poll() is not None or "BeamPlant." in Path(f"/proc/{process.pid}/maps").read_text():
            return
        time.sleep(0.05)


@posix
@pytest.mark.native
def test_sigterm_keeps_results_and_removes_temporary_folders(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write
) -> None:
    """As Ctrl-C, with status 143; the folder is free afterwards."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    process = subprocess.Popen(
        [sys.executable, "-m", "flexbeams", "run", write_scenario("long", LONG), "--out", tmp_path / "out"],
        cwd=at_run_folder,
        env=python_environment(TMPDIR=str(temporary)),
        text=True,
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    )
    wait_for_units(process)
    time.sleep(1.0)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 143, errors
    assert "flexbeams: interrupted at" in errors
    assert "Traceback" not in errors
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert summary["complete"] is False
    assert len(read_results(tmp_path / "out/results.csv").time) == summary["timing"]["steps"] + 1
    assert not list(temporary.iterdir())


@posix
@pytest.mark.skipif(sys.platform == "win32", reason="signals are not blocked there")
def test_ctrl_c_while_a_process_starts_is_not_lost(ctrl_c: None) -> None:
    with pytest.raises(KeyboardInterrupt), ignore_interrupts_in_children():
        os.kill(os.getpid(), signal.SIGINT)


def test_sigterm_before_a_run_has_results(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def terminate() -> None:
        os.kill(os.getpid(), signal.SIGTERM)

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("flexbeams.scenarios.definition.scenario_file.scenario_files", terminate)
    assert main(["list"]) == 143
    assert capsys.readouterr().err.strip() == "flexbeams: interrupted"
    assert signal.getsignal(signal.SIGTERM) is before


@posix
def test_a_closed_pipe_is_quiet(at_run_folder: Path) -> None:
    process = command("list", cwd=at_run_folder)
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(timeout=60) == 141
    assert process.stderr is not None
    assert process.stderr.read() == ""
    process.stderr.close()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize("arguments", [["list"], ["design", "--json", "--structure", "single_beam"]])
def test_a_full_disk_under_the_output_is_one_line(arguments: list[str], at_run_folder: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "flexbeams", *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            env=python_environment(),
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == "flexbeams: the output: cannot be read or written: No space left on device\n"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EDQUOT, errno.EMFILE])
def test_conditions_of_the_system_are_one_line_with_the_file(
    number: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failing(OSError(number, os.strerror(number), "/data/results.csv"), monkeypatch)
    assert main(["list"]) == 2
    expected = f"flexbeams: /data/results.csv: cannot be read or written: {os.strerror(number)}\n"
    assert capsys.readouterr().err == expected


def test_memory_that_is_not_there_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failing(MemoryError(), monkeypatch)
    assert main(["list"]) == 2
    assert capsys.readouterr().err == "flexbeams: there is not enough memory\n"


@pytest.mark.parametrize("kind", [RuntimeError, RecursionError, ValueError, OSError, KeyError, AssertionError])
def test_an_error_of_the_program_has_a_status_of_its_own_and_a_log(
    kind: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("FLEXBEAMS_CACHE", str(tmp_path / "cache"))
    failing(kind("a bug\n\x1b]0;title\x07" + 200 * "x"), monkeypatch)
    assert main(["list"]) == 70
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith(f"flexbeams: unexpected {kind.__name__}: ")
    assert "\x1b" not in line
    [log] = (tmp_path / "cache/errors").glob("*.log")
    assert f"(see {log}; please report it)" in line
    assert "a bug" in log.read_text()
    assert "Traceback" in log.read_text()
    monkeypatch.setenv("FLEXBEAMS_DEBUG", "1")
    monkeypatch.setenv("FLEXBEAMS_CACHE", "/proc/none")
    assert main(["list"]) == 70
    shown = capsys.readouterr().err
    assert shown.startswith("Traceback")
    assert "FLEXBEAMS_DEBUG=1 shows where" in shown


@posix
@pytest.mark.native
def test_a_name_that_is_not_utf8(
    at_run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Of a scenario, with report and figures; and of one that is not there."""
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/n\xe4me.toml"))
    path.write_text(LONG.replace("2000.0", "0.01") + '[[figure]]\nfile = "f"\nrows = [["plant.y_pi"]]\n')
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out/summary.json").read_text())["scenario"] == "n\ufffdme"
    assert "n\ufffdme" in (tmp_path / "out/report.html").read_text(encoding="utf-8")
    capsys.readouterr()
    assert main(["run", os.fsdecode(b"n\xe4ne.toml")]) == 2
    assert "n\\udce4ne.toml" in capsys.readouterr().err


def test_text_that_controls_the_terminal_is_shown_as_escapes() -> None:
    assert printable("plain µ ± Größe") == "plain µ ± Größe"
    assert printable("a\x1b[31m\x07\x9b\u202e\u2066\u200b\u2028\udce4\n") == (
        "a\\x1b[31m\\x07\\x9b\\u202e\\u2066\\u200b\\u2028\\udce4\\n"
    )
    assert str(FlexbeamsError("a\x1b]8;;x\x07b")) == "a\\x1b]8;;x\\x07b"
    assert str(InputError("k\u202e", "rule\x1b", source="s\x9b")) == "s\\x9b: k\\u202e rule\\x1b"


def test_messages_quote_little_of_a_file() -> None:
    assert len(quoted("x" * 1000)) == 80
    message = str(InputError("k" * 1000, "must be short", "secret " * 1000, source="file.toml"))
    assert len(message) < 200


@pytest.mark.parametrize(
    "text",
    [
        'title = "\x1b[31m"',
        'title = "\\u001b]0;owned\\u0007"\nstructure = "\\u202ekiel"\nstop_time = 1\n[instance.p]\nunit = "BeamPlant"',
        '"\\u001b[2J" = 1',
        "secret " * 100,
    ],
)
def test_files_do_not_control_the_terminal(
    text: str, write_scenario: Write, at_run_folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(write_scenario("bad", text))]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.isprintable()
    assert line.count("secret") < 12


@pytest.mark.native
def test_a_title_does_not_control_the_terminal(
    write_scenario: Write, at_run_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    title = 'title = "\\u001b]0;owned\\u0007 \\u202e [red]$x_{$ ^"'
    text = LONG.replace('title = "long"', title).replace("2000.0", "0.01")
    text += '[[figure]]\nfile = "f"\ntitle = "$\\\\frac{ \\u0007"\nrows = [["plant.y_pi", "plant.u"]]\n'
    assert main(["run", str(write_scenario("odd", text)), "--out", str(tmp_path / "out")]) == 0
    shown = capsys.readouterr().out
    assert "\\x1b]0;owned\\x07 \\u202e [red]$x_{$ ^" in shown
    assert "\x1b]0" not in shown
    assert "\u202e" not in shown
    assert (tmp_path / "out/f.png").stat().st_size > 1000


@pytest.mark.parametrize(
    "content",
    [
        b"secret;secret\nsecret;1\n",
        b"\x00\x01\xff\xfe" * 50,
        b"",
        b"time,a\n1\n",
        b"time,a\n0,secret\n",
        b"%PDF-1.7 secret",
    ],
)
def test_a_file_that_is_not_a_csv_is_not_quoted(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "results.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match="is not a CSV file of numbers") as raised:
        read_results(path)
    assert "secret" not in str(raised.value)


def test_columns_without_a_dot_are_compared(tmp_path: Path) -> None:
    from flexbeams.scenarios.results.curves import curve

    recording = Recording(time=np.arange(2.0), columns=["y[1]", "y[2]", "z"], values=np.eye(2, 3), wall_seconds=0.0)
    assert curve("y", recording).base == "y"
    assert curve("z", recording).columns == [2]
