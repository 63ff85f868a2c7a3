"""The robot and its controller as nodes equal the scenario, step by step."""

import math
from typing import Any

import numpy as np
import pytest
from memory_middleware import CLASSES, MemoryMiddleware
from numpy.typing import NDArray
from rtamt_envs.mobile_robot import ROUTE, SCENARIO
from scenario_courses import course, made, random_actions

from rtamt import InputError
from rtamt_ros.simulator.robots import Robot, RobotController, Stuck, Surge, main

ODOM, CMD = "robot0/odom", "robot0/cmd_vel"


def twist(speed: float, turn: float) -> Any:  # noqa: ANN401
    message = CLASSES["geometry_msgs", "Twist"]()
    message.linear.x, message.angular.z = speed, turn
    return message


def odometry(node: MemoryMiddleware) -> NDArray[np.float64]:
    """Return the published odometry: x, y, heading, speed, turn rate."""
    rows = []
    for message in node.on(ODOM):
        place, looks = message.pose.pose.position, message.pose.pose.orientation
        moves = message.twist.twist
        heading = 2 * math.atan2(looks.z, looks.w)
        rows.append((place.x, place.y, heading, moves.linear.x, moves.angular.z))
    return np.array(rows)


def driven(actions: NDArray[np.float64], **options: Any) -> NDArray[np.float64]:  # noqa: ANN401
    """Return the odometry of a robot with a command before every step."""
    node = MemoryMiddleware()
    Robot(node, **options)
    for action in actions:
        node.send(CMD, twist(*action))
        node.tick(node.time + 100_000_000)
    return odometry(node)


@pytest.mark.parametrize("lag", [0.0, 0.3])
def test_odometry_is_what_the_environment_observes(lag: float) -> None:
    parameters = {"lag": lag, "noise": 0.0, "start_x": 2.0, "start_heading": 1.0}
    actions = random_actions(SCENARIO, (60,), 3).repeat(5, axis=0)  # into walls, too
    seen = course(made("MobileRobot", parameters=parameters), actions)[1:, :5]
    found = driven(actions, parameters=parameters)
    np.testing.assert_array_equal(found[:, [0, 1, 3, 4]], seen[:, [0, 1, 3, 4]])
    np.testing.assert_allclose(found[:, 2], seen[:, 2], atol=1e-15)


def test_commands_are_clipped() -> None:
    found = driven(np.array([[9, -9], [math.nan, 0], [0, 0]]), parameters={"noise": 0.0})
    np.testing.assert_array_equal(found[:, 3:], [[1, -2], [1, -2], [0, 0]])


