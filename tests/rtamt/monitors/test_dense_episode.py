"""`rtamt.dense.EpisodeMonitor`: the trace so far, its bounds and when they decide."""

import copy
import math
import pickle
import random

import numpy as np
import pytest
from bits import identical
from choices import ENDS, Backend
from dense_oracle import STEP
from dense_signals import INTEGERS, Signals, chunked, chunks, relevant, signals
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from interface_cases import Case, cases, read
from interface_oracle import SEMANTICS
from profiles import examples
from region_oracle import Regions, inside
from strategies import formulas

import rtamt
from rtamt import Formula, InputError, StateError, Verdict, variable
from rtamt.inputs.event_reader import EventReader
from rtamt.language.parser import as_specification
from rtamt.machines.backend import BACKENDS
from rtamt.program.dense_lowering import NANOSECOND, compile_regions


def of(chunk: Signals, formula: Formula) -> Signals:
    """Return the events of the variables of a formula."""
    return {name: events for name, events in chunk.items() if name in formula.variables}


def seen(monitor: rtamt.dense.EpisodeMonitor) -> tuple[float, float, float]:
    return monitor.robustness, monitor.lower, monitor.upper


@settings(max_examples=examples(60))
@given(
    formula=formulas(depth=2, endless=True, dense=True), whole=signals(INTEGERS), shares=chunks(3)
)
def test_after_every_chunk_it_is_what_the_definition_says(
    formula: Formula, whole: Signals, shares: list[list[float]], backend: Backend
) -> None:
    assume(formula.variables)
    agrees(formula, whole, shares, backend)


def agrees(formula: Formula, whole: Signals, shares: list[list[float]], backend: Backend) -> None:
    """Compare a monitor after every chunk, and in every end mode, with the definition."""
    its = relevant(whole, formula.variables)
    definition = Regions(its, STEP)
    decided = definition.first_decided(formula)
    monitor = rtamt.dense.EpisodeMonitor(formula, backend=backend)
    before = monitor.bounds()
    for chunk in chunked(whole, shares):
        monitor.update(of(chunk, formula))
        after = monitor.bounds()
        assert inside(before[0], after[0], before[1])
        assert inside(before[0], after[1], before[1])
        before = after
        if math.isinf(monitor.settled):
            assert math.isnan(monitor.robustness)
            continue
        steps = int((monitor.settled - definition.begin) / STEP)
        now = definition.complete(formula, steps)[1]
        assert identical(seen(monitor), (now, *definition.open(formula, steps)))
        assert inside(monitor.lower, monitor.robustness, monitor.upper)
        known = decided is not None and decided <= monitor.settled
        assert monitor.decided_at == (decided if known else None)
        assert (monitor.verdict is Verdict.UNDECIDED) == (not known)
    for end in ENDS:
        twin = pickle.loads(pickle.dumps(monitor)) if end == "cut" else copy.copy(monitor)
        assert identical((twin.finish(end),), definition.ended(formula, end)[:1])
        assert identical(seen(twin), definition.ended(formula, end))
        assert twin.decided_at == decided


def endless_over_late(rng: random.Random) -> Formula:
    """Unbounded futures over operands that settle at different times, inside an operator."""
    first, second, third = (variable(rng.choice("abc")) > 0 for _ in range(3))
    begin = rng.randint(0, 2)
    window = begin, begin + rng.randint(1, 2)
    late = rng.choice((second.always(*window), second.eventually(*window)))
    p, q = rng.sample((first, late), 2)
    both = rng.choice((p & q, p | q))
    inner = rng.choice(
        (both.eventually(), both.always(1), p.until(q), third.until(both, 1), p.unless(q, 1))
    )
    inner = rng.choice((inner, ~inner))
    inner = rng.choice((inner, third & inner, third | inner))
    outer = inner.eventually(), inner.always(), inner.eventually(0, 2), inner.always(1, 3)
    return rng.choice((*outer, inner.once(0, 1), third.until(inner, 0, 2)))


