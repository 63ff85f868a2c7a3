"""Lost and late messages are counted, and a suspension is not a fault of an input."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware, message
from memory_nodes import MS, started

from rtamt_ros.core.inputs import LossCount
from rtamt_ros.middleware import Reception, TopicPublisher
from rtamt_ros.node import MonitorNode

START = 1000 * SECOND


def number(value: float) -> Any:  # noqa: ANN401 - the classes of ROS have no types
    """Return a message with a number."""
    return message("std_msgs", "Float64", data=value)


@given(st.lists(st.tuples(st.integers(1, 30), st.integers(1, 3)), max_size=25))
def test_losses_are_the_gaps_of_one_publisher(steps: list[tuple[int, int]]) -> None:
    """Each step is a number and the count of publishers at that time."""
    count = LossCount()
    for name, publishers in steps:
        count.follow(publishers)
        count.take(name)
    alone = [name if publishers == 1 else None for name, publishers in steps]
    gaps = [b - a - 1 for a, b in pairwise(alone) if a is not None and b is not None and b > a]
    assert count.lost == sum(gaps)
    assert bool(count.unknown) == (bool(steps) and steps[-1][1] > 1)


def test_losses_reported_by_ros_are_counted_once() -> None:
    count = LossCount()
    for name in (1, 4, 9):
        count.take(name)
    count.reported = 6
    assert count.lost == 6  # the same messages
    count.reported = 8  # and two after the last
    assert count.lost == 8


@pytest.mark.parametrize("dense", [False, True])
def test_lost_messages_are_in_text_and_diagnostics(*, dense: bool) -> None:
    ros, node = started("x > 0", dense=dense)
    for name in (5, 6, 7, 20, 21):
        ros.time += 100 * MS
        ros.send("rtamt/x", number(1.0), Reception(number=name))
        ros.tick()
    assert node.reports[0].lost == 12
    assert "lost messages: x: 12" in node.reports[0].text
    ros.publishing = {"rtamt/x": [TopicPublisher(name, keeps=False) for name in ("/a", "/b")]}
    for name in (1, 50, 2, 60):
        ros.time += 300 * MS
        ros.send("rtamt/x", number(1.0), Reception(number=name))
        ros.tick()
    ros.time += SECOND // 10
    ros.tick()
    assert node.reports[0].losses == ("x: 12 and loss unknown: 2 publishers",)
    node.replace(["x > 0"])
    ros.time += 100 * MS
    ros.tick()
    assert node.reports[0].lost == 12  # the subscription is the same


def resumed(**settings: Any) -> tuple[MemoryMiddleware, MonitorNode]:  # noqa: ANN401
    """Return a node after a suspension of 3.3 s with 33 messages, of which 20 were lost."""
    ros, node = started("out = historically(x > 0)", **settings)
    for name in range(5):
        ros.time += 100 * MS
        ros.send("rtamt/x", number(1.0), Reception(ros.time, name + 1))
        ros.tick()
    for name in range(33):
        ros.time += 100 * MS
        if name >= 20:
            ros.wait("rtamt/x", number(-1.0 if name == 25 else 2.0), name + 6)
    ros.tick()
    return ros, node


def test_a_suspension_is_the_reason_of_a_restart() -> None:
    ros, node = resumed()
    (report,) = node.reports
    reason = "nothing was evaluated for 3.3 s; 13 messages of x came at once, 20 were lost"
    assert report.restarted_because == reason
    assert (report.robustness, report.violations) == (2.0, 0)  # the suspension is not judged
    assert "stale" not in report.text
    for _ in range(10):  # no more messages arrive
        ros.time += 100 * MS
        ros.tick()
    assert node.reports[0].text.startswith("x stale 1.0 s")


@pytest.mark.parametrize("dense", [False, True])
def test_a_suspension_waits_for_messages(*, dense: bool) -> None:
    ros, node = started("out = historically(x > 0)", dense=dense)
    ros.send("rtamt/x", number(1.0), Reception(ros.time, 1))
    ros.tick()
    ros.tick(START + 3300 * MS)  # the messages have not been read yet
    assert node.reports[0].text.startswith("nothing was evaluated for 3.3 s")
    assert math.isnan(ros.latched("rtamt/out"))
    ros.time += 50 * MS
    ros.send("rtamt/x", number(2.0), Reception(ros.time, 34))
    ros.time += 50 * MS
    ros.tick()
    (report,) = node.reports
    assert report.restarted_because == (
        "nothing was evaluated for 3.3 s; 1 message of x came at once, 32 were lost"
    )


def test_queues_are_read_before_a_sample() -> None:
    ros, node = started("x > 0")
    for name in range(1, 20):
        ros.time = START + name * 100 * MS - 30 * MS
        ros.wait("rtamt/x", number(float(name)), name)
        ros.tick(START + name * 100 * MS)
    assert ros.data("rtamt/spec") == [float(name) for name in range(1, 20)]
    assert node.reports[0].late_arrivals == 0


def test_late_arrivals_are_counted_and_dated_by_reception() -> None:
    ros, node = started("x > 0")
    ros.tick(START + 100 * MS)
    ros.send("rtamt/x", number(1.0), Reception(START + 90 * MS, 1))  # after the sample of 100 ms
    ros.send("rtamt/x", number(2.0), Reception(START + 130 * MS, 2))
    ros.tick(START + 200 * MS)
    assert ros.data("rtamt/spec") == [2.0]
    assert node.reports[0].late_arrivals == 1
    assert "1 message taken late" in node.reports[0].text


def test_late_stamps_are_counted_without_times_of_reception() -> None:
    for stamps, late in ((True, 1), (False, 0)):
        text = "from nav_msgs.msg import Odometry; input Odometry o; o.twist.twist.linear.x > -1"
        ros, node = started(text, stamps=stamps)
        ros.send("rtamt/o", message("nav_msgs", "Odometry", stamp=START))
        ros.tick(START + 100 * MS)
        ros.send("rtamt/o", message("nav_msgs", "Odometry", stamp=START + 90 * MS))
        ros.tick(START + 200 * MS)
        assert node.reports[0].late_arrivals == late
