"""A monitor receives every publisher, late subscribers receive it, and it uses the clock's time."""

import itertools
import math
import os
import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import LivelinessPolicy, QoSProfile
from ros2_client import BEST_EFFORT, LATCHED, RELIABLE, Client, Heard
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64

BOTH = "input float64 x\ninput float64 y\n@ topic(x, x)\n@ topic(y, y)\nout = x > y"
ABOVE = "input float64 x\n@ topic(x, x)\nout = x > 1"

pytest_plugins = ["ros2_client"]


def messages(array: DiagnosticArray) -> list[str]:
    """Return the diagnostics of requirements."""
    return [status.message for status in array.status]


def test_best_effort_hears_sensor_data_and_reliable_publishers(tools: Client) -> None:
    tools.source("all/x", 3.0, BEST_EFFORT)
    tools.source("all/y", 2.0, RELIABLE)
    robustness = tools.hear("all/rtamt/out", Float64)
    tools.monitor("all", spec=BOTH, period=20)
    assert robustness.next(bool).data == 1.0


def test_a_publisher_that_cannot_be_heard_is_reported_with_the_way_out(tools: Client) -> None:
    tools.source("deaf/x", 3.0, BEST_EFFORT)
    tools.source("deaf/y", 2.0, RELIABLE)
    robustness = tools.hear("deaf/rtamt/out", Float64)
    diagnostics = tools.hear("/diagnostics", DiagnosticArray)
    monitor = tools.monitor("deaf", spec=BOTH, period=20, qos="reliable")
    assert diagnostics.next(lambda each: messages(each) == ["waiting for x"])  # and not for y
    reason = "[deaf.stl_monitor]: a publisher of /deaf/x is not reliable: "
    effect = "its messages are not received; "
    tools.until(lambda: f"{reason}{effect}set qos to best_effort\n" in monitor.process.output)
    assert robustness.all() == []
    assert monitor.do("deactivate")
    assert monitor.set(qos="best_effort") == ""
    assert monitor.do("activate")
    assert robustness.next(bool).data == 1.0


def test_a_publisher_of_another_type_is_reported(tools: Client) -> None:
    tools.source("other/x", 3.0)
    integer = "from std_msgs.msg import Int64\ninput Int64 x\n@ topic(x, x)\nout = x > 1"
    monitor = tools.monitor("other", spec=integer, period=20)
    said = "a publisher of /other/x sends std_msgs/msg/Float64 instead of std_msgs/msg/Int64: its"
    tools.until(lambda: f"{said} messages are not received\n" in monitor.process.output)


def test_who_comes_late_hears_the_last_value_and_of_a_stale_input_nan(tools: Client) -> None:
    source = tools.source("late/x", 3.0)
    early = tools.hear("late/rtamt/out", Float64)
    monitor = tools.monitor("late", spec=ABOVE, period=20, stale=0.3)
    assert early.next(bool).data == 2.0
    source.close()
    assert early.next(lambda each: math.isnan(each.data))
    late = tools.hear("late/rtamt/out", Float64, LATCHED)
    assert math.isnan(late.all(1)[0].data)
    assert monitor.state == "active"


def test_an_input_that_was_published_once_before_the_monitor_is_heard(tools: Client) -> None:
    limit = tools.middleware.node.create_publisher(Float64, "kept/y", LATCHED)
    limit.publish(Float64(data=2.0))
    tools.source("kept/x", 3.0)
    robustness = tools.hear("kept/rtamt/out", Float64)
    tools.monitor("kept", spec=BOTH, period=20, stale="y=inf")
    assert robustness.next(bool).data == 1.0


@pytest.mark.parametrize("mixed", [False, True])
@pytest.mark.parametrize("before", [False, True])
def test_of_two_readers_each_message_is_heard_once_and_nothing_old(
    tools: Client, *, mixed: bool, before: bool
) -> None:
    node, heard = tools.middleware.node, Heard()
    topic = f"/twice/{mixed}/{before}"
    if mixed:
        node.create_publisher(Float64, topic, RELIABLE)
    keeps = node.create_publisher(Float64, topic, LATCHED)
    subscription = tools.middleware.subscribe(topic, Float64, heard.keep)
    sent = 0
    if before:  # the first reader receives these, and the second one is given them
        tools.until(lambda: keeps.get_subscription_count() >= 1)
        for sent in range(1, 4):
            keeps.publish(Float64(data=float(sent)))
        assert heard.all(3)
    tools.until(lambda: keeps.get_subscription_count() == 2)
    while keeps.get_subscription_count() == 2:
        sent += 1
        keeps.publish(Float64(data=float(sent)))
        assert heard.all(sent)
    keeps.publish(Float64(data=float(sent + 1)))
    assert [each.data for each in heard.all(sent + 1)] == list(range(1, sent + 2))
    subscription.close()
    tools.until(lambda: keeps.get_subscription_count() == 0)


