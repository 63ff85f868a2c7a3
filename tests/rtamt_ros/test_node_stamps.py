"""Stamps ahead of the clock count with a warning; stamps out of line wait for the next message."""

from __future__ import annotations

import math

import pytest
from memory_middleware import SECOND, MemoryMiddleware, message
from memory_nodes import MS, started

from rtamt_ros.middleware import Level
from rtamt_ros.node import MonitorNode

START = 1000 * SECOND
TEXT = (
    "from nav_msgs.msg import Odometry; input Odometry p; out = always(p.twist.twist.linear.x > 0)"
)


def fed(
    offsets: list[float], values: list[float] | None = None, *, dense: bool = False
) -> tuple[MemoryMiddleware, MonitorNode]:
    """Return a node after one message per 0.1 s, with stamps at these offsets in seconds."""
    ros, node = started(TEXT, stamps=True, stale=math.inf, dense=dense)
    for n, offset in enumerate(offsets):
        ros.time = START + n * 100 * MS
        speed = values[n] if values else 1.0
        stamp = ros.time + round(offset * SECOND)
        odometry = message("nav_msgs", "Odometry", stamp=stamp, twist__twist__linear__x=speed)
        ros.send("rtamt/p", odometry)
        ros.tick()
    return ros, node


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize(("offset", "ahead"), [(0.1, 0), (0.101, 3), (5.0, 3)])
def test_stamps_ahead_count_with_a_warning(offset: float, ahead: int, *, dense: bool) -> None:
    _, node = fed([offset] * 3, dense=dense)
    (report,) = node.reports
    assert report.ahead == ahead
    assert report.level is (Level.WARN if ahead else Level.OK)
    words = f"stamps of p are {round(offset, 1):g} s ahead of the clock"
    assert (words in report.text) == bool(ahead)


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("offset", [-2.0, 1.001, 5.0, 3600.0])
def test_a_stray_decides_nothing(offset: float, *, dense: bool) -> None:
    _, node = fed([0, 0, offset, 0, 0], [1, 1, -1, 1, 1], dense=dense)
    (report,) = node.reports
    assert (report.strays, report.restarts, report.violations) == (1, 0, 0)
    assert report.robustness == 1.0
    assert "1 message out of line left out" in report.text


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize(
    ("offset", "words"), [(5.0, "jumped ahead by 5.0 s"), (-5.0, "went back by 4.8 s")]
)
def test_a_jump_starts_the_run_again(offset: float, words: str, *, dense: bool) -> None:
    ros, node = fed([0, 0, offset, offset, offset], dense=dense)
    (report,) = node.reports
    if words.startswith("went") and not dense:
        words = "went back by 4.9 s"  # the newest stamp is the one before the jump
    assert (report.strays, report.restarts) == (0, 1)
    assert f"the stamps of p {words.replace('4.8', '4.9')}" == report.restarted_because
    assert any("restarted 1 time because the stamps of p" in line for _, line in ros.lines)


def test_a_restart_is_a_log_line_while_the_level_is_ok() -> None:
    ros, node = fed([0, 0, -5, -5, -5])
    assert node.reports[0].level is Level.OK
    assert [level for level, line in ros.lines if "restarted 1 time" in line] == [Level.OK]


@pytest.mark.parametrize("dense", [False, True])
def test_three_different_offsets_leave_one_held(*, dense: bool) -> None:
    _, node = fed([0, 0, 5, 10, 0], [1, 1, -1, -1, 1], dense=dense)
    assert (node.reports[0].strays, node.reports[0].violations) == (2, 0)


def test_a_silence_and_a_late_delivery_are_in_line() -> None:
    ros, node = fed([0, 0, -0.9, 0])
    assert (node.reports[0].strays, node.reports[0].out_of_order) == (0, 1)
    ros.time += 60 * SECOND
    ros.send("rtamt/p", message("nav_msgs", "Odometry", stamp=ros.time - 30 * SECOND))
    assert node.reports[0].strays == 0
    ros.tick()
    assert node.reports[0].robustness == 0.0  # from the new message


def test_replacement_keeps_the_order_of_stamps() -> None:
    ros, node = fed([0, 0, 0])
    node.replace([TEXT])
    odometry = message("nav_msgs", "Odometry", stamp=ros.time + 3600 * SECOND)
    ros.send("rtamt/p", odometry)
    ros.tick(ros.time + 100 * MS)
    assert node.reports[0].robustness == 1.0
