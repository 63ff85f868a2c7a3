"""The machine in dense time in C++ against its definition in Python, call by call."""

from __future__ import annotations

import collections
import fractions
import itertools
import math
import random
import types
from collections.abc import Callable, Mapping
from typing import Any, Literal, cast

import numpy as np
import pytest
from dense_signals import INTEGERS, Breakpoints, Signals, bitwise, chunked, chunks, of, signals
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import DENSE, INFINITIES, formulas, rooted

import rtamt
from rtamt import Formula, StateError

pytest.importorskip("rtamt._native", reason="no compiler was at hand")

Backend = Literal["native", "python"]
Outcome = object

scales = st.sampled_from((1.0, 0.1, 1 / 3, 1e3))
"""Factors of times: differences are rounded if bounds are not multiples of a step."""


Kind = type[rtamt.dense.Monitor] | type[rtamt.dense.EpisodeMonitor]
AnyMonitor = rtamt.dense.Monitor | rtamt.dense.EpisodeMonitor


def both(formula: Formula | str, kind: Kind = rtamt.dense.Monitor) -> tuple[Any, Any]:
    return kind(formula, backend="native"), kind(formula, backend="python")


def scaled(whole: Signals, scale: float) -> Signals:
    return {name: [(t * scale, v) for t, v in events] for name, events in whole.items()}


def outcome(call: Callable[[], object]) -> Outcome:
    """Return the result of a call, or its error; values with all their digits and signs."""
    try:
        return repr(call())
    except (ValueError, TypeError, OSError, StateError) as error:
        return type(error), str(error)


def state(monitor: AnyMonitor) -> object:
    """Return the visible state of a monitor; nan as text, so that it equals itself."""
    if isinstance(monitor, rtamt.dense.Monitor):
        return monitor.settled, monitor.finished, str(monitor.values)
    said = repr((monitor.robustness, *monitor.bounds(), monitor.decided_at))
    return monitor.settled, monitor.finished, said


# Generated formulas, signals and chunks. ---------------------------------------------------------


def check(
    formula: Formula | str,
    whole: Signals,
    shares: list[list[float]],
    kind: Kind = rtamt.dense.Monitor,
) -> None:
    """Compare the machines in every call; the one in C++ is a new copy each time.

    A reset removes all earlier values.
    """
    native, python = both(formula, kind)
    parts = [of(native, chunk) for chunk in chunked(whole, shares)]
    for part in parts:
        before = native._machine.state()
        given_now = outcome(lambda m=native, p=part: m.update(p))  # type: ignore[misc]
        assert given_now == outcome(lambda m=python, p=part: m.update(p))  # type: ignore[misc]
        assert state(native) == state(python)
        if isinstance(given_now, tuple):
            assert native._machine.state() == before
            return
        twin = kind(formula, backend="native")
        twin._machine.restore(native._machine.state())
        assert twin._machine.state() == native._machine.state()
        native = twin
    assert outcome(native.finish) == outcome(python.finish)
    assert state(native) == state(python)
    native.reset()
    python.reset()
    for part in parts:
        assert outcome(lambda p=part: native.update(p)) == outcome(  # type: ignore[misc]
            lambda p=part: python.update(p)  # type: ignore[misc]
        )
        assert state(native) == state(python)


bounded = formulas(dense=True).filter(lambda f: f.variables)


@given(formula=bounded, whole=signals() | signals(INTEGERS), shares=chunks(), scale=scales)
def test_every_call_gives_what_the_definition_gives(
    formula: Formula, whole: Signals, shares: list[list[float]], scale: float
) -> None:
    check(formula, scaled(whole, scale), shares)


@given(
    formula=formulas(endless=True, total=True, dense=True).filter(lambda f: f.variables),
    whole=signals() | signals(INTEGERS) | signals(st.sampled_from(INFINITIES)),
    shares=chunks(),
    scale=scales,
)
def test_every_call_of_an_episode_gives_what_the_definition_gives(
    formula: Formula, whole: Signals, shares: list[list[float]], scale: float
) -> None:
    check(formula, scaled(whole, scale), shares, rtamt.dense.EpisodeMonitor)


DECLARED = st.sampled_from(
    (
        "input float64 a = 0.5\ninput float64 b\nb > 0 implies once[0:1](a > b)",
        "input float64 a = 0.5\ninput float64 b = -1\na > 0 and eventually[0:2](b > a)",
        "input float64 a = 1\ninput float64 b\ninput float64 c\n(a > b) until[0:2] (c > 0)",
    )
)


