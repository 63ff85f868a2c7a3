"""The middleware of ROS 2, on rclpy.

It and `rtamt_ros.ros2_lifecycle` are the only modules that import rclpy and messages of ROS 2.
"""

from __future__ import annotations

import os
import re
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError  # rclpy has no public name for it
from rclpy.context import Context
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.type_support import check_for_type_support
from rclpy.utilities import remove_ros_args

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_ros.ending import Ending
from rtamt_ros.middleware import Handle, Level, Publisher
from rtamt_ros.parameters import DEPTH, Qos

__all__ = ["Ros2"]

_QOS: dict[Qos, ReliabilityPolicy] = {
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
    "reliable": ReliabilityPolicy.RELIABLE,
}
_SECOND = 1_000_000_000


class Ros2:
    """A node of ROS 2, as `rtamt_ros.middleware.Middleware` describes it.

    Callbacks run in one thread. What is published is reliable, which every subscription may ask
    for.

    Args:
        name: The name of the node, unless ``-r __node:=NAME`` in the arguments gives another.
        arguments: Such as ``--ros-args -r odom:=robot1/odom -p use_sim_time:=true``.
        make: Makes the node of rclpy from its name and a context.

    Attributes:
        node: The node of rclpy.
        qos: Of the subscriptions to come. ``"best_effort"`` hears every publisher, also those of
            sensor data; ``"reliable"`` hears reliable ones only, which send again what was lost.
        depth: How many messages of a topic wait for their callback before the oldest is dropped.
    """

    generation = 2

    def __init__(
        self, name: str, arguments: Sequence[str] = (), *, make: Callable[..., Node] = Node
    ) -> None:
        context = Context()
        with _refusals("arguments"):
            others = remove_ros_args(arguments)
            if others:
                raise InputError(f"ROS 2 has no argument {others[0]}; its own follow --ros-args")
            # rclpy takes the first argument for the program's name. Its handlers of signals would
            # end ROS while callbacks run: `spin` has its own.
            rclpy.init(
                args=[name, *arguments],
                context=context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
        try:
            with _refusals(f"node {name!r}"):
                self.node = make(name, context=context)
        except InputError:
            context.shutdown()
            raise
        self.name: str = self.node.get_fully_qualified_name()
        self.qos: Qos = "best_effort"
        self.depth = DEPTH
        self._clock = self.node.get_clock()
        self._spinning = threading.Lock()
        self._runner: threading.Thread | None = None
        self._ending = Ending()
        self._closing = False

    def message_class(self, package: str, name: str) -> type:
        try:
            module = import_module(f"{package}.msg")
        except ImportError as error:
            raise InputError(_not_installed(package)) from error
        found = getattr(module, name, None)
        if not isinstance(found, type):
            raise InputError(f"{package} has no message {name}{nearest(name, vars(module))}")
        try:
            check_for_type_support(found)
        except AttributeError as error:
            raise InputError(
                f"expected {package} of ROS 2, found that of ROS 1 in {module.__file__}: start "
                "from a terminal where only ROS 2 is set up"
            ) from error
        return found

    def now(self) -> int:
        time: int = self._clock.now().nanoseconds
        return time

    def is_simulated(self) -> bool:
        return bool(self._clock.ros_time_is_active)

    def resolve(self, topic: str) -> str:
        return str(self.node.resolve_topic_name(topic))

    def stamp(self, message: Any) -> int | None:
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        return stamp and (stamp.sec * _SECOND + stamp.nanosec or None)

    def set_stamp(self, message: Any, time: int) -> None:
        if hasattr(message, "header"):
            stamp = message.header.stamp
            stamp.sec, stamp.nanosec = divmod(time, _SECOND)

    def subscribe(self, topic: str, message: type, callback: Callable[[Any], None]) -> Handle:
        handle = _Handle(self, self.node.destroy_subscription, callback)
        qos = self.qos
        wanted = f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"

        def cannot_hear(_event: object) -> None:
            self.log(
                Level.ERROR,
                f"a publisher of {topic} is not {qos}: none of its messages come; "
                "set qos to best_effort",
            )

        def heard(message: Any) -> None:
            handle.called = True
            handle.call(message)

        def compare_types() -> None:  # DDS tells nobody of a publisher of another type
            publishers = self.node.get_publishers_info_by_topic(handle.entity.topic_name)
            others = sorted({each.topic_type for each in publishers} - {wanted})
            if others:
                self.log(
                    Level.ERROR,
                    f"a publisher of {topic} sends {', '.join(others)} instead of {wanted}: none "
                    "of its messages come",
                )
            if handle.watch is not None and (others or handle.called):
                handle.watch.close()

        with _refusals(f"topic {topic!r}"):
            handle.entity = self.node.create_subscription(
                message,
                topic,
                heard,
                QoSProfile(depth=self.depth, reliability=_QOS[qos]),
                event_callbacks=SubscriptionEventCallbacks(
                    incompatible_qos=cannot_hear, use_default_callbacks=False
                ),
            )
        handle.watch = self.every(_SECOND, compare_types)
        return handle

    def publisher(self, topic: str, message: type, *, latched: bool = True) -> Publisher:
        if latched:  # who comes late gets all that is kept: the last
            qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        else:
            qos = QoSProfile(depth=DEPTH)
        # Every event that rclpy may tell of costs time at every message that the node takes.
        events = PublisherEventCallbacks(use_default_callbacks=False)
        with _refusals(f"topic {topic!r}"):
            entity = self.node.create_publisher(message, topic, qos, event_callbacks=events)
        return _Publisher(self.node, entity, message)

    def every(self, period: int, callback: Callable[[], None]) -> Handle:
        handle = _Handle(self, self.node.destroy_timer, callback)

        def due() -> None:
            handle.call()

        handle.entity = self.node.create_timer(period / _SECOND, due)
        return handle

    def log(self, level: Level, text: str) -> None:
        logger = self.node.get_logger()
        # rclpy holds every line of a program to one level.
        if level is Level.OK:
            logger.info(text)
        elif level is Level.ERROR:
            logger.error(text)
        else:
            logger.warning(text)

    def spin(self) -> None:
        """Lets callbacks run until `close`, SIGINT or SIGTERM; no callback runs when it returns."""
        with self._spinning:
            executor = SingleThreadedExecutor(context=self.node.context)
            executor.add_node(self.node)

            def run() -> None:
                while not self._ending.asked:
                    try:
                        executor.spin()
                    except ExternalShutdownException:
                        self._ending.ask()
                    except Exception:  # noqa: BLE001 - of a service that rclpy offers
                        if not self._ending.asked:
                            self.log(Level.ERROR, traceback.format_exc())

            # The wait of rclpy does not return for a signal, that of an ending does.
            self._runner = threading.Thread(target=run, name=self.name)
            self._runner.start()
            self._ending.wait()
            executor.shutdown()
            self._runner.join()  # a callback that runs while ROS ends aborts the process
        if self._closing:
            self.close()

    def close(self) -> None:
        """Ends the node. In a callback it returns at once, and `spin` does the rest."""
        self._closing = True
        self._ending.ask()
        if threading.current_thread() is self._runner:
            return
        with self._spinning:
            if self.node.context.ok():
                self.node.destroy_node()
                self.node.context.shutdown()


class _Handle:
    """A subscription or a timer until it is closed; an exception ends one call only.

    Attributes:
        entity: The subscription or the timer of rclpy.
        called: Whether a message came.
        watch: A timer that looks after a subscription, and is closed with it.
    """

    def __init__(
        self, ros: Ros2, destroy: Callable[[Any], object], callback: Callable[..., None]
    ) -> None:
        self.entity: Any = None
        self.called = False
        self.watch: Handle | None = None
        self._ros = ros
        self._destroy = destroy
        self._callback: Callable[..., None] | None = callback

    def call(self, *arguments: object) -> None:
        callback = self._callback
        if callback is not None:  # it may have been closed since the message came
            try:
                callback(*arguments)
            except Exception:  # noqa: BLE001 - the node would end
                self._ros.log(Level.ERROR, traceback.format_exc())

    def close(self) -> None:
        if self._callback is not None:
            self._callback = None
            if self.watch is not None:
                self.watch.close()
            self._destroy(self.entity)


class _Publisher:
    """A publisher until it is closed; who comes late gets nothing any more."""

    def __init__(self, node: Node, entity: Any, message: type) -> None:
        self.message = message
        self.publish: Callable[[Any], None] = entity.publish
        self.close = lambda: node.destroy_publisher(entity)


@contextmanager
def _refusals(what: str) -> Iterator[None]:
    """Says what rclpy refuses, without the lines of its sources."""
    try:
        yield
    except (NameValidationException, RCLError) as error:
        reason = re.sub(r", at /\S+:\d+", "", str(error)).splitlines()[0].rstrip(":. ")
        raise InputError(f"{what}: {reason}") from error


def _not_installed(package: str) -> str:
    """Says how the messages of a package come to be installed."""
    if package == "rtamt_msgs":
        return (
            "the messages of rtamt_msgs are not installed: build the package rtamt_msgs with "
            "colcon and source its setup file, or publish std_msgs/Float64"
        )
    debian = f"ros-{os.environ.get('ROS_DISTRO', 'DISTRO')}-{package.replace('_', '-')}"
    return (
        f"the messages of {package} are not installed: apt-get install {debian}, or source the "
        "setup file of a workspace that has them"
    )
