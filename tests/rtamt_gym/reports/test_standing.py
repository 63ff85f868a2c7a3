"""The line at the head of a page, against an independent count over artificial sections."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_example import EXAMPLE

from rtamt_gym import write_report
from rtamt_gym.__main__ import main
from rtamt_gym.reports.html import render, standing_of
from rtamt_gym.reports.model import Report, Requirement, Section, SectionKind, TrialRow
from rtamt_gym.results.outcome import Word

NOUNS = {"evaluation": "episode", "sweep": "simulation", "search": "simulation", "matrix": "trace"}
KINDS: list[SectionKind] = ["evaluation", "sweep", "search", "matrix"]
ORDER: list[Word] = ["violated", "failed", "undecided", "satisfied"]
WORDS = st.sampled_from(get_args(Word))

Drawn = tuple[SectionKind, list[tuple[str, list[Word], list[int | None], bool]]]


@st.composite
def drawn_sections(draw: st.DrawFn) -> list[Drawn]:
    found: list[Drawn] = []
    for _ in range(draw(st.integers(1, 3))):
        kind: SectionKind = draw(st.sampled_from(KINDS))
        count = draw(st.integers(0, 5))
        names = draw(st.lists(st.sampled_from("abc"), min_size=1, max_size=3, unique=True))
        some = st.lists(WORDS, min_size=count, max_size=count)
        times: st.SearchStrategy[int | None] = st.integers(0, 2)
        asked = st.lists(times, min_size=count, max_size=count)
        none: list[int | None] = [None] * count
        found.append(
            (kind, [(name, draw(some), draw(asked | st.just(none)), False) for name in names])
        )
        if draw(st.booleans()):
            found[-1][1].append(("all requirements", draw(some), none, True))
    return found


def sections_of(drawn: Sequence[Drawn]) -> list[Section]:
    return [
        Section(
            kind,
            "made up",
            requirements=tuple(
                Requirement(
                    name,
                    name,
                    f"always({name} > 0)",
                    tuple(TrialRow(f"{i}", word, asked=asked[i]) for i, word in enumerate(words)),
                    together=together,
                )
                for name, words, asked, together in of
            ),
        )
        for kind, of in drawn
    ]


@given(drawn_sections())
def test_requirements_and_runs_count_once(drawn: list[Drawn]) -> None:
    worst: dict[str, Word] = {}
    asked: dict[str, list[int]] = {}
    judged: dict[str, int] = {}
    failed: dict[str, int] = {}
    for kind, of in drawn:
        own = [each for each in of if not each[3]]
        for name, words, counts, _ in own:
            every = [*words, *([worst[name]] if name in worst else [])]
            if not words:
                every.append("undecided")
            worst[name] = min(every, key=ORDER.index)
            known = [each for each in counts if each is not None]
            if known:
                asked.setdefault(name, []).extend(known)
        runs = len(own[0][1])
        lost = {i for _, words, _, _ in own for i, word in enumerate(words) if word == "failed"}
        judged[NOUNS[kind]] = judged.get(NOUNS[kind], 0) + runs - len(lost)
        failed[NOUNS[kind]] = failed.get(NOUNS[kind], 0) + len(lost)
    found = standing_of(sections_of(drawn))
    assert found is not None
    assert found.verdict == min(worst.values(), key=ORDER.index)
    head, _, rest = found.text.partition(": ")
    assert head == {"violated": "Failed", "satisfied": "Passed"}.get(found.verdict, "Undecided")
    requirements, *others = rest.removesuffix(".").split("; ")
    assert requirements.startswith(f"of {len(worst)} requirement")
    said = requirements.partition(" requirement")[2].lstrip("s ").split(", ")
    tally = {word: [*worst.values()].count(word) for word in ORDER}
    assert sorted(said) == sorted(f"{count} {word}" for word, count in tally.items() if count)
    wanted = []
    for noun, count in judged.items():
        text = f"{count} {noun}{'' if count == 1 else 's'} evaluated"
        wanted.append(text + (f", {failed[noun]} failed" if failed[noun] else ""))
    never = [name for name, each in asked.items() if not any(each)]
    assert others == [*wanted, *([f"never triggered: {', '.join(never)}"] if never else [])]


@pytest.mark.parametrize(
    ("words", "answer", "text"),
    [
        (["satisfied"] * 3, None, "Passed: of 1 requirement 1 satisfied; 3 episodes evaluated."),
        (
            ["satisfied", "violated"],
            "satisfied",
            "Passed: of 1 requirement 1 satisfied; 2 episodes evaluated.",
        ),
        (
            ["satisfied", "failed"],
            "violated",
            "Failed: of 1 requirement 1 violated; 1 episode evaluated, 1 failed.",
        ),
        (
            ["failed"],
            None,
            "Undecided: of 1 requirement 1 failed; 0 episodes evaluated, 1 failed.",
        ),
        ([], None, "Undecided: of 1 requirement 1 undecided; 0 episodes evaluated."),
    ],
)
def test_answer_to_target_counts(words: list[Word], answer: Word | None, text: str) -> None:
    trials = tuple(TrialRow(f"seed {i}", word) for i, word in enumerate(words))
    section = Section(
        "evaluation", "x", requirements=(Requirement("a", "a", "a > 0", trials, answer=answer),)
    )
    found = standing_of([section])
    assert found is not None
    assert found.text == text


def test_comparison_has_no_standing() -> None:
    comparison = EXAMPLE.sections[-1]
    assert standing_of([comparison]) is None
    assert standing_of([]) is None
    page = render(Report("B and A", "rtamt", (comparison,)))
    assert 'class="standing' not in page


def test_standing_is_at_the_head() -> None:
    page = render(EXAMPLE)
    text = (
        "Failed: of 3 requirements 2 violated, 1 failed; 19 episodes evaluated, 1 failed; "
        "13 simulations evaluated, 1 failed; 2 traces evaluated, 1 failed."
    )
    assert page.count(text) == 1
    assert page.index(text) < page.index("At a glance")


def test_page_shows_warnings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    spec = "input float limit = 0.5; input float req; input float gnt; input float x\n"
    spec += "answered = always(req > 1 implies eventually[0:1](gnt > 1)); below = always(x < limit)"
    Path("req.stl").write_text(spec, encoding="utf-8")
    for name, req in (("a.csv", 0), ("b.csv", 2)):
        rows = "".join(f"{i},{req},2,0.25\n" for i in range(4))
        Path(name).write_text(f"time,req,gnt,x\n{rows}", encoding="utf-8")
    said = {}
    for names in (["a.csv"], ["a.csv", "b.csv"]):
        main(["monitor", "--end", "complete", "--json", "req.stl", "--", *names])
        Path("out.json").write_text(capsys.readouterr().out, encoding="utf-8")
        write_report("page.html", "out.json")
        text = re.sub("<[^>]*>", " ", Path("page.html").read_text(encoding="utf-8"))
        said[len(names)] = " ".join(text.partition("As a formula")[0].split())
    never = "Passed: of 2 requirements 2 satisfied; 1 trace evaluated; never triggered: answered; "
    assert f"{never}on defaults: below." in said[1]
    assert "Never triggered in 1 trace." in said[1]
    assert "Rests on a default: limit = 0.5 in 1 trace." in said[1]
    both = "Passed: of 2 requirements 2 satisfied; 2 traces evaluated; on defaults: below."
    assert both in said[2]
    assert "Triggered in 1 of 2 traces." in said[2]
    assert "Rests on a default: limit = 0.5 in 2 traces." in said[2]
