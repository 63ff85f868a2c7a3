"""Two service robots and their controller as nodes equal the scenario, step by step."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from memory_middleware import CLASSES, MemoryMiddleware
from numpy.typing import NDArray
from paths import ROOT
from rtamt_envs.two_service_robots import SCENARIO
from scenario_courses import course, made, random_actions

from rtamt import InputError, Verdict, load
from rtamt_ros.node import MonitorNode
from rtamt_ros.simulator.robots import ServiceController, ServiceRobots, main

PERIOD = 100_000_000


def twist(right: float, up: float) -> Any:  # noqa: ANN401
    message = CLASSES["geometry_msgs", "Twist"]()
    message.linear.x, message.linear.y = right, up
    return message


def places(node: MemoryMiddleware) -> NDArray[np.float64]:
    """Return the positions of both robots: x and y of the first, then of the second."""
    columns = [
        [(each.pose.pose.position.x, each.pose.pose.position.y) for each in node.on(topic)]
        for topic in ("robot0/odom", "robot1/odom")
    ]
    return np.hstack([np.array(column) for column in columns])


def driven(actions: NDArray[np.float64], **options: Any) -> MemoryMiddleware:  # noqa: ANN401
    """Return robots with commands before every step."""
    node = MemoryMiddleware()
    ServiceRobots(node, **options)
    for action in actions:
        node.send("robot0/cmd_vel", twist(*action[:2]))
        node.send("robot1/cmd_vel", twist(*action[2:]))
        node.tick(node.time + PERIOD)
    return node


@pytest.mark.parametrize("lag", [0.0, 0.4])
def test_odometry_is_what_the_environment_observes(lag: float) -> None:
    parameters = {"lag": lag, "noise": 0.0, "start_x1": 2.0, "start_y2": 4.5}
    actions = random_actions(SCENARIO, (60,), 3).repeat(5, axis=0)  # into walls, too
    seen = course(made("TwoServiceRobots", parameters=parameters), actions)[1:, :4]
    np.testing.assert_array_equal(places(driven(actions, parameters=parameters)), seen)


def test_the_twist_is_the_velocity_along_the_room() -> None:
    actions = np.tile([0.5, -0.25, 9.0, 0.0], (30, 1))  # more than a robot can reach
    node = driven(actions, parameters={"lag": 0.2, "noise": 0.0, "start_y1": 2.0})
    first, second = (node.on(f"robot{n}/odom") for n in (0, 1))
    twists = [(each.twist.twist.linear.x, each.twist.twist.linear.y) for each in first]
    assert twists[0] == pytest.approx((0.5 * (1 - math.exp(-0.5)), -0.25 * (1 - math.exp(-0.5))))
    assert twists[9] == pytest.approx((0.5, -0.25), rel=0.01)
    assert second[19].twist.twist.linear.x == pytest.approx(1.0, rel=0.01)
    stamps = [each.header.stamp.ns for each in first]
    assert set(np.diff(stamps)) == {PERIOD}
    assert {(each.header.frame_id, each.child_frame_id) for each in second} == {
        ("room", "robot1/base_link")
    }
    assert {each.pose.pose.orientation.w for each in first} == {1.0}


def test_a_command_that_is_nan_is_left_out() -> None:
    node = driven(np.array([[0.5, 0, 0, 0], [math.nan, 0, 0, 0]]), parameters={"noise": 0.0})
    assert [text for _, text in node.lines] == ["a command that is nan is left out"]
    assert node.on("robot0/odom")[-1].twist.twist.linear.x > 0.2


def together(steps: int, **parameters: float) -> tuple[MemoryMiddleware, MemoryMiddleware]:
    """Run the robots and their controller, which commands after every step."""
    robots, controller = MemoryMiddleware(), MemoryMiddleware()
    ServiceRobots(robots, parameters={"noise": 0.0, **parameters})
    ServiceController(controller, parameters=parameters)
    for step in range(steps):
        robots.tick()
        controller.send("robot0/odom", robots.on("robot0/odom")[-1])
        if not step:
            controller.tick()
            assert controller.published == []  # it waits for the other
        controller.send("robot1/odom", robots.on("robot1/odom")[-1])
        controller.tick()
        for name in ("robot0", "robot1"):
            robots.send(f"{name}/cmd_vel", controller.on(f"{name}/cmd_vel")[-1])
    return robots, controller


@pytest.mark.parametrize("parameters", [{}, {"caution": 0.0, "speed": 1.0}, {"lag": 0.8}])
def test_service_controller_equals_baseline(
    parameters: dict[str, float],
) -> None:
    robots, controller = together(590, **parameters)
    env = made("TwoServiceRobots", parameters={"noise": 0.0, **parameters})
    env.reset(seed=0)
    action = np.zeros(4)
    commands = zip(controller.on("robot0/cmd_vel"), controller.on("robot1/cmd_vel"), strict=True)
    for row, (one, other) in zip(places(robots), commands, strict=True):
        seen, *_ = env.step(action)
        np.testing.assert_array_equal(row, seen[:4])
        action = env.baseline(seen)
        found = one.linear.x, one.linear.y, other.linear.x, other.linear.y
        np.testing.assert_array_equal(found, action)


@pytest.mark.parametrize(
    ("caution", "verdict"), [(1.5, Verdict.UNDECIDED), (0.0, Verdict.VIOLATED)]
)
def test_caution_keeps_robots_apart(caution: float, verdict: Verdict) -> None:
    robots, _ = together(300, caution=caution)
    monitor = MemoryMiddleware()
    node = MonitorNode(monitor, [load(ROOT / "examples/ros/apart.stl")])
    node.start()
    for one, other in zip(robots.on("robot0/odom"), robots.on("robot1/odom"), strict=True):
        monitor.send("robot0/odom", one)
        monitor.send("robot1/odom", other)
        monitor.tick()
        monitor.time += PERIOD
    (report,) = node.reports
    assert (report.name, report.verdict) == ("apart", verdict)


def test_bad_arguments_are_named() -> None:
    node = MemoryMiddleware()
    with pytest.raises(InputError) as caught:
        ServiceRobots(node, parameters={"lag": 2.5})
    assert str(caught.value) == "expected lag from 0 to 1, got 2.5"
    assert [node.subscriptions, node.publishers, node.timers] == [[], [], []]


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("--model two-service-robots --lag 2", "expected lag from 0 to 1, got 2"),
        (
            "--model two-service-robots --stuck 5:1",
            "unrecognized arguments: --stuck 5:1",
        ),
        ("--caution 1", "unrecognized arguments: --caution 1"),
        ("--model two", "argument --model: invalid choice: 'two' (choose from "),
    ],
)
def test_options_are_those_of_the_model(
    line: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(line.split())
    assert caught.value.code == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"python -m rtamt_ros.simulator: error: {text}")


def test_help_is_that_of_the_model(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--model", "two-service-robots", "--help"])
    said = capsys.readouterr().out
    assert "--caution" in said
    assert "--stuck" not in said
