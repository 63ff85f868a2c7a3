"""Samples of a node: the messages by start + n periods, judged like the samples of any trace."""

from __future__ import annotations

import math
import tracemalloc
from itertools import groupby, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware, message

import rtamt
from rtamt import EpisodeMonitor, evaluate
from rtamt.typing import SemanticsName
from rtamt_ros.node import MonitorNode, Settings

MS = 1_000_000
PERIOD = 100 * MS
START = 1000 * SECOND
FOREVER = math.inf

FORMULAS = {
    "x - odom.twist.twist.linear.x > 0": 0,
    "always[0:0.3](x > odom.twist.twist.linear.x)": 3,
    "once[0:0.2](x > 1) and eventually[0.1:0.2](odom.twist.twist.linear.x < x)": 2,
    "always(x > -2 or historically[0:0.1](odom.twist.twist.linear.x > 0))": 0,
}
TEXT = """
from nav_msgs.msg import Odometry
input float64 x
input Odometry odom
"""
STAMPED = """
from rtamt_msgs.msg import FloatMessage
output FloatMessage out
float64 x
"""
VALUES = st.sampled_from([-3.0, -0.5, -0.0, 0.0, 1.0, 2.5, 1e300])  # inf - inf is not a number
# (milliseconds since the last one, the topic, the value); "tick" is the timer.
STEPS = st.lists(
    st.tuples(st.integers(0, 60), st.sampled_from(["x", "odom", "tick"]), VALUES), max_size=60
)


def send(ros: MemoryMiddleware, topic: str, value: float) -> None:
    """Publish a message of x or of odom."""
    if topic == "x":
        ros.send("rtamt/x", message("std_msgs", "Float64", data=value))
    else:
        ros.send("rtamt/odom", message("nav_msgs", "Odometry", twist__twist__linear__x=value))


def held_at(time: int, came: list[tuple[int, float]]) -> float | None:
    """Return the last value that arrived by a time."""
    return next((value for at, value in reversed(came) if at <= time), None)


def check_bounds(ros: MemoryMiddleware, expected: list[tuple[float, float, int]]) -> None:
    """Check that bounds and verdicts are published at every change."""
    for at, what in enumerate(("lower", "upper", "verdict")):
        found = [repr(value) for value in ros.data(f"rtamt/spec/{what}")]
        assert found == [value for value, _ in groupby(repr(each[at]) for each in expected)]


@given(steps=STEPS, text=st.sampled_from(list(FORMULAS)), late=st.integers(0, 3))
def test_samples_equal_evaluate(steps: list[tuple[int, str, float]], text: str, late: int) -> None:
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, [f"{TEXT}{text}"], Settings(stale=FOREVER))
    node.start()
    came: dict[str, list[tuple[int, float]]] = {"x": [], "odom": []}
    samples: list[tuple[float, float]] = []
    begin: int | None = None
    before: int | None = None
    episode = EpisodeMonitor(rtamt.parse(f"{TEXT}{text}"), period="100ms")
    expected: list[tuple[float, float, int]] = []
    missed = 0
    for wait, what, value in [*steps, *[(100, "tick", 0.0)] * 3]:
        # A gap of the timer is another property.
        ros.time += wait * MS * (1 + (late if what == "tick" else 0) // 2)
        if what != "tick":
            send(ros, what, value)
            came[what].append((ros.time, value))
            continue
        due = START + (ros.time - START) // PERIOD * PERIOD
        if before is not None and due - before > 500 * MS:
            return  # a gap: the node restarts
        ros.tick()
        for point in range(due if before is None else before + PERIOD, due + 1, PERIOD):
            x, odom = held_at(point, came["x"]), held_at(point, came["odom"])
            if x is None or odom is None:
                continue
            begin = point if begin is None else begin
            samples.append((x, odom))
            episode.update(x, odom)
            expected.append((episode.lower, episode.upper, int(episode.verdict)))
            missed += point < due
        before = due
        assert len(ros.on("rtamt/spec")) == max(0, len(samples) - FORMULAS[text])
    if not samples:
        assert not ros.on("rtamt/spec/lower")
        return
    check_bounds(ros, expected)
    (report,) = node.reports
    assert (report.lower, report.upper, report.verdict) == expected[-1]
    assert report.missed == missed
    assert report.restarts == 0
    latency = FORMULAS[text]
    x_, odom_ = np.array(samples).T
    trace = {"x": x_, "odom.twist.twist.linear.x": odom_}
    offline = evaluate(rtamt.parse(f"{TEXT}{text}"), trace, period=0.1)
    at = len(samples) - 1 - latency
    assert begin is not None
    assert report.time == begin + (len(samples) - 1) * PERIOD
    if at < 0:
        assert report.robustness is None
        return
    if text.startswith("always("):  # the minimum of all instants so far
        body = evaluate(rtamt.parse(f"{TEXT}{text[6:]}"), trace, period=0.1)
        offline = np.minimum.accumulate(body)
    assert ros.data("rtamt/spec") == offline[: at + 1].tolist()
    assert report.robustness == offline[at]
    assert report.about == report.time - latency * PERIOD
    assert report.worst == min(offline[: at + 1])
    assert report.worst_time is not None
    assert offline[(report.worst_time - begin) // PERIOD] == report.worst


@given(
    phase=st.integers(0, 99),
    waits=st.lists(st.tuples(st.integers(0, 130), st.integers(0, 130)), min_size=1, max_size=60),
)
def test_samples_hold_the_newest_value(phase: int, waits: list[tuple[int, int]]) -> None:
    """A value is its time of publication, in milliseconds since the start."""
    ros, published = MemoryMiddleware(time=START), []
    node = MonitorNode(ros, [f"{STAMPED}out.value = x >= 0"], Settings(stale=FOREVER))
    node.start()
    ros.time += phase * MS
    sent: list[int] = []
    for message_after, look_after in waits:
        ros.time += message_after * MS
        sent.append((ros.time - START) // MS)
        ros.send("rtamt/x", message("std_msgs", "Float64", data=float(sent[-1])))
        ros.time += look_after * MS
        ros.tick()
        found = [each for each in ros.on("rtamt/out") if each not in published]
        published += found
        for each in found:
            stamp = (each.header.stamp.ns - START) // MS
            assert each.header.stamp.ns <= ros.time
            assert each.value == max(time for time in sent if time <= stamp)
    stamps = [each.header.stamp.ns for each in published]
    assert {(after - before) % PERIOD for before, after in pairwise(stamps)} <= {0}
    assert stamps == sorted(set(stamps))


@given(st.lists(st.integers(0, 99), min_size=2, max_size=40))
def test_late_timer_keeps_samples(
    jitter: list[int],
) -> None:
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, ["x > 0"], Settings(stale=FOREVER))
    node.start()
    send(ros, "x", 1.0)
    ros.tick(START)
    for n, off in enumerate(jitter, 1):
        ros.tick(START + n * PERIOD + off * MS)
        assert node.reports[0].time == START + n * PERIOD
    assert len(ros.data("rtamt/spec")) == len(jitter) + 1
    assert node.reports[0].missed == 0


def test_late_timer_samples_every_period() -> None:
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, ["historically[0:0.2](x > 0)"], Settings())
    node.start()
    for time, value in [(0, 5.0), (100, 4.0), (190, 3.0), (210, 1.0), (350, 2.0)]:
        ros.time = START + time * MS
        send(ros, "x", value)
        if time <= 100:
            ros.tick()
    ros.tick(START + 430 * MS)
    assert ros.data("rtamt/spec") == [5.0, 4.0, 3.0, 1.0, 1.0]
    assert (node.reports[0].missed, node.reports[0].time) == (2, START + 400 * MS)
    assert node.reports[0].text == "satisfied, robustness 1; 2 samples late"


def test_stale_in_late_samples_only() -> None:
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, [f"{STAMPED}out.value = x > 0"], Settings(stale=0.25))
    node.start()
    send(ros, "x", 1.0)
    ros.tick()
    ros.time = START + 390 * MS
    send(ros, "x", 2.0)
    ros.tick(START + 410 * MS)
    found = [(each.header.stamp.ns - START, each.value) for each in ros.on("rtamt/out")]
    assert [str(value) for _, value in found] == ["1.0", "1.0", "1.0", "nan", "2.0"]
    assert [time for time, _ in found] == [n * PERIOD for n in range(5)]
    assert (node.reports[0].missed, node.reports[0].restarts) == (2, 1)


