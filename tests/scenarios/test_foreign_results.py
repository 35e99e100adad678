"""Results of third-party units: arrays by their index, units of measurement as declared, figures and reports."""

import json
import re
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from flexbeams.plant.errors import InputError
from flexbeams.scenarios.cli.main import main
from flexbeams.scenarios.definition.schema import Figure
from flexbeams.scenarios.report.comparison import comparison_html
from flexbeams.scenarios.report.figure_plots import figure_plot
from flexbeams.scenarios.report.overview import overview, overview_plot
from flexbeams.scenarios.results.compare import compare, metric_table
from flexbeams.scenarios.results.curves import curve
from flexbeams.scenarios.results.files import write_results
from flexbeams.scenarios.results.formats import write_mat
from flexbeams.scenarios.runs.files import write_run
from flexbeams.scenarios.simulation.recording import Recording
from tests.scenarios.test_foreign_packages import GAINS, SENSORS, Shop, connection
from tests.scenarios.test_foreign_recordings import SUMMARY
from tests.scenarios.test_foreign_units import Bench, G, drive
from tests.units.foreign.unit import ForeignUnit, ForeignVariable

pytestmark = pytest.mark.native
V = ForeignVariable

CHECKED = """[[check]]
name = "first"
measure = "largest"
of = "g.y"
points = [1]
unit = "mm"
[[check]]
name = "both"
measure = "largest"
of = "g.y"
reference = [3.0, 49.0]
"""


@pytest.fixture
def bench(tmp_path: Path, run_folder: Path) -> Bench:
    return Bench(tmp_path, run_folder / "build/fmus")


@pytest.fixture
def shop(tmp_path: Path, run_folder: Path) -> Shop:
    return Shop(tmp_path, run_folder / "build/fmus")


def data_of(page: str) -> dict[str, list[dict[str, object]]]:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found
    data: dict[str, list[dict[str, object]]] = json.loads(found[1])
    return data


def words(path: Path) -> list[str]:
    return [t.text or "" for t in ElementTree.parse(path).iter("{http://www.w3.org/2000/svg}text")]


def test_checks_and_figures_take_elements_by_index(bench: Bench) -> None:
    """The unit declares y[2] before y[1]; y = (u[1], 10 u[2])."""
    run = bench.run(G + drive("g.u", "constant = [3.0, 5.0]") + CHECKED)
    assert run.recording.columns.index("g.y[2]") < run.recording.columns.index("g.y[1]")
    assert [outcome.value for outcome in run.outcomes] == [3.0, 1.0]
    figure = Figure(file="a", rows=[["g.y"]], points=[1])
    plot = figure_plot(figure, run.scenario, run.recording, Path(), None, "figure[1]")
    [panel] = plot.rows[0].panels
    assert (panel.title, plot.rows[0].axis) == ("y 1", "y in mm")
    assert set(panel.lines[0].values) == {3.0}
    both = curve("g.y", run.recording)
    assert [both.element(k) for k in range(2)] == ["y 1", "y 2"]


def test_a_matrix_in_a_mat_file_goes_by_index(bench: Bench, tmp_path: Path) -> None:
    from scipy.io import loadmat

    run = bench.run(G + drive("g.u", "constant = [3.0, 5.0]"))
    with (tmp_path / "a.mat").open("wb") as file:
        write_mat(file, run.recording, run.summary)
    content = loadmat(tmp_path / "a.mat", simplify_cells=True)
    assert content["g"]["y"][-1].tolist() == [3.0, 50.0]
    assert content["columns"]["g"]["y"].tolist() == ["g.y[1]", "g.y[2]"]


def test_arrays_in_any_order_are_compared_whole(tmp_path: Path) -> None:
    time, folders = np.arange(5) * 0.1, []
    for name, columns in (("a", ["g.y[1]", "g.y[2]", "g.y[10]"]), ("b", ["g.y[10]", "g.y[2]", "g.y[1]"])):
        values = np.stack([time * float(c[4:-1]) for c in columns], axis=1)
        recording = Recording(time=time, columns=columns, values=values, wall_seconds=1.0)
        write_results(tmp_path / name, recording, SUMMARY)
        folders.append(tmp_path / name)
    comparison = compare(folders)
    assert comparison.arrays == ["g.y"]
    panels = data_of(comparison_html(comparison, "t"))["groups"][0]["panels"]
    assert isinstance(panels, list)
    assert [p["title"] for p in panels] == ["y 1", "y 2", "y 10"]
    assert all(p["curves"][0]["values"] == p["curves"][1]["values"] for p in panels)


