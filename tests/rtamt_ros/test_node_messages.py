"""Messages with several fields: what is in one of them is about one time."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND
from memory_nodes import MS, send, started

from rtamt import SpecificationError, evaluate, parse

START = 1000 * SECOND
PERIOD = 100 * MS
HEAD = """
from my_msgs.msg import Parts
output Parts out
float64 x
float64 y
"""
FORMULAS = {
    "x > 0": 0,
    "y - x > 1": 0,
    "historically[0:0.2](y > 0)": 0,
    "eventually[0:0.1](x > 1)": 1,
    "always[0.1:0.3](y > 0 or x > 2)": 3,
    "(x > 0) until[0:0.2] (y > 1)": 2,
}
"""Formulas, and by how many samples they are late."""
VALUES = st.sampled_from([-2.0, -0.5, 0.0, 1.0, 3.0])


@given(
    formulas=st.tuples(*[st.sampled_from(list(FORMULAS))] * 3),
    steps=st.lists(st.tuples(VALUES, VALUES, st.booleans()), min_size=1, max_size=20),
)
def test_message_fields_equal_evaluate(
    formulas: tuple[str, str, str], steps: list[tuple[float, float, bool]]
) -> None:
    a, b, c = formulas
    text = f"{HEAD}out.a = {a}\nout.b = {b}\nout.inner.x = {c}"
    if len({a, b, c}) < 3:  # a formula has one name
        return
    ros, node = started(text, stale=math.inf)
    last = START
    for number, (x, y, looks) in enumerate(steps):
        ros.time = START + number * PERIOD
        send(ros, "x", x)
        send(ros, "y", y)
        if not number or looks or ros.time - last >= 4 * PERIOD:  # else the look is late
            ros.tick()
            last = ros.time
    ros.tick()
    trace = {"x": [x for x, _, _ in steps], "y": [y for _, y, _ in steps]}
    columns = []
    for formula in formulas:
        spec = parse(f"float64 x\nfloat64 y\n{formula}")
        columns.append(evaluate(spec, trace, period=0.1).tolist())
    known = max(0, len(steps) - max(FORMULAS[each] for each in formulas))
    found = [(m.header.stamp.ns, m.a, m.b, m.inner.x) for m in ros.on("rtamt/out")]
    assert found == [
        (START + number * PERIOD, *(column[number] for column in columns))
        for number in range(known)
    ]
    assert len(node.reports) == 3


def test_stale_field_is_nan_in_waiting_messages() -> None:
    ros, _ = started(f"{HEAD}out.a = always[0:0.2](x > 0)\nout.b = y > 0", stale=0.25)
    for number in range(9):
        ros.time = START + number * PERIOD
        if not 3 <= number <= 6:
            send(ros, "x", 1.0 + number)
        send(ros, "y", 2.0)
        ros.tick()
    found = [((m.header.stamp.ns - START) // PERIOD, m.a, m.b) for m in ros.on("rtamt/out")]
    # x came last at 2, is held until 4 and stale at 5 and 6; what was to be known then never is.
    assert [(at, str(a), b) for at, a, b in found] == [
        (0, "1.0", 2.0),
        (1, "2.0", 2.0),
        (2, "3.0", 2.0),
        (3, "nan", 2.0),
        (4, "nan", 2.0),
        (5, "nan", 2.0),
        (6, "nan", 2.0),
    ]


def test_jump_back_drops_waiting_messages() -> None:
    ros, _ = started(f"{HEAD}out.a = always[0:0.2](x > 0)\nout.b = y > 0", stale=math.inf)
    for begin in (START, START - SECOND):
        for number in range(4):
            ros.time = begin + number * PERIOD
            send(ros, "x", 1.0)
            send(ros, "y", 2.0)
            ros.tick()
    found = [(m.header.stamp.ns - START) // PERIOD for m in ros.on("rtamt/out")]
    assert found == [0, 1, -10, -9]


def test_dense_refuses_several_fields() -> None:
    with pytest.raises(SpecificationError) as refused:
        started(f"{HEAD}out.a = x > 0\nout.inner.x = y > 0", dense=True)
    assert str(refused.value) == (
        "expected one field of the message 'out' in dense time, got out.a and out.inner.x, whose "
        "values change at times of their own; declare a message for each, or sample"
    )


def test_dense_header_has_the_time_of_the_value() -> None:
    text = f"{HEAD}output Parts near\nnear.a = x > 0\nout.a = always[0:0.5](near.a) and y > 0"
    ros, _ = started(text, dense=True)
    for number in range(9):
        send(ros, "x", 1.0 + number)
        send(ros, "y", 20.0)
        ros.tick(START + (number + 1) * PERIOD)
    for message in ros.on("rtamt/near"):  # x was published at that time, or a nanosecond before
        number = (message.header.stamp.ns - START + 1) // PERIOD
        assert message.a in (1.0 + number, float(number))
    stamps = [message.header.stamp.ns for message in ros.on("rtamt/near")]
    assert stamps == sorted(set(stamps))
    assert stamps[-1] >= START + 8 * PERIOD
