"""`examples`: verdicts, near misses, and points that no trace can reach."""

import itertools
import re
from fractions import Fraction

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from small_texts import texts_of

import rtamt
from rtamt import Verdict, judge
from rtamt.checking import Example, simplify

RESPONSE = "always(req >= 3 implies eventually[0:5](gnt >= 3))"

VALUES = (-1.0, 0.0, 1.0, 2.0)

texts = texts_of("x > 0", "x >= 1", "x < 1", "y > 0", "y <= 1")


def only(text: str, **options: object) -> rtamt.checking.RequirementExamples:
    (result,) = rtamt.examples(text, **options).values()  # type: ignore[arg-type]
    return result


def judged(text: str, example: Example) -> rtamt.Judgement:
    variables = rtamt.parse(text).variables
    columns = {name: [*example.trace.columns[name]] for name in variables}
    return judge(text, columns, end="cut", n=None if columns else example.trace.samples)


@given(text=texts)
@settings(max_examples=examples(200))
def test_examples_are_judged_as_they_say(text: str) -> None:
    result = only(text, count=30)
    for item in result.examples:
        if not item.trace.loop:
            said = judged(text, item)
            assert (said.verdict, said.robustness) == (item.verdict, item.robustness)
    different = [(e.trace.samples, e.trace.loop, *e.trace.columns.items()) for e in result.examples]
    assert len({str(item) for item in different}) == len(different)
    for answer, shown in (
        (result.satisfiable, result.satisfied),
        (result.falsifiable, result.violated),
    ):
        assert bool(shown) is (answer.answer == "yes")
        if answer.answer == "no" and answer.samples == 0:
            verdict = Verdict.SATISFIED if answer is result.satisfiable else Verdict.VIOLATED
            assert verdict not in _possible(text)


def _possible(text: str, most: int = 3) -> set[Verdict]:
    """Return the verdicts on all traces over the values."""
    variables = rtamt.parse(text).variables
    result = set()
    for n in range(1, most + 1):
        for values in itertools.product(VALUES, repeat=n * len(variables)):
            columns = {v: [*values[i * n : (i + 1) * n]] for i, v in enumerate(variables)}
            result.add(judge(text, columns, end="cut", n=n).verdict)
    return result


@given(
    p=st.sampled_from(["x > 0", "x >= 1", "y <= 1"]),
    begin=st.integers(0, 2),
    width=st.integers(0, 3),
    endless=st.booleans(),
)
def test_windows_are_left_by_one_sample(p: str, begin: int, width: int, endless: bool) -> None:  # noqa: FBT001
    """Each bounded window has a trace that just satisfies it, and one that just violates it."""
    end = begin + width
    request = "always(a > 2 implies {})" if endless else "{}"

    def text(lo: int, hi: int) -> str:
        return request.format(f"eventually[{lo}:{hi}]({p})")

    result = {kind: item for item in only(text(begin, end)).examples for kind in item.kinds}
    late = result["too late"]
    assert late.verdict is Verdict.VIOLATED
    assert judged(text(begin, end + 1), late).verdict is Verdict.SATISFIED
    if width:
        last = result["last moment"]
        assert last.verdict is Verdict.SATISFIED
        assert judged(text(begin, end - 1), last).verdict is Verdict.VIOLATED
        first = result["first moment"]
        assert judged(text(begin + 1, end), first).verdict is Verdict.VIOLATED
    if begin:
        assert judged(text(begin - 1, end), result["too early"]).verdict is Verdict.SATISFIED


def test_a_response_has_its_kinds_of_examples() -> None:
    result = only(RESPONSE)
    assert result.answer == "yes"
    assert {kind for item in result.examples for kind in item.kinds} == {
        "violated",
        "answered",
        "unanswered",
        "never asked",
        "last moment",
        "too late",
        "first moment",
        "threshold",
    }
    assert [item.verdict.name[0] for item in result.examples] == list("SVSSVSVVSS")
    assert not result.missing
    assert not result.unknown


