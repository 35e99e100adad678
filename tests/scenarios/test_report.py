"""report.html without a browser: self-contained, complete, true to the run, the same each time, harmless."""

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.report import panels
from flexbeams.scenarios.report.report import report_html
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.runs.files import write_run
from flexbeams.scenarios.runs.scenario import run_scenario
from flexbeams.scenarios.simulation.recording import Recording

pytestmark = pytest.mark.native


@pytest.fixture(scope="module")
def settings(run_folder) -> Settings:
    return Settings(build_folder=run_folder / "build/fmus")


@pytest.fixture(scope="module")
def tracking(settings) -> Run:
    return run_scenario("tracking", settings)


@pytest.fixture(scope="module")
def page(tracking) -> str:
    return report_html(tracking)


class Elements(HTMLParser):
    """Start tags with their attributes, and the texts by the tag they stand in."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self._open = ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._open = tag

    def handle_data(self, data):
        if data.strip():
            self.texts.append((self._open, " ".join(data.split())))

    def inside(self, *tags: str) -> list[str]:
        return [text for tag, text in self.texts if tag in tags]


def data_of(page: str) -> dict:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert found
    return json.loads(found[1])


def floats(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f4")


def without_timing(page: str) -> str:
    cut, count = re.subn(r'<section id="timing".*?</section>', "", page, flags=re.DOTALL)
    assert count == 1
    return cut


def test_page_loads_nothing(page):
    for tag, attributes in Elements(page).tags:
        assert "src" not in attributes
        assert attributes.get("href", "#") in ("#", "#content", "data:,"), tag
    assert "default-src 'none'" in page
    styles = "".join(re.findall(r"<style>(.*?)</style>", page, re.DOTALL))
    assert "url(" not in styles
    assert "@import" not in styles
    scripts = re.sub(r"/\*.*?\*/", "", "".join(re.findall(r"<script>(.*?)</script>", page, re.DOTALL)), flags=re.DOTALL)
    assert not re.search(r"https?://|fetch\(|XMLHttpRequest|import\(|WebSocket|sendBeacon", scripts)


def test_page_of_six_seconds_is_small(page):
    assert len(page.encode()) < 700_000


def test_every_check_is_in_the_table_with_its_verdict(page, tracking):
    elements = Elements(page[page.index('<section id="checks"') : page.index('<section id="motion"')])
    rows = elements.inside("th")[5:]
    assert rows == [check.name for check in tracking.scenario.check]
    assert elements.inside("span") == ["holds"] * len(rows)
    assert "0 mm" in elements.inside("td")
    assert "All 4 checks hold" in page


def test_failed_check_is_told(tracking):
    outcomes = [replace(tracking.outcomes[0], maximum=1e-12), *tracking.outcomes[1:]]
    summary = {**tracking.summary, "checks": [o.record() for o in outcomes]}
    failed = report_html(replace(tracking, outcomes=outcomes, summary=summary))
    assert "1 of 4 checks failed" in failed
    assert Elements(failed).inside("span").count("failed") == 1


def test_what_was_run_is_told(page, tracking):
    facts = " ".join(Elements(page).inside("dd"))
    for text in (
        "tracking",
        "kiel: 3 beams, 4 patch pairs, 2 springs",
        "clamped_free",
        "jacobi",
        "native",
        "6 s",
        tracking.design.design_id,
        "flexbeams 0.",
    ):
        assert text in facts
    assert tracking.description in Elements(page).inside("p")


def test_settings_of_the_command_line_are_told(tracking):
    changed = replace(tracking, settings=replace(tracking.settings, overrides={"plant.beam[1].tip_mass": 0.03}))
    assert "plant.beam[1].tip_mass = 0.03" in report_html(changed)


def test_panels_hold_rows_of_the_recording(page, tracking):
    groups = data_of(page)["groups"]
    recording = tracking.recording
    first = groups[0]["panels"][0]
    assert [c["label"] for c in first["curves"]] == ["feedforward.y_ref", "plant.y_pi"]
    rows = np.rint(floats(first["time"]) / 2e-4).astype(int)
    column = recording.values[:, recording.columns.index("plant.y_pi[1]")] * 1e3
    np.testing.assert_array_equal(floats(first["curves"][1]["values"]), column[rows].astype("f4"))
    for panel in (p for g in groups for p in g["panels"]):
        time = floats(panel["time"])
        assert 2 <= len(time) <= panels.MAX_ROWS
        assert np.all(np.diff(time) > 0)
        assert all(len(floats(c["values"])) == len(time) for c in panel["curves"])


def test_every_recorded_signal_is_drawn_or_named(page, tracking):
    groups = data_of(page)["groups"]
    text = json.dumps(
        [[p["title"], [c["label"] for c in p["curves"]]] for g in groups for p in g["panels"]]
        + [g["notes"] for g in groups]
    )
    for column in tracking.recording.columns:
        assert column.split("[")[0] in text


def test_peaks_of_a_long_run_are_drawn(tracking):
    rows = 400_000
    values = np.random.default_rng(3).standard_normal((rows, len(tracking.recording.columns)))
    column = tracking.recording.columns.index("plant.y_pi[3]")
    values[123_457, column] = 99.0
    long = Recording(time=np.arange(rows) * 2e-4, columns=tracking.recording.columns, values=values, wall_seconds=1.0)
    drawn = report_html(replace(tracking, recording=long))
    panel = data_of(drawn)["groups"][0]["panels"][2]
    peak = int(np.argmax(floats(panel["curves"][1]["values"])))
    assert floats(panel["curves"][1]["values"])[peak] == pytest.approx(99e3)
    assert floats(panel["time"])[peak] == pytest.approx(123_457 * 2e-4)
    assert len(drawn) < 1_500_000


def test_curves_of_the_open_loop_end_with_the_run(settings):
    run = run_scenario("disturbance", replace(settings, stop_time=6.0))
    panel = data_of(report_html(run))["groups"][0]["panels"][0]
    assert [c["label"] for c in panel["curves"]] == ["without control", "plant.y_pi"]
    assert floats(panel["time"])[-1] == pytest.approx(6.0)
    assert not np.isnan(floats(panel["curves"][0]["values"])).any()


def test_animation_holds_shapes_voltages_and_reference(page, tracking):
    moving, frames = data_of(page)["animation"], tracking.recording.frames

    def levels(packed):
        return np.frombuffer(base64.b64decode(packed["levels"]), "<i2") * packed["scale"]

    assert moving["interval"] * (moving["frames"] - 1) == pytest.approx(6.0)
    for key, values in (("shapes", frames.deflections), ("voltages", frames.voltages)):
        np.testing.assert_allclose(levels(moving[key]), values.ravel(), atol=np.abs(values).max() / 60_000)
    assert len(levels(moving["ghost"])) == frames.deflections.size
    assert [len(moving[k]) for k in ("beams", "patches", "springs", "points")] == [3, 4, 2, 4]


def test_run_without_shapes_has_no_animation(tracking):
    still = report_html(replace(tracking, recording=replace(tracking.recording, frames=None)))
    assert 'id="beams"' not in still
    assert data_of(still)["animation"] is None


def test_equal_runs_give_equal_pages(page, settings):
    assert without_timing(report_html(run_scenario("tracking", settings))) == without_timing(page)


@pytest.mark.parametrize(
    "hostile",
    ["<script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "</script><b>", "{{ 7 * 7 }} {% raw %}", "<!--"],
)
def test_hostile_texts_stay_texts(page, tracking, hostile):
    scenario = replace(
        tracking.scenario, title=hostile, paper=hostile, figure=[replace(tracking.scenario.figure[0], title=hostile)]
    )
    checks = [{**c, "name": hostile, "paper": hostile} for c in tracking.summary["checks"]]
    metrics = {n: v for n, v in tracking.summary["metrics"].items() if n not in [c.name for c in scenario.check]}
    text = report_html(
        replace(
            tracking,
            scenario=scenario,
            description=f"{hostile} again",  # a description that repeats the title is left out
            name=hostile,
            summary={**tracking.summary, "checks": checks, "metrics": metrics},
        )
    )
    attacked, usual = Elements(text), Elements(page)
    assert [t for t, _ in attacked.tags] == [t for t, _ in usual.tags]
    assert hostile in attacked.inside("h1")
    assert data_of(text)["groups"][0]["title"] == hostile


def test_values_that_are_no_numbers_are_shown_as_missing(tracking):
    values = tracking.recording.values.copy()
    values[5:9, tracking.recording.columns.index("plant.y_pi[1]")] = np.nan
    checks = [{**c, "value": None, "passed": False} for c in tracking.summary["checks"]]
    text = report_html(
        replace(
            tracking,
            recording=replace(tracking.recording, values=values),
            summary={**tracking.summary, "checks": checks},
        )
    )
    assert "no value" in text
    assert data_of(text)


def test_complete_run_writes_a_report_and_an_incomplete_one_removes_it(tracking, tmp_path):
    write_run(tracking, tmp_path, figures=False)
    assert (tmp_path / "report.html").is_file()
    stopped = replace(tracking, recording=replace(tracking.recording, interrupted=True))
    write_run(stopped, tmp_path, figures=False)
    assert not (tmp_path / "report.html").exists()


def test_no_report_where_none_is_wanted(tracking, tmp_path):
    write_run(tracking, tmp_path, figures=False, report=False)
    assert not (tmp_path / "report.html").exists()
