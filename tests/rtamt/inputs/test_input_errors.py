"""The exact errors of monitors; a refused sample leaves no trace."""

import math
from collections.abc import Callable
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples
from strategies import Trace, formulas, length, sample, traces

import rtamt
from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    InputTypeError,
    Monitor,
    RtamtError,
    SpecificationError,
    UncertainValue,
    evaluate,
    explain,
    judge,
)

Backend = Literal["native", "python"]
NAN = math.nan


@pytest.fixture
def monitor(backend: Backend) -> Monitor:
    """Return a monitor of two variables after one sample."""
    made = Monitor("once[0:2](req - gnt > 1)", backend=backend)
    made.update(req=4.0, gnt=1.0)
    return made


NOT_NUMBERS = [
    ("sqrt(x) > 1", "sqrt(x)", {"x": -1.0}),
    ("ln(x - 1) > 1", "ln(x - 1)", {"x": 0.5}),
    ("x / y > 1", "x / y", {"x": 0.0, "y": 0.0}),
    ("x > y", "x > y", {"x": math.inf, "y": math.inf}),
    ("x == y", "x == y", {"x": -math.inf, "y": -math.inf}),
    ("y > 0 and x - y > 1", "x - y", {"y": -math.inf, "x": -math.inf}),
    ("x * 0 > 1", "x * 0", {"x": math.inf}),
    ("pow(x, 0.5) > 1", "pow(x, 0.5)", {"x": -1.0}),
    ("min(1, sqrt(x)) > 1", "sqrt(x)", {"x": -4.0}),
]


@pytest.mark.parametrize(("text", "term", "bad"), NOT_NUMBERS)
def test_a_term_that_is_no_number_is_refused_by_name(
    text: str, term: str, bad: dict[str, float], backend: Backend
) -> None:
    good = dict.fromkeys(bad, 1.0)
    values = ", ".join(f"{name} = {value!r}" for name, value in bad.items())
    message = f"'{term}' is not a number at sample 1, where {values}"
    checked = Monitor(f"historically({text})", backend=backend)
    first = checked.update(good)
    for call in (
        lambda: checked.update(bad),
        lambda: Monitor(text, backend=backend).update_many(
            {name: [1.0, value] for name, value in bad.items()}
        ),
        lambda: evaluate(text, {n: [1.0, v, 1.0] for n, v in bad.items()}, backend=backend),
    ):
        with pytest.raises(InputError) as caught:
            call()
        assert str(caught.value) == message
    assert (checked.samples, checked.update(good)) == (1, first)


