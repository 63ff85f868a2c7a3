"""A lifecycle manager and tools for parameters can use a monitor like any node."""

import os
import re
import signal
from pathlib import Path

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from ros2_client import LATCHED, Client
from std_msgs.msg import Float64, Int8
from std_srvs.srv import Trigger

ABOVE = "input float64 x\n@ topic(x, x)\nout = x > 1"
ALWAYS = "input float64 x\n@ topic(x, x)\nnow = x > 1\nout = always(now)"
BELOW = "input float64 x\n@ topic(x, x)\nout = x < 1"
ODD = "from absent_msgs.msg import Odd\ninput Odd o\nout = o.x > 1"
UNREADABLE = "STL:3:10: expected an operand after '>', got the end of the text\n"

pytest_plugins = ["ros2_client"]


def test_a_monitor_starts_itself_and_ends_in_good_order(tools: Client, tmp_path: Path) -> None:
    record = tmp_path / "samples.csv"
    heard = tools.hear("alone/rtamt/out", Float64)
    tools.source("alone/x", 3.0)
    monitor = tools.monitor("alone", spec=ABOVE, period=20, record=str(record))
    assert heard.next(bool).data == 2.0
    assert monitor.state == "active"
    monitor.process.ask_to_end()
    assert monitor.process.ended() == 0
    assert "Traceback" not in monitor.process.output
    assert len(record.read_text().splitlines()) > 1


def test_a_manager_takes_a_monitor_through_its_states(tools: Client) -> None:
    heard = tools.hear("managed/rtamt/out", Float64)
    tools.source("managed/x", 3.0)
    node = tools.middleware.node
    monitor = tools.monitor("managed", autostart=False, spec=ABOVE, period=20)
    assert monitor.state == "unconfigured"
    assert monitor.do("configure")
    assert monitor.state == "inactive"
    assert node.count_subscribers("/managed/x") == node.count_publishers("/managed/rtamt/out") == 0
    for _ in range(2):
        assert monitor.do("activate")
        assert monitor.state == "active"
        assert heard.next(bool).data == 2.0
        assert monitor.do("deactivate")
        assert monitor.state == "inactive"
        tools.until(lambda: node.count_publishers("/managed/rtamt/out") == 0)
        tools.until(lambda: node.count_subscribers("/managed/x") == 0)  # discovered before or later
    assert monitor.do("cleanup")
    assert monitor.state == "unconfigured"
    assert monitor.do("configure")
    assert monitor.do("activate")
    assert heard.next(bool).data == 2.0
    assert monitor.do("shutdown")
    assert monitor.state == "finalized"
    tools.until(lambda: node.count_publishers("/managed/rtamt/out") == 0)
    monitor.process.ask_to_end()
    assert monitor.process.ended() == 0


def test_an_active_monitor_is_reset_by_a_service(tools: Client) -> None:
    verdict = tools.hear("reset/rtamt/out/verdict", Int8, LATCHED)
    now = tools.hear("reset/rtamt/now", Float64)
    source = tools.source("reset/x", 0.0)
    monitor = tools.monitor("reset", spec=ALWAYS, period=20)
    tools.until(lambda: -1 in [each.data for each in verdict.all()])
    source.value = 3.0
    now.next(lambda each: each.data > 0)  # the values from now on
    answer = monitor.call(Trigger, "reset")
    assert answer.success
    first, second = answer.message.splitlines()
    assert first.startswith("new run of 1 requirement at ")
    assert second.startswith("out: new run; was: violated, robustness -1; violated 1 time")
    assert "WARN" in monitor.process.output
    assert monitor.do("deactivate")
    assert monitor.do("activate")
    assert monitor.call(Trigger, "reset").success
    tools.until(lambda: verdict.all()[-1].data == 0)


def test_what_cannot_be_is_refused_and_the_monitor_stays_where_it_is(tools: Client) -> None:
    monitor = tools.monitor("refusing", autostart=False)
    activate = Transition(id=Transition.TRANSITION_ACTIVATE)
    monitor.send(ChangeState, "change_state", transition=activate)  # rclpy answers only by label
    assert not monitor.do("activate")
    assert not monitor.do("configure")
    assert monitor.state == "unconfigured"
    assert "nothing to monitor: set the parameter spec or spec_file\n" in monitor.process.output
    assert monitor.set(spec=ABOVE[:-2]).startswith(UNREADABLE)
    # These need not fit each other until the node is configured.
    assert monitor.set(spec="historically[0:50ms](x > 1)") == ""
    assert not monitor.do("configure")
    assert monitor.set(period=25) == ""
    assert monitor.do("configure")


