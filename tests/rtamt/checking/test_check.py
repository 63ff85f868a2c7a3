"""`check`: against every trace over a grid of values, and by examples."""

import importlib
import itertools
import math
import sys
from fractions import Fraction
from pathlib import Path

import pytest
from catalogue import check, entries
from hypothesis import given
from hypothesis import strategies as st
from small_texts import VALUES, texts

import rtamt
from rtamt import Verdict, judge
from rtamt.checking import Answer, ExampleTrace
from rtamt.checking.check import _fewest
from rtamt.checking.encoding import VariableLimits
from rtamt.checking.search import SearchAnswer


def verdicts(text: str, most: int = 4) -> set[Verdict]:
    """Return the verdicts on all traces over the values, with the end mode "cut"."""
    return {
        judge(text, {"x": list(trace)}, end="cut", n=n).verdict
        for n in range(1, most + 1)
        for trace in itertools.product(VALUES, repeat=n)
    }


@given(text=texts)
def test_answers_are_those_of_all_traces(text: str) -> None:
    result = rtamt.check(text).requirements["spec"]
    possible = verdicts(text)
    for verdict, answer in (
        (Verdict.SATISFIED, result.satisfiable),
        (Verdict.VIOLATED, result.falsifiable),
    ):
        if verdict in possible:
            assert answer.answer == "yes"
        if answer.trace is not None:
            columns = {"x": list(answer.trace.columns.get("x", ()))}
            judged = judge(text, columns, end="cut", n=answer.trace.samples)
            assert judged.verdict is verdict
        if answer.answer == "no":  # all windows are bounded: a no is proved
            assert verdict not in possible
            assert answer.samples == 0


@pytest.mark.slow
@given(one=texts, other=texts)
def test_equal_and_implied_hold_on_all_traces(one: str, other: str) -> None:
    result = rtamt.check({"one": one, "other": other})
    traces = [t for n in (3, 4) for t in itertools.product(VALUES, repeat=n)]
    pairs = {
        tuple(judge(text, {"x": list(t)}, n=len(t)).verdict for text in (one, other))
        for t in traces
    }
    if result.equal:
        assert all(Verdict.UNDECIDED in pair or pair[0] is pair[1] for pair in pairs)
    for one_implied, by in result.implied.items():
        against = {"one": Verdict.VIOLATED, "other": Verdict.SATISFIED}
        assert {one_implied, by} == {"one", "other"}
        pair = (Verdict.VIOLATED, Verdict.SATISFIED)
        assert (pair if one_implied == "one" else pair[::-1]) not in pairs, against


def only(text: str, **options: object) -> rtamt.checking.CheckedRequirement:
    (result,) = rtamt.check(text, **options).requirements.values()  # type: ignore[arg-type]
    return result


def test_a_requirement_in_which_nothing_is_wrong() -> None:
    result = only("always(req >= 3 implies eventually[0:5](gnt >= 3))")
    assert result.answer == "yes"
    assert not result.redundant
    assert [answer.answer for answer in result.triggers.values()] == ["yes"]
    (answer,) = result.triggers.values()
    assert answer.trace is not None
    first = {name: values[0] for name, values in answer.trace.columns.items()}
    assert first["req"] >= 3


def test_parts_that_clash_are_named() -> None:
    result = only("always(x < 3 and y > 0) and eventually(x > 5)")
    assert result.satisfiable.answer == "no"
    assert result.satisfiable.clash == ("always(x < 3)", "eventually(x > 5)")
    assert result.satisfiable.places == ((1, 10), (1, 29))
    assert only("always(x > 1 and x < 0)").satisfiable == Answer(
        "no", clash=("always(x > 1)", "always(x < 0)"), places=((1, 10), (1, 20))
    )


