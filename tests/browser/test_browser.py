"""The page of a report in a browser: charts, their values, sorting, themes, paper."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from chromium import draw_all, launched, opened, written
from playwright.sync_api import Browser, Page, expect
from report_example import EXAMPLE

EPISODE = EXAMPLE.sections[0].requirements[0].worst[0]
DECIDED = EPISODE.decided_at.time if EPISODE.decided_at else None
PLOT = "#evaluation-upright-worst-seed-17 .plot"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as browser:
        yield browser


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(EXAMPLE, tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture(scope="module")
def page(browser: Browser, example: Path) -> Iterator[Page]:
    with opened(browser, example) as page:
        draw_all(page)
        yield page


def shown(value: float) -> str:
    """Return a number as the page writes it."""
    return f"{value:.5g}".replace("-", "\N{MINUS SIGN}")


def test_every_chart_is_drawn(page: Page) -> None:
    kinds = page.locator("figure.chart").evaluate_all(
        "all => all.map(each => [each.classList[1], each.querySelectorAll('.trace').length])"
    )
    assert {kind for kind, _ in kinds} == {
        *("histogram", "violations", "episode", "map", "cases", "convergence", "pairs", "timeline")
    }
    assert [kind for kind, traces in kinds if not traces and kind != "map"] == []
    assert page.locator("figure.map .hm image").count() == 2  # known, and undecided next to it


@pytest.mark.parametrize("share", [0.25, 0.75])
def test_a_hover_shows_the_values_of_signals_and_robustness(page: Page, share: float) -> None:
    plot = page.locator(PLOT)
    plot.scroll_into_view_if_needed()
    box = plot.locator(".nsewdrag").first.bounding_box()
    assert box
    i = round(share * (len(EPISODE.times) - 1))
    page.mouse.move(box["x"] + 2, box["y"] + 2)
    page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2, steps=3)
    hover = plot.locator(".hoverlayer .legend")
    hover.get_by_text(f"{EPISODE.times[i]:g} s").wait_for()
    wanted = {
        "angle": EPISODE.signals["angle"][i],
        "position": EPISODE.signals["position"][i],
        "robustness": EPISODE.robustness[i],
        "abs(angle) < 0.2": EPISODE.predicates["abs(angle) < 0.2"][i],
    }
    lines = hover.locator(".legendtext").all_text_contents()
    assert [f"{name}: {shown(value)}" in lines for name, value in wanted.items()] == [True] * 4
    assert "at least: \N{MINUS SIGN}\N{INFINITY}" in lines
    read = page.locator("#evaluation-upright-worst-seed-17 output").inner_text()
    assert [shown(value) in read for value in wanted.values()] == [True] * 4


def test_a_hover_over_a_bar_counts(page: Page) -> None:
    plot = page.locator("#evaluation-upright-histogram .plot")
    plot.scroll_into_view_if_needed()
    bar = plot.locator(".point path").first.bounding_box()
    assert bar
    page.mouse.move(bar["x"] + bar["width"] / 2, bar["y"] + bar["height"] / 2, steps=3)
    said = plot.locator(".hoverlayer .hovertext")
    expect(said).to_have_text("\N{MINUS SIGN}0.25 to \N{MINUS SIGN}0.2: 1 episode violated")


def test_the_slider_shows_values_and_the_frame_of_its_time(page: Page) -> None:
    worst = page.locator("#evaluation-upright-worst-seed-17")
    slider = worst.locator("input[type=range]")
    for key, i in (("Home", 0), ("ArrowRight", 1), ("End", len(EPISODE.times) - 1)):
        slider.press(key)
        said = slider.get_attribute("aria-valuetext") or ""
        assert said.startswith(
            f"{EPISODE.times[i]:g} s, angle {shown(EPISODE.signals['angle'][i])}, "
        )
        frame = max(f.time for f in EPISODE.frames if f.time <= EPISODE.times[i])
        assert worst.locator("img").get_attribute("alt") == f"the pole at {frame:g} s"


def test_the_first_words_of_the_plot_name_violation_and_deciding_samples(page: Page) -> None:
    plot = page.locator(PLOT)
    notes = plot.locator(".annotation-text").all_text_contents()
    assert notes == [
        *("angle", "position", "robustness if it ended now, and what it can still become"),
        *("margin of abs(angle) < 0.2", f"✗ violated at {DECIDED:g} s"),
    ]
    diamonds = plot.evaluate(
        "plot => plot.data.filter(each => each.name === 'decides').map(each => [each.x, each.y])"
    )
    (decision,) = EPISODE.deciding
    assert diamonds == [
        [[decision.time], [decision.values["angle"]]],
        [[decision.time], [decision.robustness]],
    ]


def test_a_table_sorts_and_shows_all(page: Page) -> None:
    table = page.locator("#evaluation-upright table.sortable")
    rows = table.locator("tbody tr:visible")
    trials = EXAMPLE.sections[0].requirements[0].trials
    assert rows.count() == 10
    page.locator("#evaluation-upright").get_by_role("button", name="Show all 20").click()
    assert rows.count() == len(trials)
    labels = rows.locator("th")
    assert labels.all_inner_texts() == [trial.label for trial in trials]
    head = table.locator("th", has_text="return")
    key = {trial.label: trial.reward for trial in trials}
    known = [reward for reward in key.values() if reward is not None]
    for direction, wanted in (
        ("ascending", sorted(known)),
        ("descending", sorted(known, reverse=True)),
    ):
        head.get_by_role("button").click()
        assert head.get_attribute("aria-sort") == direction
        assert [key[label] for label in labels.all_inner_texts()] == [*wanted, None]
    head.get_by_role("button").click()
    assert head.get_attribute("aria-sort") is None
    assert labels.all_inner_texts() == [trial.label for trial in trials]


def test_the_samples_become_a_table(page: Page) -> None:
    details = page.locator("#evaluation-upright-worst-seed-17 [data-samples]")
    details.locator("summary").click()
    rows = details.locator("tbody tr")
    expect(rows).to_have_count(len(EPISODE.times))  # once the browser reports it as open
    assert rows.nth(64).locator("td").all_inner_texts() == [
        *(shown(EPISODE.times[64]), shown(EPISODE.signals["angle"][64])),
        *(shown(EPISODE.signals["position"][64]), shown(EPISODE.robustness[64])),
        *("\N{MINUS SIGN}\N{INFINITY}", shown(EPISODE.upper[64])),
        shown(EPISODE.predicates["abs(angle) < 0.2"][64]),
    ]


LOOK = """() => [
  getComputedStyle(document.body).backgroundColor,
  getComputedStyle(document.body).color,
  getComputedStyle(document.querySelector("figure.histogram .xtick text")).fill,
  getComputedStyle(document.querySelector("figure.episode .scatterlayer .js-line")).stroke,
]"""


def test_dark_changes_page_and_charts_and_the_switch_changes_back(page: Page) -> None:
    def wait_for(look: object) -> None:  # charts are drawn again at a later event of the browser
        page.wait_for_function(f"look => `${{({LOOK})()}}` === `${{look}}`", arg=look)

    light = page.evaluate(LOOK)
    page.emulate_media(color_scheme="dark", reduced_motion="reduce")
    page.wait_for_function(
        f"light => ({LOOK})().every((each, at) => each !== light[at])", arg=light
    )
    dark = page.evaluate(LOOK)
    button = page.locator("#theme")
    assert button.get_attribute("aria-pressed") == "true"
    button.click()
    wait_for(light)
    assert button.get_attribute("aria-pressed") == "false"
    page.emulate_media(color_scheme="light", reduced_motion="reduce")
    button.click()
    wait_for(dark)
    button.click()
    wait_for(light)


def test_paper_is_light_and_hides_nothing(browser: Browser, example: Path) -> None:
    with opened(browser, example, theme="dark") as page:
        page.emulate_media(media="print", color_scheme="dark", reduced_motion="reduce")
        page.locator("[data-chart]").last.locator(".main-svg").first.wait_for()
        for part in ("[data-chart] .main-svg:first-of-type", "table.sortable tbody tr"):
            found = page.locator(part).evaluate_all(
                "all => all.map(each => each.getClientRects().length > 0)"
            )
            assert len(found) > 10
            assert all(found)
        hidden = page.locator("details:not([data-samples]) > :not(summary)").evaluate_all(
            "all => all.filter(each => !each.checkVisibility({contentVisibilityAuto: true}))"
            ".map(each => each.outerHTML)"
        )
        assert hidden == []
        assert (
            page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
        )
        wide = page.locator("[data-chart]").evaluate_all(
            "all => Math.max(...all.map(each => each._fullLayout.width))"
        )
        assert wide == 680
        page.emulate_media(media="screen", color_scheme="dark", reduced_motion="reduce")
        assert page.pdf(format="A4").startswith(b"%PDF")
