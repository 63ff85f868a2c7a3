"""The exact errors in dense time; a call with an error leaves no trace."""

import functools
import math
import re
import warnings
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from catalogue import check, entries
from choices import Backend
from dense_signals import Signals, chunked, chunks, of, signals
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import formulas

import rtamt
from rtamt import (
    Formula,
    InputError,
    InputTypeError,
    RtamtError,
    SpecificationError,
    StateError,
    StlDenseTimeSpecification,
)
from rtamt.inputs.events import EventsLike

Error = type[RtamtError]


def refused(error: Error, text: str, call: Callable[[], object]) -> None:
    """Check the exact error of a call."""
    with pytest.raises(error, match=f"^{re.escape(text)}$") as raised:
        call()
    assert type(raised.value) is error


@pytest.fixture
def monitor(backend: Backend) -> rtamt.dense.Monitor:
    """Return a monitor of two variables with an event each."""
    made = rtamt.dense.Monitor("once[0:2](req - gnt > 1)", backend=backend)
    made.update({"req": [(1, 4)], "gnt": [(2, 1)]})
    return made


class Column:
    """Values with an index, as in data frames: has keys, and iterates over values."""

    def __init__(self, values: dict[float, float]) -> None:
        self.values = values
        self.keys = values.keys

    def __iter__(self) -> Iterator[float]:
        return iter(self.values.values())

    def __repr__(self) -> str:
        return "\n".join(f"{key}    {value}" for key, value in self.values.items())


ERRORS = entries(Path(__file__).with_name("dense_errors.txt"))


@pytest.mark.parametrize(("call", "said"), [e for e in ERRORS if e[0].startswith("monitor")])
def test_what_an_update_refuses(call: str, said: str, monitor: rtamt.dense.Monitor) -> None:
    check(call, said, monitor=monitor, Column=Column, math=math)
    assert monitor.settled == 1
    assert monitor.update({"req": [(4, 0)], "gnt": [(4, 0)]}) == [(2, 2)]
    assert monitor.finish() == []


NOT_NUMBERS = [
    (
        "sqrt(x) > 1",
        {"x": [(0, 4), (1, -1)]},
        "'sqrt(x)' is not a number at time 1.0, where x = -1.0",
    ),
    (
        "x > y",
        {"x": [(0, 1), (2, math.inf)], "y": [(0, 1), (1, math.inf), (3, 0)]},
        "'x > y' is not a number at time 2.0, where x = inf, y = inf",
    ),
    (
        "x / y > 1",
        {"x": [(0, 0), (3, 4)], "y": [(1, 0), (3, 4)]},
        "'x / y' is not a number at time 1.0, where x = 0.0, y = 0.0",
    ),
    (
        "y > 0 and x * 0 > 1",
        {"y": [(0, 2), (4, 1)], "x": [(1, 1), (2, -math.inf), (3, math.inf), (5, 0)]},
        "'x * 0' is not a number at time 2.0, where x = -inf",
    ),
]


@pytest.mark.parametrize(("text", "wrong", "message"), NOT_NUMBERS)
def test_a_term_that_is_no_number_is_told_with_its_time(
    text: str, wrong: Signals, message: str, backend: Backend
) -> None:
    refused(InputError, message, lambda: rtamt.dense.evaluate(text, wrong, backend=backend))
    monitor = rtamt.dense.Monitor(text, backend=backend)
    refused(InputError, message, lambda: monitor.update(wrong))
    right = {name: [(0, 4), (9, 4)] for name in wrong}
    expected = list(rtamt.dense.evaluate(text, right, backend=backend))
    assert monitor.update(right) + monitor.finish() == expected


def test_a_term_is_no_number_only_within_the_trace(backend: Backend) -> None:
    text = "sqrt(x) > y"
    whole = {"x": [(0, -4), (1, 9), (5, -4)], "y": [(2, 1), (4, 2)]}
    assert rtamt.dense.evaluate(text, whole, backend=backend) == [(2, 2), (4, 1)]
    monitor = rtamt.dense.Monitor(text, backend=backend)
    assert monitor.update({"x": whole["x"]}) == []
    assert monitor.update({"y": whole["y"]}) == [(2, 2)]
    later = "'sqrt(x)' is not a number at time 5.0, where x = -4.0"
    refused(InputError, later, lambda: monitor.update({"y": [(6, 1)]}))
    assert monitor.finish() == [(4, 1)]