def test_a_subscription_that_is_closed_early_opens_nothing_more(tools: Client) -> None:
    node, heard = tools.middleware.node, Heard()
    keeps = node.create_publisher(Float64, "/early", LATCHED)
    keeps.publish(Float64(data=1.0))
    subscription = tools.middleware.subscribe("/early", Float64, heard.keep)
    tools.until(lambda: keeps.get_subscription_count() == 1)
    subscription.close()
    later = Heard()
    other = tools.middleware.subscribe("/early", Float64, later.keep)
    assert later.all(1)[0].data == 1.0  # a look was due for the first one too
    tools.until(lambda: keeps.get_subscription_count() == 1)
    assert heard.all() == []
    other.close()


def test_samples_follow_a_simulated_clock_that_jumps_back(tools: Client) -> None:
    node = tools.middleware.node
    clock = node.create_publisher(Clock, "/clock", RELIABLE)
    x = node.create_publisher(Float64, "simulated/x", RELIABLE)
    robustness = tools.hear("simulated/rtamt/out", Float64)
    diagnostics = tools.hear("/diagnostics", DiagnosticArray)
    monitor = tools.monitor("simulated", spec=ABOVE, period=100, use_sim_time=True)
    assert monitor.state == "active"
    tools.until(lambda: "[WARN]" in monitor.process.output)
    assert monitor.process.output.endswith(": out: waiting for the clock\n")
    tools.until(lambda: clock.get_subscription_count() == x.get_subscription_count() == 1)

    def step(tenth: int, value: float) -> None:
        """Publish a value, and a tick of the clock after it."""
        x.publish(Float64(data=value))
        tick = Clock()
        tick.clock.sec, tick.clock.nanosec = tenth // 10, tenth % 10 * 100_000_000
        clock.publish(tick)

    for begin, value in ((500, 3.0), (100, 0.5)):
        ticks = itertools.count(begin)
        before = len(robustness.all())
        while not robustness.all(before + 1, 0.1)[before:]:  # until the value has arrived
            step(next(ticks), value)
        begun = len(robustness.all())
        for more in range(1, 21):
            step(next(ticks), value)
            robustness.all(begun + more)
        found = [each.data for each in robustness.all()[begun:]]
        assert found == [value - 1] * 20
    why = "restarted 1 time because the clock went back by "
    assert why in " ".join(messages(diagnostics.all()[-1]))
    late = tools.hear("simulated/rtamt/out", Float64, LATCHED)  # the clock stands: nothing is new
    assert [each.data for each in late.all(1)] == [-0.5]


@pytest.mark.parametrize("number", [signal.SIGSTOP, signal.SIGKILL])
def test_a_monitor_that_hangs_or_is_dead_is_not_alive(
    tools: Client, number: signal.Signals
) -> None:
    name = f"alive_{number.name.lower()}"
    alive: list[int] = []
    states = Heard()
    profile = QoSProfile(
        depth=1,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
        liveliness_lease_duration=Duration(seconds=1),
    )
    node = tools.middleware.node
    subscription = node.create_subscription(
        DiagnosticArray,
        f"{name}/rtamt/out/state",
        states.keep,
        profile,
        event_callbacks=SubscriptionEventCallbacks(
            liveliness=lambda event: alive.append(event.alive_count),
            use_default_callbacks=False,
        ),
    )
    tools.source(f"{name}/x", 3.0)
    monitor = tools.monitor(name, spec=ABOVE, period=100)
    states.next(lambda each: each.status[0].level == b"\0")
    tools.until(lambda: alive[-1:] == [1])
    os.kill(monitor.process.pid, number)
    tools.until(lambda: alive[-1] == 0)
    if number is signal.SIGSTOP:
        os.kill(monitor.process.pid, signal.SIGCONT)
        tools.until(lambda: alive[-1] == 1)
    node.destroy_subscription(subscription)