def test_ranges_that_clash_are_named() -> None:
    result = only("float x in [5, 9]\nfloat y in [0, 1]\nalways(x < 3 and y < 2)")
    assert result.satisfiable.clash == ("always(x < 3)", "declared: x in [5, 9]")
    assert result.satisfiable.places == ((3, 10), None)
    nothing = only("float x in [5, 9]; x > 3")
    assert (nothing.falsifiable.answer, nothing.falsifiable.clash) == (
        "no",
        ("declared: x in [5, 9]",),
    )
    assert nothing.satisfiable.clash == ()


@pytest.mark.parametrize(
    ("text", "idle"),
    [
        ("always(x > 1 and (x > 0 or y > 2))", [("x > 0 or y > 2", "true")]),
        ("eventually[0:3](x > 5 or (x > 6 and y > 0))", [("x > 6 and y > 0", "false")]),
        ("always[0:3](x > 0) and x > -1", [("x > -1", "true")]),
        ("x > 0 until[0:3] y > 0", []),
    ],
)
def test_parts_that_decide_nothing_are_named(text: str, idle: list[tuple[str, str]]) -> None:
    assert [(entry.text, entry.instead) for entry in only(text).redundant] == idle


def test_tautology_and_unreachable_implication() -> None:
    nothing = only("always[0:5](x > 1 implies x > 0)")
    assert (nothing.satisfiable.answer, str(nothing.falsifiable)) == ("yes", "no")
    never = only("always[0:5]((x > 1 and x < 0) implies y > 0) and eventually[0:5](y < 0)")
    assert [str(answer) for answer in never.triggers.values()] == ["no"]
    assert never.answer == "no"


def test_assumptions_hold_of_every_trace() -> None:
    free = only("always[0:3](x < 3)")
    bound = only("always[0:3](x < 3)", assume="always(x < 2)")
    assert (free.falsifiable.answer, bound.falsifiable.answer) == ("yes", "no")


def test_nonlinear_terms_are_tried_or_unknown() -> None:
    assert only("sqrt(x) > 2").falsifiable.answer == "yes"
    unknown = only("x * y > 2 and x * y < 1 + x - x").satisfiable
    assert unknown.answer in {"no", "unknown"}
    always = only("x * x >= 0").falsifiable
    assert always == Answer("unknown", why="it is not linear (mul)")


def test_rounding_can_violate() -> None:
    answer = only("x + 1 > x").falsifiable  # not for reals, but for 2**53
    assert answer.trace is not None
    (x,) = answer.trace.columns["x"]
    assert x + 1 == x
    assert not math.isinf(x)


def test_a_trace_may_have_to_repeat() -> None:
    result = only("always(eventually[1:2](x > 0) and eventually[1:2](x <= 0))").satisfiable
    assert result.trace is not None
    assert result.trace.loop == 2
    assert str(result) == "yes, by 4 samples, the last 2 samples again and again"


def test_a_horizon_that_is_too_short_is_said() -> None:
    result = only("eventually[100:200](x > 3)", horizon=50).satisfiable
    assert result == Answer("unknown", why="it needs 201 samples, the horizon is 50")
    assert only("eventually[100:200](x > 3)").answer == "yes"


def test_whole_numbers_are_whole() -> None:
    text = "input {} gear; gear > 1 and gear < 2"
    assert only(text.format("int32")).satisfiable.answer == "no"
    assert only(text.format("float64")).satisfiable.answer == "yes"


def test_bounds_in_time_become_samples() -> None:
    answer = only("eventually[0:1](x > 3)", period="250ms").falsifiable
    assert answer.trace is not None
    assert answer.trace.samples == 5


def test_several_requirements() -> None:
    result = rtamt.check(
        {"low": "always(x < 3)", "lower": "always(x < 2)", "high": "eventually(x > 5)"}
    )
    assert result.together is not None
    assert result.together.answer == "no"
    assert result.conflict in {("low", "high"), ("lower", "high")}
    assert result.implied == {"low": "lower"}
    same = rtamt.check("a = always(x < 3); b = not eventually(x >= 3)")
    assert same.equal == (("a", "b"),)
    assert same.answer == "no"


