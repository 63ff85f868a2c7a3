"""ROS 1 satisfies the contract of every middleware, and these properties of its own."""

import re
import signal
import subprocess
import sys
import xmlrpc.client
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import genmsg.gentools
import genmsg.msg_loader
import pytest
import rosgraph.names
from hypothesis import given
from hypothesis import strategies as st
from paths import ROOT
from ros_contract import FLOAT, MS, SECOND, MiddlewareContract, heard
from ros_messages import STORES, probe
from ros_processes import PATIENCE, Ros, free_port, ros
from ros_world import World

from rtamt import InputError
from rtamt_ros.ros1 import Ros1, legal_name

STAMPED = "rtamt_msgs/FloatStamped"
MD5 = "d053817de0764f9ee90dbc89c4cdd751"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    folder, simulated = (tmp_path_factory.mktemp(name) for name in ("ros", "simulated"))
    with ros(1, folder) as wall, ros(1, simulated) as simulation:
        with xmlrpc.client.ServerProxy(simulation.environment["ROS_MASTER_URI"]) as master:
            master.setParam("/tests", "/use_sim_time", 1)
        with World(wall, simulation) as found:
            yield found


class TestRos1Middleware(MiddlewareContract):
    pass


def registered(ros: Ros) -> set[str]:
    """Return the nodes that the master knows."""
    with xmlrpc.client.ServerProxy(ros.environment["ROS_MASTER_URI"]) as master:
        state: list[list[list[list[str]]]] = master.getSystemState("/tests")[2]  # type: ignore[index,assignment]
    return {node for kind in state for _, nodes in kind for node in nodes}


def uri_of(ros: Ros, node: str) -> str:
    """Return the address of a node for calls of others."""
    with xmlrpc.client.ServerProxy(ros.environment["ROS_MASTER_URI"]) as master:
        return str(master.lookupNode("/tests", node)[2])  # type: ignore[index]


@pytest.mark.parametrize("name", ["FloatStamped", "FloatMessage"])
def test_the_stamped_message_is_that_of_the_package(world: World, name: str) -> None:
    """Compare the checksum with two other programs, from the text of the package."""
    text = (ROOT / "ros" / "rtamt_msgs" / "msg" / f"{name}.msg").read_text()
    context = genmsg.msg_loader.MsgContext.create_default()
    spec = genmsg.msg_loader.load_msg_from_string(context, text, f"rtamt_msgs/{name}")
    header = "uint32 seq\ntime stamp\nstring frame_id\n"
    context.register(
        "std_msgs/Header",
        genmsg.msg_loader.load_msg_from_string(context, header, "std_msgs/Header"),
    )
    assert genmsg.gentools.compute_md5(context, spec) == MD5
    assert STORES[1].generate_msgdef("rtamt_msgs/msg/FloatStamped")[1] == MD5
    made = world.talker.ask("fields", "rtamt_msgs", name, ["_md5sum", "_type", "_slot_types"])
    assert made == [MD5, f"rtamt_msgs/{name}", ["std_msgs/Header", "float64"]]


def test_others_read_a_stamped_message(world: World) -> None:
    values = {"/stamped/a": 0.1, "/stamped/b": -0.0, "/stamped/c": float("inf")}
    for topic, value in values.items():
        world.talker.ask("publisher", topic, topic, "rtamt_msgs", "FloatStamped", latched=True)
        world.talker.ask("publish", topic, {"value": value}, 1_790_000_000_999_999_999)
    with probe(world.ros, dict.fromkeys(values, STAMPED)) as other:
        other.wait(lambda: all(map(other.heard, values)), "a message of each")
        for topic, value in values.items():
            (came,) = other.heard(topic)
            assert (came.kind, came.md5) == (STAMPED, MD5)
            assert came.message.value.hex() == value.hex()
            stamp = came.message.header.stamp
            assert (stamp.sec, stamp.nanosec) == (1_790_000_000, 999_999_999)


def test_a_publisher_of_another_type_is_named_in_the_log_once(world: World) -> None:
    world.talker.ask("publisher", "twists", "/mismatch", "geometry_msgs", "Twist")
    world.listener.ask("subscribe", "numbers", "/mismatch", *FLOAT, ["data"])
    expected = (
        "no messages come from a publisher of /mismatch: remote error reported: "
        "topic types do not match: [std_msgs/Float64] vs. [geometry_msgs/Twist]"
    )
    world.listener.ask("kept", "numbers", 1, 1.3)  # rospy tries again after 1 s
    assert world.listener.log().count(expected) == 1


def test_a_subscriber_that_hangs_holds_up_nobody(world: World) -> None:
    stuck, topic = world.peer("stuck"), "/large"
    world.talker.ask("publisher", topic, topic, "std_msgs", "String", latched=True)
    world.talker.ask("publish", topic, {"data": "first"})
    for peer in (stuck, world.listener):
        peer.ask("subscribe", topic, topic, "std_msgs", "String", ["data"])
        assert peer.ask("kept", topic, 1) == [(None, "first")]
    stuck.process.send_signal(signal.SIGSTOP)
    large = "x" * 2**20
    for _ in range(30):  # more than TCP buffers for a slow reader
        world.talker.ask("publish", topic, {"data": large})
    assert [len(text) for _, text in world.listener.ask("kept", topic, 31)] == [5] + 30 * [2**20]
    stuck.process.kill()


