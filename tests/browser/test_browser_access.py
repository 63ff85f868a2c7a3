"""The page for everyone: rules of axe, the keyboard, narrow screens, no script, hostile names."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from axe_playwright_python.base import AXE_SCRIPT
from chromium import draw_all, launched, opened, written
from playwright.sync_api import Browser, Page
from report_example import EXAMPLE

from rtamt.errors import shown
from rtamt_gym.reports.model import Figure, Report, Section, Text

EVALUATION = EXAMPLE.sections[0]
UPRIGHT = EVALUATION.requirements[0]
HOSTILE = (
    "</script><img src=x onerror=alert(1)>",
    "<!--<script>",
    '"\' onmouseover="alert(1)" x=\'',
    "{{ 7 * 7 }} %{y} ${1} &amp; &lt;b&gt;",
    "Geschwindigkeit höher 速度 \N{ROCKET} \u202ereversed\u2028line",
    "very_long_name_" * 20,
)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with launched() as browser:
        yield browser


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(EXAMPLE, tmp_path_factory.mktemp("report") / "report.html")


def faults(page: Page) -> list[Any]:
    """Return the serious or critical faults that axe finds."""
    page.evaluate(AXE_SCRIPT)
    # A chart is one image with a text, its caption.
    found = page.evaluate("axe.run({exclude: ['.plot .plot-container']})")
    assert len(found["passes"]) > 20
    return [
        (each["id"], [node["target"] for node in each["nodes"]])
        for each in found["violations"]
        if each["impact"] in {"serious", "critical"}
    ]


def beyond(page: Page) -> int:
    """Return the pixels by which the page is wider than the window."""
    found: int = page.evaluate("document.documentElement.scrollWidth - innerWidth")
    return found


@pytest.mark.parametrize(("theme", "width"), [("light", 1280), ("dark", 390)])
def test_axe_finds_nothing_serious_and_nothing_is_too_wide(
    browser: Browser, example: Path, theme: str, width: int
) -> None:
    with opened(browser, example, theme=theme, width=width) as page:
        if width > 1000:
            draw_all(page)
        assert beyond(page) <= 0
        page.locator("details").evaluate_all("all => all.forEach(each => each.open = true)")
        assert beyond(page) <= 0
        page.locator("[data-samples]").evaluate_all("all => all.forEach(each => each.open = false)")
        assert faults(page) == []


def test_the_keyboard_reaches_everything_and_leaves_it(browser: Browser, tmp_path: Path) -> None:
    small = replace(EXAMPLE, sections=(replace(EVALUATION, requirements=(UPRIGHT,)),))
    with opened(browser, written(small, tmp_path / "small.html")) as page:
        walk = page.evaluate("document.querySelectorAll('*').length") and []
        for _ in range(200):
            page.keyboard.press("Tab")
            here = page.evaluate(
                """() => {
                  const at = document.activeElement;
                  if (at === document.body) return null;
                  const style = getComputedStyle(at);
                  return [
                    at.id || at.name || at.className || at.textContent.trim(),
                    style.outlineStyle !== "none" && parseFloat(style.outlineWidth) >= 1,
                    at.checkVisibility(),
                  ];
                }"""
            )
            if here is None:
                break
            walk.append(here)
        assert here is None
        names = [name for name, _, _ in walk]
        assert names[:2] == ["skip", "theme"]
        assert names[2:6] == ["text", "requirement", "verdict", "Clear"]
        assert [name for name, outlined, visible in walk if not (outlined and visible)] == []
        # A link and a copied command per row, a button per head, and one to show all.
        assert len([name for name in names if name == "copy"]) == 11
        assert names.count("more") == 1
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        assert page.evaluate("document.activeElement.id") == "main"


def test_headings_are_in_order_and_landmarks_there(browser: Browser, example: Path) -> None:
    with opened(browser, example) as page:
        levels = page.locator("h1, h2, h3, h4, h5, h6").evaluate_all(
            "all => all.map(each => Number(each.tagName[1]))"
        )
        assert levels[:3] == [1, 2, 3]
        assert max(b - a for a, b in pairwise(levels)) == 1
        for role in ("banner", "search", "main", "contentinfo"):
            assert page.get_by_role(role).count() == 1
        captions = page.locator("[data-chart]").evaluate_all(
            "all => all.map(e => e.getAttribute('aria-labelledby'))"
            ".map(id => document.getElementById(id).innerText)"
        )
        assert min(map(len, captions)) > 30


def test_without_script_text_and_tables_are_there(browser: Browser, example: Path) -> None:
    with opened(browser, example, width=390, java_script_enabled=False) as page:
        text = page.locator("body").inner_text()
        assert "Charts, the filter and sorting need JavaScript." in text
        assert UPRIGHT.words in text
        assert "85 % 64 to 95 %" in text
        for trial in UPRIGHT.trials:
            assert trial.label in text
        assert page.get_by_role("button").count() == 0


def test_hostile_names_are_text(browser: Browser, tmp_path: Path) -> None:
    episode = UPRIGHT.worst[0]
    requirements = tuple(
        replace(
            UPRIGHT,
            name=name,
            words=name,
            formula=name,
            blocks=(Text(name),),
            trials=(replace(UPRIGHT.trials[1], label=name, text=name, case=(name,)),),
            worst=(
                replace(
                    episode,
                    label=name,
                    signals={name: episode.times},
                    predicates={name: episode.robustness},
                    deciding=(
                        replace(
                            episode.deciding[0], predicate=name, words=name, values={name: 1.0}
                        ),
                    ),
                    explanation=name,
                ),
            ),
        )
        for name in HOSTILE
    )
    sweep = EXAMPLE.sections[1]
    assert sweep.cases
    drawn = [each for each in sweep.requirements[0].figures if isinstance(each, Figure)]
    others = [each for each in drawn if each.kind != "map"]
    (heat,) = (each for each in drawn if each.kind == "map")
    maps = [replace(heat, data={**heat.data, "x": name, "y": name}) for name in HOSTILE]
    varied = replace(
        sweep,
        title=HOSTILE[0],
        requirements=(replace(sweep.requirements[0], figures=(*others, *maps)),),
        cases={
            **sweep.cases,
            "columns": dict.fromkeys(HOSTILE, sweep.cases["columns"]["leak"]),
            "labels": (HOSTILE[0],) * 9,
        },
    )
    hostile = Report(
        HOSTILE[0], HOSTILE[2], (replace(EVALUATION, requirements=requirements), varied)
    )
    with opened(browser, written(hostile, tmp_path / "hostile.html"), width=390) as page:
        draw_all(page)
        assert page.locator("h1").inner_text() == HOSTILE[0]
        assert page.locator("body img").count() == 6  # the frames of the six episodes
        assert page.locator("[onerror], [onmouseover]").count() == 0
        assert page.title() == HOSTILE[0]
        found = page.locator("article.requirement").evaluate_all(
            "all => all.map(e => [e.dataset.requirement, e.querySelector('code').textContent])"
        )
        assert found[: len(HOSTILE)] == [[shown(name)] * 2 for name in HOSTILE]
        titles = page.locator("figure.episode .annotation-text").evaluate_all(
            "all => all.map(each => each.textContent)"
        )
        assert HOSTILE[0] in titles
        assert HOSTILE[3] in titles
        assert beyond(page) <= 0
        page.locator("select[name=requirement]").select_option(HOSTILE[2])
        assert page.locator("article.requirement:visible").count() == 1


def test_infinite_empty_single_and_many(browser: Browser, tmp_path: Path) -> None:
    none = replace(
        UPRIGHT,
        name="none",
        rate=0.0,
        interval=(0.0, 1.0),
        trials=(),
        worst=(),
    )
    episode = UPRIGHT.worst[0]
    endless = (math.inf,) * len(episode.times)
    infinite = replace(
        UPRIGHT,
        name="infinite",
        trials=tuple(
            replace(trial, robustness=math.inf if trial.verdict == "satisfied" else -math.inf)
            for trial in UPRIGHT.trials
        ),
        worst=(
            replace(episode, robustness=endless, upper=endless, predicates={"p": endless}),
            replace(episode, label="short", **_first(episode)),
        ),
    )
    single = replace(
        UPRIGHT,
        name="single",
        trials=(replace(UPRIGHT.trials[-1], robustness=0.0),),
        worst=(),
    )
    many = tuple(replace(UPRIGHT, name=f"r{i}", worst=()) for i in range(30))
    report = Report(
        "edges",
        "rtamt",
        (
            replace(EVALUATION, requirements=(none, infinite, single)),
            Section("evaluation", "thirty", requirements=many),
            Section("sweep", "nothing"),
        ),
    )
    with opened(browser, written(report, tmp_path / "edges.html")) as page:
        for kind in ("histogram", "episode"):
            for plot in page.locator(f"#evaluation figure.{kind} .plot").all():
                plot.scroll_into_view_if_needed()
                plot.locator(".main-svg").first.wait_for()
        assert page.locator("#count").inner_text() == "33 requirements, 40 runs"
        assert page.locator("[data-chart]").count() == 4 + 1 + 2 * 30
        assert page.locator("#evaluation-none .rate").inner_text() == "nothing evaluated"
        assert beyond(page) <= 0


def _first(episode: Any) -> dict[str, Any]:  # noqa: ANN401 - an episode of one sample
    series = ("times", "robustness", "lower", "upper")
    return {
        **{name: getattr(episode, name)[:1] for name in series},
        **{
            name: {key: values[:1] for key, values in getattr(episode, name).items()}
            for name in ("signals", "predicates")
        },
        "deciding": (),
        "decided_at": None,
        "frames": (),
    }
