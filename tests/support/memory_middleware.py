"""A middleware without ROS: messages, a clock and timers that a test controls."""

# ruff: noqa: ANN401 - the classes of messages have no types
from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rtamt import InputError
from rtamt_ros.callbacks import answered
from rtamt_ros.middleware import Handle, Level, Publisher, Reception, TopicPublisher
from rtamt_ros.packed import MessageMaker

__all__ = ["CLASSES", "MemoryMiddleware", "message"]

SECOND = 1_000_000_000


def _fields(**defaults: Any) -> type:
    """Return a class of messages with slots and defaults, as genpy creates them."""

    def __init__(self: Any) -> None:  # noqa: N807
        for name, default in defaults.items():
            setattr(self, name, default() if isinstance(default, type) else copy.copy(default))

    return type("Message", (), {"__slots__": tuple(defaults), "__init__": __init__})


Stamp = _fields(ns=0)
Header = _fields(stamp=Stamp, frame_id="")
Vector3 = _fields(x=0.0, y=0.0, z=0.0)
Quaternion = _fields(x=0.0, y=0.0, z=0.0, w=1.0)
Pose = _fields(position=Vector3, orientation=Quaternion)
PoseWithCovariance = _fields(pose=Pose, covariance=[0.0] * 36)
Twist = _fields(linear=Vector3, angular=Vector3)
TwistWithCovariance = _fields(twist=Twist, covariance=np.zeros(36))  # as on ROS 2

CLASSES: dict[tuple[str, str], type] = {
    ("std_msgs", "Float64"): _fields(data=0.0),
    ("std_msgs", "Float32"): _fields(data=0.0),
    ("std_msgs", "Int8"): _fields(data=0),
    ("std_msgs", "Int64"): _fields(data=0),
    ("std_msgs", "Bool"): _fields(data=False),
    ("std_msgs", "String"): _fields(data=""),
    ("geometry_msgs", "Twist"): Twist,
    ("nav_msgs", "Odometry"): _fields(
        header=Header, child_frame_id="", pose=PoseWithCovariance, twist=TwistWithCovariance
    ),
    ("sensor_msgs", "LaserScan"): _fields(header=Header, ranges=[]),
    ("rtamt_msgs", "FloatMessage"): _fields(header=Header, value=0.0),
    ("my_msgs", "Parts"): _fields(header=Header, a=0.0, b=0.0, inner=Vector3, count=0),
    ("diagnostic_msgs", "DiagnosticArray"): _fields(header=Header, status=[]),
    ("diagnostic_msgs", "DiagnosticStatus"): _fields(
        level=0, name="", message="", hardware_id="", values=[]
    ),
    ("diagnostic_msgs", "KeyValue"): _fields(key="", value=""),
}


def message(package: str, name: str, *, stamp: int | None = None, **values: Any) -> Any:
    """Return a message with values by path: ``twist__twist__linear__x=1.0``."""
    made = CLASSES[package, name]()
    if stamp is not None:
        made.header.stamp.ns = stamp
    for path, value in values.items():
        holder = made
        *outer, last = path.split("__")
        for step in outer:
            holder = getattr(holder, step)
        setattr(holder, last, value)
    return made


@dataclass
class _Open:
    """An object that is open until it is closed."""

    of: list[Any]
    callback: Callable[..., Any]
    topic: str = ""
    message: type = object
    period: int = 0
    begin: int = 0
    receptions: bool = False

    def close(self) -> None:
        self.of.remove(self)


@dataclass
class _Publisher:
    middleware: MemoryMiddleware
    topic: str
    message: type
    made: MessageMaker
    latched: bool
    lease: int | None = None
    asserted: int = 0

    def assert_alive(self) -> None:
        self.asserted += 1

    def publish_numbers(self, time: int, numbers: Sequence[float]) -> None:
        self.publish(self.made(time, numbers))

    def publish(self, message: Any) -> None:
        assert type(message) is self.message
        assert self in self.middleware.publishers
        self.middleware.published.append((self.topic, message))

    def close(self) -> None:
        self.middleware.publishers.remove(self)


