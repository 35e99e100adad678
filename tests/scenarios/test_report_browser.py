"""The pages in headless Chromium: no complaint, no request, plots, animation, themes, keyboard, phone."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from flexbeams.scenarios.definition.settings import Settings
from flexbeams.scenarios.report.comparison import write_comparison
from flexbeams.scenarios.results.compare import compare
from flexbeams.scenarios.results.run import Run
from flexbeams.scenarios.runs.files import write_run
from flexbeams.scenarios.runs.scenario import run_scenario
from tests.browser import chromium, needs_browser

FEW = 24  # plots of a page that draws them all at once
pytestmark = [
    pytest.mark.native,
    pytest.mark.browser,
    needs_browser,
]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as started:
        yield started


@pytest.fixture(scope="module")
def tracking(run_folder) -> Run:
    return run_scenario("tracking", Settings(build_folder=run_folder / "build/fmus"))


@pytest.fixture(scope="module")
def report(tracking, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("tracking")
    write_run(tracking, folder, figures=False)
    return folder / "report.html"


class Opened:
    """A page with what it complained of and what it asked for."""

    def __init__(self, page: Any, file: Path) -> None:
        self.page, self.complaints, self.requests = page, [], []
        page.on("console", lambda message: self.complaints.append(message.text))
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))
        page.route("**/*", lambda route: route.continue_() if route.request.url == file.as_uri() else route.abort())
        page.goto(file.as_uri())
        self.wait(f"(n => n > {FEW} || plots.length === n)(data.groups.flatMap(g => g.panels).length)")

    def wait(self, expression: str) -> None:
        """Until an expression holds; the page's own rules forbid Playwright's wait_for_function."""
        for _ in range(200):
            if self.page.evaluate(expression):
                return
            self.page.wait_for_timeout(50)
        raise AssertionError(f"never came true: {expression}")

    def picture(self, selector: str) -> str:
        """The content of the first canvas under a selector."""
        return str(self.page.evaluate("s => document.querySelector(s).toDataURL()", selector))

    def changes(self, selector: str, act: Callable[[], object]) -> bool:
        """Whether the canvas is another one after an action."""
        before = self.picture(selector)
        act()
        self.page.wait_for_timeout(100)
        return self.picture(selector) != before


@pytest.fixture
def opened(browser, report) -> Iterator[Callable[..., Opened]]:
    pages = []

    def make(file: Path = report, **context: Any) -> Opened:
        pages.append(browser.new_page(**context))
        return Opened(pages[-1], file)

    yield make
    for page in pages:
        page.close()


BEAMS, PLOT = "#beams", ".panel canvas"
SLIDER = "document.getElementById('time')"


def test_report_loads_without_complaint_or_request(opened, report):
    shown = opened()
    assert shown.complaints == []
    assert shown.requests == [report.as_uri()]


def test_checks_are_complete(opened, tracking):
    rows = opened().page.locator("#checks tbody tr")
    assert rows.locator("th").all_inner_texts() == [check.name for check in tracking.scenario.check]
    assert rows.locator(".verdict").all_inner_texts() == ["holds"] * len(tracking.scenario.check)


def test_every_panel_is_drawn(opened):
    shown = opened()
    coloured = shown.page.evaluate("""() => [...document.querySelectorAll(".panel canvas")].map(canvas => {
        const d = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
        let count = 0;
        for (let i = 0; i < d.length; i += 4) if (d[i + 3] > 128 && Math.abs(d[i] - d[i + 2]) > 60) count++;
        return count;
    })""")
    assert len(coloured) == 11
    assert min(coloured) > 50


def test_all_plots_zoom_together(opened):
    shown = opened()
    page = shown.page
    assert shown.changes(PLOT, lambda: page.get_by_role("button", name="Zoom in").click())
    assert [page.input_value("#from"), page.input_value("#to")] == ["1.5", "4.5"]
    limits = page.evaluate("plots.map(p => [p.chart.scales.x.min, p.chart.scales.x.max])")
    assert limits == [[1.5, 4.5]] * 11
    page.get_by_role("button", name="0.5 … 4 s").click()
    assert page.input_value("#to") == "4"
    page.fill("#from", "2")
    page.press("#from", "Enter")
    assert page.evaluate("plots[3].chart.scales.x.min") == 2
    page.get_by_role("button", name="Whole run").click()
    assert page.evaluate("plots[5].chart.scales.x.max") == 6


def test_dragging_over_a_plot_zooms(opened):
    page = opened().page
    over = page.locator(".u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 4, box["y"] + 40)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + 60, steps=4)
    page.mouse.up()
    low, high = page.evaluate("[plots[7].chart.scales.x.min, plots[7].chart.scales.x.max]")
    assert low == pytest.approx(1.5, abs=0.1)
    assert high == pytest.approx(3.0, abs=0.1)
    over.dblclick()
    assert page.evaluate("plots[7].chart.scales.x.max") == 6


def test_keys_move_a_focused_plot(opened):
    page = opened().page
    page.locator(".plot").nth(2).focus()
    page.keyboard.press("+")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("plots[0].chart.scales.x.min") == pytest.approx(2.25)
    page.keyboard.press("0")
    assert page.evaluate("plots[0].chart.scales.x.min") == 0


def test_hovering_shows_values_in_all_plots(opened):
    page = opened().page
    over = page.locator(".u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 50)
    texts = page.locator(".panel").first.locator(".value").all_inner_texts()
    assert [text[:2] for text in texts] == ["-8", "-8"]
    assert all(page.locator(".value").all_inner_texts())


def test_names_below_a_plot_switch_its_curves(opened):
    shown = opened()
    button = shown.page.locator(".curves button").first
    assert shown.changes(PLOT, button.click)
    assert button.get_attribute("aria-pressed") == "false"
    button.focus()
    assert shown.changes(PLOT, lambda: shown.page.keyboard.press("Enter"))
    assert button.get_attribute("aria-pressed") == "true"


def test_animation_plays_and_pauses(opened):
    shown = opened()
    page, play = shown.page, shown.page.locator("#play")
    begin = float(page.input_value("#time"))
    assert shown.changes(BEAMS, lambda: (play.click(), shown.wait(f"{SLIDER}.value > {begin + 5}")))
    assert play.inner_text() == "Pause"
    play.click()
    assert not shown.changes(BEAMS, lambda: page.wait_for_timeout(200))


def test_animation_ends_and_begins_again(opened):
    shown = opened()
    page = shown.page
    page.select_option("#speed", "5")
    page.locator("#time").focus()
    page.keyboard.press("End")
    page.locator("#play").click()
    shown.wait(f"{SLIDER}.value > 5 && {SLIDER}.value < 250")
    shown.wait("document.getElementById('play').textContent === 'Play'")
    assert page.input_value("#time") == "300"


def test_animation_is_scrubbed(opened):
    shown = opened()
    scrub = shown.page.locator("#time")
    assert shown.changes(BEAMS, lambda: scrub.fill("55"))
    assert shown.page.locator("#clock").inner_text() == "1.10 s"
    assert scrub.get_attribute("aria-valuetext") == "1.10 s"
    marker = shown.page.locator(".now").first
    assert marker.is_visible()


def test_animation_answers_keys(opened):
    shown = opened()
    page = shown.page
    page.locator(BEAMS).focus()
    page.keyboard.press("Home")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    assert page.input_value("#time") == "11"
    page.keyboard.press(" ")
    shown.wait(f"{SLIDER}.value > 15")
    assert page.evaluate("scrollY") < 900
    page.keyboard.press(" ")
    assert page.locator("#play").inner_text() == "Play"


@pytest.mark.parametrize(
    "act",
    [
        lambda page: page.locator("#angle").fill("70"),
        lambda page: page.select_option("#exaggeration", "5"),
        lambda page: page.locator("#ghost").uncheck(),
    ],
)
def test_view_of_the_animation_changes(opened, act):
    shown = opened()
    assert shown.changes(BEAMS, lambda: act(shown.page))


def test_theme_follows_the_system_and_the_button(opened):
    background = "getComputedStyle(document.body).backgroundColor"
    shown = opened(color_scheme="dark")
    page = shown.page
    dark = page.evaluate(background)
    assert page.locator("#theme").inner_text() == "Light theme"
    assert shown.changes(BEAMS, page.locator("#theme").click)
    assert page.evaluate(background) != dark
    assert shown.changes(PLOT, page.locator("#theme").click)
    assert page.evaluate(background) == dark
    assert opened(color_scheme="light").page.evaluate(background) != dark


def test_every_control_has_a_name_and_a_place_in_the_tab_order(opened):
    page = opened().page
    nameless = page.evaluate("""() => [...document.querySelectorAll("button, input, select, canvas[tabindex]")].filter(
        e => !(e.getAttribute("aria-label") || e.textContent.trim() || e.labels?.length)
             || e.tabIndex < 0).map(e => e.outerHTML)""")
    assert nameless == []


@pytest.mark.parametrize("width", [390, 320])
def test_phone_does_not_scroll_sideways(opened, width):
    page = opened(viewport={"width": width, "height": 800}).page
    assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_print_is_light_and_has_no_controls(opened):
    page = opened(color_scheme="dark").page
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert not page.locator("#play").is_visible()
    assert not page.locator("#theme").is_visible()
    assert page.locator("#checks").is_visible()


def test_printed_plots_are_whole(opened):
    """On A4, whose text is 182 mm wide, each plot with its time axis is within its panel."""
    page = opened(viewport={"width": 688, "height": 900}).page
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    page.wait_for_timeout(200)
    wide = page.evaluate("""() => [...document.querySelectorAll(".panel")].filter(
        p => p.querySelector("canvas").getBoundingClientRect().right > p.getBoundingClientRect().right + 1).length""")
    assert wide == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= 688


def test_the_time_axis_has_a_unit_and_the_cursor_a_colour_of_its_own(opened):
    page = opened().page
    page.locator(".now").first.wait_for(state="attached")
    colours = page.evaluate("""() => {
        const root = getComputedStyle(document.documentElement);
        const names = ["time", "accent", ...[1, 2, 3, 4, 5, 6].map(k => `curve-${k}`)];
        return names.map(n => root.getPropertyValue(`--${n}`));
    }""")
    assert colours[0] not in colours[1:]
    assert 'label: "time in s"' in page.content()


def test_without_scripts_the_page_names_the_figures(browser, report, tracking):
    page = browser.new_page(java_script_enabled=False)
    page.goto(report.as_uri())
    text = page.locator("noscript").inner_text()
    page.close()
    assert "need JavaScript" in text
    for figure in tracking.scenario.figure:
        assert f"{figure.file}.png" in text


def test_report_without_reference_and_springs(opened, run_folder, tmp_path):
    settings = Settings(build_folder=run_folder / "build/fmus", stop_time=1.5)
    write_run(run_scenario("step_response", settings), tmp_path, figures=False)
    shown = opened(tmp_path / "report.html")
    assert shown.changes(BEAMS, lambda: shown.page.locator("#time").fill("10"))
    assert shown.page.locator("#ghost").count() == 0
    assert shown.complaints == []


def test_comparison_loads_without_complaint_or_request(opened, run_folder, tmp_path):
    settings = Settings(build_folder=run_folder / "build/fmus", stop_time=2.0)
    for name in ("feedforward", "tracking"):
        write_run(run_scenario(name, settings), tmp_path / name, figures=False, report=False)
    file = write_comparison(compare([tmp_path / "feedforward", tmp_path / "tracking"]), tmp_path)[0]
    shown = opened(file, viewport={"width": 390, "height": 800})
    assert shown.complaints == []
    assert shown.requests == [file.as_uri()]
    assert shown.page.locator("#checks tbody tr").count() > 3
    assert shown.page.evaluate("document.documentElement.scrollWidth") <= 390
    shown.page.locator("#signals").scroll_into_view_if_needed()
    shown.wait("document.querySelector('.panel canvas') !== null")
    assert shown.changes(PLOT, lambda: shown.page.locator("[data-zoom=in]").click())