@pytest.mark.slow(backend="python")
@settings(max_examples=examples(80))
@given(seed=st.integers(0, 2**32))
def test_so_it_is_of_futures_without_an_end_over_what_settles_late(
    seed: int, backend: Backend
) -> None:
    rng = random.Random(seed)
    formula = endless_over_late(rng)
    last = rng.randint(0, 4)
    whole = {
        name: [
            (float(time), float(rng.randint(-2, 3)))
            for time in sorted({0, last, *rng.sample(range(last + 1), rng.randint(0, last))})
        ]
        for name in "abc"
    }
    agrees(formula, whole, [[rng.random() for _ in range(2)] for _ in whole], backend)


@settings(max_examples=examples(30))
@given(case=cases(st.sampled_from(SEMANTICS), endless=True, dense=True), whole=signals())
def test_every_semantics(case: Case, whole: Signals, backend: Backend) -> None:
    spec, semantics = case
    assume(spec.variables)
    its = relevant(whole, spec.variables)
    definition = Regions(its, STEP, read(case))
    for end in ENDS:
        monitor = rtamt.dense.EpisodeMonitor(spec, semantics=semantics, backend=backend)
        monitor.update(its)
        monitor.finish(end)
        assert identical(seen(monitor), definition.ended(spec.formula, end))


@settings(max_examples=examples(30))
@given(
    formula=formulas(depth=2, endless=True, dense=True),
    whole=signals(INTEGERS),
    cut=st.floats(0, 1),
)
def test_a_copy_taken_midway_goes_on_alike(
    formula: Formula, whole: Signals, cut: float, backend: Backend
) -> None:
    assume(formula.variables)
    first, second = chunked(whole, [[cut]] * 3)
    monitor = rtamt.dense.EpisodeMonitor(formula, backend=backend)
    monitor.update(of(first, formula))
    twin = pickle.loads(pickle.dumps(monitor))
    rest = of(second, formula)
    monitor.reset()
    for events in (first, second):
        monitor.update(of(events, formula))
    twin.update(rest)
    assert identical(seen(twin), seen(monitor))
    assert twin.decided_at == monitor.decided_at
    found = rtamt.dense.judge(formula, relevant(whole, formula.variables), "open", backend=backend)
    assert identical(seen(twin), (found.robustness, found.lower, found.upper))


def test_the_decision_has_its_time_inside_a_long_step(backend: Backend) -> None:
    for text, decided in (
        ("eventually[0:100](x > 0)", 100.0),
        ("always[0:2.5](x < 0)", 2.5),
        ("eventually(once[1:2](x < 0))", 1.0),
        ("eventually(once[0.75:2](x < -1 since[0.25:1] x < 0))", None),
        ("true or x > 5", 0.0),
    ):
        monitor = rtamt.dense.EpisodeMonitor(text, backend=backend)
        monitor.update(x=[(0, -1), (250, -1)])
        assert monitor.decided_at == decided


def test_a_window_of_the_past_may_be_empty_at_the_first_instant(backend: Backend) -> None:
    monitor = rtamt.dense.EpisodeMonitor("eventually(historically[1:1](x > 0))", backend=backend)
    assert (monitor.lower, monitor.upper) == (math.inf, math.inf)
    monitor.update({"x": [(0.0, -1.0)]})
    assert (monitor.robustness, monitor.lower) == (math.inf, math.inf)


@pytest.mark.parametrize(
    ("text", "lower", "upper"),
    [
        ("eventually[0:3](eventually[0:4](x > 0 or 1 > 0))", 1.0, math.inf),
        ("eventually[0:3](eventually[0:4](x > 0 or true))", math.inf, math.inf),
        ("always[0:3](always[0:4](x > 0 and 2 > 1))", -math.inf, 1.0),
    ],
)
def test_before_the_first_event_constants_bound_the_first_instant(
    text: str, lower: float, upper: float, backend: Backend
) -> None:
    monitor = rtamt.dense.EpisodeMonitor(text, backend=backend)
    assert (monitor.lower, monitor.upper) == (lower, upper)