def test_values_are_displayed_in_the_units_that_are_declared(shop: Shop, tmp_path: Path) -> None:
    """A variable called u or w is a voltage or a deflection in the units of this project only."""
    unit = ForeignUnit(
        variables=[
            V(name="u", type="Real", causality="output", reference=0, unit="degC"),
            V(name="w[1]", type="Real", causality="output", reference=1, unit="m"),
            V(name="y_pi", type="Integer", causality="output", reference=1),
            V(name="mixed[1]", type="Real", causality="output", reference=2, unit="mm"),
            V(name="mixed[2]", type="Real", causality="output", reference=3, unit="V"),
        ],
        rules=["clock 0", "clock 1", "clock 2", "clock 3"],
    )
    dotted = shop.run(shop.package({"1st.part-a": (unit, "")}))
    assert dotted.summary["signals"]["1st.part-a.u"]["unit"] == "degC"
    run = shop.run(shop.package({"1st-part": (unit, "")}))
    curves = {name: curve(f"1st-part.{name}", run.recording) for name in ("u", "w", "y_pi", "mixed")}
    assert {n: (c.quantity, c.unit, c.factor) for n, c in curves.items()} == {
        "u": ("value", "degC", 1.0),
        "w": ("deflection", "mm", 1e3),
        "y_pi": ("value", "", 1.0),
        "mixed": ("value", "", 1.0),
    }
    assert curves["mixed"].element(1) == "mixed 2 in V"
    for name in ("a", "b"):
        write_run(run, tmp_path / name)
    table = dict(metric_table(compare([tmp_path / "a", tmp_path / "b"])))
    assert table["1st-part.u.largest"] == ["0.05 degC"] * 2
    assert "1st-part.u in degC" in words(tmp_path / "a/signals.svg")


def test_a_package_has_a_figure_and_a_report(shop: Shop, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A panel for each array with the unit; constant ones are named in the report. Replaced by the next run."""
    clock = V(name="seen", type="Real", causality="output", reference=5, unit="mm")
    unit = replace(GAINS, variables=[clock if v.name == "seen" else v for v in GAINS.variables])
    unit = replace(unit, rules=[*[r for r in unit.rules if " 5 " not in r], "clock 5"])
    path = shop.package({"s": (SENSORS, ""), "g": (unit, "")}, connection("s.x[1]", "g.u[1]"))
    options = ["--out", str(tmp_path / "out"), "--cache", str(shop.settings.build_folder)]
    for _ in range(2):
        assert main(["run", str(path), *options]) == 0
        names = {p.name for p in (tmp_path / "out").iterdir()}
        assert names == {"results.csv", "summary.json", "report.html", "signals.png", "signals.svg"}
    assert set(json.loads((tmp_path / "out/summary.json").read_text())["files"]) == names - {"summary.json"}
    assert "g.seen in mm" in words(tmp_path / "out/signals.svg")
    page = (tmp_path / "out/report.html").read_text()
    [group] = data_of(page)["groups"]
    assert (group["title"], [p["title"] for p in group["panels"]]) == ("Recorded signals", ["g.seen"])  # type: ignore[attr-defined]
    assert "g.y = 1000, 0" in page
    assert "signals.png" in page
    assert main(["run", str(path), *options, "--no-figures"]) == 0
    assert not (tmp_path / "out/signals.png").exists()
    capsys.readouterr()


def test_units_without_outputs_have_results(shop: Shop, tmp_path: Path) -> None:
    unit = ForeignUnit(variables=[V(name="u", type="Real", causality="input", reference=0, start="0")])
    run = shop.run(shop.package({"g": (unit, "")}))
    kinds = [k for k, m in (("parquet", "pyarrow"), ("mf4", "asammdf")) if find_spec(m)]
    write_run(run, tmp_path / "out", formats=("csv", "mat", *kinds))  # type: ignore[arg-type]
    assert (tmp_path / "out/results.csv").read_text().splitlines()[:2] == ["time", "0.0"]
    assert not (tmp_path / "out/signals.png").exists()


def test_the_figure_of_many_signals_is_limited(tmp_path: Path) -> None:
    time = np.arange(4) * 0.1
    columns = [f"g.y{k}" for k in range(400)]
    values = time[:, None] * np.arange(1, 401)
    recording = Recording(time=time, columns=columns, values=values, wall_seconds=1.0)
    found = overview(recording)
    assert (len(found.curves), found.notes) == (300, ["Not drawn: 100 further arrays"])
    plot = overview_plot(recording, "many", tmp_path)
    assert plot is not None
    assert (plot.title, sum(len(row.panels) for row in plot.rows)) == ("many (24 of 300 signals)", 24)
    constant = replace(recording, columns=columns[:2], values=np.ones((4, 2)))
    still = overview_plot(constant, "still", tmp_path)
    assert still is not None
    assert [p.title for p in still.rows[0].panels] == ["g.y0", "g.y1"]


def test_components_whose_names_cannot_be_told_apart_are_refused(shop: Shop) -> None:
    inner = ForeignUnit(variables=[V(name="b.c", type="Real", causality="output", reference=0, start="1")])
    outer = ForeignUnit(variables=[V(name="c", type="Real", causality="output", reference=0, start="2")])
    with pytest.raises(InputError, match=r"instance\.a has a variable 'b\.c', which cannot be told from 'c' of a\.b"):
        shop.run(shop.package({"a": (inner, ""), "a.b": (outer, "")}))
    assert shop.last(shop.package({"a": (inner, ""), "ab": (outer, "")})) == {"a.b.c": 1.0, "ab.c": 2.0}
