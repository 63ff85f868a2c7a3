"""The copy of a bag has its messages, and the results at the times of the samples."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import START, Said, message, store_of, twist, write_bag
from command_line import run_unread
from memory_middleware import MemoryMiddleware
from memory_nodes import topics
from rosbags.highlevel import AnyReader
from rosbags.rosbag1 import Writer

import rtamt
from rtamt import EpisodeMonitor, Verdict
from rtamt_gym.__main__ import main
from rtamt_ros.node import MonitorNode

SPEC = """
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rtamt_msgs.msg import FloatStamped
input Twist cmd
input Odometry odom
output FloatStamped out
@ topic(cmd, robot0/cmd_vel)
@ topic(odom, /robot0/odom)
@ topic(out, monitor/out)
near = abs(cmd.linear.x - odom.twist.twist.linear.x) <= 0.3
out.value = always(not near implies eventually[0:0.5](near))
slow = eventually(cmd.linear.x > 0.9)
"""
N = 60
STEP = 10**8
COMMANDS = np.sin(np.arange(N) / 5).tolist()
SPEEDS = np.sin((np.arange(N) - 2) / 5).tolist()


def odometry(i: int) -> Said:
    header = {"frame_id": "odom", "stamp": {"sec": i, "nanosec": 5}}
    fields = {"header": header, "twist": {"twist": {"linear": {"x": SPEEDS[i]}}}}
    return Said(START + i * STEP, "/robot0/odom", "nav_msgs/Odometry", fields)


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "spec.stl"
    path.write_text(SPEC)
    return path


def recorded(tmp_path: Path, extension: str) -> Path:
    said = [twist(START + i * STEP, COMMANDS[i]) for i in range(N)]
    said += [odometry(i) for i in range(N)]
    others = [Said(START + 7, "/name", "std_msgs/String", {"data": "ann"})]
    said = sorted([*said, *others], key=lambda each: each.time)
    return write_bag(tmp_path / f"run{extension}", said, silent=[("/lamp", "std_msgs/Bool")])


def messages(path: Path) -> dict[str, list[tuple[int, Any]]]:
    """Return times and messages of every topic."""
    found: dict[str, list[tuple[int, Any]]] = {}
    with AnyReader([path]) as reader:
        for each in reader.connections:
            found[each.topic] = []
        for connection, time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found[connection.topic].append((time, message))
    return found


@pytest.mark.parametrize("dense", [False, True])
def test_states_change_at_violations(spec: Path, tmp_path: Path, *, dense: bool) -> None:
    bag, copy = recorded(tmp_path, ".mcap"), tmp_path / "copy.mcap"
    command = ["monitor", str(spec), str(bag), "--write-mcap", str(copy), "--occurrences"]
    assert main([*command, *(["--dense"] if dense else ["--period", "100ms"])]) == 1
    near = np.abs(np.array(COMMANDS) - np.array(SPEEDS)) <= 0.3
    late = [not (near[i] or near[i : i + 6].any()) for i in range(N)]
    known = [near[i] or i + 5 < N for i in range(N)]  # 0.5 s of samples follow
    words = np.where(~np.array(known), "unknown", np.where(late, "violated", "satisfied"))
    changes = [i for i in range(N) if i == 0 or words[i] != words[i - 1]]
    said = [(time, each.data) for time, each in messages(copy)["/monitor/out/state"]]
    assert len(said) > 3
    if not dense:
        assert said == [(START + i * STEP, words[i]) for i in changes]
    assert {text for _, text in said} <= {"satisfied", "violated", "unknown"}


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("extension", [".mcap", ".db3", ".bag", ""])
def test_copy_contains_messages_and_results(
    extension: str, spec: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, copy = recorded(tmp_path, extension), tmp_path / "copy.mcap"
    command = ["monitor", str(spec), str(bag), "--period", "100ms", "--write-mcap", str(copy)]
    assert main(command) == 1
    lines = " ".join(capsys.readouterr().out.split())
    assert lines.endswith(
        f"copy of the bag: {copy}, with /rtamt/near, /monitor/out, /monitor/out/verdict, "
        "/rtamt/slow, /rtamt/slow/verdict"
    )
    before, after = messages(bag), messages(copy)
    assert [*after][: len(before)] == [*before]
    assert after["/lamp"] == []
    assert [m.data for _, m in after["/name"]] == ["ann"]
    for topic in before:
        assert [time for time, _ in after[topic]] == [time for time, _ in before[topic]]
    assert [m.linear.x for _, m in after["/robot0/cmd_vel"]] == COMMANDS
    assert [m.twist.twist.linear.x for _, m in after["/robot0/odom"]] == SPEEDS
    stamps = [(m.header.stamp.sec, m.header.frame_id) for _, m in after["/robot0/odom"]]
    assert stamps == [(i, "odom") for i in range(N)]

    text = rtamt.parse(SPEC)
    columns = {"cmd.linear.x": COMMANDS, "odom.twist.twist.linear.x": SPEEDS}
    times = [START + i * STEP for i in range(N)]
    for requirement, topic, field in (
        ("out.value", "/monitor/out", "value"),
        ("slow", "/rtamt/slow", "data"),
    ):
        part = text.requirements[requirement]
        robustness = rtamt.evaluate(part, columns, 0.1)
        assert [time for time, _ in after[topic]] == times
        assert [getattr(m, field) for _, m in after[topic]] == robustness.tolist()
        monitor = EpisodeMonitor(part, 0.1)
        verdicts = []
        for i in range(N):
            monitor.update({name: columns[name][i] for name in part.variables})
            verdicts.append(monitor.verdict)
        verdicts[-1] = rtamt.judge(part, columns, 0.1).verdict
        signs = {Verdict.VIOLATED: -1, Verdict.UNDECIDED: 0, Verdict.SATISFIED: 1}
        said = [m.data for _, m in after[f"{topic}/verdict"]]
        assert said == [signs[verdict] for verdict in verdicts]
        assert [time for time, _ in after[f"{topic}/verdict"]] == times
    near = rtamt.evaluate(text.with_result(text.formulas["near"]), columns, 0.1)
    assert [m.data for _, m in after["/rtamt/near"]] == near.tolist()
    stamped = [m.header.stamp for _, m in after["/monitor/out"]]
    assert [s.sec * 10**9 + s.nanosec for s in stamped] == times

    assert main(["monitor", str(spec), str(copy), "--period", "100ms"]) == 1
    again = capsys.readouterr().out.replace(str(copy), str(bag))
    assert " ".join(again.split()) == lines.partition(" copy of the bag")[0]
    assert main([*command[:2], str(copy), *command[3:-1], str(tmp_path / "twice.mcap")]) == 1
    topics = messages(tmp_path / "twice.mcap")
    assert len(topics["/monitor/out"]) == len(topics["/monitor/out/offline"]) == N
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(
        ["copy.mcap", bag.name, "spec.stl", "twice.mcap"]
    )


@pytest.mark.slow
def test_copy_survives_closed_stdout(spec: Path, tmp_path: Path) -> None:
    bag, copy = recorded(tmp_path, ".mcap"), tmp_path / "copy.mcap"
    command = ["monitor", str(spec), str(bag), "--period", "100ms", "--write-mcap", str(copy)]
    assert run_unread(command, tmp_path) == (141, b"")
    assert len(messages(copy)["/rtamt/slow"]) == N


def test_what_every_reader_needs_is_in_the_copy(spec: Path, tmp_path: Path) -> None:
    bag, copy = recorded(tmp_path, ".bag"), tmp_path / "copy.mcap"
    main(["monitor", str(spec), str(bag), "--period", "0.1", "--write-mcap", str(copy)])
    with AnyReader([copy]) as reader:
        kinds = {each.topic: each.msgtype for each in reader.connections}
        texts = {each.topic: each.msgdef.data for each in reader.connections}
        assert reader.message_count == 2 * N + 1 + 5 * N
        assert {each.ext.serialization_format for each in reader.connections} == {"cdr"}  # type: ignore[union-attr]
        header = reader.typestore.fielddefs["std_msgs/msg/Header"][1]
    assert [name for name, _ in header] == ["stamp", "frame_id"]  # ROS 1 has seq too
    assert kinds["/rtamt/near"] == "std_msgs/msg/Float64"
    assert kinds["/rtamt/slow/verdict"] == "std_msgs/msg/Int8"
    assert kinds["/monitor/out"] == "rtamt_msgs/msg/FloatStamped"
    assert texts["/rtamt/near"] == "float64 data\n"
    assert texts["/monitor/out"].startswith("std_msgs/Header header\nfloat64 value\n===")


def test_dense_robustness_keeps_event_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = [twist(START, 1.0), twist(START + 3 * STEP, 3.0), twist(START + 20 * STEP, 1.0)]
    bag = write_bag(tmp_path / "run.mcap", said)
    command = [
        "monitor",
        "fine = always(x < 2)",
        str(bag),
        "--signal",
        "x=/robot0/cmd_vel.linear.x",
    ]
    copy = tmp_path / "copy.mcap"
    assert main([*command, "--dense", "--write-mcap", str(copy)]) == 1
    capsys.readouterr()
    found = messages(copy)
    robustness = [(time, m.data) for time, m in found["/rtamt/fine"]]
    # From the third event on only the value 1 is left.
    assert robustness == [(START, -1.0), (START + 20 * STEP, 1.0)]
    verdicts = [(time - START, m.data) for time, m in found["/rtamt/fine/verdict"]]
    assert verdicts == [(0, 0), (3 * STEP, -1), (20 * STEP, -1)]


def test_copy_needs_a_bag_and_a_new_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = recorded(tmp_path, "")
    table = tmp_path / "run.csv"
    table.write_text("time,x\n0,1\n1,2\n")
    more = tmp_path / "more.csv"
    more.write_text("time,x\n0,1\n1,2\n")
    for traces, out, words in (
        (
            [str(table)],
            "copy.mcap",
            f"--write-mcap copies a bag, got {table}; --out writes the robustness of any trace",
        ),
        (
            [str(bag)],
            "copy.db3",
            f"cannot write {tmp_path}/copy.db3: expected a name that ends in .mcap",
        ),
        ([str(bag)], "run/run.mcap", f"cannot write {bag}/run.mcap: it is in the bag that is read"),
        (
            ["--", str(table), str(more)],
            "copy.mcap",
            "expected one trace for --write-mcap, got 2",
        ),
    ):
        command = ["monitor", "--write-mcap", str(tmp_path / out), "always(x < 9)", *traces]
        assert main(command) == 2
        assert capsys.readouterr().err == f"rtamt: error: {words}\n"


def test_failed_copy_leaves_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag, copy, store = tmp_path / "run.bag", tmp_path / "copy.mcap", store_of(1, {})
    kind = "geometry_msgs/msg/Twist"
    with Writer(bag) as writer:
        to = writer.add_connection("/robot0/cmd_vel", kind, typestore=store)
        other = writer.add_connection("/name", "std_msgs/msg/String", typestore=store)
        for i in range(3):
            raw = store.serialize_ros1(message(store, kind, {}), kind)
            writer.write(to, START + i * STEP, raw)
        writer.write(other, START + STEP, b"\xff\xff\xff\x7fann")  # a text longer than the message
    command = ["monitor", "always(x < 9)", str(bag), "--signal", "x=/robot0/cmd_vel.linear.x"]
    assert main([*command, "--period", "0.1"]) == 0
    capsys.readouterr()
    assert main([*command, "--period", "0.1", "--write-mcap", str(copy)]) == 2
    said = (
        f"rtamt: error: {bag}: expected a whole bag of ROS 1, got an error: Invalid string length"
    )
    assert capsys.readouterr().err.startswith(said)
    assert not copy.exists()


def test_names_of_topics_have_letters_of_ros(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "run.bag", [twist(START + i * STEP, 1.0) for i in range(3)])
    (tmp_path / "3-d.stl").write_text("limit = x < 2; always(limit)\n")
    (tmp_path / "b.stl").write_text("limit = x < 22; always(limit)\n")
    specs = [f"{tmp_path}/3-d.stl", f"{tmp_path}/b.stl"]
    copy = tmp_path / "copy.mcap"
    command = ["monitor", *specs, str(bag), "--signal", "x=robot0/cmd_vel.linear.x"]
    assert main([*command, "--period", "0.1", "--write-mcap", str(copy)]) == 0
    capsys.readouterr()
    assert [*messages(copy)] == [
        "/robot0/cmd_vel",
        "/rtamt/limit",
        "/rtamt/_3_d",
        "/rtamt/_3_d/verdict",
        "/rtamt/b/limit",
        "/rtamt/b",
        "/rtamt/b/verdict",
    ]


def test_shared_topics_keep_all_results(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "run.bag", [twist(START + i * STEP, 1.0) for i in range(3)])
    declared = "from my_msgs.msg import Parts\noutput Parts out\n@ topic(out, /safe)\n"
    (tmp_path / "a.stl").write_text(f"{declared}out.a = x < 3\nout.b.c = always(out.a)\n")
    for name, bound in (("b", 2), ("c", 5)):
        topics_of = f"@ topic(near, n)\n@ topic({name}, m)\n"
        text = f"{topics_of}near = x < {bound}\n{name} = always(near)\n"
        (tmp_path / f"{name}.stl").write_text(text)
    specs = [f"{tmp_path}/{name}.stl" for name in "abc"]
    copy = tmp_path / "copy.mcap"
    command = ["monitor", *specs, str(bag), "--signal", "x=robot0/cmd_vel.linear.x"]
    assert main([*command, "--period", "0.1", "--write-mcap", str(copy)]) == 0
    found = messages(copy)
    robustness = {
        topic: said[0][1].data
        for topic, said in found.items()
        if topic != "/robot0/cmd_vel" and "verdict" not in topic
    }
    assert robustness == {
        "/safe/a": 2.0,
        "/safe/b/c": 2.0,
        "/n": 1.0,
        "/m": 1.0,
        "/rtamt/c/near": 4.0,
        "/rtamt/c": 4.0,
    }
    assert {topic for topic in found if "verdict" in topic} == {
        "/safe/b/c/verdict",
        "/m/verdict",
        "/rtamt/c/verdict",
    }


def test_a_copy_has_the_topics_of_a_node(spec: Path, tmp_path: Path) -> None:
    ros = MemoryMiddleware()
    text = spec.read_text().replace("FloatStamped", "FloatMessage")
    spec.write_text(f"{text}out.value = slow\n".replace("out.value = always", "kept = always"))
    node = MonitorNode(ros, [rtamt.load(spec)])
    node.start()
    copy = tmp_path / "copy.mcap"
    bag = recorded(tmp_path, ".mcap")
    words = [*("monitor", str(spec), str(bag), "--period", "0.1"), "--occurrences"]
    main([*words, "--write-mcap", str(copy)])
    with AnyReader([copy]) as reader:
        added = {each.topic for each in reader.connections}
    with AnyReader([bag]) as reader:
        added -= {each.topic for each in reader.connections}
    published = {f"/{topic}" for topic in topics(ros)} - {"//diagnostics"}
    assert added == {topic for topic in published if not topic.endswith(("/lower", "/upper"))}


def test_simulated_stamps_use_recording_times(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "run.mcap", [odometry(i) for i in range(10)])
    copy = tmp_path / "copy.mcap"
    source = "x=/robot0/odom.twist.twist.linear.x"
    command = ["monitor", "f = always(x < 9)", str(bag), "--signal", source, "--dense"]
    assert main([*command, "--time", "header", "--write-mcap", str(copy)]) == 0
    capsys.readouterr()
    found = [time for time, _ in messages(copy)["/rtamt/f/verdict"]]
    # The stamps are a second apart and the messages 0.1 s: the middle ones overlap.
    assert abs(found[0] - START) < 5 * 10**9
    assert found[-1] - found[0] == 9 * 10**9


def test_undefined_classes_are_omitted_with_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = {"lab_msgs/Wheel": "float32 turn\n"}
    said = [twist(START, 1.0), Said(START + 5, "/wheel", "lab_msgs/Wheel", {"turn": 1.0})]
    bag = write_bag(tmp_path / "run.db3", said, definitions=own)
    with sqlite3.connect(bag) as database:
        database.execute("DROP TABLE message_definitions")
        database.execute("DROP TABLE schema")
    database.close()
    copy = tmp_path / "copy.mcap"
    command = ["monitor", "f = always(x < 9)", str(bag), "--signal", "x=/robot0/cmd_vel.linear.x"]
    assert main([*command, "--dense", "--write-mcap", str(copy)]) == 0
    assert " ".join(capsys.readouterr().out.split()).endswith(
        "with /rtamt/f, /rtamt/f/verdict; without /wheel, whose classes the bag does not define"
    )
    assert [*messages(copy)] == ["/robot0/cmd_vel", "/rtamt/f", "/rtamt/f/verdict"]
    assert main([*command[:-1], "x=/wheel.turn", "--dense"]) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: {bag}: /wheel (lab_msgs/Wheel): the bag does not define lab_msgs/Wheel\n"
    )