@pytest.mark.parametrize(
    ("text", "last", "bounds"),
    [
        ("always(eventually[1:inf](eventually[0:1](x > 0) and y > 0))", -5.0, (-math.inf, -5.0)),
        ("eventually(always[1:inf](always[0:1](x > 0) or y > 0))", 5.0, (5.0, math.inf)),
    ],
)
def test_the_last_instant_of_which_a_cut_trace_shows_something_reads_that_alone(
    text: str, last: float, bounds: tuple[float, float], backend: Backend
) -> None:
    """At 4 s the inner operator starts at the end, where y has a new value."""
    monitor = rtamt.dense.EpisodeMonitor(text, resolution="1s", backend=backend)
    monitor.update(x=[(0, 2.0), (5, 2.0)], y=[(0, -last), (5, last)])
    monitor.finish("cut")
    assert (monitor.lower, monitor.upper) == bounds


def test_until_over_a_late_operand_reads_its_left_side_at_every_step(backend: Backend) -> None:
    late = "(y == -1) until[0.25:1] (eventually[0.75:0.75] always[0.25:1.75] (x < -1))"
    monitor = rtamt.dense.EpisodeMonitor(late, backend=backend)
    monitor.update(x=[(0, -2), (1.75, 2)], y=[(0, -1), (0.5, 2), (1, -2), (1.75, -1)])
    assert (monitor.robustness, monitor.verdict) == (-3, Verdict.VIOLATED)


def test_two_invariants_are_one_formula(backend: Backend) -> None:
    monitor = rtamt.dense.EpisodeMonitor("always(a > 0) and always(b > 0)", backend=backend)
    assert monitor.update(a=[(0, 2), (5, 2)], b=[(0, 1), (3, -1), (4, 1)]) == -1
    assert (monitor.verdict, monitor.decided_at, monitor.settled) == (Verdict.VIOLATED, 3, 4)


