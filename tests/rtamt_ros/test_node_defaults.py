"""A variable with a declared value has it after two seconds without a message."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from memory_middleware import SECOND, MemoryMiddleware, message
from memory_nodes import MS, let_defaults_count, send, started

from rtamt_ros.middleware import TopicPublisher
from rtamt_ros.node import MonitorNode, Settings

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
    """Return the published values and the reports of the requirement."""
    numbers = [repr(ros.data(f"rtamt/out{what}")) for what in ("", "/upper", "/verdict")]
    texts = [report._replace(defaults=()).text for report in node.reports]
    return [*numbers, *texts]


@pytest.mark.parametrize("dense", [False, True])
@given(steps=STEPS)
def test_default_equals_a_first_message(
    steps: list[tuple[int, str, float]], *, dense: bool
) -> None:
    options: dict[str, Any] = {"dense": dense, "stale_of": {"rtamt/limit": float("inf")}}
    (ros, node), (other, told) = started(WITH, **options), started(WITHOUT, **options)
    send(other, "limit", 0.5)
    for each in (ros, other):
        let_defaults_count(each)
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
    let_defaults_count(ros)
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
    let_defaults_count(ros)
    for _ in range(3):
        ros.time += 100 * MS
        ros.tick()
    assert set(ros.data("rtamt/out")) == {2.0}


def test_defaults_of_several_texts() -> None:
    ros, node = started(*(f"input float64 x{default}; x < 9" for default in (" = 1", " = 2", "")))
    let_defaults_count(ros)
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
    let_defaults_count(ros)
    begin = ros.time
    for n, a in enumerate((0.0, 1.0, 2.0)):
        ros.send("rtamt/m", message("my_msgs", "Parts", stamp=begin + n * 100 * MS, a=a))
    assert ros.data("rtamt/out") == [0.5, -0.5]  # nothing is known of 2.0 before the next stamp
    send(ros, "limit", 5.0)  # late: the default was valid until 2.0
    ros.time = begin + 300 * MS
    send(ros, "limit", 6.0)
    ros.send("rtamt/m", message("my_msgs", "Parts", stamp=begin + 300 * MS, a=3.0))
    assert ros.data("rtamt/out")[2:] == [-1.5, 3.0]


# A kept message that arrives late. ----------------------------------------------------------------

LATCHED = [TopicPublisher("/limits", keeps=True)]
LIVE = [TopicPublisher("/robot", keeps=False)]


def later(ros: MemoryMiddleware, seconds: float, x: float = 0.6) -> None:
    """Publish a message of x and look, some seconds later on all clocks."""
    ros.time += round(seconds * SECOND)
    send(ros, "x", x)
    ros.tick()


@pytest.mark.parametrize("dense", [False, True])
def test_no_run_starts_before_the_kept_message(*, dense: bool) -> None:
    ros, node = started("input float64 x; input float64 limit = 0.8; out = x < limit", dense=dense)
    ros.publishing = {"rtamt/limit": LATCHED}
    for _ in range(12):
        later(ros, 0.1)
        assert node.reports[0].text == "waiting for limit"
    send(ros, "limit", 0.3)
    later(ros, 0.1)
    assert ros.data("rtamt/out")
    assert set(ros.data("rtamt/out")) == {0.3 - 0.6}
    assert node.reports[0].defaults == ()


@pytest.mark.parametrize(
    ("publishers", "counts_after"),
    [([], 1.0), (LIVE, 1.0), (LATCHED, 2.0), ([*LIVE, *LATCHED], 2.0)],
)
def test_default_counts_when_no_publisher_keeps(
    publishers: list[TopicPublisher], counts_after: float
) -> None:
    ros, node = started(WITH)
    ros.publishing = {"rtamt/limit": publishers}
    for n in range(1, 31):
        later(ros, 0.1)
        waits = n / 10 < counts_after
        assert (node.reports[0].waiting == ("limit",)) == waits
        assert node.reports[0].defaults == (() if waits else ("limit = 0.5",))
    assert node.reports[0].text.startswith("violated, robustness -0.1; ")
    assert "; by default limit = 0.5; " in node.reports[0].text
    ros.time += SECOND  # once a second
    ros.tick()
    pairs = {pair.key: pair.value for pair in ros.on("/diagnostics")[-1].status[0].values}
    assert pairs["defaults"] == "limit = 0.5"


def test_publishers_that_keep_are_never_stale() -> None:
    for stale_of, stale in (({}, False), ({"rtamt/limit": 0.5}, True)):
        ros, node = started(WITHOUT, stale_of=stale_of)
        ros.publishing = {"rtamt/limit": LATCHED, "rtamt/x": LIVE}
        send(ros, "limit", 0.5)
        for _ in range(20):
            later(ros, 0.1)
        assert (node.reports[0].stale == ("limit",)) == stale
        ros.publishing = {"rtamt/limit": [*LATCHED, *LIVE]}
        for _ in range(10):
            later(ros, 0.1)
        assert node.reports[0].stale == ("limit",)


# Other specifications and settings. ---------------------------------------------------------------


@pytest.mark.parametrize("dense", [False, True])
def test_replacement_keeps_the_last_messages(*, dense: bool) -> None:
    text = "input float64 x; input float64 limit = 0.8; out = x < limit"
    ros, node = started(text, dense=dense)
    ros.publishing = {"rtamt/limit": LATCHED}
    send(ros, "limit", 0.3)
    for _ in range(30):
        later(ros, 0.1)
    known = len(ros.published)
    node.replace([text.replace("out", "other")], Settings(dense=dense, period=50 * MS))
    for _ in range(5):
        later(ros, 0.05)
    numbers = [each.data for topic, each in ros.published[known:] if topic == "rtamt/other"]
    assert numbers
    assert set(numbers) == {0.3 - 0.6}
    assert node.reports[0].restarts == 0
    node.stop()
    node.start()
    later(ros, 0.1)
    assert node.reports[0].waiting == ("limit",)  # nothing is kept


@pytest.mark.parametrize("dense", [False, True])
def test_replacement_equals_a_reset(*, dense: bool) -> None:
    """The formula depends on the start of the run: no earlier message may count."""
    text = "input float64 x; input float64 limit; out = historically[0:10](x < limit)"
    options: dict[str, Any] = {"dense": dense, "stale_of": {"rtamt/limit": float("inf")}}
    results = []
    for replaces in (False, True):
        ros, node = started(text, **options)
        send(ros, "limit", 0.3)
        for x in (0.9, 0.8, 0.1):
            later(ros, 0.1, x)
        known = len(ros.published)
        if replaces:
            node.replace([text])
        else:
            node.reset()
        for x in (0.2, 0.0, 0.25):
            later(ros, 0.1, x)
        sent = [each.data for topic, each in ros.published[known:] if topic == "rtamt/out"]
        results.append([value for value in sent if value == value])  # noqa: PLR0124 - not nan
    assert results[0] == results[1]
    assert results[1]


def test_replacement_stores_messages_in_between() -> None:
    ros, node = started(WITHOUT, stale_of={"rtamt/limit": float("inf")})
    send(ros, "limit", 0.25)
    resolve = ros.resolve

    def send_too(topic: str) -> str:
        ros.resolve = resolve  # type: ignore[method-assign]
        send(ros, "limit", 0.75)
        return resolve(topic)

    ros.resolve = send_too  # type: ignore[method-assign] # the node calls it while it changes
    node.replace([WITHOUT])
    later(ros, 0.1, 0.5)
    assert ros.data("rtamt/out") == [0.25]
