"""Messages in dense time: their events are events of their fields."""

from __future__ import annotations

import copy
import math
import re
from typing import Any, Literal

import pytest
from dense_signals import Signals, signals
from hypothesis import given, settings
from message_classes import MODULES, Slotted, Twist, Vector
from profiles import examples
from strategies import formulas

import rtamt
from rtamt import Formula, InputError, InputTypeError

Backend = Literal["native", "python"]
FIELDS = {"a": "cmd.linear.x", "b": "cmd.angular.y", "c": "c"}


def dotted(formula: Formula) -> str:
    return re.sub(r"\b[abc]\b", lambda name: FIELDS[name[0]], str(formula))


@settings(max_examples=examples(50))
@given(formula=formulas(dense=True).filter(lambda f: f.variables), whole=signals())
def test_events_of_messages_are_events_of_their_fields(
    formula: Formula, whole: Signals, backend: Backend
) -> None:
    plain = {**whole, "b": [(time, 2 * value) for time, value in whole["a"]]}
    plain = {name: plain[name] for name in formula.variables}
    if max(e[0][0] for e in plain.values()) > min(e[-1][0] for e in plain.values()):
        return
    expected = rtamt.dense.evaluate(formula, plain, backend=backend)
    messages = [(t, Twist(Vector(v), Vector(0, 2 * v))) for t, v in whole["a"]]
    nested = [(t, {"linear": m.linear, "angular": vars(m.angular)}) for t, m in messages]
    for cmd in (messages, tuple(nested), iter(nested)):
        events: dict[str, Any] = {"cmd": cmd, "c": whole["c"]}
        assert rtamt.dense.evaluate(dotted(formula), events, backend=backend) == expected
    monitor = rtamt.dense.Monitor(dotted(formula), backend=backend)
    given: list[tuple[float, float]] = []
    if "c" in monitor.variables:
        given += monitor.update({"c": whole["c"]})
    if {"a", "b"} & set(formula.variables):
        for event in messages:
            given += monitor.update({"cmd": [event]})
    assert given + monitor.finish() == expected


REFUSED: list[tuple[dict[str, Any], type[Exception], str]] = [
    (
        {"cmd": [(2.0, Vector())]},
        InputTypeError,
        "expected a Twist or a mapping for 'cmd' at time 2.0, got Vector",
    ),
    (
        {"cmd": [(2.0, Twist()), (2.5, {"linear": 3})]},
        InputError,
        "'cmd.linear' at time 2.5 (int) has no field 'x'",
    ),
    (
        {"cmd": Twist()},
        InputTypeError,
        "expected events of 'cmd' as a sequence of (time, message), got Twist Twist(",
    ),
    (
        {"cmd": [Twist()]},
        InputError,
        "expected (time, message) as event 0 of 'cmd', got Twist Twist(",
    ),
    (
        {"cmd": [(0.5, Twist())]},
        InputError,
        "expected a time after 1.0 at event 0 of 'cmd.linear.x', got 0.5",
    ),
    ({"cdm": []}, InputError, "unknown variable 'cdm'; did you mean 'cmd'?"),
    ({"odom": []}, InputError, "unknown variable 'odom'; the variables are cmd.linear.x, pos"),
]


@pytest.mark.parametrize(("events", "error", "message"), REFUSED)
def test_messages_that_do_not_fit_are_refused_and_leave_no_trace(
    events: dict[str, Any], error: type[Exception], message: str, backend: Backend
) -> None:
    text = "from geometry import Twist; input Twist cmd; float pos; cmd.linear.x > pos"
    monitor = rtamt.dense.Monitor(rtamt.parse(text, modules=MODULES), backend=backend)
    monitor.update({"cmd": [(0.0, Twist()), (1.0, Twist(Vector(3)))], "pos": [(0.0, 1.0)]})
    with pytest.raises(error, match=f"^{re.escape(message)}"):
        monitor.update(events)
    again = copy.copy(monitor)
    assert again.update({"pos": [(4.0, 0.0)], "cmd": [(3.0, Twist())]}) == [
        (0.0, -1.0),
        (1.0, 2.0),
    ]


def test_values_are_written_to_the_fields_that_formulas_name(backend: Backend) -> None:
    monitor = rtamt.dense.Monitor(
        "out.near = x > 0\nout.value = always[0:1](x > 0)", backend=backend
    )
    message = Slotted()
    assert monitor.write(out=message) is False
    assert math.isnan(message.near)
    monitor.update({"x": [(0, 3.0), (0.5, 2.0), (3, 9.0)]})
    assert monitor.write({"out": message}) is True
    assert {"out.near": message.near, "out.value": message.value} == monitor.values
    with pytest.raises(InputError, match=r"^no formula names a field of 'x'"):
        monitor.write(x=message)
