"""Studies: inputs by their distributions, results that are those of single runs, resumption, refusals."""

import json
import multiprocessing
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import flexbeams as fb
from flexbeams.plant.errors import FlexbeamsError, InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.definition.study_file import load_study
from flexbeams.scenarios.processes.cluster import cluster_workers
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.studies.dataset import Results
from flexbeams.scenarios.studies.planning import StudyPlan, plan_study
from flexbeams.scenarios.studies.study import Study, Workers, cluster, local_workers
from tests.helpers import PUSHED_SCENARIO, command, python_environment

pytestmark = pytest.mark.native
pytest.importorskip("pyarrow")

STUDY = """title = "pushed"
scenario = "pushed.toml"
runs = 12
seed = 3
[[parameter]]
name = "plant.beam[].tip_mass"
range = [0.9, 1.1]
relative = true
[[parameter]]
name = "plant.patch[].piezo_ratio"
distribution = "truncnorm"
arguments = { a = -2.0, b = 2.0, loc = 24.0, scale = 0.5 }
[[parameter]]
name = "controller.integral_gain"
values = [0.0, 1e-5]
[[measure]]
name = "error"
measure = "largest"
of = "plant.y_pi"
reference = "target"
unit = "m"
max = 1e-3
[[measure]]
name = "voltage"
measure = "largest"
of = "controller.u"
unit = "V"
"""
GAIN = 'name = "controller.integral_gain"\nvalues = [0.0, 1e-5]'


@pytest.fixture
def study_file(tmp_path: Path) -> Callable[..., Path]:
    """A function that writes a study of a run of 0.06 s, with replacements in its text."""

    def write(*replacements: tuple[str, str], stop: float = 0.06) -> Path:
        text = STUDY
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "pushed.toml").write_text(PUSHED_SCENARIO.format(stop=stop), encoding="utf-8")
        path = tmp_path / "mine.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


class Here:
    """An executor in this process, which does its calls from the last to the first where it is told to."""

    def __init__(self, backwards: bool = False) -> None:
        self.backwards, self.calls = backwards, 0

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        self.calls += 1
        future: Future[Any] = Future()
        future.set_result(function(*arguments))
        return future


def here(executor: Here | None = None) -> Workers:
    return Workers(count=2, open=lambda: nullcontext(executor or Here()))


def planned(path: Path, **samples: Any) -> StudyPlan:
    return plan_study(load_study(path), Settings(), **samples)


def finished(plan: StudyPlan, folder: Path, workers: Workers | None = None) -> Results:
    study = Study(plan=plan, folder=folder)
    assert study.run(workers or here())
    return study.results()


def test_inputs_have_their_distributions(study_file: Callable[..., Path]) -> None:
    plan = planned(study_file(), runs=400)
    mass, ratio, gain = plan.samples.values.T
    nominal = plan.axes[0].nominal
    assert stats.kstest(mass / nominal, stats.uniform(0.9, 0.2).cdf).statistic < 1 / 400 + 1e-12
    assert stats.kstest(ratio, stats.truncnorm(-2, 2, 24, 0.5).cdf).statistic < 1 / 400 + 1e-12
    assert np.unique(gain, return_counts=True)[1].tolist() == [200, 200]
    assert [axis.name for axis in plan.axes] == [
        "plant.beam[1].tip_mass",
        "plant.patch[1].piezo_ratio",
        "controller.integral_gain",
    ]
    assert plan.axes[1].unit == "C/m2"


def test_a_run_of_a_study_is_that_of_the_scenario(study_file: Callable[..., Path], tmp_path: Path) -> None:
    plan = planned(study_file(), runs=3)
    results = finished(plan, tmp_path / "out")
    for k in range(3):
        starts = dict(zip((axis.name for axis in plan.axes), plan.samples.values[k].tolist(), strict=True))
        run = run_scenario(plan.file.scenario, Settings(record_animation=False, overrides=starts))
        columns = run.recording.columns
        error = run.recording.values[:, [columns.index("plant.y_pi[1]")]] - 1e-3
        assert results.measures[k, 0] == np.max(np.abs(error))
        assert results.measures[k, 1] == run.summary["metrics"]["controller.u[1].largest"]


