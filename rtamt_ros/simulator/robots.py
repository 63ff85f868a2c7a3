"""Simulated robots and their controllers as nodes of ROS, and their command line.

`Robot` and `RobotController` are the scenario ``MobileRobot`` of `rtamt_envs`, with the topics of
the simulator STDR. `ServiceRobots` and `ServiceController` are the scenario ``TwoServiceRobots``.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rtamt_envs.mobile_robot import ROUTE, drive, next_point
from rtamt_envs.mobile_robot import SCENARIO as ONE
from rtamt_envs.scenario import Scenario
from rtamt_envs.two_service_robots import REACHED, STATIONS, VELOCITY
from rtamt_envs.two_service_robots import SCENARIO as TWO

from rtamt import InputError
from rtamt_ros.generation import choose_generation, open_node, split_arguments
from rtamt_ros.middleware import Level, Middleware


def _nanoseconds(scenario: Scenario) -> int:
    """Return the nanoseconds between odometry messages, and between commands."""
    return round(scenario.period * 1e9)


def checked_row(
    scenario: Scenario, parameters: Mapping[str, float], seed: int
) -> NDArray[np.float64]:
    """Return the parameters of a scenario with defaults; raise InputError outside the ranges."""
    row = scenario.parameter_row(parameters, scenario.defaults)
    for parameter in scenario.parameters:
        if (
            parameter.name in parameters
            and not parameter.low <= parameters[parameter.name] <= parameter.high
        ):
            raise InputError(
                f"expected {parameter.name} from {parameter.low:g} to {parameter.high:g}, "
                f"got {parameters[parameter.name]:g}"
            )
    if seed < 0:
        raise InputError(f"expected a seed of at least 0, got {seed}")
    return row


class Stuck(NamedTuple):
    """A fault of the robot: its wheels are blocked.

    Attributes:
        begin: Seconds from its first command.
        duration: Seconds.
    """

    begin: float
    duration: float


class Surge(NamedTuple):
    """A fault of the controller: it commands a speed straight ahead.

    Attributes:
        begin: Seconds from its first odometry.
        duration: Seconds.
        speed: The speed in m/s.
    """

    begin: float
    duration: float
    speed: float


def _lasts(fault: Stuck | Surge, steps: int) -> bool:
    """Return whether a fault covers the step after this number of steps."""
    begin = round(fault.begin / ONE.period)
    return begin <= steps < begin + round(fault.duration / ONE.period)


class Robot:
    """A robot that subscribes to ``NAME/cmd_vel`` and publishes ``NAME/odom``.

    Args:
        node: Its node.
        name: The namespace of its topics and frames.
        parameters: Parameters of the scenario ``MobileRobot`` by name.
        seed: The seed of the noise.
        stuck: The time when its wheels are blocked; None for never.

    Raises:
        InputError: If a parameter is unknown, or a value or the seed is out of range.
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
        self._parameters = checked_row(ONE, parameters or {}, seed)
        self._without_lag = ONE.parameter_row({"lag": 0.0}, self._parameters)
        self._random = np.random.default_rng(seed)
        self._stuck = stuck
        self._steps = 0
        self._command: NDArray[np.float64] | None = None
        self._state = np.zeros(ONE.state)
        self._seen = np.zeros(len(ONE.observations))
        ONE.start(self._parameters, np.zeros(ONE.noise), self._state, self._seen)
        self._node = node
        self._name = name
        self._message = node.message_class("nav_msgs", "Odometry")
        twist = node.message_class("geometry_msgs", "Twist")
        self._odometry = node.publisher(f"{name}/odom", self._message, latched=False)
        node.subscribe(f"{name}/cmd_vel", twist, self._take)
        node.every(_nanoseconds(ONE), self._step)

    def _take(self, twist: Any) -> None:  # noqa: ANN401 - the classes of ROS have no types
        command = np.array([twist.linear.x, twist.angular.z])
        if np.isnan(command).any():  # it would make the state nan
            self._node.log(Level.WARN, "a command that is nan is left out")
            return
        low, high = np.array([action[2:] for action in ONE.actions]).T
        self._command = np.clip(command, low, high)

    def _step(self, _due: int) -> None:
        """Move for a period, and publish the odometry."""
        command, parameters = self._command, self._parameters
        if command is None:  # before the first command
            command = np.zeros(len(ONE.actions))
        else:
            if self._stuck is not None and _lasts(self._stuck, self._steps):
                if not _lasts(self._stuck, self._steps - 1):
                    self._node.log(Level.WARN, "the wheels are blocked")
                command, parameters = np.zeros_like(command), self._without_lag
            self._steps += 1
        noise = self._random.standard_normal(ONE.noise)
        ONE.step(command, parameters, noise, self._state, self._seen)
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

    It publishes ten commands per second after its first odometry, even if no more odometry arrives.

    Args:
        node: Its node.
        name: The namespace of the topics of its robot.
        surge: The time when it commands another speed; None for never.
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
        node.every(_nanoseconds(ONE), self._step)

    def _take(self, odometry: Any) -> None:  # noqa: ANN401
        pose = odometry.pose.pose
        heading = 2 * math.atan2(pose.orientation.z, pose.orientation.w)
        self._pose = pose.position.x, pose.position.y, heading
        self._point = next_point(pose.position.x, pose.position.y, self._point)

    def _step(self, _due: int) -> None:
        """Publish the command of the baseline of the scenario, or of the fault."""
        if self._pose is None:
            return
        speed, turn = drive(*self._pose, *ROUTE[self._point])
        surge = self._surge
        if surge is not None and _lasts(surge, self._steps):
            if not _lasts(surge, self._steps - 1):
                self._node.log(Level.WARN, f"the command is {surge.speed:g} m/s")
            speed, turn = surge.speed, 0.0
        self._steps += 1
        message = self._message()
        message.linear.x, message.angular.z = float(speed), float(turn)
        self._command.publish(message)


