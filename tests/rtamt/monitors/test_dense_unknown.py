"""Unknown or uncertain values in dense time, and missing intervals: bounds around all traces."""

import itertools
import math
import pickle
import random
from typing import Any

import numpy as np
import pytest
from bits import identical
from choices import ENDS, Backend
from dense_oracle import STEP
from dense_signals import Signals, chunked, chunks, relevant, signals
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from interface_cases import Case, cases
from interface_oracle import SEMANTICS
from interval_oracle import Ends, contains, hull, inside, order
from oracle import Trace, Value, predicate
from profiles import examples
from region_oracle import Regions
from strategies import QUARTERS, formulas
from uncertain_traces import UNKNOWN, some_value

import rtamt
from rtamt import Formula, InputError, Judgement, SpecificationError, UncertainValue, Verdict
from rtamt.language.node import Node
from rtamt.machines.backend import BACKENDS
from rtamt.typing import End

Uncertain = dict[str, list[tuple[float, float | UncertainValue]]]
INF, NAN = math.inf, math.nan
V, U, S = Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.SATISFIED


@st.composite
def uncertain_signals(draw: st.DrawFn, share: float = 0.4) -> Uncertain:
    """Events of every variable, some of which are unknown."""
    rng = random.Random(draw(st.integers(0, 2**32)))
    return {
        name: [(time, some_value(rng, share)) for time, _ in events]
        for name, events in draw(signals()).items()
    }


def one_of(whole: Uncertain, rng: random.Random) -> Signals:
    """Signals that uncertain ones allow, with more changes."""
    end = min(events[-1][0] for events in whole.values())
    found: Signals = {}
    for name, events in whole.items():
        times = sorted({*(time for time, _ in events), *np.arange(events[0][0], end, STEP / 4)})
        found[name] = [(time, _number(_at(events, time), rng)) for time in times]
    return found


def _at(events: list[tuple[float, float | UncertainValue]], time: float) -> float | UncertainValue:
    return [value for t, value in events if t <= time][-1]


def _number(value: float | UncertainValue, rng: random.Random) -> float:
    return max(-1e3, min(1e3, inside(value, rng))) if value is UNKNOWN else inside(value, rng)


def of(whole: Any, formula: Formula) -> Any:  # noqa: ANN401 - signals of either kind
    return relevant(whole, formula.variables)


def values(found: Judgement | rtamt.dense.EpisodeMonitor) -> tuple[float, float, float]:
    return found.robustness, found.lower, found.upper


def around(found: Judgement, value: float) -> bool:
    return order(found.lower) <= order(value) <= order(found.upper)


@settings(max_examples=examples(25))
@given(
    formula=formulas(depth=2, endless=True, dense=True),
    whole=uncertain_signals(),
    seed=st.integers(0, 2**32),
)
def test_every_trace_inside_has_its_value_inside_the_bounds(
    formula: Formula, whole: Uncertain, seed: int, backend: Backend
) -> None:
    assume(formula.variables)
    rng, its = random.Random(seed), of(whole, formula)
    for _ in range(3):
        known = one_of(its, rng)
        later = {name: [*events, (99.0, rng.choice(QUARTERS))] for name, events in known.items()}
        after = rtamt.dense.judge(formula, later, "complete", backend=backend).robustness
        for end in ENDS:
            found = rtamt.dense.judge(formula, its, end, backend=backend)
            exact = rtamt.dense.judge(formula, known, end, backend=backend)
            assert order(found.lower) <= order(exact.lower)
            assert order(exact.upper) <= order(found.upper)
            if found.verdict is not U:
                assert exact.verdict is found.verdict
                assert (found.robustness > 0 or order(found.robustness) == (0, 1)) == (
                    found.verdict is S
                )
            if end == "complete":
                assert order(found.robustness) == order(found.lower)
            if end == "open":
                assert around(found, exact.robustness)
                assert around(found, after)


