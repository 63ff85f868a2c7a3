"""Clocks and stamps that jump: monitors restart, and messages out of order are omitted."""

from __future__ import annotations

import math
import threading

import pytest
from memory_middleware import SECOND, message
from memory_nodes import MS, send, started, until

from rtamt_ros.middleware import Level

START = 1000 * SECOND
ODOM = "from nav_msgs.msg import Odometry; input Odometry odom; "


def odometry(speed: float, stamp: int | None = None) -> object:
    """Return a message with a stamp."""
    return message("nav_msgs", "Odometry", stamp=stamp, twist__twist__linear__x=speed)


# The clock. --------------------------------------------------------------------------------------


def test_looped_bag_restarts_monitors() -> None:
    ros, node = started("historically(x > 0)")
    for loop in range(3):
        for n in range(5):
            ros.time = START + n * 100 * MS
            send(ros, "x", 10.0 * loop + 5 - n)
            ros.tick()
    found = ros.data("rtamt/spec")
    # The first look after each jump forgets earlier messages, and has a new one already.
    assert found == [5, 4, 3, 2, 1, 15, 14, 13, 12, 11, 25, 24, 23, 22, 21]
    assert node.reports[0].restarts == 2
    assert node.reports[0].restarted_because == "the clock went back by 0.4 s"


def test_jump_back_drops_later_messages() -> None:
    ros, node = started("historically(x > 0 and y > 0)", stale=math.inf)
    send(ros, "y", 7.0)
    ros.tick()
    ros.time = START + 5 * SECOND
    send(ros, "x", 1.0)
    ros.tick()
    assert ros.data("rtamt/spec") == [1.0]
    ros.tick(START + 2 * SECOND)
    assert node.reports[0].waiting == ("x",)
    assert math.isnan(ros.latched("rtamt/spec"))
    send(ros, "x", 3.0)
    ros.tick(START + 2 * SECOND + 100 * MS)
    assert ros.latched("rtamt/spec") == 3.0


def test_small_jump_back_changes_nothing() -> None:
    ros, node = started("historically(x > 0)")
    for time in (0, 100, 200, 130, 240, 300):
        ros.time = START + time * MS
        send(ros, "x", 10.0 - time / 100)
        ros.tick()
    assert ros.data("rtamt/spec") == [10.0, 9.0, 8.0, 7.0]
    assert node.reports[0].restarts == 0


def test_small_jumps_back_add_up() -> None:
    ros, node = started("historically(x > 0)")
    for time in (0, 100, 200, 130, 99, 200):
        ros.time = START + time * MS
        send(ros, "x", 10.0 - time / 100)
        ros.tick()
    found = ros.data("rtamt/spec")
    assert math.isnan(found.pop(3))  # the time to which the clock went back, followed by x
    assert found == [10.0, 9.0, 8.0, 9.01, 8.0]
    assert node.reports[0].restarted_because == "the clock went back by 0.1 s"


def test_no_robustness_before_a_simulated_clock_starts() -> None:
    ros, node = started("x > 0")
    ros.time = 0
    send(ros, "x", 1.0)
    ros.tick()
    assert node.reports[0].text == "waiting for the clock"
    assert node.reports[0].level == Level.WARN
    assert not ros.on("rtamt/spec")
    ros.tick(5000 * SECOND)  # a latched message arrived before
    assert ros.data("rtamt/spec") == [1.0]


@pytest.mark.parametrize("dense", [False, True])
def test_jump_back_with_stamps_counts_once(dense: bool) -> None:  # noqa: FBT001 - a parameter of the test
    text = f"{ODOM}input float64 x; out = odom.twist.twist.linear.x > x"
    ros, node = started(text, dense=dense, stamps=True)
    for begin in (START, START - 50 * SECOND, START - 100 * SECOND):
        for n in range(8):
            ros.time = begin + n * 100 * MS
            ros.send("rtamt/odom", odometry(1.0, ros.time))
            send(ros, "x", 0.0)
            ros.tick()
    (report,) = node.reports
    assert (report.restarts, report.out_of_order) == (2, 0)
    assert report.restarted_because == "the clock went back by 50.7 s"


# Stamps. -----------------------------------------------------------------------------------------


def test_messages_out_of_order_are_counted() -> None:
    ros, node = started(f"{ODOM}odom.twist.twist.linear.x > 0", stamps=True)
    for stamp, speed in [(0, 1.0), (100, 2.0), (60, 9.0), (100, 3.0), (99, 9.0)]:
        ros.send("rtamt/odom", odometry(speed, START + stamp * MS))
    ros.tick(START + 150 * MS)
    assert ros.data("rtamt/spec") == [3.0]
    assert node.reports[0].out_of_order == 2