def test_an_answer_that_takes_too_long_is_unknown() -> None:
    result = rtamt.check("always(x > 1 implies eventually[0:50](y > 1))", timeout=1e-9)
    assert result.answer == "unknown"
    assert "within 1e-09 s" in result.requirements["spec"].satisfiable.why


def test_missing_solver_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "z3", None)
    with pytest.raises(ModuleNotFoundError) as error:
        rtamt.check("x > 0")
    assert str(error.value) == (
        "a check or an example of a requirement needs z3, which is not installed; "
        "from the checkout: pip install '.[check]'"
    )
    assert importlib.import_module("rtamt").check is rtamt.check


def test_unrolled_trace_repeats_its_end() -> None:
    witness = ExampleTrace({"x": (1.0, 2.0, 3.0)}, 3, 2)
    assert witness.unrolled("x") == [1.0, 2.0, 3.0, 2.0, 3.0, 2.0, 3.0, 2.0, 3.0]
    assert ExampleTrace({"x": (1.0,)}, 1, 0).unrolled("x") == [1.0]


@pytest.mark.slow
def test_requirements_compatible_only_without_triggers() -> None:
    result = rtamt.check(
        {"up": "always(m == 1 implies x > 1)", "down": "always(m == 1 implies x < 0)"}
    )
    assert result.together is not None
    assert result.together.answer == "yes"
    assert {name: answer.answer for (name, _), answer in result.triggers.items()} == {
        "up": "no",
        "down": "no",
    }
    assert result.answer == "no"
    fine = rtamt.check(
        {"up": "always(m == 1 implies x > 1)", "more": "always(m == 1 implies x > 0)"}
    )
    assert {answer.answer for (name, _), answer in fine.triggers.items() if name == "up"} == {"yes"}


def test_what_is_assumed_is_named_where_it_clashes() -> None:
    assert only("always(x > 1)", assume="always(x < 0)").satisfiable.clash == (
        "always(x > 1)",
        "assumed: always(x < 0)",
    )


@pytest.mark.parametrize(
    ("text", "satisfiable", "falsifiable"),
    [
        ("min(x, y) > 3 and max(x, y) < 2", "no", "yes"),
        ("min(x, y) > 3 and max(x, y) < 3.5", "yes", "yes"),
        ("min(x, y) <= x", "yes", "no"),
        ("-x > 3 and x > -3", "no", "yes"),
        ("-x > 3", "yes", "yes"),
        ("float x in [0, 8]; x / 2 > 3 and x / 4 < 1", "no", "yes"),
        ("float x in [0, 8]; x / 2 > 3", "yes", "yes"),
        ("x <= 3 and (x > 1 / 0 or x > 2 * 3 + 1)", "no", "yes"),
        ("1 > 2 or x > 3 * 2", "yes", "yes"),
    ],
)
def test_functions_that_are_linear_are_decided(
    text: str, satisfiable: str, falsifiable: str
) -> None:
    result = only(text)
    assert (result.satisfiable.answer, result.falsifiable.answer) == (satisfiable, falsifiable)


def test_unknown_implication_has_a_reason() -> None:
    result = rtamt.check({"a": "x * y > z", "b": "y * x > z"})
    assert result.unknown == {("a", "b"): "it is not linear (mul)"}
    assert result.implied == {}
    assert result.equal == ()


@given(
    clashes=st.sets(st.frozensets(st.integers(0, 5), min_size=1, max_size=4), min_size=1),
    core=st.sets(st.integers(0, 5)),
)
def test_of_what_clashes_nothing_can_be_left_out(
    clashes: set[frozenset[int]], core: set[int]
) -> None:
    def find(places: list[int]) -> SearchAnswer:
        none = any(clash <= {*places} for clash in clashes)
        guessed = tuple(i for i, position in enumerate(places) if position in core)
        return SearchAnswer(none=none, core=guessed)

    keeps = _fewest([*range(6)], find)
    assert find(keeps).impossible
    for position in keeps:
        assert (
            keeps == [position]
            or not find([entry for entry in keeps if entry != position]).impossible
        )


