"""`equivalent`, `check(same_as=)` and ranges: against traces over a grid, and by examples."""

import itertools
from typing import get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from small_texts import VALUES, texts

import rtamt
from rtamt import Verdict, judge
from rtamt.typing import End


@given(one=texts, other=texts, least=st.sampled_from(VALUES), most=st.sampled_from(VALUES))
def test_an_equivalence_holds_on_all_traces_in_range(
    one: str, other: str, least: float, most: float
) -> None:
    least, most = min(least, most), max(least, most)
    declared = f"float x in [{least}, {most}]\n"
    result = rtamt.equivalent(declared + one, other)
    values = [value for value in VALUES if least <= value <= most]
    pairs = {
        tuple(judge(text, {"x": list(t)}, end="cut", n=n).verdict for text in (one, other))
        for n in range(1, 5)
        for t in itertools.product(values, repeat=n)
    }
    mixed = {(Verdict.SATISFIED, Verdict.VIOLATED), (Verdict.VIOLATED, Verdict.SATISFIED)} & pairs
    if mixed:
        assert result.answer == "no"
    if result.trace is not None:
        assert all(least <= x <= most for x in result.trace.columns.get("x", ()))
        columns, n = {"x": result.trace.columns.get("x", ())}, result.trace.samples
        judged = [judge(text, columns, end="cut", n=n).verdict for text in (one, other)]
        satisfied = ("one", "other").index(result.satisfied)
        assert judged[satisfied] is Verdict.SATISFIED
        assert judged[1 - satisfied] is Verdict.VIOLATED
    else:
        assert (result.answer, result.samples) == ("yes", 0)  # all windows are bounded


@pytest.mark.parametrize("declaration", ["float x in [1, 2]", "uint8 x; float y in [0, 1]"])
def test_range_of_a_variable_that_only_the_other_uses(declaration: str) -> None:
    assert str(rtamt.equivalent(f"{declaration}; true", "x >= 0")) == "yes"
    assert str(rtamt.equivalent("x >= 0", f"{declaration}; true")) == "yes"


def test_unbounded_equivalence_states_its_samples() -> None:
    result = rtamt.equivalent("always(x < 3)", "not eventually(x >= 3)")
    assert str(result) == "yes, on all traces of up to 16 samples, their ends repeated"
    assert str(rtamt.equivalent("always[0:50](x < 3)", "always[0:5](x < 3)")) == (
        "no, in 7 samples: other is satisfied, one is violated"
    )


WHOLES = ("always({})", "eventually({})", "not (x > 0 until ({}))", "always(x > 0 implies ({}))")


@settings(max_examples=examples(30))
@given(frame=st.sampled_from(WHOLES), one=texts, other=texts, end=st.sampled_from(get_args(End)))
def test_unbounded_equivalence_is_proved_by_parts(
    frame: str, one: str, other: str, end: End
) -> None:
    result = rtamt.equivalent(frame.format(one), frame.format(other), end=end)
    if (result.answer, result.samples) != ("yes", 0):
        return
    for n in range(1, 4):
        for t in itertools.product(VALUES[::2], repeat=n):
            both = {
                judge(frame.format(text), {"x": list(t)}, end=end, n=n).verdict
                for text in (one, other)
            }
            assert both != {Verdict.SATISFIED, Verdict.VIOLATED}, (t, end)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("always(x < 1 and x < 2)", "always(x < 1)"),
        ("eventually(x > 1 and always(x < 3))", "eventually(not (x <= 1) and always(x < 3))"),
        ("always(x > 0 implies next(x > 1 or x > 2))", "always(x > 0 implies next(x > 1))"),
    ],
)
def test_equal_parts_prove_equivalence(one: str, other: str) -> None:
    for end in get_args(End):
        assert str(rtamt.equivalent(one, other, end=end)) == "yes"
    checked = rtamt.check(f"a = {one}", same_as=f"a = {other}").same["a"]
    assert (checked.answer, checked.samples) == ("yes", 0)


def test_what_nobody_knows_is_unknown() -> None:
    result = rtamt.equivalent("x * x >= 0", "true or x > 0")
    assert (result.answer, result.trace) == ("unknown", None)
    assert str(result) == "unknown: it is not linear (mul)"


@pytest.mark.slow
def test_assumptions_and_the_ranges_of_both_hold() -> None:
    assert (
        rtamt.equivalent("always(x < 3)", "always(x < 4)", assume="always(x < 2)").answer == "yes"
    )
    declared = "float x in [0, 2]; always(x < 3)"
    assert rtamt.equivalent(declared, "always(x < 4)").answer == "yes"
    assert rtamt.equivalent("always(x < 4)", declared).answer == "yes"


def test_types_have_ranges_that_hold() -> None:
    (result,) = rtamt.check("uint8 gear; always(gear <= 255)").requirements.values()
    assert result.falsifiable.answer == "no"
    (result,) = rtamt.check("uint8 gear; gear > 255").requirements.values()
    assert result.satisfiable.answer == "no"
    (result,) = rtamt.check("int gear; gear > 255").requirements.values()
    assert result.satisfiable.answer == "yes"


def test_values_without_effect_keep_their_range() -> None:
    text = "float x in [5, 9]; float y in [-4, -2]; x > 6 or y > -3"
    (result,) = rtamt.check(text).requirements.values()
    for answer in (result.satisfiable, result.falsifiable):
        assert answer.trace is not None
        assert all(5 <= x <= 9 for x in answer.trace.columns["x"])
        assert all(-4 <= y <= -2 for y in answer.trace.columns["y"])


def test_requirements_are_compared_with_their_namesakes() -> None:
    text = "a = always(x < 3); b = x > 1"
    result = rtamt.check(text, same_as="b = not x <= 1; a = always(x <= 3)")
    assert {name: item.answer for name, item in result.same.items()} == {"a": "no", "b": "yes"}
    assert result.answer == "no"
    assert [(name, what) for name, what, _ in result.traces()] == [("a", "apart")]
    one = rtamt.check("a = x > 1", same_as={"other": "x > 1 or x > 2"})
    assert {name: item.answer for name, item in one.same.items()} == {"a": "yes"}
    assert one.answer == "yes"


@pytest.mark.parametrize(
    ("one", "other", "samples"),
    [
        (  # the past part is not a proof, the differing part is
            "always(eventually historically(x > 0 and y > 0))",
            "always(eventually historically(y > 0 and x > 0))",
            0,
        ),
        (  # no part is proved, and their operands differ in number
            "always(eventually(x > 0) and eventually(y > 0) and eventually(x > 0))",
            "always(eventually(x > 0) and eventually(y > 0))",
            16,
        ),
    ],
)
def test_parts_prove_as_much_as_they_can(one: str, other: str, samples: int) -> None:
    result = rtamt.equivalent(one, other)
    assert (result.answer, result.samples) == ("yes", samples)
