"""The page of a report as a text: it loads nothing, is complete, and stays small."""

import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from paths import ROOT
from report_example import EXAMPLE

from rtamt_gym.reports.figures import bins
from rtamt_gym.reports.html import PageIds, render
from rtamt_gym.reports.model import Report
from rtamt_gym.reports.numbers import aligned, number, percent

PAGE = ROOT / "rtamt_gym" / "reports" / "page"


class Elements(HTMLParser):
    """The elements of a page with their attributes, and the text in each."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str]]] = []
        self.texts: list[str] = []
        self._inside: list[str] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, {name: value or "" for name, value in attrs}))
        self.texts.append("")

    def handle_data(self, data: str) -> None:
        if self.texts:
            self.texts[-1] += data

    def of(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.found if name == tag]

    def text_of(self, tag: str) -> list[str]:
        pairs = zip(self.found, self.texts, strict=True)
        return [text for (name, _), text in pairs if name == tag]


@pytest.fixture(scope="module")
def page() -> Elements:
    return Elements(render(EXAMPLE))


def test_page_loads_nothing(page: Elements) -> None:
    loads = {"src", "srcset", "data", "action", "poster", "background"}
    assert [each for each in page.found if loads & set(each[1])] == []
    links = [attributes["href"] for _, attributes in page.found if "href" in attributes]
    assert [link for link in links if not link.startswith(("#", "data:,"))] == []
    policy = page.of("meta")[1]
    assert policy["http-equiv"] == "Content-Security-Policy"
    assert policy["content"].startswith("default-src 'none';")
    styles = "".join(path.read_text(encoding="utf-8") for path in PAGE.glob("*.css"))
    assert "url(" not in styles
    assert "@import" not in styles


def test_ids_are_unique_and_links_have_targets(page: Elements) -> None:
    ids = [attributes["id"] for _, attributes in page.found if "id" in attributes]
    assert len(ids) == len(set(ids)) > 50
    links = {attributes["href"][1:] for attributes in page.of("a")}
    named = {
        name
        for _, attributes in page.found
        for name in attributes.get("aria-labelledby", "").split()
    }
    assert links | named <= set(ids)


def test_page_has_data_of_charts(page: Elements) -> None:
    scripts = page.of("script")
    place = next(i for i, script in enumerate(scripts) if script.get("id") == "data")
    data = json.loads(page.text_of("script")[place])
    drawn = [each["data-chart"] for _, each in page.found if "data-chart" in each]
    assert drawn == list(data["charts"])
    episode = data["charts"]["evaluation-upright-worst-seed-17-episode"]
    assert episode["lower"] == ["-inf"] * 101
    signals = EXAMPLE.sections[0].requirements[0].worst[0].signals
    assert episode["signals"] == {name: [*values] for name, values in signals.items()}


@pytest.mark.slow
def test_names_cannot_end_the_script() -> None:
    section = EXAMPLE.sections[0]
    name = "</script><script>alert(1)</script><!--"
    hostile = replace(section.requirements[0], name=name, words=name, formula=name)
    plain = Elements(render(Report("x", "y", (replace(section, requirements=(hostile,)),))))
    assert len(plain.of("script")) == 4
    assert name in {attributes.get("data-requirement") for attributes in plain.of("article")}


@pytest.mark.slow
def test_size_of_a_hundred_long_episodes() -> None:
    section = EXAMPLE.sections[0]
    upright = section.requirements[0]
    rng = np.random.default_rng(0)

    def series() -> tuple[float, ...]:
        return tuple(float(f"{value:.6g}") for value in rng.normal(size=1000))

    def episode(i: int) -> object:
        return replace(
            upright.worst[0],
            times=tuple(round(0.01 * k, 2) for k in range(1000)),
            signals={f"signal {k}": series() for k in range(8)},
            robustness=series(),
            lower=series(),
            upper=series(),
            predicates={f"signal {k} < {i}": series() for k in range(3)},
        )

    requirements = tuple(
        replace(
            upright,
            name=f"requirement {i}",
            trials=tuple(replace(upright.trials[1], label=f"seed {k}") for k in range(100)),
            worst=(episode(i),),  # type: ignore[arg-type] # replace gives the class of its argument
        )
        for i in range(5)
    )
    page = render(Report("long", "rtamt", (replace(section, requirements=requirements),)))
    assert len(page.encode()) < 6_000_000


@given(st.lists(st.floats(allow_nan=False), max_size=60))
def test_bins_count_numbers_once(values: list[float]) -> None:
    found = bins(values)
    finite = [value for value in values if abs(value) <= 1e100]
    assert sum(found.counts) == len(finite)
    assert (found.below, found.above) == (
        sum(value < -1e100 for value in values),
        sum(value > 1e100 for value in values),
    )
    assert len(found.counts) <= 27
    negative = sum(math.copysign(1, value) < 0 for value in finite)
    assert sum(found.counts[: max(-found.first, 0)]) == negative
    for value in finite:
        place = value / found.width - found.first
        assert -1e-6 * abs(value / found.width) - 1 <= place <= len(found.counts) + 1


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ([2.5e-5, 1.0e-7, None, 0.0], ["2.5e\N{MINUS SIGN}05", "1e\N{MINUS SIGN}07", "", "0"]),
        ([1.25e6, 3.0, -0.5], ["1250000", "3", "\N{MINUS SIGN}0.5"]),
    ],
)
def test_columns_of_tiny_or_huge_numbers(values: list[float | None], texts: list[str]) -> None:
    assert aligned(values) == texts


@given(st.lists(st.floats(-1e5, 1e5).map(lambda value: round(value, 6)), min_size=1))
def test_columns_align(values: list[float]) -> None:
    texts = [text.replace("\N{MINUS SIGN}", "-") for text in aligned(values)]
    if max(map(abs, values)) >= 1e-4:
        pairs = zip(texts, values, strict=True)
        large = [text for text, value in pairs if abs(value) > max(map(abs, values)) / 10]
        decimals = {len(text.partition(".")[2]) for text in large}
        assert len(decimals) <= 1
    for text, value in zip(texts, values, strict=True):
        assert math.isclose(float(text), value, rel_tol=0.051)
        assert (float(text) < 0) == (value < 0)


@given(st.integers(1, 100_000), st.data())
def test_only_full_share_is_100_percent(total: int, data: st.DataObject) -> None:
    share = data.draw(st.integers(0, total)) / total
    text = percent(share)
    assert (text == "100") == (share == 1)
    assert (text == "0") == (share == 0)
    assert abs(float(text) - 100 * share) <= 0.5


@given(st.lists(st.text(max_size=80), max_size=30))
def test_ids_are_safe_and_unique(names: list[str]) -> None:
    log = PageIds()
    found = [log.add("section", name) for name in names]
    assert len(set(found)) == len(found)
    assert all(re.fullmatch(r"[a-z][a-z0-9-]*", name) for name in found)


def test_numbers_have_few_digits() -> None:
    assert [number(value) for value in (0.123456, 123456.0, 1e12, -1e-7, -0.0)] == [
        *("0.1235", "123500", "1e+12", "\N{MINUS SIGN}1e\N{MINUS SIGN}07", "\N{MINUS SIGN}0")
    ]


def test_heading_levels(page: Elements) -> None:
    levels = [int(tag[1]) for tag, _ in page.found if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert max(after - before for before, after in pairwise(levels)) == 1
