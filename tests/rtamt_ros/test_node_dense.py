"""A node in dense time: messages are events at their times, without sampling."""

from __future__ import annotations

import bisect
import math
from typing import Any, cast

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware, message

import rtamt
from rtamt import SpecificationError
from rtamt_ros.middleware import Level
from rtamt_ros.node import MonitorNode, Settings

MS = 1_000_000
START = 1_700_000_000 * SECOND + 123_456_789
HEAD = """
from my_msgs.msg import Parts
from rtamt_msgs.msg import FloatMessage
input Parts m
input Parts n
output FloatMessage out
"""
FORMULAS = [
    "m.a > n.a",
    "always[0:0.25](m.a > n.a or n.b > 1)",
    "once[0.05:0.1](m.b > 0) and n.a < 3",
    "(m.a > 0) until[0:0.2] (n.a > 0)",
]
VALUES = st.sampled_from([-2.0, -0.5, 0.0, 1.0, 3.0])
# (milliseconds since the last one, the topic, two values); "tick" is the timer.
STEPS = st.lists(
    st.tuples(st.integers(0, 80), st.sampled_from(["m", "n", "tick"]), VALUES, VALUES), max_size=50
)


def started(text: str, **settings: object) -> tuple[MemoryMiddleware, MonitorNode]:
    """Return a running node in dense time."""
    ros = MemoryMiddleware(time=START)
    node = MonitorNode(ros, [text], Settings(dense=True, **cast("Any", settings)))
    node.start()
    return ros, node


def parts(a: float, b: float, stamp: int | None = None) -> object:
    """Return a message with two values."""
    return message("my_msgs", "Parts", a=a, b=b, stamp=stamp)


def published(ros: MemoryMiddleware) -> list[tuple[int, float]]:
    """Return the published times and robustness."""
    return [(each.header.stamp.ns, each.value) for each in ros.on("rtamt/out")]


def signals(
    events: dict[str, list[tuple[int, float, float]]], origin: int
) -> dict[str, list[tuple[float, float]]]:
    """Return the events of the fields of m and n, from the last one before both are known."""
    begin = max(event[0][0] for event in events.values())
    found = {}
    for name, each in events.items():
        first = bisect.bisect_right([time for time, _, _ in each], begin) - 1
        for at, field in enumerate("ab", 1):
            rows = each[max(first, 0) :]
            found[f"{name}.{field}"] = [((row[0] - origin) / 1e9, row[at]) for row in rows]
    return found


@given(steps=STEPS, formula=st.sampled_from(FORMULAS))
def test_dense_by_arrival_equals_evaluate(
    steps: list[tuple[int, str, float, float]], formula: str
) -> None:
    text = f"{HEAD}out.value = {formula}"
    ros, node = started(text, stale=math.inf)
    events: dict[str, list[tuple[int, float, float]]] = {"m": [], "n": []}
    for wait, what, a, b in steps:
        ros.time += wait * MS
        if what == "tick":
            ros.tick()
            continue
        time = max(ros.time, events[what][-1][0] + 1) if events[what] else ros.time
        ros.send(f"rtamt/{what}", parts(a, b))
        events[what].append((time, a, b))
    ros.time += 1000 * MS
    ros.tick()
    if not (events["m"] and events["n"]):
        assert not published(ros)
        return
    # A silent topic keeps its value until just before the last look.
    spec = rtamt.parse(text)
    given_ = signals(events, START)
    end = (ros.time - 1 - START) / 1e9
    for each in given_.values():
        each.append((end, each[-1][1]))
    wanted = {name: each for name, each in given_.items() if name in spec.variables}
    whole = rtamt.dense.evaluate(spec, wanted)
    found = rtamt.dense.Events(*_arrays(published(ros)))
    horizon = rtamt.dense.Monitor(spec).horizon
    expected = [(time, value) for time, value in whole if time < end - horizon - 1e-9]
    assert list(found) == expected
    assert node.reports[0].restarts == 0
    assert node.reports[0].worst == min(value for _, value in expected)


def _arrays(rows: list[tuple[int, float]]) -> tuple[list[float], list[float]]:
    return [(time - START) / 1e9 for time, _ in rows], [value for _, value in rows]


