"""Figures of a run: PNG and SVG, the same bytes each time, with what the scenario names in them."""

import struct
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.definition.scenario_file import find_scenario, read_scenario
from flexbeams.scenarios.definition.schema import Figure, Scenario
from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.report.figure_plots import MAX_POINTS, figure_plot, figure_plots
from flexbeams.scenarios.report.figure_process import FigureProcess
from flexbeams.scenarios.report.figures import draw, write_figures
from flexbeams.scenarios.results.curves import figure_curve
from flexbeams.scenarios.results.decimation import decimated
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.recording import Recording
from tests.helpers import STRUCTURES, design_of

Write = Callable[[str, str], Path]
TIME = np.linspace(0, 2, 401)


def recording(
    scale: float = 1.0,
    columns: tuple[str, ...] = (
        "plant.y_pi[1]",
        "plant.y_pi[2]",
        "plant.y_pi[3]",
        "plant.u[1]",
        "plant.u[2]",
        "feedforward.y_ref[1]",
        "plant.energy",
    ),
) -> Recording:
    values = np.stack([scale * (k + 1) * np.sin((k + 2) * TIME) for k in range(len(columns))], axis=1)
    return Recording(time=TIME, columns=list(columns), values=values, wall_seconds=0.0)


def scenario(*figures: Figure) -> Scenario:
    return Scenario(
        title="Waves & <more>",
        structure="kiel",
        stop_time=2.0,
        figure=list(figures),
        instance=read_scenario(find_scenario("step_response")).instance,
    )


