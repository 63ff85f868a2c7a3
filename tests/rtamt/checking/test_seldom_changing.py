"""Requirements whose windows are long, terms that are not linear, and the horizon."""

import pytest

import rtamt
from rtamt import Answer, Verdict, judge

SHIFTS = """
first = gear >= 0.5 and gear <= 1.5
kept = always[0:30](not first and eventually[0.01:0.1] first
    implies eventually[0.01:0.1] always[0:2.5] first)
"""
PAIR = """
desk = sqrt(pow(x - 8.8, 2) + pow(y - 5.6, 2))
dock = sqrt(pow(x - 6.2, 2) + pow(y - 1, 2))
visits = eventually[0:30](desk <= 0.3 and eventually[0:30](dock <= 0.3))
"""
LONG = {
    "shifts": (SHIFTS, 0.01),
    "visits": (PAIR, 0.01),
    "speed": ("always[0:30](rpm < 3000) implies always[0:8](speed < 50)", 0.01),
    "cars": (
        "always[0:72](eventually[0:8](always[0:5](b - a >= 9) implies always[5:20](c - b >= 9)))",
        0.05,
    ),
    "answered": ("always(req >= 3 implies eventually[0:50](gnt >= 3))", 0.1),
    "held": ("always[0:40](rise(x > 1) implies (y > 0 until[0:20] z > 0))", 0.01),
    "returns": (
        "always[0:30](eventually[0:1](x > 0) and eventually[0:1](x < 0))",
        0.01,
    ),
}


@pytest.mark.slow(keep=3)
@pytest.mark.parametrize("name", LONG)
def test_long_windows_are_answered(name: str) -> None:
    text, period = LONG[name]
    spec = rtamt.parse(text)
    (found,) = rtamt.check(spec, period).requirements.values()
    assert found.says == "yes"
    for answer, verdict in (
        (found.satisfiable, Verdict.SATISFIED),
        (found.falsifiable, Verdict.VIOLATED),
    ):
        assert answer.trace is not None
        if not answer.trace.loop:
            (wanted,) = spec.requirements.values()
            judged = judge(wanted, dict(answer.trace.columns), period)
            assert judged.verdict is verdict
            if answer.trace.samples > 32:  # it ends where that is certain
                shorter = {n: v[:-1] for n, v in answer.trace.columns.items()}
                assert judge(wanted, shorter, period).verdict is Verdict.UNDECIDED


def test_a_trace_that_satisfies_for_ever_repeats_its_end() -> None:
    text = "always(req > 3 implies eventually[0:500](gnt > 3))"
    (found,) = rtamt.check(text, end="open").requirements.values()
    assert found.satisfiable.trace is not None
    assert found.satisfiable.trace.loop == 1
    assert found.falsifiable.trace is not None
    assert found.falsifiable.trace.loop == 0
    assert found.falsifiable.trace.samples <= 502
    (cut,) = rtamt.check(text).requirements.values()
    assert str(cut.satisfiable) == "yes, in 1 sample"


def test_a_long_no_is_proved() -> None:
    text = "always[0:1500](x < 3) implies always[0:400](x < 4)"
    (found,) = rtamt.check(text).requirements.values()
    assert found.falsifiable == Answer("no")
    (late,) = rtamt.check(text, horizon=300).requirements.values()
    assert late.falsifiable.says == "unknown"


@pytest.mark.parametrize(
    "text",
    [
        "sqrt(pow(x - 8.8, 2) + pow(y - 5.6, 2)) <= 0.3",
        "sqrt(pow(a - c, 2) + pow(b - d, 2)) >= 0.8 and a * b > 2 and x < 1",
        "eventually[0:4](x * y > 6 and x < 1 and eventually[0:4](x * y < -6))",
    ],
)
def test_points_are_found_for_terms_that_are_not_linear(text: str) -> None:
    (found,) = rtamt.check(text).requirements.values()
    assert (found.satisfiable.says, found.falsifiable.says) == ("yes", "yes")


def test_points_keep_ranges_and_are_whole() -> None:
    text = "input int x in [2, 9]; input float y in [-1, 1]; x * y > 6 and x * x < 70"
    (found,) = rtamt.check(text).requirements.values()
    assert found.satisfiable.trace is not None
    columns = found.satisfiable.trace.columns
    assert columns["x"][0] in range(2, 10)
    assert -1 <= columns["y"][0] <= 1
