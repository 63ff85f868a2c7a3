"""What a node needs of ROS, in the same words for ROS 1 and ROS 2.

To add a method, add it to `Middleware`, ``ros1.py`` and ``ros2.py``, and a test to
``tests/support/ros_contract.py``, which both pass.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from enum import IntEnum
from typing import Any, Protocol


class Level(IntEnum):
    """How bad a state is, with the numbers of ``diagnostic_msgs/DiagnosticStatus``."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Handle(Protocol):
    """A subscription, a publisher or a timer, until it is closed."""

    def close(self) -> None:
        """Ends it; no callback begins after that."""
        ...


class Publisher(Handle, Protocol):
    """Publishes messages of one class on one topic."""

    message: type

    def publish(self, message: Any) -> None:  # noqa: ANN401 - the classes of ROS have no types
        """Publishes a message, which must be of `message`."""
        ...

    def publish_numbers(self, time: int, numbers: Sequence[float]) -> None:
        """Publishes a message with a time in its header, and numbers in the fields that are its."""
        ...


class Middleware(Protocol):
    """A node of ROS 1 or ROS 2: what `rtamt_ros.ros1` and `rtamt_ros.ros2` offer.

    Times are nanoseconds of the clock of ROS: the wall clock since 1970, or the simulated one of
    ``/clock`` under ``use_sim_time``. Callbacks may run in several threads.

    Attributes:
        generation: 1 or 2.
        name: The name of the node, with its namespace.
    """

    generation: int
    name: str

    def message_class(self, package: str, name: str) -> type:
        """The class of messages ``package/name``: ``geometry_msgs``, ``Twist``.

        Raises:
            InputError: If it is not installed; the message says what to install.
        """
        ...

    def now(self) -> int:
        """The time of the clock of ROS; 0 before the first tick of a simulated one."""
        ...

    def is_simulated(self) -> bool:
        """Whether the clock is a simulated one, which stands still while nobody moves it."""
        ...

    def resolve(self, topic: str) -> str:
        """The whole name of a topic: with the namespace of the node, and remapped.

        Raises:
            InputError: If ROS cannot have the topic, or the topic that it is remapped to.
        """
        ...

    def published_topics(self) -> Collection[str] | None:
        """The whole names of topics that somebody publishes; None where ROS does not say."""
        ...

    def stamp(self, message: Any) -> int | None:  # noqa: ANN401
        """The time in a message's header; None without a header, or where it is not set."""
        ...

    def set_stamp(self, message: Any, time: int) -> None:  # noqa: ANN401
        """Sets the time in a message's header; without one, does nothing."""
        ...

    def subscribe(self, topic: str, message: type, callback: Callable[[Any], None]) -> Handle:
        """Calls back with every message of a topic, and with what was latched before."""
        ...

    def publisher(
        self,
        topic: str,
        message: type,
        *,
        latched: bool = True,
        fields: Sequence[Sequence[str]] = (),
    ) -> Publisher:
        """Publishes on a topic; a latched one gives its last message to who comes late.

        The paths to fields are for `Publisher.publish_numbers`.
        """
        ...

    def every(self, period: int, callback: Callable[[int], None]) -> Handle:
        """Calls back at every point of a grid of the clock of ROS; calls never overlap.

        A call is given the last point that has come; those of a timer are whole periods apart,
        whatever the clock does. A call that is late by several points is one call.
        """
        ...

    def around(self) -> tuple[Level, str] | None:
        """How the node stands among others; None if there was never anything to say of it.

        It is asked again and again, in a thread of its own: it may wait for answers, and may mend
        what it finds.
        """
        ...

    def trigger(self, name: str, act: Callable[[], str]) -> Handle:
        """Offers a service ``std_srvs/Trigger`` of the node's own, which answers with a text.

        An InputError is the answer that it did not succeed.

        Raises:
            InputError: If the services of ``std_srvs`` are not installed.
        """
        ...

    def log(self, level: Level, text: str) -> None:
        """Writes a line to the log of the node."""
        ...

    def spin(self) -> int:
        """Lets callbacks run until the node ends; the exit code, 0 if it was told to."""
        ...

    def close(self) -> None:
        """Ends the node."""
        ...
