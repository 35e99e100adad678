"""The page of a design, as text and in Chromium."""

import re
from functools import cache
from pathlib import Path

import pytest

from flexbeams.controller.analysis import analyse
from flexbeams.scenarios.report.design import design_html
from tests.browser import chromium, needs_browser
from tests.helpers import design_of


@cache
def page() -> str:
    return design_html(analyse(design_of()), "kiel")


@pytest.mark.slow
def test_the_page_is_complete_alone_and_shows_the_figures() -> None:
    text = page()
    assert not re.search(r'(src|href)="(?!#|data:)', text)
    assert "Stable on both plants" in text
    for value in ("1.155", "1.184", "39.54", design_of().design_id, "1: 14.6 rad/s"):
        assert value in text
    assert text == design_html(analyse(design_of()), "kiel")


@pytest.mark.browser
@needs_browser
def test_every_chart_is_drawn_and_nothing_overflows(tmp_path: Path) -> None:
    """Wide and narrow, light and dark, in print; a name switches its curve."""
    file = tmp_path / "design.html"
    file.write_text(page(), encoding="utf-8")
    with chromium() as browser:
        for width, scheme in ((1280, "light"), (390, "dark")):
            opened = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
            complaints: list[str] = []
            opened.on("console", lambda message, kept=complaints: kept.append(message.text))
            opened.on("pageerror", lambda error, kept=complaints: kept.append(str(error)))
            opened.goto(file.as_uri())
            count = opened.evaluate("Object.values(data.charts).flat().length")
            assert count == 6 + 2 + 1 + 20 + 1
            opened.locator(".panel canvas").nth(count - 1).wait_for(state="attached")
            assert opened.evaluate("document.documentElement.scrollWidth") <= width
            assert opened.evaluate("document.documentElement.dataset.theme") == scheme
            name = opened.locator(".curves button").first
            name.click()
            assert name.get_attribute("aria-pressed") == "false"
            opened.emulate_media(media="print")
            assert not complaints