def test_shared_traces_with_nan_terms_are_not_reused() -> None:
    result = rtamt.check({"a": "x < 0", "b": "sqrt(x) > 2", "c": "sqrt(x) <= 2"})
    for name, entry in result.requirements.items():
        for answer, expected in (
            (entry.satisfiable, Verdict.SATISFIED),
            (entry.falsifiable, Verdict.VIOLATED),
        ):
            assert answer.trace is not None or answer.why == "it is not linear (sqrt)"
            if answer.trace is not None:
                assert judge(entry.text, answer.trace.columns).verdict is expected, name


RATES = st.sampled_from([(-1.0, 1.0), (-0.5, 0.5), (0.0, 1.0), (-2.0, 0.0), (0.5, 1.0)])


@given(text=texts, rate=RATES)
def test_answers_match_traces_within_the_rate(text: str, rate: tuple[float, float]) -> None:
    if "x" not in rtamt.parse(text).variables:
        return
    result = rtamt.check(text, rates={"x": rate}).requirements["spec"]
    possible = {
        judge(text, {"x": list(trace)}, end="cut").verdict
        for n in range(1, 5)
        for trace in itertools.product(VALUES, repeat=n)
        if all(rate[0] <= b - a <= rate[1] for a, b in itertools.pairwise(trace))
    }
    for verdict, answer in (
        (Verdict.SATISFIED, result.satisfiable),
        (Verdict.VIOLATED, result.falsifiable),
    ):
        if verdict in possible:
            assert answer.answer == "yes"
        if answer.trace is not None:
            values = answer.trace.columns.get("x", ())
            assert all(
                rate[0] <= Fraction(b) - Fraction(a) <= rate[1]
                for a, b in itertools.pairwise(values)
            )


@pytest.mark.slow
def test_a_no_names_the_rate_on_which_it_rests() -> None:
    text = "always[0:9](x < 1 implies next(x > 5))"
    result = rtamt.check(text, "100ms", rates={"x": (-2, 2)}).requirements["spec"]
    assert [answer.answer for answer in result.triggers.values()] == ["no"]
    never = rtamt.check("x < 1 and next(x > 5)", "100ms", rates={"x": (-2, 2)})
    assert never.requirements["spec"].satisfiable.clash == (
        "x < 1",
        "next(x > 5)",
        "rate: x in [-2, 2] per second",
    )


def test_a_rate_is_per_second_or_per_sample() -> None:
    text = "x < 0 and eventually[0:1](x > 1)"
    slow = {"x": (-1.05, 1.05)}
    assert rtamt.check(text, "100ms", rates=slow).requirements["spec"].satisfiable.answer == "yes"
    assert rtamt.check(text, rates={"x": (-1, 1)}).requirements["spec"].satisfiable.answer == "no"
    assert rtamt.check(text, rates={"x": (-1, 2)}).requirements["spec"].satisfiable.answer == "yes"


def test_steps_that_doubles_round_keep_the_rate() -> None:
    result = rtamt.check("x <= 0 and eventually[0:30](x >= 2.9)", rates={"x": (-0.1, 0.1)})
    trace = result.requirements["spec"].satisfiable.trace
    assert trace is not None
    steps = [Fraction(b) - Fraction(a) for a, b in itertools.pairwise(trace.columns["x"])]
    assert max(steps) <= 0.1


def test_what_repeats_keeps_the_rate() -> None:
    text = "always(eventually(x > 3) and eventually(x < 0))"
    result = rtamt.check(text, rates={"x": (-2, 2)}).requirements["spec"].satisfiable
    assert result.trace is not None
    values = result.trace.unrolled("x")
    assert all(abs(b - a) <= 2 for a, b in itertools.pairwise(values))


