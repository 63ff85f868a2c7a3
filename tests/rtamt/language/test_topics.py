"""The ROS topics of variables and formulas, and the readers of fields."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import rtamt
from rtamt.errors import ParseError
from rtamt.language import SubscribedField
from rtamt.language.topics import publications, subscriptions

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

out.value = always(cmd.linear.x - odom.twist.twist.linear.x <= 0.1 and cmd.angular.z < 1)
"""


def shown(text: str) -> list[tuple[str, str, str, str]]:
    """Return variable, class, topic, and the variables with their paths."""
    return [
        (
            s.variable,
            f"{s.package}/{s.message}",
            s.topic,
            ", ".join(f"{f.variable}: {'.'.join(map(str, f.path))}" for f in s.fields),
        )
        for s in subscriptions(text)
    ]


def test_topics_of_the_paper() -> None:
    assert shown(PAPER) == [
        (
            "cmd",
            "geometry_msgs/Twist",
            "robot0/cmd_vel",
            "cmd.linear.x: linear.x, cmd.angular.z: angular.z",
        ),
        (
            "odom",
            "nav_msgs/Odometry",
            "/robot0/odom",
            "odom.twist.twist.linear.x: twist.twist.linear.x",
        ),
    ]


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("bool", "Bool"),
        ("int", "Int64"),
        ("uint", "UInt64"),
        ("long", "Int64"),
        ("float", "Float64"),
        ("double", "Float64"),
        ("float32", "Float32"),
        ("float64", "Float64"),
        ("int8", "Int8"),
        ("int16", "Int16"),
        ("int32", "Int32"),
        ("int64", "Int64"),
        ("uint8", "UInt8"),
        ("uint16", "UInt16"),
        ("uint32", "UInt32"),
        ("uint64", "UInt64"),
    ],
)
def test_plain_variable_reads_std_msgs(kind: str, message: str) -> None:
    assert shown(f"input {kind} x; @ topic(x, /a/b); x > 0") == [
        ("x", f"std_msgs/{message}", "/a/b", "x: data")
    ]


def test_undeclared_variable_topics() -> None:
    assert shown("x > 0 and robot.pose.x < 1") == [
        ("x", "std_msgs/Float64", "rtamt/x", "x: data"),
        ("robot", "None/None", "rtamt/robot", "robot.pose.x: pose.x"),
    ]


def test_a_message_that_holds_a_number_may_stand_for_it() -> None:
    text = "from std_msgs.msg import Float32; input Float32 x; x > 0 and x.data < 9"
    assert shown(text) == [("x", "std_msgs/Float32", "rtamt/x", "x: data, x.data: data")]


@pytest.mark.parametrize(
    ("package", "message"),
    [("geometry_msgs", "Twist"), ("std_msgs", "Header"), ("other_msgs", "Float32")],
)
def test_message_without_number_error(package: str, message: str) -> None:
    with pytest.raises(ParseError) as error:
        subscriptions(f"from {package}.msg import {message}; input {message} cmd; cmd > 0")
    text = f"from {package}.msg import {message}; input {message} cmd; cmd > 0"
    assert (error.value.reason, error.value.hint) == (
        "expected a field of the message 'cmd', got 'cmd' as a number",
        f"write a field, such as cmd.x: a {package}/{message} is not a number",
    )
    assert text[error.value.column - 1 :] == "cmd > 0"


def test_subscriptions_cover_all_formulas() -> None:
    spec = rtamt.parse("float a; float b; float c; p = a > 0; q = always(b > 0)")
    assert [s.variable for s in subscriptions(spec)] == ["a", "b"]
    assert [s.variable for s in subscriptions(spec.requirements["q"])] == ["b"]
    assert [s.variable for s in subscriptions(spec.formula)] == ["b"]


MESSAGE = SimpleNamespace(
    ranges=np.array([0.5, 1.5]), rows=[SimpleNamespace(x=[1, (2, 3)])], head=SimpleNamespace(x=4)
)


@pytest.mark.parametrize(
    ("path", "value"),
    [(("head", "x"), 4), (("ranges", 1), 1.5), (("rows", 0, "x", 1, 0), 2)],
)
def test_a_reader_follows_fields_and_elements(path: tuple[str | int, ...], value: float) -> None:
    assert SubscribedField("x", path).read(MESSAGE) == value


def test_a_reader_says_what_is_missing() -> None:
    with pytest.raises(AttributeError, match="nothing"):
        SubscribedField("x", ("head", "nothing")).read(MESSAGE)
    with pytest.raises(IndexError):
        SubscribedField("x", ("ranges", 2)).read(MESSAGE)
    with pytest.raises(TypeError):
        SubscribedField("x", ("head", 0)).read(MESSAGE)


TEXT = """
from rtamt_msgs.msg import FloatStamped
from std_msgs.msg import Float32
from nav_msgs.msg import Odometry
output FloatStamped out
output Float32 plain
output Odometry whole
input float64 x
@ topic(out, monitor/out)
@ topic(near, /near)
@ topic(x, speed)
near = x < 1
plain = x < 2
whole = x < 3
whole.twist.twist.linear.x = x < 4
a.b = x < 5
out.value = always(near and plain and whole and whole.twist.twist.linear.x and a.b)
"""


def test_the_text_says_topics_messages_and_fields() -> None:
    published = [(p.formula, p.variable, p.topic, p.default, p.path) for p in publications(TEXT)]
    twist = "whole.twist.twist.linear.x"
    assert published == [
        ("near", "near", "/near", "rtamt/near", ("data",)),
        ("plain", "plain", None, "rtamt/plain", ("data",)),
        ("whole", "whole", None, "rtamt/whole", ()),  # not a number
        (twist, "whole", None, "rtamt/whole", ("twist", "twist", "linear", "x")),
        ("a.b", "a.b", None, "rtamt/a/b", ("data",)),
        ("out.value", "out", "monitor/out", "rtamt/out", ("value",)),
    ]
    assert [f"{p.package}/{p.message}" for p in publications(TEXT)] == [
        "std_msgs/Float64",
        "std_msgs/Float32",
        "nav_msgs/Odometry",
        "nav_msgs/Odometry",
        "std_msgs/Float64",
        "rtamt_msgs/FloatStamped",
    ]


@pytest.mark.parametrize(
    ("text", "name", "default"),
    [
        ("always(x > 1)", None, "rtamt/spec"),
        ("specification whole\nalways(x > 1)", None, "rtamt/whole"),
        ("always(x > 1)", "3-d.x", "rtamt/_3_d/x"),
        ("always(x > 1)", "wärme", "rtamt/w_rme"),
        ("kept = always(x > 1)", None, "rtamt/kept"),
        ("kept = always(x > 1)", "kept_2", "rtamt/kept_2"),
        ("same = x > 1; kept = same", "kept_2", "rtamt/kept_2"),
    ],
)
def test_the_result_is_last_and_may_be_given_a_name(
    text: str, name: str | None, default: str
) -> None:
    assert publications(text, name)[-1].default == default


def test_unnamed_result_topic() -> None:
    text = "input float64 speed\n@ topic(speed, /robot/speed)\nalways(speed < 3)"
    (published,) = publications(text, "speed")
    assert (published.formula, published.topic, published.default) == ("", None, "rtamt/speed")