@settings(max_examples=examples(30))
@given(formula=formulas(depth=2, endless=True, dense=True, total=False), whole=uncertain_signals())
def test_the_bounds_are_those_of_intervals_at_every_instant(
    formula: Formula, whole: Uncertain, backend: Backend
) -> None:
    assume(formula.variables)
    its: Any = of(whole, formula)
    definition = Regions(its, STEP, between)
    worst, best = definition.complete(formula)
    found = rtamt.dense.judge(formula, its, "complete", backend=backend)
    assert identical(values(found), (worst, worst, best))
    for end in ENDS[1:]:
        found = rtamt.dense.judge(formula, its, end, backend=backend)
        _, lower, upper = definition.ended(formula, end)
        moved = max(lower, min(worst, upper, key=order), key=order)
        assert identical(values(found), (moved, lower, upper))
    assert found.decided_at == definition.first_decided(formula)


def between(f: Node, trace: Trace, i: int | None) -> Value:
    """Return the minimum and the maximum of a comparison of a variable with a quarter."""
    if i is None or not f.variables:
        return predicate(f, trace, i)
    (name,) = f.variables
    value: float | UncertainValue = trace[name][i]
    ends: Ends = (value, value) if isinstance(value, float) else (value.lower, value.upper)  # type: ignore[assignment] # floats
    inner = [x for x in (*QUARTERS, 0.0) if contains(ends, x)]
    return hull(predicate(f, {name: [x]}, 0)[0] for x in (*ends, *inner))


@settings(max_examples=examples(30))
@given(
    formula=formulas(depth=2, endless=True, dense=True),
    whole=uncertain_signals(),
    shares=chunks(3),
    end=st.sampled_from(ENDS),
)
def test_chunks_copies_and_back_ends_do_not_matter(
    formula: Formula, whole: Uncertain, shares: list[list[float]], end: End
) -> None:
    assume(formula.variables)
    found = rtamt.dense.judge(formula, of(whole, formula), end)
    assert set(found.unknown) <= set(formula.variables)
    for backend in BACKENDS:
        monitor = rtamt.dense.EpisodeMonitor(formula, nan="unknown", backend=backend)
        before = monitor.bounds()
        for chunk in chunked(whole, shares):  # type: ignore[arg-type] # intervals for numbers
            monitor.update({n: events for n, events in chunk.items() if n in formula.variables})
            assert order(before[0]) <= order(monitor.lower)
            assert order(monitor.upper) <= order(before[1])
            before = monitor.bounds()
            monitor = pickle.loads(pickle.dumps(monitor))
        assert monitor.decided_at == found.decided_at
        monitor.finish(end)
        assert identical(values(monitor), values(found))
        assert monitor.verdict is found.verdict


@pytest.mark.slow(backend="python")
@settings(max_examples=examples(25))
@given(
    formula=formulas(depth=2, endless=True, dense=True), whole=signals(), end=st.sampled_from(ENDS)
)
def test_without_unknown_values_nothing_changes(
    formula: Formula, whole: Signals, end: End, backend: Backend
) -> None:
    assume(formula.variables)
    its = of(whole, formula)
    found = rtamt.dense.judge(formula, its, end, backend=backend)
    assert found.unknown == ()
    columns = {n: np.array(events).T for n, events in its.items()}
    same = {n: rtamt.dense.Events(times, UncertainValue(x, x)) for n, (times, x) in columns.items()}
    for other in (
        rtamt.dense.judge(formula, same, end, backend=backend),
        rtamt.dense.judge(formula, its, end, nan="unknown", max_gap=1000, backend=backend),
    ):
        assert identical(values(other), values(found))
        assert (other.verdict, other.decided_at) == (found.verdict, found.decided_at)
    monitor = rtamt.dense.EpisodeMonitor(formula, nan="unknown", backend=backend)
    monitor.update({name: [(0, NAN), (5, NAN)] for name in its})
    monitor.reset()
    monitor.update(its)
    monitor.finish(end)
    assert identical(values(monitor), values(found))


