"""A variable with a declared value has it until its first message, and nothing waits for one."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import MemoryMiddleware, message
from memory_nodes import MS, send, started

from rtamt_ros.node import MonitorNode

TEXT = "input float64 x; input float64 limit{}; out = x < limit"
WITH, WITHOUT = TEXT.format(" = 0.5"), TEXT.format("")
# Milliseconds since the last one, the topic, the value; "tick" is the timer.
STEPS = st.lists(
    st.tuples(
        st.integers(1, 150), st.sampled_from(["x", "limit", "tick"]), st.sampled_from([-1.0, 2.0])
    ),
    max_size=40,
)


def said(ros: MemoryMiddleware, node: MonitorNode) -> list[str]:
    """What was published of the requirement, and what is said of it."""
    numbers = [repr(ros.data(f"rtamt/out{what}")) for what in ("", "/upper", "/verdict")]
    return [*numbers, *(report.text for report in node.reports)]


@pytest.mark.parametrize("dense", [False, True])
@given(steps=STEPS)
def test_default_equals_a_first_message(
    steps: list[tuple[int, str, float]], *, dense: bool
) -> None:
    options: dict[str, Any] = {"dense": dense, "stale_of": {"rtamt/limit": float("inf")}}
    (ros, node), (other, told) = started(WITH, **options), started(WITHOUT, **options)
    send(other, "limit", 0.5)
    send(ros, "x", 1.0)
    send(other, "x", 1.0)
    for wait, what, value in steps:
        for each in (ros, other):
            each.time += wait * MS
            if what == "tick":
                each.tick()
            else:
                send(each, what, value)
    assert said(ros, node) == said(other, told)


def test_default_is_not_stale() -> None:
    ros, node = started(WITH)
    for n in range(20):
        ros.time += 100 * MS
        send(ros, "x", 1.0)
        if n == 10:
            send(ros, "limit", 3.0)
        ros.tick()
    assert ros.data("rtamt/out")[:16] == [-0.5] * 10 + [2.0] * 6
    assert node.reports[0].stale == ("limit",)


@pytest.mark.parametrize("dense", [False, True])
def test_defaults_alone_have_robustness(dense: bool) -> None:  # noqa: FBT001 - a parameter of the test
    ros, _ = started("input float64 x = 3; out = x > 1", dense=dense)
    for _ in range(3):
        ros.time += 100 * MS
        ros.tick()
    assert set(ros.data("rtamt/out")) == {2.0}


def test_defaults_of_several_texts() -> None:
    ros, node = started(*(f"input float64 x{default}; x < 9" for default in (" = 1", " = 2", "")))
    ros.tick()
    assert [ros.data(f"rtamt/spec{n}") for n in ("", "_2", "_3")] == [[8.0], [7.0], []]
    assert node.reports[2].waiting == ("x",)
    send(ros, "x", 4.0)
    ros.time += 100 * MS
    ros.tick()
    assert [ros.data(f"rtamt/spec{n}")[-1] for n in ("", "_2", "_3")] == [5.0] * 3


def test_dense_default_lasts() -> None:
    text = (
        "from my_msgs.msg import Parts; from std_msgs.msg import Float64; input Parts m; "
        "input Float64 limit = 0.5; out = m.a < limit"
    )
    ros, _ = started(text, dense=True, stamps=True, stale=float("inf"))
    begin = ros.time
    for n, a in enumerate((0.0, 1.0, 2.0)):
        ros.send("rtamt/m", message("my_msgs", "Parts", stamp=begin + n * 100 * MS, a=a))
    assert ros.data("rtamt/out") == [0.5, -0.5]  # of 2.0 nothing is known before the next stamp
    send(ros, "limit", 5.0)  # late: the default has lasted until 2.0 came
    ros.time = begin + 300 * MS
    send(ros, "limit", 6.0)
    ros.send("rtamt/m", message("my_msgs", "Parts", stamp=begin + 300 * MS, a=3.0))
    assert ros.data("rtamt/out")[2:] == [-1.5, 3.0]
