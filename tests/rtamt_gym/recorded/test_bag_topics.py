"""Topics and fields of bags, and defaults of variables without a message."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import pytest
from bags import START, Said, twist, write_bag

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled

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
    """Return the values of variables at the first sample; ``__`` in a name is a dot."""
    columns = Columns({name.replace("__", "."): where for name, where in signals.items()})
    trace, _ = read_ruled(
        bag, {"": rtamt.parse(text)}, EvaluationOptions(period=Fraction(1)), columns
    )
    assert isinstance(trace, Trace)
    return {name: float(values[0]) for name, values in trace.columns.items()}


TWIST = "from geometry_msgs.msg import Twist; input Twist cmd; "


def test_absolute_and_relative_topics(bag: str) -> None:
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


def test_list_elements_in_specifications(bag: str) -> None:
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


def test_wrong_message_class_error(bag: str) -> None:
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


TEXT_FIELDS = {
    "{twist}always(cmd.linaer.x > 0)": ("linaer.x > 0)", "did you mean 'linear'?"),
    "{twist}a = cmd.linear.x > 0\nalways(a and cmd.linear.w > 0)": (
        "w > 0)",
        "its fields are x, y, z",
    ),
    "{twist}always(cmd.linear.x.y > 0)": ("y > 0)", ""),
    "{twist}always(cmd.linear > 0)": ("linear > 0)", "write a field of it"),
    "{scan}always(scan.ranges > 0)": ("ranges > 0)", "write an element, such as ranges[0]"),
    "{base}always(b.wheels[4].turn > 0)": ("[4].turn > 0)", ""),
    "{base}always(b.wheels[1].turm > 0)": ("turm > 0)", "did you mean 'turn'?"),
    "{base}always(b.wheels.turn > 0)": ("turn > 0)", "write an element, such as [0].turn"),
}
"""Texts, and for each the text from the caret on, and the hint."""
TOPICS = {
    "twist": "from geometry_msgs.msg import Twist\ninput Twist cmd\n@ topic(cmd, robot0/cmd_vel)\n",
    "scan": "from sensor_msgs.msg import LaserScan\ninput LaserScan scan\n@ topic(scan, scan)\n",
    "base": "from lab_msgs.msg import Base\ninput Base b\n@ topic(b, base)\n",
}


@pytest.mark.parametrize("form", [*TEXT_FIELDS])
def test_field_errors_of_a_text_show_their_place(
    bag: str, form: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, (caret, hint) = form.format(**TOPICS), TEXT_FIELDS[form]
    path = tmp_path / "bad.stl"
    path.write_text(text, encoding="utf-8")
    assert main(["monitor", str(path), bag, "--period", "1s"]) == 2
    error = capsys.readouterr().err
    lines = text.split("\n")
    assert f"in {path}: STL:{len(lines)}:{lines[-1].index(caret) + 1}: " in error
    first_line, shown, arrow, *more = error.splitlines()
    assert f"{Path(bag).name}: " in first_line
    assert shown == f"  {lines[-1]}"
    assert arrow == f"  {' ' * lines[-1].index(caret)}^"
    assert more == ([f"  hint: {hint}"] if hint else [])


def test_a_source_that_cannot_be_read_is_refused(bag: str) -> None:
    for source in ("/scan.ranges[x]", "/scan.", ".x", "/scan..ranges"):
        with pytest.raises(rtamt.InputError) as caught:
            first(bag, "x > 0", x=source)
        assert str(caught.value) == (
            "--signal: expected TOPIC.FIELD, such as /robot0/odom.twist.twist.linear.x, "
            f"got {source!r}"
        )


def test_different_topic_declarations_error(bag: str) -> None:
    both = {
        name: rtamt.parse(f"{TWIST} @ topic(cmd, {topic}); cmd.linear.x > 0")
        for name, topic in (("a", "/robot0/cmd_vel"), ("b", "/robot1/cmd_vel"))
    }
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(bag, both, EvaluationOptions(dense=True), Columns())
    assert str(caught.value) == (
        "expected one topic for 'cmd', which two specifications read, got /robot0/cmd_vel and "
        "/robot1/cmd_vel; rename one variable, or judge the specifications separately"
    )
    both["b"] = rtamt.parse("cmd.linear.x > 3")  # declares nothing of its own
    trace, _ = read_ruled(bag, both, EvaluationOptions(period=Fraction(1)), Columns())
    assert isinstance(trace, Trace)
    assert trace.columns["cmd.linear.x"].tolist() == [1.0]


def test_missing_numbers_error_or_hold(tmp_path: Path) -> None:
    ranges = [[0.5], [float("nan")], [], [0.25], [float("inf")]]
    said = [
        Said(START + i * 10**9, "/scan", "sensor_msgs/LaserScan", {"ranges": each})
        for i, each in enumerate(ranges)
    ]
    path = str(write_bag(tmp_path / "run.mcap", said))
    spec, signals = rtamt.parse("x > 0"), {"x": "/scan.ranges[0]"}
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, {"": spec}, EvaluationOptions(period=Fraction(1)), Columns(signals))
    assert str(caught.value) == (
        f"{path}, message 2 of /scan, recorded at 1 s: expected a number for 'x', got nan; "
        "give --missing hold or --missing drop"
    )
    for columns in (Columns(signals, missing="hold"), Columns(signals, missing="drop")):
        trace, _ = read_ruled(path, {"": spec}, EvaluationOptions(period=Fraction(1)), columns)
        assert isinstance(trace, Trace)
        assert trace.columns["x"].tolist() == [0.5, 0.5, 0.5, 0.25, float("inf")]
        assert [*trace.notes] == ["messages without a number leave the value before (x: 2)"]
    path = str(write_bag(tmp_path / "short.mcap", said[2:3]))
    with pytest.raises(rtamt.InputError, match=r"got a list that is shorter; give --missing hold"):
        read_ruled(path, {"": spec}, EvaluationOptions(period=Fraction(1)), Columns(signals))
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(
            path,
            {"": spec},
            EvaluationOptions(period=Fraction(1)),
            Columns(signals, missing="hold"),
        )
    assert str(caught.value) == (
        f"{path}: expected a number for 'x' in a message of /scan, got none"
    )


TEXT = """
    from geometry_msgs.msg import Twist
    input Twist cmd
    input float64 limit = 0.5
    @ topic(cmd, robot0/cmd_vel)
    @ topic(limit, robot0/limit)
    slow = always(cmd.linear.x < limit)
