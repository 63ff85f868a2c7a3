"""The filter of a report's page, and the address that stores it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from chromium import launched, opened, written
from playwright.sync_api import Browser, Page, expect
from report_example import EXAMPLE

UPRIGHT = "evaluation-upright"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as browser:
        yield browser


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(EXAMPLE, tmp_path_factory.mktemp("report") / "report.html")


@pytest.fixture(scope="module")
def loaded(browser: Browser, example: Path) -> Iterator[Page]:
    with opened(browser, example) as page:
        yield page


@pytest.fixture
def page(loaded: Page) -> Page:
    """Return the page with a filter that accepts everything."""
    loaded.get_by_role("button", name="Clear").click()
    loaded.locator("#count", has_text="3 requirements, 37 runs listed").wait_for()
    return loaded


def articles(page: Page) -> list[str]:
    shown = page.locator("article.requirement:visible")
    return [str(each) for each in shown.evaluate_all("all => all.map(each => each.id)")]


def runs(page: Page, article: str) -> list[str]:
    rows = page.locator(f"#{article} table.sortable tbody tr:visible th")
    return [str(each) for each in rows.all_inner_texts()]


def test_a_requirement_is_chosen(page: Page) -> None:
    page.locator("select[name=requirement]").select_option("upright")
    assert articles(page) == [UPRIGHT, "comparison-upright"]
    assert page.locator("li[data-glance]:visible").count() == 2
    assert page.locator("section.result:visible h2").count() == 2
    assert page.locator("#count").inner_text() == "1 of 3 requirements, 20 of 37 runs listed"
    page.locator("select[name=requirement]").select_option("dry")
    assert articles(page) == ["sweep-dry", "search-dry", "matrix-dry"]
    assert page.locator("table.matrix tbody tr:visible").count() == 3


@pytest.mark.parametrize("verdict", ["satisfied", "violated", "undecided", "failed"])
def test_a_verdict_is_chosen(page: Page, verdict: str) -> None:
    page.get_by_label("Verdict").select_option(verdict)
    requirements = {
        f"{section.kind}-{r.name}": [t.label for t in r.trials if t.verdict == verdict]
        for section in EXAMPLE.sections
        for r in section.requirements
    }
    wanted = {name: labels for name, labels in requirements.items() if labels}
    assert articles(page) == list(wanted)
    assert {name: runs(page, name) for name in wanted} == {
        name: labels[:10] for name, labels in wanted.items()
    }
    traces = page.locator("table.matrix tbody tr:visible")
    assert traces.count() == (0 if verdict == "undecided" else 1)
    # A requirement of several results and an episode of several requirements count once.
    names = {name.partition("-")[2] for name in wanted}
    count = len({(name.partition("-")[0], each) for name, of in wanted.items() for each in of})
    assert page.locator("#count").inner_text() == (
        f"{len(names)} of 3 requirements, {count} of 37 runs listed"
    )


def test_text_is_found_in_names_words_formulas_and_runs(page: Page) -> None:
    text = page.get_by_label("Text")
    text.fill("ABS(angle)")
    assert articles(page) == [UPRIGHT, "comparison-upright"]
    assert len(runs(page, UPRIGHT)) == 10
    text.fill("simulator stopped")
    assert articles(page) == [UPRIGHT, "evaluation-centred"]
    assert runs(page, UPRIGHT) == ["seed 4"]
    text.fill("-0.2012")
    assert runs(page, UPRIGHT) == ["seed 17"]
    text.fill("runs/b.csv")
    assert articles(page) == ["matrix-dry"]
    assert page.locator("table.matrix tbody tr:visible").count() == 1
    text.fill("no such thing")
    assert articles(page) == []
    assert page.locator("#nothing").is_visible()
    assert page.locator("#count").inner_text() == "0 of 3 requirements, 0 of 37 runs listed"


def test_the_address_restores_filter_and_position(
    page: Page, browser: Browser, example: Path
) -> None:
    page.locator("select[name=requirement]").select_option("upright")
    page.get_by_label("Verdict").select_option("violated")
    page.get_by_label("Text").fill("seed & 50%")
    page.get_by_label("Text").fill("seed")
    # By the keyboard: charts that are drawn late may move the link under a mouse.
    page.locator(f"#{UPRIGHT}").get_by_role("link", name="seed 9").press("Enter")
    fragment = page.evaluate("location.hash")
    assert fragment == (
        "#text=seed&requirement=upright&verdict=violated&at=evaluation-upright-seed-9"
    )
    with opened(browser, example, fragment) as again:
        assert again.get_by_label("Text").input_value() == "seed"
        assert again.locator("select[name=requirement]").input_value() == "upright"
        assert again.get_by_label("Verdict").input_value() == "violated"
        assert runs(again, UPRIGHT) == ["seed 17", "seed 9"]
        row = again.locator("#evaluation-upright-seed-9.at")
        expect(row).to_be_in_viewport()


def test_a_link_to_a_run_beyond_the_first_ten_shows_it(browser: Browser, example: Path) -> None:
    with opened(browser, example, "#evaluation-upright-seed-19") as page:
        row = page.locator("#evaluation-upright-seed-19")
        expect(row).to_be_in_viewport()
        assert len(runs(page, UPRIGHT)) == 20
