"""Several scenarios in processes side by side: the same results as alone, one verdict, and an end by Ctrl-C."""

import json
import multiprocessing
import os
import queue
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.runs.job import FAILED, INTERRUPTED, OK, Job, run_job
from flexbeams.scenarios.runs.observer import SILENT, Observer
from flexbeams.scenarios.runs.parallel import _Monitor, prepare_all, run_parallel
from flexbeams.scenarios.runs.progress import Display
from tests.helpers import python_environment

pytestmark = pytest.mark.native

Write = Callable[[str, str], Path]

SCRIPT = """from os import getpid
from flexbeams.scenarios.processes.pools import ProcessPool
with ProcessPool(1) as pool:
    print(pool.submit(getpid).result() != getpid())
"""
PLANT = """title = "voltage on one beam"
structure = "single_beam"
stop_time = {stop}
[instance.plant]
unit = "BeamPlant"
[[input]]
to = "plant.u"
constant = {voltage}
[[check]]
name = "voltage"
measure = "largest"
of = "plant.u"
unit = "V"
max = 100.0
"""

# Hours of simulated time, which no computer has done when the test ends the run
LONG = PLANT.format(stop=2e4, voltage=1.0)
EVERY = 1000  # steps to a row of these


def job(path: Path, out: Path, **settings: object) -> Job:
    folder = out / path.stem
    folder.mkdir(parents=True, exist_ok=True)
    return Job(
        experiment=load_scenario(path),
        folder=folder,
        settings=Settings(record_animation=False, **{"decimate": EVERY, **settings}),  # type: ignore[arg-type]
        figures=False,
        report=False,
    )


def run(*arguments: object) -> int:
    return main(["run", *map(str, arguments), "--no-figures", "--no-report"])