"""
SPEC = rtamt.parse(TEXT)
RULES = EvaluationOptions(period=Fraction(1))


def bag_defaults(folder: Path, limits: dict[int, float], name: str = "run.mcap") -> str:
    """Return speeds of 0.25 for 5 s, and limits at some seconds."""
    said = [twist(START + i * 10**9, 0.25) for i in range(5)]
    said += [
        Said(START + second * 10**9, "/robot0/limit", "std_msgs/Float64", {"data": limit})
        for second, limit in limits.items()
    ]
    return str(write_bag(folder / name, sorted(said, key=lambda each: each.time)))


@pytest.mark.parametrize(
    ("limits", "values", "note"),
    [
        ({}, [0.5] * 5, "'limit' is 0.5, its default: no message is there"),
        (
            {2: 2.0, 4: 3.0},
            [0.5, 0.5, 2.0, 2.0, 3.0],
            "'limit' of /robot0/limit is 0.5, its default: its first message comes at 2 s",
        ),
        ({0: 2.0}, [2.0] * 5, "/robot0/limit: the message at 0 s is held for 4 s, to the end"),
    ],
)
def test_default_before_first_message(
    tmp_path: Path, limits: dict[int, float], values: list[float], note: str
) -> None:
    path = bag_defaults(tmp_path, limits)
    trace, _ = read_ruled(path, {"": SPEC}, RULES, Columns())
    assert isinstance(trace, Trace)
    assert trace.columns["limit"].tolist() == values
    assert (trace.notes, trace.known_from) == ([note], {})
    dense, _ = read_ruled(path, {"": SPEC}, EvaluationOptions(dense=True), Columns())
    assert isinstance(dense, EventTrace)
    times = [0, *(second for second in limits if second), *([4] * (4 not in limits))]
    held = [values[second] for second in times]
    assert dense.tables["limit"].tolist() == [list(row) for row in zip(times, held, strict=True)]


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("topic", ["/robot0/Limit", "/robot0/limti"])
@pytest.mark.parametrize("reading", [RULES, EvaluationOptions(dense=True)])
def test_misspelt_topic_error(
    topic: str, whole: object, reading: EvaluationOptions, tmp_path: Path
) -> None:
    said = [twist(START + i * 10**9, 0.25) for i in range(5)]
    said.append(Said(START + 10**9, topic, "std_msgs/Float64", {"data": 0.125}))
    path = str(write_bag(tmp_path / "run.mcap", sorted(said, key=lambda each: each.time)))
    spec = SPEC if whole else rtamt.parse(TEXT.replace("@ topic(limit, robot0/limit)", ""))
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, {"": spec}, reading, Columns())
    where = "robot0/limit" if whole else "limit"
    assert str(caught.value) == (
        f"{path}: no topic '{where}', which 'limit' has a default for, but '{topic}'; give "
        f"--signal limit={topic}.FIELD to read it, or --default limit to take the default"
    )
    found, _ = read_ruled(path, {"": spec}, reading, Columns({"limit": f"{topic}.data"}))
    assert found.defaults == {"limit": 0.5}  # up to its first message
    found, _ = read_ruled(path, {"": spec}, reading, Columns(defaults=["limit"]))
    assert found.defaults == {"limit": 0.5}


@pytest.mark.parametrize("limits", [{}, {2: 2.0}])
def test_topic_defaults_error_with_no_defaults(
    limits: dict[int, float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bag_defaults(tmp_path, limits)
    words = ["monitor", TEXT, path, "--period", "1", "--no-defaults"]
    assert main(words) == 2
    assert "expected records of 'limit'" in capsys.readouterr().err
    assert main([*words, "--default", "limit", "--json"]) in (0, 1)
    (trial,) = json.loads(capsys.readouterr().out)["trials"]
    assert trial["outcomes"]["slow"]["defaults"] == {"limit": 0.5}
    assert main(["monitor", TEXT, bag_defaults(tmp_path, {0: 2.0}, "whole.mcap"), *words[3:]]) == 0


def test_missing_requested_topic_error(tmp_path: Path) -> None:
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(
            bag_defaults(tmp_path, {}), {"": SPEC}, RULES, Columns({"limit": "/robot0/limt"})
        )
    assert "no topic '/robot0/limt', which 'limit' reads" in str(caught.value)


def test_defaults_alone_pass_no_gate(tmp_path: Path) -> None:
    path = bag_defaults(tmp_path, {})
    spec = rtamt.parse("input float64 limit = 0.5; always(limit > 0)")
    for rules in (RULES, EvaluationOptions(dense=True)):
        with pytest.raises(rtamt.InputError) as caught:
            read_ruled(path, {"one": SPEC, "alone": spec}, rules, Columns())
        assert str(caught.value) == (
            f"{path}: expected messages with 'limit', got none: defaults alone are not a trace; "
            "the topics are /robot0/cmd_vel"
        )


def test_data_field_has_message_default(tmp_path: Path) -> None:
    declared = "from std_msgs.msg import Float64\ninput Float64 limit = 0.5"
    text = TEXT.replace("input float64 limit = 0.5", declared).replace("< limit", "< limit.data")
    for limits, values in (({}, [0.5] * 5), ({2: 2.0}, [0.5, 0.5, 2.0, 2.0, 2.0])):
        path = bag_defaults(tmp_path, limits)
        trace, _ = read_ruled(path, {"": rtamt.parse(text)}, RULES, Columns())
        assert isinstance(trace, Trace)
        assert trace.columns["limit.data"].tolist() == values


def test_two_defaults_error(tmp_path: Path) -> None:
    other = rtamt.parse(TEXT.replace("= 0.5", "= 0.75"))
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(bag_defaults(tmp_path, {}), {"one": SPEC, "two": other}, RULES, Columns())
    assert str(caught.value) == (
        "expected one default for 'limit', which two specifications read, got 0.5 and 0.75; rename "
        "one variable, or judge the specifications separately"
    )


def test_a_default_is_kept_with_the_outcomes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bag_defaults(tmp_path, {3: 0.125})
    assert main(["monitor", TEXT, path, "--period", "1", "--json"]) == 1
    outcomes = json.loads(capsys.readouterr().out)
    assert outcomes["reading"]["columns"]["starts"] == {"limit": 0.5}
    # The formula of the outcomes has lost its declarations.
    again = rtamt.parse(outcomes["requirements"]["slow"])
    trace, _ = read_ruled(path, {"": again}, RULES, Columns(**outcomes["reading"]["columns"]))
    assert isinstance(trace, Trace)
    assert trace.columns["limit"].tolist() == [0.5, 0.5, 0.5, 0.125, 0.125]
    absent = bag_defaults(tmp_path, {}, "absent.mcap")
    trace, _ = read_ruled(absent, {"": again}, RULES, Columns(**outcomes["reading"]["columns"]))
    assert isinstance(trace, Trace)
    assert trace.columns["limit"].tolist() == [0.5] * 5
