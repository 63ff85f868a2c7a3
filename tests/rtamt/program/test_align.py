"""Bounds between two samples are rounded as `align` sets it, and nothing else changes."""

import copy
import pickle
from collections.abc import Callable
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import Trace, formulas, length, sample, traces

import rtamt
from rtamt import Formula, InputError, Interval, SpecificationError
from rtamt.language.formula import make
from rtamt.language.node import Node
from rtamt.typing import Align

WAYS: tuple[Align, ...] = ("outward", "inward", "nearest")
PERIODS = (Fraction(1, 10), Fraction(3, 10), Fraction(1, 15), Fraction(7, 4))
UNITS = {None: 1, "s": 1, "ms": 1000}
ways = pytest.mark.parametrize("align", WAYS)


def whole(steps: Fraction, align: Align, *, begin: bool) -> int:
    """Return the sample of a bound, by integer arithmetic on twice its number of steps."""
    low, rest = divmod(steps.numerator, steps.denominator)
    if rest == 0:
        return low
    if align == "nearest":
        doubled = 2 * rest - steps.denominator
        return low + (doubled > 0 or (doubled == 0 and not begin))
    return low + ((align == "outward") != begin)


def rebuilt(formula: Node, interval: Callable[[Interval], Interval | None]) -> Node:
    """Return the formula with every interval replaced."""
    if formula.op is None:
        return formula
    args = tuple(rebuilt(arg, interval) for arg in formula.args)
    new = None if formula.interval is None else interval(formula.interval)
    return make(formula.op.name, args, new)


@st.composite
def misfits(draw: st.DrawFn) -> tuple[Formula, Formula, Fraction, Align]:
    """A formula with bounds between samples, the same in samples, the period, the rounding."""
    drawn = draw(formulas(endless=True))
    period, align = draw(st.sampled_from(PERIODS)), draw(st.sampled_from(WAYS))
    rounded: dict[Interval, Interval | None] = {}

    def stretched(interval: Interval) -> Interval | None:
        shift, more = (Fraction(draw(st.integers(0, 7)), 8) for _ in range(2))
        unit = draw(st.sampled_from([*UNITS]))
        scale = period * UNITS[unit]
        # Bounds are decimal numbers; some multiples of a period of 1/15 are not.
        begin = Fraction(round((interval.begin + shift) * scale * 1000), 1000)
        end = None
        if interval.end is not None:
            end = Fraction(round((interval.end + shift + more) * scale * 1000), 1000)
        new = Interval(begin, end, unit)
        first = whole(begin / scale, align, begin=True)
        last = None if end is None else whole(end / scale, align, begin=False)
        assume(last is None or first <= last)
        rounded[new] = Interval.of(first, last)
        return new

    misfit = rebuilt(drawn, stretched)
    fitting = rebuilt(misfit, lambda interval: rounded[interval])
    assert isinstance(misfit, Formula)
    assert isinstance(fitting, Formula)
    return misfit, fitting, period, align


@given(misfits(), traces())
def test_a_trace_is_judged_as_with_the_rounded_bounds(
    case: tuple[Formula, Formula, Fraction, Align], trace: Trace
) -> None:
    misfit, fitting, period, align = case
    for backend in ("native", "python"):
        got = rtamt.evaluate(misfit, trace, period, n=length(trace), align=align, backend=backend)
        expected = rtamt.evaluate(fitting, trace, n=length(trace), backend=backend)
        np.testing.assert_array_equal(got, expected)
    why = rtamt.explain(misfit, trace, period, n=length(trace), align=align)
    assert why.robustness == expected[0]
    if misfit.variables:
        table = np.array([[trace[name] for name in misfit.variables]]).transpose(0, 2, 1)
        many = rtamt.evaluate(misfit, table, period, align=align)
        np.testing.assert_array_equal(many[0], expected)


