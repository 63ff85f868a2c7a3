"""Which topics and fields of a bag a specification means, and what is said where there are none."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import pytest
from bags import START, Said, twist, write_bag

import rtamt
from rtamt_gym import Reading
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.ruled import read_ruled
from rtamt_gym.recorded.trace import Trace

CUSTOM = {
    "lab_msgs/Wheel": "float32 turn\n",
    "lab_msgs/Base": "lab_msgs/Wheel[4] wheels\nint8 on\n",
}
WHEELS = [{"turn": 1.5}, {"turn": 2.5}, {"turn": 3.5}, {"turn": 4.5}]


@pytest.fixture(scope="module", params=[".mcap", ".db3", ".bag"])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("bags") / f"run{request.param}"
    said = [
        twist(START, 1.0),
        twist(START, 2.0, "/robot1/cmd_vel"),
        Said(START, "/scan", "sensor_msgs/LaserScan", {"ranges": [0.5, 0.75]}),
        Said(START, "/limit", "std_msgs/Float32", {"data": 8.0}),
        Said(START, "/on", "std_msgs/Bool", {"data": True}),
        Said(START, "/name", "std_msgs/String", {"data": "ann"}),
        Said(START, "/base", "lab_msgs/Base", {"wheels": WHEELS, "on": 1}),
        Said(START, "/rtamt/battery", "std_msgs/UInt8", {"data": 99}),
    ]
    silent = [("/lamp", "std_msgs/Bool")]
    return str(write_bag(path, said, definitions=CUSTOM, silent=silent))


def first(bag: str, text: str, **signals: str) -> dict[str, float]:
    """The values of the variables of a text at the first sample; ``__`` in a name is a dot."""
    columns = Columns({name.replace("__", "."): where for name, where in signals.items()})
    trace, _ = read_ruled(bag, {"": rtamt.parse(text)}, Reading(period=Fraction(1)), columns)
    assert isinstance(trace, Trace)
    return {name: float(values[0]) for name, values in trace.columns.items()}


TWIST = "from geometry_msgs.msg import Twist; input Twist cmd; "


def test_topics_are_absolute_or_relative_to_any_namespace(bag: str) -> None:
    for topic, speed in (
        ("/robot0/cmd_vel", 1.0),
        ("robot0/cmd_vel", 1.0),
        ("robot1/cmd_vel", 2.0),
        ("/robot1/cmd_vel", 2.0),
    ):
        text = f"{TWIST} @ topic(cmd, {topic}); cmd.linear.x > 0"
        assert first(bag, text) == {"cmd.linear.x": speed}
    assert first(bag, "float y; @ topic(y, battery); y > 0") == {"y": 99.0}
    assert first(bag, "battery > 0") == {"battery": 99.0}


def test_signals_name_topics_and_fields(bag: str) -> None:
    assert first(bag, "x > 0", x="/robot1/cmd_vel.linear.x") == {"x": 2.0}
    assert first(bag, "x > 0", x="robot1/cmd_vel.linear.x") == {"x": 2.0}
    assert first(bag, "x > 0", x="/limit") == {"x": 8.0}
    assert first(bag, "x > 0", x="/on.data") == {"x": 1.0}
    assert first(bag, "x > 0", x="/scan.ranges[1]") == {"x": 0.75}
    assert first(bag, "x > 0", x="/base.wheels[3].turn") == {"x": 4.5}
    text = f"{TWIST} @ topic(cmd, /gone); cmd.linear.x > 0 and cmd.linear.y < 9"
    both = {"cmd.linear.x": 2.0, "cmd.linear.y": 0.0}
    assert first(bag, text, cmd="/robot1/cmd_vel") == both
    assert first(bag, text, cmd="/robot1/cmd_vel", cmd__linear__y="/limit") == {
        "cmd.linear.x": 2.0,
        "cmd.linear.y": 8.0,
    }
    assert first(bag, "v.x > 0", v="/robot1/cmd_vel.linear") == {"v.x": 2.0}


def test_elements_of_lists_are_written_in_the_text(bag: str) -> None:
    text = (
        "from sensor_msgs.msg import LaserScan; input LaserScan scan; @ topic(scan, /scan);"
        "scan.ranges[0] < scan.ranges[1]"
    )
    assert first(bag, text) == {"scan.ranges[0]": 0.5, "scan.ranges[1]": 0.75}
    text = "from lab_msgs.msg import Base; input Base b; @ topic(b, base); b.wheels[2].turn > b.on"
    assert first(bag, text) == {"b.wheels[2].turn": 3.5, "b.on": 1.0}


def refused(bag: str, text: str, **signals: str) -> str:
    with pytest.raises(rtamt.InputError) as caught:
        first(bag, text, **signals)
    message = str(caught.value)
    assert message.startswith(f"{bag}: ")
    return message.removeprefix(f"{bag}: ")


def test_what_is_not_there_is_named_with_what_is(bag: str) -> None:
    text = f"{TWIST} @ topic(cmd, robot0/cmd_wel); cmd.linear.x > 0"
    topics = (
        "the topics are /base, /lamp, /limit, /name, /on, /robot0/cmd_vel, /robot1/cmd_vel, "
        "/rtamt/battery, /scan"
    )
    assert refused(bag, text) == (
        f"no topic 'robot0/cmd_wel', which 'cmd' reads; {topics}; did you mean '/robot0/cmd_vel'?"
    )
    assert refused(bag, f"{TWIST} cmd.linear.x > 0") == (
        f"no topic 'rtamt/cmd', which 'cmd' reads; {topics}; give --signal cmd=TOPIC"
    )
    laser = "from sensor_msgs.msg import LaserScan; input LaserScan front; front.ranges[0] > 0"
    assert refused(bag, laser) == (
        f"no topic 'rtamt/front', which 'front' reads; {topics}; give --signal front=/scan"
    )
    assert refused(bag, "limit < 3") == (
        f"no topic 'rtamt/limit', which 'limit' reads; {topics}; give --signal limit=/limit"
    )
    assert refused(bag, "speed < 3") == (
        f"no topic 'rtamt/speed', which 'speed' reads; {topics}; give --signal speed=TOPIC.FIELD"
    )
    assert refused(bag, f"{TWIST} @ topic(cmd, cmd_vel); cmd.linear.x > 0") == (
        "expected one topic that ends in '/cmd_vel', which 'cmd' reads, got /robot0/cmd_vel, "
        "/robot1/cmd_vel; give --signal cmd=TOPIC"
    )
    assert refused(bag, "bool lamp; @ topic(lamp, /lamp); lamp > 0") == (
        "expected messages on /lamp, which 'lamp' reads, got none"
    )


def test_messages_of_another_class_than_declared_are_refused(bag: str) -> None:
    text = "from geometry_msgs.msg import TwistStamped; input TwistStamped cmd; "
    assert refused(bag, f"{text} @ topic(cmd, robot0/cmd_vel); cmd.twist.linear.x > 0") == (
        "expected geometry_msgs/TwistStamped on /robot0/cmd_vel, as 'cmd' is declared, got "
        "geometry_msgs/Twist"
    )
    assert refused(bag, "float x; @ topic(x, /robot0/cmd_vel); x > 0") == (
        "expected std_msgs/Float64 on /robot0/cmd_vel, as 'x' is declared, got geometry_msgs/Twist"
    )
    assert refused(bag, f"{TWIST} cmd.x > 0", cmd="/robot0/cmd_vel.linear") == (
        "expected geometry_msgs/Twist on 'linear' of /robot0/cmd_vel, as 'cmd' is declared, got "
        "geometry_msgs/Vector3"
    )


TWIST_AT = "/robot0/cmd_vel (geometry_msgs/Twist)"
SCAN_AT = "/scan (sensor_msgs/LaserScan)"
BASE_AT = "/base (lab_msgs/Base)"
FIELDS = {
    "/robot0/cmd_vel": "expected a field of the messages on /robot0/cmd_vel, each a "
    "geometry_msgs/Twist, for 'x', got none; give --signal x=/robot0/cmd_vel.FIELD; its fields are "
    "linear, angular",
    "/robot0/cmd_vel.linaer.x": f"{TWIST_AT} has no field 'linaer'; did you mean 'linear'?",
    "/robot0/cmd_vel.linear.w": f"'linear' of {TWIST_AT} has no field 'w'; its fields are x, y, z",
    "/robot0/cmd_vel.linear.x.y": f"'linear.x' of {TWIST_AT} is no message, got field 'y'",
    "/robot0/cmd_vel.linear[0]": f"'linear' of {TWIST_AT} is no list, got element [0]",
    "/robot0/cmd_vel.linear": "expected a number for 'x', got 'linear' of /robot0/cmd_vel, "
    "a geometry_msgs/Vector3; write a field of it",
    "/scan.ranges": f"expected a number in 'ranges' of {SCAN_AT}, got a list; "
    "write an element, such as ranges[0]",
    "/base.wheels.turn": f"'wheels' of {BASE_AT} is a list; write an element, such as [0].turn",
    "/base.wheels[4].turn": f"'wheels' of {BASE_AT} ends with element [3], got [4]",
    "/name.data": "expected a number in 'data' of /name (std_msgs/String), got text",
    "/name": "expected a number in 'data' of /name (std_msgs/String), got text",
}


@pytest.mark.parametrize("source", [*FIELDS])
def test_a_field_that_is_no_number_is_refused(bag: str, source: str) -> None:
    assert refused(bag, "x > 0", x=source) == FIELDS[source]


def test_a_source_that_cannot_be_read_is_refused(bag: str) -> None:
    for source in ("/scan.ranges[x]", "/scan.", ".x", "/scan..ranges"):
        with pytest.raises(rtamt.InputError) as caught:
            first(bag, "x > 0", x=source)
        assert str(caught.value) == (
            "--signal: expected TOPIC.FIELD, such as /robot0/odom.twist.twist.linear.x, "
            f"got {source!r}"
        )


def test_specifications_that_differ_in_a_topic_are_refused(bag: str) -> None:
    both = {
        name: rtamt.parse(f"{TWIST} @ topic(cmd, {topic}); cmd.linear.x > 0")
        for name, topic in (("a", "/robot0/cmd_vel"), ("b", "/robot1/cmd_vel"))
    }
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(bag, both, Reading(dense=True), Columns())
    assert str(caught.value) == (
        "expected one topic for 'cmd', which two specifications read, got /robot0/cmd_vel and "
        "/robot1/cmd_vel; give one of them another name, or judge them one at a time"
    )
    both["b"] = rtamt.parse("cmd.linear.x > 3")  # says nothing of its own
    trace, _ = read_ruled(bag, both, Reading(period=Fraction(1)), Columns())
    assert isinstance(trace, Trace)
    assert trace.columns["cmd.linear.x"].tolist() == [1.0]


def test_numbers_that_are_missing_are_refused_or_leave_the_value_before(tmp_path: Path) -> None:
    ranges = [[0.5], [float("nan")], [], [0.25], [float("inf")]]
    said = [
        Said(START + i * 10**9, "/scan", "sensor_msgs/LaserScan", {"ranges": each})
        for i, each in enumerate(ranges)
    ]
    path = str(write_bag(tmp_path / "run.mcap", said))
    spec, signals = rtamt.parse("x > 0"), {"x": "/scan.ranges[0]"}
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, {"": spec}, Reading(period=Fraction(1)), Columns(signals))
    assert str(caught.value) == (
        f"{path}, message 2 of /scan, recorded at 1 s: expected a number for 'x', got nan; "
        "give --missing hold or --missing drop"
    )
    for columns in (Columns(signals, missing="hold"), Columns(signals, missing="drop")):
        trace, _ = read_ruled(path, {"": spec}, Reading(period=Fraction(1)), columns)
        assert isinstance(trace, Trace)
        assert trace.columns["x"].tolist() == [0.5, 0.5, 0.5, 0.25, float("inf")]
        assert [*trace.notes] == ["messages without a number leave the value before (x: 2)"]
    path = str(write_bag(tmp_path / "short.mcap", said[2:3]))
    with pytest.raises(rtamt.InputError, match=r"got a list that is shorter; give --missing hold"):
        read_ruled(path, {"": spec}, Reading(period=Fraction(1)), Columns(signals))
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, {"": spec}, Reading(period=Fraction(1)), Columns(signals, missing="hold"))
    assert str(caught.value) == (
        f"{path}: expected a number for 'x' in a message of /scan, got none"
    )