def test_a_topic_has_one_type_in_a_node(world: World) -> None:
    peer = world.peer("robot's types")
    assert re.fullmatch(r"/robot_s_types_\d+_\d+", peer.ask("name"))
    peer.ask("subscribe", "numbers", "/one_type", *FLOAT, ["data"])
    with pytest.raises(AssertionError) as refused:
        peer.ask("subscribe", "twists", "/one_type", "geometry_msgs", "Twist", ["linear.x"])
    assert (
        "InputError: expected one type of messages on /one_type, got std_msgs/Float64 and "
        "geometry_msgs/Twist"
    ) in str(refused.value)
    # The first node continues.
    world.talker.ask("publisher", "one_type", "/one_type", *FLOAT, latched=True)
    world.talker.ask("publish", "one_type", {"data": 2.0})
    assert heard(peer, "numbers", 1) == [2.0]


def test_a_message_of_another_ros_is_refused(world: World, tmp_path: Path) -> None:
    package = tmp_path / "other_msgs"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "msg.py").write_text("class Twist: pass\n")
    world.talker.ask("path", str(tmp_path))
    assert world.talker.ask("refusal", "other_msgs", "Twist") == (
        f"InputError: expected other_msgs of ROS 1, found other_msgs of ROS 2 in {package}/msg.py: "
        "start from a terminal where only ROS 1 is set up"
    )
    assert world.talker.ask("refusal", "absent_msgs", "Twist") == (
        "InputError: the messages of absent_msgs are not installed: apt-get install "
        "python3-absent-msgs (Debian) or ros-noetic-absent-msgs, or source the setup file of a "
        "workspace that has them"
    )


@given(st.text(max_size=8))
def test_every_name_becomes_a_legal_one(name: str) -> None:
    legal = legal_name(name)
    assert rosgraph.names.is_legal_base_name(legal)
    if name.isascii() and rosgraph.names.is_legal_base_name(name) and not re.search("__|_$", name):
        assert legal == name


def test_a_name_that_ros_cannot_have_is_refused() -> None:
    with pytest.raises(InputError) as refused:
        Ros1("any", ["odom:=wheels", "__name:=a b"])
    assert str(refused.value) == "__name: expected letters, digits and '_', got 'a b'"


def test_a_topic_that_is_remapped_to_what_ros_cannot_have_is_refused(world: World) -> None:
    peer = world.peer("remapped", {"odom": "/a b"})
    with pytest.raises(AssertionError) as refused:
        peer.ask("subscribe", "odom", "odom", *FLOAT, ["data"])
    assert (
        "InputError: topic 'odom', which is remapped to '/a b': expected letters, digits, '_' and "
        "'/', first a letter, '/' or '~'"
    ) in str(refused.value)


def test_an_argument_that_rospy_chokes_on_is_an_input_error(world: World) -> None:
    peer = world.peer("refused", {"_gain": "{"})
    assert peer.process.wait(PATIENCE) == 1
    assert "InputError: cannot start the node: invalid command-line parameters: " in peer.log()


def test_a_node_that_ended_has_left_the_master(world: World) -> None:
    peer = world.peer("leaving", {"__name": "fixed_name"})
    peer.ask("subscribe", "a", "/left/a", *FLOAT, ["data"])
    peer.ask("publisher", "b", "/left/b", *FLOAT)
    assert "/fixed_name" in registered(world.ros)
    peer.process.send_signal(signal.SIGTERM)
    assert peer.process.wait(PATIENCE) == 0
    assert "/fixed_name" not in registered(world.ros)


def test_a_node_can_be_ended_by_others_through_the_master(world: World) -> None:
    """As `rosnode kill` does it."""
    peer = world.peer("killed")
    uri = uri_of(world.ros, peer.ask("name"))
    with xmlrpc.client.ServerProxy(uri) as node, suppress(ConnectionError):  # it ends at once
        node.shutdown("/tests", "a test")
    assert peer.process.wait(PATIENCE) == 0
    assert peer.log().endswith("closed\n")


def test_a_command_that_waits_for_a_master_says_so_and_ends_on_sigint(
    world: World, tmp_path: Path
) -> None:
    command = subprocess.Popen(
        [sys.executable, "-m", "rtamt_ros", "--spec", "always(x > 1)"],
        env={**world.ros.environment, "ROS_MASTER_URI": f"http://127.0.0.1:{free_port()}"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        cwd=tmp_path,
        text=True,
    )
    with command:
        assert command.stdout is not None
        line = command.stdout.readline()
        assert "master may not be running yet. Will keep trying." in line
        command.send_signal(signal.SIGINT)
        try:
            assert command.wait(PATIENCE) == -signal.SIGINT  # 130 in a shell
            assert "Traceback" not in command.stdout.read()
        finally:
            command.kill()


def test_a_timer_calls_at_the_first_tick_of_each_period(world: World) -> None:
    """The oracle knows the grid: it starts with the timer, and jumps do not move it."""
    clock, node = world.clock, world.simulated
    contract = TestRos1Middleware()
    begin, period = 1000 * SECOND, 70 * MS
    contract.tick(clock, node, begin)
    node.ask("every", "grid", period)
    now, last, expected = begin, begin, []
    for step in [30] * 12 + [700, 20, 30, 40, -9000, 50, 60, 10, -20, 40, 70, 141, 9]:
        now += step * MS
        contract.tick(clock, node, now)
        point = begin + (now - begin) // period * period
        if point > last:
            expected.append((now, point))
            last = point
            assert len(node.ask("kept", "grid", len(expected))) == len(expected)
        elif now < last:  # the clock jumped back, before earlier calls
            last = point
            node.ask("kept", "grid", len(expected) + 1, 0.1)  # wait for the timer
    assert [(time, due) for time, _, due in node.ask("kept", "grid")] == expected