def test_without_stamps_the_order_is_that_of_receipt() -> None:
    ros, node = started(f"{ODOM}odom.twist.twist.linear.x > 0")
    for stamp, speed in [(100, 2.0), (60, 9.0)]:
        ros.send("rtamt/odom", odometry(speed, START + stamp * MS))
    ros.tick()
    assert ros.data("rtamt/spec") == [9.0]
    assert node.reports[0].out_of_order == 0


def test_the_age_by_stamps_is_that_of_the_stamp() -> None:
    ros, node = started(f"{ODOM}odom.twist.twist.linear.x > 0", stamps=True)
    ros.send("rtamt/odom", odometry(1.0, START - 700 * MS))
    ros.tick()
    assert node.reports[0].text == "odom stale 0.7 s"
    ros.time += 100 * MS
    ros.send("rtamt/odom", odometry(1.0))  # a stamp of zero: the time of arrival counts
    ros.tick()
    assert node.reports[0].stale == ()


def test_fast_publisher_clock_becomes_stale() -> None:
    ros, node = started(f"{ODOM}odom.twist.twist.linear.x > 0", stamps=True)
    ros.send("rtamt/odom", odometry(1.0, START + 3600 * SECOND))
    ros.tick()
    assert node.reports[0].robustness == 1.0
    ros.tick(START + 300 * MS)
    ros.tick(START + 600 * MS)
    assert node.reports[0].text == (
        "odom stale 0.6 s; stamps of odom are 3600 s ahead of the clock; 4 samples late"
    )
    assert math.isnan(ros.latched("rtamt/spec"))


def test_stamps_that_went_back_for_good_begin_anew() -> None:
    text = "historically(odom.twist.twist.linear.x > 0)"
    ros, node = started(ODOM + text, stamps=True, stale=math.inf)
    for stamp, speed in [(0, 2.0), (100, 1.0), (-9000, 5.0), (-8900, 6.0)]:
        ros.time += 100 * MS
        ros.send("rtamt/odom", odometry(speed, START + stamp * MS))
        ros.tick()
    # The first message after the jump waits for the second.
    assert ros.data("rtamt/spec") == [2.0, 1.0, 1.0, 6.0]
    assert node.reports[0].out_of_order == 0
    assert node.reports[0].restarted_because == "the stamps of odom went back by 9.1 s"


# A clock that stands still. ----------------------------------------------------------------------


@pytest.mark.parametrize("dense", [False, True])
def test_standing_clock_clears_verdict(monkeypatch: pytest.MonkeyPatch, *, dense: bool) -> None:
    monkeypatch.setattr("rtamt_ros.node.CLOCK_PERIOD", 0.02)
    ros, node = started("historically(x > 0)", dense=dense)
    ros.simulated = True
    send(ros, "x", 3.0)
    ros.tick(START + 100 * MS)
    until(lambda: math.isnan(ros.latched("rtamt/spec")))
    until(lambda: node.reports[0].level is Level.STALE)
    assert node.reports[0].text == "the clock stands still"
    assert math.isnan(ros.latched("rtamt/spec/upper"))
    assert ros.latched("rtamt/spec/verdict") == 0
    node.stop()
    kept = len(ros.published)
    threading.Event().wait(0.1)
    assert len(ros.published) == kept


def test_a_monitor_goes_on_with_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rtamt_ros.node.CLOCK_PERIOD", 0.2)
    ros, node = started("historically(x > 0)")
    ros.simulated = True
    send(ros, "x", 3.0)
    ros.tick()
    until(lambda: math.isnan(ros.latched("rtamt/spec")))
    known = len(ros.published)
    ros.time = START + 100 * MS
    send(ros, "x", 5.0)
    ros.tick()
    assert [each.data for at, each in ros.published[known:] if at == "rtamt/spec"][:1] == [3.0]
    assert node.reports[0].restarts == 0
    node.stop()


def test_the_wall_clock_may_stand_for_a_look(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rtamt_ros.node.CLOCK_PERIOD", 0.01)
    ros, _ = started("historically(x > 0)")
    send(ros, "x", 3.0)
    ros.tick()
    threading.Event().wait(0.1)
    assert ros.latched("rtamt/spec") == 3.0
