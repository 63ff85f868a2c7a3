"""Variables that are fields of messages have the values of these fields."""

from __future__ import annotations

import copy
import math
import pickle
import re
from collections.abc import Callable, Mapping
from types import MappingProxyType, SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from message_classes import MODULES, Twist, Vector
from profiles import examples
from strategies import Trace, formulas, length, traces

import rtamt
from rtamt import (
    EpisodeMonitor,
    Formula,
    InputError,
    InputTypeError,
    Monitor,
    evaluate,
)

Backend = Literal["native", "python"]
NAN = math.nan


TEXT = """
from geometry import Twist
input Twist cmd
output float pos
abs(cmd.linear.x - pos) < cmd.angular.y
"""


@pytest.fixture
def monitor(backend: Backend) -> Monitor:
    """Return a monitor of two fields and a number after one sample."""
    made = Monitor(rtamt.parse(TEXT, modules=MODULES), backend=backend)
    assert made.update(cmd=Twist(Vector(1), Vector(0, 5)), pos=3.0) == 3.0
    return made


# Forms of messages. ------------------------------------------------------------------------------

FIELDS = {"a": "cmd.linear.x", "b": "cmd.linear.y", "c": "c"}
FORMS: dict[str, Callable[[float, float], dict[str, Any]]] = {
    "names": lambda a, b: {"cmd.linear.x": a, "cmd.linear.y": b},
    "objects": lambda a, b: {"cmd": Twist(Vector(a, b))},
    "mappings": lambda a, b: {"cmd": {"linear": {"x": a, "y": b}, "stamp": "now"}},
    "objects in mappings": lambda a, b: {"cmd": MappingProxyType({"linear": Vector(a, b)})},
    "mappings in objects": lambda a, b: {"cmd": SimpleNamespace(linear={"y": b, "x": a})},
    "inner messages": lambda a, b: {"cmd.linear": Vector(a, b)},
    "the innermost of several": lambda a, b: {
        "cmd.linear": {"y": b},
        "cmd.linear.x": a,
        "cmd": Twist(Vector(NAN, NAN)),
    },
    "numpy scalars": lambda a, b: {"cmd": Twist(Vector(np.float64(a), np.float64(b)))},
}


def dotted(formula: Formula) -> str:
    """Return the formula with fields of a message as variables."""
    return re.sub(r"\b[abc]\b", lambda name: FIELDS[name[0]], str(formula))


def needed(sample: dict[str, Any], variables: tuple[str, ...]) -> dict[str, Any]:
    """Return the part of a sample for the variables of the formula."""
    return {
        name: value
        for name, value in sample.items()
        if any(v == name or v.startswith(f"{name}.") for v in variables)
    }


@pytest.mark.parametrize("form", FORMS)
@settings(max_examples=examples(20))
@given(formula=formulas(2), trace=traces())
def test_messages_of_any_form_mean_their_fields(
    form: str, formula: Formula, trace: Trace, backend: Backend
) -> None:
    pairs = [
        (make(formula, backend=backend), make(dotted(formula), backend=backend))
        for make in (Monitor, EpisodeMonitor)
    ]
    for a, b, c in zip(*trace.values(), strict=True):
        for plain, fields in pairs:
            assert fields.variables == tuple(FIELDS[name] for name in plain.variables)
            expected = plain.update({n: {"a": a, "b": b, "c": c}[n] for n in plain.variables})
            sample = needed({**FORMS[form](a, b), "c": c}, fields.variables)
            assert np.array_equal(fields.update(sample), expected, equal_nan=True)