@given(steps=STEPS, formula=st.sampled_from(FORMULAS), data=st.data())
def test_dense_by_stamp_ignores_topic_order(
    steps: list[tuple[int, str, float, float]], formula: str, data: st.DataObject
) -> None:
    text = f"{HEAD}out.value = {formula}"
    queues: dict[str, list[tuple[int, float, float]]] = {"m": [(0, 1.0, 1.0)], "n": [(0, 1.0, 0.0)]}
    time = 0
    for wait, what, a, b in steps:
        time += (wait + 1) * MS
        if what != "tick":
            queues[what].append((time, a, b))
    for queue in queues.values():
        queue.append((time + 1000 * MS, 0.0, 0.0))
    ros, node = started(text, stamps=True, stale=math.inf)
    left = {name: list(each) for name, each in queues.items()}
    for name in ("m", "n"):
        stamp, a, b = left[name].pop(0)
        ros.send(f"rtamt/{name}", parts(a, b, START + stamp))
    while any(left.values()):
        name = data.draw(st.sampled_from([name for name, each in left.items() if each]))
        stamp, a, b = left[name].pop(0)
        ros.time = max(ros.time, START + stamp) + data.draw(st.integers(0, 3)) * MS
        ros.send(f"rtamt/{name}", parts(a, b, START + stamp))
        if data.draw(st.booleans()):
            ros.tick()
    spec = rtamt.parse(text)
    wanted = {
        name: each
        for name, each in signals(
            {
                name: [(START + stamp, a, b) for stamp, a, b in each]
                for name, each in queues.items()
            },
            START,
        ).items()
        if name in spec.variables
    }
    end = (time + 1000 * MS) / 1e9 - rtamt.dense.Monitor(spec).horizon
    expected = [each for each in rtamt.dense.evaluate(spec, wanted) if each[0] < end - 1e-9]
    assert list(rtamt.dense.Events(*_arrays(published(ros)))) == expected
    assert (node.reports[0].restarts, node.reports[0].out_of_order) == (0, 0)


def test_dense_robustness_is_published_early() -> None:
    ros, _ = started(f"{HEAD}out.value = always[0:0.2](m.a > n.a)")
    ros.send("rtamt/m", parts(5, 0))
    ros.time += 100 * MS
    ros.send("rtamt/n", parts(1, 0))
    begin = ros.time
    ros.tick(begin + 200 * MS)
    assert published(ros) == []  # the window of the start ends now, at an instant that is not over
    ros.tick(begin + 250 * MS)
    assert published(ros) == [(begin, 4.0)]
    ros.time += 50 * MS  # m falls at start + 300 ms: known for start + 100 ms
    ros.send("rtamt/m", parts(2, 0))
    ros.tick(ros.time + 1 * MS)
    assert published(ros) == [(begin, 4.0), (begin + 100 * MS, 1.0)]


def test_dense_invariant_bounds() -> None:
    ros, node = started("bad = always(x > 0); good = eventually(x > 3); now = x > 0")
    for value in (2.0, 1.0, 4.0, -1.0, 5.0):
        ros.send("rtamt/x", message("std_msgs", "Float64", data=value))
        ros.tick(ros.time + 100 * MS)
    assert ros.data("rtamt/bad") == [2.0, 1.0, -1.0]
    assert ros.data("rtamt/bad/upper") == [2.0, 1.0, -1.0]
    assert ros.data("rtamt/bad/lower") == [-math.inf]
    assert ros.data("rtamt/bad/verdict") == [0, -1]
    assert ros.data("rtamt/good/lower") == [-1.0, 1.0, 2.0]
    assert ros.data("rtamt/good/verdict") == [0, 1]
    assert ros.data("rtamt/now") == [2.0, 1.0, 4.0, -1.0, 5.0]
    assert ros.data("rtamt/now/verdict") == [1]
    assert ros.data("rtamt/now/lower") == ros.data("rtamt/now/upper") == [2.0]
    bad, good, now = node.reports
    assert (bad.level, good.level, now.level) == (Level.ERROR, Level.OK, Level.OK)
    assert (bad.violations, now.violations, now.worst) == (1, 0, -1.0)
    assert bad.violated_at is not None
    assert bad.violated_at >= START + 300 * MS


