"""The subscriptions, publications and errors of a node."""

from __future__ import annotations

from pathlib import Path

import pytest
from memory_middleware import MemoryMiddleware, message
from memory_nodes import MS, send, started, topics

import rtamt
from rtamt import InputError, ParseError, SpecificationError
from rtamt_ros.node import MonitorNode, Settings

PAPER = """
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rtamt_msgs.msg import FloatMessage

input Twist cmd
output Odometry odom
output FloatMessage out

@ topic(cmd, robot0/cmd_vel)
@ topic(odom, /robot0/odom)
@ topic(out, rtamt/c)

near = abs(cmd.linear.x - odom.twist.twist.linear.x) <= 0.1
out.value = always[0:0.2](near)
"""


def drive(ros: MemoryMiddleware, speeds: list[tuple[float, float]]) -> None:
    """Publish commands and speeds, one pair per period."""
    for command, speed in speeds:
        ros.send("robot0/cmd_vel", message("geometry_msgs", "Twist", linear__x=command))
        ros.send("/robot0/odom", message("nav_msgs", "Odometry", twist__twist__linear__x=speed))
        ros.tick()
        ros.time += 100 * MS


def open_ends(ros: MemoryMiddleware) -> tuple[int, int, int]:
    """Return the number of open publishers, subscriptions and timers."""
    return len(ros.publishers), len(ros.subscriptions), len(ros.timers)


def test_text_of_the_paper_runs() -> None:
    ros, _ = started(PAPER)
    assert [subscription.topic for subscription in ros.subscriptions] == [
        "robot0/cmd_vel",
        "/robot0/odom",
    ]
    assert topics(ros) == {
        "rtamt/near": "std_msgs",
        "rtamt/c": "rtamt_msgs",
        "rtamt/c/lower": "std_msgs",
        "rtamt/c/upper": "std_msgs",
        "rtamt/c/verdict": "std_msgs",
        "rtamt/c/state": "diagnostic_msgs",
        "/diagnostics": "diagnostic_msgs",
    }
    assert [publisher.topic for publisher in ros.publishers if not publisher.latched] == [
        "rtamt/c/state",
        "/diagnostics",
    ]
    begin = ros.time
    drive(ros, [(1.0, 0.25), (1.0, 0.5), (1.0, 1.0), (1.0, 1.0)])
    assert ros.data("rtamt/near") == pytest.approx([-0.65, -0.4, 0.1, 0.1])
    found = [(each.header.stamp.ns, each.value) for each in ros.on("rtamt/c")]
    assert found == [(begin, -0.65), (begin + 100 * MS, -0.4)]
    # The verdict is about the start, at which the robot is too slow.
    assert ros.data("rtamt/c/verdict") == [-1]
    assert ros.data("rtamt/c/upper") == pytest.approx([-0.65])


def test_topics_are_subscribed_once() -> None:
    other = """
    specification slow
    from nav_msgs.msg import Odometry
    input Odometry o
    @ topic(o, /robot0/odom)
    o.twist.twist.linear"""
    ros, node = started(PAPER, f"{other}.x < 2", f"{other}.y < 2")
    assert [subscription.topic for subscription in ros.subscriptions] == [
        "robot0/cmd_vel",
        "/robot0/odom",
    ]
    drive(ros, [(1.0, 0.5)])
    assert [report.name for report in node.reports] == ["out.value", "slow", "slow_2"]
    assert ros.data("rtamt/slow") == [1.5]
    assert ros.data("rtamt/slow_2") == [2.0]


MESSAGES = "from my_msgs.msg import Parts; from std_msgs.msg import Float32; float64 x; "


@pytest.mark.parametrize("dense", [False, True])
def test_unreadable_field_affects_one_requirement(dense: bool) -> None:  # noqa: FBT001 - a parameter of the test
    scan = "from sensor_msgs.msg import LaserScan; @ topic(s, /scan); "
    near = f"{scan}input LaserScan s; near = s.ranges[0] > 1; far = s.ranges[9] > 1"
    other = scan.replace("(s,", "(front,") + "input LaserScan front; last = front.ranges[1] > 1"
    ros, node = started(near, other, dense=dense)
    assert [subscription.topic for subscription in ros.subscriptions] == ["/scan"]
    for _ in range(3):
        ros.send("/scan", message("sensor_msgs", "LaserScan", ranges=[2.0, 3.0]))
        ros.time += 100 * MS
        ros.tick()
    found = [set(ros.data(f"rtamt/{name}")) for name in ("near", "far", "last")]
    assert found == [{1.0}, set(), {2.0}]
    reason = "s.ranges[9] cannot be read: list index out of range"
    assert [report.problem for report in node.reports] == ["", f"waiting for s; {reason}", ""]
    assert [report.errors for report in node.reports] == [0, 3, 0]
    ros.tick(ros.time + 1000 * MS)
    assert [report.stale for report in node.reports] == [("s",), (), ("front",)]


