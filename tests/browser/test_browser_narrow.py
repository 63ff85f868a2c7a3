"""Nothing on the page is cut, on a phone and on a screen: the browser measures the boxes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from chromium import draw_all, launched, opened, written
from playwright.sync_api import Browser, Page
from report_example import EXAMPLE

BEYOND = """() => [...document.querySelectorAll("body *")]
  .filter(each => each.getClientRects().length && !each.closest(".scroll") && !each.ownerSVGElement)
  .filter(each => each.getBoundingClientRect().right > -500)  // where Plotly measures texts
  .filter(each => !each.matches(".unseen, .skip"))
  .map(each => [each.outerHTML.slice(0, 80), each.getBoundingClientRect()])
  .filter(([, box]) => box.left < -0.5 || box.right > innerWidth + 0.5)
  .map(([text, box]) => [text, box.left, box.right])"""
"""Elements that extend beyond the window, except scrollable tables."""

CUT = """() => [...document.querySelectorAll(".plot")].flatMap(plot => {
  const room = plot.getBoundingClientRect();
  return [...plot.querySelectorAll("text")]
    .map(each => [each.textContent, each.getBoundingClientRect()])
    .filter(([text, box]) => text && box.width)
    .filter(([, box]) => box.left < room.left - 1 || box.right > room.right + 1
      || box.top < room.top - 1 || box.bottom > room.bottom + 1)
    .map(([text, box]) => [plot.dataset.chart, text, box.left - room.left, room.right - box.right]);
})"""
"""Texts of charts that their charts cut."""

COVERED = """() => [...document.querySelectorAll(".plot")].flatMap(plot => {
  const ticks = [...plot.querySelectorAll(".xaxislayer-above")].map(axis =>
    [...axis.querySelectorAll(".xtick text")].map(each => each.getBoundingClientRect())
      .filter(box => box.width).sort((a, b) => a.left - b.left));
  return ticks.flatMap(boxes => boxes.slice(1)
    .filter((box, i) => box.left < boxes[i].right - 1 && Math.abs(box.top - boxes[i].top) < 5)
    .map(box => [plot.dataset.chart, box.left]));
})"""
"""Overlapping labels of an axis."""

INTERVALS = """() => [...document.querySelectorAll("svg.interval")]
  .filter(each => each.getClientRects().length)
  .map(each => {
    const scroll = each.closest(".scroll");
    const room = scroll ? scroll.getBoundingClientRect() : {left: 0, right: innerWidth};
    const boxes = [each, ...each.querySelectorAll("line, circle")]
      .map(part => part.getBoundingClientRect());
    return {
      width: each.getBoundingClientRect().width,
      left: Math.min(...boxes.map(box => box.left)) - room.left,
      right: Math.min(room.right, innerWidth) - Math.max(...boxes.map(box => box.right)),
    };
  })"""
"""The width of each interval, and the space next to it."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as browser:
        yield browser


@pytest.fixture(scope="module", params=[390, 1280])
def page(
    request: pytest.FixtureRequest, browser: Browser, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Page]:
    path = written(EXAMPLE, tmp_path_factory.mktemp("report") / "report.html")
    with opened(browser, Path(path), width=request.param) as page:
        draw_all(page)
        yield page


def test_no_element_is_wider_than_the_window(page: Page) -> None:
    assert page.evaluate(BEYOND) == []
    assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0


def test_no_text_of_a_chart_is_cut_and_no_label_covers_another(page: Page) -> None:
    assert page.locator(".plot text").count() > 100
    assert page.evaluate(CUT) == []
    assert page.evaluate(COVERED) == []


def test_intervals_are_whole_and_wide_enough_to_read(page: Page) -> None:
    found: list[dict[str, Any]] = page.evaluate(INTERVALS)
    assert len(found) == 2 + 2 + 1 + 3  # at a glance, of requirements, of the comparison
    for each in found:
        assert each["width"] >= 100
        assert each["left"] >= -0.5
        assert each["right"] >= -0.5


def test_tables_of_numbers_fit_where_they_are_opened(page: Page) -> None:
    page.locator("details.numbers").evaluate_all("all => all.forEach(each => each.open = true)")
    assert page.evaluate(BEYOND) == []
    wide = page.locator(".chart:not(.episode):not(.map) .numbers .scroll, .rates").evaluate_all(
        "all => all.map(each => each.closest('.scroll'))"
        ".map(each => each.scrollWidth - each.clientWidth)"
    )
    assert len(wide) > 5
    assert max(wide) <= 1