@pytest.mark.parametrize("stamps", [False, True])
def test_a_stale_input_ends_the_run(stamps: bool) -> None:  # noqa: FBT001 - a parameter of the test
    ros, node = started(f"{HEAD}out.value = always(m.a > n.a)", stamps=stamps)
    for name, a in (("m", 5.0), ("n", 1.0)):
        ros.send(f"rtamt/{name}", parts(a, 0, ros.time))
    for _ in range(4):
        ros.time += 100 * MS
        ros.send("rtamt/m", parts(6, 0, ros.time))
        ros.tick()
    assert not any(math.isnan(value) for _, value in published(ros))
    for _ in range(3):
        ros.time += 100 * MS
        ros.send("rtamt/m", parts(6, 0, ros.time))
        ros.tick()
    assert node.reports[0].text == "n stale 0.7 s"
    assert math.isnan(published(ros)[-1][1])
    assert ros.latched("rtamt/out/verdict") == 0
    ros.send("rtamt/n", parts(2, 0, ros.time))
    ros.send("rtamt/m", parts(6, 0, ros.time + 1))
    ros.tick(ros.time + 100 * MS)
    ros.send("rtamt/n", parts(2, 0, ros.time))
    ros.send("rtamt/m", parts(6, 0, ros.time))
    ros.tick(ros.time + 100 * MS)
    assert published(ros)[-1][1] == 4.0
    assert node.reports[0].restarts == 1
    assert node.reports[0].restarted_because == "n was stale"


def test_dense_messages_in_one_tick() -> None:
    ros, node = started("x > 0")
    for value in (1.0, 2.0, 3.0):
        ros.send("rtamt/x", message("std_msgs", "Float64", data=value))
    ros.tick(ros.time + 100 * MS)
    assert ros.data("rtamt/spec") == [1.0, 2.0, 3.0]
    assert node.reports[0].restarts == 0


def test_two_messages_with_one_stamp_are_one_event() -> None:
    ros, node = started(f"{HEAD}out.value = m.a > 0", stamps=True)
    for stamp, a in [(0, 1.0), (0, 2.0), (50, 3.0), (40, 9.0), (90, 4.0)]:
        ros.send("rtamt/m", parts(a, 0, START + stamp * MS))
    assert published(ros) == [(START, 1.0), (START + 50 * MS, 3.0)]
    assert node.reports[0].out_of_order == 2


def test_dense_message_publishes_at_once() -> None:
    ros, node = started("always(x > 0)")
    for n, (value, least) in enumerate([(4.0, 4.0), (-1.0, -1.0), (9.0, -1.0)]):
        ros.time = START + n * 100 * MS
        ros.send("rtamt/x", message("std_msgs", "Float64", data=value))
        assert ros.data("rtamt/spec")[-1] == node.reports[0].upper == least
        assert node.reports[0].violations == (n > 0)


def test_a_clock_that_goes_back_begins_anew() -> None:
    ros, node = started("always(x > 0)")
    for loop in range(2):
        for n in range(4):
            ros.time = START + n * 100 * MS
            ros.tick()
            ros.send("rtamt/x", message("std_msgs", "Float64", data=9.0 + 4 * loop - n))
    assert [each for each in ros.data("rtamt/spec") if each == each] == [  # noqa: PLR0124 - nan
        *(9, 8, 7, 6, 13, 12, 11, 10)
    ]
    assert node.reports[0].restarts == 1


def test_values_without_a_robustness_begin_anew() -> None:
    ros, node = started("sqrt(x) > 1")
    for value in (4.0, -1.0, 9.0):
        ros.send("rtamt/x", message("std_msgs", "Float64", data=value))
        ros.tick(ros.time + 100 * MS)
    assert list(map(str, ros.data("rtamt/spec"))) == ["1.0", "nan", "nan", "2.0"]
    assert node.reports[0].restarted_because == "there was no robustness"


def test_dense_refusals() -> None:
    with pytest.raises(SpecificationError, match="'prev' reads the next or previous sample"):
        started("always(prev(x > 0))")