TWIST = "from geometry_msgs.msg import Twist\ninput Twist cmd\n"
ODOMETRY = "from nav_msgs.msg import Odometry\ninput Odometry o\n"


@pytest.mark.parametrize(
    ("text", "caret", "reason", "hint"),
    [
        (
            f"{TWIST}a = cmd.linear.x > 0\nb = a and cmd.linear.w > 0",
            "w > 0",
            "geometry_msgs/Twist.linear has no field 'w'",
            "its fields are x, y, z",
        ),
        (
            f"{TWIST}// the speed\ncmd.linar.x > 0",
            "linar.x > 0",
            "geometry_msgs/Twist has no field 'linar'",
            "did you mean 'linear'?",
        ),
        (
            f"{TWIST}cmd.linear > 0",
            "linear > 0",
            "expected a number as 'cmd.linear', got a value of type Message",
            "its fields are x, y, z",
        ),
        (
            f"{TWIST}cmd.linear.x > cmd + 1",
            "cmd + 1",
            "expected a field of the message 'cmd', got 'cmd' as a number",
            "write a field, such as cmd.x: a geometry_msgs/Twist is not a number",
        ),
        (
            f"{ODOMETRY}o.header.frame_id > 0",
            "frame_id > 0",
            "expected a number as 'o.header.frame_id', got a value of type str",
            "",
        ),
        (
            f"{TWIST}cmd.linear.x[2] > 0",
            "[2] > 0",
            "geometry_msgs/Twist.linear.x is not a list and has no element [2]",
            "",
        ),
        (
            f"{ODOMETRY}o.child_frame_id[0] > 0",
            "[0] > 0",
            "nav_msgs/Odometry.child_frame_id is not a list and has no element [0]",
            "",
        ),
        *(
            (
                f"{ODOMETRY}o.{of}.covariance > 0",
                "covariance > 0",
                f"expected a number as 'o.{of}.covariance', got a value of type {kind}",
                "",
            )
            for of, kind in (("pose", "list"), ("twist", "ndarray"))
        ),
        (
            f"{MESSAGES}output Parts out\nout = x > 0",
            "out = x > 0",
            "the formula 'out' has the name of a message, but a my_msgs/Parts is not a number",
            "name the formula after a field, such as out.value",
        ),
        (
            f"{MESSAGES}output Parts out\nout.count = x > 0",
            "count = x > 0",
            "expected a floating-point field for a robustness, got my_msgs/Parts.count of type int",
            "",
        ),
        (
            f"{MESSAGES}output Parts out\nout.a = x > 0\nout.d = always(out.a)",
            "d = always(out.a)",
            "my_msgs/Parts has no field 'd'",
            "its fields are header, a, b, inner, count",
        ),
        (
            f"{MESSAGES}output Parts out\nout.inner.f = x > 0\nout.a = always(out.inner.f)",
            "f = x > 0",
            "my_msgs/Parts.inner has no field 'f'",
            "its fields are x, y, z",
        ),
    ],
)
def test_field_errors_show_their_place(
    tmp_path: Path, text: str, caret: str, reason: str, hint: str
) -> None:
    path = tmp_path / "bad.stl"
    path.write_text(text, encoding="utf-8")
    ros = MemoryMiddleware()
    for specification in (text, rtamt.load(path)):
        with pytest.raises(ParseError) as caught:
            MonitorNode(ros, [specification])
        error = caught.value
        assert (error.reason, error.hint) == (reason, hint)
        assert text.split("\n")[error.line - 1][error.column - 1 :] == caret
        in_a_file = isinstance(specification, rtamt.Specification)
        assert getattr(error, "__notes__", []) == ([f"in {path}"] if in_a_file else [])
    assert open_ends(ros) == (0, 0, 0)


@pytest.mark.parametrize(
    ("texts", "text"),
    [
        (
            ["robot.pose.x > 0"],
            (
                "The message 'robot' has no class. Declare one: from PACKAGE.msg "
                "import CLASS, then input CLASS robot"
            ),
        ),
        (
            ["float64 x; @ topic(x, a); x > 0", "int64 y; @ topic(y, a); y > 0"],
            (
                "expected one class of messages on the topic a, got std_msgs/Float64 as 'x' and "
                "std_msgs/Int64 as 'y'"
            ),
        ),
        (
            ["float64 x; @ topic(out, c); out = x > 0", "float64 x; @ topic(p, c); p = x > 1"],
            (
                "expected a topic for 'p' on which nothing else is published, got c; write "
                "another: @ topic(p, PATH)"
            ),
        ),
        (
            ["float64 x; @ topic(x, speed); @ topic(out, speed); out = x > 0"],
            (
                "'out' is published on speed, the topic of its own input 'x'. "
                "Write another topic: @ topic(out, PATH)"
            ),
        ),
        (
            ["always[0:0.25](x > 0)"],
            (
                "STL:1:7: bound 0.25 s is not a multiple of the period 0.1 s (2.5 steps)\n"
                "  always[0:0.25](x > 0)\n        ^\n"
                "  hint: use 0.2 s or 0.3 s, take samples 0.05 s apart, or let align= round it"
            ),
        ),
    ],
)
def test_constructor_refuses_wrong_specifications(texts: list[str], text: str) -> None:
    ros = MemoryMiddleware()
    with pytest.raises(SpecificationError) as error:
        MonitorNode(ros, texts)
    assert str(error.value) == text
    assert open_ends(ros) == (0, 0, 0)


