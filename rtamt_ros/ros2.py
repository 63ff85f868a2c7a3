"""The middleware of ROS 2, on rclpy.

Only this module, `rtamt_ros.ros2_subscription` and `rtamt_ros.ros2_lifecycle` import rclpy and
messages of ROS 2.
"""

from __future__ import annotations

import os
import re
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from typing import Any

import rclpy
from rclpy._rclpy_pybind11 import RCLError  # there is no public name
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.exceptions import NameValidationException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.type_support import check_for_type_support
from rclpy.utilities import remove_ros_args

from rtamt import InputError
from rtamt_ros.callbacks import Callback, GridTimer, answered
from rtamt_ros.messages import installed
from rtamt_ros.middleware import Handle, Level, Publisher, TopicPublisher
from rtamt_ros.packed import Made, Packed
from rtamt_ros.parameters import DEPTH, Qos
from rtamt_ros.process import Ending
from rtamt_ros.ros2_subscription import Hearing, Ros2Subscription, keeps, type_name

_SECOND = 1_000_000_000


class Ros2:
    """A node of ROS 2, as `rtamt_ros.middleware.Middleware` describes it.

    Callbacks of messages run in one thread, and timers on the wall clock in others. On a simulated
    clock all run in one thread, so a tick comes after the messages that were sent before it.
    Publishers are reliable, which every subscription may request.

    Args:
        name: The name of the node, unless ``-r __node:=NAME`` in the arguments sets another.
        arguments: Such as ``--ros-args -r odom:=robot1/odom -p use_sim_time:=true``.
        make: Makes the node of rclpy from its name and a context.

    Attributes:
        node: The node of rclpy.
        qos: The quality of service of new subscriptions. ``"best_effort"`` receives from every
            publisher; ``"reliable"`` only from reliable ones, which send lost messages again.
        depth: The number of messages of a topic that wait before the oldest is dropped.
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
            # The first argument is the name of the program. The signal handlers of rclpy would end
            # ROS while callbacks run, so `spin` has its own.
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
        self._hearing = Hearing(self.node, partial(self.log, Level.ERROR))
        self._spinning = threading.Lock()
        self._runner: threading.Thread | None = None
        self._ending = Ending()
        self._closing = False
        self._timers: list[GridTimer] = []
        self._around: tuple[Level, str] | None = None

    def message_class(self, package: str, name: str) -> type:
        how = _how(package)
        if package == "rtamt_msgs":
            how = (
                "build the package rtamt_msgs with colcon and source its setup file, or publish "
                "std_msgs/Float64"
            )
        return installed(package, name, generation=2, is_its_own=_is_message, how=how)

    def trigger(self, name: str, act: Callable[[], str]) -> Handle:
        service = installed(
            "std_srvs",
            "Trigger",
            kind="service",
            generation=2,
            is_its_own=_is_service,
            how=_how("std_srvs"),
        )
        with _refusals(f"service ~/{name}"):
            return _Service(self, f"~/{name}", service, act)

    def now(self) -> int:
        nanoseconds: int = self._clock.now().nanoseconds
        return nanoseconds

    def steady(self) -> int:
        return time.monotonic_ns()

    def is_simulated(self) -> bool:
        return bool(self._clock.ros_time_is_active)

    def wait_for_another(self, now: int) -> None:  # noqa: ARG002
        """Wait for a clock that became simulated after the timer was made."""
        time.sleep(0.005)

    def resolve(self, topic: str) -> str:
        with _refusals(f"topic {topic!r}"):
            return str(self.node.resolve_topic_name(topic))

    def published_topics(self) -> set[str]:
        topics = (name for name, _ in self.node.get_topic_names_and_types())
        return {name for name in topics if self.node.count_publishers(name)}

    def publishers_of(self, topic: str, message: type) -> list[TopicPublisher]:
        known = self.node.get_publishers_info_by_topic(self.resolve(topic))
        return [
            TopicPublisher(
                f"{each.node_namespace.rstrip('/')}/{each.node_name}", keeps(each.qos_profile)
            )
            for each in known
            if each.topic_type == type_name(message)
        ]

    def may_keep(self, topic: str, message: type) -> bool:
        return any(publisher.keeps for publisher in self.publishers_of(topic, message))

    def around(self) -> tuple[Level, str] | None:
        nodes = self.node.get_node_names_and_namespaces()
        count = nodes.count((self.node.get_name(), self.node.get_namespace()))
        if count > 1:
            text = f"{count} nodes have the name {self.name}, and may get what is asked of another"
            self._around = Level.WARN, f"{text}; give each its own: --ros-args -r __node:=NAME"
        elif self._around is not None:
            self._around = Level.OK, f"no other node has the name {self.name} any more"
        return self._around

    def stamp(self, message: Any) -> int | None:
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        return stamp and (stamp.sec * _SECOND + stamp.nanosec or None)

    def set_stamp(self, message: Any, time: int) -> None:
        if hasattr(message, "header"):
            stamp = message.header.stamp
            stamp.sec, stamp.nanosec = divmod(time, _SECOND)

    def subscribe(
        self,
        topic: str,
        message: type,
        callback: Callable[..., None],
        *,
        receptions: bool = False,
    ) -> Handle:
        with _refusals(f"topic {topic!r}"):
            return Ros2Subscription(
                self.node,
                topic,
                message,
                callback,
                qos=self.qos,
                depth=self.depth,
                log=self.log,
                receptions=receptions,
                hearing=None if self.is_simulated() else self._hearing,
            )

    def take_waiting(self) -> None:
        self._hearing.take_waiting()

    def publisher(
        self,
        topic: str,
        message: type,
        *,
        latched: bool = True,
        fields: Sequence[Sequence[str]] = (),
        lease: int | None = None,
    ) -> Publisher:
        if latched:  # late subscribers get the last message
            qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        else:
            qos = QoSProfile(depth=DEPTH)
        if lease is not None:
            qos.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
            qos.liveliness_lease_duration = Duration(nanoseconds=lease)
        # Every event of rclpy costs time with every message that the node takes.
        events = PublisherEventCallbacks(use_default_callbacks=False)
        with _refusals(f"topic {topic!r}"):
            entity = self.node.create_publisher(message, topic, qos, event_callbacks=events)
        return _Publisher(self.node, entity, message, Made(message, fields, self.set_stamp))

    def every(self, period: int, callback: Callable[[int], None]) -> Handle:
        called = Callback(callback, partial(self.log, Level.ERROR))
        if self.is_simulated():  # in the thread of message callbacks
            return _Timer(self, period, called)
        timer = GridTimer(self, period, called)
        self._timers.append(timer)
        return timer

    def log(self, level: Level, text: str) -> None:
        logger = self.node.get_logger()
        # rclpy ties every line of a program to one level.
        if level is Level.OK:
            logger.info(text)
        elif level is Level.ERROR:
            logger.error(text)
        else:
            logger.warning(text)

    def spin(self) -> int:
        """Run callbacks until `close`, SIGINT or SIGTERM; none runs when it returns."""
        with self._spinning:
            executor = SingleThreadedExecutor(context=self.node.context)
            executor.add_node(self.node)

            def run() -> None:
                while not self._ending.asked:
                    try:
                        executor.spin()
                    except ExternalShutdownException:
                        self._ending.ask()
                    except Exception:  # noqa: BLE001 - from a service of rclpy
                        if not self._ending.asked:
                            self.log(Level.ERROR, traceback.format_exc())

            # Signals do not interrupt a wait of rclpy.
            self._runner = threading.Thread(target=run, name=self.name)
            self._runner.start()
            self._ending.wait()
            executor.shutdown()
            self._runner.join()  # a callback at the end of ROS would abort the process
            self._close_threads()
        if self._closing:
            self.close()
        return 0

    def close(self) -> None:
        """End the node. In a callback it returns at once, and `spin` completes it."""
        self._closing = True
        self._ending.ask()
        if threading.current_thread() in (self._runner, self._hearing, *self._timers):
            return
        with self._spinning:
            self._close_threads()
            if self.node.context.ok():
                self.node.destroy_node()
                self.node.context.shutdown()

    def _close_threads(self) -> None:
        """End the threads that call back next to an executor."""
        self._hearing.close()
        for timer in self._timers:
            timer.close()


class _Timer:
    """Calls back with the points of its own grid, shortly before rclpy's timer."""

    def __init__(self, ros: Ros2, period: int, callback: Callback) -> None:
        self._node = ros.node
        self._callback = callback
        begin, now = ros.now(), ros.now

        def call() -> None:
            time = now()
            self._callback(time - (time - begin) % period)

        # rclpy converts seconds to nanoseconds and truncates.
        self._timer = self._node.create_timer((period + 0.5) / _SECOND, call)

    def close(self) -> None:
        self._callback.close()
        self._node.destroy_timer(self._timer)


