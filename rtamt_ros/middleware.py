"""The interface between a node and ROS, the same for ROS 1 and ROS 2.

To add a method, add it to `Middleware`, ``ros1.py`` and ``ros2.py``, and a test to
``tests/support/ros_contract.py``, which both pass.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from enum import IntEnum
from typing import Any, NamedTuple, Protocol


class Level(IntEnum):
    """The severity of a state, with the numbers of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class TopicPublisher(NamedTuple):
    """A publisher of a topic.

    Attributes:
        node: The full name of its node.
        keeps: Whether it sends its last message to late subscribers.
    """

    node: str
    keeps: bool


class Reception(NamedTuple):
    """The arrival of a message.

    Attributes:
        received: The nanoseconds of the wall clock at which ROS received it, which may be earlier
            than its callback; None if ROS does not report it, or if the clock is simulated.
        number: The sequence number from its publisher; None without a number.
        lost: The number of messages of the topic that ROS has reported as lost.
    """

    received: int | None = None
    number: int | None = None
    lost: int = 0


class Handle(Protocol):
    """An open subscription, publisher, timer or service."""

    def close(self) -> None:
        """Close it; no callback starts after that."""
        ...


class Publisher(Handle, Protocol):
    """A publisher of messages of one class on one topic."""

    message: type

    def publish(self, message: Any) -> None:  # noqa: ANN401 - the classes of ROS have no types
        """Publish a message of the class `message`."""
        ...

    def assert_alive(self) -> None:
        """Inform subscribers that the node runs, if the publisher has a lease; on ROS 2 only."""
        ...

    def publish_numbers(self, time: int, numbers: Sequence[float]) -> None:
        """Publish a message with a time in its header, and numbers in its fields."""
        ...


class Middleware(Protocol):
    """A node of ROS 1 or ROS 2, as `rtamt_ros.ros1` and `rtamt_ros.ros2` implement it.

    Times are nanoseconds of the clock of ROS: the wall clock since 1970, or under ``use_sim_time``
    the simulated clock of ``/clock``. Callbacks may run in several threads.

    Attributes:
        generation: 1 or 2.
        name: The name of the node, with its namespace.
    """

    generation: int
    name: str

    def message_class(self, package: str, name: str) -> type:
        """Return the class of messages ``package/name``: ``geometry_msgs``, ``Twist``.

        Raises:
            InputError: If the class is not installed; the error explains how to install it.
        """
        ...

    def now(self) -> int:
        """Return the time of the ROS clock; 0 before the first tick of a simulated clock."""
        ...

    def steady(self) -> int:
        """Return the nanoseconds of a steady clock of the computer, which never jumps."""
        ...

    def is_simulated(self) -> bool:
        """Return whether the clock is simulated; a simulated clock may stand still."""
        ...

    def resolve(self, topic: str) -> str:
        """Return the full name of a topic, with the namespace and remappings.

        Raises:
            InputError: If ROS does not allow the topic or its remapping.
        """
        ...

    def published_topics(self) -> Collection[str] | None:
        """Return the full names of published topics; None if ROS does not answer."""
        ...

    def publishers_of(self, topic: str, message: type) -> Sequence[TopicPublisher]:
        """Return the publishers of a subscribed topic, without waiting for an answer.

        On ROS 1 these are the connected publishers. On ROS 2 they are those in the graph, which
        keeps a killed publisher for up to 20 s.
        """
        ...

    def may_keep(self, topic: str, message: type) -> bool | None:
        """Return whether a publisher of a topic may keep its last message; None while unknown.

        On ROS 1 any publisher may, because only a connection shows whether it does.
        """
        ...

    def stamp(self, message: Any) -> int | None:  # noqa: ANN401
        """Return the stamp of a message; None without a header, or if the stamp is not set."""
        ...

    def set_stamp(self, message: Any, time: int) -> None:  # noqa: ANN401
        """Set the stamp of a message, if it has a header."""
        ...

    def subscribe(
        self,
        topic: str,
        message: type,
        callback: Callable[..., None],
        *,
        receptions: bool = False,
    ) -> Handle:
        """Pass every message of a topic to a callback, including latched messages.

        With ``receptions``, the second argument of the callback is the `Reception` of the message.
        """
        ...

    def take_waiting(self) -> None:
        """Pass messages that wait in queues to their callbacks, if ROS can read its queues."""
        ...

    def publisher(
        self,
        topic: str,
        message: type,
        *,
        latched: bool = True,
        fields: Sequence[Sequence[str]] = (),
        lease: int | None = None,
    ) -> Publisher:
        """Publish on a topic; a latched topic sends its last message to late subscribers.

        The paths to fields are for `Publisher.publish_numbers`. With a lease, ROS 2 informs
        subscribers if `Publisher.assert_alive` was not called for that many nanoseconds.
        """
        ...

    def every(self, period: int, callback: Callable[[int], None]) -> Handle:
        """Call a callback at every point of a grid of the clock; calls never overlap.

        The callback gets the last point that has passed. The points are whole periods apart, even
        if the clock jumps. After several missed points there is one call.
        """
        ...

    def ros_state(self) -> tuple[Level, str] | None:
        """Return the state of ROS around the node, such as a missing master; None if always good.

        A thread calls it repeatedly. It may wait for answers, and may repair problems.
        """
        ...

    def trigger(self, name: str, act: Callable[[], str]) -> Handle:
        """Offer a service ``std_srvs/Trigger`` of the node, which answers with a text.

        An InputError becomes an answer with ``success`` false.

        Raises:
            InputError: If the services of ``std_srvs`` are not installed.
        """
        ...

    def log(self, level: Level, text: str) -> None:
        """Write a line to the log of the node."""
        ...

    def spin(self) -> int:
        """Run callbacks until the node ends; return the exit code, 0 after a request to end."""
        ...

    def close(self) -> None:
        """End the node."""
        ...