def test_last_moment_is_too_late_one_sample_later() -> None:
    (last,) = (item for item in only(RESPONSE).examples if "last moment" in item.kinds)
    req, gnt = last.trace.columns["req"], last.trace.columns["gnt"]
    assert (req, gnt) == ((4, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 4))
    later = judge(RESPONSE, {"req": [*req, 0.0], "gnt": [0.0, *gnt]}, end="cut")
    assert (last.verdict, later.verdict) == (Verdict.SATISFIED, Verdict.VIOLATED)


def test_thresholds_are_met_exactly_and_missed_by_a_unit() -> None:
    result = {item.why: item for item in only("always[0:1](x >= 0.5)").examples}
    exact = result["exactly at its threshold, x >= 0.5 holds"]
    missed = result["x >= 0.5 just fails"]
    assert (exact.robustness, min(exact.trace.columns["x"])) == (0.0, 0.5)
    assert min(missed.trace.columns["x"]) == 0.4
    strict = {item.why: item for item in only("always[0:1](x < 3)").examples}
    assert strict["exactly at its threshold, x < 3 fails"].verdict is Verdict.VIOLATED


def test_the_part_that_decides_is_alone() -> None:
    result = {item.why: item for item in only("eventually[0:2](x > 5 or y > 5)").satisfied}
    for part, variable in (("x > 5", "x"), ("y > 5", "y")):
        (example,) = (item for why, item in result.items() if f"saved by {part} alone" in why)
        above = {name for name, values in example.trace.columns.items() if max(values) > 5}
        assert above == {variable}
    broken = only("always[0:2](x > 5 and y > 5)").violated
    assert any("broken by x > 5 alone" in item.why for item in broken)


def test_the_shortest_violation_is_the_shortest() -> None:
    shortest = only(RESPONSE).violated[0]
    assert "the shortest violation" in shortest.why
    assert shortest.trace.samples == 6


def test_unproved_violation_is_not_called_shortest() -> None:
    long = only("eventually[0:80](x > 0)").violated[0]
    assert long.trace.samples == 81
    assert "a violation" in long.why
    assert "shortest" not in long.why


def test_an_implication_that_nothing_asks_is_said() -> None:
    result = only("always((x > 1 and x < 0) implies y > 0) and eventually(y < 0)")
    assert result.missing == ("triggered and answered", "triggered and not answered")


def test_what_the_solver_does_not_know_is_said() -> None:
    result = only("x * y > 2 and x * y < 1 + y * y", count=30)
    assert result.unknown
    assert set(result.unknown.values()) == {"it is not linear (mul)"}


def test_whole_numbers_and_ranges_are_kept() -> None:
    text = "input int32 gear in [1, 5]; input float v in [0, 50]; always(gear >= 4 implies v > 30)"
    for item in only(text, count=30).examples:
        assert all(g in {1, 2, 3, 4, 5} for g in item.trace.columns["gear"])
        assert all(0 <= v <= 50 for v in item.trace.columns["v"])


def test_what_is_assumed_holds_of_every_example() -> None:
    for item in only("always(x < 3)", assume="always(x >= 2)").examples:
        assert min(item.trace.columns["x"]) >= 2


def test_unbounded_requirement_has_repeating_examples() -> None:
    result = only("always(eventually[1:2](x > 0) and eventually[1:2](x <= 0))")
    assert result.satisfied[0].trace.loop == 2
    assert result.satisfied[0].robustness is None


def test_bounds_in_time_are_left_by_one_sample() -> None:
    result = only("eventually[0:1s](x > 3)", period="250ms").examples
    (last,) = (item for item in result if "last moment" in item.kinds)
    assert last.trace.columns["x"] == (0, 0, 0, 0, 4)


def test_the_same_arguments_give_the_same_examples() -> None:
    assert only(RESPONSE) == only(RESPONSE)
    assert only(RESPONSE, count=3).examples == only(RESPONSE).examples[:3]