@given(
    formula=formulas(dense=True).filter(lambda f: f.variables),
    whole=signals(),
    shares=chunks(),
    data=st.data(),
)
@settings(max_examples=examples(30))
def test_a_refused_update_leaves_no_trace(
    formula: Formula,
    whole: Signals,
    shares: list[list[float]],
    data: st.DataObject,
    backend: Backend,
) -> None:
    monitor = rtamt.dense.Monitor(formula, backend=backend)
    untouched = rtamt.dense.Monitor(formula, backend=backend)
    name = data.draw(st.sampled_from(formula.variables))
    for chunk in chunked(whole, shares):
        wrong = {v: [(90.0, 1.0), (91.0, 1.0)] for v in formula.variables}
        wrong[name] = [(90.0, 2.0), (91.0, math.nan)]
        with pytest.raises(InputError):
            monitor.update(wrong)
        assert monitor.update(of(monitor, chunk)) == untouched.update(of(monitor, chunk))
    assert monitor.finish() == untouched.finish()


# The end. ----------------------------------------------------------------------------------------
def test_finish_needs_events_of_every_variable(backend: Backend) -> None:
    monitor = rtamt.dense.Monitor("a > b", backend=backend)
    nothing = "finish() needs an event of every variable, got none of '{}' since reset"
    refused(StateError, nothing.format("a"), monitor.finish)
    monitor.update({"a": [(0, 1)]})
    refused(StateError, nothing.format("b"), monitor.finish)
    assert not monitor.finished
    monitor.update({"b": [(0, 0)]})
    assert monitor.finish() == [(0, 1)]


def test_signals_must_overlap(backend: Backend) -> None:
    apart: Signals = {"a": [(0, 1), (2, 1)], "b": [(2.5, 0), (4, 1)]}
    text = (
        "expected signals that overlap in time, got 'a', which ends at 2.0, "
        "and 'b', which begins at 2.5"
    )
    refused(InputError, text, lambda: rtamt.dense.evaluate("a > b", apart, backend=backend))
    monitor = rtamt.dense.Monitor("a > b", backend=backend)
    assert monitor.update(apart) == []
    refused(InputError, text, monitor.finish)
    assert monitor.update({"a": [(3, 1)]}) == [(2.5, 1)]
    assert monitor.finish() == []


def test_events_are_given_as_one_mapping_or_by_name(backend: Backend) -> None:
    monitor = rtamt.dense.Monitor("a > b", backend=backend)
    assert monitor.update(a=[(0, 3)], b=[(0, 1), (1, 2)]) == []
    assert monitor.update() == []
    one = {"a": [(1, 4)]}
    for args, named in [((one, one), {}), ((one,), one), ((one, one), one)]:
        text = (
            "expected events as one mapping or by name, as in update(x=[(0.0, 1.5)]), got "
            f"{len(args)} by position and {len(named)} by name"
        )
        refused(InputError, text, functools.partial(monitor.update, *args, **named))
    assert monitor.update(**one) == [(0, 2)]
    assert monitor.finish() == []


def test_nothing_comes_after_the_end(backend: Backend) -> None:
    monitor = rtamt.dense.Monitor("a > 0", backend=backend)
    monitor.update({"a": [(0, 1)]})
    monitor.finish()
    text = "the trace is finished; call reset() before the next update"
    refused(StateError, text, lambda: monitor.update({"a": [(1, 1)]}))
    refused(StateError, text, lambda: monitor.update({}))
    monitor.reset()
    assert monitor.update({"a": [(0, 1), (1, 2)]}) == [(0, 1)]


# Whole signals. ----------------------------------------------------------------------------------
def test_evaluate_dense_needs_events_of_every_variable(backend: Backend) -> None:
    text = "expected events of every variable, got none of 'b'; the variables are a, b"
    missing = "No signal 'b'. The signals are 'a'."
    refused(
        InputError, missing, lambda: rtamt.dense.evaluate("a > b", {"a": [(0, 1)]}, backend=backend)
    )
    nothings: list[EventsLike] = [[], (), np.empty(0), np.empty((0, 2)), rtamt.dense.Events([], [])]
    for nothing in nothings:
        whole = {"a": [(0, 1)], "b": nothing}
        call = functools.partial(rtamt.dense.evaluate, "a > b", whole, backend=backend)
        refused(InputError, text, call)


def test_evaluate_dense_ignores_other_variables(backend: Backend) -> None:
    whole: dict[str, Any] = {"a": [(0, 1)], "z": "no events"}
    assert rtamt.dense.evaluate("a > 0", whole, backend=backend) == [(0, 1)]


