"""The HTML of notebooks: complete, small, without other files; foreign text is never markup."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from named_systems import wave

import rtamt
from rtamt_gym import Parameter, Signal, evaluate_policy, falsify, markup, simulate

HOSTILE = "<script>alert('x')</script> & \x1b[31m"


class _Read(HTMLParser):
    """The elements and the text of HTML; every opened element is closed, in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[str] = []
        self.text = ""
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [f"{name}={value}" for name, value in attrs]
        if tag != "br":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [f"{name}={value}" for name, value in attrs]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        self.text += " " * (tag in ("td", "th"))

    def handle_data(self, data: str) -> None:
        self.text += data


def read(shown: object) -> _Read:
    html = shown._repr_html_()  # type: ignore[attr-defined]
    assert len(html) < 20_000
    page = _Read(html)
    known = {"span", "code", "br", "table", "tr", "th", "td", "svg", "path", "rect", "circle"}
    assert set(page.tags) <= known
    assert not re.search(r"href|src=|url\(|http|^on", "\n".join(page.attributes), re.MULTILINE)
    assert page.text.isprintable()
    return page


@pytest.mark.parametrize("end", ["cut", "complete"])
def test_html_of_judgement(end: rtamt.typing.End) -> None:
    trace = {"req": [0, 4, 0, 0, 4], "gnt": [0, 0, 5, 0, 0]}
    spec = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
    judgement = rtamt.judge(spec, trace, period=1, end=end)
    page = read(judgement)
    shown, printed = (re.sub(r"[\s:]", "", text) for text in (page.text, str(judgement)))
    assert shown == printed
    assert "code" in page.tags


def test_html_of_run() -> None:
    levels = [{"level": float(x)} for x in range(5000)]
    specs = {"dry": "always(level < 3)", "high": "eventually(level > 4000)"}
    run = simulate(levels, specs, period=0.5, stop="end")
    page = read(run)
    assert page.tags.count("svg") == page.tags.count("code") == len(specs)
    for name, course in run.histories.items():
        assert name in page.text
        assert course.formula in page.text
        assert course.verdict.name in page.text
        assert course.final_text(".6g") in page.text
    assert "VIOLATED" in page.text
    assert repr(run)[1:-1] in page.text


def test_foreign_names_are_escaped() -> None:
    run = simulate([{"x": 1.0}], {HOSTILE: "always(x > 0)"}, period=1)
    page = read(run)
    assert "<script>alert('x')</script> & \\x1b[31m" in page.text
    assert "script" not in page.tags


def test_html_of_violation_by_end() -> None:
    run = simulate(
        [{"x": 1.0}] * 3, "eventually[0:9](x > 5) or x > 0 and always[0:9](x > 0)",
        period=1, at_termination="failure",
    )  # fmt: skip
    assert run.verdict is rtamt.Verdict.VIOLATED
    assert "VIOLATED by how it ended" in read(run).text


def test_html_of_evaluation() -> None:
    specs = {"near": "always(abs(x) < 9)", "up": "always(abs(angle) < 0.01)"}
    signals = {"x": "obs[0]", "angle": "obs[2]"}
    result = evaluate_policy(
        "random", "CartPole-v1", specs, signals, episodes=4, at_termination="complete"
    )
    page = read(result)
    for each in [*result.requirements.values(), result.success]:
        low, high = each.interval
        assert f"{each.satisfied} of 4 {each.rate:.1%} {low:.1%} to {high:.1%} " in page.text
    bars = [each for each in page.attributes if each.startswith("aria-label=")]
    assert len(bars) == 3


@pytest.mark.parametrize("falsified", [True, False])
def test_html_of_falsification(*, falsified: bool) -> None:
    space = [Signal("drive", 0, 1, points=3), Parameter("gain", 1, 2)]
    requirement = f"always(x < {1 if falsified else 50})"
    found = falsify(wave, requirement, space, period=1, duration=8, budget=4)
    assert found.falsified is falsified
    page = read(found)
    assert found.record.requirements[found.requirement] in page.text
    assert {"drive", "gain"} <= set(re.findall(r"\w+", page.text))


@given(st.lists(st.floats(width=32), max_size=300))
def test_curve_fits_the_picture(values: list[float]) -> None:
    html = markup.curve(values, "it")
    heights = np.array(values)[np.isfinite(values)] if values else np.array([])
    if not len(heights):
        assert not html
        return
    points = re.findall(r"[ML]([\d.e+-]+) ([\d.e+-]+)", html.rpartition("<path")[2])
    across, down = np.array(points, dtype=float).T
    assert np.all(np.diff(across) >= 0)
    assert across.min() >= 0
    assert across.max() <= 120
    if heights.min() < heights.max():
        assert (down.min(), down.max()) == (2, 22)
    else:
        assert np.all(down == 12)
    assert ("dasharray" in html) == (heights.min() < 0 < heights.max())
    assert len(points) <= 2 * 100 + 2