def test_results_side_by_side_are_those_of_single_runs(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [
        write_scenario(name, PLANT.format(stop=0.1, voltage=voltage))
        for name, voltage in (("low", 50.0), ("high", 150.0), ("middle", 100.0))
    ]
    assert run(*paths, "--out", "several", "--jobs", 2) == 1
    shown = capsys.readouterr()
    rows = [line.split("│")[1:-1] for line in shown.out.splitlines() if "several" in line and "│" in line]
    assert [[cell.strip() for cell in r[:4]] for r in rows] == [
        ["low", "ok", "1", "0"],
        ["high", "FAILED", "0", "1"],
        ["middle", "ok", "1", "0"],
    ]
    assert "high: 1 of 1 checks failed" in shown.err
    for path in paths:
        run(path, "--out", tmp_path / "alone")
        several = (at_run_folder / "several" / path.stem / "results.csv").read_bytes()
        assert several == (tmp_path / "alone/results.csv").read_bytes()


def test_a_job_that_fails_leaves_the_others_alone(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    good = write_scenario("good", PLANT.format(stop=0.1, voltage=1.0))
    lost = write_scenario("lost", PLANT.format(stop=0.1, voltage=1.0).replace('plant.u"\nc', 'plant.v"\nc'))
    assert run(lost, good, "--out", tmp_path) == 2
    errors = capsys.readouterr().err
    assert "lost.toml: input[1].to must name an input of plant, which has no 'v'" in errors
    assert "good: one check holds" in errors
    assert json.loads((tmp_path / "good/summary.json").read_text())["complete"] is True


def test_bad_input_is_refused_before_anything_runs(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write, capsys: pytest.CaptureFixture[str]
) -> None:
    good = write_scenario("good", PLANT.format(stop=0.1, voltage=1.0))
    bad = write_scenario("bad", PLANT.format(stop=-1.0, voltage=1.0))
    assert run(good, bad, "--out", tmp_path / "out") == 2
    assert capsys.readouterr().err == f"flexbeams: {bad}: stop_time must be finite and > 0, got -1.0\n"
    (tmp_path / "copy").mkdir()
    twin = tmp_path / "copy" / "good.toml"
    twin.write_text(good.read_text())
    assert run(good, twin, "--out", tmp_path / "out") == 2
    assert "SCENARIO must be given once, since its name is that of its results, got 'good'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_equal_designs_are_computed_once(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    paths = [write_scenario(f"same{k}", PLANT.format(stop=0.1, voltage=1.0)) for k in range(3)]
    display = Noting([path.stem for path in paths])
    assert len(prepare_all([job(path, tmp_path, build_folder=tmp_path / "units") for path in paths], display)) == 1
    assert display.notes == ["same0: building BeamPlant"]


class Noting(Display):
    """Keeps the notes."""

    def __init__(self, names: list[str]) -> None:
        super().__init__(names)
        self.notes: list[str] = []

    def note(self, text: str, name: str = "") -> None:
        self.notes.append(f"{name}: {text}")


class Impatient(Display):
    """Presses Ctrl-C where a worker first tells of its progress, as often as asked."""

    presses = 1

    def progress(self, name: str, done: int, steps: int) -> None:
        if self.presses:
            self.presses -= 1
            signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_ends_all_and_marks_what_was_recorded(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write
) -> None:
    jobs = [job(write_scenario(f"long{k}", LONG), tmp_path) for k in range(5)]
    finished = run_parallel(jobs, 2, Impatient([j.name for j in jobs]))
    assert [f.status for f in finished] == [INTERRUPTED] * 5
    written = [f for f in finished if f.folder is not None]
    assert 1 <= len(written) <= 3  # two at work, one perhaps handed over already
    for f in written:
        assert f.folder is not None
        summary = json.loads((f.folder / "summary.json").read_text())
        recording = read_results(f.folder / "results.csv")
        assert summary["complete"] is False
        assert summary["timing"]["steps"] == round(recording.time[-1] / 2e-4) > 0
        # Its rows are those of a run that ends there
        text = PLANT.format(stop=float(recording.time[-1]), voltage=1.0)
        whole = job(write_scenario(f.name, text), tmp_path / "whole")
        run_job(whole, SILENT)
        assert (f.folder / "results.csv").read_bytes() == (whole.folder / "results.csv").read_bytes()
    assert finished[-1].message == "not run"


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_twice_ends_the_processes(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    before = set(multiprocessing.active_children())  # those that other tests keep
    jobs = [job(write_scenario(f"long{k}", LONG), tmp_path) for k in range(2)]
    display = Impatient([j.name for j in jobs])
    display.presses = 2
    assert [f.status for f in run_parallel(jobs, 2, display)] == [INTERRUPTED] * 2
    assert set(multiprocessing.active_children()) <= before


def test_a_lost_process_is_reported(at_run_folder: Path, tmp_path: Path, write_scenario: Write) -> None:
    class Rough(Display):
        def progress(self, name: str, done: int, steps: int) -> None:
            for process in multiprocessing.active_children():
                process.kill()

    jobs = [job(write_scenario(f"long{k}", LONG), tmp_path) for k in range(2)]
    finished = run_parallel(jobs, 1, Rough([j.name for j in jobs]))
    assert [f.status for f in finished] == [FAILED] * 2
    assert finished[0].message == "its process, or a parallel one, was killed"


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.skipif(os.name == "nt", reason="process groups as a terminal has them")
@pytest.mark.parametrize("count", [1, 2])
def test_ctrl_c_at_a_terminal(at_run_folder: Path, tmp_path: Path, write_scenario: Write, count: int) -> None:
    """The signal reaches every process of the group; the command ends with 130 and valid results."""
    paths = [write_scenario(f"long{k}", LONG) for k in range(count)]
    jobs = [job(path, tmp_path) for path in paths]
    prepare_all(jobs, Noting([]))
    code = (
        "import sys; from flexbeams.scenarios.cli.main import main\n"
        "def note(*arguments): print('stepping', file=sys.stderr, flush=True)\n"
        "import flexbeams.scenarios.runs.progress as p; p.Display.progress = note\n"
        "if __name__ == '__main__': sys.exit(main())"
    )
    script = tmp_path / "starter.py"
    script.write_text(code)
    command = [
        sys.executable,
        str(script),
        "run",
        *map(str, paths),
        "--out",
        str(tmp_path),
        "--no-figures",
        "--no-report",
        "--decimate",
        str(EVERY),
    ]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=python_environment(),
    )
    assert process.stderr is not None
    lines = []
    for line in process.stderr:
        lines.append(line)
        if "stepping" in line:
            break
    time.sleep(0.2)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130, "".join(lines) + errors
    assert "Traceback" not in errors
    assert "interrupted at " in errors
    folder = tmp_path if count == 1 else tmp_path / "long0"
    assert json.loads((folder / "summary.json").read_text())["complete"] is False
    recording = read_results(folder / "results.csv")
    np.testing.assert_allclose(np.diff(recording.time)[:-1], EVERY * 2e-4)
    assert np.isfinite(recording.values).all()


def test_a_single_scenario_runs_in_this_process(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(multiprocessing, "get_context", lambda *_: pytest.fail("a process was started"))
    path = write_scenario("alone", PLANT.format(stop=0.1, voltage=1.0))
    assert run(path, "--out", tmp_path, "--jobs", 3) == OK


def test_a_worker_that_writes_is_not_taken_for_one_that_hangs(
    at_run_folder: Path, tmp_path: Path, write_scenario: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It says so once its units are freed, however the run ended; the last step alone says nothing."""
    said: list[str] = []
    monkeypatch.setattr("flexbeams.scenarios.runs.job.write_files", lambda *_, **__: said.append("written"))
    observer = Observer(progress=lambda done, steps: said.append(f"{done}"), writing=lambda: said.append("writing"))
    one = job(write_scenario("one", PLANT.format(stop=0.01, voltage=1.0)), tmp_path)
    run_job(one, observer)
    assert said[-3:] == ["50", "writing", "written"]

    messages: queue.Queue[Any] = queue.Queue()
    monitor = _Monitor([one], [Future()], messages, Display(["one"]), [])  # type: ignore[arg-type]
    for kind, content, least, most in (
        ("begin", None, 0.0, 1.0),
        ("progress", (50, 50), 0.0, 1.0),
        ("writing", None, -601.0, -599.0),
    ):
        messages.put((0, kind, content))
        monitor.poll()
        assert least <= monitor.silence() <= most, kind


def test_a_script_starts_processes_without_being_imported_by_them(tmp_path: Path) -> None:
    """No `if __name__ == "__main__"` is needed around fb.study."""
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "script.py"],
        cwd=tmp_path,
        env=python_environment(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.stdout, done.stderr) == ("True\n", "")
