"""What a node says in diagnostics and in its log."""

from __future__ import annotations

import pytest
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import MS, send

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
    assert {each.key: each.value for each in first.values} == {
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
        "stale inputs": "",
        "late samples": "0",
        "messages out of order": "0",
        "unreadable messages": "0",
        "restarts": "0",
        "resets": "0",
        "last reset at": "",
    }
    assert ros.lines[:5] == [
        (Level.OK, "hears /rtamt/x (std_msgs/Float64) as x"),
        (Level.OK, "hears /rtamt/y (std_msgs/Float64) as y"),
        (Level.OK, "hears /rtamt/z (std_msgs/Float64) as z"),
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
