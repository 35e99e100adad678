"""Runs that are paced to the wall clock."""

from pathlib import Path

import numpy as np
import pytest

from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.results.run import lateness_figures
from flexbeams.scenarios.runs.scenario import run_scenario

pytestmark = pytest.mark.native


def test_a_paced_run_is_late_by_no_less_than_nothing(run_folder: Path) -> None:
    settings = Settings(stop_time=0.4, real_time_factor=2.0, build_folder=run_folder / "fmus", record_animation=False)
    recording = run_scenario("feedforward", settings).recording
    assert recording.lateness is not None
    assert recording.lateness.shape == (2000,)
    assert np.all(recording.lateness >= 0)
    assert recording.wall_seconds >= 0.4 / 2.0 - 1e-3  # it waited for its last step


def test_a_paced_run_gives_the_same_values(run_folder: Path) -> None:
    free, paced = (
        run_scenario("feedforward", Settings(stop_time=0.2, real_time_factor=speed, build_folder=run_folder / "fmus"))
        for speed in (None, 4.0)
    )
    assert np.array_equal(free.recording.values, paced.recording.values)
    assert set(paced.summary["timing"]["lateness"]) == {"median", "p99", "p99.99", "max", "overruns", "rate_error"}
    assert "lateness" not in free.summary["timing"]


def test_lateness_figures_of_a_drifting_clock() -> None:
    lateness = np.linspace(0.0, 0.1, 1001)  # 0.1 s in 1000 periods of 1 ms
    figures = lateness_figures(lateness, 1e-3)
    assert figures["rate_error"] == pytest.approx(0.1)
    assert figures["median"] == pytest.approx(0.05)
    assert figures["max"] == pytest.approx(0.1)
    assert figures["overruns"] == np.count_nonzero(lateness > 1e-3)


def test_python_units_are_not_paced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status = main(
        [
            "run",
            "feedforward",
            "--backend",
            "python",
            "--real-time",
            "--stop-time",
            "0.1",
            "--out",
            str(tmp_path / "results"),
        ]
    )
    assert status == 2
    assert capsys.readouterr().err.strip().endswith("--real-time needs native units")
