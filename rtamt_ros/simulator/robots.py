"""The simulated robots and their controllers as nodes of ROS.

`Robot` and `RobotController` are the scenario ``MobileRobot`` of `rtamt_envs`, with the topics of
the simulator STDR. `ServiceRobots` and `ServiceController` are the scenario ``TwoServiceRobots``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
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
from rtamt_ros.middleware import Level, Middleware


def _nanoseconds(scenario: Scenario) -> int:
    """Return the time between odometry messages, and between commands."""
    return round(scenario.period * 1e9)


def checked_row(
    scenario: Scenario, parameters: Mapping[str, float], seed: int
) -> NDArray[np.float64]:
    """Return the parameters of a scenario, with defaults; raise InputError outside their ranges."""
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
        node: The node that it runs in.
        name: The namespace of its topics and frames.
        parameters: Parameters of the scenario ``MobileRobot`` by name.
        seed: The seed of the noise.
        stuck: When its wheels are blocked.

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
        self._at_once = ONE.parameter_row({"lag": 0.0}, self._parameters)
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
                command, parameters = np.zeros_like(command), self._at_once
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

    It publishes ten commands a second after its first odometry, even if no more odometry comes.

    Args:
        node: The node that it runs in.
        name: The namespace of the topics of its robot.
        surge: When it commands another speed.
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
        """Command what the baseline of the scenario does, or the fault."""
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


_ROBOTS = range(2)


class ServiceRobots:
    """Robots that subscribe to ``NAME0/cmd_vel`` and ``NAME1/cmd_vel`` and publish ``odom`` there.

    Args:
        node: The node that they run in.
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
            node.publisher(f"{each}/odom", self._message, latched=False) for each in self._names
        ]
        for robot, each in enumerate(self._names):
            node.subscribe(f"{each}/cmd_vel", twist, partial(self._take, robot))
        node.every(_nanoseconds(TWO), self._step)

    def _take(self, robot: int, twist: Any) -> None:  # noqa: ANN401 - the classes of ROS have no types
        command = np.array([twist.linear.x, twist.linear.y])
        if np.isnan(command).any():  # it would make the state nan
            self._node.log(Level.WARN, "a command that is nan is left out")
            return
        place = slice(2 * robot, 2 * robot + 2)
        low, high = np.array([action[2:] for action in TWO.actions[place]]).T
        self._commands[place] = np.clip(command, low, high)

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

    It publishes ten commands a second, as soon as it has odometry of both. A robot at its station
    goes to its other station next.

    Args:
        node: The node that it runs in.
        name: As for the robots.
        parameters: Parameters of the scenario, of which it reads ``speed`` and ``caution``.
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
        place = slice(4 + 2 * robot, 6 + 2 * robot)
        self._seen[place] = STATIONS[2 * robot + self._stations[robot]]

    def _take(self, robot: int, odometry: Any) -> None:  # noqa: ANN401
        position = odometry.pose.pose.position
        self._seen[2 * robot : 2 * robot + 2] = position.x, position.y
        right, up = self._seen[4 + 2 * robot : 6 + 2 * robot] - (position.x, position.y)
        if right * right + up * up <= REACHED * REACHED:
            self._stations[robot] = 1 - self._stations[robot]
            self._aim(robot)

    def _step(self, _due: int) -> None:
        """Command what the baseline of the scenario does."""
        if np.isnan(self._seen).any():
            return
        TWO.baseline(0.0, self._seen, self._parameters, self._action)
        for robot in _ROBOTS:
            message = self._message()
            right, up = self._action[2 * robot : 2 * robot + 2]
            message.linear.x, message.linear.y = float(right), float(up)
            self._commands[robot].publish(message)
