"""The inputs of dense time: every form of events and every type of number, unchanged by calls."""

from collections.abc import Callable
from fractions import Fraction
from typing import Any, Literal

import numpy as np
import pytest

import rtamt
from rtamt import InputError

Backend = Literal["native", "python"]

PAIRS = [(0.0, 3.0), (1.0, 1.0), (2.5, 2.0), (4.0, 2.0)]
TABLE = np.array(PAIRS)


def read_only(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    array = array.copy()
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    "form",
    [
        lambda: PAIRS,
        lambda: tuple(PAIRS),
        lambda: [list(pair) for pair in PAIRS],
        lambda: iter(PAIRS),
        lambda: (pair for pair in PAIRS),
        lambda: [(np.float32(t), Fraction(v)) for t, v in PAIRS],
        lambda: [np.array(pair) for pair in PAIRS],
        lambda: [(np.array(t), v) for t, v in PAIRS],
        lambda: TABLE,
        lambda: TABLE.astype(np.float32),
        lambda: TABLE.astype(">f8"),
        lambda: np.asfortranarray(TABLE),
        lambda: np.repeat(TABLE, 2, axis=0)[::2],
        lambda: np.hstack([TABLE, TABLE])[:, 2:],
        lambda: read_only(TABLE),
        lambda: rtamt.dense.Events(TABLE[:, 0], TABLE[:, 1]),
        lambda: zip(TABLE[:, 0], TABLE[:, 1], strict=True),
    ],
)
def test_every_form_of_events_means_the_same(form: Callable[[], Any], backend: Backend) -> None:
    expected = [(0, 2), (1, 0), (2.5, 1)]
    assert rtamt.dense.evaluate("x > 1", {"x": form()}, backend=backend) == expected
    monitor = rtamt.dense.Monitor("x > 1", backend=backend)
    assert monitor.update({"x": form()}) + monitor.finish() == expected


def test_integers_and_booleans_are_numbers(backend: Backend) -> None:
    expected = [(0, 0), (1, 1), (2, 0)]
    for events in (
        [(0, False), (1, True), (2, False)],
        np.array([[0, 0], [1, 1], [2, 0]], np.uint8),
        rtamt.dense.Events(range(3), [False, True, False]),
    ):
        assert rtamt.dense.evaluate("x > 0", {"x": events}, backend=backend) == expected


def test_what_the_caller_hands_over_is_not_changed(backend: Backend) -> None:
    pairs, table, events = list(PAIRS), TABLE.copy(), rtamt.dense.Events(*TABLE.T)
    given_away: dict[str, Any] = {"x": pairs, "y": table, "z": events}
    text = "always[0:1](x > 0) and once[0:1](y > 0) and z > 0"
    first = rtamt.dense.evaluate(text, given_away, backend=backend)
    monitor = rtamt.dense.Monitor(text, backend=backend)
    monitor.update(given_away)
    assert list(given_away) == ["x", "y", "z"]
    assert pairs == PAIRS
    assert (table == TABLE).all()
    assert events == PAIRS
    table += 1  # the monitor does not store it
    assert monitor.update({}) == []
    assert rtamt.dense.evaluate(text, given_away | {"y": PAIRS}, backend=backend) == first


def test_integers_of_numpy_are_exact_times(backend: Backend) -> None:
    first = 2**60 + 1  # not a double
    found = rtamt.dense.evaluate(
        "x > 0",
        {"x": [(np.int64(first), 1), (np.int64(first + 2), 2)]},
        resolution="1s",
        backend=backend,
    )
    assert found.values.tolist() == [1.0, 2.0]


def test_events_from_last_to_first_are_refused() -> None:
    events = rtamt.dense.Events([0.0, 1.0], [1, 2])
    assert events[:1:-1] == rtamt.dense.Events([], [])
    assert events[:0:-1] == events[1:]
    with pytest.raises(InputError, match=r"^expected a time after 1.0 at event 1, got 0.0$"):
        events[::-1]
