"""What the clock of dense time refuses, in exact words, with a resolution that would do."""

import re
import warnings
from collections.abc import Callable
from fractions import Fraction
from typing import Any, Literal

import numpy as np
import pytest

from rtamt import (
    DenseEpisodeMonitor,
    DenseMonitor,
    Events,
    InputError,
    InputTypeError,
    SpecificationError,
    StlDenseTimeSpecification,
    evaluate_dense,
    explain_dense,
    judge_dense,
)

Backend = Literal["native", "python"]


@pytest.mark.parametrize(
    ("text", "reason", "hint"),
    [
        (
            "once[0:0.0000000015](x > 0)",
            "bound 0.0000000015 s is not a whole number of ticks of 1ns",
            "give resolution='500ps', of which it is one",
        ),
        (
            "once[0:5000000000](x > 0)",
            "bound 5000000000 s is 2**62 ticks of 1ns or more",
            "give resolution='10ns', or write smaller bounds",
        ),
        (
            "once[0.000000001:5000000000](x > 0)",
            "bound 5000000000 s is 2**62 ticks of 1ns or more",
            "write smaller bounds",
        ),
        (
            "once[0:4000000000](once[0:4000000000](x > 0))",
            "the bounds nested here are together 2**62 ticks of 1ns or more",
            "give resolution='10ns', or write smaller bounds",
        ),
    ],
)
def test_bounds_are_counted(text: str, reason: str, hint: str) -> None:
    words = re.escape(f"STL:1:5: {reason}\n  {text}\n      ^\n  hint: {hint}")
    for call in (
        DenseMonitor,
        DenseEpisodeMonitor,
        lambda spec: evaluate_dense(spec, {"x": [(0, 1)]}),
        lambda spec: judge_dense(spec, {"x": [(0, 1)]}),
    ):
        with pytest.raises(SpecificationError, match=f"^{words}$"):
            call(text)


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
        (
            1e9,
            Fraction(10**19 + 1, 10**10),
            ON_ONE.format(1e9, 1e9, APART),
        ),
        (LAST, np.datetime64("NaT", "s"), NO_TIME),
        (LAST, NO_UNIT, NO_TIME),
    ],
)
def test_times_are_counted(before: Any, event: Any, words: str, backend: Backend) -> None:  # noqa: ANN401
    monitor = DenseMonitor("x > 0", backend=backend)
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
        evaluate_dense("x > 0", {"x": events}, backend=backend)


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
    dates: list[str],
    resolution: str | Fraction,
    words: str,
    would_do: str,
    backend: Backend,
) -> None:
    signals = {"x": Events(np.array(dates, "datetime64[h]"), [1, -1])}
    said = f"expected {words}; resolution={would_do!r} would do"
    with pytest.raises(InputError, match=f"^{re.escape(said)}$"):
        evaluate_dense("x > 0", signals, resolution=resolution, backend=backend)
    found = evaluate_dense("x > 0", signals, resolution=would_do, backend=backend)
    np.testing.assert_array_equal(found.times, signals["x"].times)


@pytest.mark.parametrize("unit", ["Y", "M"])
def test_years_and_months_are_dates(unit: Literal["Y", "M"], backend: Backend) -> None:
    monitor = DenseMonitor("x > 0", backend=backend)
    first = np.datetime64("2026", unit)
    monitor.update({"x": [(first, 1.0)]})
    with pytest.raises(InputError, match="expected a time after 2026"):
        monitor.update({"x": [(np.datetime64("2026-01-01", "s"), 2.0)]})
    monitor.update({"x": [(np.datetime64("2026-01-01T00:00:01", "s"), -1.0)]})
    assert [value for _, value in monitor.finish()] == [-1.0]


@pytest.mark.parametrize("judge_it", [explain_dense, judge_dense])
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
        (
            "1x",
            SpecificationError,
            "from 1e-300 to 1e300 s, or text such as \"100ms\", got '1x'",
        ),
    ],
)
def test_a_resolution_is_a_duration(resolution: Any, error: type[Exception], words: str) -> None:  # noqa: ANN401
    for call in (
        lambda: DenseMonitor("x > 0", resolution=resolution),
        lambda: evaluate_dense("x > 0", {"x": [(0, 1)]}, resolution=resolution),
    ):
        with pytest.raises(error, match=f"^expected a resolution {re.escape(words)}"):
            call()


def test_a_date_that_is_too_far_is_shown_as_a_date(backend: Backend) -> None:
    dates = np.array(["1600-01-01", "2026-01-01"], "datetime64[D]")
    words = (
        "expected a time of less than 2**62 ticks of 1ns at event 0 of 'x', got 1600-01-01; "
        "resolution='10ns' would do"
    )
    for events in (Events(dates, [1, 2]), [(dates[0], 1), (dates[1], 2)]):
        with pytest.raises(InputError, match=f"^{re.escape(words)}$"):
            evaluate_dense("x > 0", {"x": events}, backend=backend)


def test_in_the_released_classes_the_last_event_of_a_tick_counts() -> None:
    events = [[0.0, 1.0], [1.0, 2.0], [1.0 + 1e-10, 5.0], [2.0, 3.0], [2.0, 4.0]]
    spec = StlDenseTimeSpecification()
    spec.declare_var("x", "float")
    spec.spec = "x > 0"
    spec.parse()
    expected = [[0.0, 1.0], [1.0, 5.0], [2.0, 4.0]]
    assert spec.evaluate(["x", events]) == expected
    assert spec.update(["x", events]) == expected
