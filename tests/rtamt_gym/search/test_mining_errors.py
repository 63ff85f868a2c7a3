"""What `mine` refuses and what it says: requirements, ranges, what is not monotone."""

from __future__ import annotations

from typing import Any

import pytest

import rtamt
from rtamt import InputError, InputTypeError, ParseError, SpecificationError
from rtamt_gym import mine
from rtamt_gym.search.mining.requirement import unmarked

CALM = {"speed": [10.0, 24.5, 18.0]}
FAST = {"speed": [10.0, 22.0, 31.25, 12.0]}
BELOW = "always(speed < ?v)"


def refusal(
    requirement: Any = BELOW,  # noqa: ANN401 - mistakes of any type
    traces: Any = None,  # noqa: ANN401
    ranges: Any = None,  # noqa: ANN401
    kind: type[Exception] = InputError,
    **options: Any,  # noqa: ANN401
) -> str:
    """What `mine` says when it refuses."""
    with pytest.raises(kind) as caught:
        mine(
            requirement,
            [CALM, FAST] if traces is None else traces,
            {"v": (0, 50)} if ranges is None else ranges,
            **options,
        )
    assert type(caught.value) is kind
    return str(caught.value)


def test_it_holds_nowhere_or_everywhere() -> None:
    assert refusal(ranges={"v": (0, 20)}) == (
        "none of the 17 tried values of 'v' from 0 to 20 satisfies the requirement on all 2 "
        "traces: trace 0 comes closest at v = 20, VIOLATED with robustness -4.5, and 1 other "
        "alike; give a wider range"
    )
    assert refusal(traces=CALM, ranges={"v": (100, 200)}) == (
        "all 17 tried values of 'v' from 100 to 200 satisfy the requirement on the trace; the "
        "minimum robustness is 75.5 at v = 100 (trace 0) and 175.5 at v = 200 (trace 0); give a "
        "wider range"
    )
    assert refusal("always(speed < ?v) and eventually(speed > ?v)", CALM) == (
        "none of the 17 tried values of 'v' from 0 to 50 satisfies the requirement on the trace: "
        "trace 0 comes closest at v = 25, VIOLATED with robustness -0.5; a value between them "
        "might; give a narrower range around it"
    )


def test_what_is_undecided_does_not_satisfy() -> None:
    text = "always(speed > 15 implies eventually[0:1](speed < ?v))"
    trace = {"speed": [10.0, 20.0, 18.0]}
    assert refusal(text, trace, {"v": (0, 17)}, end="cut") == (
        "none of the 17 tried values of 'v' from 0 to 17 satisfies the requirement on the trace: "
        "trace 0 comes closest at v = 17, VIOLATED with robustness -1; give a wider range"
    )
    recorded = {"speed": [10.0, 12.0, 18.0]}
    assert refusal(text, recorded, {"v": (0, 17)}) == (
        "none of the 17 tried values of 'v' from 0 to 17 satisfies the requirement on the trace: "
        "trace 0 comes closest at v = 17, UNDECIDED with robustness -1; the samples that would "
        "decide it are missing; leave it out, or judge it as complete with end='complete'"
    )


def test_a_requirement_that_is_not_monotone_is_refused_with_the_values_that_show_it() -> None:
    assert refusal("always(abs(speed - ?v) < 15)", CALM) == (
        "expected a requirement that is monotone in 'v'; trace 0 is VIOLATED at v = 9.375, "
        "SATISFIED at v = 12.5, VIOLATED at v = 25; give a range with a single change"
    )
    # One trace needs more than 4, the other less than 6.
    text = "always(x > 0 implies y < ?v) and always(x < 0 implies y > ?v)"
    traces = [{"x": [1.0], "y": [4.0]}, {"x": [-1.0], "y": [6.0]}]
    assert refusal(text, traces, {"v": (0, 16)}) == (
        "expected a requirement that is monotone in 'v'; trace 0 satisfies it at v = 5 and not at "
        "v = 4, trace 1 at v = 5 and not at v = 6"
    )
    # A gap between two of the values at which all are judged is seen where the other is bisected.
    gap = "always(x < ?v) and always(y > 0 implies ?v < 9.2 or ?v > 9.3)"
    traces = [{"x": [9.24], "y": [-1.0]}, {"x": [8.5], "y": [1.0]}]
    assert refusal(gap, traces, {"v": (0, 16)}, tolerance=0.01) == (
        "expected a requirement that is monotone in 'v'; trace 1 is VIOLATED at v = 8, SATISFIED "
        "at v = 9, VIOLATED at v = 9.25; give a range with a single change"
    )