def test_dense_unbounded_formulas() -> None:
    ros, node = started(
        "both = always(x > 0) and always(y > 0); answered = always(x > 2 implies eventually(y > 2))"
    )
    for x, y in ((3.0, 1.0), (1.0, 1.0), (1.0, 3.0), (1.0, -1.0), (1.0, 1.0)):
        ros.send("rtamt/x", message("std_msgs", "Float64", data=x))
        ros.send("rtamt/y", message("std_msgs", "Float64", data=y))
        ros.tick(ros.time + 100 * MS)
    assert ros.data("rtamt/both") == [1.0, -1.0]
    assert ros.data("rtamt/both/verdict") == [0, -1]
    assert ros.data("rtamt/both/upper") == [1.0, -1.0]
    assert ros.data("rtamt/answered") == [-1.0, 1.0]
    assert ros.data("rtamt/answered/verdict") == [0]
    both, answered = node.reports
    assert (both.level, answered.level, both.violations) == (Level.ERROR, Level.OK, 1)
    assert both.violated_at is not None
    assert 0 < both.violated_at - (START + 300 * MS) < MS


def test_dense_verdict_precedes_robustness() -> None:
    ros, node = started("always[0:10](x > 0)")
    for value in (2.0, -1.0):
        ros.send("rtamt/x", message("std_msgs", "Float64", data=value))
        ros.tick(ros.time + 100 * MS)
    assert ros.data("rtamt/spec/verdict") == [-1]
    assert ros.data("rtamt/spec/upper") == [-1.0]
    assert node.reports[0].text.startswith("violated, robustness not known yet")


def test_dense_silent_input_does_not_block() -> None:
    text = f"{HEAD}out.value = always(m.a > 0 or n.a > 5)"
    ros, node = started(text, stamps=True, stale=0.5, stale_as="unknown")
    said = []
    for k in range(12):
        ros.time = START + k * 100 * MS
        ros.send("rtamt/m", parts(-1.0 if k == 9 else 1.0, 0, stamp=ros.time))
        if k < 2 or k > 10:
            ros.send("rtamt/n", parts(0, 0, stamp=ros.time))
        ros.time += 1 * MS
        ros.tick()
        (report,) = node.reports
        said.append((report.level, report.lower, report.upper))
    assert said[5] == (Level.OK, -math.inf, 1.0)
    assert said[8] == (Level.STALE, -math.inf, 1.0)
    assert said[10] == (Level.STALE, -math.inf, 1.0)  # n may have been above 5
    assert report.restarts == 0
    assert node.reports[0].verdict is rtamt.Verdict.UNDECIDED


@pytest.mark.parametrize(
    "formula", ["always(m.a > n.a + 0 * sqrt(n.b))", "always[0:10](m.a > n.a + 0 * sqrt(n.b))"]
)
@pytest.mark.parametrize("restart", ["clock", "stamps", "stale", "failed"])
def test_dense_violation_counts_before_restart(formula: str, restart: str) -> None:
    ros, node = started(f"{HEAD}out.value = {formula}", stamps=True)
    begin = ros.time = START + 20 * SECOND
    for name, a in (("n", 1.0), ("m", 0.0)):
        ros.send(f"rtamt/{name}", parts(a, 0, begin))
    assert ros.data("rtamt/out/verdict") == [-1]
    match restart:
        case "clock":
            ros.time -= 10 * SECOND
        case "stamps":
            for later in range(2):  # a single message would be out of line
                ros.send("rtamt/m", parts(5.0, 0, begin - 10 * SECOND + later))
        case "stale":
            ros.tick(ros.time + SECOND)
        case _:
            ros.time += SECOND // 10
            ros.send("rtamt/n", parts(1.0, -1.0, ros.time))
            ros.send("rtamt/m", parts(1.0, 0.0, ros.time))
            ros.time += SECOND // 10
    ros.tick()
    if restart == "stamps":  # they jump back to the clock
        ros.send("rtamt/m", parts(5.0, 0, ros.time - 1))
    for name, a in (("n", 1.0), ("m", 5.0)):
        ros.send(f"rtamt/{name}", parts(a, 0, ros.time))
    ros.tick(ros.time + 1)
    (report,) = node.reports
    assert (report.violations, report.violated_at, report.restarts) == (1, begin, 1)
    assert (report.verdict, report.level) == (rtamt.Verdict.UNDECIDED, Level.WARN)
    assert "violated 1 time since start, first at " in report.text