class _Service:
    def __init__(self, ros: Ros2, name: str, service: Any, act: Callable[[], str]) -> None:
        def answer(_: object, response: Any) -> Any:
            response.success, response.message = answered(act, partial(ros.log, Level.ERROR))
            return response

        self._node = ros.node
        self._service = ros.node.create_service(service, name, answer)

    def close(self) -> None:
        self._node.destroy_service(self._service)


class _Publisher:
    """A publisher until it is closed; later subscribers get nothing."""

    def __init__(self, node: Node, entity: Any, message: type, made: Made) -> None:
        self.message = message
        self.publish: Callable[[Any], None] = entity.publish
        self.assert_alive: Callable[[], None] = entity.assert_liveliness
        self.close = lambda: node.destroy_publisher(entity)
        self._make: Callable[[int, Sequence[float]], Any] = made
        if made.count:
            with suppress(ValueError):
                self._make = Packed(made, serialize_message)

    def publish_numbers(self, time: int, numbers: Sequence[float]) -> None:
        self.publish(self._make(time, numbers))


@contextmanager
def _refusals(what: str) -> Iterator[None]:
    """Turn refusals of rclpy into InputError, without the lines of its sources."""
    try:
        yield
    except (NameValidationException, RCLError) as error:
        reason = re.sub(r", at /\S+:\d+", "", str(error)).splitlines()[0].rstrip(":. ")
        raise InputError(f"{what}: {reason}") from error


def _how(package: str) -> str:
    """Return how to install a package of messages."""
    distribution = os.environ.get("ROS_DISTRO")  # set by setup files, not by wheels
    install = "apt-get install" if distribution else "pip install"
    return (
        f"{install} ros-{distribution or 'jazzy'}-{package.replace('_', '-')}, or source the "
        "setup file of a workspace that has them"
    )


def _is_service(cls: type) -> bool:
    """Return whether a class is a service of ROS 2."""
    return hasattr(cls, "Response") and _is_message(cls)


def _is_message(cls: type) -> bool:
    """Return whether a class is a message or a service of ROS 2."""
    try:
        check_for_type_support(cls)
    except AttributeError:
        return False
    return True