def changes(example: Example) -> int:
    """Return the number of samples with changes in an example."""
    rows = [*zip(*example.trace.columns.values(), strict=True)]
    return sum(x != y for x, y in itertools.pairwise(rows))


@pytest.mark.parametrize(
    "text",
    [
        "always(req >= 3 implies eventually[0:{}](gnt >= 3))",
        "eventually[{}:{}](always[0:3](x >= 5)) or always[0:{}](y < 2)",
        "always(x == 3 implies eventually[0:{}](y != 1))",
    ],
)
def test_long_traces_are_as_plain_as_short_ones(text: str) -> None:
    def shown(n: int) -> dict[str, Example]:
        result = only(text.format(n, n + 2, n), count=40, timeout=1e4).examples
        return {re.sub(r"\d+", "n", why): e for e in result for why in e.why.split("; ")}

    short, long = shown(4), shown(40)
    assert len(short.keys() & long.keys()) > 8
    for why in short.keys() & long.keys():
        assert long[why].trace.samples > 40
        assert changes(long[why]) <= changes(short[why]) + 2
        values = {*itertools.chain(*short[why].trace.columns.values()), 0.0}
        assert {*itertools.chain(*long[why].trace.columns.values())} <= values


def test_an_equality_has_near_misses_on_either_side() -> None:
    result = only(
        "input int x in [0, 3]; input int y; always(x == 3 implies eventually[0:1](y != 1))",
        count=30,
    )
    by_why = {part: item for item in result.examples for part in item.why.split("; ")}
    assert "x == 3 just fails, from above" not in by_why
    below = by_why["x == 3 just fails, from below"]
    assert (below.verdict, below.trace.columns["x"][0]) == (Verdict.SATISFIED, 2)
    for side, value in (("above", 2), ("below", 0)):
        near = by_why[f"y != 1 just holds, from {side}"]
        assert near.verdict is Verdict.SATISFIED
        assert value in near.trace.columns["y"]


@pytest.mark.parametrize(
    "text",
    ["sqrt(x) < 2 and y > sqrt(x)", "sqrt(x) >= 2", "always[0:3](sqrt(x - 1) <= y or y > 2)"],
)
def test_examples_have_no_nan_terms(text: str) -> None:
    result = only(text, count=30)
    assert result.examples
    for item in result.examples:
        said = judged(text, item)
        assert (said.verdict, said.robustness) == (item.verdict, item.robustness)


@pytest.mark.parametrize(
    ("text", "border", "just"),
    [
        ("3 < x", 3.0, 4.0),
        ("3 >= x", 3.0, 4.0),
        ("x > 5e-324", 5e-324, None),  # its last digit has no half
        ("2.5 > x", 2.5, 2.4),
    ],
)
def test_a_threshold_may_stand_on_either_side(text: str, border: float, just: float | None) -> None:
    wanted = {border, just} - {None}
    result = only(text, count=30).examples
    shown = {item.trace.columns["x"] for item in result if "threshold" in item.kinds}
    assert shown == {(value,) for value in wanted}


def test_period_without_decimal_bounds_has_fewer_examples() -> None:
    third = only("eventually[0:1](x > 0)", period=Fraction(1, 3), count=30)
    half = only("eventually[0:1](x > 0)", period=Fraction(1, 2), count=30)
    kinds = [{kind for item in result.examples for kind in item.kinds} for result in (third, half)]
    assert kinds[1] - kinds[0] == {"last moment", "too late", "first moment"}
    assert kinds[0] < kinds[1]


@pytest.mark.parametrize("work", [0, 2000])
def test_examples_without_work_left_have_true_verdicts(
    monkeypatch: pytest.MonkeyPatch, work: int
) -> None:
    monkeypatch.setattr(simplify, "_WORK", work)
    text = "always[0:6](x > 3 implies eventually[0:4](y < x / 7)) and eventually[0:9](x > 3)"
    result = only(text, count=30)
    assert len(result.examples) > 5
    for item in result.examples:
        said = judged(text, item)
        assert (said.verdict, said.robustness) == (item.verdict, item.robustness)