@settings(max_examples=examples(25))
@given(
    case=cases(st.sampled_from(SEMANTICS), endless=True, dense=True),
    whole=uncertain_signals(),
    seed=st.integers(0, 2**32),
)
def test_every_semantics(case: Case, whole: Uncertain, seed: int, backend: Backend) -> None:
    spec, semantics = case
    assume(spec.variables)
    its = relevant(whole, spec.variables)
    known = one_of(its, random.Random(seed))
    for end in ENDS:
        found, exact = (
            rtamt.dense.judge(spec, each, end, semantics=semantics, backend=backend)
            for each in (its, known)
        )
        assert order(found.lower) <= order(exact.lower)
        assert order(exact.upper) <= order(found.upper)


# Holes. ------------------------------------------------------------------------------------------

TICK = STEP / 4


def with_holes(events: list[tuple[float, float]], most: float) -> list[tuple[float, float]]:
    """Return the events, and an unknown one a tick after each that starts a missing interval."""
    found = []
    for (time, value), (after, _) in itertools.pairwise(events):
        found.append((time, value))
        if after - time > most:
            found.append((time + TICK, NAN))
    return [*found, events[-1]]


@settings(max_examples=examples(30))
@given(
    formula=formulas(depth=2, endless=True, dense=True),
    whole=signals(),
    shares=chunks(3),
    most=st.sampled_from((STEP / 2, STEP, 2 * STEP)),
)
def test_a_hole_is_unknown_from_a_tick_after_the_event_before_it(
    formula: Formula, whole: Signals, shares: list[list[float]], most: float, backend: Backend
) -> None:
    assume(formula.variables)
    its = of(whole, formula)
    options: Any = {"resolution": TICK, "backend": backend}
    written = {name: with_holes(events, most) for name, events in its.items()}
    for end in ENDS:
        found = rtamt.dense.judge(formula, its, end, max_gap=most, **options)
        expected = rtamt.dense.judge(formula, written, end, nan="unknown", **options)
        assert identical(values(found), values(expected))
        assert found.decided_at == expected.decided_at
        assert found.unknown == expected.unknown
    monitor = rtamt.dense.EpisodeMonitor(formula, max_gap=f"{most}s", **options)
    for chunk in chunked(whole, shares):
        monitor.update({n: events for n, events in chunk.items() if n in formula.variables})
    assert identical(values(monitor), values(found))
    assert monitor.decided_at == found.decided_at


def test_both_instants_of_a_hole_are_known_and_the_end_is_none(backend: Backend) -> None:
    x: Signals = {"x": [(0, 1), (1, -1), (9, -1), (9.5, 1)]}
    for text, verdict in (
        ("eventually[1:1](x < 0)", S),
        ("eventually[9:9](x < 0)", S),
        ("eventually[5:5](x < 0)", U),
        ("eventually[0:1](x < 0)", S),
        ("always[0:9](x < 2)", U),
        ("always[9:9.5](x < 2)", S),
    ):
        assert rtamt.dense.judge(text, x, "complete", max_gap=1, backend=backend).verdict is verdict
        assert rtamt.dense.judge(text, x, "complete", max_gap=8, backend=backend).unknown == ()
    late: Signals = {"x": [(0, 1), (1, 1), (50, 1)], "y": [(0, 1), (0.5, 1), (1, 1)]}
    found = rtamt.dense.judge("always(x > 0 and y > 0)", late, max_gap=2, backend=backend)
    # The trace ends where the missing interval starts.
    assert (found.verdict, found.unknown) == (S, ())


DECLARED = "input float64 a\ninput float64 b = 2\nalways(a < b)"


def test_a_declared_value_leaves_no_hole(backend: Backend) -> None:
    a: Signals = {"a": [(0, 1), (1, 1), (2, 1), (3, 1)]}
    told: list[tuple[Signals, tuple[str, ...]]] = [
        (a, ()),
        ({**a, "b": [(2.5, 9), (3, 9)]}, ()),
        ({**a, "b": [(1.5, 9), (2.75, 9)]}, ("b",)),
    ]
    for whole, unknown in told:
        found = rtamt.dense.judge(DECLARED, whole, "open", max_gap=1, backend=backend)
        assert found.unknown == unknown
        events = sorted((t, name, x) for name, its in whole.items() for t, x in its)
        monitor = rtamt.dense.EpisodeMonitor(DECLARED, max_gap=1, backend=backend)
        for time, name, value in events:
            monitor.update({name: [(time, value)]})
        assert identical(values(monitor), values(found))