@pytest.mark.parametrize("kind", [rtamt.dense.Monitor, rtamt.dense.EpisodeMonitor])
@settings(max_examples=examples(40))
@given(text=DECLARED, whole=signals(), shares=chunks(), silent=st.sets(st.sampled_from("abc")))
def test_so_it_does_with_declared_values(
    kind: Kind, text: str, whole: Signals, shares: list[list[float]], silent: set[str]
) -> None:
    heard = {name: [] if name in silent else events for name, events in whole.items()}
    check(text, heard, shares, kind)


@pytest.mark.parametrize("name", DENSE)
@settings(max_examples=examples(20))
@given(data=st.data(), whole=signals(), shares=chunks(), scale=scales)
def test_so_does_every_operator(
    name: str, data: st.DataObject, whole: Signals, shares: list[list[float]], scale: float
) -> None:
    formula = data.draw(rooted(name, depth=1, dense=True).filter(lambda f: f.variables))
    check(formula, scaled(whole, scale), shares)


@given(
    formula=formulas(total=True, dense=True).filter(lambda f: f.variables),
    whole=signals(st.sampled_from(INFINITIES)),
    shares=chunks(),
)
def test_so_it_does_where_terms_have_no_value(
    formula: Formula, whole: Signals, shares: list[list[float]]
) -> None:
    check(formula, whole, shares)


@given(
    formula=formulas(endless=True, dense=True).filter(lambda f: f.variables),
    whole=signals(),
    scale=scales,
)
def test_whole_signals_give_what_the_definition_gives(
    formula: Formula, whole: Signals, scale: float
) -> None:
    moved = scaled(whole, scale)
    native, python = (
        list(rtamt.dense.evaluate(formula, moved, backend=b)) for b in ("native", "python")
    )
    assert bitwise(native) == bitwise(python)


# Many events: blocks inside of the machine. ------------------------------------------------------

PROGRAMS = (
    "always[0:1](a + b > -2)",
    "historically((a > 1) implies eventually[0:0.7](b > 0))",
    "(a > -1) until[0.3:1.1] (b > 1)",
    "historically[0.2:0.9](a > b) or (a > -1) since[0:3] (b > 1)",
    "once[5:9] eventually[0:2] (a > 2) and b < 9",
    "low = a > 1; high = eventually[0:4](b > 1); not (low implies high)",
    "a > 1.5 and abs(b) < 2",
)


def noise(n: int, *, pace: float = 1.0) -> Breakpoints:
    rng = np.random.default_rng(round(n * pace))
    times = pace * np.cumsum(rng.exponential(size=n)) / 100
    return list(zip(times.tolist(), rng.normal(size=n).tolist(), strict=True))


def parts(events: Breakpoints, rng: random.Random) -> list[Breakpoints]:
    sizes = (1, 2, 3, 60, 511, 512, 513, 1500)
    cuts = [0]
    while cuts[-1] < len(events):
        cuts.append(cuts[-1] + rng.choice(sizes))
    return [events[i:j] for i, j in itertools.pairwise(cuts)]


@pytest.mark.parametrize("spec", PROGRAMS)
@pytest.mark.parametrize("pace", [1.0, 7.0])
def test_chunks_of_any_length_give_what_a_whole_trace_gives(spec: str, pace: float) -> None:
    whole = {"a": noise(3000), "b": noise(round(3000 / pace), pace=pace)}
    expected = list(rtamt.dense.evaluate(spec, whole, backend="native"))
    shown = {name: events[:400] for name, events in whole.items()}
    native, python = (
        list(rtamt.dense.evaluate(spec, shown, backend=b)) for b in ("native", "python")
    )
    assert native == python
    for seed in range(4):
        rng, monitor = random.Random(seed), rtamt.dense.Monitor(spec, backend="native")
        waiting = {name: parts(events, rng) for name, events in whole.items()}
        seen: Breakpoints = []
        while any(waiting.values()):
            names = [name for name in waiting if waiting[name] and rng.random() < 0.7]
            seen += monitor.update({name: waiting[name].pop(0) for name in names})
        assert seen + monitor.finish() == expected


