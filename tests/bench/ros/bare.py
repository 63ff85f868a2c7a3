# ruff: noqa: ANN401 - the classes of ROS have no types
"""rospy and rclpy without a monitor: processes that publish, receive and forward messages."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from importlib import import_module
from typing import Any, Protocol

DEPTH = 1000
"""The queue size, so large that a slow reader loses no message."""


class Bare(Protocol):
    """A node of ROS 1 or ROS 2 with a thread that runs callbacks."""

    def publisher(self, topic: str, message: type) -> Any:
        """Return an object with a method `publish`."""
        ...

    def subscribe(self, topic: str, message: type, callback: Callable[[Any], None]) -> None:
        """Call a function with every message."""
        ...

    def readers(self, publisher: Any) -> int:
        """Return the number of subscribers of a publisher."""
        ...

    def tick(self, publisher: Any, time: int) -> None:
        """Publish a time in nanoseconds on ``/clock``."""
        ...

    def close(self) -> None:
        """End the node."""
        ...


class Rospy:
    """A node of ROS 1."""

    def __init__(self, name: str) -> None:
        import rospy

        self._ros = rospy
        self._closed = False
        rospy.init_node(name, disable_signals=True, disable_rosout=True)

    def publisher(self, topic: str, message: type) -> Any:
        return self._ros.Publisher(topic, message, queue_size=DEPTH, tcp_nodelay=True)

    def subscribe(self, topic: str, message: type, callback: Callable[[Any], None]) -> None:
        self._ros.Subscriber(topic, message, callback, tcp_nodelay=True)

    def readers(self, publisher: Any) -> int:
        return publisher.get_num_connections()

    def tick(self, publisher: Any, time: int) -> None:
        clock = message_class("rosgraph_msgs", "Clock")()
        clock.clock = self._ros.Time(time // 10**9, time % 10**9)
        publisher.publish(clock)

    def close(self) -> None:
        self._ros.signal_shutdown("the measurement is over")


class Rclpy:
    """A node of ROS 2; an executor with one thread runs its callbacks."""

    def __init__(self, name: str) -> None:
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        self._ros = rclpy
        rclpy.init()
        self._node = rclpy.create_node(name)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self) -> None:
        while not self._stopping.is_set():
            self._executor.spin_once(timeout_sec=0.2)

    def publisher(self, topic: str, message: type) -> Any:
        return self._node.create_publisher(message, topic, DEPTH)

    def subscribe(self, topic: str, message: type, callback: Callable[[Any], None]) -> None:
        self._node.create_subscription(message, topic, callback, DEPTH)
        self._executor.wake()

    def readers(self, publisher: Any) -> int:
        return publisher.get_subscription_count()

    def tick(self, publisher: Any, time: int) -> None:
        clock = message_class("rosgraph_msgs", "Clock")()
        clock.clock.sec, clock.clock.nanosec = divmod(time, 10**9)
        publisher.publish(clock)

    def close(self) -> None:
        self._stopping.set()
        self._thread.join()
        self._node.destroy_node()
        self._ros.shutdown()


def node(generation: int, name: str) -> Bare:
    """Return a bare node of a generation of ROS."""
    return Rospy(name) if generation == 1 else Rclpy(name)


def message_class(package: str, name: str) -> type:
    """Return a message class, such as ``geometry_msgs``, ``Twist``."""
    return getattr(import_module(f"{package}.msg"), name)


def stamp(message: Any) -> int:
    """Return the nanoseconds in the header of a message; 0 without a header."""
    header = getattr(message, "header", None)
    if header is None:
        return 0
    if hasattr(header.stamp, "to_nsec"):
        return header.stamp.to_nsec()
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def set_stamp(message: Any, time: int) -> None:
    """Set the time in the header of a message."""
    stamp_field, (seconds, nanoseconds) = message.header.stamp, divmod(time, 10**9)
    if hasattr(stamp_field, "secs"):
        stamp_field.secs, stamp_field.nsecs = seconds, nanoseconds
    else:
        stamp_field.sec, stamp_field.nanosec = seconds, nanoseconds


def resident(process: int) -> int:
    """Return the bytes of memory that a process holds."""
    with open(f"/proc/{process}/statm") as file:  # noqa: PTH123 - a file of the kernel
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def processor(process: int) -> float:
    """Return the processor time of a process in seconds."""
    with open(f"/proc/{process}/stat") as file:  # noqa: PTH123 - a file of the kernel
        fields = file.read().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