# What is told, and what is refused. --------------------------------------------------------------


def test_an_unknown_value_lasts_until_the_next_event(backend: Backend) -> None:
    x: Any = [(0, 3), (1, UncertainValue(1, 5)), (2, NAN), (3, 4), (9, 4)]
    monitor = rtamt.dense.EpisodeMonitor("always(x > 0)", nan="unknown", backend=backend)
    seen = []
    for event in x:
        monitor.update(x=[event])
        seen.append((monitor.robustness, monitor.lower, monitor.upper))
    assert seen == [(3, -INF, 3), (1, -INF, 3), *[(-INF, -INF, 3)] * 3]
    assert monitor.verdict is U
    assert monitor.finish() == -INF
    assert (monitor.lower, monitor.upper, monitor.verdict) == (-INF, 3, U)
    monitor.reset()
    assert monitor.update(x=[(0, -1)]) == -1
    assert monitor.verdict is V


def test_the_first_event_may_be_unknown_and_the_only_one(backend: Backend) -> None:
    whole: Any = {"x": [(0, UNKNOWN), (2, 1)], "y": [(1, UncertainValue(-1, 1)), (2, 5)]}
    found = rtamt.dense.judge(
        "always(y > -2) and (x > 0 or y <= 1)", whole, "complete", backend=backend
    )
    assert (found.verdict, found.robustness, found.unknown) == (S, 0.0, ("y", "x"))
    alone = rtamt.dense.judge(
        "x > 0", {"x": [(0, UncertainValue(1, 2))]}, "complete", backend=backend
    )
    assert (values(alone), alone.verdict) == ((1, 1, 2), S)


def test_it_prints_what_is_not_known(backend: Backend) -> None:
    whole: Signals = {"req": [(0, -1), (1, 1), (2, -1), (50, -1)], "gnt": [(0, -1), (50, -1)]}
    spec = "always(req > 0 implies eventually[0:2](gnt > 0))"
    found = rtamt.dense.judge(spec, whole, "complete", max_gap=10, backend=backend)
    assert str(found) == (
        "UNDECIDED: always(req > 0 implies eventually[0:2](gnt > 0))\n"
        'robustness -inf, bounds -inf to 1 under end="complete"\n'
        "triggered 1 time, first at time 1\n"
        "undecided under every end mode: it depends on values of req, gnt that are not\n"
        "    known"
    )
    assert pickle.loads(pickle.dumps(found)) == found
    known = rtamt.dense.judge(spec, whole, "complete", backend=backend)
    assert (known.verdict, known.unknown) == (V, ())


def test_a_term_without_a_value_is_refused_and_changes_nothing(backend: Backend) -> None:
    monitor = rtamt.dense.EpisodeMonitor("always(sqrt(x) > -1)", nan="unknown", backend=backend)
    monitor.update(x=[(0, 4)])
    before = values(monitor)
    with pytest.raises(InputError, match=r"'sqrt\(x\)' is not a number at time 1\.0, where x = U"):
        monitor.update(x=[(0.5, NAN), (1, UncertainValue(-3, -1)), (2, 1)])
    assert (values(monitor), monitor.settled) == (before, 0)
    monitor.update(x=[(0.5, UncertainValue(-3, 9)), (2, 1)])
    assert values(monitor) == (1, -INF, 2)


SIGNALS: Any = {"x": [(0, 1), (2, 3)]}


