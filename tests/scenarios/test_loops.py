"""Pictures of loops: where a curve lies in its box, and the channels of an actuator in a report."""

from pathlib import Path

import numpy as np
import pytest

from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.report.loops import BELOW, HEIGHT, LEFT, ROOM, WIDTH, loop_picture
from flexbeams.scenarios.report.report import report_html
from flexbeams.scenarios.runs.scenario import run_scenario
from tests.helpers import design_of


def test_a_curve_fills_its_box_and_has_round_marks() -> None:
    angle = np.linspace(0.0, 2 * np.pi, 400)
    picture = loop_picture("circle", ("x", "y"), {"": (1000 * np.cos(angle), np.sin(angle))})
    [line] = picture["lines"]
    points = np.array([[float(v) for v in point.split(",")] for point in line["points"].split()])
    margin = 0.03 / 1.06  # of each side
    width, height = WIDTH - ROOM - LEFT, HEIGHT - BELOW - ROOM
    np.testing.assert_allclose(points.min(axis=0), [LEFT + margin * width, ROOM + margin * height], atol=0.2)
    np.testing.assert_allclose(
        points.max(axis=0), [WIDTH - ROOM - margin * width, HEIGHT - BELOW - margin * height], atol=0.2
    )
    assert [mark["text"] for mark in picture["x_ticks"]] == ["−1000", "−500", "0", "500", "1000"]
    assert [mark["text"] for mark in picture["y_ticks"]] == ["−1", "−0.5", "0", "0.5", "1"]


def test_a_constant_has_a_picture_too() -> None:
    picture = loop_picture("rest", ("x", "y"), {"": (np.zeros(3), np.full(3, 5.0))})
    assert len(set(picture["lines"][0]["points"].split())) == 1


@pytest.mark.native
def test_the_report_has_a_loop_of_each_channel(at_run_folder: Path) -> None:
    settings = Settings(record_animation=False, stop_time=0.01)
    page = report_html(run_scenario("hysteresis", settings, designs=[design_of()]))
    assert page.count('<svg class="loop"') == 4
    assert "actuator, channel 4" in page
    assert "actuator.u_eff in V over actuator.u in V" in page
