"""`check`: against every trace over a grid of values, and by examples."""

import importlib
import itertools
import math
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_texts import VALUES, texts

import rtamt
from rtamt import Answer, ExampleTrace, InputError, InputTypeError, Verdict, judge
from rtamt.checking.check import _fewest
from rtamt.checking.search import SearchAnswer


def verdicts(text: str, most: int = 4) -> set[Verdict]:
    """The verdicts on all traces over the values, by the definition of a trace that was cut."""
    return {
        judge(text, {"x": list(trace)}, end="cut", n=n).verdict
        for n in range(1, most + 1)
        for trace in itertools.product(VALUES, repeat=n)
    }


@given(text=texts)
def test_answers_are_those_of_all_traces(text: str) -> None:
    found = rtamt.check(text).requirements["spec"]
    possible = verdicts(text)
    for verdict, answer in (
        (Verdict.SATISFIED, found.satisfiable),
        (Verdict.VIOLATED, found.falsifiable),
    ):
        if verdict in possible:
            assert answer.says == "yes"
        if answer.trace is not None:
            columns = {"x": list(answer.trace.columns.get("x", ()))}
            judged = judge(text, columns, end="cut", n=answer.trace.samples)
            assert judged.verdict is verdict
        if answer.says == "no":  # all windows end: a no is proved
            assert verdict not in possible
            assert answer.samples == 0


@pytest.mark.slow
@given(one=texts, other=texts)
def test_what_is_equal_or_implied_is_so_on_all_traces(one: str, other: str) -> None:
    found = rtamt.check({"one": one, "other": other})
    traces = [t for n in (3, 4) for t in itertools.product(VALUES, repeat=n)]
    ways = {
        tuple(judge(text, {"x": list(t)}, n=len(t)).verdict for text in (one, other))
        for t in traces
    }
    if found.equal:
        assert all(Verdict.UNDECIDED in way or way[0] is way[1] for way in ways)
    for one_implied, by in found.implied.items():
        against = {"one": Verdict.VIOLATED, "other": Verdict.SATISFIED}
        assert {one_implied, by} == {"one", "other"}
        way = (Verdict.VIOLATED, Verdict.SATISFIED)
        assert (way if one_implied == "one" else way[::-1]) not in ways, against


def only(text: str, **options: object) -> rtamt.CheckedRequirement:
    (found,) = rtamt.check(text, **options).requirements.values()  # type: ignore[arg-type]
    return found


def test_a_requirement_in_which_nothing_is_wrong() -> None:
    found = only("always(req >= 3 implies eventually[0:5](gnt >= 3))")
    assert found.says == "yes"
    assert not found.idle
    assert [answer.says for answer in found.asked.values()] == ["yes"]
    (answer,) = found.asked.values()
    assert answer.trace is not None
    first = {name: values[0] for name, values in answer.trace.columns.items()}
    assert first["req"] >= 3


def test_parts_that_clash_are_named() -> None:
    found = only("always(x < 3 and y > 0) and eventually(x > 5)")
    assert found.satisfiable.says == "no"
    assert found.satisfiable.clash == ("always(x < 3)", "eventually(x > 5)")
    assert found.satisfiable.places == ((1, 10), (1, 29))
    assert only("always(x > 1 and x < 0)").satisfiable == Answer(
        "no", clash=("always(x > 1)", "always(x < 0)"), places=((1, 10), (1, 20))
    )