def test_the_parameter_is_in_the_requirement_and_has_a_range() -> None:
    assert refusal(ranges={"w": (0, 20)}) == (
        "the requirement has no parameter 'w'; it has 'v'; write ?w in place of its value, as in "
        "always(x < ?w)"
    )
    assert refusal("always(speed < v)") == (
        "the requirement has no parameter 'v'; write ?v in place of its value, as in always(x < ?v)"
    )
    assert refusal("always(speed < ?limit)", ranges={"limt": (0, 1)}) == (
        "the requirement has no parameter 'limt'; it has 'limit'; did you mean 'limit'?; write "
        "?limt in place of its value, as in always(x < ?limt)"
    )
    assert refusal("always(speed < ?v or speed > ?w)") == (
        "the parameter ?w has neither a range nor a value; one is mined at a time: write "
        "constants={'w': 3}"
    )
    assert refusal("always(speed < ?speed)", ranges={"speed": (0, 50)}) == (
        "'speed' occurs with and without '?', as a parameter and as another name; give the "
        "parameter another name"
    )
    assert refusal(constants={"v": 3}) == "expected 'v' with a range or a value, got both"
    assert refusal(ranges={"v": (0, 1), "w": (0, 1)}) == (
        "expected the range of one parameter, got 'v', 'w'; mine one parameter, and set the "
        "others: constants={'w': 3}"
    )
    assert refusal(ranges={}) == (
        "expected the range of one parameter, got none; mine one parameter, and set the others: "
        "constants={'w': 3}"
    )
    assert refusal(ranges={"v": (20, 20)}) == (
        "expected the range of 'v' as two finite numbers, the smaller first, got 20 and 20"
    )
    assert refusal(ranges={"v": (0, float("inf"))}) == (
        "expected the range of 'v' as two finite numbers, the smaller first, got 0 and inf"
    )
    assert refusal(ranges={"v": 20}, kind=InputTypeError) == (
        "expected the range of 'v' as two numbers, (0, 100), got 20"
    )
    assert refusal(ranges=[0, 20], kind=InputTypeError) == (
        'expected the range of a parameter by its name, {"v": (0, 100)}, got [0, 20]'
    )
    assert refusal(requirement=3, kind=InputTypeError) == (
        "expected the text of a requirement or a specification, got 3"
    )


def test_the_requirement_is_one_that_looks_at_the_trace() -> None:
    assert refusal("speed < ?v", kind=SpecificationError) == (
        "the requirement reads the first sample only; write always(speed < ?v)"
    )
    assert refusal("slow.stl", kind=SpecificationError) == (
        "expected the text of a requirement, got the path 'slow.stl'; write "
        "Path('slow.stl').read_text()"
    )
    assert refusal("a = always(speed < ?v); b = always(speed > 1)") == (
        "expected one requirement, got 'a', 'b'; select one"
    )
    assert refusal("always(speed < ?v", kind=ParseError) == (
        "STL:1:7: '(' is not closed\n  always(speed <  v\n        ^\n"
        "  hint: write ')' where it ends"
    )


def test_the_values_that_are_tried() -> None:
    assert refusal(tolerance=-1) == (
        "expected tolerance= as a finite number above 0 and at most 50, got -1"
    )
    assert refusal(tolerance=51) == (
        "expected tolerance= as a finite number above 0 and at most 50, got 51"
    )
    assert refusal("eventually[0:?v](speed > 20)", tolerance=1) == (
        "expected no tolerance= for 'v', which bounds a time and is sought among the multiples of "
        "the period"
    )
    assert refusal("eventually[0:?v](speed > 20)", ranges={"v": (0, 0.3)}, period=0.5) == (
        "expected a range with at least two multiples of the period, got 0 to 0.3, where the "
        "period is 0.5"
    )
    assert refusal(end="cutt") == (
        "expected end=None or 'complete' or 'cut' or 'open', got 'cutt'; did you mean 'cut'?"
    )


def test_a_constant_of_the_text_or_of_a_specification_is_a_parameter_too() -> None:
    text = "const float v = 3\nconst float w = 1\nalways(speed < v * w)"
    for requirement in (text, rtamt.parse(text)):
        result = mine(requirement, [CALM, FAST], {"v": (0, 50)}, constants={"w": 2})
        assert result.value == 15.6251
        assert repr(result) == (
            "<Mined v = 15.6251, the smallest: always(speed < 15.6251 * 2) on 2 traces>"
        )
    several = rtamt.parse("const float v = 3; a = always(speed < v); b = always(speed < 2 * v)")
    found = [
        mine(several.requirements[name], [CALM, FAST], {"v": (0, 50)}).value for name in ("a", "b")
    ]
    assert found == [31.2501, 15.6251]
    assert mine("always(speed < ?v + ?w)", FAST, {"v": (0, 50)}, constants={"w": 1}).value == (
        30.2501
    )


def test_marks_leave_every_other_character_in_its_place() -> None:
    text = "a = x < ?v // is it?so\n/* ?no */ always[0:?t](a) and y>?v"
    plain = "a = x <  v // is it?so\n/* ?no */ always[0: t](a) and y> v"
    assert unmarked(text) == (plain, ("v", "t"))


def test_what_is_printed_fits_a_terminal_and_tells_what_was_found() -> None:
    assert str(mine(BELOW, [CALM, FAST], {"v": (0, 50)})) == (
        "v = 31.2501 is the smallest for which all 2 traces satisfy always(speed < ?v)\n"
        "at v = 31.25 trace 1 does not\n"
        "no trace changes its verdict more than once at the 17 values that were tried\n"
        "  from 0 to 50 (49 evaluations)\n"
        "\n"
        "trace 1 at v = 31.2501:\n"
        "robustness 0.0001 at sample 0, decided by speed < 31.2501 at sample 2\n"
        "\n"
        "      at   value  formula\n"
        "sample 0  0.0001  always(speed < 31.2501)\n"
        "sample 2  0.0001  speed < 31.2501\n"
        "sample 2   31.25  speed"
    )
    long = " and ".join(f"always(speed < {i} + ?v)" for i in range(20))
    shown = str(mine(long, FAST, {"v": (0, 50)}))
    assert max(map(len, shown.splitlines())) <= 80
    assert shown.startswith("v = 31.2501 is the smallest for which the trace satisfies always(")
