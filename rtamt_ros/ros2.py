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
from rtamt_ros.messages import find_class
from rtamt_ros.middleware import Handle, Level, Publisher, TopicPublisher
from rtamt_ros.packed import MessageMaker, MessagePacker
from rtamt_ros.parameters import DEPTH, Qos
from rtamt_ros.process import Ending
from rtamt_ros.ros2_subscription import Receiver, Ros2Subscription, keeps, type_name

_SECOND = 1_000_000_000


class Ros2:
    """A node of ROS 2, as `rtamt_ros.middleware.Middleware` describes it.

    Message callbacks run in one thread, and timers on the wall clock run in others. On a simulated
    clock, all run in one thread, so a tick comes after the messages that were sent before it.
    Publishers are reliable, so every subscription is compatible with them.

    Args:
        name: The name of the node, unless ``-r __node:=NAME`` in the arguments sets another.
        arguments: Such as ``--ros-args -r odom:=robot1/odom -p use_sim_time:=true``.
        make: Returns the node of rclpy for a name and a context.

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
                raise InputError(
                    f"ROS 2 has no argument {others[0]}; write its arguments after --ros-args"
                )
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
        self._receiver = Receiver(self.node, partial(self.log, Level.ERROR))
        self._spinning = threading.Lock()
        self._runner: threading.Thread | None = None
        self._ending = Ending()
        self._closing = False
        self._timers: list[GridTimer] = []
        self._ros_state: tuple[Level, str] | None = None

    def message_class(self, package: str, name: str) -> type:
        how = _install_hint(package)
        if package == "rtamt_msgs":
            how = (
                "build the package rtamt_msgs with colcon and source its setup file, or publish "
                "std_msgs/Float64"
            )
        return find_class(package, name, generation=2, belongs=_is_message, install_hint=how)

    def trigger(self, name: str, act: Callable[[], str]) -> Handle:
        service = find_class(
            "std_srvs",
            "Trigger",
            kind="service",
            generation=2,
            belongs=_is_service,
            install_hint=_install_hint("std_srvs"),
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
        endpoints = self.node.get_publishers_info_by_topic(self.resolve(topic))
        return [
            TopicPublisher(
                f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}",
                keeps(endpoint.qos_profile),
            )
            for endpoint in endpoints
            if endpoint.topic_type == type_name(message)
        ]

    def may_keep(self, topic: str, message: type) -> bool:
        return any(publisher.keeps for publisher in self.publishers_of(topic, message))

    def ros_state(self) -> tuple[Level, str] | None:
        nodes = self.node.get_node_names_and_namespaces()
        count = nodes.count((self.node.get_name(), self.node.get_namespace()))
        if count > 1:
            text = f"{count} nodes have the name {self.name}, so a request may reach another node"
            self._ros_state = (
                Level.WARN,
                f"{text}; give each node its own name: --ros-args -r __node:=NAME",
            )
        elif self._ros_state is not None:
            self._ros_state = Level.OK, f"no other node has the name {self.name} any more"
        return self._ros_state

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
                receiver=None if self.is_simulated() else self._receiver,
            )

    def take_waiting(self) -> None:
        self._receiver.take_waiting()

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
        # Every event handler of rclpy costs time at every message that the node takes.
        events = PublisherEventCallbacks(use_default_callbacks=False)
        with _refusals(f"topic {topic!r}"):
            entity = self.node.create_publisher(message, topic, qos, event_callbacks=events)
        return _Publisher(self.node, entity, message, MessageMaker(message, fields, self.set_stamp))

    def every(self, period: int, callback: Callable[[int], None]) -> Handle:
        closable = Callback(callback, partial(self.log, Level.ERROR))
        if self.is_simulated():  # in the thread of message callbacks
            return _Timer(self, period, closable)
        timer = GridTimer(self, period, closable)
        self._timers.append(timer)
        return timer

    def log(self, level: Level, text: str) -> None:
        logger = self.node.get_logger()
        # rclpy allows one level per line of a program.
        if level is Level.OK:
            logger.info(text)
        elif level is Level.ERROR:
            logger.error(text)
        else:
            logger.warning(text)

    def spin(self) -> int:
        """Run callbacks until `close`, SIGINT or SIGTERM; return after the last callback."""
        with self._spinning:
            executor = SingleThreadedExecutor(context=self.node.context)
            executor.add_node(self.node)

            def run() -> None:
                while not self._ending.requested:
                    try:
                        executor.spin()
                    except ExternalShutdownException:
                        self._ending.request()
                    except Exception:  # noqa: BLE001 - an error in a service of rclpy
                        if not self._ending.requested:
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
        """End the node. In a callback it returns at once, and `spin` closes the node."""
        self._closing = True
        self._ending.request()
        if threading.current_thread() in (self._runner, self._receiver, *self._timers):
            return
        with self._spinning:
            self._close_threads()
            if self.node.context.ok():
                self.node.destroy_node()
                self.node.context.shutdown()

    def _close_threads(self) -> None:
        """End the threads that call back next to an executor."""
        self._receiver.close()
        for timer in self._timers:
            timer.close()


class _Timer:
    """A timer on a simulated clock, which passes the last point of its own grid."""

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
    """An open publisher of rclpy."""

    def __init__(self, node: Node, entity: Any, message: type, maker: MessageMaker) -> None:
        self.message = message
        self.publish: Callable[[Any], None] = entity.publish
        self.assert_alive: Callable[[], None] = entity.assert_liveliness
        self.close = lambda: node.destroy_publisher(entity)
        self._make: Callable[[int, Sequence[float]], Any] = maker
        if maker.count:
            with suppress(ValueError):
                self._make = MessagePacker(maker, serialize_message)

    def publish_numbers(self, time: int, numbers: Sequence[float]) -> None:
        self.publish(self._make(time, numbers))


@contextmanager
def _refusals(subject: str) -> Iterator[None]:
    """Turn errors of rclpy about a name into InputError, without its source lines."""
    try:
        yield
    except (NameValidationException, RCLError) as error:
        reason = re.sub(r", at /\S+:\d+", "", str(error)).splitlines()[0].rstrip(":. ")
        raise InputError(f"{subject}: {reason}") from error


def _install_hint(package: str) -> str:
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