def test_specifications_are_exchanged_while_the_monitor_runs(tools: Client) -> None:
    heard = tools.hear("exchanged/rtamt/out", Float64)
    tools.source("exchanged/x", 3.0)
    monitor = tools.monitor("exchanged", spec=ABOVE, period=20)
    assert heard.next(bool).data == 2.0
    assert monitor.set(spec=BELOW) == ""
    assert heard.next(lambda each: each.data < 0).data == -2.0
    assert monitor.state == "active"
    assert monitor.get("spec") == BELOW
    # Of several parameters that are set together, all or none count.
    assert monitor.set(spec=ABOVE, unit="h") == "unit: expected 's', 'ms', 'us' or 'ns', got 'h'"
    assert (monitor.get("spec"), monitor.get("unit")) == (BELOW, "ms")
    assert heard.next(bool).data == -2.0
    assert monitor.set(spec=ABOVE, period=0.01, unit="s") == ""
    assert heard.next(lambda each: each.data > 0).data == 2.0


def test_parameters_leave_a_kept_limit(tools: Client) -> None:
    text = "input float64 x\ninput float64 limit = 4.0\n@ topic(x, x)\n@ topic(limit, limit)\n"
    limit = tools.middleware.node.create_publisher(Float64, "kept_limit/limit", LATCHED)
    limit.publish(Float64(data=2.0))
    tools.source("kept_limit/x", 3.0)
    heard = tools.hear("kept_limit/rtamt/out", Float64)
    monitor = tools.monitor("kept_limit", spec=f"{text}out = x < limit", period=20)
    assert heard.next(bool).data == -1.0
    before = len(heard.all())
    for period in (10, 20, 10, 20):
        assert monitor.set(period=period) == ""
        heard.all(len(heard.all()) + 20)
    numbers = [each.data for each in heard.all()[before:]]
    assert set(numbers) == {-1.0}
    assert len(numbers) >= 80


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("spec", ABOVE[:-2], UNREADABLE),
        ("spec", "", "nothing to monitor: set the parameter spec or spec_file"),
        ("spec", 3, "spec: expected a text or a list of texts, got 3"),
        (
            "spec_file",
            "/absent.stl",
            "spec_file: cannot read /absent.stl: No such file or directory",
        ),
        ("spec", ODD, "the messages of absent_msgs are not installed: pip install ros-jazzy-"),
        ("period", 0, "period: expected a number above 0, got 0"),
        ("unit", "h", "unit: expected 's', 'ms', 'us' or 'ns', got 'h'"),
        ("stale", "soon", "stale: expected seconds or TOPIC=SECONDS, got 'soon'"),
        ("qos", "reliable", "qos is fixed while the node is active: deactivate it, then set qos"),
        ("depth", 1, "depth is fixed while the node is active: deactivate it, then set depth"),
    ],
)
def test_a_refused_parameter_changes_nothing(
    tools: Client, name: str, value: object, reason: str
) -> None:
    heard = tools.hear("refused/rtamt/out", Float64)
    monitor = tools.shared("refused", spec=ABOVE, period=20)
    tools.source("refused/x", 3.0)
    assert heard.next(bool).data == 2.0
    before = monitor.get(name)
    assert monitor.set(**{name: value}).startswith(reason)
    assert monitor.get(name) == before
    assert heard.next(bool).data == 2.0
    assert monitor.state == "active"


def test_a_file_is_read_again_when_it_is_set_again(tools: Client, tmp_path: Path) -> None:
    file = tmp_path / "bound.stl"
    file.write_text(ABOVE)
    heard = tools.hear("edited/rtamt/out", Float64)
    tools.source("edited/x", 3.0)
    monitor = tools.monitor("edited", spec_file=str(file), period=20)
    assert heard.next(bool).data == 2.0
    file.write_text(ABOVE[:-2])
    hint = "hint: write a variable, a number or '(' there"
    refused = f"in {file}: {UNREADABLE}  out = x >\n           ^\n  {hint}"
    assert monitor.set(spec_file=str(file)) == refused
    assert heard.next(bool).data == 2.0
    file.write_text(BELOW)
    assert monitor.set(spec_file=str(file)) == ""
    assert heard.next(lambda each: each.data < 0).data == -2.0


def test_a_signal_ends_a_monitor_that_waits_to_be_configured(tools: Client) -> None:
    monitor = tools.monitor("waiting", autostart=False)
    assert monitor.state == "unconfigured"
    os.kill(monitor.process.pid, signal.SIGINT)
    assert monitor.process.ended() == 0
    assert not re.search(r"\[ERROR\]|Traceback", monitor.process.output)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"spec": ABOVE[:-2]}, UNREADABLE),
        ({"perod": 10}, "no parameter perod; did you mean 'period'?\n"),
        ({"depth": 1.5}, "parameter depth: Trying to set parameter 'depth' to '1.5'"),
    ],
)
def test_a_monitor_that_cannot_start_says_why_and_exits_with_2(
    tools: Client, parameters: dict[str, object], said: str
) -> None:
    monitor = tools.monitor("failing", **parameters)
    assert monitor.process.ended() == 2
    assert said in monitor.process.output
    assert "Traceback" not in monitor.process.output