def test_constructor_refuses_missing_classes() -> None:
    ros = MemoryMiddleware(missing={"rtamt_msgs"})
    with pytest.raises(InputError, match="rtamt_msgs is not installed"):
        MonitorNode(ros, [PAPER])
    with pytest.raises(InputError, match="expected one or more specifications, got an empty list"):
        MonitorNode(ros, [])


def test_start_and_stop_are_idempotent() -> None:
    ros = MemoryMiddleware()
    node = MonitorNode(ros, [PAPER])
    assert open_ends(ros) == (0, 0, 0)
    assert (node.running, node.reports) == (False, ())
    node.start()
    node.start()
    assert open_ends(ros) == (7, 2, 1)
    assert ros.timers[0].period == 100 * MS
    tick = ros.timers[0].callback
    node.stop()
    node.stop()
    assert open_ends(ros) == (0, 0, 0)
    assert not node.running
    before = len(ros.published)
    tick(ros.time)  # a waiting callback
    assert len(ros.published) == before


def test_refused_start_leaves_nothing_open() -> None:
    for topic in ("/robot0/odom", "rtamt/c/upper", "/diagnostics"):
        ros = MemoryMiddleware(refused={topic})
        node = MonitorNode(ros, [PAPER])
        with pytest.raises(InputError, match="is refused"):
            node.start()
        assert open_ends(ros) == (0, 0, 0)
        assert not node.running


def test_second_start_resets_monitors() -> None:
    ros, node = started("historically(x > 0)")
    send(ros, "x", 1.0)
    ros.tick()
    node.stop()
    node.start()
    ros.tick(ros.time + 100 * MS)
    assert node.reports[0].text == "waiting for x"
    send(ros, "x", 5.0)
    ros.tick(ros.time + 100 * MS)
    assert ros.data("rtamt/spec") == [1.0, 5.0]
    assert node.reports[0].restarts == 0


def test_refused_replacement_changes_nothing() -> None:
    ros, node = started("historically(x > 0)")
    send(ros, "x", 1.0)
    ros.tick()
    before = node.specifications
    for bad in ("historically(x >", "robot.x > 0", "always[0:0.25](x > 0)"):
        with pytest.raises(SpecificationError):
            node.replace([bad])
    with pytest.raises(InputError):
        node.replace(["from no_msgs.msg import None_; input None_ x; x.y > 0"])
    assert node.specifications is before
    send(ros, "x", 5.0)
    ros.tick(ros.time + 100 * MS)
    assert ros.data("rtamt/spec") == [1.0, 1.0]


def test_replacement_has_new_topics_and_settings() -> None:
    ros, node = started("historically(x > 0)")
    node.replace(["slow = y < 3"], Settings(period=10 * MS))
    assert [subscription.topic for subscription in ros.subscriptions] == ["rtamt/y"]
    assert ros.timers[0].period == node.settings.period == 10 * MS
    node.replace([rtamt.parse("fast = y > 3")])
    assert node.settings.period == 10 * MS
    send(ros, "y", 5.0)
    ros.tick()
    assert ros.data("rtamt/fast") == [2.0]
    assert "rtamt/slow" not in topics(ros)
    ros.refused.add("rtamt/z")
    with pytest.raises(InputError, match="rtamt/z is refused"):
        node.replace(["z > 0"])
    assert node.running
    assert [subscription.topic for subscription in ros.subscriptions] == ["rtamt/y"]
    node.stop()
    node.replace(["z > 0"])
    assert not node.running


@pytest.mark.parametrize("of", ["pose", "twist"])
def test_list_and_array_elements_are_read(of: str) -> None:
    odometry = "from nav_msgs.msg import Odometry; input Odometry o; "
    ros, _ = started(f"{odometry}a = o.{of}.covariance[35] < 1")
    heard = message("nav_msgs", "Odometry")
    getattr(heard, of).covariance[35] = 0.25
    ros.send("rtamt/o", heard)
    ros.tick()
    assert ros.data("rtamt/a") == [0.75]
