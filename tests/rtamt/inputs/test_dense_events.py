"""`rtamt.dense.Events`: a signal as two arrays and as a sequence of pairs."""

import copy
import math
import pickle
import re

import numpy as np
import pytest
from numpy.typing import ArrayLike

import rtamt
from rtamt import InputError, InputTypeError, RtamtError

PAIRS = [(0.0, 3.0), (1.5, math.inf), (4.0, 2.0)]


@pytest.fixture
def events() -> rtamt.dense.Events:
    """Return three events."""
    return rtamt.dense.Events([0, 1.5, 4], [3, math.inf, 2])


def test_events_are_the_sequence_of_their_pairs(events: rtamt.dense.Events) -> None:
    assert list(events) == [events[0], events[1], events[2]] == PAIRS
    assert (len(events), events[-1]) == (3, (4.0, 2.0))
    assert events[1:] == PAIRS[1:]
    assert isinstance(events[1:], rtamt.dense.Events)
    assert (4.0, 2.0) in events
    assert events.index((1.5, math.inf)) == 1
    assert [*reversed(events)] == PAIRS[::-1]
    assert all(type(number) is float for pair in events for number in pair)
    with pytest.raises(IndexError):
        events[3]


def test_events_equal_any_sequence_of_the_same_pairs(events: rtamt.dense.Events) -> None:
    assert events == PAIRS == events
    assert events == tuple(map(list, PAIRS))
    assert events == np.array(PAIRS)
    assert events == rtamt.dense.Events(*np.array(PAIRS).T)
    assert events != PAIRS[:2]
    assert events != [*PAIRS[:2], (4.0, 2.5)]
    assert events != [1, 2, 3]
    assert events != rtamt.dense.Events([0, 1.5, 5], [3, math.inf, 2])
    assert events != "abc"
    assert rtamt.dense.Events([], []) == []


def test_events_never_change(events: rtamt.dense.Events) -> None:
    times = np.array([0.0, 1.0])
    made = rtamt.dense.Events(times, times)
    times[1] = 9
    assert made == [(0, 0), (1, 1)]
    for array in (events.times, events.values, pickle.loads(pickle.dumps(events)).values):
        assert array.dtype == np.float64
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError):
        events.times = times  # type: ignore[misc]
    with pytest.raises(TypeError, match="unhashable"):
        hash(events)


def test_events_are_copied_and_pickled(events: rtamt.dense.Events) -> None:
    for twin in (copy.copy(events), copy.deepcopy(events), pickle.loads(pickle.dumps(events))):
        assert twin == events
        assert isinstance(twin, rtamt.dense.Events)


def test_events_show_their_beginning(events: rtamt.dense.Events) -> None:
    assert repr(events) == "Events([0.0, 1.5, 4.0], [3.0, inf, 2.0])"
    assert len(repr(rtamt.dense.Events(range(1000), range(1000)))) <= 80
    day = np.array(["2026-01-01"], "datetime64[ns]")
    assert repr(rtamt.dense.Events(day, [1])) == "Events(['2026-01-01T00:00:00.000000000'], [1.0])"


def test_robustness_is_events_for_another_formula() -> None:
    close = rtamt.dense.evaluate("once[0:1](x > 2)", {"x": PAIRS})
    assert rtamt.dense.evaluate("p > 0", {"p": close}) == close


@pytest.mark.parametrize(
    ("times", "values", "error", "text"),
    [
        ([0, 1], [1], InputError, "expected as many values as times, got 1 and 2"),
        ([0, 0], [1, 2], InputError, "expected a time after 0.0 at event 1, got 0.0"),
        ([0, math.inf], [1, 2], InputError, "expected a finite time at event 1, got inf"),
        (
            [[0, 1]],
            [1, 2],
            InputError,
            "expected a 1-D array for the times of events, got shape (1, 2)",
        ),
        (
            [0, 1],
            ["a", "b"],
            InputTypeError,
            "expected an array of numbers for the values of events, got <U1",
        ),
    ],
)
def test_what_is_no_signal_is_refused(
    times: ArrayLike, values: ArrayLike, error: type[RtamtError], text: str
) -> None:
    with pytest.raises(error, match=f"^{re.escape(text)}$"):
        rtamt.dense.Events(times, values)
