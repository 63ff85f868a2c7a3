"""Variables with a declared default, without values from the caller."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt.machines.backend import BackendName

TEXT = "input float64 x; input float64 limit = 0.5; once[0:2](x < limit)"
backends = pytest.mark.parametrize("backend", ["native", "python"])

rows = st.lists(st.tuples(st.floats(-2, 2), st.none() | st.floats(-2, 2)), min_size=1, max_size=12)
"""Values of ``x``, and values of ``limit`` if it is passed."""


def held(samples: list[tuple[float, float | None]]) -> list[float]:
    """Return the limit of every sample: the last passed value, at first 0.5."""
    limits, last = [], 0.5
    for _, limit in samples:
        last = last if limit is None else limit
        limits.append(last)
    return limits


@backends
@given(samples=rows)
def test_a_variable_that_is_not_said_is_as_before_and_at_first_its_default(
    backend: BackendName, samples: list[tuple[float, float | None]]
) -> None:
    monitor = rtamt.Monitor(TEXT, backend=backend)
    whole = rtamt.Monitor(TEXT, backend=backend)
    for (x, limit), known in zip(samples, held(samples), strict=True):
        said = {"x": x} if limit is None else {"x": x, "limit": limit}
        assert repr(monitor.update(said)) == repr(whole.update(x, known))
    episode = rtamt.EpisodeMonitor("always(x < limit)", backend=backend)
    short = rtamt.EpisodeMonitor(TEXT.replace("once[0:2]", "always"), backend=backend)
    for (x, limit), known in zip(samples, held(samples), strict=True):
        named = {} if limit is None else {"limit": limit}
        assert repr(short.update(x=x, **named)) == repr(episode.update(x=x, limit=known))


@backends
@given(samples=rows, cut=st.integers(0, 12))
def test_a_column_that_is_not_there_is_one_of_the_default(
    backend: BackendName, samples: list[tuple[float, float | None]], cut: int
) -> None:
    xs = [x for x, _ in samples]
    whole = {"x": xs, "limit": [0.5] * len(xs)}
    expected = rtamt.evaluate(TEXT, whole, backend=backend)
    assert rtamt.evaluate(TEXT, {"x": xs}, backend=backend).tobytes() == expected.tobytes()
    monitor = rtamt.Monitor(TEXT, backend=backend)
    parts = [monitor.update_many({"x": xs[:cut]}), monitor.update_many({"x": xs[cut:]})]
    assert np.concatenate(parts).tobytes() == expected.tobytes()
    monitor.reset()
    monitor.update(x=0.0, limit=0.75)
    later = rtamt.evaluate(TEXT, {"x": [0.0, *xs], "limit": [0.75] * (len(xs) + 1)})[1:]
    assert monitor.update_many({"x": xs}).tobytes() == later.tobytes()
    always = TEXT.replace("once[0:2]", "always")
    found, known = rtamt.judge(always, {"x": xs}), rtamt.judge(always, whole)
    assert (found.verdict, found.robustness) == (known.verdict, known.robustness)


@backends
def test_a_default_lasts_to_the_first_event_in_dense_time(backend: BackendName) -> None:
    spec = "input float64 x; input float64 limit = 0.5; x < limit"
    xs = [(1, 0.25), (2, 0.125), (4, 0.0)]
    for limits, whole in (
        ([], [(1, 0.5), (4, 0.5)]),
        ([(3, 0.75), (4, 1.0)], [(1, 0.5), (3, 0.75), (4, 1.0)]),
        ([(0, 0.75), (4, 1.0)], [(0, 0.75), (4, 1.0)]),
    ):
        given = {"x": xs, "limit": limits} if limits else {"x": xs}
        found = rtamt.dense.evaluate(spec, given, backend=backend)
        known = rtamt.dense.evaluate(spec, {"x": xs, "limit": whole}, backend=backend)
        assert (found.times.tolist(), found.values.tolist()) == (
            known.times.tolist(),
            known.values.tolist(),
        )
    dates = [(np.datetime64("2024-01-01"), 0.25), (np.datetime64("2024-01-02"), 0.0)]
    found = rtamt.dense.evaluate(spec, {"x": dates}, backend=backend)
    assert (found.times.tolist(), found.values.tolist()) == (
        [1704067200 * 10**9, 1704153600 * 10**9],
        [0.25, 0.5],
    )
    one = rtamt.dense.evaluate(spec, {"x": [(1, 0.25)]}, backend=backend)
    assert (one.times.tolist(), one.values.tolist()) == ([1.0], [0.25])


def test_the_defaults_are_those_of_plain_variables_that_are_read() -> None:
    spec = rtamt.parse("""
        from std_msgs.msg import Float64
        from geometry_msgs.msg import Twist
        input Float64 gain = 0.5
        input Twist cmd = 3
        input int near = 2
        input int unread = 4
        input float64 other
        always(gain.data + near + cmd.linear.x > other)
    """)
    assert spec.defaults == {"gain.data": 0.5, "near": 2.0}


@backends
def test_variables_without_a_default_are_needed(backend: BackendName) -> None:
    monitor = rtamt.Monitor(TEXT, backend=backend)
    needed = "expected a value for every variable, got none for 'x'; the variables are x, limit"
    no_column = "No column 'x'. The columns are 'limit'."
    no_signal = "No signal 'x'. The signals are 'limit'."
    none_at_all = "expected events of every variable, got none of 'limit'; the variables are limit"
    no_count = (
        "every variable has its default, so that the number of samples is unknown; pass the values "
        "of a variable, or n= for a single trace"
    )
    alone = "input float64 limit = 0.5; limit > 0"
    for call, message in (
        (lambda: monitor.update(limit=1.0), needed),
        (lambda: monitor.update({}), needed),
        (lambda: monitor.update(x=1.0, y=2.0), "unknown variable 'y'; the variables are x, limit"),
        (lambda: rtamt.evaluate(TEXT, {"limit": [1]}, backend=backend), no_column),
        (lambda: rtamt.dense.evaluate(TEXT, {"limit": [(0, 1)]}, backend=backend), no_signal),
        (
            lambda: rtamt.dense.evaluate(alone, {}, backend=backend),
            none_at_all,
        ),
        (
            lambda: rtamt.evaluate(alone, {}, backend=backend),
            no_count,
        ),
    ):
        with pytest.raises(rtamt.InputError) as caught:
            call()
        assert str(caught.value) == message
    assert rtamt.evaluate(alone, {}, n=2, backend=backend).tolist() == [0.5, 0.5]
    assert monitor.update(x=0.25) == 0.25


NEAR = "input float64 x; input float64 limit = 20; always(x < limit)"
COLUMNS: dict[str, list[float]] = {"x": [12.0, 13.0], "Limit": [11.0, 11.0], "o": [1, 1]}
EVENTS = {"x": [(0, 12.0), (1, 13.0)], "Limit": [(0, 11.0), (1, 11.0)]}


@pytest.mark.parametrize(
    "call",
    [
        lambda spec: rtamt.evaluate(spec, COLUMNS),
        lambda spec: rtamt.judge(spec, COLUMNS),
        lambda spec: rtamt.judge(spec, pa.table(COLUMNS)),
        lambda spec: rtamt.explain(spec, COLUMNS),
        lambda spec: rtamt.occurrences(spec, COLUMNS),
        lambda spec: rtamt.judge_many(spec, COLUMNS, by="o"),
        lambda spec: rtamt.judge_many(spec, COLUMNS, lengths=[1, 1]),
        lambda spec: rtamt.judge_many(spec, [COLUMNS]),
        lambda spec: rtamt.dense.evaluate(spec, EVENTS),
        lambda spec: rtamt.dense.judge(spec, EVENTS),
        lambda spec: rtamt.dense.explain(spec, EVENTS),
    ],
)
def test_default_next_to_a_similar_name_is_an_error(call: Callable[[str], object]) -> None:
    expected = (
        r"No (column|signal) 'limit', which has the default 20, but 'Limit'\. Rename it to 'limit' "
        "to read it, or leave it out"
    )
    with pytest.raises(rtamt.InputError, match=expected):
        call(NEAR)
    call(NEAR.replace("limit", "bound"))  # uses the default
    call(f"input float64 Limit; {NEAR} and always(Limit > 0)")  # a separate variable


values = st.sampled_from((-1.0, -0.0, 0.0, 0.5, 2.0))
signal = st.lists(st.tuples(st.integers(1, 3), values), min_size=1, max_size=5)
"""The distances of events, in half seconds, and their values."""


def timed(steps: list[tuple[int, float]], begin: float) -> list[tuple[float, float]]:
    times = begin + np.cumsum([step for step, _ in steps]) / 2
    return list(zip(times.tolist(), [value for _, value in steps], strict=True))


@backends
@given(x=signal, limit=st.just([]) | signal, early=st.booleans())
def test_in_dense_time_a_default_lasts_until_the_first_event(
    backend: BackendName, x: list[tuple[int, float]], limit: list[tuple[int, float]], *, early: bool
) -> None:
    text = TEXT.replace("once[0:2](x < limit)", "once[0:2](x < limit) and eventually[0:1](x > 0)")
    whole = {"x": timed(x, 0.0), "limit": timed(limit, 0.25)}
    ends = [events[-1][0] for events in whole.values() if events]
    if min(ends) < whole["x"][0][0]:
        return
    if early:  # all events of one variable, then of the other
        chunks = [{"limit": whole["limit"]}, {"x": whole["x"]}]
    else:
        order = sorted((time, name, value) for name, its in whole.items() for time, value in its)
        chunks = [{name: [(time, value)]} for time, name, value in order]
    monitor = rtamt.dense.Monitor(text, backend=backend)
    episode = rtamt.dense.EpisodeMonitor(text, backend=backend)
    seen = []
    for chunk in chunks:
        seen += monitor.update(chunk)
        episode.update(chunk)
        assert early or monitor.settled >= episode.settled - monitor.horizon
    assert seen + monitor.finish() == list(rtamt.dense.evaluate(text, whole, backend=backend))
    judged = rtamt.dense.judge(text, whole, "open", backend=backend)
    assert episode.bounds() == (judged.lower, judged.upper)
    assert (episode.robustness, episode.decided_at) == (judged.robustness, judged.decided_at)


@backends
def test_in_dense_time_nothing_waits_for_a_default(backend: BackendName) -> None:
    monitor = rtamt.dense.Monitor("input float64 x; input float64 k = 2; x < k", backend=backend)
    assert monitor.update(x=[(0, 1), (3, 4), (5, 0)]) == [(0.0, 1.0), (3.0, -2.0)]
    with pytest.raises(rtamt.InputError, match=r"a time after 5\.0 at event 0 of 'k', got 4\.0"):
        monitor.update(k=[(4, 9)])
    assert monitor.update(k=[(6, 9)]) == []
    assert monitor.update(x=[(8, 9)]) == [(5.0, 2.0)]
    assert monitor.finish() == [(6.0, 9.0)]
    alone = rtamt.dense.Monitor("input float64 x = 1; input float64 k = 2; x < k", backend=backend)
    with pytest.raises(rtamt.StateError, match="needs an event of every variable"):
        alone.finish()
    assert alone.update(k=[(1, 3), (2, 0)]) == [(1.0, 2.0)]
