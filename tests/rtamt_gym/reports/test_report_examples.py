"""Examples on the page next to their requirements, unchanged, and errors for wrong ones."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_example import EXAMPLE

import rtamt
from rtamt import InputError, Verdict
from rtamt.checking import Answer, Example, ExampleTrace, RequirementExamples
from rtamt_gym import Parameter, sweep, write_report
from rtamt_gym.__main__ import main
from rtamt_gym.reports import examples
from rtamt_gym.reports.examples import with_examples
from rtamt_gym.reports.html import render
from rtamt_gym.reports.model import Report
from rtamt_gym.reports.write import report_of
from rtamt_gym.results import Sweep

TEXT = "always(level < 2 or eventually[0:3](inflow <= 0.25))"
FORM = "rtamt examples --json"


def tank(inflow: float) -> object:
    level = 1.0
    for _ in range(20):
        yield {"level": level, "inflow": inflow}
        level += inflow - 0.1 * level


@pytest.fixture(scope="module")
def swept() -> Sweep:
    space = [Parameter("inflow", 0.1, 0.3)]
    return sweep(tank, {"dry": TEXT}, space, samples=4, period=1)


@pytest.fixture(scope="module")
def found() -> dict[str, RequirementExamples]:
    return rtamt.examples({"dry": TEXT}, 1)


def test_page_shows_examples(
    swept: Sweep, found: dict[str, RequirementExamples], tmp_path: Path
) -> None:
    ((requirement,),) = (s.requirements for s in report_of(swept, examples=[found]).sections)
    given = found["dry"].examples
    shown = requirement.examples
    assert len(shown) == 6
    assert requirement.more_examples == len(given) - 6
    by_why = {each.why: each for each in given}
    for each in shown:
        of = by_why[each.why]
        assert each.verdict == of.verdict.name.lower()
        assert each.robustness == of.robustness
        assert [band.name for band in each.bands] == ["level", "inflow"]
        assert [band.compared for band in each.bands] == ["2", "0.25"]
        assert each.length == f"{of.trace.samples} s"
    page = tmp_path / "page.html"
    write_report(page, swept, examples=found)
    text = page.read_text(encoding="utf-8")
    assert text.count('<figure class="example">') == 6
    assert text.count("<svg viewBox") == 12


@pytest.mark.slow
def test_examples_from_file(
    swept: Sweep,
    found: dict[str, RequirementExamples],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    assert main(["examples", f"dry = {TEXT}", "--period", "1s", "--json"]) == 0
    file = tmp_path / "examples.json"
    file.write_text(capsys.readouterr().out, encoding="utf-8")
    pages = [tmp_path / "one.html", tmp_path / "other.html"]
    write_report(pages[0], swept, examples=found)
    write_report(pages[1], swept, examples=file)
    assert pages[0].read_text(encoding="utf-8") == pages[1].read_text(encoding="utf-8")


@given(st.lists(st.integers(-3, 3), min_size=1, max_size=60))
def test_drawing_has_signal_values(numbers: list[int]) -> None:
    values = tuple(map(float, numbers))
    trace = ExampleTrace({"angle": values}, len(values), 0)
    one = Example(("violated",), "drawn", Verdict.VIOLATED, -1.0, trace)
    yes = Answer("yes")
    many = {"x": RequirementExamples("always(abs(angle) < 0.2)", None, yes, yes, (one,))}
    (section, *_) = with_examples(EXAMPLE.sections, [many])
    ((band,),) = (each.bands for each in section.requirements[0].examples)
    low, high = min(-0.2, *values), max(0.2, *values)
    x, y, drawn = 0.0, 0.0, []
    for command, first, second in re.findall(r"([MVH])([\d.e-]+)(?: ([\d.e-]+))?", band.line):
        if command == "H":
            count = round((float(first) - x) / 100 * len(values))
            drawn += [high - y / 36 * (high - low)] * count
            x = float(first)
        else:
            y = float(second or first)
    assert drawn == pytest.approx(values, abs=0.02)
    assert band.dots.count("h0") == (len(values) if len(values) <= 40 else 0)
    assert len(band.levels) == 2


def test_constant_signal_has_room() -> None:
    assert examples._levels(rtamt.parse("always(2 * angle < 3)").formula) == {}
    band = examples._band("angle", (2.0, 2.0), ())
    assert (band.line, band.levels, band.low, band.high) == ("M0 18H100", (), "1", "3")


def test_example_texts_are_escaped() -> None:
    page = render(EXAMPLE)
    assert "a trace that &lt;i&gt;satisfies&lt;/i&gt; it" in page
    assert "a trace that <i>" not in page
    assert "robustness −∞" in page  # noqa: RUF001 - the minus sign is meant
    assert "The last 2 samples, shaded, again and again." in page
    assert "2 more examples not shown" in page


@pytest.mark.slow
def test_many_examples_are_closed() -> None:
    few = render(EXAMPLE)
    (section, *_) = EXAMPLE.sections
    named = [
        replace(each, name=f"{each.name}{i}") for each in section.requirements for i in range(3)
    ]
    page = render(Report("many", "rtamt", (replace(section, requirements=(*named,)),)))
    assert '<details class="examples" open>' in few
    assert '<details class="examples">' in page
    assert '<details class="examples" open>' not in page


def test_other_examples_error(swept: Sweep, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    yes = Answer("yes")
    other = RequirementExamples("always(level < 3)", None, yes, yes)
    with pytest.raises(InputError, match=r"dry is always\(level < 3\) there, and always\(level"):
        write_report(page, swept, examples={"dry": other})
    with pytest.raises(InputError, match=r"expected the result of rtamt.examples, got Answer$"):
        write_report(page, swept, examples={"dry": yes})  # type: ignore[dict-item]  # the mistake
    with pytest.raises(InputError, match="examples of 'wet', and none of 'dry'"):
        write_report(page, swept, examples={"wet": other})
    assert not page.exists()


def test_file_without_examples_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], swept: Sweep
) -> None:
    record, page = tmp_path / "sweep.json", tmp_path / "page.html"
    record.write_text(json.dumps({"req": [1]}), encoding="utf-8")
    with pytest.raises(InputError, match=f"expected a file that {FORM} writes"):
        write_report(page, swept, examples=record)
    assert main(["examples", TEXT, "--json"]) == 0
    record.write_text(capsys.readouterr().out, encoding="utf-8")
    assert main(["report", str(record), "-o", str(page)]) == 2
    assert "a result of kind 'examples'" in capsys.readouterr().err


def test_infinite_value_is_at_the_edge() -> None:
    trace = ExampleTrace({"angle": (-math.inf, 0.0, math.inf)}, 3, 0)
    one = Example(("violated",), "drawn", Verdict.VIOLATED, -math.inf, trace)
    yes = Answer("yes")
    many = {"x": RequirementExamples("always(abs(angle) < 0.2)", None, yes, yes, (one,))}
    (section, *_) = with_examples(EXAMPLE.sections, [many])
    (shown,) = section.requirements[0].examples
    assert shown.bands[0].line == "M0 36H33.33V18H66.67V0H100"
