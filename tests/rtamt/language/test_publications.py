"""On which topic, and as which field of which message, the robustness of a formula is published."""

from __future__ import annotations

import pytest

from rtamt.language.topics import publications

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
    found = [(p.formula, p.variable, p.topic, p.default, p.path) for p in publications(TEXT)]
    twist = "whole.twist.twist.linear.x"
    assert found == [
        ("near", "near", "/near", "rtamt/near", ("data",)),
        ("plain", "plain", None, "rtamt/plain", ("data",)),
        ("whole", "whole", None, "rtamt/whole", ()),  # no number
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


def test_a_result_without_a_name_takes_no_topic_of_a_variable_of_that_name() -> None:
    text = "input float64 speed\n@ topic(speed, /robot/speed)\nalways(speed < 3)"
    (found,) = publications(text, "speed")
    assert (found.formula, found.topic, found.default) == ("", None, "rtamt/speed")
