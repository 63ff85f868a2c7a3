"""Samples of a node: the values held at start + n periods, judged like the samples of any trace."""

from __future__ import annotations

import math
from itertools import groupby, pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware, message

import rtamt
from rtamt import EpisodeMonitor, SemanticsName, evaluate
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
VALUES = st.sampled_from([-3.0, -0.5, -0.0, 0.0, 1.0, 2.5, 1e300])  # inf - inf is no number
# (milliseconds since the last one, the topic, the value); "tick" is the timer.
STEPS = st.lists(
    st.tuples(st.integers(0, 60), st.sampled_from(["x", "odom", "tick"]), VALUES), max_size=60
)


def send(ros: MemoryMiddleware, topic: str, value: float) -> None:
    """A message of x or of odom."""
    if topic == "x":
        ros.send("rtamt/x", message("std_msgs", "Float64", data=value))
    else:
        ros.send("rtamt/odom", message("nav_msgs", "Odometry", twist__twist__linear__x=value))


def nearest_sample(time: int, start: int) -> int:
    """The number of the sample that a tick is for."""
    return math.floor((time - start) / PERIOD + 0.5)


def check_bounds(ros: MemoryMiddleware, expected: list[tuple[float, float, int]]) -> None:
    """Bounds and verdicts are published whenever they are new."""
    for at, what in enumerate(("lower", "upper", "verdict")):
        found = [repr(value) for value in ros.data(f"rtamt/spec/{what}")]
        assert found == [value for value, _ in groupby(repr(each[at]) for each in expected)]


@given(steps=STEPS, text=st.sampled_from(list(FORMULAS)), late=st.integers(0, 3))
def test_a_node_says_of_its_samples_what_evaluate_says(
    steps: list[tuple[int, str, float]], text: str, late: int
) -> None:
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, [f"{TEXT}{text}"], Settings(stale=FOREVER))
    node.start()
    held: dict[str, float] = {}
    samples: list[tuple[float, float]] = []
    begin: int | None = None
    episode = EpisodeMonitor(rtamt.parse(f"{TEXT}{text}"), period="100ms")
    expected: list[tuple[float, float, int]] = []
    missed = 0
    for wait, what, value in [*steps, *[(100, "tick", 0.0)] * 3]:
        # A gap of the timer is another property.
        ros.time += wait * MS * (1 + (late if what == "tick" else 0) // 2)
        if what != "tick":
            send(ros, what, value)
            held[what] = value
            continue
        seen = len(ros.on("rtamt/spec"))
        last = -1 if begin is None else len(samples) - 1
        ros.tick()
        if len(held) < 2:
            assert not ros.on("rtamt/spec")
            assert not ros.on("rtamt/spec/lower")
            continue
        begin = ros.time if begin is None else begin
        due = nearest_sample(ros.time, begin)
        if ros.time - begin - last * PERIOD > 500 * MS and last >= 0:
            return  # a gap: the node begins anew
        for _ in range(last, due):
            samples.append((held["x"], held["odom"]))
            episode.update(*samples[-1])
        if due > last:
            expected.append((episode.lower, episode.upper, int(episode.verdict)))
            missed += due - last - 1
        assert len(ros.on("rtamt/spec")) == seen or due > last
    if not samples:
        return
    check_bounds(ros, expected)
    (report,) = node.reports
    assert (report.lower, report.upper, report.verdict) == expected[-1]
    assert report.missed == missed
    assert report.restarts == 0
    latency = FORMULAS[text]
    x, odom = np.array(samples).T
    trace = {"x": x, "odom.twist.twist.linear.x": odom}
    offline = evaluate(rtamt.parse(f"{TEXT}{text}"), trace, period=0.1)
    at = len(samples) - 1 - latency
    assert begin is not None
    assert report.time == begin + (len(samples) - 1) * PERIOD
    if at < 0:
        assert report.robustness is None
        assert not ros.on("rtamt/spec")
        return
    if text.startswith("always("):  # the least of all instants so far
        body = evaluate(rtamt.parse(f"{TEXT}{text[6:]}"), trace, period=0.1)
        offline = np.minimum.accumulate(body)
    assert report.robustness == offline[at] == ros.latched("rtamt/spec")
    assert report.about == report.time - latency * PERIOD
    assert report.worst == min(offline[: at + 1])
    assert report.worst_time is not None
    assert offline[(report.worst_time - begin) // PERIOD] == report.worst


@given(st.lists(st.integers(-49, 49), min_size=2, max_size=40))
def test_jitter_below_half_a_period_neither_drops_nor_adds_a_sample(jitter: list[int]) -> None:
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


def test_a_late_timer_feeds_the_held_values_for_the_periods_that_passed() -> None:
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, ["historically[0:0.2](x > 0)"], Settings())
    node.start()
    for time, value in [(0, 5.0), (100, 1.0), (400, 3.0), (500, 4.0)]:
        ros.time = START + time * MS
        send(ros, "x", value)
        ros.tick()
    assert ros.data("rtamt/spec") == [5.0, 1.0, 3.0, 3.0]
    assert node.reports[0].missed == 2
    assert node.reports[0].text == "satisfied, robustness 3; 2 samples late"


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
    assert report.restarted_because == "nothing was sampled for 0.6 s"


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
