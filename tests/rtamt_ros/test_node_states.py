"""The state of a requirement is published at every sample, and its publisher is asserted alive."""

from __future__ import annotations

from typing import Any

import pytest
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import MS, send, started

from rtamt_ros.core.publishing import lease_of
from rtamt_ros.node import MonitorNode

START = 1000 * SECOND


def states(ros: MemoryMiddleware) -> list[tuple[int, int, dict[str, str]]]:
    """Return stamp, level and values of every message."""
    return [
        (
            (each.header.stamp.ns - START) // MS,
            each.status[0].level,
            {pair.key: pair.value for pair in each.status[0].values},
        )
        for each in ros.on("rtamt/out/state")
    ]


def publisher(ros: MemoryMiddleware) -> Any:  # noqa: ANN401 - private to the middleware
    """Return the publisher of the state."""
    (found,) = [each for each in ros.publishers if each.topic == "rtamt/out/state"]
    return found


def test_a_state_at_every_sample() -> None:
    ros, node = started("out = always(x > 0)")
    for n, x in enumerate([None, 1.0, 0.5, -1.0, 1.0, None, None, None, None, None, None]):
        if x is not None:
            send(ros, "x", x)
        ros.tick(START + n * 100 * MS)
        (report,) = node.reports
        time, level, values = states(ros)[-1]
        assert (time, level) == (n * 100, report.level)
        assert values["verdict"] == ("" if report.verdict is None else report.verdict.name)
        assert values["upper"] == ("" if report.upper is None else repr(report.upper))
    verdicts = [values["verdict"] for _, _, values in states(ros)]
    assert verdicts == ["", "UNDECIDED", "UNDECIDED", *["VIOLATED"] * 6, "UNDECIDED", "UNDECIDED"]
    assert states(ros)[-1][1] == 3  # stale
    assert publisher(ros).asserted == 11


def test_a_dense_state_at_every_change_and_look() -> None:
    ros, _ = started("out = always(x > 0)", dense=True)
    send(ros, "x", 1.0)
    ros.time += 30 * MS
    send(ros, "x", -1.0)
    assert states(ros)[-1][2]["verdict"] == "VIOLATED"
    count = len(states(ros))
    for _ in range(3):
        ros.time += 100 * MS
        ros.tick()
    assert [time for time, *_ in states(ros)[count:]] == [130, 230, 330]
    assert publisher(ros).asserted == 3


@pytest.mark.parametrize(("period", "lease"), [(10 * MS, SECOND), (500 * MS, 2500 * MS)])
def test_lease_is_a_second_or_five_periods(period: int, lease: int) -> None:
    ros, _ = started("out = x > 0", period=period)
    assert publisher(ros).lease == lease_of(period) == lease


def test_no_state_without_diagnostic_messages() -> None:
    ros = MemoryMiddleware(missing={"diagnostic_msgs"})
    MonitorNode(ros, ["out = x > 0"]).start()
    send(ros, "x", 1.0)
    ros.tick()
    assert ros.data("rtamt/out") == [1.0]
    assert not ros.on("rtamt/out/state")