REFUSED: list[tuple[Callable[[Monitor], object], type[RtamtError], str]] = [
    (
        lambda m: m.update(req=1.0),
        InputError,
        "expected a value for every variable, got none for 'gnt'; the variables are req, gnt",
    ),
    (
        lambda m: m.update({}),
        InputError,
        "expected a value for every variable, got none for 'req'; the variables are req, gnt",
    ),
    (
        lambda m: m.update(),
        InputError,
        "expected a value for every variable, got none for 'req'; the variables are req, gnt",
    ),
    (
        lambda m: m.update(req=1.0, gtn=2.0),
        InputError,
        "unknown variable 'gtn'; did you mean 'gnt'?",
    ),
    (
        lambda m: m.update(req=1.0, gnt=2.0, time=3.0),
        InputError,
        "unknown variable 'time'; the variables are req, gnt",
    ),
    (
        lambda m: m.update({0: 1.0, 1: 2.0}),
        InputError,
        "unknown variable '0'; the variables are req, gnt",
    ),
    (lambda m: m.update(1.0), InputError, "expected 2 values (req, gnt), got 1"),
    (lambda m: m.update(1.0, 2.0, 3.0), InputError, "expected 2 values (req, gnt), got 3"),
    (lambda m: m.update([1.0, 2.0, 3.0]), InputError, "expected 2 values (req, gnt), got 3"),
    (lambda m: m.update(np.zeros(3)), InputError, "expected 2 values (req, gnt), got 3"),
    (
        lambda m: m.update(np.zeros((4, 2))),
        InputError,
        "expected a 1-D array of 2 values, got shape (4, 2); update_many takes blocks",
    ),
    (
        lambda m: m.update(1.0, gnt=2.0),
        InputError,
        "expected values by position or by keyword, got both",
    ),
    (
        lambda m: m.update(1.0, NAN),
        InputError,
        "variable 'gnt' is nan at sample 1; pass nan='hold' to keep the last value instead",
    ),
    (
        lambda m: m.update(np.array([NAN, 1.0])),
        InputError,
        "variable 'req' is nan at sample 1; pass nan='hold' to keep the last value instead",
    ),
    (
        lambda m: m.update(req=1.0, gnt=NAN),
        InputError,
        "variable 'gnt' is nan at sample 1; pass nan='hold' to keep the last value instead",
    ),
    (
        lambda m: m.update(1.0, "2"),
        InputTypeError,
        "expected a number for 'gnt' at sample 1, got str '2'",
    ),
    (
        lambda m: m.update(req=1.0, gnt=None),
        InputTypeError,
        "expected a number for 'gnt' at sample 1, got NoneType None",
    ),
    (
        lambda m: m.update({"req": 1j, "gnt": 2.0}),
        InputTypeError,
        "expected a number for 'req' at sample 1, got complex 1j",
    ),
    (
        lambda m: m.update(1.0, [2.0]),
        InputTypeError,
        "expected a number for 'gnt' at sample 1, got list [2.0]",
    ),
    (
        lambda m: m.update(np.array([1.0, 2.0], dtype=complex)),
        InputTypeError,
        "expected a number for 'req' at sample 1, got complex (1+0j)",
    ),
    (
        lambda m: m.update(1.0, 10**400),
        InputTypeError,
        "expected a number for 'gnt' at sample 1, got int " + "1" + "0" * 36 + "...",
    ),
    (
        lambda m: m.update_many({"req": [1.0, 2.0, 3.0], "gnt": [1.0, NAN, 3.0]}),
        InputError,
        "variable 'gnt' is nan at sample 2; pass nan='hold' to keep the last value instead",
    ),
    (
        lambda m: m.update_many({"req": [1.0, 2.0], "gnt": [1.0]}),
        InputError,
        "expected columns of one length, got req: 2, gnt: 1",
    ),
    (
        lambda m: m.update_many({"req": [1.0]}),
        InputError,
        "expected a value for every variable, got none for 'gnt'; the variables are req, gnt",
    ),
    (
        lambda m: m.update_many({"req": [1.0], "gnt": [1.0], "reg": [1.0]}),
        InputError,
        "unknown variable 'reg'; did you mean 'req'?",
    ),
    (
        lambda m: m.update_many(np.zeros((4, 3))),
        InputError,
        "expected an array of shape (n, 2), a column for each of req, gnt, got shape (4, 3)",
    ),
    (
        lambda m: m.update_many(np.zeros(2)),
        InputError,
        "expected an array of shape (n, 2), a column for each of req, gnt, got shape (2,)",
    ),
    (
        lambda m: m.update_many({"req": np.zeros((2, 2)), "gnt": [1.0, 2.0]}),
        InputError,
        "expected a 1-D array for 'req', got shape (2, 2)",
    ),
    (
        lambda m: m.update_many({"req": ["1"], "gnt": [1.0]}),
        InputTypeError,
        "expected an array of numbers for 'req', got <U1",
    ),
    (
        lambda m: m.update_many({"req": [1.0], "gnt": np.array([1j])}),
        InputTypeError,
        "expected an array of numbers for 'gnt', got complex128",
    ),
    (
        lambda m: m.update_many({"req": [1.0], "gnt": np.array([None])}),
        InputTypeError,
        "expected an array of numbers for 'gnt', got object",
    ),
    (
        lambda m: m.update_many([[1.0, 2.0], [3.0]]),
        InputTypeError,
        "expected an array of numbers for the block, got list [[1.0, 2.0], [3.0]]",
    ),
]