def texts(path: Path) -> list[str]:
    """The words in an SVG file."""
    return [t.text or "" for t in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")]


def test_png_and_svg_with_titles_units_and_elements(tmp_path: Path) -> None:
    figure = Figure(file="waves", title="Two rows", rows=[["plant.y_pi", "feedforward.y_ref"], ["plant.u"]])
    files = write_figures(figure_plots(scenario(figure), recording(), tmp_path))
    assert [f.name for f in files] == ["waves.png", "waves.svg"]
    assert sorted(tmp_path.iterdir()) == files
    header = files[0].read_bytes()[:24]
    assert header[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", header[16:24])
    assert (width, height) == (round(150 * (3.0 * 3 + 0.32)), round(150 * (2.3 * 2 + 0.75)))
    words = texts(files[1])
    for word in (
        "Two rows",
        "point 1",
        "point 3",
        "patch pair 2",
        "deflection in mm",
        "voltage in V",
        "time in s",
        "plant.y_pi",
        "feedforward.y_ref",
    ):
        assert word in words, word


def test_same_bytes_each_time(tmp_path: Path) -> None:
    """Also under other settings of matplotlib's user, and with markup in the title."""
    figure = Figure(file="a", rows=[["plant.energy", "plant.y_pi[2]"]], start=0.5, stop=1.5)
    first = [f.read_bytes() for f in write_figures(figure_plots(scenario(figure), recording(), tmp_path / "first"))]
    assert "Waves & <more>" in texts(tmp_path / "first/a.svg")
    assert b"dc:date" not in first[1]
    with matplotlib.rc_context({"svg.hashsalt": "other", "savefig.dpi": 10}):
        again = write_figures(figure_plots(scenario(figure), recording(), tmp_path / "second"))
        second = [f.read_bytes() for f in again]
    assert second == first
    other = write_figures(figure_plots(scenario(figure), recording(1.1), tmp_path / "third"))
    assert other[1].read_bytes() != first[1]


def test_curves_are_those_of_the_recording() -> None:
    """Lines in the units shown, in the window asked for; a reference below is wide."""
    figure = Figure(
        file="a", rows=[["feedforward.y_ref", "plant.y_pi"], ["plant.u"]], points=[1, 3], start=0.25, stop=1.0
    )
    run = recording()
    canvas = draw(figure_plot(figure, scenario(figure), run, Path(), None, "figure[1]"))
    grid = np.array(canvas.axes).reshape(2, 2)
    window = (TIME >= 0.25) & (TIME <= 1.0)
    reference, own = grid[0, 0].lines
    np.testing.assert_array_equal(own.get_xdata(), TIME[window])
    np.testing.assert_allclose(own.get_ydata(), 1e3 * run.values[window, 0])
    np.testing.assert_allclose(reference.get_ydata(), 1e3 * run.values[window, 5])
    assert reference.get_linewidth() > 2 * own.get_linewidth()
    [third] = grid[0, 1].lines
    np.testing.assert_allclose(third.get_ydata(), 1e3 * run.values[window, 2])
    [voltage] = grid[1, 0].lines
    np.testing.assert_allclose(voltage.get_ydata(), run.values[window, 3])
    assert not grid[1, 1].lines  # there is no third voltage
    assert grid[0, 1].get_title() == "point 3"


def test_open_loop_is_drawn_below(tmp_path: Path) -> None:
    figure = Figure(file="a", rows=[["open_loop.plant.y_pi[2]", "plant.y_pi[2]"]])
    other = recording(5.0)
    canvas = draw(figure_plot(figure, scenario(figure), recording(), Path(), other, "figure[1]"))
    [axis] = canvas.axes
    without, own = axis.lines
    assert [t.get_text() for t in axis.get_legend().get_texts()] == ["without control", "plant.y_pi[2]"]
    np.testing.assert_allclose(without.get_ydata(), 1e3 * other.values[:, 1])
    np.testing.assert_allclose(own.get_ydata(), 1e3 * recording().values[:, 1])


def test_long_curves_keep_their_peaks() -> None:
    """Fewer points than rows, yet every extremum of any stretch."""
    time = np.arange(300_001) * 2e-4
    y = np.sin(time) * 0.1
    y[[17, 123_456, 299_999]] = (5.0, -7.0, 3.0)
    t, kept = decimated(time, y, MAX_POINTS)
    assert len(t) < 1.1 * MAX_POINTS
    assert {5.0, -7.0, 3.0} <= set(kept)
    assert (t[0], t[-1]) == (time[0], time[-1])
    assert np.all(np.diff(t) > 0)


def test_many_signals_in_a_row(tmp_path: Path) -> None:
    """More than there are colours."""
    columns = tuple(f"plant.w[1,{k}]" for k in range(1, 10))
    figure = Figure(file="a", rows=[list(columns)])
    write_figures(figure_plots(scenario(figure), recording(columns=columns), tmp_path))
    assert set(columns) <= set(texts(tmp_path / "a.svg"))


def test_figure_beyond_the_run_is_empty_but_there(tmp_path: Path) -> None:
    """A run shortened by --stop-time has figures all the same."""
    figure = Figure(file="a", rows=[["plant.y_pi"]], start=5.0, stop=6.0)
    assert all(f.stat().st_size > 1000 for f in write_figures(figure_plots(scenario(figure), recording(), tmp_path)))


def test_points_choose_elements() -> None:
    curve = figure_curve("plant.y_pi", recording(), None, [3, 1, 9], "figure[1]")
    assert [recording().columns[p] for p in curve.columns] == ["plant.y_pi[3]", "plant.y_pi[1]"]


def test_drawn_beside_a_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same files from a process of their own; by the caller where that process is lost."""
    figure = Figure(file="a", rows=[["plant.energy", "plant.y_pi[2]"]])
    first, second, third = (tmp_path / name for name in ("first", "second", "third"))
    files = write_figures(figure_plots(scenario(figure), recording(), first))
    with FigureProcess() as beside:
        beside.start(figure_plots(scenario(figure), recording(), second))
        with monkeypatch.context() as patch:  # the caller draws nothing here
            patch.delattr("flexbeams.scenarios.report.figures.drawn_figures")
            drawn = beside.wait()
    with FigureProcess() as lost:
        lost._process.kill()
        lost._process.wait()
        lost.start(figure_plots(scenario(figure), recording(), third))
        again = lost.wait()
    assert len(files) == len(drawn) == 2
    for file in files:
        assert file.read_bytes() == drawn[second / file.name] == again[third / file.name]


def test_figure_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    plots = figure_plots(scenario(Figure(file="a", rows=[["plant.u"]])), recording(), tmp_path / "file" / "folder")
    with pytest.raises(InputError, match="cannot be written: Not a directory"):
        write_figures(plots)


@pytest.mark.parametrize("name", ["step_response", "tracking", "disturbance", "five_beams"])
@pytest.mark.native
def test_shipped_figures(at_run_folder: Path, tmp_path: Path, name: str) -> None:
    """Each figure of the paper is drawn from a short run, by the names that the scenario fixes."""
    run = run_scenario(
        name, Settings(record_animation=False, stop_time=0.4), designs=[design_of(s) for s in STRUCTURES]
    )
    files = write_figures(figure_plots(run.scenario, run.recording, tmp_path, run.open_loop))
    expected = {
        "step_response": "figure4",
        "tracking": "figure5_tracking",
        "disturbance": "figure6",
        "five_beams": "five_beams",
    }[name]
    assert {f.stem for f in files} == {expected}
    assert {f.suffix for f in files} == {".png", ".svg"}
    words = texts(tmp_path / f"{expected}.svg")
    assert "deflection in mm" in words
    assert "time in s" in words
    assert run.scenario.figure[0].title in words