_ROBOTS = range(2)


class ServiceRobots:
    """Robots that subscribe to ``NAME0/cmd_vel`` and ``NAME1/cmd_vel`` and publish ``odom`` there.

    Args:
        node: Their node.
        name: The start of the namespaces of their topics and frames.
        parameters: Parameters of the scenario ``TwoServiceRobots`` by name.
        seed: The seed of the noise.

    Raises:
        InputError: If a parameter is unknown, or a value or the seed is out of range.
    """

    def __init__(
        self,
        node: Middleware,
        name: str = "robot",
        *,
        parameters: Mapping[str, float] | None = None,
        seed: int = 0,
    ) -> None:
        self._parameters = checked_row(TWO, parameters or {}, seed)
        self._random = np.random.default_rng(seed)
        self._commands = np.zeros(len(TWO.actions))
        self._state = np.zeros(TWO.state)
        self._seen = np.zeros(len(TWO.observations))
        TWO.start(self._parameters, np.zeros(TWO.noise), self._state, self._seen)
        self._node = node
        self._names = [f"{name}{robot}" for robot in _ROBOTS]
        self._message = node.message_class("nav_msgs", "Odometry")
        twist = node.message_class("geometry_msgs", "Twist")
        self._odometry = [
            node.publisher(f"{topic}/odom", self._message, latched=False) for topic in self._names
        ]
        for robot, topic in enumerate(self._names):
            node.subscribe(f"{topic}/cmd_vel", twist, partial(self._take, robot))
        node.every(_nanoseconds(TWO), self._step)

    def _take(self, robot: int, twist: Any) -> None:  # noqa: ANN401 - the classes of ROS have no types
        command = np.array([twist.linear.x, twist.linear.y])
        if np.isnan(command).any():  # it would make the state nan
            self._node.log(Level.WARN, "a command that is nan is left out")
            return
        entries = slice(2 * robot, 2 * robot + 2)
        low, high = np.array([action[2:] for action in TWO.actions[entries]]).T
        self._commands[entries] = np.clip(command, low, high)

    def _step(self, _due: int) -> None:
        """Move both for a period, and publish their odometry."""
        noise = self._random.standard_normal(TWO.noise)
        TWO.step(self._commands, self._parameters, noise, self._state, self._seen)
        now = self._node.now()
        for robot, name in enumerate(self._names):
            message = self._message()
            self._node.set_stamp(message, now)
            message.header.frame_id = "room"
            message.child_frame_id = f"{name}/base_link"
            position, linear = message.pose.pose.position, message.twist.twist.linear
            position.x, position.y = map(float, self._seen[2 * robot : 2 * robot + 2])
            begin = VELOCITY + 2 * robot
            linear.x, linear.y = map(float, self._state[begin : begin + 2])
            message.pose.pose.orientation.w = 1.0
            self._odometry[robot].publish(message)