@pytest.mark.slow(backend="python")
def test_memory_is_that_of_the_windows(backend: Backend) -> None:
    text = (
        "always(x > 0 implies eventually[0:2](y > 0)) and always(x > 0 implies eventually(y > 1))"
    )
    monitor = rtamt.dense.EpisodeMonitor(text, backend=backend)
    sizes = []
    for i in range(300):
        monitor.update(x=[(i, (-1) ** i)], y=[(i, 2 * (-1) ** (i // 2))])
        sizes.append(len(pickle.dumps(monitor)))
    assert max(sizes[100:]) <= max(sizes[:100]) + 64


def test_nothing_is_settled_before_all_variables_are_known(backend: Backend) -> None:
    monitor = rtamt.dense.EpisodeMonitor("always(x > y)", backend=backend)
    assert monitor.settled == -math.inf
    monitor.update(x=[(0, 1), (1, 2)])
    assert monitor.settled == -math.inf
    monitor.update(y=[(3, 1)])
    assert monitor.settled == -math.inf
    monitor.update(x=[(5, 4)])
    assert monitor.settled == 3.0


def test_a_whole_trace_is_refused_by_the_machine_where_nothing_overlaps(backend: Backend) -> None:
    regions = compile_regions(as_specification("always(x > y)"), NANOSECOND)
    reader = EventReader(regions, bounds=True)
    machine = BACKENDS[backend].dense_episode_machine(regions, reader)
    apart = reader.whole({"x": [(0, 1), (1, 2)], "y": [(3, 1)]})
    with pytest.raises(InputError, match=r"^expected signals that overlap in time, got 'x', which"):
        machine.run(apart)


def test_errors(backend: Backend) -> None:
    monitor = rtamt.dense.EpisodeMonitor("always(sqrt(x) > y)", backend=backend)
    assert math.isnan(monitor.robustness)
    with pytest.raises(StateError, match="needs an event of every variable, got none of 'x'"):
        monitor.finish()
    monitor.update(x=[(0, 4)], y=[(0, 1)])
    before = monitor.__reduce__()[-1]
    for events, message in (
        ({"x": [(1, -1)], "y": [(1, 1)]}, r"'sqrt\(x\)' is not a number at time 1.0"),
        ({"x": [(0, 1)]}, "expected a time after 0.0 at event 0"),
        ({"z": [(1, 1)]}, "'z'"),
        ({"x": [(1, math.nan)]}, "is nan"),
    ):
        with pytest.raises(InputError, match=message):
            monitor.update(events)
        assert repr(monitor.__reduce__()[-1]) == repr(before)
    with pytest.raises(InputError, match="expected end="):
        monitor.finish("later")  # type: ignore[arg-type] # refused
    assert monitor.finish("cut") == 1.0
    with pytest.raises(StateError, match="the trace is finished"):
        monitor.update(x=[(1, 1)])
    assert monitor.finish() == 1.0
    monitor.reset()
    assert not monitor.finished


def test_a_refused_chunk_leaves_what_waits(backend: Backend) -> None:
    monitor = rtamt.dense.EpisodeMonitor("always(sqrt(x) + y > 1)", backend=backend)
    monitor.update(x=[(0, 4), (2, 9)], y=[(0, 1), (1, 3)])
    before = seen(monitor), monitor.settled
    roots = np.arange(1.0, 1_001.0)
    roots[700] = -1.0
    with pytest.raises(InputError, match=r"at time 703\.0, where x = -1\.0"):
        monitor.update(x=rtamt.dense.Events(np.arange(3.0, 1_003.0), roots), y=[(4, 5), (2_000, 5)])
    assert (seen(monitor), monitor.settled) == before
    monitor.update(x=[(3, 0), (5, 16)], y=[(2.5, 0.5), (6, 7)])
    assert (monitor.robustness, monitor.settled, monitor.decided_at) == (-0.5, 5, 3)


def test_events_that_wait_are_copies(backend: Backend) -> None:
    monitor = rtamt.dense.EpisodeMonitor("always(x + y > 0)", backend=backend)
    times, values = np.arange(4, dtype=np.int64) * 10**9, np.array([3.0, 2.0, 5.0, 4.0])
    monitor.update(x=rtamt.dense.Events(times, values))
    values[:] = times[:] = -9
    monitor.update(y=[(0, 1), (2, 0)])
    assert monitor.robustness == 3
    monitor.update(y=[(10**9, 0), (4 * 10**9, 1)])
    assert (monitor.robustness, monitor.settled) == (2, 3 * 10**9)


DECLARED = """
input float64 x
input float64 y = 2
out = always(x > 0 implies eventually[0:2](y > 1))
"""


def test_a_declared_value_lasts_until_the_first_event(backend: Backend) -> None:
    x = [(0.0, 1.0), (1.0, -1.0), (4.0, 1.0), (9.0, 1.0)]
    for y in ([], [(5.0, 0.0), (8.0, 3.0), (9.5, 3.0)]):
        events = sorted([(t, "x", v) for t, v in x] + [(t, "y", v) for t, v in y])
        monitor = rtamt.dense.EpisodeMonitor(DECLARED, backend=backend)
        for time, name, value in events:
            monitor.update({name: [(time, value)]})
            assert monitor.settled <= time
        whole = {"x": x, "y": y} if y else {"x": x}
        at_once = rtamt.dense.EpisodeMonitor(DECLARED, backend=backend)
        at_once.update(whole)
        found = rtamt.dense.judge(DECLARED, whole, "open", backend=backend)
        expected = found.robustness, found.lower, found.upper
        assert identical(seen(monitor), expected)
        assert identical(seen(at_once), expected)
        assert monitor.settled == at_once.settled == 9
        assert monitor.decided_at == at_once.decided_at == found.decided_at


def test_the_first_event_after_a_declared_value_is_later_than_what_is_settled(
    backend: Backend,
) -> None:
    monitor = rtamt.dense.EpisodeMonitor(DECLARED, backend=backend)
    monitor.update(x=[(0, 1), (6, 1)])
    assert (monitor.settled, monitor.robustness) == (6, 1)
    with pytest.raises(InputError, match=r"expected a time after 6\.0 at event 0 of 'y', got 3\.0"):
        monitor.update(y=[(3, 0)])
    monitor.update(y=[(7, 0)], x=[(9.5, 1)])
    assert monitor.settled == 7


def test_it_shows_its_formula_and_its_verdict(backend: Backend) -> None:
    monitor = rtamt.dense.EpisodeMonitor("always(x > 0)", backend=backend)
    assert repr(monitor) == "<DenseEpisodeMonitor of always(x > 0), UNDECIDED>"
    monitor.update({"x": [(0.0, -1.0), (1.0, -1.0)]})
    assert repr(monitor) == "<DenseEpisodeMonitor of always(x > 0), VIOLATED>"
