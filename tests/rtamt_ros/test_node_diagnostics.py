"""The diagnostics and the log of a node."""

from __future__ import annotations

import pytest
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import MS, send, started, until

import rtamt_ros.node
from rtamt_ros.middleware import Level
from rtamt_ros.node import MonitorNode

OTHER = "other = always[0:0.2](y > z)"


@pytest.mark.parametrize("generation", [1, 2])
def test_diagnostics_rate_and_content(generation: int) -> None:
    ros = MemoryMiddleware(generation=generation, name="/ns/monitor")
    node = MonitorNode(ros, ["bounded = always(x < 3)", OTHER])
    node.start()
    for n in range(30):
        send(ros, "x", 1.0 if n < 15 else 4.0)
        ros.tick()
        ros.time += 100 * MS
    found = ros.on("/diagnostics")
    begin = 1000 * SECOND
    assert [(each.header.stamp.ns - begin) // MS for each in found] == [0, 1000, 1500, 2500]
    first, second = found[-1].status
    assert (first.level, second.level) == ((2, 1) if generation == 1 else (b"\x02", b"\x01"))
    assert (first.name, second.name) == ("ns/monitor: bounded", "ns/monitor: other")
    at = "1001.500 s"
    assert first.message == (f"violated, robustness -1; violated 1 time since start, first at {at}")
    assert second.message == "waiting for y, z"
    assert {value.key: value.value for value in first.values} == {
        "formula": "always(x < 3)",
        "robustness": "-1",
        "at": "1002.500 s",
        "lower": "-inf",
        "upper": "-1",
        "verdict": "VIOLATED",
        "worst robustness": "-1",
        "worst at": at,
        "violations": "1",
        "first violation at": at,
        "waiting for": "",
        "defaults": "",
        "stale inputs": "",
        "late samples": "0",
        "messages out of order": "0",
        "late arrivals": "0",
        "lost messages": "x: loss unknown: the messages have no numbers",
        "messages out of line": "0",
        "messages ahead of the clock": "0",
        "unreadable messages": "0",
        "restarts": "0",
        "resets": "0",
        "last reset at": "",
    }
    assert ros.lines[:5] == [
        (Level.OK, "subscribes to /rtamt/x (std_msgs/Float64) as x"),
        (Level.OK, "subscribes to /rtamt/y (std_msgs/Float64) as y"),
        (Level.OK, "subscribes to /rtamt/z (std_msgs/Float64) as z"),
        (Level.OK, "publishes /rtamt/bounded (std_msgs/Float64)"),
        (Level.OK, "publishes /rtamt/other (std_msgs/Float64)"),
    ]
    assert [level for level, _ in ros.lines[5:]] == [Level.OK, Level.WARN, Level.ERROR]
    assert ros.lines[6][1] == "other: waiting for y, z"


def test_missing_diagnostic_msgs() -> None:
    ros = MemoryMiddleware(missing={"diagnostic_msgs"})
    node = MonitorNode(ros, ["x > 0"])
    node.start()
    send(ros, "x", 1.0)
    ros.tick()
    assert ros.data("rtamt/spec") == [1.0]
    assert ros.lines[0] == (
        Level.WARN,
        "there is no /diagnostics: diagnostic_msgs is not installed",
    )
    node.stop()
    assert not ros.publishers


GONE = Level.WARN, "no master answers"
BACK = Level.OK, "registered again"


@pytest.fixture
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nodes look at once, and repeatedly."""
    monkeypatch.setattr(rtamt_ros.node, "SEARCH_AFTER", 0.0)
    monkeypatch.setattr(rtamt_ros.node, "WATCH_PERIOD", 0.001)


def states(ros: MemoryMiddleware) -> list[list[tuple[str, int, str]]]:
    """Return the names, levels and texts of diagnostics, without requirements."""
    arrays = [each.status for each in ros.on("/diagnostics")]
    return [[(one.name, one.level, one.message) for one in array[1:]] for array in arrays]


@pytest.mark.usefixtures("soon")
def test_problems_with_others_are_logged_once() -> None:
    ros, node = started("out = x > 1")
    send(ros, "x", 2.0)
    ros.tick()
    assert states(ros)[-1] == []
    for level, text in (GONE, BACK):
        ros.standing = level, text
        until(lambda: ros.lines[-1] == ros.standing)
        for _ in range(3):
            ros.tick(ros.time + SECOND)
        assert states(ros)[-3:] == [[("monitor: ROS", int(level), text)]] * 3
    node.stop()
    assert [line for line in ros.lines if line in (GONE, BACK)] == [GONE, BACK]


@pytest.mark.usefixtures("soon")
def test_robustness_goes_on_without_a_master() -> None:
    ros, node = started("out = x > 1")
    ros.standing = GONE
    send(ros, "x", 2.0)
    ros.tick()
    until(lambda: GONE in ros.lines)
    send(ros, "x", 3.0)
    ros.tick(ros.time + SECOND // 10)
    node.stop()
    assert ros.data("rtamt/out") == [1.0, 2.0]
    assert node.reports == ()


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("other", ["", "/rtamt/oats"])
def test_hint_excludes_own_topics(other: str) -> None:
    ros, node = started("input float64 x\n@ topic(x, rtamt/oat)\nout = x > 1")
    ros.known = {ros.resolve(publisher.topic) for publisher in ros.publishers} | {other} - {""}
    ros.tick()
    hint = other and f"; did you mean '{other}'?"
    until(lambda: (Level.WARN, f"nobody publishes /rtamt/oat{hint}") in ros.lines)
    node.stop()


def test_the_log_has_ten_changes_a_minute() -> None:
    ros, node = started("out = x > 0")
    for n in range(1500):  # 150 s, with a change at every sample
        send(ros, "x", 1.0 if n % 2 else -1.0)
        ros.time += 100 * MS
        ros.tick()
    lines = [line for _, line in ros.lines if line.startswith("out: ")]
    assert len(lines) == 30
    assert sum(
        line.endswith("more changes in this minute are in /diagnostics only") for line in lines
    )
    left_out = [int(line.split()[-5]) for line in lines if line.endswith("changes were not logged")]
    assert len(left_out) == 2
    assert 1150 < sum(left_out) < 1200
    assert node.reports[0].restarts == 0


def test_every_restart_is_logged() -> None:
    ros, node = started("out = x > 0")
    for _ in range(30):
        ros.time += 800 * MS
        send(ros, "x", 1.0)
        ros.tick()
    restarts = {
        line.split("restarted ")[1].split()[0] for _, line in ros.lines if "restarted" in line
    }
    assert restarts == {str(n + 1) for n in range(node.reports[0].restarts)}
    assert len(restarts) == 29
