"""Shares of the time that voltages are held at a limit: as a check, as a metric, in the table and on the page."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.scenario_file import load_scenario
from flexbeams.scenarios.definition.schema import Check
from flexbeams.scenarios.results.checks import Measurement, standard_metrics
from flexbeams.scenarios.results.files import read_results
from flexbeams.scenarios.results.saturation import saturation_lines
from flexbeams.scenarios.simulation.recording import Recording
from tests.helpers import PUSHED_SCENARIO

FLAG = "controller.saturated"
CHECK = """[[check]]
name = "saturated"
measure = "saturation_share"
of = "controller.saturated"
after = 0.02
max = {limit}
"""


def recording(flags: list[float]) -> Recording:
    """Rows every 0.1 s of a flag and, beside it, of its opposite."""
    values = np.array([flags, [1 - f for f in flags]]).T
    return Recording(
        time=0.1 * np.arange(len(flags)), columns=[FLAG, "other.saturated[1]"], values=values, wall_seconds=0.0
    )


def measured(check: Check, recorded: Recording) -> float:
    scenario = replace(load_scenario("tracking").scenario, check=[check])
    return Measurement(scenario, "s.toml", recorded, None).value(check, "check[1]")


@pytest.mark.parametrize(
    ("flags", "window", "share"),
    [
        ([0, 1, 1, 0, 0], {}, 0.4),
        ([0, 0, 0], {}, 0.0),
        ([1, 1, 1, 1], {}, 1.0),
        ([1, 1, 0, 1, 0], {"after": 0.2}, 1 / 3),
        ([1, 1, 0, 1, 0], {"after": 0.1, "before": 0.2}, 0.5),
        ([1, 0], {"before": 0.05}, 1.0),
    ],
)
def test_share_of_the_rows_in_the_window(flags: list[float], window: dict[str, float], share: float) -> None:
    check = Check(name="c", measure="saturation_share", of=FLAG, **window)  # type: ignore[arg-type]
    assert measured(check, recording(flags)) == pytest.approx(share, rel=1e-15)


def test_one_flag_of_an_array_is_enough() -> None:
    both = recording([0, 1, 0, 1])
    both.columns[:] = ["controller.flags[1]", "controller.flags[2]"]
    check = Check(name="c", measure="saturation_share", of="controller.flags")
    assert measured(check, both) == 1.0
    assert measured(replace(check, points=[2]), both) == 0.5
    with pytest.raises(InputError, match="is not recorded"):
        measured(replace(check, of=FLAG), both)


@pytest.mark.parametrize(
    ("share", "text"), [(0.12, "12"), (0.123, "12"), (3e-5, "0.003"), (0.5, "50"), (0.9999, ">99"), (1.0, "100")]
)
def test_the_line(share: float, text: str) -> None:
    metrics = {"controller.saturated.largest": 1.0, "controller.saturated.share": share, "x.saturated.share": 0.0}
    assert saturation_lines(metrics) == [f"controller: saturated for {text} % of the time"]


def test_metrics_of_every_run() -> None:
    assert standard_metrics(recording([0, 1, 1, 0, 0]))["controller.saturated.share"] == 0.4


@pytest.mark.native
def test_a_run_says_so_where_it_happens(
    at_run_folder: Path, write_scenario: Callable[[str, str], Path], capsys: pytest.CaptureFixture[str]
) -> None:
    """With a limit below what the motion needs; in the table, in summary.json and on the page; else nowhere."""
    text = PUSHED_SCENARIO.format(stop=0.2) + CHECK.format(limit=0.5)
    path = write_scenario("saturated", text)
    options = ["run", str(path), "--no-figures", "--out"]
    assert main([*options, "wide"]) == 0
    assert "saturated for" not in capsys.readouterr().out
    assert "saturated for" not in Path("wide/report.html").read_text()
    limits = ["--set", "controller.voltage_limit=2", "--set", "feedforward.voltage_limit=900"]
    assert main([*options, "narrow", *limits]) == 1
    printed = capsys.readouterr()
    recorded = read_results(Path("narrow/results.csv"))
    summary = json.loads(Path("narrow/summary.json").read_text())
    flags = recorded.values[:, recorded.columns.index(FLAG)]
    share = np.count_nonzero(flags) / len(flags)
    assert 0.5 < share < 1
    assert summary["metrics"]["controller.saturated.share"] == pytest.approx(share, rel=1e-15)
    [check] = summary["checks"]
    assert check["value"] == pytest.approx(np.count_nonzero(flags[100:]) / len(flags[100:]), rel=1e-15)
    assert not check["passed"]
    line = f"controller: saturated for {100 * share:.2g} % of the time"
    assert line in printed.out
    assert line in Path("narrow/report.html").read_text()