@dataclass
class MemoryMiddleware:
    """A node without ROS.

    Attributes:
        time: The result of `now`.
        published: Every (topic, message), in order.
        lines: The logged lines.
        missing: Packages that are not installed.
        refused: Topics that it refuses.
        simulated: Whether its clock is simulated.
        later: The nanoseconds by which the steady clock is ahead of `time`.
        waiting: Messages that wait for `take_waiting`.
        publishing: The publishers of topics.
        known: The result of `published_topics`.
        standing: The result of `ros_state`.
        remapped: Complete names of topics that replace their own.
    """

    generation: int = 1
    name: str = "/monitor"
    time: int = 1000 * SECOND
    published: list[tuple[str, Any]] = field(default_factory=list)
    lines: list[tuple[Level, str]] = field(default_factory=list)
    missing: set[str] = field(default_factory=set)
    refused: set[str] = field(default_factory=set)
    simulated: bool = False
    later: int = 0
    waiting: list[tuple[str, Any, Reception]] = field(default_factory=list)
    publishing: dict[str, list[TopicPublisher]] = field(default_factory=dict)
    known: set[str] | None = None
    standing: tuple[Level, str] | None = None
    remapped: dict[str, str] = field(default_factory=dict)
    subscriptions: list[_Open] = field(default_factory=list)
    publishers: list[_Publisher] = field(default_factory=list)
    timers: list[_Open] = field(default_factory=list)
    services: list[_Open] = field(default_factory=list)

    def message_class(self, package: str, name: str) -> type:
        if package in self.missing or (package, name) not in CLASSES:
            raise InputError(f"{package} is not installed")
        return CLASSES[package, name]

    def now(self) -> int:
        return self.time

    def steady(self) -> int:
        return self.time + self.later

    def publishers_of(self, topic: str, message: type) -> list[TopicPublisher]:  # noqa: ARG002
        return self.publishing.get(topic, [])

    def may_keep(self, topic: str, message: type) -> bool:  # noqa: ARG002
        return any(each.keeps for each in self.publishing.get(topic, ()))

    def is_simulated(self) -> bool:
        return self.simulated

    def resolve(self, topic: str) -> str:
        return self.remapped.get(topic, topic if topic.startswith("/") else f"/{topic}")

    def published_topics(self) -> set[str] | None:
        return self.known

    def stamp(self, message: Any) -> int | None:
        return message.header.stamp.ns or None if hasattr(message, "header") else None

    def set_stamp(self, message: Any, time: int) -> None:
        if hasattr(message, "header"):
            message.header.stamp.ns = time

    def subscribe(
        self,
        topic: str,
        message: type,
        callback: Callable[..., None],
        *,
        receptions: bool = False,
    ) -> Handle:
        if topic in self.refused:
            raise InputError(f"{topic} is refused")
        self.subscriptions.append(
            _Open(self.subscriptions, callback, topic, message, receptions=receptions)
        )
        return self.subscriptions[-1]

    def take_waiting(self) -> None:
        waiting, self.waiting = self.waiting, []
        for topic, message, reception in waiting:
            self.send(topic, message, reception)

    def publisher(
        self,
        topic: str,
        message: type,
        *,
        latched: bool = True,
        fields: Sequence[Sequence[str]] = (),
        lease: int | None = None,
    ) -> Publisher:
        if topic in self.refused:
            raise InputError(f"{topic} is refused")
        made = MessageMaker(message, fields, self.set_stamp)
        self.publishers.append(_Publisher(self, topic, message, made, latched, lease))
        return self.publishers[-1]

    def every(self, period: int, callback: Callable[[int], None]) -> Handle:
        self.timers.append(_Open(self.timers, callback, period=period, begin=self.time))
        return self.timers[-1]

    def ros_state(self) -> tuple[Level, str] | None:
        return self.standing

    def trigger(self, name: str, act: Callable[[], str]) -> Handle:
        if "std_srvs" in self.missing:
            raise InputError("std_srvs is not installed")
        self.services.append(_Open(self.services, act, name))
        return self.services[-1]

    def log(self, level: Level, text: str) -> None:
        self.lines.append((level, text))

    def spin(self) -> int:
        raise NotImplementedError

    def close(self) -> None:
        raise NotImplementedError

    # The actions of a test. ----------------------------------------------------------------------

    def wait(self, topic: str, message: Any, number: int | None = None) -> None:
        """Receive a message now, and let it wait until `take_waiting`."""
        self.waiting.append((topic, message, Reception(self.time, number)))

    def send(self, topic: str, message: Any, reception: Reception = Reception()) -> None:  # noqa: B008
        """Deliver a message to every subscription of its topic."""
        for each in list(self.subscriptions):
            if each.topic == topic:
                assert type(message) is each.message
                each.callback(*((message, reception) if each.receptions else (message,)))

    def tick(self, time: int | None = None) -> None:
        """Call the timers at a time, by default now. Their grids start at their creation."""
        self.time = self.time if time is None else time
        for each in list(self.timers):
            each.callback(self.time - (self.time - each.begin) % each.period)

    def call(self, name: str) -> tuple[bool, str]:
        """Return the answer of a service of the node."""
        (service,) = [each for each in self.services if each.topic == name]
        return answered(service.callback, lambda text: self.log(Level.ERROR, text))

    def on(self, topic: str) -> list[Any]:
        """Return the messages published on a topic."""
        return [message for at, message in self.published if at == topic]

    def data(self, topic: str) -> list[float]:
        """Return the numbers published on a topic."""
        return [message.data for message in self.on(topic)]

    def latched(self, topic: str) -> float:
        """Return the latched message of a topic."""
        assert all(each.latched for each in self.publishers if each.topic == topic)
        return float(self.data(topic)[-1])