@settings(max_examples=examples(20))
@given(formula=formulas(2), trace=traces())
def test_blocks_take_messages_in_a_row_and_nested_columns(
    formula: Formula, trace: Trace, backend: Backend
) -> None:
    n = length(trace)
    expected = evaluate(formula, trace, n=n, backend=backend)
    a, b, c = trace.values()
    messages = [Twist(Vector(x, y)) for x, y in zip(a, b, strict=True)]
    blocks: list[Mapping[str, Any]] = [
        {"cmd": messages, "c": c},
        {"cmd": tuple({"linear": vars(m.linear)} for m in messages), "c": c, "other": range(n)},
        {"cmd": np.array(messages, object), "c": np.array(c)},
        {"cmd": {"linear": {"x": a, "y": np.array(b)}}, "c": c},
        {"cmd.linear": [m.linear for m in messages], "c": c},
    ]
    once = {"cmd": iter(messages), "c": c}
    assert np.array_equal(evaluate(dotted(formula), once, n=n, backend=backend), expected)
    for block in blocks:
        found = evaluate(dotted(formula), block, n=n, backend=backend)
        assert np.array_equal(found, expected)
        monitor = Monitor(dotted(formula), backend=backend)
        if monitor.variables:
            values = monitor.update_many(needed(dict(block), monitor.variables))
            plain = Monitor(formula, backend=backend)
            columns = {name: trace[name] for name in plain.variables}
            assert np.array_equal(values, plain.update_many(columns), equal_nan=True)


def test_a_held_nan_is_that_of_the_field(backend: Backend) -> None:
    monitor = Monitor("m.x + m.y > 0", backend=backend, nan="hold")
    assert monitor.update(m=Vector(1, 2)) == 3.0
    assert monitor.update(m=Vector(NAN, 5)) == 6.0


def test_what_is_a_variable_itself_is_no_message(backend: Backend) -> None:
    monitor = Monitor("m > 0 and m.x > 0", backend=backend)
    assert monitor.update({"m": 3.0, "m.x": 2.0}) == 2.0
    with pytest.raises(InputError, match=r"got none for 'm\.x'; the variables are m, m\.x$"):
        monitor.update(m=Vector(1))


@pytest.mark.parametrize(
    "duplicate",
    [copy.copy, copy.deepcopy, lambda m: pickle.loads(pickle.dumps(m))],
    ids=["copy", "deepcopy", "pickle"],
)
def test_a_duplicate_knows_the_messages_and_their_classes(
    duplicate: Callable[[Monitor], Monitor], monitor: Monitor
) -> None:
    twin = duplicate(monitor)
    assert twin.update(cmd=Twist(Vector(2), Vector(0, 1)), pos=2.0) == 1.0
    with pytest.raises(InputTypeError, match="expected a Twist"):
        twin.update(cmd=Vector(), pos=2.0)


def test_of_a_class_that_cannot_be_imported_a_pickle_keeps_the_name() -> None:
    class Local:
        x = 5.0

    spec = rtamt.parse("from m import T; T m; m.x > 0", modules={"m": SimpleNamespace(T=Local)})
    again = pickle.loads(pickle.dumps(spec))
    assert again == spec
    assert (spec.types, dict(again.types)) == ({"T": Local}, {})
    assert Monitor(again).update(m=Local()) == 5.0


# What is refused. --------------------------------------------------------------------------------


