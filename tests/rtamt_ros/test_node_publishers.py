"""Several publishers of one topic are named, and with ``one`` there is no run meanwhile."""

from __future__ import annotations

import math

import pytest
from memory_middleware import MemoryMiddleware
from memory_nodes import MS, send, started

from rtamt_ros.core.settings import Publishers
from rtamt_ros.middleware import Level, TopicPublisher

A, B = (TopicPublisher(name, keeps=False) for name in ("/a", "/b"))
WORDS = "2 publishers of /rtamt/x: /a, /b"


def seconds(ros: MemoryMiddleware, value: float, publishers: list[TopicPublisher]) -> None:
    """Run half a second with messages of these publishers."""
    ros.publishing = {"rtamt/x": publishers}
    for _ in range(5):
        ros.time += 100 * MS
        send(ros, "x", value)
        ros.tick()


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("stale_as", ["restart", "unknown"])
@pytest.mark.parametrize("mode", ["any", "one"])
def test_several_publishers(mode: Publishers, stale_as: str, *, dense: bool) -> None:
    ros, node = started(
        "out = historically(x > 0)", publishers=mode, dense=dense, stale_as=stale_as
    )
    seconds(ros, 1.0, [A])
    assert node.reports[0].level is Level.OK
    seconds(ros, 1.0, [B, A])
    (report,) = node.reports
    assert report.level is Level.WARN
    assert WORDS in report.text
    assert any(line.startswith(WORDS) and level is Level.WARN for level, line in ros.lines)
    assert WORDS in ros.on("/diagnostics")[-1].status[0].message
    latched = ros.latched("rtamt/out")
    assert (latched == 1.0) if mode == "any" else math.isnan(latched)
    seconds(ros, -1.0, [A, B])
    seconds(ros, 1.0, [A])
    (report,) = node.reports
    if mode == "any":
        assert (report.restarts, report.robustness) == (0, -1.0)
    else:
        assert (report.restarts, report.violations, report.robustness) == (1, 0, 1.0)
        assert report.restarted_because == f"there were {WORDS}"
    assert WORDS not in report.text.partition("restarted")[0]
    assert any("no more than 1 publisher of /rtamt/x" in line for _, line in ros.lines)
