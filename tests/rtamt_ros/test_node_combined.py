"""Optionally one message for each sample with all requirements."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import MS, send, started

from rtamt import EpisodeMonitor, InputError, Monitor, evaluate, holds, judge, parse
from rtamt_ros.node import MonitorNode, Settings

START = 1000 * SECOND
PERIOD = 100 * MS
TOPIC = "monitor/all"
VALUES = st.sampled_from([-2.0, -0.0, 0.0, 1.0 / 3, 3.0])
AHEAD = "y > 0 until[0:0.2] x > 1"
TEXTS = [
    "always(x > 0)",
    "eventually[0:0.2](y > 1)",
    "always(x > 0 implies eventually[0:0.2](y > 0))",
    f"always(once[0:0.2](x > 1) implies y > 0) and always(({AHEAD}) implies x > 0)",
    "always[0:0.5](x > 0 implies y > 0)",
    "always(not (x > 0 implies y > 0))",
    "always(x > 0 implies y > 0) and eventually(y > 0 implies x > 0)",
]


def rows(message: Any) -> dict[str, dict[str, str]]:  # noqa: ANN401 - the classes of ROS have no types
    """Return the values of each requirement in a message."""
    return {row.name: {value.key: value.value for value in row.values} for row in message.status}


@given(
    texts=st.lists(st.sampled_from(TEXTS), min_size=1, max_size=3, unique=True),
    steps=st.lists(st.tuples(VALUES, VALUES, st.booleans()), min_size=1, max_size=15),
)
def test_combined_message_equals_monitors(
    texts: list[str], steps: list[tuple[float, float, bool]]
) -> None:
    named = [f"r{at} = {text}" for at, text in enumerate(texts)]
    ros, _ = started(*named, stale=math.inf, combined=TOPIC)
    last = START
    for number, (x, y, looks) in enumerate(steps):
        ros.time = START + number * PERIOD
        send(ros, "x", x)
        send(ros, "y", y)
        if not number or looks or ros.time - last >= 4 * PERIOD:  # otherwise the look is late
            ros.tick()
            last = ros.time
    ros.tick()
    messages = ros.on(TOPIC)
    assert [message.header.stamp.ns for message in messages] == [
        START + number * PERIOD for number in range(len(steps))
    ]
    for at, text in enumerate(texts):
        spec = parse(f"float64 x\nfloat64 y\n{text}")
        episode = EpisodeMonitor(spec, period="100ms")
        try:
            monitor: Monitor | EpisodeMonitor = Monitor(spec, period="100ms")
        except Exception:  # noqa: BLE001 - an unbounded future inside
            monitor = episode
        for number, (x, y, _) in enumerate(steps):
            values = {"x": x, "y": y}
            taken = {name: values[name] for name in episode.variables}
            robustness = episode.update(**taken)
            if monitor is not episode:
                robustness = monitor.update(**taken)
            its = rows(messages[number])[f"r{at}"]
            lower, upper = episode.bounds()
            assert its["verdict"] == episode.verdict.name
            assert [its["lower"], its["upper"]] == [repr(lower), repr(upper)]
            if math.isnan(robustness):
                assert (its["robustness"], its["at"]) == ("", "")
                continue
            assert float(its["robustness"]).hex() == robustness.hex()
            late = monitor.latency if isinstance(monitor, Monitor) else 0
            about = START + (number - late) * PERIOD
            assert its["at"] == f"{about // SECOND}.{about % SECOND:09d}"


@given(
    text=st.sampled_from(TEXTS), steps=st.lists(st.tuples(VALUES, VALUES), min_size=1, max_size=15)
)
def test_combined_trigger_counts_equal_judge(text: str, steps: list[tuple[float, float]]) -> None:
    ros, _ = started(f"r = {text}", stale=math.inf, combined=TOPIC)
    asks = TEXTS.index(text) in (2, 3)
    for number, (x, y) in enumerate(steps):
        ros.time = START + number * PERIOD
        send(ros, "x", x)
        send(ros, "y", y)
        ros.tick()
        said = rows(ros.on(TOPIC)[-1])["r"]["asked"]
        if not asks:
            assert not said
            continue
        so_far = {name: [step[at] for step in steps[: number + 1]] for at, name in enumerate("xy")}
        spec = parse(f"float64 x\nfloat64 y\n{text}")
        trace = {name: so_far[name] for name in spec.variables}
        counts = [
            trigger.samples for trigger in judge(spec, trace, period=0.1, end="open").triggers
        ]
        if TEXTS.index(text) == 3:  # the second left side reads 0.2 s ahead
            lefts = evaluate(f"float64 x\nfloat64 y\n{AHEAD}", so_far, period=0.1)
            counts[1] = int(holds(lefts)[: max(0, number - 1)].sum())
        assert said == " ".join(map(str, counts))


def test_combined_text_equals_diagnostics() -> None:
    ros, _ = started("bounded = always(x < 3)", "other = always(y > 0)", combined=TOPIC)
    for number in range(3):
        ros.time = START + number * PERIOD
        send(ros, "x", 1.0 + number)
        ros.tick()
    (first, *_, last) = ros.on(TOPIC)
    bounded, other = last.status
    assert (bounded.name, bounded.level, other.name, other.level) == ("bounded", 2, "other", 1)
    assert bounded.message.startswith("violated, robustness -0; violated 1 time")
    assert other.message == "waiting for y"
    assert set(rows(first)["other"].values()) == {""}


def test_combined_message_of_stale_and_reset() -> None:
    ros, _ = started("bounded = always(x < 3)", combined=TOPIC)
    send(ros, "x", 4.0)
    ros.tick()
    ros.call("reset")
    reset = ros.on(TOPIC)[-1]
    assert reset.header.stamp.ns == START
    assert reset.status[0].message.startswith("new run; was: violated, robustness -1")
    assert rows(reset)["bounded"] | {"asked": ""} == {
        "robustness": "nan",
        "at": "",
        "lower": "nan",
        "upper": "nan",
        "verdict": "UNDECIDED",
        "asked": "",
    }
    ros.tick(START + 10 * PERIOD)
    assert rows(ros.on(TOPIC)[-1])["bounded"]["robustness"] == "nan"


def test_unknown_values_stop_trigger_counts() -> None:
    text = "asked = always(x > 0 implies y > 0)"
    ros, _ = started(text, combined=TOPIC, stale=0.25, stale_as="unknown")
    said = []
    for number in range(8):
        ros.time = START + number * PERIOD
        if number < 2 or number == 7:
            send(ros, "x", 1.0)
        send(ros, "y", 1.0)
        ros.tick()
        said.append(rows(ros.on(TOPIC)[-1])["asked"]["asked"])
    assert said == ["1", "2", "3", "4", "", "", "", ""]


def test_no_combined_topic_by_default() -> None:
    ros, _ = started("bounded = always(x < 3)")
    assert {publisher.topic for publisher in ros.publishers} == {
        "/diagnostics",
        *(f"rtamt/bounded{part}" for part in ("", "/lower", "/upper", "/verdict", "/state")),
    }
    assert not ros.on(TOPIC)


def test_combined_errors() -> None:
    with pytest.raises(InputError) as caught:
        Settings(dense=True, combined=TOPIC)
    assert str(caught.value) == (
        "combined= cannot be set in dense time, where requirements are known up to different times"
    )
    for topic in ("rtamt/bounded", "rtamt/x"):
        node = MonitorNode(
            MemoryMiddleware(), ["bounded = always(x < 3)"], Settings(combined=topic)
        )
        with pytest.raises(InputError, match="expected one type of messages on /rtamt/"):
            node.start()
    node = MonitorNode(MemoryMiddleware(), ["x > 0"], Settings(combined="/diagnostics"))
    with pytest.raises(
        InputError, match=r"^combined: /diagnostics has the states of all nodes; write"
    ):
        node.start()
    with pytest.raises(InputError, match=r"^diagnostic_msgs is not installed"):
        MonitorNode(
            MemoryMiddleware(missing={"diagnostic_msgs"}), ["x > 0"], Settings(combined=TOPIC)
        )