class ServiceController:
    """A controller that subscribes to the odometry of both robots and publishes their commands.

    It publishes ten commands per second after the first odometry of both. A robot at one of its
    stations goes to the other station next.

    Args:
        node: Its node.
        name: As for the robots.
        parameters: Parameters of the scenario; the controller uses ``speed`` and ``caution``.
    """

    def __init__(
        self,
        node: Middleware,
        name: str = "robot",
        *,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self._parameters = checked_row(TWO, parameters or {}, 0)
        self._seen = np.full(len(TWO.observations), np.nan)
        self._stations = [1, 1]
        for robot in _ROBOTS:
            self._aim(robot)
        self._action = np.zeros(len(TWO.actions))
        self._message = node.message_class("geometry_msgs", "Twist")
        odometry = node.message_class("nav_msgs", "Odometry")
        self._commands = []
        for robot in _ROBOTS:
            topic = f"{name}{robot}"
            self._commands.append(node.publisher(f"{topic}/cmd_vel", self._message, latched=False))
            node.subscribe(f"{topic}/odom", odometry, partial(self._take, robot))
        node.every(_nanoseconds(TWO), self._step)

    def _aim(self, robot: int) -> None:
        target = slice(4 + 2 * robot, 6 + 2 * robot)
        self._seen[target] = STATIONS[2 * robot + self._stations[robot]]

    def _take(self, robot: int, odometry: Any) -> None:  # noqa: ANN401
        position = odometry.pose.pose.position
        self._seen[2 * robot : 2 * robot + 2] = position.x, position.y
        right, up = self._seen[4 + 2 * robot : 6 + 2 * robot] - (position.x, position.y)
        if right * right + up * up <= REACHED * REACHED:
            self._stations[robot] = 1 - self._stations[robot]
            self._aim(robot)

    def _step(self, _due: int) -> None:
        """Publish the commands of the baseline of the scenario."""
        if np.isnan(self._seen).any():
            return
        TWO.baseline(0.0, self._seen, self._parameters, self._action)
        for robot in _ROBOTS:
            message = self._message()
            right, up = self._action[2 * robot : 2 * robot + 2]
            message.linear.x, message.linear.y = float(right), float(up)
            self._commands[robot].publish(message)


_ROBOT, _TWO = "mobile-robot", "two-service-robots"


def _stuck(text: str) -> Stuck:
    """Parse ``BEGIN:DURATION``."""
    return Stuck(*_numbers(text, ("BEGIN", "DURATION"), "5:1"))


def _surge(text: str) -> Surge:
    """Parse ``BEGIN:DURATION:SPEED``."""
    return Surge(*_numbers(text, ("BEGIN", "DURATION", "SPEED"), "5:1:-0.5"))


def _numbers(text: str, names: Sequence[str], example: str) -> list[float]:
    """Parse numbers between colons, first a start and a duration."""
    try:
        begin, duration, *_ = numbers = list(map(float, text.split(":")))
        good = begin >= 0 and duration > 0 and all(map(math.isfinite, numbers))
    except ValueError:
        good = False
    if not good or len(numbers) != len(names):
        raise argparse.ArgumentTypeError(
            f"expected {':'.join(names)} in seconds, such as {example}, got {text!r}"
        )
    return numbers


def _parser(model: str = _ROBOT) -> argparse.ArgumentParser:
    """Return the parser of a model."""
    is_robot = model == _ROBOT
    scenario = ONE if is_robot else TWO
    subject = (
        "A robot that drives through two rooms, and its controller,"
        if is_robot
        else "Two robots that carry things through one room, and their controller,"
    )
    parser = argparse.ArgumentParser(
        prog="python -m rtamt_ros.simulator",
        description=f"{subject} as a node of ROS. It runs until Ctrl-C.",
        epilog="Remappings go to ROS: robot0/odom:=odom on ROS 1, --ros-args -r robot0/odom:=odom "
        "on ROS 2.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "--only",
        choices=("robot", "controller"),
        help="simulate only the robot or only the controller",
    )
    parser.add_argument(
        "--ros", type=int, choices=(1, 2), help="ROS 1 or ROS 2 (default: the installed one)"
    )
    parser.add_argument(
        "--model",
        choices=(_ROBOT, _TWO),
        default=_ROBOT,
        help=f"the robots (default: {_ROBOT}); --model NAME --help lists the options of a model",
    )
    name = "robot0" if is_robot else "robot"
    meaning = "namespace of the topics" if is_robot else "the topics are in NAME0 and NAME1"
    parser.add_argument("--name", default=name, help=f"{meaning} (default: {name})")
    for parameter in scenario.parameters:
        unit = f" in {parameter.unit}" if parameter.unit else ""
        parser.add_argument(
            f"--{parameter.name.replace('_', '-')}",
            type=float,
            default=parameter.default,
            metavar="X",
            help=f"{parameter.about}{unit} (default: {parameter.default:g})",
        )
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="seed of the noise")
    if not is_robot:
        return parser
    parser.add_argument(
        "--stuck",
        type=_stuck,
        metavar="BEGIN:DURATION",
        help="block the wheels from BEGIN seconds after the first command on, for DURATION seconds",
    )
    parser.add_argument(
        "--surge",
        type=_surge,
        metavar="BEGIN:DURATION:SPEED",
        help="command SPEED in m/s from BEGIN seconds after the first odometry on, for DURATION "
        "seconds",
    )
    return parser