@pytest.mark.parametrize("n", [3, 700, 5000])
def test_a_term_without_a_value_at_the_end_of_a_chunk_leaves_the_monitor_as_it_was(n: int) -> None:
    monitor = rtamt.dense.Monitor("always[0:1](sqrt(a) > b)", backend="native")
    start = {"a": [(0.0, 1.0)], "b": [(0.5, 0.0)]}
    good = [(i + 1.0, float(i)) for i in range(n)]
    for warm in (False, True):
        if warm:
            monitor.update(start)
        before = monitor._machine.state()
        chunk = {} if warm else start
        a = [*([] if warm else start["a"]), *good[:-1], (good[-1][0], -2.0)]
        with pytest.raises(ValueError, match=rf"^'sqrt\(a\)' is not a number at time {n}\.0, "):
            monitor.update({**chunk, "a": a, "b": [*chunk.get("b", []), (n + 5.0, 1.0)]})
        assert monitor._machine.state() == before
    given_now = monitor.update({"a": good, "b": [(n + 5.0, 1.0)]})
    assert given_now == [(0.5, 0.0), *((t, math.sqrt(v)) for t, v in good[1:-2])]


# Forms of arguments. -----------------------------------------------------------------------------


class Half(float):
    """A float whose value is half of its own."""

    def __float__(self) -> float:
        return float.__float__(self) / 2


def reader_only(*values: float) -> np.ndarray[Any, Any]:
    array = np.array(values).reshape(-1, 2)
    array.flags.writeable = False
    return array


Pair = collections.namedtuple("Pair", "time value")  # noqa: PYI024 - as callers have them
A = [(0.0, 1.0), (1.0, 3.0)]
FORMS: Mapping[str, Callable[[], object]] = {
    "tuples": lambda: {"a": A},
    "lists": lambda: {"a": [[0.0, 1.0], [1.0, 3.0]]},
    "a tuple of both": lambda: {"a": ((0.0, 1.0), [1.0, 3.0])},
    "ints": lambda: {"a": [(0, 1), (1, 3)]},
    "a great int": lambda: {"a": [(0, 10**300)]},
    "an int that no double holds": lambda: {"a": [(0, 10**400)]},
    "bools": lambda: {"a": [(False, True)]},
    "numpy scalars": lambda: {"a": [(np.float64(0.5), np.float32(2.1)), (np.int8(1), 2)]},
    "fractions": lambda: {"a": [(0.0, fractions.Fraction(1, 3))]},
    "named tuples": lambda: {"a": [Pair(0.0, 1.0), Pair(1.0, 3.0)]},
    "a subclass of float": lambda: {"a": [(0.0, Half(3.0))]},
    "an array": lambda: {"a": np.array(A)},
    "an array with steps": lambda: {"a": np.array([A[0], (0.5, 9.0), A[1]])[::2]},
    "columns in Fortran's order": lambda: {"a": np.asfortranarray(A)},
    "an array of float32": lambda: {"a": np.array(A, np.float32)},
    "an array of ints": lambda: {"a": np.array(A, np.int64)},
    "an array in another byte order": lambda: {"a": np.array(A, ">f8")},
    "a read-only array": lambda: {"a": reader_only(0.0, 1.0, 1.0, 3.0)},
    "an array of pairs of one": lambda: {"a": np.zeros((1, 2))},
    "an array of rows of three": lambda: {"a": np.zeros((2, 3))},
    "a 1-D array": lambda: {"a": np.zeros(2)},
    "a 0-D array": lambda: {"a": np.array(1.0)},
    "an empty array": lambda: {"a": np.empty((0, 2))},
    "an empty 1-D array": lambda: {"a": np.empty(0)},
    "an empty list": lambda: {"a": []},
    "events": lambda: {"a": rtamt.dense.Events([0, 1], [1, 3])},
    "events with steps": lambda: {"a": rtamt.dense.Events([0, 0.5, 1], [1, 9, 3])[::2]},
    "no events": lambda: {"a": rtamt.dense.Events([], [])},
    "a generator": lambda: {"a": (pair for pair in A)},
    "a set": lambda: {"a": {(0.0, 1.0)}},
    "both variables": lambda: {"b": [(0.5, 0.0), (4.0, 1.0)], "a": [*A, (2.0, 0.0), (9.0, 0.0)]},
    "an empty dict": dict,
    "an ordered dict": lambda: collections.OrderedDict(a=A),
    "a read-only mapping": lambda: types.MappingProxyType({"a": A}),
    "another text": lambda: {b"a".decode(): A},
    "an unknown name": lambda: {"a": A, "c": A},
    "a name of another type": lambda: {"a": A, 3: A},
    "a number": lambda: {"a": 1.0},
    "text": lambda: {"a": "text"},
    "a pair alone": lambda: {"a": (0.0, 1.0)},
    "None": lambda: {"a": None},
    "pairs of text": lambda: {"a": [("0", "1")]},
    "complex values": lambda: {"a": [(0.0, 1j)]},
    "a pair of three": lambda: {"a": [(0.0, 1.0, 2.0)]},
    "a pair of one": lambda: {"a": [(0.0,)]},
    "times that stand still": lambda: {"a": [(0.0, 1.0), (0.0, 2.0)]},
    "times that go back": lambda: {"a": [(1.0, 1.0), (0.0, 2.0)]},
    "times that go back in an array": lambda: {"a": np.array([(1.0, 1.0), (0.0, 2.0)])},
    "a time of inf": lambda: {"a": [(0.0, 1.0), (math.inf, 2.0)]},
    "a time of -inf": lambda: {"a": [(-math.inf, 2.0)]},
    "a time of nan": lambda: {"a": [(math.nan, 2.0)]},
    "a value of nan": lambda: {"a": [(0.0, 1.0), (1.0, math.nan)]},
    "a value of nan behind good events": lambda: {"a": A, "b": [(0.0, math.nan)]},
    "infinite values": lambda: {"a": [(0.0, math.inf), (1.0, -math.inf)]},
    "no mapping": lambda: A,
    "nothing": lambda: None,
}


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("begun", [False, True])
@pytest.mark.parametrize("kind", [rtamt.dense.Monitor, rtamt.dense.EpisodeMonitor])
def test_every_form_means_what_it_means_in_python(
    name: str,
    begun: bool,  # noqa: FBT001 - a parameter
    kind: Kind,
) -> None:
    native, python = both("always[0:0.5](a + b > 1)", kind)
    for monitor in (native, python):
        if begun:
            monitor.update({"a": [(-2.0, 1.0)], "b": [(-2.0, 1.0), (-1.0, 3.0)]})
    before = native._machine.state()
    got, expected = (
        outcome(lambda m=m: m.update(cast("Any", FORMS[name]())))  # type: ignore[misc]
        for m in (native, python)
    )
    assert got == expected
    assert state(native) == state(python)
    if isinstance(got, tuple):
        assert native._machine.state() == before
    after = {"a": [(20.0, 0.0)], "b": [(20.0, 0.0)]}
    assert native.update(after) == python.update(after)
    assert native.finish() == python.finish()