@pytest.mark.parametrize("interpolation", ["linear", "next", None])
def test_values_last_until_the_next_event(interpolation: Literal["previous"]) -> None:
    text = (
        "expected interpolation='previous' (a value lasts until the next event), "
        f"got {interpolation!r}"
    )
    refused(InputError, text, lambda: rtamt.dense.Monitor("a > 0", interpolation=interpolation))
    refused(
        InputError, text, lambda: rtamt.dense.evaluate("a > 0", {}, interpolation=interpolation)
    )


def test_a_future_without_an_end_is_refused_online(backend: Backend) -> None:
    with pytest.raises(RtamtError) as error:
        rtamt.dense.Monitor("once[0:1] always (x > 1)", backend=backend)
    assert str(error.value) == (
        "STL:1:11: 'always' without an end needs the whole future, and rtamt.dense.Monitor cannot "
        "wait for it\n  once[0:1] always (x > 1)\n            ^\n  hint: write an end, as in "
        "always[0:10], or use rtamt.dense.evaluate()"
    )


def test_an_error_points_into_the_text_that_was_given(backend: Backend) -> None:
    for blanks in range(3):
        with pytest.raises(RtamtError, match=rf"^STL:1:{11 + blanks}: 'always'"):
            rtamt.dense.Monitor(" " * blanks + "once[0:1] always (x > 1)", backend=backend)


@pytest.mark.parametrize(("call", "said"), [e for e in ERRORS if e[0].startswith("of(")])
@pytest.mark.parametrize(
    "make",
    [
        rtamt.dense.Monitor,
        rtamt.dense.EpisodeMonitor,
        lambda spec: rtamt.dense.evaluate(spec, {"x": [(0, 1)]}),
        lambda spec: rtamt.dense.judge(spec, {"x": [(0, 1)]}),
    ],
)
def test_bounds_are_counted(make: Callable[[str], object], call: str, said: str) -> None:
    check(call, said, of=make)


LAST = np.datetime64("2026-01-01T00:00:01", "s")


with warnings.catch_warnings(action="ignore"):  # deprecated since NumPy 2.5
    NO_UNIT = np.datetime64("NaT")


NO_TIME = "expected a finite time at event 0 of 'x', got NaT"


AFTER = "expected a time after {} at event 0 of 'x', got {}"


ON_ONE = f"{AFTER}, which is on the same tick of 1ns; {{}}"


KIND = "expected {} as the time of event 0 of 'x', as before, got {}"


FAR = "expected a time of less than 2**62 ticks of 1ns at event 0 of 'x', got {}; {}"


APART = "subtract the time of the first event from all, or leave one out"


@pytest.mark.parametrize(
    ("before", "event", "words"),
    [
        (1.5, 1.5, AFTER.format(1.5, 1.5)),
        (1.5, 1.5 + 1e-10, ON_ONE.format(1.5, 1.5000000001, "resolution='100ps' would do")),
        (1.5, 5e9, FAR.format(5e9, "resolution='10ns' would do")),
        (1.5, LAST, KIND.format("a number", f"datetime64 {LAST}")),
        (LAST, 1.5, KIND.format("datetime64", 1.5)),
        (1e9, Fraction(10**19 + 1, 10**10), ON_ONE.format(1e9, 1e9, APART)),
        (LAST, np.datetime64("NaT", "s"), NO_TIME),
        (LAST, NO_UNIT, NO_TIME),
    ],
)
def test_times_are_counted(before: Any, event: Any, words: str, backend: Backend) -> None:  # noqa: ANN401
    monitor = rtamt.dense.Monitor("x > 0", backend=backend)
    monitor.update({"x": [(before, 1.0)]})
    with pytest.raises(InputError, match=f"^{re.escape(words)}$"):
        monitor.update({"x": [(event, 2.0)]})
    assert monitor.settled == before
    assert monitor.finish() == [(before, 1.0)]


@pytest.mark.parametrize(
    ("events", "words"),
    [
        ([(LAST, 1), (2, 1)], "datetime64 as the time of event 1 of 'x', as before, got 2.0"),
        (
            [(0.5, 1), (Fraction(1), 1), (LAST, 1)],
            f"a number as the time of event 2 of 'x', as before, got datetime64 {LAST}",
        ),
    ],
)
def test_dates_and_numbers_are_not_mixed(events: Any, words: str, backend: Backend) -> None:  # noqa: ANN401
    with pytest.raises(InputError, match=f"^expected {re.escape(words)}$"):
        rtamt.dense.evaluate("x > 0", {"x": events}, backend=backend)


