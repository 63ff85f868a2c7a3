"""A subscription of ROS 2 that hears what is published, and what publishers have kept."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from rtamt_ros.callback import Callback
from rtamt_ros.middleware import Level
from rtamt_ros.parameters import Qos
from rtamt_ros.ros2_hearing import Hearing

__all__ = ["Ros2Subscription"]

_QOS: dict[Qos, ReliabilityPolicy] = {
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
    "reliable": ReliabilityPolicy.RELIABLE,
}


class Ros2Subscription:
    """A subscription that hears what is published, and what publishers have kept.

    What was kept (``transient_local``) DDS gives to a reader that asks for it alone, and to such a
    reader nothing of a publisher that keeps nothing. So the first reader, ``live``, asks for
    nothing. Where a publisher keeps, ``late`` asks. Once something came one of the two stays:
    ``late``, which hears a publisher that begins anew too, if every publisher keeps.

    Args:
        node: The node of rclpy.
        topic: As in the specification.
        message: The class of its messages.
        callback: Takes every message, once.
        qos: ``"best_effort"`` hears every publisher; ``"reliable"`` reliable ones only.
        depth: How many messages wait for the callback.
        log: The log of the node.
        hearing: The thread that takes the messages; None: an executor of the node does.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        message: type,
        callback: Callable[[Any], None],
        *,
        qos: Qos,
        depth: int,
        log: Callable[[Level, str], None],
        hearing: Hearing | None = None,
    ) -> None:
        self._node = node
        self._hearing = hearing
        self._topic = topic
        self._message = message
        self._callback = Callback(callback, partial(log, Level.ERROR))
        self._qos: Qos = qos
        self._depth = depth
        self._log = log
        self._lock = threading.RLock()  # of the readers
        self._readers: dict[str, Any] = {}
        self._closed = False
        self._came = False
        self._mixed = False  # whether there is a publisher that `late` cannot hear
        self._newest = 0  # when the newest of what came was sent, until one reader stays
        # When the last that came were sent. One reader may be closed before the other has given
        # what both were given: so many messages are compared after that too.
        self._recent: deque[int] = deque(maxlen=2 * depth)
        self._compared = 2 * depth
        self._others: list[str] = []
        self._open_live()
        self._whole_name = self._readers["live"].topic_name
        # Of the wall clock: a simulated one may stand while publishers come.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._watch: Any = node.create_timer(1.0, self._look, clock=clock)

    def close(self) -> None:
        """Hears nothing more."""
        self._callback.close()
        with self._lock:
            self._closed = True
            self._end_watch()
            for name in [*self._readers]:
                self._close(name)

    def _open_live(self) -> None:
        profile = QoSProfile(depth=self._depth, reliability=_QOS[self._qos])
        self._open("live", profile, self._tell_unheard)

    def _open_late(self) -> None:
        profile = QoSProfile(depth=self._depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._open("late", profile, self._hear_all)

    def _open(self, name: str, profile: QoSProfile, unheard: Callable[[object], None]) -> None:
        """Opens a reader; `unheard` is called when there is a publisher that it cannot hear."""
        events = SubscriptionEventCallbacks(incompatible_qos=unheard, use_default_callbacks=False)
        hearing = self._hearing
        self._readers[name] = self._node.create_subscription(
            self._message,
            self._topic,
            self._hear,
            profile,
            event_callbacks=events,
            callback_group=hearing.group if hearing is not None else None,
        )
        if hearing is not None:
            hearing.add(self._readers[name], self._hear)

    def _close(self, name: str) -> None:
        reader = self._readers.pop(name)
        if self._hearing is not None:
            self._hearing.remove(reader)
        self._node.destroy_subscription(reader)

    def _hear(self, message: Any, info: dict[str, int]) -> None:
        self._came = True
        if self._compared:
            sent, watched = info["source_timestamp"], self._watch is not None
            if sent in self._recent:
                return  # the other reader heard it
            if watched and sent <= self._newest and len(self._readers) == 2:
                return  # it is older than what was heard
            self._newest = max(sent, self._newest)
            self._recent.append(sent)
            self._compared -= not watched
        self._callback(message)

    def _look(self) -> None:
        """Looks at the publishers once a second, until one reader stays: DDS tells of few."""
        publishers = self._node.get_publishers_info_by_topic(self._whole_name)
        wanted = f"{self._message.__module__.partition('.')[0]}/msg/{self._message.__name__}"
        others = sorted({each.topic_type for each in publishers} - {wanted})
        if others not in ([], self._others):
            self._others = others
            self._log(
                Level.ERROR,
                f"a publisher of {self._whole_name} sends {', '.join(others)} instead of {wanted}: "
                "none of its messages come",
            )
        keeps = any(each.topic_type == wanted and _keeps(each.qos_profile) for each in publishers)
        with self._lock:
            if keeps and not self._closed and "late" not in self._readers:
                self._open_late()
            elif self._came:
                self._end_watch()
                if len(self._readers) == 2:
                    self._close("late" if self._mixed else "live")

    def _end_watch(self) -> None:
        watch, self._watch = self._watch, None
        if watch is not None:
            self._node.destroy_timer(watch)

    def _tell_unheard(self, _event: object) -> None:
        self._log(
            Level.ERROR,
            f"a publisher of {self._whole_name} is not {self._qos}: none of its messages come; "
            "set qos to best_effort",
        )

    def _hear_all(self, _event: object) -> None:
        """Goes back to the reader that hears everybody."""
        with self._lock:
            self._mixed = True
            if not self._closed and "live" not in self._readers:
                self._open_live()
                self._close("late")


def _keeps(qos: QoSProfile) -> bool:
    """Whether a publisher gives what it has published to who comes late."""
    return (
        qos.durability is DurabilityPolicy.TRANSIENT_LOCAL
        and qos.reliability is ReliabilityPolicy.RELIABLE
    )
