"""Two service robots and their controller as nodes.

The scenario ``TwoServiceRobots`` of `rtamt_envs` models them: discs that roll in any direction, and
carry things between stations of one room. Each takes ``cmd_vel`` (``geometry_msgs/Twist``), a
velocity along x and y of the room, moves ten times a second and publishes ``odom``
(``nav_msgs/Odometry``). The controller reads the odometry of both and drives each to its next
station as the baseline of the scenario does, giving way where they meet.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from rtamt_envs.two_service_robots import REACHED, SCENARIO, STATIONS, VELOCITY

from rtamt_ros.middleware import Level, Middleware
from rtamt_ros.simulator.parameters import checked_row

__all__ = ["ServiceController", "ServiceRobots"]

PERIOD = round(SCENARIO.period * 1e9)
"""Nanoseconds between odometry, and between commands."""
_ROBOTS = range(2)


class ServiceRobots:
    """Robots that subscribe to ``NAME0/cmd_vel`` and ``NAME1/cmd_vel`` and publish ``odom`` there.

    Args:
        node: The node that they run in.
        name: What the namespaces of their topics begin with, and their frames.
        parameters: Parameters of the scenario by name.
        seed: The seed of the noise.

    Raises:
        InputError: If a parameter has no such name, or a value or the seed is not in its range.
    """

    def __init__(
        self,
        node: Middleware,
        name: str = "robot",
        *,
        parameters: Mapping[str, float] | None = None,
        seed: int = 0,
    ) -> None:
        self._parameters = checked_row(SCENARIO, parameters or {}, seed)
        self._random = np.random.default_rng(seed)
        self._commands = np.zeros(len(SCENARIO.actions))
        self._state = np.zeros(SCENARIO.state)
        self._seen = np.zeros(len(SCENARIO.observations))
        SCENARIO.start(self._parameters, np.zeros(SCENARIO.noise), self._state, self._seen)
        self._node = node
        self._names = [f"{name}{robot}" for robot in _ROBOTS]
        self._message = node.message_class("nav_msgs", "Odometry")
        twist = node.message_class("geometry_msgs", "Twist")
        self._odometry = [
            node.publisher(f"{each}/odom", self._message, latched=False) for each in self._names
        ]
        for robot, each in enumerate(self._names):
            node.subscribe(f"{each}/cmd_vel", twist, partial(self._take, robot))
        node.every(PERIOD, self._step)

    def _take(self, robot: int, twist: Any) -> None:  # noqa: ANN401 - the classes of ROS have no types
        command = np.array([twist.linear.x, twist.linear.y])
        if np.isnan(command).any():  # the robot would be never from then on
            self._node.log(Level.WARN, "a command that is nan is left out")
            return
        place = slice(2 * robot, 2 * robot + 2)
        low, high = np.array([each[2:] for each in SCENARIO.actions[place]]).T
        self._commands[place] = np.clip(command, low, high)

    def _step(self, _due: int) -> None:
        """Moves both for a period and says where they are then."""
        noise = self._random.standard_normal(SCENARIO.noise)
        SCENARIO.step(self._commands, self._parameters, noise, self._state, self._seen)
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

    It commands ten times a second, as soon as it has odometry of both. A robot that is at its
    station goes to the other one of its two next.

    Args:
        node: The node that it runs in.
        name: As for the robots.
        parameters: Parameters of the scenario by name, of which it reads ``speed`` and ``caution``.
    """

    def __init__(
        self,
        node: Middleware,
        name: str = "robot",
        *,
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        self._parameters = checked_row(SCENARIO, parameters or {}, 0)
        self._seen = np.full(len(SCENARIO.observations), np.nan)
        self._stations = [1, 1]
        for robot in _ROBOTS:
            self._aim(robot)
        self._action = np.zeros(len(SCENARIO.actions))
        self._message = node.message_class("geometry_msgs", "Twist")
        odometry = node.message_class("nav_msgs", "Odometry")
        self._commands = []
        for robot in _ROBOTS:
            topic = f"{name}{robot}"
            self._commands.append(node.publisher(f"{topic}/cmd_vel", self._message, latched=False))
            node.subscribe(f"{topic}/odom", odometry, partial(self._take, robot))
        node.every(PERIOD, self._step)

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
        """Commands what the baseline of the scenario does."""
        if np.isnan(self._seen).any():
            return
        SCENARIO.baseline(0.0, self._seen, self._parameters, self._action)
        for robot in _ROBOTS:
            message = self._message()
            right, up = self._action[2 * robot : 2 * robot + 2]
            message.linear.x, message.linear.y = float(right), float(up)
            self._commands[robot].publish(message)
