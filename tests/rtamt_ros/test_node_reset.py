"""The service that restarts monitors, and the state that remains."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import MS, send, started

from rtamt import EpisodeMonitor, InputError, Verdict
from rtamt_ros.middleware import Level
from rtamt_ros.node import MonitorNode

START = 1000 * SECOND
PERIOD = 100 * MS
VALUES = st.sampled_from([-2.0, -0.0, 0.0, 1.0, 3.0])


def play(ros: MemoryMiddleware, values: list[float], begin: int) -> None:
    """Publish x before every sample, from a point of the grid on."""
    for number, value in enumerate(values):
        ros.time = begin + number * PERIOD
        send(ros, "x", value)
        ros.tick()


@given(
    before=st.lists(VALUES, max_size=8),
    after=st.lists(VALUES, min_size=1, max_size=8),
    late=st.integers(1, 99),
    text=st.sampled_from(["always(x > 0)", "eventually(x > 2)", "always(once[0:0.2](x > 0))"]),
)
def test_reset_equals_a_new_node(
    before: list[float], after: list[float], late: int, text: str
) -> None:
    ros, node = started(text, stale=math.inf)
    play(ros, before, START)
    middle = START + len(before) * PERIOD
    ros.time = middle - late * MS
    good, _ = ros.call("reset")
    assert good
    play(ros, after, middle)
    fresh, other = started(text, begin=middle, stale=math.inf)
    play(fresh, after, middle)
    (found,), (expected,) = node.reports, other.reports
    for name in ("time", "robustness", "about", "lower", "upper", "verdict", "worst", "violations"):
        assert getattr(found, name) == getattr(expected, name), name
    assert (found.restarts, found.resets, found.reset_at) == (0, 1, middle - late * MS)
    episode = EpisodeMonitor(text, period="100ms")
    for value in after:
        episode.update(value)
    assert (found.lower, found.upper) == episode.bounds()


@pytest.mark.parametrize("dense", [False, True])
def test_reset_forgets_violations(dense: bool) -> None:  # noqa: FBT001
    ros, node = started("bounded = always(x < 3)", "other = always(y > 0)", dense=dense)
    for number in range(5):
        ros.time = START + number * PERIOD
        send(ros, "x", 4.0 if number == 1 else 1.0)
        ros.tick()
    assert node.reports[0].verdict is Verdict.VIOLATED
    ros.time += 50 * MS
    good, said = ros.call("reset")
    at = "1000.450 s"
    assert good
    first, bounded, other = said.splitlines()
    assert first == f"new run of 2 requirements at {at}"
    assert bounded.startswith("bounded: new run; was: violated, robustness -1")
    assert "violated 1 time since start, first at 1000.100 s" in bounded
    assert other == "other: new run; was: waiting for y"
    assert ros.lines[-1] == (Level.WARN, said)
    # Until the next sample the topics report that nothing is known; y has never arrived.
    for part in ("", "/lower", "/upper"):
        assert math.isnan(ros.latched(f"rtamt/bounded{part}"))
        assert not ros.data(f"rtamt/other{part}")
    assert ros.latched("rtamt/bounded/verdict") == 0
    ros.time = START + 5 * PERIOD
    send(ros, "x", 2.0)
    ros.tick()
    report = node.reports[0]
    assert (report.level, report.verdict) == (Level.OK, Verdict.UNDECIDED)
    said, *others = report.text.split("; ")
    assert said.startswith("holds so far, robustness 1")
    assert others == [f"reset 1 time, at {at}"]
    ros.time += PERIOD
    send(ros, "x", 5.0)
    ros.tick()
    assert node.reports[0].text.split("; ")[1:] == [
        "violated 1 time since the reset, first at 1000.600 s",
        f"reset 1 time, at {at}",
    ]
    ros.call("reset")
    assert "reset 2 times, the last at 1000.600 s" in node.reports[0].text


def test_resets_and_restarts_are_counted_apart() -> None:
    ros, node = started("always(x < 3)")
    play(ros, [1.0, 1.0], START)
    ros.call("reset")
    play(ros, [1.0], START + 2 * PERIOD)
    ros.tick(START + 20 * PERIOD)  # stale
    ros.call("reset")  # the run has already ended: the reset applies to the next one
    play(ros, [1.0], START + 21 * PERIOD)
    ros.tick(START + 40 * PERIOD)
    play(ros, [1.0], START + 41 * PERIOD)
    (report,) = node.reports
    assert (report.restarts, report.resets) == (1, 2)
    assert report.restarted_because == (
        "nothing was evaluated for 1.9 s; 1 message of x came at once, loss unknown"
    )
    (status,) = ros.on("/diagnostics")[-1].status
    values = {value.key: value.value for value in status.values}
    assert (values["restarts"], values["resets"]) == ("1", "2")
    assert values["last reset at"] == "1002.000 s"


def test_reset_drops_due_samples() -> None:
    ros, node = started("always(x < 3)", stale=math.inf)
    play(ros, [1.0], START)
    ros.time = START + PERIOD
    send(ros, "x", 7.0)
    ros.time += PERIOD + 10 * MS
    send(ros, "x", 2.0)
    ros.call("reset")
    ros.tick(START + 3 * PERIOD)
    (report,) = node.reports
    assert (report.verdict, report.robustness, report.missed) == (Verdict.UNDECIDED, 1.0, 0)


def test_dense_reset_keeps_held_values() -> None:
    ros, node = started("always[0:0.2](x < 3)", dense=True, stale=math.inf)
    for number, value in enumerate([7.0, 1.0]):
        ros.time = START + number * PERIOD
        send(ros, "x", value)
    ros.time += 50 * MS
    ros.call("reset")
    ros.tick(START + 2 * PERIOD)
    (report,) = node.reports
    assert (report.verdict, report.violations, report.lower) == (Verdict.UNDECIDED, 0, -math.inf)
    ros.tick(START + 4 * PERIOD)
    assert node.reports[0].verdict is Verdict.SATISFIED
    assert min(each.header.stamp.ns for each in ros.on("/diagnostics")) >= START


def test_jump_back_before_a_reset() -> None:
    ros, node = started("always[0:0.2](x < 3)", dense=True, stale=math.inf)
    send(ros, "x", 1.0)
    ros.time += PERIOD
    ros.call("reset")
    ros.tick()
    ros.time = START - 10 * SECOND
    for _ in range(5):
        send(ros, "x", 1.0)
        ros.tick()
        ros.time += PERIOD
    assert node.reports[0].verdict is Verdict.SATISFIED
    assert node.reports[0].time < START


def test_reset_starts_the_next_record(tmp_path: Path) -> None:
    ros, node = started("always(x < 3)", record=tmp_path / "run.csv")
    play(ros, [1.0, 2.0], START)
    ros.call("reset")
    play(ros, [2.5], START + 2 * PERIOD)
    node.stop()
    rows = [(tmp_path / name).read_text().splitlines()[1:] for name in ("run.csv", "run-2.csv")]
    assert [len(row) for row in rows] == [2, 1]


def test_reset_service_exists_while_running() -> None:
    ros, node = started("always(x < 3)")
    assert [service.topic for service in ros.services] == ["reset"]
    node.stop()
    assert not ros.services
    with pytest.raises(InputError, match=r"^the monitor does not run; start it, or activate"):
        node.reset()
    ros = MemoryMiddleware(missing={"std_srvs"})
    node = MonitorNode(ros, ["always(x < 3)"])
    node.start()
    assert ros.lines[0] == (
        Level.WARN,
        "there is no service ~/reset: std_srvs is not installed",
    )
    play(ros, [1.0], START)
    first, second = node.reset().splitlines()
    assert first == "new run of 1 requirement at 1000.000 s"
    assert second == "spec: new run; was: holds so far, robustness 2"
    node.stop()


def test_reset_before_a_simulated_clock() -> None:
    ros = MemoryMiddleware(time=0, simulated=True)
    node = MonitorNode(ros, ["always(x < 3)"])
    node.start()
    assert ros.call("reset") == (
        False,
        "the node does not run, or its clock has not started",
    )
    node.stop()
