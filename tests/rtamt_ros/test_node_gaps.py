"""Silent inputs and unreadable messages: the verdict never stays as it was."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, message
from memory_nodes import MS, send, started

from rtamt import InputError, Verdict
from rtamt_ros.middleware import Level
from rtamt_ros.node import Settings

START = 1000 * SECOND
PERIOD = 100 * MS
STALE = 500 * MS  # five periods of 100 ms
X_AND_Y = "historically(x > 0 and y > 0)"

GAPS = st.lists(
    st.tuples(
        st.sampled_from([0, 10, 100, 300, 600, 2000]), st.sampled_from(["x", "y", "tick", "tick"])
    ),
    max_size=80,
)


@given(GAPS)
def test_stale_input_clears_topics(steps: list[tuple[int, str]]) -> None:
    ros, node = started(X_AND_Y)
    came: dict[str, list[int]] = {"x": [], "y": []}
    runs = 0
    running = False
    before: int | None = None
    for wait, what in steps:
        ros.time += wait * MS
        if what != "tick":
            send(ros, what, 2.0)
            came[what].append(ros.time)
            continue
        ros.tick()
        due = ros.time - (ros.time - START) % PERIOD
        gap = before is not None and due - before > STALE
        first = due if before is None or gap else before + PERIOD
        for point in range(first, due + 1, PERIOD):
            last = {
                name: max((t for t in at if t <= point), default=None) for name, at in came.items()
            }
            waiting = tuple(name for name, time in last.items() if time is None)
            late = tuple(n for n, time in last.items() if time is not None and point - time > STALE)
            there = not (waiting or late)
            runs += there and (gap or not running)
            running, before = there, point
        (report,) = node.reports
        assert (report.waiting, report.stale) == (waiting, late)
        if late:
            assert report.level == Level.STALE
        if running:
            assert ros.latched("rtamt/spec") == 2.0
        elif runs:
            assert math.isnan(ros.latched("rtamt/spec"))
            assert math.isnan(ros.latched("rtamt/spec/lower"))
            assert math.isnan(ros.latched("rtamt/spec/upper"))
            assert ros.latched("rtamt/spec/verdict") == Verdict.UNDECIDED
        else:
            assert not ros.on("rtamt/spec")
        assert report.restarts == max(0, runs - 1)


@given(GAPS, st.booleans())
def test_no_value_is_left_in_dense_time_either(steps: list[tuple[int, str]], stamps: bool) -> None:  # noqa: FBT001 - a parameter of the test
    text = """
    from rtamt_msgs.msg import FloatMessage
    input FloatMessage x
    input FloatMessage y
    always(x.value > 0 and y.value > 0)
    """
    ros, node = started(text, dense=True, stamps=stamps)
    came: dict[str, int] = {}
    for wait, what in steps:
        ros.time += wait * MS
        if what != "tick":
            ros.send(
                f"rtamt/{what}", message("rtamt_msgs", "FloatMessage", value=2.0, stamp=ros.time)
            )
            came[what] = ros.time
            continue
        ros.tick()
        late = [name for name in ("x", "y") if name in came and ros.time - came[name] > STALE]
        assert node.reports[0].stale == tuple(late)
        if late and ros.on("rtamt/spec"):
            assert math.isnan(ros.latched("rtamt/spec"))
            assert math.isnan(ros.latched("rtamt/spec/upper"))
            assert ros.latched("rtamt/spec/verdict") == Verdict.UNDECIDED


def test_run_after_a_gap_is_new() -> None:
    ros, node = started("historically(x > 0)", "always(x > 0)")
    for time, value in [(0, 5.0), (100, -1.0), (200, 5.0), (900, None), (1000, 4.0), (1100, 6.0)]:
        ros.time = START + time * MS
        if value is not None:
            send(ros, "x", value)
        ros.tick()
    assert list(map(str, ros.data("rtamt/spec"))) == list(
        map(str, [5.0, -1.0, -1.0, math.nan, 4.0, 4.0])
    )
    assert ros.data("rtamt/spec_2/verdict") == [0, -1, 0]
    past, always = node.reports
    assert past.text == (
        "satisfied, robustness 4; restarted 1 time because nothing was evaluated for 0.7 s; 1 "
        "message of x came at once, loss unknown"
    )
    assert always.violations == 1
    assert always.violated_at == START + 100 * MS
    assert (always.worst, always.worst_time) == (-1.0, START + 100 * MS)
    assert always.level == Level.WARN
    assert always.text == (
        "holds so far, robustness 4; violated 1 time since start, first at 1000.100 s; "
        "restarted 1 time because nothing was evaluated for 0.7 s; "
        "1 message of x came at once, loss unknown"
    )


def test_stale_input_affects_one_requirement() -> None:
    ros, node = started("slow = x < 3; near = y < 3")
    for n in range(10):
        ros.time = START + n * 100 * MS
        send(ros, "x", float(n) / 10)
        if n < 2:
            send(ros, "y", 1.0)
        ros.tick()
    slow, near = node.reports
    assert slow.robustness == pytest.approx(2.1)
    assert (near.stale, near.problem) == (("y",), "y stale 0.8 s")
    assert len(ros.data("rtamt/slow")) == 10
    assert math.isnan(ros.latched("rtamt/near"))


@pytest.mark.parametrize("dense", [False, True])
def test_stale_input_clears_named_formulas(
    dense: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    text = """
    from my_msgs.msg import Parts
    float64 x
    output Parts out
    output Parts other
    near = x > 0
    other.a = x < 9
    out.b = always(near and other.a)
    """
    ros, _ = started(text, dense=dense)
    for n in range(3):
        send(ros, "x", 2.0)
        ros.tick(START + n * 100 * MS)
    assert ros.latched("rtamt/near") == 2.0
    assert (ros.on("rtamt/other")[-1].a, ros.on("rtamt/out")[-1].b) == (7.0, 2.0)
    ros.tick(START + 2000 * MS)
    assert math.isnan(ros.latched("rtamt/near"))
    assert math.isnan(ros.on("rtamt/other")[-1].a)
    assert math.isnan(ros.on("rtamt/out")[-1].b)


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize(
    ("settings", "limit"),
    [
        ({}, 500),
        ({"period": 1000 * MS}, 5000),
        ({"stale": 0.25}, 250),
        ({"stale": 0.25, "stale_of": {"rtamt/x": 1.5}}, 1500),
        ({"stale": math.inf, "stale_of": {"rtamt/x": 2.0}}, 2000),
        ({"stale": math.inf}, 10**9),
    ],
)
def test_when_an_input_is_stale_can_be_said(
    settings: dict[str, Any],
    limit: int,
    dense: bool,  # noqa: FBT001 - a parameter of the test
) -> None:
    ros, node = started("x > 0", dense=dense, **settings)
    send(ros, "x", 1.0)
    ros.tick()
    # A sample is stale at its own late time, an event at any time.
    period = 1 if dense else node.settings.period // MS
    last = limit - limit % period
    for late, stale in ((last, ()), (last + period, ("x",))):
        if limit < 10**9 or not stale:
            ros.tick(START + late * MS)
            assert node.reports[0].stale == stale


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"period": 0}, "expected a whole number of nanoseconds as the period, got 0"),
        ({"period": -5}, "expected a whole number of nanoseconds as the period, got -5"),
        ({"period": 0.5}, "expected a whole number of nanoseconds as the period, got 0.5"),
        (
            {"stale": 0.0},
            "expected seconds above 0 until an input is stale, got 0.0; inf is never",
        ),
        (
            {"stale_of": {"/odom": math.nan}},
            "expected seconds above 0 until an input is stale of /odom, got nan; inf is never",
        ),
    ],
)
def test_settings_without_a_meaning_are_refused(settings: dict[str, Any], text: str) -> None:
    with pytest.raises(InputError) as error:
        Settings(**settings)
    assert str(error.value) == text


def test_a_topic_that_nothing_reads_is_never_stale() -> None:
    with pytest.raises(InputError) as error:
        started("x > 0", stale_of={"rtamt/y": 2.0})
    assert str(error.value) == (
        "stale: no specification reads the topic rtamt/y; did you mean 'rtamt/x'?"
    )
    with pytest.raises(InputError) as error:
        started("x > 0 and y > 0", stale_of={"/odom": 2.0})
    assert str(error.value) == (
        "stale: no specification reads the topic /odom; the topics are rtamt/x, rtamt/y"
    )


# What cannot be read. ----------------------------------------------------------------------------

SCAN = "from sensor_msgs.msg import LaserScan; input LaserScan scan; "


@pytest.mark.parametrize(
    ("ranges", "problem"),
    [
        ([1.0], "scan.ranges[1] cannot be read: list index out of range"),
        ([1.0, math.nan], "scan.ranges[1] is nan"),
        (
            [1.0, "far"],
            "scan.ranges[1] cannot be read: could not convert string to float: 'far'",
        ),
        (3.0, "scan.ranges[1] cannot be read: 'float' object is not subscriptable"),
        ([1.0, 10**400], "scan.ranges[1] cannot be read: int too large to convert to float"),
    ],
)
def test_unreadable_message_is_reported(ranges: object, problem: str) -> None:
    ros, node = started(f"{SCAN}scan.ranges[1] > 0.3")
    bad = message("sensor_msgs", "LaserScan", ranges=ranges)
    good = message("sensor_msgs", "LaserScan", ranges=[0.0, 1.3])
    ros.send("rtamt/scan", bad)
    ros.tick()
    (waiting,) = node.reports
    assert waiting.level == Level.ERROR
    assert waiting.text == f"waiting for scan; {problem}"
    assert not ros.on("rtamt/spec")
    ros.time = START + 100 * MS
    ros.send("rtamt/scan", good)
    ros.tick()
    (held,) = node.reports
    assert held.level == Level.OK
    for n in range(1, 8):
        ros.send("rtamt/scan", bad)
        ros.tick(START + (n + 1) * 100 * MS)
        if n <= 5:  # the last readable value is held
            assert ros.latched("rtamt/spec") == 1.0
            assert node.reports[0].level == Level.WARN
            assert node.reports[0].text == f"satisfied, robustness 1; {problem}"
        else:
            assert math.isnan(ros.latched("rtamt/spec"))
            assert node.reports[0].text == f"scan stale 0.{n} s; {problem}"
    assert node.reports[0].errors == 8
    ros.time = START + 900 * MS
    ros.send("rtamt/scan", good)
    ros.tick()
    assert (
        node.reports[0].text == "satisfied, robustness 1; restarted 1 time because scan was stale"
    )


def test_values_without_robustness_restart() -> None:
    ros, node = started("always(sqrt(x) > 1)", "always(x > -9)")
    for n, x in enumerate([4.0, -1.0, -4.0, 16.0]):
        ros.time = START + n * 100 * MS
        send(ros, "x", x)
        ros.tick()
        if x < 0:
            report = node.reports[0]
            assert report.level == Level.ERROR
            assert report.text == f"'sqrt(x)' is not a number at sample {2 - n}, where x = {x}"
            assert math.isnan(ros.latched("rtamt/spec"))
            assert ros.latched("rtamt/spec/verdict") == 0
    assert ros.latched("rtamt/spec") == 3.0
    assert node.reports[0].restarts == 1
    assert node.reports[0].restarted_because == "there was no robustness"
    assert ros.data("rtamt/spec_2") == [13.0, 8.0, 5.0, 5.0]


def test_a_goal_that_is_not_reached_yet_is_no_error() -> None:
    ros, node = started("eventually(x > 3)", "eventually[0:0.1](x > 3)", "x < 2")
    for n, x in enumerate([1.0, 2.0, 4.0]):
        ros.time = START + n * 100 * MS
        send(ros, "x", x)
        ros.tick()
        unbounded, bounded, now = node.reports
        assert unbounded.level == Level.OK
        if n == 1:
            assert unbounded.text == "not yet, robustness -1"
            assert bounded.level == Level.ERROR
    assert (now.level, now.text) == (Level.ERROR, "does not hold, robustness -2")
    assert unbounded.text == "satisfied, robustness 1"
    assert bounded.text.startswith("holds, robustness 1 at 1000.100 s; violated 1 time since start")