@pytest.mark.parametrize(("call", "error", "message"), REFUSED, ids=[r[2] for r in REFUSED])
def test_refused_input_says_why_and_leaves_the_monitor_as_it_was(
    call: Callable[[Monitor], object], error: type[RtamtError], message: str, monitor: Monitor
) -> None:
    with pytest.raises(error) as caught:
        call(monitor)
    assert str(caught.value) == message
    assert monitor.samples == 1
    assert [monitor.update(0.0, 0.0) for _ in range(3)] == [2.0, 2.0, -1.0]


EVALUATIONS: list[tuple[Callable[[Any], object], type[RtamtError], str]] = [
    (
        lambda b: evaluate("x > 0", {"x": []}, backend=b),
        InputError,
        "expected a trace of at least 1 sample, got 0",
    ),
    (
        lambda b: evaluate("x > y", {"x": [1.0], "y": [1.0, 2.0]}, backend=b),
        InputError,
        "expected columns of one length, got x: 1, y: 2",
    ),
    (
        lambda b: evaluate("x > 0", {"x": [1.0]}, n=2, backend=b),
        InputError,
        "expected columns of one length, got x: 1 and n=2",
    ),
    (
        lambda b: evaluate("x > 0", {"y": [1.0]}, backend=b),
        InputError,
        "No column 'x'. The columns are 'y'.",
    ),
    (
        lambda b: judge("x > 0", {"x": [[1.0]]}, backend=b),
        InputError,
        "expected a 1-D array for 'x', got shape (1, 1)",
    ),
    (
        lambda b: evaluate("x > 0", {"x": [1.0, NAN]}, backend=b),
        InputError,
        "variable 'x' is nan at sample 1; pass nan='hold' to keep the last value instead",
    ),
    (
        lambda b: evaluate("x > 0", {"x": [NAN, 1.0]}, backend=b, nan="hold"),
        InputError,
        (
            "variable 'x' is nan at sample 0; "
            "nan='hold' keeps the last value, and the first sample has none"
        ),
    ),
    (
        lambda b: evaluate("true", {}, backend=b),
        InputError,
        (
            "the formula has no variables, so that the number of samples is unknown; pass an array "
            "of shape (samples, 0), or n= for a single trace"
        ),
    ),
    (
        lambda b: evaluate("true", {}, n=-1, backend=b),
        InputError,
        "expected a whole number of samples as n, got -1",
    ),
    (
        lambda b: evaluate("true", {}, n=2.0, backend=b),  # type: ignore[arg-type]
        InputError,
        "expected a whole number of samples as n, got 2.0",
    ),
    (
        lambda b: evaluate("x > 0", {"x": np.ma.array([1, 2], mask=[False, True])}, backend=b),
        InputError,
        "variable 'x' is nan at sample 1; pass nan='hold' to keep the last value instead",
    ),
    (
        lambda b: Monitor("specs/response.stl", backend=b),
        SpecificationError,
        (
            "expected the text of a specification, got the path 'specs/response.stl'; "
            "write load('specs/response.stl')"
        ),
    ),
    (
        lambda b: Monitor("x > 0", backend=b, nan="skip"),  # type: ignore[arg-type]
        InputError,
        "expected nan='raise' or nan='hold', got 'skip'",
    ),
    (
        lambda _: Monitor("x > 0", backend="cuda"),  # type: ignore[arg-type]
        InputError,
        "expected backend='auto', 'native' or 'python', got 'cuda'",
    ),
    (
        lambda b: Monitor(3, backend=b),  # type: ignore[arg-type]
        InputTypeError,
        "expected a specification as text, Formula or Specification, got int",
    ),
    (
        lambda b: Monitor("x > 0 and eventually(y > 0)", backend=b),
        SpecificationError,
        (
            "STL:1:11: 'eventually' without an end needs the whole future, and Monitor cannot wait "
            "for it\n  x > 0 and eventually(y > 0)\n            ^\n  hint: write an end, as in "
            "eventually[0:10], or use EpisodeMonitor or evaluate()"
        ),
    ),
    (
        lambda b: Monitor("sqrt(-1) > 0", backend=b),
        SpecificationError,
        "STL:1:1: sqrt(-1) is not a number\n  sqrt(-1) > 0\n  ^",
    ),
]


