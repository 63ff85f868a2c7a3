"""Laws of `EpisodeMonitor`: robustness if the episode ended now, bounds, verdict, finish."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import episode, horizon
from strategies import INFINITIES, TERMS, Trace, formulas, length, rooted, sample, traces

import rtamt
from rtamt import EpisodeMonitor, Formula, InputError, StateError, Verdict, evaluate
from rtamt.operators import OPERATORS

Backend = Literal["native", "python"]
INF = math.inf


def offered(monitor: EpisodeMonitor) -> tuple[float, float, float]:
    """Robustness and bounds."""
    return monitor.robustness, monitor.lower, monitor.upper


def feed(monitor: EpisodeMonitor, trace: Trace, i: int) -> float:
    """What update gives at one sample of a trace."""
    return monitor.update(sample(trace, i, monitor.variables))


def verdict(lower: float, upper: float) -> Verdict:
    """The verdict that bounds decide."""
    if upper < 0:
        return Verdict.VIOLATED
    return Verdict.SATISFIED if lower > 0 else Verdict.UNDECIDED


def agrees_with_its_definition(formula: Formula, trace: Trace, backend: Backend) -> None:
    """Compare with the oracle before the first sample and after every one."""
    monitor = EpisodeMonitor(formula, backend=backend)
    for n in range(length(trace) + 1):
        if n:
            assert feed(monitor, trace, n - 1) == monitor.robustness
        expected = episode(formula, trace, n)
        assert np.array_equal(offered(monitor), expected, equal_nan=True), n
        assert monitor.verdict is verdict(*expected[1:])
        assert (monitor.samples, monitor.finished) == (n, False)


# The definition. ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in OPERATORS if name not in TERMS])
@settings(max_examples=25)
@given(data=st.data(), trace=traces(most=10))
def test_every_operator_is_bounded_as_its_definition_says(
    name: str, data: st.DataObject, trace: Trace, backend: Backend
) -> None:
    formula = data.draw(rooted(name, depth=1, endless=True))
    agrees_with_its_definition(formula, trace, backend)


@pytest.mark.parametrize("name", [n for n, row in OPERATORS.items() if row.operands == "formula"])
@settings(max_examples=25)
@given(data=st.data(), trace=traces(most=10))
def test_every_operator_is_bounded_below_an_endless_window(
    name: str, data: st.DataObject, trace: Trace, backend: Backend
) -> None:
    inner = data.draw(rooted(name, depth=1, endless=True))
    formula = data.draw(st.sampled_from([inner.always(), inner.always(1, 3).eventually()]))
    agrees_with_its_definition(formula, trace, backend)


@settings(max_examples=200)
@given(formula=formulas(depth=3), trace=traces(most=14))
def test_bounded_formulas_agree_with_the_definition(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    agrees_with_its_definition(formula, trace, backend)


@settings(max_examples=200)
@given(formula=formulas(depth=2, endless=True), trace=traces(most=12))
def test_endless_formulas_agree_with_the_definition(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    agrees_with_its_definition(formula, trace, backend)


@given(formula=formulas(depth=2, endless=True, total=False), trace=traces(values=INFINITIES))
def test_infinite_samples_agree_with_the_definition(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    agrees_with_its_definition(formula, trace, backend)


@settings(max_examples=25)
@given(
    inner=formulas(depth=1),
    begin=st.integers(0, 9),
    width=st.integers(0, 9),
    outer=st.integers(0, 9),
    trace=traces(least=20, most=40),
)
def test_nested_windows_longer_than_the_strategies_draw_agree_with_the_definition(
    inner: Formula, begin: int, width: int, outer: int, trace: Trace, backend: Backend
) -> None:
    formula = inner.eventually(begin, begin + width).always(0, outer)
    agrees_with_its_definition(formula, trace, backend)


# What follows from it. ---------------------------------------------------------------------------


@given(formula=formulas(endless=True, depth=2), trace=traces(most=14))
def test_upper_never_rises_lower_never_falls_and_a_verdict_stays(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    lower, upper, before = monitor.lower, monitor.upper, monitor.verdict
    for i in range(length(trace)):
        feed(monitor, trace, i)
        assert lower <= monitor.lower <= monitor.upper <= upper
        assert before in {Verdict.UNDECIDED, monitor.verdict}
        lower, upper, before = monitor.lower, monitor.upper, monitor.verdict


@given(formula=formulas(depth=2), trace=traces(least=18, most=18))
def test_bounds_hold_for_what_comes(formula: Formula, trace: Trace, backend: Backend) -> None:
    assert horizon(formula) < length(trace)
    whole = evaluate(formula, trace, n=length(trace), backend=backend)[0]
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(length(trace)):
        assert monitor.lower <= whole <= monitor.upper
        feed(monitor, trace, i)
    assert offered(monitor) == (whole, whole, whole)


@given(formula=formulas(endless=True, depth=2), trace=traces(most=12))
def test_robustness_is_the_offline_robustness_at_the_first_sample(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(length(trace)):
        seen = {name: values[: i + 1] for name, values in trace.items()}
        assert feed(monitor, trace, i) == evaluate(formula, seen, n=i + 1, backend=backend)[0]


# The moment of the verdict. ----------------------------------------------------------------------

V, U, S = Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.SATISFIED

MOMENTS = [
    ("always[0:100](x > 0)", [1, 1, -1, 1], [U, U, V, V]),
    ("always(x > 0)", [1, 1, -1, 1], [U, U, V, V]),
    ("eventually[0:3](x > 0)", [-1] * 5, [U, U, U, V, V]),
    ("eventually[0:3](x > 0)", [-1, 1, -1], [U, S, S]),
    ("eventually(x > 0)", [-1, -1, 1, -1], [U, U, S, S]),
    ("not always(x > 0)", [1, -1, 1], [U, S, S]),
    ("always[2:4](x > 0)", [-1, -1, 1, 1, 1, -1], [U, U, U, U, S, S]),
    ("always[1:2](x > 0) and eventually[0:5](x > 9)", [9, 9, -1], [U, U, V]),
    ("(x > 0) until[0:3] (x > 5)", [1, 1, -1], [U, U, V]),
    ("(x > 0) until[0:3] (x > 5)", [1, 6, -1], [U, S, S]),
    ("(x > 0) until[2:3] (x > 5)", [1, 6, 6], [U, U, S]),
    ("(x > 0) until (x > 5)", [1, 1, 1, 0.5, -1], [U, U, U, U, V]),
    ("always(eventually[0:2](x > 0))", [-1, -1, -1, 5], [U, U, V, V]),
    ("always((x > 3) implies eventually[0:2](x < 1))", [4, 2, 2, 0], [U, U, V, V]),
    ("always((x > 3) implies eventually(x < 1))", [4, 2, 2, 2], [U, U, U, U]),
    ("eventually(always[0:2](x > 0))", [1, 1, -1, 1, 1, 1], [U, U, U, U, U, S]),
    ("always(x > 0 or true)", [-1, -1], [S, S]),
    ("next(x > 0)", [-1, -1], [U, V]),
    ("next(next(x > 0))", [-1, -1, 1], [U, U, S]),
    ("x > 0", [-1, 1], [V, V]),
    ("x > 0", [0, 1], [U, U]),
    ("eventually[0:2](prev(x > 0))", [-1, 1, -1], [S, S, S]),
    ("eventually[1:2](s_prev(x > 0))", [-1, 1, -1], [U, S, S]),
    ("always(once(x > 0))", [1, -1], [S, S]),
    ("eventually(historically(x > 0))", [-1, 1], [V, V]),
    ("always[0:2](historically(x > 0))", [1, 1, -1, -1], [U, U, V, V]),
    ("eventually[0:3](false)", [0], [V]),
    ("always[0:3](3 > 2)", [], []),
]


@pytest.mark.parametrize(("text", "xs", "verdicts"), MOMENTS)
def test_the_verdict_comes_at_the_first_sample_that_decides_it(
    text: str, xs: list[float], verdicts: list[Verdict], backend: Backend
) -> None:
    monitor = EpisodeMonitor(text, backend=backend)
    found = []
    for x in xs:
        monitor.update(dict.fromkeys(monitor.variables, x))
        found.append(monitor.verdict)
    assert found == verdicts


def test_eventually_is_violated_after_its_last_sample_and_not_before(backend: Backend) -> None:
    monitor = EpisodeMonitor("eventually[0:100](x > 0)", backend=backend)
    for _ in range(100):
        monitor.update(x=-1.0)
    assert monitor.verdict is U
    monitor.update(x=-1.0)
    assert monitor.verdict is V


def test_an_empty_cut_window_puts_robustness_outside_the_bounds(backend: Backend) -> None:
    monitor = EpisodeMonitor("eventually[2:3](x > 0) or x > 5", backend=backend)
    monitor.update(x=7.0)
    assert offered(monitor) == (2.0, 2.0, INF)
    monitor = EpisodeMonitor("not eventually[2:3](true)", backend=backend)
    monitor.update()
    assert offered(monitor) == (INF, -INF, -INF)


# The beginning and the end. ----------------------------------------------------------------------


@given(formula=formulas(endless=True, depth=2))
def test_before_the_first_sample_there_are_the_bounds_of_the_empty_prefix(
    formula: Formula, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    _, lower, upper = episode(formula, {}, 0)
    assert math.isnan(monitor.robustness)
    assert (monitor.lower, monitor.upper) == (lower, upper)


def test_before_the_first_sample_nothing_is_decided(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(x > 0)", backend=backend)
    assert math.isnan(monitor.robustness)
    assert (monitor.lower, monitor.upper, monitor.verdict) == (-INF, INF, U)
    assert not monitor.finished


@given(formula=formulas(endless=True, depth=2), trace=traces(most=8))
def test_finish_closes_the_episode_once_and_keeps_what_was_decided(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(length(trace)):
        feed(monitor, trace, i)
    robustness, lower, upper = offered(monitor)
    decided = monitor.verdict
    for _ in range(2):
        assert monitor.finish() == monitor.robustness == robustness
        assert monitor.finished
        if decided is U:
            assert monitor.lower == monitor.upper == robustness
            assert monitor.verdict is verdict(robustness, robustness)
        else:
            assert (monitor.lower, monitor.upper, monitor.verdict) == (lower, upper, decided)
    with pytest.raises(StateError):
        feed(monitor, trace, 0)
    assert monitor.samples == length(trace)
    assert monitor.robustness == robustness


@pytest.mark.parametrize(
    ("text", "x", "robustness", "closed"),
    [
        ("always(x > 0)", 2.0, 2.0, S),
        ("eventually(x > 0)", -2.0, -2.0, V),
        ("always(x > 0)", 0.0, 0.0, U),
        ("always(x > 0)", -1.0, -1.0, V),
        ("eventually[5:9](x > 0)", 1.0, -INF, V),
        ("always[5:9](x > 0)", -1.0, INF, S),
        ("next(x > 0)", -1.0, INF, S),
        ("s_next(x > 0)", 1.0, -INF, V),
    ],
)
def test_finish_gives_an_open_verdict_the_sign_of_the_robustness(
    text: str, x: float, robustness: float, closed: Verdict, backend: Backend
) -> None:
    monitor = EpisodeMonitor(text, backend=backend)
    monitor.update(x=x)
    assert monitor.finish() == robustness
    assert monitor.verdict is closed


def test_update_after_finish_is_refused_until_reset(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(x > 0)", backend=backend)
    monitor.update(x=1.0)
    monitor.finish()
    with pytest.raises(StateError) as caught:
        monitor.update(x=1.0)
    assert str(caught.value) == "the episode is finished; call reset() before the next update"
    monitor.reset()
    assert (monitor.finished, monitor.verdict) == (False, U)
    assert monitor.update(x=-1.0) == -1.0


def test_finish_before_any_sample_is_refused(backend: Backend) -> None:
    monitor = EpisodeMonitor("always(x > 0)", backend=backend)
    with pytest.raises(StateError) as caught:
        monitor.finish()
    assert str(caught.value) == "finish() needs at least one sample, got none since reset"
    assert not monitor.finished
    assert monitor.update(x=1.0) == 1.0


def test_too_many_endless_operators_inside_others_are_refused(backend: Backend) -> None:
    text = "always(" + " and ".join(f"eventually(x > {i})" for i in range(7)) + ")"
    with pytest.raises(rtamt.SpecificationError) as caught:
        EpisodeMonitor(text, backend=backend)
    assert str(caught.value) == (
        "the formula has 7 operators without an end inside others; the limit is 6; "
        "write an end, as in eventually[0:100]"
    )


# State. ------------------------------------------------------------------------------------------

DUPLICATES: dict[str, Callable[[EpisodeMonitor], EpisodeMonitor]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda monitor: pickle.loads(pickle.dumps(monitor)),
}


@pytest.mark.parametrize("duplicate", DUPLICATES)
@settings(max_examples=40)
@given(formula=formulas(endless=True, depth=2), trace=traces(most=12), data=st.data())
def test_a_duplicate_mid_run_continues_like_the_original_and_apart_from_it(
    duplicate: str, formula: Formula, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    n = length(trace)
    cut = data.draw(st.integers(0, n))
    original, whole = (EpisodeMonitor(formula, backend=backend) for _ in range(2))
    for i in range(cut):
        feed(original, trace, i)
    twin = DUPLICATES[duplicate](original)
    for i in range(n):
        feed(whole, trace, i)
    for monitor in (twin, original):
        assert (monitor.backend, monitor.samples) == (backend, cut)
        for i in range(cut, n):
            feed(monitor, trace, i)
        assert offered(monitor) == offered(whole)
    twin.finish()
    assert DUPLICATES[duplicate](twin).finished
    assert not original.finished


@given(formula=formulas(endless=True, depth=2), trace=traces(most=12), data=st.data())
def test_reset_forgets_everything(
    formula: Formula, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    n = length(trace)
    monitor, fresh = (EpisodeMonitor(formula, backend=backend) for _ in range(2))
    for i in range(data.draw(st.integers(1, n))):
        feed(monitor, trace, n - 1 - i)
    if data.draw(st.booleans()):
        monitor.finish()
    monitor.reset()
    assert np.array_equal(offered(monitor), offered(fresh), equal_nan=True)
    for i in range(n):
        feed(monitor, trace, i)
        feed(fresh, trace, i)
        assert offered(monitor) == offered(fresh)


@given(formula=formulas(endless=True, depth=2).filter(lambda f: bool(f.variables)), trace=traces())
def test_refused_input_leaves_the_episode_as_it_was(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    monitor, twin = (EpisodeMonitor(formula, backend=backend) for _ in range(2))
    for i in range(length(trace)):
        good = sample(trace, i, monitor.variables)
        for bad in (dict.fromkeys(good, math.nan), {**good, "else": 0.0}, {}):
            with pytest.raises(InputError):
                monitor.update(bad)
        assert monitor.update(good) == twin.update(good)
        assert offered(monitor) == offered(twin)
