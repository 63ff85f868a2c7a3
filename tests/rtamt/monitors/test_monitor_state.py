"""The state of monitors: copies, pickles, errors and calls inside calls."""

import copy
import math
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from choices import Backend
from episode_monitors import feed, offered, verdict
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import episode
from profiles import examples
from strategies import Trace, formulas, length, sample, traces

import rtamt
from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    Monitor,
    SpecificationError,
    StateError,
    UncertainValue,
    Verdict,
    parse,
)
from rtamt.machines.backend import BackendName

INF = math.inf


V, U, S = Verdict.VIOLATED, Verdict.UNDECIDED, Verdict.SATISFIED


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
def test_finish_closes_the_episode_once_and_keeps_a_verdict(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    monitor = EpisodeMonitor(formula, backend=backend)
    for i in range(length(trace)):
        feed(monitor, trace, i)
    robustness, *_ = offered(monitor)
    decided = monitor.verdict
    for _ in range(2):
        assert monitor.finish() == monitor.robustness == robustness
        assert monitor.finished
        assert monitor.lower == monitor.upper == robustness
        assert monitor.verdict is verdict(robustness, robustness)
        assert decided in {U, monitor.verdict}
    with pytest.raises(StateError):
        feed(monitor, trace, 0)
    assert monitor.samples == length(trace)
    assert monitor.robustness == robustness


@pytest.mark.parametrize(
    ("text", "x", "robustness", "closed"),
    [
        ("always(x > 0)", 2.0, 2.0, S),
        ("eventually(x > 0)", -2.0, -2.0, V),
        ("always(x > 0)", 0.0, 0.0, V),
        ("always(x >= 0)", 0.0, 0.0, S),
        ("eventually[0:2](x == 0)", 0.0, 0.0, S),
        ("eventually(x != 0)", 0.0, 0.0, V),
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
    text = "always(" + " and ".join(f"eventually(x > {i})" for i in range(9)) + ")"
    with pytest.raises(SpecificationError) as caught:
        EpisodeMonitor(text, backend=backend)
    assert str(caught.value) == (
        "the formula has 9 operators without an end inside others; the limit is 8; "
        "write an end, as in eventually[0:100], or judge recorded traces with judge()"
    )
    twice = "always(" + " iff ".join(f"eventually(x > {i})" for i in range(5)) + ")"
    with pytest.raises(
        SpecificationError, match=r"has 5 operators .*, which count as 10: one that"
    ):
        EpisodeMonitor(twice, backend=backend)


@pytest.mark.parametrize(
    "text",
    [
        "always(" + " iff ".join(f"eventually(a > {i})" for i in range(-1, 3)) + ")",
        "always(" + " and ".join(f"(a < {i} unless a > {i})" for i in range(4)) + ")",
    ],
)
def test_eight_endless_operators_inside_others_are_judged(text: str, backend: Backend) -> None:
    trace = {"a": [1.5, -2.0, 0.5, 3.5, -0.5, 2.5, 0.0]}
    formula, monitor = parse(text).formula, EpisodeMonitor(text, backend=backend)
    for i in range(length(trace)):
        feed(monitor, trace, i)
        assert (monitor.robustness, *monitor.bounds()) == episode(formula, trace, i + 1)


# State. ------------------------------------------------------------------------------------------
DUPLICATES: dict[str, Callable[[EpisodeMonitor], EpisodeMonitor]] = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda monitor: pickle.loads(pickle.dumps(monitor)),
}


@pytest.mark.parametrize("duplicate", DUPLICATES)
@settings(max_examples=examples(40))
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
    assert np.array_equal(offered(twin), offered(original), equal_nan=True)
    assert twin.verdict is original.verdict
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


def test_bounds_are_lower_and_upper_wherever_an_episode_is_taken(backend: Backend) -> None:
    monitor = EpisodeMonitor("always[0:5](a > 0)", backend=backend, history=True)
    monitor.update(2.0)
    for twin in (monitor, copy.copy(monitor), pickle.loads(pickle.dumps(monitor))):
        assert twin.bounds() == (twin.lower, twin.upper) == (-math.inf, 2.0)
        twin.finish()
        assert twin.bounds() == (2.0, 2.0)
        twin.reset()
        assert twin.bounds() == (-math.inf, math.inf)


BACKENDS: tuple[BackendName, ...] = ("native", "python")


Kind = Callable[..., Any]


Options = dict[str, Any]


NEUTRAL: Options = {"semantics": "output-robustness", "inputs": ["x"], "outputs": ["y"]}


class Running:
    """A number that runs a function when it is read."""

    def __init__(self, run: Callable[[], object], value: float = 1.0) -> None:
        self.run, self.value = run, value

    def __float__(self) -> float:
        self.run()
        return self.value


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "options", [{}, {"history": True}, {"nan": "unknown"}, NEUTRAL], ids=["", "h", "u", "n"]
)
@pytest.mark.parametrize("form", ["position", "name", "mapping"])
def test_an_update_whose_value_ends_the_episode_is_refused(
    backend: BackendName, options: Options, form: str
) -> None:
    monitor = EpisodeMonitor("always(x > 0 or y > 3)", backend=backend, **options)
    monitor.update(1.0, 2.0)
    value: Any = Running(monitor.finish)
    positional, named = {
        "position": ((value, 2.0), {}),
        "name": ((), {"x": value, "y": 2.0}),
        "mapping": (({"x": value, "y": 2.0},), {}),
    }[form]
    with pytest.raises(StateError, match="the episode is finished"):
        monitor.update(*positional, **named)
    assert monitor.finished
    assert monitor.samples == 1
    assert monitor.lower == monitor.upper == monitor.robustness or options is NEUTRAL


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", [rtamt.dense.Monitor, rtamt.dense.EpisodeMonitor])
def test_an_update_whose_event_ends_the_trace_is_refused(backend: BackendName, kind: Kind) -> None:
    monitor = kind("always(x > 0)", backend=backend)
    monitor.update({"x": [(0.0, 1.0)]})
    with pytest.raises(StateError):
        monitor.update({"x": [(1.0, Running(monitor.finish))]})
    with pytest.raises(StateError):
        monitor.update({"x": [(2.0, 1.0)]})


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("kind", [Monitor, EpisodeMonitor])
def test_an_update_inside_an_update_takes_its_turn_first(backend: BackendName, kind: Kind) -> None:
    monitor = kind("always(x > 0 and y > 3)", backend=backend)
    value: Any = Running(lambda: monitor.update(5.0, 9.0), 6.0)
    monitor.update(7.0, value)
    alone = kind("always(x > 0 and y > 3)", backend=backend)
    alone.update(5.0, 9.0)
    alone.update(7.0, 6.0)
    assert monitor.samples == 2
    assert repr(monitor.__reduce__()[2]) == repr(alone.__reduce__()[2])


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    "options", [{}, {"history": True}, {"nan": "unknown"}, NEUTRAL], ids=["", "h", "u", "n"]
)
def test_an_update_of_before_an_init_is_stale(backend: BackendName, options: Options) -> None:
    monitor = EpisodeMonitor("always(x > 0 or y > 3)", backend=backend, **options)
    update = monitor.update
    update(1.0, 2.0)
    monitor.__init__("always(x < 0 or y > 3)", backend=backend, **options)  # type: ignore[misc]
    shown = (monitor.robustness, monitor.lower, monitor.upper, monitor.verdict)
    for values in ((1.0, 2.0), (Running(lambda: None), 2.0), (math.nan, 2.0)):
        with pytest.raises(StateError, match="__init__ has run again since"):
            update(*values)
    assert repr((monitor.robustness, monitor.lower, monitor.upper, monitor.verdict)) == repr(shown)
    monitor.update(-1.0, 2.0)
    assert monitor.samples == 1
    again = monitor.update
    again(-1.0, 2.0)
    assert monitor.samples == 2