def test_an_interval_of_arrays_is_no_value(backend: Backend) -> None:
    monitor = EpisodeMonitor("x > 0", backend=backend)
    with pytest.raises(InputTypeError) as error:
        monitor.update(UncertainValue([1, 2], [2, 3]))
    assert str(error.value).startswith(
        "expected a number at each end for 'x' at sample 0, "
        "got UncertainValue UncertainValue([1.0, 2.0]"
    )
    assert monitor.samples == 0


def test_of_a_long_name_no_similar_one_is_sought(backend: Backend) -> None:
    name = "r" * 1000
    with pytest.raises(InputError) as error:
        Monitor("req > 0", backend=backend).update({name: 1.0, "req": 1.0})
    assert str(error.value) == f"unknown variable '{name}'; the variables are req"


def test_one_value_is_counted_in_the_singular(backend: Backend) -> None:
    with pytest.raises(InputError, match=r"^expected 1 value \(x\), got 2$"):
        Monitor("x > 0", backend=backend).update(1.0, 2.0)


@pytest.mark.parametrize(("call", "error", "message"), EVALUATIONS, ids=[r[2] for r in EVALUATIONS])
def test_what_cannot_be_monitored_says_why(
    call: Callable[[Backend], object], error: type[RtamtError], message: str, backend: Backend
) -> None:
    with pytest.raises(error) as caught:
        call(backend)
    assert str(caught.value) == message


@pytest.mark.parametrize(
    "text", ["not always(x > 0)", "always(x > 0) and y > 0", "eventually[1:inf](x > 0)"]
)
def test_only_an_endless_root_from_now_is_monitored(text: str, backend: Backend) -> None:
    with pytest.raises(SpecificationError, match="without an end needs the whole future"):
        Monitor(text, backend=backend)


@given(
    formula=formulas().filter(lambda f: bool(f.variables)), trace=traces(least=2), data=st.data()
)
@settings(max_examples=examples(40))
def test_nan_is_refused_and_the_monitor_continues_like_an_undisturbed_twin(
    formula: Formula, trace: Trace, data: st.DataObject, backend: Backend
) -> None:
    monitor, twin = Monitor(formula, backend=backend), Monitor(formula, backend=backend)
    names, n = monitor.variables, length(trace)
    bad = data.draw(st.sampled_from(names))
    for i in range(n):
        good = sample(trace, i, names)
        with pytest.raises(InputError):
            monitor.update({**good, bad: NAN})
        with pytest.raises(InputError):
            monitor.update_many({v: [good[v], NAN if v == bad else 0.0] for v in names})
        assert np.array_equal(monitor.update(good), twin.update(good), equal_nan=True)


CALLS_WITH_COLUMNS: list[Callable[[dict[str, Any]], object]] = [
    lambda data: evaluate("always(speed > 0)", data),
    lambda data: judge("always(speed > 0)", data),
    lambda data: explain("always(speed > 0)", data),
    lambda data: rtamt.dense.evaluate("always(speed > 0)", data),
    lambda data: rtamt.dense.judge("always(speed > 0)", data),
]


@pytest.mark.parametrize("call", CALLS_WITH_COLUMNS)
@pytest.mark.parametrize("column", ["Speed", "SPEED", "spede"])
def test_misspelt_column_is_named(call: Callable[[dict[str, Any]], object], column: str) -> None:
    with pytest.raises(
        InputError, match=rf"'speed'\. The \w+ are 'gap', '{column}'\. Did you mean '{column}'\?"
    ):
        call({"gap": [(0, 1.0), (1, 1.0)], column: [(0, 1.0), (1, 1.0)]})


def test_error_lists_twenty_columns() -> None:
    with pytest.raises(InputError, match=r"'c0', .*'c19' and 10 more\.$"):
        evaluate("speed > 0", {f"c{i}": [1.0] for i in range(30)})
