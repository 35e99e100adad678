"""A comparison of many signals in headless Chromium: plots in view are drawn, a filter finds the others."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexbeams.scenarios.report.comparison import comparison_html
from flexbeams.scenarios.results.compare import Comparison, FinishedRun
from flexbeams.scenarios.simulation.recording import Recording
from tests.browser import chromium, needs_browser

pytestmark = [pytest.mark.browser, needs_browser]
COUNT = 60
ARRAYS = ["plant.y_pi", "plant.u", "plant.y_pm"]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    time = np.linspace(0.25, 6.5, 200)
    columns = [f"{name}[{k}]" for name in ARRAYS for k in range(1, COUNT + 1)]
    runs = [
        FinishedRun(
            label=label,
            folder=Path(label),
            summary={},
            recording=Recording(
                time=time,
                columns=columns,
                values=np.sin(np.outer(time, np.linspace(rate, 3.0, len(columns)))),
                wall_seconds=1.0,
            ),
        )
        for label, rate in (("a", 1.0), ("b", 1.1))
    ]
    file = tmp_path_factory.mktemp("many") / "compare.html"
    file.write_text(comparison_html(Comparison(runs=runs, arrays=ARRAYS, signals=columns, left_out=[]), "a and b"))
    with chromium() as browser:
        opened = browser.new_page(viewport={"width": 1440, "height": 900})
        opened.on("pageerror", lambda error: pytest.fail(str(error)))
        opened.goto(file.as_uri())
        yield opened


def settled(page: Any) -> int:
    """Number of plots when all in view are drawn and no more follow."""
    count = -1
    for _ in range(200):
        page.wait_for_timeout(100)
        now = page.evaluate("plots.length")
        if now == count and now and all(drawn_in_view(page)):
            return int(now)
        count = now
    raise AssertionError("plots are drawn without end")


def drawn_in_view(page: Any) -> list[bool]:
    return list(
        page.evaluate("""[...document.querySelectorAll(".panel")].filter(box => {
            const r = box.getBoundingClientRect();
            return !box.hidden && r.height && r.bottom > 0 && r.top < innerHeight;
        }).map(box => !!box.querySelector("canvas"))""")
    )


def test_plots_near_the_visible_part_are_drawn(page: Any) -> None:
    assert settled(page) < COUNT
    assert all(drawn_in_view(page))
    assert page.evaluate("[document.getElementById('from').value, document.getElementById('to').value]") == [
        "0.25",
        "6.5",
    ]
    page.evaluate("scrollTo(0, document.body.scrollHeight / 2)")
    settled(page)
    seen = drawn_in_view(page)
    assert seen
    assert all(seen)


def test_a_filter_finds_signals(page: Any) -> None:
    page.fill("#filter", f"pair {COUNT}")
    settled(page)
    shown = page.evaluate("[...document.querySelectorAll('.panel')].filter(b => !b.hidden).map(b => b.textContent)")
    assert [text for text in shown if "patch pair 60" not in text] == []
    assert len(shown) == 2  # the pair, and its difference
    assert page.inner_text("#found") == f"2 of {3 * COUNT + 2 * COUNT}"
    page.fill("#filter", "")
    assert page.evaluate("[...document.querySelectorAll('.panel, details')].filter(b => b.hidden).length") == 0


def test_groups_fold(page: Any) -> None:
    group = page.locator("details.group").first
    before = group.bounding_box()["height"]
    group.locator("summary").click()
    assert group.bounding_box()["height"] < before / 10
    page.fill("#filter", "point 7")
    assert group.evaluate("element => element.open")


def test_paper_has_every_plot(page: Any) -> None:
    page.fill("#filter", "")
    group = page.locator("details.group").nth(1)
    group.locator("summary").click()
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate("plots.length === data.groups.flatMap(g => g.panels).length")
    assert page.evaluate("[...document.querySelectorAll('details.group')].every(g => g.open)")
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert not group.evaluate("element => element.open")
