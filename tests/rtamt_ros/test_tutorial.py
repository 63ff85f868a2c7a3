"""The exact tutorial of a robot: its commands, its specification and its transcripts."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from bags import Said, write_bag
from memory_middleware import SECOND, MemoryMiddleware
from memory_nodes import MS, until
from paths import ROOT
from tutorial_page import PAGE, block

import rtamt_ros.node
from rtamt_gym.__main__ import main
from rtamt_ros.command import _parser as parser_of_monitor
from rtamt_ros.middleware import Level
from rtamt_ros.node import MonitorNode
from rtamt_ros.parameters import PARAMETERS, read
from rtamt_ros.simulator.robots import Robot, RobotController
from rtamt_ros.simulator.robots import _parser as parser_of_robot

BEGIN = 1_795_333_330_934_702_000
ROBOT = BEGIN + 5 * SECOND + 40 * MS
"""The start of the robot after the monitor; its messages arrive between two samples."""
DRIVES = 16 * SECOND
"""The time of Ctrl-C."""


@dataclass
class Logging(MemoryMiddleware):
    """A node that writes its log as rospy does."""

    shown: list[str] = field(default_factory=list)
    heard: list[tuple[int, str, Any]] = field(default_factory=list)
    said: str = ""

    def log(self, level: Level, text: str) -> None:
        super().log(level, text)
        name = "INFO" if level is Level.OK else "ERROR" if level is Level.ERROR else "WARN"
        self.shown.append(f"[{name}] [{self.time / SECOND:.6f}]: {text}")


def option(parser: Any, line: str, words: int) -> Any:  # noqa: ANN401
    """Return the options of a command on the page, after these words."""
    return parser.parse_args(shlex.split(line.removeprefix("$ "))[words:])


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Logging:
    """Run the commands of the page without ROS."""
    folder = tmp_path_factory.mktemp("tutorial")
    given = vars(option(parser_of_monitor(), block("ros_stl_monitor.py")[0], 1))
    record = given["record"]
    given = {**given, "spec_file": [str(ROOT / path) for path in given.pop("stl")]}
    given["record"] = str(folder / record)
    defaults = {name: default for name, (default, _) in PARAMETERS.items()}
    specifications, settings = read({**defaults, **given})
    (robot_line,) = block("python -m rtamt_ros.simulator")
    stuck = option(parser_of_robot(), robot_line, 3).stuck

    ros = Logging(time=BEGIN, known=set())
    node = MonitorNode(ros, specifications, settings)
    node.start()
    starts = ROBOT, ROBOT + DRIVES + 5 * SECOND
    for time in range(BEGIN, starts[1] + SECOND, 10 * MS):
        ros.time = time
        if time in starts:
            robot, sent = MemoryMiddleware(time=time), 0
            Robot(robot, stuck=stuck)
            RobotController(robot)
        if time > ROBOT and not 0 < time - ROBOT - DRIVES <= 5 * SECOND:
            if (time - ROBOT) % (100 * MS) == 0:
                robot.tick(time)
            for topic, message in robot.published[sent:]:
                robot.send(topic, message)
                ros.send(topic, message)
                if time < starts[1]:
                    ros.heard.append((time, topic, message))
            sent = len(robot.published)
        if (time - BEGIN) % (100 * MS) == 0:
            ros.tick()
        if time == BEGIN + 3 * SECOND:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(rtamt_ros.node, "SEARCH_AFTER", 0.0)
                ros.tick()
                until(lambda: sum("nobody" in line for line in ros.shown) == 2)
    ros.said = node.reports[0].text
    node.stop()
    ros.shown = [line.replace(str(folder / record), record) for line in ros.shown]
    return ros


def test_the_specification_is_the_file() -> None:
    text = (ROOT / "examples" / "follows.stl").read_text(encoding="utf-8")
    assert block("from geometry_msgs.msg") == text.strip().splitlines()


def test_the_monitor_says_what_the_page_shows(played: Logging) -> None:
    shown = block("ros_stl_monitor.py")[1:]
    assert played.shown[: len(shown)] == shown


def test_the_violation_is_on_the_topics_of_the_page(played: Logging) -> None:
    shown = [
        float(line.removeprefix("data: ")) for line in block("rostopic echo") if "data" in line
    ]
    found = played.data("rtamt/near")
    at = found.index(shown[0])
    assert found[at : at + len(shown)] == shown
    assert min(shown) < 0
    assert -1 in played.data("rtamt/follows/verdict")


def test_restart_text_of_the_page(
    played: Logging,
) -> None:
    _, said = played.said.split("; ", 1)
    found = re.search(r"keeps the history: `(violated .*?)`", PAGE, re.DOTALL)
    assert found is not None
    assert " ".join(found[1].split()) == said


def test_bag_of_the_page(
    played: Logging,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    messages = []
    for time, topic, heard in played.heard:
        if hasattr(heard, "linear"):
            kind, fields = "geometry_msgs/Twist", {"linear": {"x": heard.linear.x}}
        else:
            kind = "nav_msgs/Odometry"
            fields = {"twist": {"twist": {"linear": {"x": heard.twist.twist.linear.x}}}}
        messages.append(Said(time, f"/{topic}", kind, fields))
    write_bag(tmp_path / "run.bag", messages)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    prompt, *shown = block("rtamt monitor examples/follows.stl run.bag")
    assert main(shlex.split(prompt)[2:]) == 1
    assert capsys.readouterr().out.splitlines() == shown
