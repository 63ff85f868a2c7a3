"""The safety of a monitor among robots, on real processes of ROS 1 and ROS 2.

The tests of a generation subclass `RobotContract` and pass it a `World`. To add a claim about late
or lost messages or about two robots, add a test here.
"""

from __future__ import annotations

import re
import signal
import threading
from collections.abc import Iterator
from typing import Protocol

import pytest
from paths import ROOT
from ros_contract import FLOAT, SECOND
from ros_peer import Peer
from ros_processes import PATIENCE, Process
from ros_world import World

__all__ = ["RobotContract"]

LIMITED = """
input float64 x
input float64 limit = 0.8
@ topic(x, {0}/x)
@ topic(limit, {0}/limit)
@ topic(out, {0}/out)
out = x < limit
"""

STAMPED = """
from geometry_msgs.msg import PointStamped
input PointStamped p
@ topic(p, {0}/p)
@ topic(out, {0}/out)
out = always(p.point.x > 0)
"""


class Starter(Protocol):
    """Starts a monitor on a text, with options; it ends with the test."""

    def __call__(self, text: str, *options: str) -> Process:
        """Return the process."""
        ...


class RobotContract:
    """The properties; a subclass has a fixture `world`."""

    @pytest.fixture
    def topic(self, request: pytest.FixtureRequest) -> str:
        """Return a namespace for this test only."""
        return f"/robots/{request.node.originalname}"

    @pytest.fixture
    def started(self, world: World) -> Iterator[Starter]:
        """Start a monitor on a text with options; it ends with the test."""
        processes: list[Process] = []

        def start(text: str, *options: str) -> Process:
            words = ["-m", "rtamt_ros", "--spec", text, "--period", "50", "--unit", "ms", *options]
            processes.append(world.ros.start(*words, name=f"monitor{len(processes)}"))
            return processes[-1]

        yield start
        for process in processes:
            process.ask_to_end()
            process.ended()

    def publish(self, world: World, key: str, value: float, seconds: float) -> None:
        """Publish a number 20 times a second."""
        for _ in range(round(seconds * 20)):
            world.talker.ask("publish", key, {"data": value})
            threading.Event().wait(0.05)

    def test_default_never_replaces_a_kept_limit(
        self, world: World, topic: str, started: Starter
    ) -> None:
        for name, latched in (("limit", True), ("x", False)):
            world.talker.ask(
                "publisher", f"{topic}/{name}", f"{topic}/{name}", *FLOAT, latched=latched
            )
        world.talker.ask("publish", f"{topic}/limit", {"data": 0.3})
        world.listener.ask("subscribe", topic, f"{topic}/out", *FLOAT, ["data"])
        monitor = started(LIMITED.format(topic))
        self.publish(world, f"{topic}/x", 0.6, 6.0)
        numbers = [value for _, value in world.listener.ask("kept", topic, 20)]
        assert {*numbers} == {0.3 - 0.6}, monitor.output

    def test_default_counts_where_nothing_is_kept(
        self, world: World, topic: str, started: Starter
    ) -> None:
        world.talker.ask("publisher", f"{topic}/x", f"{topic}/x", *FLOAT)
        world.listener.ask("subscribe", topic, f"{topic}/out", *FLOAT, ["data"])
        monitor = started(LIMITED.format(topic))
        self.publish(world, f"{topic}/x", 0.6, 6.0)
        numbers = [value for _, value in world.listener.ask("kept", topic, 20)]
        assert {*numbers} == {0.8 - 0.6}, monitor.output
        assert "; by default limit = 0.8" in monitor.output

    def test_stamps_out_of_line_decide_nothing(
        self, world: World, topic: str, started: Starter
    ) -> None:
        text = STAMPED.format(topic)
        key, point = f"{topic}/p", ("geometry_msgs", "PointStamped")
        world.talker.ask("publisher", key, key, *point)
        world.listener.ask("subscribe", topic, f"{topic}/out", *FLOAT, ["data"])
        monitor = started(text, "--stamps")

        def publish(count: int, offset: float, value: float = 1.0) -> None:
            for _ in range(count):
                stamp = world.talker.ask("now") + round(offset * SECOND)
                world.talker.ask("publish", key, {"point.x": value}, stamp)
                threading.Event().wait(0.05)

        while not world.listener.ask("kept", topic, 1, 0.0):
            publish(1, 0.0)
        for offset in (3600.0, 5.0, 1.5, -2.0):
            publish(5, 0.0)
            publish(1, offset, -1.0)
        publish(10, 0.0)
        assert {value for _, value in world.listener.ask("kept", topic)} == {1.0}, monitor.output
        assert "restarted" not in monitor.output
        publish(20, 5.0)
        assert "stamps of p are 5 s ahead of the clock" in monitor.output
        assert "restarted 1 time because the stamps of p jumped ahead by 5.0 s" in monitor.output
        assert "4 messages out of line left out" in monitor.output

    @pytest.mark.parametrize("mode", ["any", "one"])
    def test_two_publishers_are_named(
        self, world: World, topic: str, started: Starter, mode: str
    ) -> None:
        topic = f"{topic}_{mode}"
        key = f"{topic}/x"
        robots = [world.peer(f"{mode}_{name}") for name in ("a", "b")]
        robots[0].ask("publisher", key, key, *FLOAT)
        world.listener.ask("subscribe", topic, f"{topic}/out", *FLOAT, ["data"])
        text = f"input float64 x\n@ topic(x, {key})\n@ topic(out, {topic}/out)\nout = x > 0"
        monitor = started(text, "--publishers", mode, "--stale", "inf")

        def publish(robot: Peer, value: float, until: str = "") -> None:
            for _ in range(round(PATIENCE * 20)):
                robot.ask("publish", key, {"data": value})
                threading.Event().wait(0.05)
                if until in monitor.output and world.listener.ask("kept", topic, 1, 0.0):
                    return
            raise AssertionError(f"expected {until!r} in the log:\n{monitor.output}")

        publish(robots[0], 1.0)
        robots[1].ask("publisher", key, key, *FLOAT)
        names = ", ".join(sorted(robot.ask("name") for robot in robots))
        publish(robots[0], 1.0, f"2 publishers of {key}: {names}")
        before = len(world.listener.ask("kept", topic))
        for _ in range(20):
            publish(robots[0], 1.0)
        numbers = [value for _, value in world.listener.ask("kept", topic)[before:]]
        assert (1.0 in numbers) == (mode == "any"), monitor.output
        robots[1].process.kill()
        robots[1].process.wait()
        third = world.peer(f"{mode}_b")
        third.ask("publisher", key, key, *FLOAT)
        for _ in range(40):
            publish(robots[0], 1.0)
        if mode == "any":
            assert "restarted" not in monitor.output
        third.process.kill()
        third.process.wait()
        publish(robots[0], 1.0, f"no more than 1 publisher of {key}")
        world.listener.ask("kept", topic, len(world.listener.ask("kept", topic)) + 1, 1.0)
        before = len(world.listener.ask("kept", topic))
        for _ in range(10):
            publish(robots[0], 1.0)
        assert 1.0 in [value for _, value in world.listener.ask("kept", topic)[before:]]

    def test_field_errors_show_file_line_and_caret(self, world: World) -> None:
        """Check errors with real message classes; one line imports two of them."""
        text = """from geometry_msgs.msg import Twist, PointStamped
        input Twist cmd
        input PointStamped p
        fast = cmd.linear.x > 1
        out = always(fast implies p.point.{} > 0)"""
        path = world.ros.folder / "fields.stl"
        for field, hint in (("w", "its fields are x, y, z"), ("x.y", "")):
            path.write_text(text.format(field), encoding="utf-8")
            node = world.ros.start("-m", "rtamt_ros", "--stl", path, name="fields")
            assert node.ended() == 2
            line = text.format(field).split("\n")[-1]
            column = line.index(f"point.{field}") + len(f"point.{field}")  # of the last letter
            assert f"in {path}: STL:5:{column}: " in node.output
            assert f"\n  {line}\n  {' ' * (column - 1)}^\n" in node.output
            assert (f"  hint: {hint}" in node.output) == bool(hint)

    def test_losses_of_a_burst_are_counted(
        self, world: World, topic: str, started: Starter
    ) -> None:
        """On ROS 2 the queue of 14 messages drops most of a burst; rospy has no such queue."""
        text, key = STAMPED.format(topic), f"{topic}/p"
        world.talker.ask("publisher", key, key, "geometry_msgs", "PointStamped")
        world.listener.ask("subscribe", topic, f"{topic}/out", *FLOAT, ["data"])
        options = ("--depth", "14", "--qos", "reliable")
        name = ["--ros-args", "-r", "__node:=burst"]
        monitor = started(
            text, *options, *(name if world.ros.generation == 2 else ["__name:=burst"])
        )
        while not world.listener.ask("kept", topic, 1, 0.0):
            world.talker.ask("publish", key, {"point.x": 1.0})
            threading.Event().wait(0.05)
        monitor.signal(signal.SIGSTOP)
        for number in range(200):
            world.talker.ask("publish", key, {"point.x": 2.0 + number})
        threading.Event().wait(1.0)
        monitor.signal(signal.SIGCONT)
        for _ in range(30):
            world.talker.ask("publish", key, {"point.x": 1.0})
            threading.Event().wait(0.05)
        answer = world.talker.ask("call", "/burst/reset")[1]
        monitor.ask_to_end()
        assert monitor.ended() == 0
        words = r"(\d+) messages of p came at once, (\d+) were lost"
        taken, lost = map(int, re.search(words, answer).groups())  # type: ignore[union-attr]
        assert 200 <= taken + lost <= 203, answer
        assert (lost >= 170) == (world.ros.generation == 2), answer
        assert (f"lost messages: p: {lost}" in answer) == (lost > 0)

    def test_a_suspension_is_named(self, world: World, topic: str, started: Starter) -> None:
        key = f"{topic}/x"
        world.talker.ask("publisher", key, key, *FLOAT)
        world.listener.ask("subscribe", topic, f"{topic}/out", *FLOAT, ["data"])
        monitor = started(
            f"input float64 x\n@ topic(x, {key})\n@ topic(out, {topic}/out)\nout = x > 0"
        )
        while not world.listener.ask("kept", topic, 1, 0.0):
            self.publish(world, key, 1.0, 0.1)
        monitor.signal(signal.SIGSTOP)
        self.publish(world, key, -1.0, 2.0)
        self.publish(world, key, 1.0, 0.2)
        monitor.signal(signal.SIGCONT)
        self.publish(world, key, 1.0, 2.0)
        assert "restarted 1 time because nothing was evaluated for 2." in monitor.output
        assert "messages of x came at once, " in monitor.output
        assert "x stale" not in monitor.output
        assert -1.0 not in [value for _, value in world.listener.ask("kept", topic)]

    def test_a_multiplexer_stops_the_robot(
        self, world: World, topic: str, started: Starter
    ) -> None:
        generation, talker, listener = world.ros.generation, world.talker, world.listener
        key, twist = f"{topic}/x", ("geometry_msgs", "Twist")
        talker.ask("publisher", key, key, *FLOAT)
        talker.ask("publisher", f"{topic}/in", f"{topic}/in", *twist)
        listener.ask("subscribe", topic, f"{topic}/cmd_vel", *twist, ["linear.x"])
        names = {"state": f"{topic}/out/state", "commands": f"{topic}/in"}
        names["cmd_vel"] = f"{topic}/cmd_vel"
        words = [f"{name}:={other}" for name, other in names.items()]
        if generation == 2:
            words = ["--ros-args", *[word for each in words for word in ("-r", each)]]
        example = ROOT / "examples" / "ros" / f"multiplexer_ros{generation}.py"
        node = world.ros.start(example, *words, name="multiplexer")
        text = f"input float64 x\n@ topic(x, {key})\n@ topic(out, {topic}/out)\nout = x > 0"

        def drive(x: float | None, speed: float, monitor: Process) -> None:
            """Publish commands until the robot has this speed, and still has it 0.3 s later."""

            def command(times: int) -> float:
                for _ in range(times):
                    if x is not None:
                        talker.ask("publish", key, {"data": x})
                    talker.ask("publish", f"{topic}/in", {"linear.x": 0.5})
                    threading.Event().wait(0.03)
                return float((listener.ask("kept", topic) or [(None, -1.0)])[-1][1])

            for _ in range(300):
                if command(1) == speed:
                    break
            assert command(10) == speed, (x, monitor.output, node.output)

        monitor = started(text)
        drive(1.0, 0.5, monitor)
        drive(-1.0, 0.0, monitor)
        drive(1.0, 0.5, monitor)
        drive(None, 0.0, monitor)  # stale
        drive(1.0, 0.5, monitor)
        monitor.signal(signal.SIGSTOP)
        drive(1.0, 0.0, monitor)
        monitor.signal(signal.SIGCONT)
        drive(1.0, 0.5, monitor)
        monitor.kill()
        drive(1.0, 0.0, monitor)
        drive(1.0, 0.5, started(text))
        node.kill()
