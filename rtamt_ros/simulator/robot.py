"""The robot and its controller as nodes, and their command line.

The scenario ``MobileRobot`` of `rtamt_envs` models the robot; its topics are as in the simulator
STDR: it takes ``robot0/cmd_vel`` (``geometry_msgs/Twist``), moves ten times a second and publishes
``robot0/odom`` (``nav_msgs/Odometry``): the pose, and the twist with noise. The twist follows the
command at once or with a lag; the pose stays where a wall is. The controller reads the odometry
and drives through the door to the desk and on to the dock, as the baseline of the scenario does.
Both take a fault, so that a requirement breaks when it is told to. The command line has the two
robots of `rtamt_ros.simulator.service_robots` too.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rtamt_envs.mobile_robot import ROUTE, SCENARIO, drive, next_point
from rtamt_envs.two_service_robots import SCENARIO as TWO

from rtamt import InputError
from rtamt_ros.generation import chosen, open_node, split
from rtamt_ros.middleware import Level, Middleware
from rtamt_ros.simulator.parameters import checked_row
from rtamt_ros.simulator.service_robots import ServiceController, ServiceRobots

__all__ = ["Robot", "RobotController", "Stuck", "Surge"]

_ROBOT, _TWO = "mobile-robot", "two-service-robots"
PERIOD = round(SCENARIO.period * 1e9)
"""Nanoseconds between odometry, and between commands."""


class Stuck(NamedTuple):
    """A fault of the robot: its wheels are blocked, whatever is commanded.

    Attributes:
        begin: Seconds from its first command.
        duration: Seconds that it lasts.
    """

    begin: float
    duration: float


class Surge(NamedTuple):
    """A fault of the controller: it commands one speed straight ahead.

    Attributes:
        begin: Seconds from its first odometry.
        duration: Seconds that it lasts.
        speed: The speed in m/s.
    """

    begin: float
    duration: float
    speed: float


def _lasts(fault: Stuck | Surge, steps: int) -> bool:
    """Whether a fault lasts over the step that comes after this many."""
    begin = round(fault.begin / SCENARIO.period)
    return begin <= steps < begin + round(fault.duration / SCENARIO.period)


class Robot:
    """A robot that subscribes to ``NAME/cmd_vel`` and publishes ``NAME/odom``.

    Args:
        node: The node that it runs in.
        name: The namespace of its topics, and of its frames.
        parameters: Parameters of the scenario by name: ``lag`` in seconds, ``noise`` as a fraction
            of the twist, and where it starts.
        seed: The seed of the noise.
        stuck: When its wheels are blocked.

    Raises:
        InputError: If a parameter has no such name, or a value or the seed is not in its range.
    """

    def __init__(
        self,
        node: Middleware,
        name: str = "robot0",
        *,
        parameters: Mapping[str, float] | None = None,
        seed: int = 0,
        stuck: Stuck | None = None,
    ) -> None:
        self._parameters = checked_row(SCENARIO, parameters or {}, seed)
        self._at_once = SCENARIO.parameter_row({"lag": 0.0}, self._parameters)
        self._random = np.random.default_rng(seed)
        self._stuck = stuck
        self._steps = 0
        self._command: NDArray[np.float64] | None = None
        self._state = np.zeros(SCENARIO.state)
        self._seen = np.zeros(len(SCENARIO.observations))
        SCENARIO.start(self._parameters, np.zeros(SCENARIO.noise), self._state, self._seen)
        self._node = node
        self._name = name
        self._message = node.message_class("nav_msgs", "Odometry")
        twist = node.message_class("geometry_msgs", "Twist")
        self._odometry = node.publisher(f"{name}/odom", self._message, latched=False)
        node.subscribe(f"{name}/cmd_vel", twist, self._take)
        node.every(PERIOD, self._step)

    def _take(self, twist: Any) -> None:  # noqa: ANN401 - the classes of ROS have no types
        command = np.array([twist.linear.x, twist.angular.z])
        if np.isnan(command).any():  # the robot would be never from then on
            self._node.log(Level.WARN, "a command that is nan is left out")
            return
        low, high = np.array([each[2:] for each in SCENARIO.actions]).T
        self._command = np.clip(command, low, high)

    def _step(self, _due: int) -> None:
        """Moves for a period and says where the robot is then."""
        command, parameters = self._command, self._parameters
        if command is None:  # it stands
            command = np.zeros(len(SCENARIO.actions))
        else:
            if self._stuck is not None and _lasts(self._stuck, self._steps):
                if not _lasts(self._stuck, self._steps - 1):
                    self._node.log(Level.WARN, "the wheels are blocked")
                command, parameters = np.zeros_like(command), self._at_once
            self._steps += 1
        noise = self._random.standard_normal(SCENARIO.noise)
        SCENARIO.step(command, parameters, noise, self._state, self._seen)
        x, y, heading, v, w = map(float, self._seen[:5])
        message = self._message()
        self._node.set_stamp(message, self._node.now())
        message.header.frame_id = f"{self._name}/odom"
        message.child_frame_id = f"{self._name}/base_link"
        message.pose.pose.position.x = x
        message.pose.pose.position.y = y
        message.pose.pose.orientation.z = math.sin(heading / 2)
        message.pose.pose.orientation.w = math.cos(heading / 2)
        message.twist.twist.linear.x = v
        message.twist.twist.angular.z = w
        self._odometry.publish(message)


class RobotController:
    """A controller that subscribes to ``NAME/odom`` and publishes ``NAME/cmd_vel``.

    It commands ten times a second from its first odometry on, also when no more odometry comes.

    Args:
        node: The node that it runs in.
        name: The namespace of the topics of its robot.
        surge: When it commands one speed instead.
    """

    def __init__(
        self, node: Middleware, name: str = "robot0", *, surge: Surge | None = None
    ) -> None:
        self._surge = surge
        self._steps = 0
        self._point = 0
        self._pose: tuple[float, float, float] | None = None
        self._node = node
        self._message = node.message_class("geometry_msgs", "Twist")
        odometry = node.message_class("nav_msgs", "Odometry")
        self._command = node.publisher(f"{name}/cmd_vel", self._message, latched=False)
        node.subscribe(f"{name}/odom", odometry, self._take)
        node.every(PERIOD, self._step)

    def _take(self, odometry: Any) -> None:  # noqa: ANN401
        pose = odometry.pose.pose
        heading = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
        self._pose = pose.position.x, pose.position.y, heading
        self._point = next_point(pose.position.x, pose.position.y, self._point)

    def _step(self, _due: int) -> None:
        """Commands what the baseline of the scenario does, or the fault."""
        if self._pose is None:
            return
        speed, turn = drive(*self._pose, *ROUTE[self._point])
        surge = self._surge
        if surge is not None and _lasts(surge, self._steps):
            if not _lasts(surge, self._steps - 1):
                self._node.log(Level.WARN, f"{surge.speed:g} m/s are commanded")
            speed, turn = surge.speed, 0.0
        self._steps += 1
        message = self._message()
        message.linear.x, message.angular.z = float(speed), float(turn)
        self._command.publish(message)


def _stuck(text: str) -> Stuck:
    """Reads ``BEGIN:DURATION``."""
    return Stuck(*_numbers(text, ("BEGIN", "DURATION"), "5:1"))


def _surge(text: str) -> Surge:
    """Reads ``BEGIN:DURATION:SPEED``."""
    return Surge(*_numbers(text, ("BEGIN", "DURATION", "SPEED"), "5:1:-0.5"))


def _numbers(text: str, names: Sequence[str], example: str) -> list[float]:
    """Reads numbers between colons: a begin, a duration, and others."""
    try:
        begin, duration, *_ = found = list(map(float, text.split(":")))
        good = begin >= 0 and duration > 0 and all(map(math.isfinite, found))
    except ValueError:
        good = False
    if not good or len(found) != len(names):
        raise argparse.ArgumentTypeError(
            f"expected {':'.join(names)} in seconds, such as {example}, got {text!r}"
        )
    return found


def _parser(model: str = _ROBOT) -> argparse.ArgumentParser:
    """The command line of a model."""
    is_robot = model == _ROBOT
    scenario = SCENARIO if is_robot else TWO
    what = (
        "A robot that drives through two rooms, and its controller,"
        if is_robot
        else "Two robots that carry things through one room, and their controller,"
    )
    parser = argparse.ArgumentParser(
        prog="python -m rtamt_ros.simulator",
        description=f"{what} as a node of ROS. It runs until Ctrl-C.",
        epilog="Remappings go to ROS: robot0/odom:=odom on ROS 1, --ros-args -r robot0/odom:=odom "
        "on ROS 2.",
        allow_abbrev=False,
    )
    parser.add_argument("--only", choices=("robot", "controller"), help="one of both")
    parser.add_argument(
        "--ros", type=int, choices=(1, 2), help="its generation (default: what is installed)"
    )
    parser.add_argument(
        "--model",
        choices=(_ROBOT, _TWO),
        default=_ROBOT,
        help=f"what is simulated (default: {_ROBOT}); each has options of its own: "
        "--model NAME --help",
    )
    name = "robot0" if is_robot else "robot"
    meaning = "namespace of the topics" if is_robot else "the topics are in NAME0 and NAME1"
    parser.add_argument("--name", default=name, help=f"{meaning} (default: {name})")
    for each in scenario.parameters:
        unit = f" in {each.unit}" if each.unit else ""
        parser.add_argument(
            f"--{each.name.replace('_', '-')}",
            type=float,
            default=each.default,
            metavar="X",
            help=f"{each.about}{unit} (default: {each.default:g})",
        )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the noise")
    if not is_robot:
        return parser
    parser.add_argument(
        "--stuck",
        type=_stuck,
        metavar="BEGIN:DURATION",
        help="seconds from the first command after which the wheels are blocked, and for how many",
    )
    parser.add_argument(
        "--surge",
        type=_surge,
        metavar="BEGIN:DURATION:SPEED",
        help="seconds from the first odometry after which this speed in m/s is commanded, and for "
        "how many",
    )
    return parser


def _fill(
    node: Middleware, model: str, options: argparse.Namespace, parameters: Mapping[str, float]
) -> None:
    """Puts the robots and the controller of a model into a node, or one of both."""
    moves, drives = options.only != "controller", options.only != "robot"
    if model == _TWO:
        if moves:
            ServiceRobots(node, options.name, parameters=parameters, seed=options.seed)
        if drives:
            ServiceController(node, options.name, parameters=parameters)
        return
    if moves:
        Robot(node, options.name, parameters=parameters, seed=options.seed, stuck=options.stuck)
    if drives:
        RobotController(node, options.name, surge=options.surge)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the robot, the controller or both until the node ends; returns the exit code.

    Args:
        arguments: The words of a command line; None: the program's own.
    """
    given = sys.argv[1:] if arguments is None else arguments
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    first.add_argument("--model", default=_ROBOT)
    model = first.parse_known_args(given)[0].model
    parser = _parser(model)
    options, of_ros = split(parser, given)
    scenario = SCENARIO if model == _ROBOT else TWO
    parameters = {each.name: getattr(options, each.name) for each in scenario.parameters}
    try:
        checked_row(scenario, parameters, options.seed)  # before a node waits for a master
        generation = chosen(options.ros)
        node = open_node(generation, options.only or "simulator", of_ros.of(generation))
        _fill(node, model, options, parameters)
    except InputError as error:
        parser.error(str(error))
    code = node.spin()
    node.close()
    return code