@pytest.mark.parametrize("backend", BACKENDS)
def test_updates_of_the_other_monitors_are_stale_too(backend: BackendName) -> None:
    one = Monitor("always[0:1](x > 0)", backend=backend)
    dense = rtamt.dense.Monitor("always(x > 0)", backend=backend)
    whole = rtamt.dense.EpisodeMonitor("always(x > 0)", backend=backend)
    unknown = rtamt.dense.EpisodeMonitor("always(x > 0)", backend=backend, nan="unknown")
    for monitor, value in (
        (one, 1.0),
        (dense, {"x": [(0.0, 1.0)]}),
        (whole, {"x": [(0.0, 1.0)]}),
        (unknown, {"x": [(0.0, UncertainValue(0.0, 1.0))]}),
    ):
        made: Any = monitor
        update = made.update
        update(value)
        made.__init__("always(x > 0)", backend=backend)
        with pytest.raises(StateError, match="__init__ has run again since"):
            update(value)


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_init_that_is_refused_leaves_the_update_as_it_was(backend: BackendName) -> None:
    monitor: Any = EpisodeMonitor("always(x > 0)", backend=backend)
    update = monitor.update
    with pytest.raises(ValueError, match="STL:1"):
        monitor.__init__("always(x >", backend=backend)
    assert update(2.0) == 2.0 == monitor.robustness


@pytest.mark.parametrize("backend", BACKENDS)
def test_an_init_inside_an_update_makes_that_update_stale(backend: BackendName) -> None:
    monitor: Any = EpisodeMonitor("always(x > 0)", backend=backend)
    value = Running(lambda: monitor.__init__("always(x < 0)", backend=backend))
    with pytest.raises(StateError, match="__init__ has run again since"):
        monitor.update(value)
    assert monitor.samples == 0
