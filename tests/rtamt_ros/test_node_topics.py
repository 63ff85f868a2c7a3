"""The topics and messages of robustness, bounds and verdicts."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import MS, send, started, topics, until

import rtamt_ros.node
from rtamt import EpisodeMonitor, InputError, Monitor, SpecificationError, evaluate, parse
from rtamt_ros.middleware import Level
from rtamt_ros.node import MonitorNode

MESSAGES = "from my_msgs.msg import Parts; from std_msgs.msg import Float32; float64 x; "


def test_fields_share_a_message() -> None:
    text = f"""{MESSAGES}
    output Parts out
    output Float32 alone
    out.a = x > 1
    out.inner.y = eventually[0:0.1](x > 2)
    out.b = always(out.a or out.inner.y)
    alone = x < 9
    """
    ros, _ = started(text.replace("; ", "\n"))
    assert "rtamt/out" in topics(ros)
    assert "rtamt/alone" in topics(ros)
    begin = ros.time
    for value in (3.0, 0.5, 4.0):
        send(ros, "x", value)
        ros.tick()
        ros.time += 100 * MS
    found = [(m.header.stamp.ns, m.a, m.inner.y, m.b) for m in ros.on("rtamt/out")]
    # out.b and out.inner.y are late by one sample, and out.a waits for them.
    assert found == [(begin, 2.0, 1.0, 2.0), (begin + 100 * MS, -0.5, 2.0, 2.0)]
    assert ros.data("rtamt/alone") == [6.0, 8.5, 5.0]


def test_shared_formula_is_published_once() -> None:
    ros, _ = started("p = eventually[0:0.1](x > 0); a = p or x > 5; b = always(p)")
    for value in (1.0, 2.0, 3.0):
        send(ros, "x", value)
        ros.tick()
        ros.time += 100 * MS
    assert ros.data("rtamt/p") == [2.0, 3.0]
    assert ros.data("rtamt/a") == [2.0, 3.0]
    assert ros.data("rtamt/b") == [2.0, 2.0]


def test_requirements_in_a_message_have_own_bounds() -> None:
    text = f"{MESSAGES}output Parts out; @ topic(out, /safe); out.a = x > 1; out.inner.x = x < 5"
    ros, _ = started(text)
    assert {topic for topic in topics(ros) if "verdict" in topic} == {
        "/safe/a/verdict",
        "/safe/inner/x/verdict",
    }
    send(ros, "x", 2.0)
    ros.tick()
    assert [(m.a, m.inner.x) for m in ros.on("/safe")] == [(1.0, 3.0)]


# For each text, the named formulas next to the result, and the publisher of their robustness.
UNBOUNDED: dict[str, dict[str, type[Monitor | EpisodeMonitor]]] = {
    "slow = always(x < 3); out = always(slow) and x > 0": {"slow": Monitor},
    "near = x > 0; up = eventually(near); out = always(up)": {"near": Monitor, "up": Monitor},
    "seen = eventually[0:0.2](x > 1); kept = always(seen) or x < 0; out = eventually(kept)": {
        "seen": Monitor,
        "kept": EpisodeMonitor,
    },
}


@pytest.mark.parametrize("text", UNBOUNDED)
@given(values=st.lists(st.sampled_from([-2.0, -0.0, 0.0, 1.0, 2.5, 7.0]), min_size=1, max_size=9))
def test_named_formulas_of_unbounded_requirements(text: str, values: list[float]) -> None:
    ros, node = started(text)
    spec = parse(text)
    alone = {
        name: kind(spec.formulas[name], period="100ms") for name, kind in UNBOUNDED[text].items()
    }
    whole = EpisodeMonitor(spec, period="100ms")
    said: dict[str, list[str]] = {name: [] for name in (*alone, "out")}
    for value in values:
        send(ros, "x", value)
        ros.tick()
        ros.time += 100 * MS
        said["out"].append(repr(whole.update(value)))
        for name, monitor in alone.items():
            said[name].append(repr(monitor.update(value)))
    for name, numbers in said.items():
        found = [repr(number) for number in ros.data(f"rtamt/{name}")]
        assert found == [number for number in numbers if number != "nan"], name
    node.stop()
    node.start()
    seen = {name: len(ros.data(f"rtamt/{name}")) for name in said}
    send(ros, "x", values[0])
    ros.tick()
    for name, before in seen.items():  # after a restart
        found = [repr(number) for number in ros.data(f"rtamt/{name}")[before:]]
        assert found == [number for number in said[name][:1] if number != "nan"]


def test_silent_topics_are_logged_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(rtamt_ros.node, "SEARCH_AFTER", 0.0)
    ros = MemoryMiddleware(known={"/robot0/odom", "/there"})
    topics_of = {"a": "", "b": "there", "c": "robot/odom", "d": "/lonely"}
    text = "".join(f"@ topic({name}, {topic})\n" for name, topic in topics_of.items() if topic)
    declared = "float64 a\nfloat64 b\nfloat64 c\nfloat64 d\n"
    declared += "input float64 limit = 1\n"  # has a default at once
    node = MonitorNode(ros, [f"{declared}{text}a + b + c + d > limit"])
    node.start()
    for _ in range(3):
        ros.tick()
    until(lambda: sum("nobody" in text for _, text in ros.lines) == 3)
    node.stop()
    assert [line for line in ros.lines if "nobody" in line[1]] == [
        (Level.WARN, "nobody publishes /rtamt/a"),
        (Level.WARN, "nobody publishes /robot/odom; did you mean '/robot0/odom'?"),
        (Level.WARN, "nobody publishes /lonely"),
    ]


@pytest.mark.parametrize(
    ("text", "topic", "types"),
    [
        ("float64 x; int64 y; x > y", "rtamt/y", "std_msgs/Float64 and std_msgs/Int64"),
        ("int64 x; out = x > 1", "rtamt/out", "std_msgs/Int64 and std_msgs/Float64"),
    ],
)
def test_remapped_topics_have_one_type(text: str, topic: str, types: str) -> None:
    ros = MemoryMiddleware(remapped={topic: "/rtamt/x"})
    node = MonitorNode(ros, [text])
    with pytest.raises(InputError) as refused:
        node.start()
    assert str(refused.value) == f"expected one type of messages on /rtamt/x, got {types}"
    assert not [*ros.subscriptions, *ros.publishers, *ros.timers]


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
"""Formulas, and the number of samples by which they are late."""
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
        if not number or looks or ros.time - last >= 4 * PERIOD:  # otherwise the look is late
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
    # x arrived last at 2, is held until 4 and stale at 5 and 6; later values are never known.
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
        "values change at different times; declare a message for each, or sample"
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
