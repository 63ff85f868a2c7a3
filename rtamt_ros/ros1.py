"""The middleware of ROS 1, on rospy.

Only this module imports rospy and messages of ROS 1. rospy allows one node per process, so a
process creates one `Ros1`.
"""

from __future__ import annotations

import logging
import math
import re
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from http.client import HTTPConnection, HTTPException
from importlib.util import find_spec
from io import BytesIO
from typing import Any
from xmlrpc.client import Error, ServerProxy, Transport

import genpy.dynamic
import rosgraph
import rosgraph.names
import rospy
import rospy.impl.paramserver
import std_msgs.msg
from rospy.impl import registration

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_ros.callbacks import Callback, GridTimer, answered
from rtamt_ros.messages import find_class
from rtamt_ros.middleware import Handle, Level, Publisher, Reception, TopicPublisher
from rtamt_ros.packed import MessageMaker, MessagePacker
from rtamt_ros.process import Ending

_UNKNOWN = "the master at {} did not know this node"
PATIENCE = 2.0
"""The timeout in seconds of calls to a master or a node, which may hang."""


class Displaced(Exception):  # noqa: N818
    """Another node has the name of this node."""


class Refused(Exception):  # noqa: N818
    """The master does not register the node."""


class MasterLink:
    """Registers a node again with a restarted master.

    rospy registers topics and services once. A restarted master does not know them, so new nodes do
    not find the node, although its connections stay. This class repeats all registrations through
    the API of masters, and informs the node of publishers through the API of nodes.

    Args:
        name: The name of the node, which rospy has registered.

    Attributes:
        state: The state since the first problem; None before.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._own = str(rospy.get_node_uri())
        self._address = str(rosgraph.get_master_uri())
        self._process: int | None = None  # of the master with all registrations
        self._gone = self._incomplete = False
        self._count = 0
        self.state: tuple[Level, str] | None = None

    def look(self) -> None:
        """Check the master; register again with a restarted one.

        Raises:
            Displaced: If the master knows another node by the name.
            Refused: If the master does not register the node.
        """
        try:
            with _proxy(self._address) as master:
                process = _value(master.getPid(self._name))
                known, _, address = _answer(master.lookupNode(self._name, self._name))
                if rospy.core.is_shutdown_requested():  # it may have left the master
                    return
                if known == 1 and address != self._own:
                    raise Displaced(f"another node has the name {self._name}")
                if known != 1 or self._incomplete or self._process not in (None, process):
                    self._incomplete = True
                    self._register(master)
                    self._incomplete = False
                    self._count += 1
                    self._set_state(Level.OK, f"registered again ({self._count}): {_UNKNOWN}")
                elif self._gone:
                    self._set_state(Level.OK, "the master at {} answers again")
                self._process, self._gone = process, False
        except (OSError, HTTPException, Error):
            self._gone = True
            self._set_state(
                Level.WARN, "no master answers at {}: nodes that start now do not find this node"
            )

    def _set_state(self, level: Level, text: str) -> None:
        self.state = level, text.format(self._address)

    def _register(self, master: ServerProxy) -> None:
        """Repeat the registrations of rospy with a master."""
        topics, services = registration.get_topic_manager(), registration.get_service_manager()
        for topic, kind in topics.get_publications():
            _value(master.registerPublisher(self._name, topic, kind, self._own))
        for service, address in services.get_services():
            _value(master.registerService(self._name, service, address, self._own))
        with _proxy(self._own) as node:
            for topic, kind in topics.get_subscriptions():
                publishers = _value(master.registerSubscriber(self._name, topic, kind, self._own))
                _value(node.publisherUpdate("/master", topic, publishers))


class _Patient(Transport):
    """A transport that gives up after `PATIENCE`."""

    def make_connection(self, host: Any) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = PATIENCE
        return connection


def _proxy(address: str) -> ServerProxy:
    """Return a proxy for the functions at an address."""
    return ServerProxy(address, transport=_Patient())


def _answer(answer: Any) -> Sequence[Any]:
    """Return the code, the text and the value that every function of ROS answers."""
    code, text, value = answer
    return code, text, value


def _value(answer: Any) -> Any:
    """Return the value of an answer; raise Refused if its code is not 1."""
    code, text, value = _answer(answer)
    if code != 1:
        raise Refused(str(text))
    return value


# The messages of the package rtamt_msgs, created at run time: few users build it.
_STAMPED = ("FloatStamped", "FloatMessage")
_LOGS = {
    Level.OK: rospy.loginfo,
    Level.WARN: rospy.logwarn,
    Level.ERROR: rospy.logerr,
    Level.STALE: rospy.logwarn,
}
DISPLACED = 4
"""The exit code after another node took the name; a restart would end that node."""
REFUSED = 5
"""The exit code of a node that a master does not register."""
_TOPICS_OF_LOG = "/rosout_disable_topics_generation"
_SAME_NAME = "new node registered with same name"  # the master's words
_NAME_IT = "give each node its own name: __name:=NAME"
# The messages that wait for a slow subscriber.
_QUEUE = 100


class Ros1:
    """A node of ROS 1, as `rtamt_ros.middleware.Middleware` describes it.

    After SIGINT, SIGTERM and `rosnode kill`, `spin` returns 0. If another node takes the name, it
    returns `DISPLACED`; if a restarted master refuses the node, `REFUSED`. Without a master the
    node logs that and waits, as every node of ROS 1 does.

    Args:
        name: The name of the node. Characters that ROS does not allow become ``_``, and a number is
            added, because the master ends the first of two nodes with the same name. The argument
            ``__name:=NAME`` sets the exact name.
        arguments: Remappings and private parameters, such as ``odom:=robot1/odom``.
    """

    generation = 1

    def __init__(self, name: str, arguments: Sequence[str] = ()) -> None:
        # rospy reads remappings from `arguments`, but the namespace from `sys.argv` alone.
        namespace = rosgraph.names.get_ros_namespace(argv=arguments)
        rospy.names._set_caller_id(f"{namespace}unnamed")  # noqa: SLF001
        names = [
            argument.removeprefix("__name:=")
            for argument in arguments
            if argument[:8] == "__name:="
        ]
        if not all(map(rosgraph.names.is_legal_base_name, names)):
            raise InputError(f"__name: expected letters, digits and '_', got {names[0]!r}")
        try:
            rospy.init_node(legal_name(name), list(arguments), anonymous=True, disable_signals=True)
        except rospy.ROSException as error:
            raise InputError(f"cannot start the node: {error}") from error
        # If this parameter is not set, rospy asks the master for it at every log line. A look would
        # wait for the answer, and two nodes with the same name would end each other.
        parameters = rospy.impl.paramserver.get_param_server_cache()
        parameters.set(_TOPICS_OF_LOG, rospy.get_param_cached(_TOPICS_OF_LOG, False))  # noqa: FBT003
        self.name: str = rospy.get_name()
        self._timers: list[GridTimer] = []
        self._published = _PublishedTopics(self.published_topics)
        self._ending = Ending()
        self._code = 0
        rospy.core.add_preshutdown_hook(self._end)  # the public hook has no reason
        self._master = MasterLink(self.name)
        self._refusals = _Refusals()
        logging.getLogger("rospy.internal").addHandler(self._refusals)

    def message_class(self, package: str, name: str) -> type:
        if package == "rtamt_msgs" and find_spec(package) is None:
            if name in _STAMPED:
                stamped: type = _stamped(name)
                return stamped
            raise InputError(f"{package} has no message {name}{nearest(name, _STAMPED)}")
        cls: type = find_class(
            package,
            name,
            generation=1,
            belongs=lambda cls: issubclass(cls, genpy.Message),
            install_hint=_install_hint(package),
        )
        return cls

    def now(self) -> int:
        return _now()

    def steady(self) -> int:
        return time.monotonic_ns()

    def is_simulated(self) -> bool:
        return not rospy.rostime.is_wallclock()

    def wait_for_another(self, now: int) -> None:
        """Wait as `rtamt_ros.callbacks.NodeClock` describes."""
        ticked = rospy.rostime.get_rostime_cond()
        with ticked:
            if _now() == now:
                ticked.wait(0.5)

    def resolve(self, topic: str) -> str:
        full = str(rospy.resolve_name(topic))
        for name in (topic, full):
            if not rosgraph.names.is_legal_name(name) or not name.isascii():
                remapped = "" if name == topic else f", which is remapped to {full!r}"
                raise InputError(
                    f"topic {topic!r}{remapped}: expected letters, digits, '_' and '/', first a "
                    "letter, '/' or '~'"
                )
        return full

    def published_topics(self) -> set[str] | None:
        try:
            return {topic for topic, _ in rospy.get_published_topics()}
        except (
            OSError,
            HTTPException,
            xmlrpc.client.Error,
            rospy.ROSException,
        ):  # no master answers
            return None

    def publishers_of(self, topic: str, message: type) -> list[TopicPublisher]:  # noqa: ARG002 - a topic has one type
        implementation = rospy.topics.get_topic_manager().get_subscriber_impl(self.resolve(topic))
        connections = [] if implementation is None else list(implementation.connections or ())
        return [
            TopicPublisher(str(connection.callerid_pub), bool(connection.is_latched))
            for connection in connections
            if connection.callerid_pub not in (None, "unknown")
        ]

    def may_keep(self, topic: str, message: type) -> bool | None:
        if self.publishers_of(topic, message):
            return True
        published = self._published.recent()
        return None if published is None else self.resolve(topic) in published

    def stamp(self, message: Any) -> int | None:
        stamp = getattr(getattr(message, "header", None), "stamp", None)
        return (stamp and int(stamp.to_nsec())) or None

    def set_stamp(self, message: Any, time: int) -> None:
        if hasattr(message, "header"):  # a new Time would double the time
            stamp = message.header.stamp
            stamp.secs, stamp.nsecs = divmod(time, 1_000_000_000)

    def subscribe(
        self,
        topic: str,
        message: type,
        callback: Callable[..., None],
        *,
        receptions: bool = False,
    ) -> Handle:
        self.resolve(topic)
        if not receptions:
            return _Subscription(topic, message, callback)

        def numbered(received: Any) -> None:
            number = getattr(getattr(received, "header", None), "seq", 0)
            callback(received, Reception(number=number or None))

        return _Subscription(topic, message, numbered)

    def take_waiting(self) -> None:
        """Do nothing: rospy reads each connection in its own thread."""

    def publisher(
        self,
        topic: str,
        message: type,
        *,
        latched: bool = True,
        fields: Sequence[Sequence[str]] = (),
        lease: int | None = None,  # noqa: ARG002 - ROS 1 has no liveliness
    ) -> Publisher:
        self.resolve(topic)
        return _Publisher(
            topic, message, MessageMaker(message, fields, self.set_stamp), latched=latched
        )

    def every(self, period: int, callback: Callable[[int], None]) -> Handle:
        timer = GridTimer(self, period, Callback(callback, rospy.logerr))
        self._timers.append(timer)
        return timer

    def trigger(self, name: str, act: Callable[[], str]) -> Handle:
        service = find_class(
            "std_srvs",
            "Trigger",
            kind="service",
            generation=1,
            belongs=lambda cls: hasattr(cls, "_response_class"),
            install_hint=_install_hint("std_srvs"),
        )
        return _Service(f"~{name}", service, act)

    def log(self, level: Level, text: str) -> None:
        _LOGS[level](text)

    def ros_state(self) -> tuple[Level, str] | None:
        try:
            self._master.look()
        except Displaced as displaced:
            self._fail(DISPLACED, f"{displaced}; {_NAME_IT}")
        except Refused as refused:
            self._fail(REFUSED, f"the master refuses this node: {refused}")
        return self._master.state

    def spin(self) -> int:
        self._ending.wait()
        return self._code

    def close(self) -> None:
        for timer in self._timers:
            timer.close()
        logging.getLogger("rospy.internal").removeHandler(self._refusals)
        rospy.signal_shutdown("closed")

    def _end(self, why: str) -> None:
        """End the node because rospy ends, with the reason from rospy."""
        if _SAME_NAME in why:
            self._fail(DISPLACED, f"another node has the name {self.name}; {_NAME_IT}")
        self._ending.request()

    def _fail(self, code: int, why: str) -> None:
        """End the node with an exit code."""
        self.log(Level.ERROR, why)
        self._code = self._code or code
        self._ending.request()


class _PublishedTopics:
    """The topics that the master knows; a thread asks, so that no caller waits."""

    def __init__(self, ask: Callable[[], set[str] | None]) -> None:
        self._ask = ask
        self._answer: set[str] | None = None
        self._asked_at = -math.inf
        self._thread: threading.Thread | None = None

    def recent(self) -> set[str] | None:
        """Return an answer of the last second, or None if there is no answer yet."""
        now = time.monotonic()
        running = self._thread is not None and self._thread.is_alive()
        if now - self._asked_at > 1.0 and not running:
            self._answer, self._asked_at = None, now
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()
        return self._answer

    def _run(self) -> None:
        self._answer = self._ask()


def legal_name(name: str) -> str:
    """Return a similar name that ROS allows: a letter, then ASCII letters, digits and ``_``."""
    words = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
    return words if words[:1].isalpha() else f"monitor_{words}".rstrip("_")


def _install_hint(package: str) -> str:
    """Return how to install a package of messages."""
    debian = package.replace("_", "-")
    return (
        f"apt-get install python3-{debian} (Debian) or ros-noetic-{debian}, or source the "
        "setup file of a workspace that has them"
    )


def _now() -> int:
    """Return the time of the clock of ROS in nanoseconds; 0 before a simulated clock ticks."""
    # rospy reads the wall clock as a float, which is exact to a quarter of a microsecond.
    if rospy.rostime.is_wallclock():
        return time.time_ns()
    return int(rospy.get_rostime().to_nsec())


@cache
def _stamped(name: str) -> type:
    """Return the class of a number with a header, in the wire format of rtamt_msgs."""
    header = std_msgs.msg.Header
    text = f"Header header\nfloat64 value\n{'=' * 80}\nMSG: {header._type}\n{header._full_text}"  # noqa: SLF001
    cls: type = genpy.dynamic.generate_dynamic(f"rtamt_msgs/{name}", text)[f"rtamt_msgs/{name}"]
    cls.__name__ = cls.__qualname__ = name
    return cls


class _Subscription:
    def __init__(self, topic: str, message: type, callback: Callable[[Any], None]) -> None:
        self._callback = Callback(callback, rospy.logerr)
        self._subscriber = rospy.Subscriber(topic, message, self._callback, tcp_nodelay=True)
        # rospy decodes messages for all subscriptions of a topic with its first class.
        first = self._subscriber.impl.data_class
        if first is not message:
            self.close()
            raise InputError(
                f"expected one type of messages on {topic}, got {first._type} and {message._type}"  # type: ignore[attr-defined] # noqa: SLF001
            )

    def close(self) -> None:
        self._callback.close()
        self._subscriber.unregister()


class _Publisher:
    def __init__(self, topic: str, message: type, maker: MessageMaker, *, latched: bool) -> None:
        self.message = message
        self._publisher = rospy.Publisher(
            topic, message, latch=latched, queue_size=_QUEUE, tcp_nodelay=True
        )
        self._topic = self._publisher.impl
        self._latched = latched
        self.publish: Callable[[Any], None] = self._publisher.publish
        self._make: Callable[[int, Sequence[float]], Any] = maker
        if maker.count:
            with suppress(ValueError):
                self._make = _packed_class(message, maker)

    def publish_numbers(self, time: int, numbers: Sequence[float]) -> None:
        message = self._make(time, numbers)
        if self._latched:
            # rospy sends this message to later subscribers. Without subscribers now, `publish`
            # would only double the time.
            self._topic.latch = message
            if not self._topic.has_connections():
                return
        self.publish(message)

    def assert_alive(self) -> None:
        """Do nothing: ROS 1 has no liveliness."""

    def close(self) -> None:
        self._publisher.unregister()


def _packed_class(
    message: type, maker: MessageMaker
) -> Callable[[int, Sequence[float]], _PackedMessage]:
    """Return a class that rospy accepts and writes like messages of the given class."""
    attributes = {name: getattr(message, name) for name in ("_md5sum", "_has_header")}
    attributes |= {"pack": staticmethod(MessagePacker(maker, _serialized)), "__slots__": ()}
    return type(f"{message.__name__}MessagePacker", (_PackedMessage,), attributes)


def _serialized(message: Any) -> bytes:
    buffer = BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


class _PackedMessage:
    """A message that is packed when it is sent.

    rospy identifies it by the checksum of its class, and sets the sequence number in its header.
    """

    __slots__ = ("_numbers", "_time", "seq")

    _has_header = False
    frame_id = ""
    pack: MessagePacker

    def __init__(self, time: int, numbers: Sequence[float]) -> None:
        self._time = time
        self._numbers = numbers
        self.seq = 0

    @property
    def header(self) -> _PackedMessage:
        """The object in which rospy sets `seq`."""
        return self

    def serialize(self, buffer: BytesIO) -> None:
        """Write the bytes; a header starts with the sequence number."""
        packed = self.pack(self._time, self._numbers)
        if self._has_header:
            buffer.write(self.seq.to_bytes(4, "little"))
            packed = packed[4:]
        buffer.write(packed)


class _Service:
    def __init__(self, name: str, service: Any, act: Callable[[], str]) -> None:
        def answer(_: object) -> Any:
            return service._response_class(*answered(act, rospy.logerr))  # noqa: SLF001

        self._service = rospy.Service(name, service, answer)

    def close(self) -> None:
        self._service.shutdown("closed")


class _Refusals(logging.Handler):
    """Logs why a publisher refuses the node; rospy writes that to a file only."""

    def emit(self, record: logging.LogRecord) -> None:
        """Log why a thread of rospy could not connect; the thread has the name of the topic."""
        why = re.match(r"unable to create subscriber transport: (.*)\.  ", record.getMessage())
        if why is not None:
            rospy.logerr(f"no messages come from a publisher of {record.threadName}: {why[1]}")
