"""The paper's command line on ROS 1, with a specification for the released library."""

import os
import signal
import sys
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from paths import ROOT
from ros_messages import probe
from ros_processes import Process, ros
from ros_world import World

SPEC = ROOT / "examples" / "ros" / "spec.stl"
OUT, DIAGNOSTICS = "rtamt/follows", "/diagnostics"
MD5 = "d053817de0764f9ee90dbc89c4cdd751"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    with ros(1, tmp_path_factory.mktemp("ros")) as master, World(master, master) as found:
        yield found


def start(world: World, *arguments: str, name: str) -> Process:
    """Start the command: the installed console script."""
    script = Path(sys.executable).with_name("ros_stl_monitor.py")
    program = [script] if script.exists() else ["-m", "rtamt_ros"]
    return world.ros.start(*program, *arguments, name=name)


def test_a_file_of_the_released_library_is_monitored_unchanged(world: World) -> None:
    robot = world.peer("robot")
    robot.ask("publisher", "cmd", "/robot0/cmd_vel", "geometry_msgs", "Twist", latched=True)
    robot.ask("publisher", "odom", "/wheels", "nav_msgs", "Odometry", latched=True)
    robot.ask("publish", "cmd", {"linear.x": 0.5})
    robot.ask("publish", "odom", {"twist.twist.linear.x": 0.375})
    topics = {OUT: "rtamt_msgs/FloatStamped", DIAGNOSTICS: "diagnostic_msgs/DiagnosticArray"}
    with probe(world.ros, topics) as ears:
        begin = robot.ask("now")
        options = "--period 50 --unit ms --stale inf __name:=watch robot0/odom:=wheels"
        monitor = start(world, "--stl", str(SPEC), *options.split(), name="watch")
        ears.wait(lambda: len(ears.heard(OUT)) >= 3 and bool(ears.heard(DIAGNOSTICS)), "values")
        monitor.ask_to_end()
        assert monitor.ended() == 0, monitor.output
        end = robot.ask("now")
    times = []
    for each in ears.heard(OUT):
        assert each.md5 == MD5
        assert each.message.value == 0.2 - abs(0.5 - 0.375)
        stamp = each.message.header.stamp
        times.append(10**9 * stamp.sec + stamp.nanosec)
    assert begin <= times[0] <= times[-1] <= end
    assert all((after - before) % 50_000_000 == 0 for before, after in pairwise(times))
    assert ears.heard(DIAGNOSTICS)[-1].message.status[0].name == "watch: follows"


def test_a_monitor_is_reset_by_a_service(world: World) -> None:
    talker = world.peer("talker")
    talker.ask("publisher", "x", "/number", "std_msgs", "Float64", latched=True)
    talker.ask("publish", "x", {"data": 0.0})
    verdict, now = "rtamt/out/verdict", "rtamt/now"
    with probe(world.ros, {verdict: "std_msgs/Int8", now: "std_msgs/Float64"}) as ears:
        spec = "float64 x\n@ topic(x, /number)\nnow = x > 1\nout = always(now)"
        monitor = start(world, "--spec", spec, "--stale", "inf", "__name:=gate", name="gate")
        ears.wait(lambda: -1 in [each.message.data for each in ears.heard(verdict)], "violated")
        talker.ask("publish", "x", {"data": 3.0})
        ears.wait(lambda: ears.heard(now)[-1].message.data > 0, "the other number")
        good, said = talker.ask("call", "/gate/reset")
        assert good
        assert said.splitlines()[1].startswith("out: new run; was: violated, robustness -1; ")
        ears.wait(lambda: ears.heard(verdict)[-1].message.data == 0, "begun anew")
        monitor.ask_to_end()
        assert monitor.ended() == 0, monitor.output


def test_messages_that_are_not_installed_end_the_command_with_code_2(world: World) -> None:
    text = "from absent_msgs.msg import Thing; input Thing it; x = it.y > 1"
    command = start(world, "--spec", text, name="absent")
    assert command.ended() == 2
    assert command.output == (
        "ros_stl_monitor.py: error: the messages of absent_msgs are not installed: apt-get install "
        "python3-absent-msgs (Debian) or ros-noetic-absent-msgs, or source the setup file of a "
        "workspace that has them\n"
    )


def test_a_monitor_ends_with_ctrl_c(world: World) -> None:
    command = start(world, "--spec", "float64 x; always(x > 1)", name="interrupted")
    with probe(world.ros, {DIAGNOSTICS: "diagnostic_msgs/DiagnosticArray"}) as ears:
        ears.wait(lambda: bool(ears.heard(DIAGNOSTICS)), "diagnostics")
    os.kill(command.pid, signal.SIGINT)
    assert command.ended() == 0
    assert "Traceback" not in command.output
