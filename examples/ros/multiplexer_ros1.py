"""Pass velocity commands on while a monitored requirement permits it; otherwise, stop the robot.

Run it with the topics remapped:

    python multiplexer_ros1.py state:=rtamt/out/state commands:=nav/cmd_vel

It stops the robot if the requirement is violated, if an input is stale, and if the stamp of the
last state is older than half a second, as after the end of the monitor.
"""

import threading
from typing import Any

import rospy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Twist

SILENCE = 0.5  # seconds: five periods of the monitor
WARN = 1  # the level of a requirement that holds now, with a warning


def permits(state: DiagnosticArray) -> bool:
    """Return whether every requirement of a message permits the robot to move."""
    return bool(state.status) and all(
        status.level <= WARN
        and {pair.key: pair.value for pair in status.values}["verdict"]
        in ("UNDECIDED", "SATISFIED")
        for status in state.status
    )


class Multiplexer:
    """A node between a controller and a robot."""

    def __init__(self) -> None:
        self._lock = threading.Lock()  # rospy calls back in several threads
        self._permitted = False
        self._stamp = rospy.Time()
        self._robot = rospy.Publisher("cmd_vel", Twist, queue_size=1)
        rospy.Subscriber("state", DiagnosticArray, self._take_state, queue_size=1)
        rospy.Subscriber("commands", Twist, self._take_command, queue_size=1)
        rospy.Timer(rospy.Duration(0.1), self._stop)

    def _take_state(self, state: DiagnosticArray) -> None:
        self._permitted, self._stamp = permits(state), state.header.stamp
        self._stop()

    def _take_command(self, command: Twist) -> None:
        with self._lock:
            if self._may_move():
                self._robot.publish(command)

    def _may_move(self) -> bool:
        silent = rospy.Time.now() - self._stamp > rospy.Duration(SILENCE)
        return self._permitted and not silent

    def _stop(self, _event: Any = None) -> None:
        with self._lock:
            if not self._may_move():
                self._robot.publish(Twist())


if __name__ == "__main__":
    rospy.init_node("multiplexer")
    Multiplexer()
    rospy.spin()