PASSED = ("rtamt_ros/*", "rtamt/*", "tests/rtamt_ros/*", "tests/support/memory_*")
"""The functions that create and store the messages of a node."""


@pytest.mark.parametrize("looks", [True, False])
def test_what_waits_for_a_look_is_bounded(looks: bool) -> None:  # noqa: FBT001 - a parameter of the test
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, ["x > 0"], Settings())
    node.start()
    if looks:
        ros.tick()
    tracemalloc.start()
    sizes = []
    for k in range(3):
        for _ in range(2000):
            ros.time += 5 * MS
            send(ros, "x", float(k))
        # Other threads allocate too, so count only where messages are created and stored.
        filters = [tracemalloc.Filter(True, f"*/{name}") for name in PASSED]  # noqa: FBT003
        kept = tracemalloc.take_snapshot().filter_traces(filters)
        sizes.append(sum(trace.size for trace in kept.traces))
    tracemalloc.stop()
    assert sizes[2] - sizes[0] < 1000
    ros.tick()
    assert ros.data("rtamt/spec") == [2.0]


def test_a_gap_of_the_timer_begins_anew() -> None:
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, ["historically(x > 0)"], Settings(stale=FOREVER))
    node.start()
    for time, value in [(0, 1.0), (100, 5.0), (700, 4.0), (800, 9.0)]:
        ros.time = START + time * MS
        send(ros, "x", value)
        ros.tick()
    assert ros.data("rtamt/spec") == [1.0, 1.0, 4.0, 4.0]
    (report,) = node.reports
    assert (report.restarts, report.missed) == (1, 0)
    assert report.restarted_because == (
        "nothing was evaluated for 0.6 s; 2 messages of x came at once, loss unknown"
    )


def test_times_of_samples_increase_by_one_period() -> None:
    ros = MemoryMiddleware(time=START)
    text = """
    from rtamt_msgs.msg import FloatMessage
    output FloatMessage out
    out.value = x > 0
    float64 x
    """
    node = MonitorNode(ros, [text], Settings(stale=FOREVER))
    node.start()
    send(ros, "x", 1.0)
    for n in range(20):
        ros.tick(START + n * PERIOD + (n * 37 % 40) * MS)
    stamps = [each.header.stamp.ns for each in ros.on("rtamt/out")]
    assert {b - a for a, b in pairwise(stamps)} == {PERIOD}
    assert stamps[0] == START


@pytest.mark.parametrize("semantics", ["standard", "boolean", "output-robustness"])
def test_semantics_are_those_of_the_monitors(semantics: SemanticsName) -> None:
    text = "input float64 x; output float64 y; x > 1 and y > 0"
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, [text], Settings(semantics=semantics))
    node.start()
    send(ros, "x", 4.0)
    ros.send("rtamt/y", message("std_msgs", "Float64", data=0.5))
    ros.tick()
    trace = {"x": [4.0], "y": [0.5]}
    assert ros.data("rtamt/spec") == evaluate(text, trace, semantics=semantics).tolist()