REFUSED: list[tuple[dict[str, Any], type[Exception], str]] = [
    (
        {"cmd": Vector(), "pos": 1},
        InputTypeError,
        "expected a Twist or a mapping for 'cmd' at sample 1, got Vector",
    ),
    (
        {"cmd": {"linear": {"x": 1}}, "pos": 1},
        InputError,
        "'cmd' at sample 1 (dict) has no field 'angular'; its fields are linear",
    ),
    (
        {"cmd": {"linear": Twist()}, "pos": 1},
        InputError,
        "'cmd.linear' at sample 1 (Twist) has no field 'x'; its fields are angular, linear, stamp",
    ),
    (
        {"cmd": {"linaer": Vector()}, "pos": 1},
        InputError,
        "'cmd' at sample 1 (dict) has no field 'linear'; did you mean 'linaer'?",
    ),
    (
        {"cmd": Twist(linear=5), "pos": 1},  # type: ignore[arg-type]
        InputError,
        "'cmd.linear' at sample 1 (int) has no field 'x'",
    ),
    (
        {"cmd": Twist(Vector("fast")), "pos": 1},  # type: ignore[arg-type]
        InputTypeError,
        "expected a number for 'cmd.linear.x' at sample 1, got str 'fast'",
    ),
    (
        {"cmd": {"linear": Vector(), "angular": Vector}, "pos": 1, "cmd.angular.y": Vector()},
        InputTypeError,
        "expected a number for 'cmd.angular.y' at sample 1, got Vector Vector(x=0.0, y=0.0)",
    ),
    (
        {"cmd": Twist(Vector(NAN)), "pos": 1},
        InputError,
        (
            "variable 'cmd.linear.x' is nan at sample 1; "
            "pass nan='hold' to keep the last value instead"
        ),
    ),
    (
        {"cmd": Twist()},
        InputError,
        (
            "expected a value for every variable, got none for 'pos'; "
            "the variables are cmd.linear.x, cmd.angular.y, pos"
        ),
    ),
    (
        {"pos": 1},
        InputError,
        (
            "expected a value for every variable, got none for 'cmd.linear.x'; "
            "the variables are cmd.linear.x, cmd.angular.y, pos"
        ),
    ),
    (
        {"cmd": Twist(), "pos": 1, "dmc": Twist()},
        InputError,
        "unknown variable 'dmc'; the variables are cmd.linear.x, cmd.angular.y, pos",
    ),
    (
        {"cdm": Twist(), "pos": 1},
        InputError,
        "unknown variable 'cdm'; did you mean 'cmd'?",
    ),
]


@pytest.mark.parametrize(("sample", "error", "message"), REFUSED)
def test_a_message_that_does_not_fit_is_refused_and_leaves_no_trace(
    sample: dict[str, Any], error: type[Exception], message: str, monitor: Monitor
) -> None:
    with pytest.raises(error, match=f"^{re.escape(message)}"):
        monitor.update(**sample)
    with pytest.raises(error, match=f"^{re.escape(message)}"):
        monitor.update(sample)
    assert monitor.samples == 1
    assert monitor.update(cmd=Twist(Vector(1), Vector(0, 5)), pos=3.0) == 3.0


BLOCKS: list[tuple[dict[str, Any], type[Exception], str]] = [
    (
        {"cmd": [Twist(), Vector()], "pos": [1, 2]},
        InputTypeError,
        "expected a Twist or a mapping for 'cmd' at sample 2, got Vector",
    ),
    (
        {"cmd": Twist(), "pos": [1, 2]},
        InputTypeError,
        "expected a message for every sample as 'cmd', got Twist Twist(",
    ),
    (
        {"cmd": [Twist()], "pos": [1, 2]},
        InputError,
        "expected columns of one length, got cmd.linear.x: 1, cmd.angular.y: 1, pos: 2",
    ),
    (
        {"cmd": [Twist(Vector("a"))], "pos": [1]},  # type: ignore[arg-type]
        InputTypeError,
        "expected an array of numbers for 'cmd.linear.x', got <U1",
    ),
]


@pytest.mark.parametrize(("block", "error", "message"), BLOCKS)
def test_a_block_with_messages_that_do_not_fit_is_refused_as_a_whole(
    block: dict[str, Any], error: type[Exception], message: str, monitor: Monitor
) -> None:
    with pytest.raises(error, match=f"^{re.escape(message)}"):
        monitor.update_many(block)
    assert monitor.samples == 1


@pytest.mark.parametrize(
    ("column", "words"),
    [
        ("text", "'m.r[0]' at sample 0 (str) has no field 'x'"),
        (3, "'m.r' at sample 0 (int) has no elements, expected a list with [0]"),
        (None, "'m.r' at sample 0 (NoneType) has no elements, expected a list with [0]"),
    ],
)
def test_a_column_of_lists_that_is_none_is_refused(column: object, words: str) -> None:
    spec = rtamt.parse(
        "from m import T; T m; m.r[0].x > 0", modules={"m": SimpleNamespace(T=SimpleNamespace)}
    )
    assert evaluate(spec, {"m": {"r": [[{"x": 2.0}]]}}).tolist() == [2.0]
    with pytest.raises(InputError) as error:
        evaluate(spec, {"m": {"r": column}})
    assert str(error.value) == words