def test_results_do_not_depend_on_workers_and_order(study_file: Callable[..., Path], tmp_path: Path) -> None:
    plan = planned(study_file())
    alone = finished(plan, tmp_path / "alone")
    two = finished(plan, tmp_path / "two", local_workers(2))
    assert np.array_equal(alone.measures, two.measures)
    study = Study(plan=plan, folder=tmp_path / "parts")
    for k in (3, 1, 2):
        assert study.run(here(), part=(k, 3))
    assert np.array_equal(alone.measures, study.results().measures)


def test_only_missing_runs_are_done(study_file: Callable[..., Path], tmp_path: Path) -> None:
    """A Sobol sequence goes on where a shorter one ended."""
    path = study_file()
    first, longer = (planned(path, runs=n, method="sobol") for n in (4, 8))
    finished(first, tmp_path / "out")
    sent: list[int] = []

    class Counting(Here):
        def submit(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
            future = super().submit(function, *arguments)
            sent.extend(future.result().numbers.tolist())
            return future

    resumed = finished(longer, tmp_path / "out", here(Counting()))
    assert sorted(sent) == [4, 5, 6, 7]
    assert np.array_equal(resumed.measures, finished(longer, tmp_path / "anew").measures)


def test_each_controller_has_its_design(study_file: Callable[..., Path], tmp_path: Path) -> None:
    path = study_file(
        (
            'name = "controller.integral_gain"\nvalues = [0.0, 1e-5]',
            'name = "design.gevrey_order"\nvalues = [1.5, 1.9, 2.5]',
        )
    )
    assert main(["study", str(path), "--out", str(tmp_path / "out")]) == 2  # 2.5 is no order
    text = path.read_text().replace("[1.5, 1.9, 2.5]", "[1.5, 1.9]")
    path.write_text(text)
    plan = planned(path, runs=4)
    results = finished(plan, tmp_path / "out")
    orders = plan.samples.values[:, 2]
    assert sorted(set(orders.tolist())) == [1.5, 1.9]
    assert len(set(results.measures[:, 1].tolist())) == 4


def test_a_failed_run_is_recorded_with_its_reason(study_file: Callable[..., Path], tmp_path: Path) -> None:
    path = study_file((GAIN, 'name = "controller.strain_limit"\nvalues = [1e-9, 0.1]'))
    plan = planned(path)
    results = finished(plan, tmp_path / "out")
    low = plan.samples.values[:, 2] == 1e-9
    assert np.array_equal(results.complete, ~low)
    assert "beyond strain_limit" in results.failures[int(np.flatnonzero(low)[0])]
    assert np.all(np.isfinite(results.measures[~low]))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("plant.beam[].tip_mass", "plant.beam[].tip_mas", "parameter[1].name is not a variable"),
        ("plant.beam[].tip_mass", "plnt.beam[].tip_mass", "names an unknown instance 'plnt'"),
        ("values = [0.0, 1e-5]", "values = []", "parameter[3].values must have at least 1 entries"),
        ("truncnorm", "truncnrm", "parameter[2].distribution is not one of scipy.stats; did you mean 'truncnorm'?"),
        ("a = -2.0, b = 2.0, ", "a = -2.0, ", "parameter[2].arguments must have b of truncnorm"),
        ("scale = 0.5", "width = 0.5", "parameter[2].arguments.width is not an argument of truncnorm"),
        (
            'truncnorm"\narguments = { a = -2.0, b = 2.0, ',
            'norm"\narguments = { ',
            "parameter[2].distribution reaches beyond the bounds of patch[1].piezo_ratio",
        ),
        ("[0.9, 1.1]\nrelative = true", "[-0.1, 1.1]", "parameter[1].name must be from 0.0 to"),
        ("range = [0.9, 1.1]", "range = [1.1, 0.9]", "parameter[1].range must have its smaller end first"),
        ("values = [0.0, 1e-5]", "relative = true", "must have exactly one of range, distribution and values"),
        ('of = "plant.y_pi"', 'of = "plant.y_pj"', "measure 'error'.of is not recorded"),
        ('name = "voltage"', 'name = "error"', "measure 'error' must differ from others"),
        ('scenario = "pushed.toml"', 'scenario = "trackin"', "scenario 'trackin' is neither a file nor a shipped"),
        ("runs = 12", 'runs = 12\nmethod = "grid"', "method grid needs values or levels of each parameter on a grid"),
        ("seed = 3", "seed = 3\nsampels = 1", "sampels is not a known key"),
    ],
)
def test_bad_studies_take_one_line(
    study_file: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    message: str,
) -> None:
    path = study_file((old, new))
    assert main(["study", str(path), "--out", str(tmp_path / "out")]) == 2
    errors = capsys.readouterr().err
    assert message in errors
    assert errors.startswith(f"flexbeams: {path}")
    assert errors.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_results_of_another_study_are_kept(study_file: Callable[..., Path], tmp_path: Path) -> None:
    plan = planned(study_file(), runs=2)
    before = finished(plan, tmp_path / "out")
    other = planned(study_file(("max = 1e-3", "max = 2e-3")), runs=2)
    with pytest.raises(Exception, match="holds results of another study, or of other units; use --out"):
        finished(other, tmp_path / "out")
    header = tmp_path / "out/study.json"
    content = json.loads(header.read_text())
    header.write_text(json.dumps({**content, "flexbeams": "0.0.1"}))
    with pytest.raises(Exception, match=r"holds results of flexbeams 0\.0\.1"):
        finished(plan, tmp_path / "out")
    header.write_text(json.dumps(content))
    assert np.array_equal(finished(plan, tmp_path / "out").measures, before.measures)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_study_goes_on(ctrl_c: None, study_file: Callable[..., Path], tmp_path: Path, number: int) -> None:
    path = study_file(("runs = 12", "runs = 300"), stop=2.0)
    plan = planned(path)
    arguments = ("study", path, "--out", tmp_path / "out", "--jobs", 1)
    process = command(*arguments, cwd=tmp_path, start_new_session=True)
    data = tmp_path / "out/data"
    while not list(data.glob("*.parquet")) and process.poll() is None:
        time.sleep(0.05)
    process.send_signal(number)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == (130 if number == signal.SIGINT else -number), errors
    with_rest = finished(plan, tmp_path / "out")
    assert np.array_equal(with_rest.measures, finished(plan, tmp_path / "anew").measures)


