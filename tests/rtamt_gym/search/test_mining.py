"""The tightest constants: against a scan of all values with a robustness in NumPy."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from profiles import examples

import rtamt
from rtamt import InputError, InputTypeError, ParseError, SpecificationError, Verdict
from rtamt_gym import mine
from rtamt_gym.results import Mined
from rtamt_gym.search.mining.requirement import unmarked

Floats = NDArray[np.float64]
Signals = dict[str, Floats]


class Kind(NamedTuple):
    """A requirement, and its meaning in NumPy.

    Attributes:
        text: The requirement with its parameter p.
        holds: Whether a trace satisfies it for a value of the parameter.
    """

    text: str
    holds: Callable[[Signals, float], bool]


def window(
    found: NDArray[np.bool_], width: int, fold: Callable[..., np.bool_]
) -> NDArray[np.bool_]:
    """Return the fold of each value and a number of values after it, within the trace."""
    return np.array([fold(found[i : i + width + 1]) for i in range(len(found))])


KINDS = [
    Kind("always(x < ?p)", lambda s, p: bool((s["x"] < p).all())),
    Kind("always(x <= ?p)", lambda s, p: bool((s["x"] <= p).all())),
    Kind("always[1:3](x < ?p)", lambda s, p: bool((s["x"][1:4] < p).all())),
    Kind("eventually(x > ?p)", lambda s, p: bool((s["x"] > p).any())),
    Kind("eventually[0:2](x >= ?p)", lambda s, p: bool((s["x"][:3] >= p).any())),
    Kind("always(abs(x - y) <= ?p)", lambda s, p: bool((abs(s["x"] - s["y"]) <= p).all())),
    Kind("not eventually(x - ?p >= y)", lambda s, p: bool((s["x"] - p < s["y"]).all())),
    Kind(
        "always(x > 2 implies eventually[0:2](y < ?p))",
        lambda s, p: bool((~(s["x"] > 2) | window(s["y"] < p, 2, np.any)).all()),
    ),
    Kind(
        "always(x > ?p implies eventually[0:1](y > 0))",
        lambda s, p: bool((~(s["x"] > p) | window(s["y"] > 0, 1, np.any)).all()),
    ),
    Kind("y > -9 until x > ?p", lambda s, p: bool((s["x"] > p).any())),
]
SIGNAL = st.lists(st.integers(-8, 8), min_size=5, max_size=9)


@st.composite
def campaigns(draw: st.DrawFn) -> list[Signals]:
    """One trace or more of two signals."""
    traces = []
    for _ in range(draw(st.integers(1, 5))):
        x = draw(SIGNAL)
        y = draw(st.lists(st.integers(-8, 8), min_size=len(x), max_size=len(x)))
        traces.append({"x": np.array(x, float), "y": np.array(y, float)})
    return traces


def scanned(holds: Sequence[bool]) -> tuple[str, int] | None:
    """Return the side and the place of the tightest value, from all values."""
    changes = [i for i in range(1, len(holds)) if holds[i] != holds[i - 1]]
    if len(changes) != 1:
        return None
    return ("least", changes[0]) if holds[-1] else ("greatest", changes[0] - 1)


def mined(kind: Kind, traces: list[Signals], low: float, high: float, step: float) -> Mined:
    return mine(kind.text, traces, {"p": (low, high)}, tolerance=step, end="complete")


@pytest.mark.slow(keep=3)
@pytest.mark.parametrize("kind", KINDS, ids=[kind.text for kind in KINDS])
@given(traces=campaigns(), low=st.sampled_from([-20.0, -20.25, -8.5]))
@settings(max_examples=examples(10), deadline=None)
def test_the_value_is_that_of_a_scan_of_all_values(
    kind: Kind, traces: list[Signals], low: float
) -> None:
    # The multiples of the tolerance are tried, and both ends of the range.
    inside = np.arange(-20, 20.5, 0.5)
    values = np.concatenate([[low], inside[inside > low], [20.25]])
    found = [all(kind.holds(trace, value) for trace in traces) for value in values]
    expected = scanned(found)
    if expected is None:
        with pytest.raises(InputError, match="tried values of"):
            mined(kind, traces, low, 20.25, 0.5)
        return
    side, place = expected
    fails_at = values[place + (-1 if side == "least" else 1)]
    result = mined(kind, traces, low, 20.25, 0.5)
    assert (result.side, result.value, result.fails_at) == (side, values[place], fails_at)
    failing = {i for i, trace in enumerate(traces) if not kind.holds(trace, fails_at)}
    assert {witness.index for witness in result.witnesses} == failing
    assert all(witness.trace is traces[witness.index] for witness in result.witnesses)


@pytest.mark.slow(keep=3)
@pytest.mark.parametrize("kind", KINDS, ids=[kind.text for kind in KINDS])
@given(traces=campaigns())
@settings(max_examples=examples(4), deadline=None)
def test_with_tolerance_0_the_neighbouring_float_fails(kind: Kind, traces: list[Signals]) -> None:
    try:
        result = mined(kind, traces, -30.5, 30.5, 0)
    except InputError:  # it holds everywhere or nowhere
        assert kind.holds(traces[0], -30.5) == kind.holds(traces[0], 30.5)
        return
    side = -1 if result.side == "least" else 1
    beyond = math.nextafter(result.value, side * math.inf)
    if abs(beyond) < 1e-300:  # no text has such a number
        beyond = 0.0 if result.value else side * 1e-300
    assert result.fails_at == beyond
    assert all(kind.holds(trace, result.value) for trace in traces)
    assert not all(kind.holds(trace, result.fails_at) for trace in traces)


def test_a_strict_bound_is_the_next_float_after_the_greatest_sample() -> None:
    x = np.random.default_rng(3).normal(size=100)
    exact = mine("always(x <= ?v)", {"x": x}, {"v": (-10, 10)}, tolerance=0)
    strict = mine("always(x < ?v)", {"x": x}, {"v": (-10, 10)}, tolerance=0)
    assert exact.value == x.max()
    assert strict.value == np.nextafter(x.max(), math.inf)


@pytest.mark.slow
@given(traces=campaigns(), period=st.sampled_from([None, 0.5, "20ms"]), level=st.integers(-3, 3))
@settings(max_examples=examples(25), deadline=None)
def test_a_bound_of_time_is_the_first_sample_that_reaches_the_level(
    traces: list[Signals], period: float | str | None, level: int
) -> None:
    step = {None: 1.0, 0.5: 0.5, "20ms": 0.02}[period]
    reached = [np.flatnonzero(trace["x"] > level) for trace in traces]
    first = max(int(found[0]) if len(found) else 99 for found in reached)

    def mined_within() -> Mined:
        return mine(
            f"eventually[0:?t](x > {level})",
            traces,
            {"t": (0, 8 * step)},
            period=period,
            end="complete",
        )

    if first in {0, 99}:
        with pytest.raises(InputError, match=" 9 tried values "):
            mined_within()
        return
    result = mined_within()
    assert result.side == "least"
    assert result.value == pytest.approx(first * step)
    assert result.fails_at == pytest.approx((first - 1) * step)


def test_the_greatest_bound_within_which_a_level_is_kept_and_units_are_those_of_the_text() -> None:
    trace = {"x": [1.0, 2.0, 3.0, 9.0, 3.0, 2.0]}
    greatest = [
        mine(f"always[0:?t{unit}](x < 4)", trace, {"t": (0, high)}, period=0.5)
        for unit, high in (("", 2), (" s", 2.1), (" ms", 2000))
    ]
    assert [(each.value, each.side) for each in greatest] == [
        (1.0, "greatest"),
        (1.0, "greatest"),
        (1000.0, "greatest"),
    ]
    least = mine("always[?t:2.5](x < 4)", trace, {"t": (0, 2.5)}, period=0.5)
    assert (least.value, least.side, least.fails_at) == (2.0, "least", 1.5)


def test_the_order_of_the_traces_changes_nothing_but_their_numbers() -> None:
    random = np.random.default_rng(7)
    traces = [{"x": random.normal(size=40)} for _ in range(12)]
    first = mine("always(x < ?v)", traces, {"v": (0, 10)})
    for _ in range(3):
        order = random.permutation(12)
        again = mine("always(x < ?v)", [traces[i] for i in order], {"v": (0, 10)})
        assert (again.value, again.robustness) == (first.value, first.robustness)
        assert order[again.witness.index] == first.witness.index


def test_the_witness_and_the_explanation_are_those_of_rtamt() -> None:
    random = np.random.default_rng(11)
    traces = [{"x": random.normal(size=60)} for _ in range(20)]
    result = mine("always[2:30](x < ?v)", traces, {"v": (0, 10)})
    spec = rtamt.parse(f"always[2:30](x < {result.value})")
    judged = [rtamt.judge(spec, trace) for trace in traces]
    assert all(each.verdict is Verdict.SATISFIED for each in judged)
    least = min(judged, key=lambda each: each.robustness)
    assert result.robustness == least.robustness == result.explanation.robustness
    assert judged[result.witness.index] is least
    assert result.explanation == rtamt.explain(result.specification, result.witness.trace)  # type: ignore[arg-type]  # it is columns
    (cause,) = result.explanation.causes
    assert cause.value == max(trace["x"][2:31].max() for trace in traces)


@pytest.mark.slow
def test_a_trace_is_bisected_only_if_it_moves_the_value() -> None:
    traces = [{"x": [float(i)]} for i in range(50)]
    # 17 values of each, then 14 halvings of one, and both neighbours of all.
    for given_traces in (traces, traces[::-1]):
        result = mine("always(x < ?v)", given_traces, {"v": (-10, 90)}, tolerance=0.001)
        assert result.value == 49.001
        assert result.evaluations <= 50 * 17 + 15 + 2 * 50


def test_the_last_trace_that_differs_by_less_than_a_probe_is_found() -> None:
    traces = [{"x": [10 + i / 100]} for i in range(50)]
    result = mine("always(x < ?v)", traces, {"v": (0, 100)}, tolerance=0.001)
    assert (result.value, result.witness.index) == (10.491, 49)
    assert [witness.index for witness in result.witnesses] == [49]


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
    """Return the error of `mine`."""
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
        "expected end=None, 'complete', 'cut' or 'open', got 'cutt'; did you mean 'cut'?"
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