def test_ranges_that_clash_are_named() -> None:
    found = only("float x in [5, 9]\nfloat y in [0, 1]\nalways(x < 3 and y < 2)")
    assert found.satisfiable.clash == ("always(x < 3)", "declared: x in [5, 9]")
    assert found.satisfiable.places == ((3, 10), None)
    nothing = only("float x in [5, 9]; x > 3")
    assert (nothing.falsifiable.says, nothing.falsifiable.clash) == (
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
    assert [(each.text, each.instead) for each in only(text).idle] == idle


def test_what_demands_nothing_and_what_is_never_asked() -> None:
    nothing = only("always[0:5](x > 1 implies x > 0)")
    assert (nothing.satisfiable.says, str(nothing.falsifiable)) == ("yes", "no")
    never = only("always[0:5]((x > 1 and x < 0) implies y > 0) and eventually[0:5](y < 0)")
    assert [str(answer) for answer in never.asked.values()] == ["no"]
    assert never.says == "no"


def test_assumptions_hold_of_every_trace() -> None:
    free = only("always[0:3](x < 3)")
    bound = only("always[0:3](x < 3)", assume="always(x < 2)")
    assert (free.falsifiable.says, bound.falsifiable.says) == ("yes", "no")


def test_what_is_not_linear_is_tried_and_else_unknown() -> None:
    assert only("sqrt(x) > 2").falsifiable.says == "yes"
    unknown = only("x * y > 2 and x * y < 1 + x - x").satisfiable
    assert unknown.says in {"no", "unknown"}
    always = only("x * x >= 0").falsifiable
    assert always == Answer("unknown", why="it is not linear (mul)")


def test_what_hangs_on_rounding_is_found_by_rounding() -> None:
    answer = only("x + 1 > x").falsifiable  # not of reals, but of 2**53
    assert answer.trace is not None
    (x,) = answer.trace.columns["x"]
    assert x + 1 == x
    assert not math.isinf(x)


def test_a_trace_may_have_to_repeat() -> None:
    found = only("always(eventually[1:2](x > 0) and eventually[1:2](x <= 0))").satisfiable
    assert found.trace is not None
    assert found.trace.loop == 2
    assert str(found) == "yes, by 4 samples, the last 2 samples again and again"


def test_a_horizon_that_is_too_short_is_said() -> None:
    found = only("eventually[100:200](x > 3)", horizon=50).satisfiable
    assert found == Answer("unknown", why="it needs 201 samples, the horizon is 50")
    assert only("eventually[100:200](x > 3)").says == "yes"


def test_whole_numbers_are_whole() -> None:
    text = "input {} gear; gear > 1 and gear < 2"
    assert only(text.format("int32")).satisfiable.says == "no"
    assert only(text.format("float64")).satisfiable.says == "yes"


def test_bounds_in_time_become_samples() -> None:
    answer = only("eventually[0:1](x > 3)", period="250ms").falsifiable
    assert answer.trace is not None
    assert answer.trace.samples == 5


def test_several_requirements() -> None:
    found = rtamt.check(
        {"low": "always(x < 3)", "lower": "always(x < 2)", "high": "eventually(x > 5)"}
    )
    assert found.together is not None
    assert found.together.says == "no"
    assert found.conflict in {("low", "high"), ("lower", "high")}
    assert found.implied == {"low": "lower"}
    same = rtamt.check("a = always(x < 3); b = not eventually(x >= 3)")
    assert same.equal == (("a", "b"),)
    assert same.says == "no"


def test_an_answer_that_takes_too_long_is_unknown() -> None:
    found = rtamt.check("always(x > 1 implies eventually[0:50](y > 1))", timeout=1e-9)
    assert found.says == "unknown"
    assert "within 1e-09 s" in found.requirements["spec"].satisfiable.why


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"horizon": 0}, "horizon: expected 1 sample or more, got 0"),
        ({"timeout": 0}, "timeout: expected seconds, more than 0, got 0"),
        ({"end": "cutt"}, "end: "),
    ],
)
def test_wrong_options_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError) as error:
        only("x > 0", **options)
    assert str(error.value).startswith(message) or "cutt" in str(error.value)


def test_nothing_to_check_is_refused() -> None:
    with pytest.raises(InputError) as error:
        rtamt.check({})
    assert str(error.value) == "expected one specification or more, got an empty mapping"