def test_a_lost_worker_is_replaced(study_file: Callable[..., Path], tmp_path: Path) -> None:
    """Its runs are repeated."""
    plan = planned(study_file())
    killed: list[int] = []

    def progress(done: int, total: int) -> None:
        if 0 < done < total and not killed:
            for process in multiprocessing.active_children():
                process.kill()
                killed.append(process.pid or 0)

    study = Study(plan=plan, folder=tmp_path / "out")
    assert study.run(local_workers(1), progress=progress)
    assert killed
    assert np.array_equal(study.results().measures, finished(plan, tmp_path / "anew").measures)


@pytest.mark.slow
def test_dask_gives_the_same_bits(study_file: Callable[..., Path], tmp_path: Path) -> None:
    """Two worker processes, each in a folder of its own with nothing in its cache; the scheduler is killed once."""
    pytest.importorskip("distributed")
    path, port = study_file(), free_port()
    plan, address = planned(path), f"tcp://127.0.0.1:{port}"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    scheduler = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port)]
    worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"]
    processes = []
    try:
        processes.append(subprocess.Popen([*scheduler, "--no-dashboard"], cwd=tmp_path, **quiet))  # type: ignore[call-overload]
        for name in ("one", "two"):
            (tmp_path / name).mkdir()
            environment = python_environment(FLEXBEAMS_CACHE=str(tmp_path / name / "cache"))
            processes.append(
                subprocess.Popen(  # type: ignore[call-overload]
                    [*worker, "--no-nanny"], cwd=tmp_path / name, env=environment, **quiet
                )
            )
        for _ in range(300):
            try:
                if cluster_workers(address) == 2:
                    break
            except InputError:
                time.sleep(0.2)
        found = finished(plan, tmp_path / "out", cluster(address))
        assert np.array_equal(found.measures, finished(plan, tmp_path / "here").measures)

        def kill_scheduler(done: int, total: int) -> None:
            if 0 < done < total:
                processes[0].kill()

        lost = Study(plan=plan, folder=tmp_path / "lost")
        with pytest.raises(FlexbeamsError, match=r"the cluster was lost .*; the same command does what is missing"):
            lost.run(cluster(address), progress=kill_scheduler)
        assert 0 < len(lost.results().numbers) < plan.samples.runs
        assert np.array_equal(finished(plan, tmp_path / "lost").measures, found.measures)
        with pytest.raises(InputError, match="--scheduler cannot be reached"):
            cluster(address)
    finally:
        for process in processes:
            process.kill()
            process.wait()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def test_failed_runs_come_first_on_the_page(study_file: Callable[..., Path], tmp_path: Path) -> None:
    path = study_file((GAIN, 'name = "controller.strain_limit"\nvalues = [1e-9, 0.1]'), ("runs = 12", "runs = 40"))
    study = fb.study(path, folder=tmp_path / "out", executor=Here())
    page = study.report().read_text(encoding="utf-8")
    assert f"40 runs, {len(study.failed)} failed" in page
    assert 15 < len(study.failed) < 25
    assert page.index("Failed runs") < page.index("Distributions") < page.index("Worst runs")
    assert all("beyond strain_limit" in reason for reason in study.failed.values())
    worst = study.worst("voltage", 2)
    assert study["voltage"][worst[0]] == np.nanmax(study["voltage"])
    for number in worst:
        assert f'href="runs/{number}/report.html"' in page
        assert (tmp_path / "out/runs" / str(number) / "report.html").is_file()
    assert study.run(worst[0]).summary["metrics"]["voltage"] == study["voltage"][worst[0]]
    assert study.sensitivity("voltage").left_out == len(study.failed)
    assert study.table.column_names == ["run", *study.inputs, *study.measures, "failure"]
    with pytest.raises(fb.FlexbeamsError, match="did you mean 'voltage'"):
        study.worst("voltge")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"runs": "a"}, "runs must be an integer >= 1, got 'a'"),
        ({"runs": 0}, "runs must be an integer >= 1, got 0"),
        ({"seed": 1.5}, "seed must be an integer >= 0, got 1.5"),
        ({"workers": -1}, "workers must be an integer >= 1, got -1"),
        ({"method": "x"}, "method must be 'lhs' or 'sobol' or 'saltelli' or 'grid', got 'x'"),
    ],
)
def test_wrong_arguments_of_the_function(options: Any, message: str) -> None:
    with pytest.raises(fb.FlexbeamsError) as caught:
        fb.study("noise", **options)
    assert str(caught.value) == message


def test_signals_are_kept_at_their_rate(study_file: Callable[..., Path], tmp_path: Path) -> None:
    import pyarrow.parquet

    path = study_file(("seed = 3", 'seed = 3\nsignals = { record = ["plant.y_pi"], interval = 1e-3 }'))
    study = fb.study(path, folder=tmp_path / "out", executor=Here(), runs=2)
    table = pyarrow.parquet.read_table(tmp_path / "out/data")
    kept = table.column("plant.y_pi[1]").to_pylist()[table.column("run").to_pylist().index(1)]
    recording = study.run(1).recording
    assert kept == recording.values[::5, recording.columns.index("plant.y_pi[1]")].tolist()
    assert len(kept) == 61


def test_the_command_prints_json(
    study_file: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = study_file()
    assert main(["study", str(path), "--out", str(tmp_path / "out"), "--jobs", "1", "--json", "--runs", "20"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["runs"], summary["failed"], summary["seed"]) == (20, 0, 3)
    assert summary["measures"]["error"]["outside"] >= 0
    assert set(summary["measures"]["voltage"]["sensitivity"]["indices"]) == set(summary["inputs"])