@given(
    times=st.lists(
        st.one_of(
            st.floats(allow_nan=False, allow_infinity=False),
            st.floats(-5e9, 5e9),
            st.integers(-(10**12), 10**12).map(lambda n: n / 2000),
        ),
        min_size=1,
    ),
    resolution=st.sampled_from(("1ns", "1ms", "3ns", "1s")),
)
def test_the_events_of_an_episode_are_counted_alike(times: list[float], resolution: str) -> None:
    ordered = np.unique(times)

    def counted(backend: Backend) -> object:
        monitor = rtamt.dense.EpisodeMonitor("x > 0", resolution=resolution, backend=backend)
        found = []
        for time in ordered.tolist():
            monitor.update(x=[(time, 1)])
            found.append(monitor.settled)
        return found

    assert outcome(lambda: counted("native")) == outcome(lambda: counted("python"))


@given(
    x=st.lists(st.one_of(st.sampled_from(INFINITIES), st.floats(-2, 2)), min_size=1),
    calm=st.sampled_from((0, 511, 700)),
    text=st.sampled_from(("sqrt(x)", "1 / x", "x - x", "min(ln(x), 2) + x ** 2", "abs(x) * 3")),
)
def test_terms_of_an_episode_are_alike(x: list[float], calm: int, text: str) -> None:
    values = np.append(np.full(calm, 2.0), x)

    def judged(backend: Backend) -> object:
        events = {"x": rtamt.dense.Events(np.arange(float(len(values))), values)}
        found = rtamt.dense.judge(
            f"always({text} > 1) or once({text} == 2)", events, backend=backend
        )
        return found.robustness, found.lower, found.upper, found.decided_at

    assert outcome(lambda: judged("native")) == outcome(lambda: judged("python"))
