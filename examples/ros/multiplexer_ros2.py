"""Pass velocity commands on while a monitored requirement permits it; otherwise, stop the robot.

Run it with the topics remapped:

    python multiplexer_ros2.py --ros-args -r state:=rtamt/out/state -r commands:=nav/cmd_vel

It stops the robot if the requirement is violated, if an input is stale, if the state is silent for
half a second, and if the monitor hangs or is dead.
"""

import time
from contextlib import suppress
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy, QoSProfile

SILENCE = 0.5  # seconds without a state: five periods of the monitor
LEASE = 1.0  # seconds: at least the larger of 1 s and five periods of the monitor
WARN = 1  # the level of a requirement that holds now, with a warning


def permits(state: DiagnosticArray) -> bool:
    """Return whether every requirement of a message permits the robot to move."""
    return bool(state.status) and all(
        ord(status.level) <= WARN
        and {pair.key: pair.value for pair in status.values}["verdict"]
        in ("UNDECIDED", "SATISFIED")
        for status in state.status
    )


class Multiplexer(Node):  # type: ignore[misc] # rclpy has no types
    """A node between a controller and a robot."""

    def __init__(self) -> None:
        super().__init__("multiplexer")
        self._permitted = False
        self._state_at = -SILENCE
        self._alive = False
        alive = QoSProfile(
            depth=1,
            liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
            liveliness_lease_duration=Duration(seconds=LEASE),
        )
        events = SubscriptionEventCallbacks(
            liveliness=self._take_liveliness, use_default_callbacks=False
        )
        self._robot = self.create_publisher(Twist, "cmd_vel", 1)
        self.create_subscription(
            DiagnosticArray, "state", self._take_state, alive, event_callbacks=events
        )
        self.create_subscription(Twist, "commands", self._take_command, 1)
        self.create_timer(0.1, self._stop)

    def _take_state(self, state: DiagnosticArray) -> None:
        self._permitted, self._state_at = permits(state), time.monotonic()
        self._stop()

    def _take_liveliness(self, event: Any) -> None:
        self._alive = event.alive_count > 0
        self._stop()

    def _take_command(self, command: Twist) -> None:
        if self._may_move():
            self._robot.publish(command)

    def _may_move(self) -> bool:
        silent = time.monotonic() - self._state_at > SILENCE
        return self._permitted and self._alive and not silent

    def _stop(self) -> None:
        if not self._may_move():
            self._robot.publish(Twist())


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Multiplexer())


if __name__ == "__main__":
    main()