@given(misfits(), traces())
def test_monitors_run_with_the_rounded_bounds(
    case: tuple[Formula, Formula, Fraction, Align], trace: Trace
) -> None:
    misfit, fitting, period, align = case
    got = rtamt.EpisodeMonitor(misfit, period, align=align)
    expected = rtamt.EpisodeMonitor(fitting)
    entries = rtamt.VectorEpisodeMonitor(misfit, 2, period, align=align)
    for i in range(length(trace)):
        row = [sample(trace, i)[name] for name in got.variables]
        got.update(*row)
        expected.update(*row)
        entries.update([row, row])
        values = (expected.robustness, *expected.bounds())
        np.testing.assert_array_equal((got.robustness, *got.bounds()), values)
        np.testing.assert_array_equal(
            (entries.robustness[1], entries.lower[1], entries.upper[1]), values
        )


@given(misfits(), traces())
def test_values_come_as_late_as_with_the_rounded_bounds(
    case: tuple[Formula, Formula, Fraction, Align], trace: Trace
) -> None:
    misfit, fitting, period, align = case
    try:
        expected = rtamt.Monitor(fitting)
    except SpecificationError:  # an unbounded future
        with pytest.raises(SpecificationError, match="without an end"):
            rtamt.Monitor(misfit, period, align=align)
        return
    got = rtamt.Monitor(misfit, period, align=align)
    entries = rtamt.VectorMonitor(misfit, 2, period, align=align)
    assert got.latency == entries.latency == expected.latency
    for i in range(length(trace)):
        row = [sample(trace, i)[name] for name in got.variables]
        value = expected.update(*row)
        np.testing.assert_array_equal(got.update(*row), value)
        np.testing.assert_array_equal(entries.update([row, row]), [value, value])


@ways
def test_a_bound_that_fits_stays(align: Align) -> None:
    monitor = rtamt.Monitor("always[0.2:0.5](x > 0)", 0.1, align=align)
    assert "[2, 5]" in str(monitor.program)
    assert monitor.program.aligned == ()


LISTED: list[tuple[str, object, Align, tuple[str, ...]]] = [
    ("always[0.11:0.25](x > 0)", 0.1, "outward", ("[0.11:0.25] is samples 1 to 3, 0.1 to 0.3 s",)),
    ("always[0.11:0.25](x > 0)", 0.1, "inward", ("[0.11:0.25] is samples 2 to 2, 0.2 to 0.2 s",)),
    ("always[0.15:0.25](x > 0)", 0.1, "nearest", ("[0.15:0.25] is samples 1 to 3, 0.1 to 0.3 s",)),
    ("once[15:25ms](x > 0)", 0.01, "nearest", ("[15:25ms] is samples 1 to 3, 10 to 30 ms",)),
    ("once[0.5:inf](x > 0)", "1/3", "outward", ("[0.5:inf] is samples 1 to inf, 1/3 to inf s",)),
    ("once[0:2.5](x > 0)", None, "inward", ("[0:2.5] is samples 0 to 2",)),
    (
        "always[0:1](once[0:0.7](x > 0) and once[0:0.7](y > 0) and once[0:2](x > 0))",
        "0.5",
        "outward",
        ("[0:0.7] is samples 0 to 2, 0 to 1 s",),
    ),
]


@pytest.mark.parametrize(("text", "period", "align", "lines"), LISTED)
def test_the_listing_says_what_each_interval_became(
    text: str, period: str, align: Align, lines: tuple[str, ...]
) -> None:
    given_period = Fraction(1, 3) if period == "1/3" else period
    monitor = rtamt.EpisodeMonitor(text, given_period, align=align)
    assert monitor.program.aligned == lines
    assert str(monitor.program).endswith("\n" + "\n".join(lines))