def test_noise_is_that_of_the_seed() -> None:
    actions = np.tile([0.5, 1.0], (20, 1))
    one, again, other = (driven(actions, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert (one[:, 3] != other[:, 3]).all()
    assert one[:, 3].std() == pytest.approx(0.025, rel=0.5)


def test_odometry_says_when_it_is_and_of_what() -> None:
    node = MemoryMiddleware()
    Robot(node, "r2")
    begin = node.time
    for step in range(3):
        node.tick(begin + step * 100_000_000)
    found = node.on("r2/odom")
    assert [each.header.stamp.ns - begin for each in found] == [0, 100_000_000, 200_000_000]
    frames = {(each.header.frame_id, each.child_frame_id) for each in found}
    assert frames == {("r2/odom", "r2/base_link")}
    assert [timer.period for timer in node.timers] == [100_000_000]


def test_blocked_wheels_stop() -> None:
    actions = np.tile([0.2, 0.0], (20, 1))
    parameters = {"lag": 0.5, "noise": 0.0}
    free = driven(actions, parameters=parameters)
    found = driven(actions, parameters=parameters, stuck=Stuck(0.5, 0.3))
    np.testing.assert_array_equal(found[:5], free[:5])
    np.testing.assert_array_equal(found[5:8, 3:], 0.0)
    np.testing.assert_array_equal(found[5:8, :3], found[4:7, :3])
    np.testing.assert_array_equal(found[8:, 3], free[:12, 3])


def test_fault_waits_for_the_first_command() -> None:
    node = MemoryMiddleware()
    Robot(node, parameters={"noise": 0.0}, stuck=Stuck(0.1, 0.1))
    for _ in range(5):
        node.tick()
    node.send(CMD, twist(0.2, 0.0))
    for _ in range(3):
        node.tick()
    assert odometry(node)[:, 3].tolist() == [0.0] * 5 + [0.2, 0.0, 0.2]
    assert [text for _, text in node.lines] == ["the wheels are blocked"]


def together(steps: int, surge: Surge | None = None) -> tuple[MemoryMiddleware, MemoryMiddleware]:
    """Run a robot and its controller, which commands after every step."""
    robot, controller = MemoryMiddleware(), MemoryMiddleware()
    Robot(robot, parameters={"noise": 0.0})
    RobotController(controller, surge=surge)
    controller.tick()
    assert controller.published == []
    for _ in range(steps):
        robot.tick()
        controller.send(ODOM, robot.on(ODOM)[-1])
        controller.tick()
        robot.send(CMD, controller.on(CMD)[-1])
    return robot, controller


def test_controller_equals_baseline() -> None:
    robot, controller = together(500)
    env = made("MobileRobot", parameters={"noise": 0.0})
    env.reset(seed=0)
    action = np.zeros(2)
    found = odometry(robot)
    for row, message in zip(found, controller.on(CMD), strict=True):
        seen, *_ = env.step(action)
        np.testing.assert_allclose(row, seen[:5], atol=1e-9)
        action = env.baseline(seen)
        command = message.linear.x, message.angular.z
        np.testing.assert_allclose(command, action, atol=1e-9)
    assert np.hypot(*(found[-1, :2] - ROUTE[-1])) <= 0.2
    assert command == (0.0, 0.0)


def test_surge_duration() -> None:
    _, calm = together(30)
    _, controller = together(30, Surge(0.7, 0.4, -0.5))
    speeds = [each.linear.x for each in controller.on(CMD)]
    assert speeds[7:11] == [-0.5] * 4
    assert speeds[:7] == [each.linear.x for each in calm.on(CMD)][:7]
    assert -0.5 not in speeds[11:]
    assert [text for _, text in controller.lines] == ["the command is -0.5 m/s"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"parameters": {"lag": 2.5}}, "expected lag from 0 to 2, got 2.5"),
        (
            {"parameters": {"lag": math.nan}},
            "expected a number as parameter 'lag' of rtamt/MobileRobot-v0, got nan",
        ),
        ({"seed": -1}, "expected a seed of at least 0, got -1"),
    ],
)
def test_bad_arguments_are_named(options: dict[str, Any], text: str) -> None:
    node = MemoryMiddleware()
    with pytest.raises(InputError) as caught:
        Robot(node, **options)
    assert str(caught.value) == text
    assert [node.subscriptions, node.publishers, node.timers] == [[], [], []]


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("--stuck 5", "argument --stuck: expected BEGIN:DURATION in seconds, such as 5:1, got '5'"),
        (
            "--stuck 1:0",
            "argument --stuck: expected BEGIN:DURATION in seconds, such as 5:1, got '1:0'",
        ),
        (
            "--surge=",
            "argument --surge: expected BEGIN:DURATION:SPEED in seconds, such as 5:1:-0.5, got ''",
        ),
        ("--lagg 1", "unrecognized arguments: --lagg 1; did you mean '--lag'?"),
        ("--lag 3", "expected lag from 0 to 2, got 3"),
    ],
)
def test_a_bad_line_is_refused_before_there_is_a_node(
    line: str, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(line.split())
    assert caught.value.code == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert said == f"python -m rtamt_ros.simulator: error: {text}"