def test_examples_and_comparisons_keep_rates() -> None:
    text = "always(x > 3 implies eventually[0:4](x < 0))"
    for example in rtamt.examples(text, rates={"x": (-1, 1)})["spec"].examples:
        values = example.trace.unrolled("x")
        assert all(abs(b - a) <= 1 for a, b in itertools.pairwise(values))
    same = rtamt.equivalent("x < 1 and next(x < 5)", "x < 1", rates={"x": (-2, 2)})
    assert same.answer == "yes"


@pytest.mark.parametrize(
    ("values", "loop", "keeps"),
    [
        ((0.0, 1.0, 2.0), 0, True),
        ((0.0, 1.0, 2.0), 3, False),  # from 2 back to 0
        ((0.0, 1.0, 2.0), 1, True),
        ((0.0, 2.0), 0, False),
        ((2.0, 3.5), 0, False),  # out of range
        ((math.inf, math.inf), 0, True),
        ((0.0, math.inf), 0, False),
        ((math.inf, 0.0), 0, False),
    ],
)
def test_values_keep_ranges_and_rates(values: tuple[float, ...], loop: int, *, keeps: bool) -> None:
    upper = math.inf if math.inf in values else 3.0
    limits = VariableLimits({"x": (0.0, upper)}, {"x": (-1.0, 1.0)})
    assert limits.allow({"x": values}, loop) is keeps


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
    (result,) = rtamt.check(spec, period).requirements.values()
    assert result.answer == "yes"
    for answer, verdict in (
        (result.satisfiable, Verdict.SATISFIED),
        (result.falsifiable, Verdict.VIOLATED),
    ):
        assert answer.trace is not None
        if not answer.trace.loop:
            (wanted,) = spec.requirements.values()
            judged = judge(wanted, dict(answer.trace.columns), period)
            assert judged.verdict is verdict
            if answer.trace.samples > 32:  # it ends where that is certain
                shorter = {n: v[:-1] for n, v in answer.trace.columns.items()}
                assert judge(wanted, shorter, period).verdict is Verdict.UNDECIDED


def test_endless_satisfaction_repeats_the_end() -> None:
    text = "always(req > 3 implies eventually[0:500](gnt > 3))"
    (result,) = rtamt.check(text, end="open").requirements.values()
    assert result.satisfiable.trace is not None
    assert result.satisfiable.trace.loop == 1
    assert result.falsifiable.trace is not None
    assert result.falsifiable.trace.loop == 0
    assert result.falsifiable.trace.samples <= 502
    (cut,) = rtamt.check(text).requirements.values()
    assert str(cut.satisfiable) == "yes, in 1 sample"


def test_a_long_no_is_proved() -> None:
    text = "always[0:1500](x < 3) implies always[0:400](x < 4)"
    (result,) = rtamt.check(text).requirements.values()
    assert result.falsifiable == Answer("no")
    (late,) = rtamt.check(text, horizon=300).requirements.values()
    assert late.falsifiable.answer == "unknown"


@pytest.mark.parametrize(
    "text",
    [
        "sqrt(pow(x - 8.8, 2) + pow(y - 5.6, 2)) <= 0.3",
        "sqrt(pow(a - c, 2) + pow(b - d, 2)) >= 0.8 and a * b > 2 and x < 1",
        "eventually[0:4](x * y > 6 and x < 1 and eventually[0:4](x * y < -6))",
    ],
)
def test_points_for_nonlinear_terms(text: str) -> None:
    (result,) = rtamt.check(text).requirements.values()
    assert (result.satisfiable.answer, result.falsifiable.answer) == ("yes", "yes")


def test_points_keep_ranges_and_are_whole() -> None:
    text = "input int x in [2, 9]; input float y in [-1, 1]; x * y > 6 and x * x < 70"
    (result,) = rtamt.check(text).requirements.values()
    assert result.satisfiable.trace is not None
    columns = result.satisfiable.trace.columns
    assert columns["x"][0] in range(2, 10)
    assert -1 <= columns["y"][0] <= 1


@pytest.mark.parametrize(("call", "said"), entries(Path(__file__).with_name("errors.txt")))
def test_errors_of_arguments(call: str, said: str) -> None:
    check(call, said)