def test_an_explanation_says_what_an_interval_became() -> None:
    why = rtamt.explain("always[0:0.25](x > 1)", {"x": [3, 2, 3, 0]}, 0.1, align="outward")
    assert why.steps[0].aligned == "[0:0.25] is samples 0 to 3, 0 to 0.3 s"
    assert why.steps[1].aligned is None
    assert "\n                [0:0.25] is samples 0 to 3, 0 to 0.3 s\n" in str(why)
    fitting = rtamt.explain("always[0:0.2](x > 1)", {"x": [3, 2, 3, 0]}, 0.1, align="outward")
    assert fitting.steps[0].aligned is None


def test_a_history_is_explained_with_the_rounded_bounds() -> None:
    episode = rtamt.EpisodeMonitor("eventually[0:0.25](x > 1)", 0.1, history=True, align="inward")
    for x in (0, 1, 0.5, 9):
        episode.update(x)
    assert episode.explain().causes == (rtamt.explain("x", {"x": [0, 1]}, sample=1).causes)


@given(misfits(), traces())
def test_a_trace_is_judged_cut_with_the_rounded_bounds(
    case: tuple[Formula, Formula, Fraction, Align], trace: Trace
) -> None:
    misfit, fitting, period, align = case
    assume(misfit.variables)
    got = rtamt.judge(misfit, trace, period, align=align)
    expected = rtamt.judge(fitting, trace)
    assert (got.robustness, got.verdict) == (expected.robustness, expected.verdict)
    np.testing.assert_array_equal((got.lower, got.upper), (expected.lower, expected.upper))


@ways
@pytest.mark.parametrize("kind", [rtamt.Monitor, rtamt.EpisodeMonitor])
def test_copies_and_pickles_keep_it(kind: type[rtamt.Monitor], align: Align) -> None:
    monitor = kind("once[0.11:0.35](x > 0)", 0.1, align=align)
    for x in (1.0, -2.0, 3.0):
        monitor.update(x)
    twins = (copy.copy(monitor), copy.deepcopy(monitor), pickle.loads(pickle.dumps(monitor)))
    for twin in twins:
        assert str(twin.program) == str(monitor.program)
    for x in (4.0, -5.0, 6.0, -7.0, 0.0):
        value = monitor.update(x)
        assert [twin.update(x) for twin in twins] == [value] * 3


def test_a_vector_monitor_keeps_it() -> None:
    entries = rtamt.VectorMonitor("once[0.11:0.35](x > 0)", 2, 0.1, align="inward")
    assert "[-3, -2]" in str(pickle.loads(pickle.dumps(entries)).program)


def test_one_specification_is_compiled_for_each_way() -> None:
    spec = rtamt.parse("once[0.11:0.35](x > 0)")
    windows = {align: str(rtamt.Monitor(spec, 0.1, align=align).program) for align in WAYS}
    assert "[-4, -1]" in windows["outward"]
    assert "[-3, -2]" in windows["inward"]
    assert "[-4, -1]" in windows["nearest"]
    with pytest.raises(SpecificationError, match="not a multiple"):
        rtamt.Monitor(spec, 0.1)


@ways
def test_a_unit_needs_a_period_all_the_same(align: Align) -> None:
    with pytest.raises(SpecificationError, match="has a unit, but no period is known"):
        rtamt.Monitor("always[0:15ms](x > 0)", align=align)


@ways
def test_a_bound_is_limited_all_the_same(align: Align) -> None:
    with pytest.raises(SpecificationError, match=r"is 2147483649 samples; the limit is 2147483648"):
        rtamt.Monitor("once[0:2147483648.5](x > 0)", align=align)


@pytest.mark.parametrize("align", ["up", "Outward", "", 1, ["outward"], True, np.array(["inward"])])
def test_another_way_is_refused(align: Align) -> None:
    for call in (rtamt.Monitor, rtamt.EpisodeMonitor):
        with pytest.raises(InputError) as caught:
            call("x > 0", align=align)
        assert str(caught.value) == (
            f"expected align=None, 'outward', 'inward' or 'nearest', got {align!r}"
        )