@pytest.mark.parametrize(
    "evaluate", [rtamt.dense.evaluate, rtamt.dense.explain, rtamt.dense.Monitor]
)
def test_what_gives_one_number_refuses_what_is_not_known(
    evaluate: Any,  # noqa: ANN401 - each has its own arguments
    backend: Backend,
) -> None:
    def of_signals(x: Any, **options: Any) -> None:  # noqa: ANN401
        if evaluate is rtamt.dense.Monitor:
            rtamt.dense.Monitor("x > 0", backend=backend, **options).update(x=x)
        else:
            evaluate("x > 0", {"x": x}, backend=backend, **options)

    reason = "rtamt.dense.EpisodeMonitor and rtamt.dense.judge give bounds"
    with pytest.raises(InputError, match=f"known at event 1 of 'x', got UncertainValue.*{reason}"):
        of_signals([(0, 1), (1, UncertainValue(-0.0, 0.0))])
    with pytest.raises(InputError, match=f"known at event 1 of 'x', got UncertainValue.*{reason}"):
        of_signals(rtamt.dense.Events([0, 1], UncertainValue([0, 1], [0, 2])))
    with pytest.raises(InputError, match=r"event 1 of 'x', at time 1\.0, is nan; leave it"):
        of_signals(rtamt.dense.Events([0, 1], [0, NAN]))
    for option in ({"nan": "unknown"}, {"max_gap": 1}):
        with pytest.raises(InputError, match=f"= is for unknown values; {reason}"):
            of_signals([(0, 1)], **option)


def test_errors(backend: Backend) -> None:
    with pytest.raises(InputError) as missing:
        rtamt.dense.judge("x > 0", {"x": [(0, 1), (1, NAN)]}, backend=backend)
    assert str(missing.value) == (
        "event 1 of 'x', at time 1.0, is nan; leave it out: a value lasts until the next event, "
        "or pass nan='unknown'"
    )
    with pytest.raises(InputError) as hold:
        rtamt.dense.judge("x > 0", SIGNALS, nan="hold")
    assert str(hold.value) == (
        "expected nan='raise' or nan='unknown', got 'hold'; leave events without a value out: a "
        "value lasts until the next event"
    )
    for gap in (0, -1, INF, "soon"):
        with pytest.raises(SpecificationError, match="expected a max_gap from 1e-300 to 1e300 s"):
            rtamt.dense.EpisodeMonitor("x > 0", max_gap=gap)
    monitor = rtamt.dense.EpisodeMonitor("x > 0", backend=backend)
    with pytest.raises(InputError) as between:
        monitor.update(x=[(0, 1), (1, UncertainValue(1, 2))])
    assert str(between.value) == (
        "expected a value that is known at event 1 of 'x', got UncertainValue(1.0, 2.0); "
        "pass nan='unknown' to take it"
    )
    assert math.isnan(monitor.robustness)
    monitor = rtamt.dense.EpisodeMonitor("x > 0", nan="unknown", max_gap="500ms")
    assert monitor.nan == "unknown"
    assert monitor.max_gap == 0.5


def test_events_hold_what_is_not_known() -> None:
    events = rtamt.dense.Events([0, 1, 2], UncertainValue([0, 1, INF], [2, 1, INF]))
    assert list(events) == [(0.0, UncertainValue(0, 2)), (1.0, 1.0), (2.0, INF)] == events[:]
    assert (events.values.tolist(), events.upper.tolist()) == ([0, 1, INF], [2, 1, INF])
    assert (
        repr(events) == "Events([0.0, 1.0, 2.0], UncertainValue([0.0, 1.0, inf], [2.0, 1.0, inf]))"
    )
    assert events[0] == (0.0, UncertainValue(0, 2))
    assert (
        pickle.loads(pickle.dumps(events)) == events != rtamt.dense.Events([0, 1, 2], [0, 1, INF])
    )
    known = rtamt.dense.Events([0, 1], UncertainValue([0, 4], [0, 4]))
    assert known.upper is known.values
    assert rtamt.dense.Events([0, 1], [0, NAN]) == rtamt.dense.Events([0, 1], [0, NAN])
    with pytest.raises(InputError, match=r"expected a 1-D array for the values of events"):
        rtamt.dense.Events([0, 1], UncertainValue(0, 1))