def test_without_the_solver_an_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "z3", None)
    with pytest.raises(ModuleNotFoundError) as error:
        rtamt.check("x > 0")
    assert str(error.value) == (
        "a check or an example of a requirement needs z3, which is not installed; "
        "from the checkout: pip install '.[check]'"
    )
    assert importlib.import_module("rtamt").check is rtamt.check


def test_a_witness_says_its_values_again_if_they_repeat() -> None:
    witness = ExampleTrace({"x": (1.0, 2.0, 3.0)}, 3, 2)
    assert witness.unrolled("x") == [1.0, 2.0, 3.0, 2.0, 3.0, 2.0, 3.0, 2.0, 3.0]
    assert ExampleTrace({"x": (1.0,)}, 1, 0).unrolled("x") == [1.0]


@pytest.mark.slow
def test_requirements_that_agree_only_while_nothing_is_asked() -> None:
    found = rtamt.check(
        {"up": "always(m == 1 implies x > 1)", "down": "always(m == 1 implies x < 0)"}
    )
    assert found.together is not None
    assert found.together.says == "yes"
    assert {name: answer.says for (name, _), answer in found.asked.items()} == {
        "up": "no",
        "down": "no",
    }
    assert found.says == "no"
    fine = rtamt.check(
        {"up": "always(m == 1 implies x > 1)", "more": "always(m == 1 implies x > 0)"}
    )
    assert {answer.says for (name, _), answer in fine.asked.items() if name == "up"} == {"yes"}


def test_what_is_assumed_is_named_where_it_clashes() -> None:
    assert only("always(x > 1)", assume="always(x < 0)").satisfiable.clash == (
        "always(x > 1)",
        "assumed: always(x < 0)",
    )
    with pytest.raises(InputError) as error:
        only("always(x > 1)", assume="always(x < 0 and x > 1)")
    assert str(error.value) == (
        "assume: expected what some trace fulfils, got always(x < 0 and x > 1), which none does"
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
    found = only(text)
    assert (found.satisfiable.says, found.falsifiable.says) == (satisfiable, falsifiable)


def test_of_a_pair_that_is_not_linear_it_is_said_why_nobody_knows() -> None:
    found = rtamt.check({"a": "x * y > z", "b": "y * x > z"})
    assert found.unknown == {("a", "b"): "it is not linear (mul)"}
    assert found.implied == {}
    assert found.equal == ()


@given(
    clashes=st.sets(st.frozensets(st.integers(0, 5), min_size=1, max_size=4), min_size=1),
    core=st.sets(st.integers(0, 5)),
)
def test_of_what_clashes_nothing_can_be_left_out(
    clashes: set[frozenset[int]], core: set[int]
) -> None:
    def find(places: list[int]) -> SearchAnswer:
        none = any(clash <= {*places} for clash in clashes)
        guessed = tuple(i for i, place in enumerate(places) if place in core)
        return SearchAnswer(none=none, core=guessed)

    kept = _fewest([*range(6)], find)
    assert find(kept).impossible
    for place in kept:
        assert kept == [place] or not find([each for each in kept if each != place]).impossible


def test_a_name_that_is_no_text_is_refused() -> None:
    with pytest.raises(InputTypeError) as error:
        rtamt.check({3: "x > 0"})  # type: ignore[dict-item]
    assert str(error.value) == "expected names of specifications as text, got int"


def test_traces_of_other_requirements_on_which_a_term_is_no_number_are_no_witnesses() -> None:
    found = rtamt.check({"a": "x < 0", "b": "sqrt(x) > 2", "c": "sqrt(x) <= 2"})
    for name, each in found.requirements.items():
        for answer, expected in (
            (each.satisfiable, Verdict.SATISFIED),
            (each.falsifiable, Verdict.VIOLATED),
        ):
            assert answer.trace is not None or answer.why == "it is not linear (sqrt)"
            if answer.trace is not None:
                assert judge(each.text, answer.trace.columns).verdict is expected, name