def _fill(
    node: Middleware, model: str, options: argparse.Namespace, parameters: Mapping[str, float]
) -> None:
    """Add the robots, the controller or both to a node."""
    with_robots, with_controller = options.only != "controller", options.only != "robot"
    if model == _TWO:
        if with_robots:
            ServiceRobots(node, options.name, parameters=parameters, seed=options.seed)
        if with_controller:
            ServiceController(node, options.name, parameters=parameters)
        return
    if with_robots:
        Robot(node, options.name, parameters=parameters, seed=options.seed, stuck=options.stuck)
    if with_controller:
        RobotController(node, options.name, surge=options.surge)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the robots, the controller or both until the node ends; return the exit code.

    Args:
        arguments: The words of a command line; None for those of the program.
    """
    words = sys.argv[1:] if arguments is None else arguments
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    first.add_argument("--model", default=_ROBOT)
    model = first.parse_known_args(words)[0].model
    parser = _parser(model)
    options, ros_arguments = split_arguments(parser, words)
    scenario = ONE if model == _ROBOT else TWO
    parameters = {
        parameter.name: getattr(options, parameter.name) for parameter in scenario.parameters
    }
    try:
        checked_row(scenario, parameters, options.seed)  # before a node waits for a master
        generation = choose_generation(options.ros)
        node = open_node(
            generation, options.only or "simulator", ros_arguments.for_generation(generation)
        )
        _fill(node, model, options, parameters)
    except InputError as error:
        parser.error(str(error))
    code = node.spin()
    node.close()
    return code
