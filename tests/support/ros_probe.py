"""Print the messages of topics as lines of JSON, in a process with ROS only.

``python ros_probe.py 2 odom=nav_msgs/Odometry rtamt/out=std_msgs/Float64`` prints the topic, the
type, the time of arrival in nanoseconds and the bytes in hexadecimal digits; on ROS 1 also the md5
of the type, as the publisher sends it. ``+topic=...`` also requests the last message before the
start; ROS 1 always delivers latched messages. The first line is ``null`` once it listens. It uses
nothing of `rtamt_ros`, so it receives the same as any other program.
"""

from __future__ import annotations

import importlib
import json
import sys
from contextlib import suppress
from typing import Any


def said(topic: str, kind: str, time: int, data: bytes, md5: str | None = None) -> None:
    line = {"topic": topic, "kind": kind, "time": time, "data": data.hex(), "md5": md5}
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def listen1(topics: list[tuple[str, str]]) -> None:
    import rospy

    def take(message: Any, topic: str) -> None:  # noqa: ANN401 - it has no type
        header = message._connection_header
        time = rospy.Time.now().to_nsec()
        said(topic, header["type"], time, message._buff, header["md5sum"])

    rospy.init_node("probe", anonymous=True, disable_rosout=True)
    for topic in (topic.removeprefix("+") for topic, _ in topics):
        rospy.Subscriber(topic, rospy.AnyMsg, take, callback_args=topic)
    sys.stdout.write("null\n")
    sys.stdout.flush()
    rospy.spin()


def listen2(topics: list[tuple[str, str]]) -> None:
    import rclpy
    from rclpy.executors import ExternalShutdownException
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile

    rclpy.init()
    node = rclpy.create_node("probe", start_parameter_services=False)
    clock = node.get_clock()

    def subscribe(topic: str, kind: str) -> None:
        last = topic.startswith("+")
        policy = DurabilityPolicy.TRANSIENT_LOCAL if last else DurabilityPolicy.VOLATILE
        quality = QoSProfile(history=HistoryPolicy.KEEP_ALL, durability=policy)
        package, name = kind.split("/")
        node.create_subscription(
            getattr(importlib.import_module(f"{package}.msg"), name),
            topic.removeprefix("+"),
            lambda data: said(topic.removeprefix("+"), kind, clock.now().nanoseconds, data),
            quality,
            raw=True,
        )

    for topic, kind in topics:
        subscribe(topic, kind)
    sys.stdout.write("null\n")
    sys.stdout.flush()
    with suppress(ExternalShutdownException):
        rclpy.spin(node)


if __name__ == "__main__":
    generation, *arguments = sys.argv[1:]
    wanted = [(topic, kind) for topic, _, kind in (each.partition("=") for each in arguments)]
    {"1": listen1, "2": listen2}[generation](wanted)