@pytest.mark.parametrize(
    ("dates", "resolution", "words", "would_do"),
    [
        (
            ["2026-01-01T00", "2500-01-01T00"],
            "10ns",
            "times that datetime64[ns] holds, as the resolution is 10ns",
            "1us",
        ),
        (
            ["2026-01-01T00", "2026-01-02T00"],
            Fraction(1, 3),
            "numbers as times, because no datetime64 counts ticks of 1/3s",
            "1ns",
        ),
    ],
)
def test_a_resolution_that_no_date_has_is_refused_and_the_named_one_would_do(
    dates: list[str], resolution: str | Fraction, words: str, would_do: str, backend: Backend
) -> None:
    signals = {"x": rtamt.dense.Events(np.array(dates, "datetime64[h]"), [1, -1])}
    said = f"expected {words}; resolution={would_do!r} would do"
    with pytest.raises(InputError, match=f"^{re.escape(said)}$"):
        rtamt.dense.evaluate("x > 0", signals, resolution=resolution, backend=backend)
    found = rtamt.dense.evaluate("x > 0", signals, resolution=would_do, backend=backend)
    np.testing.assert_array_equal(found.times, signals["x"].times)


@pytest.mark.parametrize("unit", ["Y", "M"])
def test_years_and_months_are_dates(unit: Literal["Y", "M"], backend: Backend) -> None:
    monitor = rtamt.dense.Monitor("x > 0", backend=backend)
    first = np.datetime64("2026", unit)
    monitor.update({"x": [(first, 1.0)]})
    with pytest.raises(InputError, match="expected a time after 2026"):
        monitor.update({"x": [(np.datetime64("2026-01-01", "s"), 2.0)]})
    monitor.update({"x": [(np.datetime64("2026-01-01T00:00:01", "s"), -1.0)]})
    assert [value for _, value in monitor.finish()] == [-1.0]


@pytest.mark.parametrize("judge_it", [rtamt.dense.explain, rtamt.dense.judge])
def test_a_trace_that_is_too_long_with_its_bounds_is_refused(
    judge_it: Callable[..., object], backend: Backend
) -> None:
    words = (
        "expected a trace that lasts less than 2**62 ticks of 1ns with the bounds of the "
        "formula, got 8500000000000000000; resolution='10ns' would do"
    )
    with pytest.raises(InputError, match=f"^{re.escape(words)}$"):
        judge_it("always[0:4e9](x > 0)", {"x": [(-2e9, 1), (2.5e9, 1)]}, backend=backend)


@pytest.mark.parametrize(
    ("resolution", "error", "words"),
    [
        (None, InputTypeError, 'in seconds or as text such as "1ns", got None'),
        (0, SpecificationError, 'from 1e-300 to 1e300 s, or text such as "100ms", got 0'),
        ("1x", SpecificationError, "from 1e-300 to 1e300 s, or text such as \"100ms\", got '1x'"),
    ],
)
def test_a_resolution_is_a_duration(resolution: Any, error: type[Exception], words: str) -> None:  # noqa: ANN401
    for call in (
        lambda: rtamt.dense.Monitor("x > 0", resolution=resolution),
        lambda: rtamt.dense.evaluate("x > 0", {"x": [(0, 1)]}, resolution=resolution),
    ):
        with pytest.raises(error, match=f"^expected a resolution {re.escape(words)}"):
            call()


def test_a_date_that_is_too_far_is_shown_as_a_date(backend: Backend) -> None:
    dates = np.array(["1600-01-01", "2026-01-01"], "datetime64[D]")
    words = (
        "expected a time of less than 2**62 ticks of 1ns at event 0 of 'x', got 1600-01-01; "
        "resolution='10ns' would do"
    )
    for events in (rtamt.dense.Events(dates, [1, 2]), [(dates[0], 1), (dates[1], 2)]):
        with pytest.raises(InputError, match=f"^{re.escape(words)}$"):
            rtamt.dense.evaluate("x > 0", {"x": events}, backend=backend)


def test_in_the_released_classes_the_last_event_of_a_tick_counts() -> None:
    events = [[0.0, 1.0], [1.0, 2.0], [1.0 + 1e-10, 5.0], [2.0, 3.0], [2.0, 4.0]]
    spec = StlDenseTimeSpecification()
    spec.declare_var("x", "float")
    spec.spec = "x > 0"
    spec.parse()
    expected = [[0.0, 1.0], [1.0, 5.0], [2.0, 4.0]]
    assert spec.evaluate(["x", events]) == expected
    assert spec.update(["x", events]) == expected
