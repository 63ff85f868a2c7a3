"""Subscriptions of ROS 2 in their own thread, with what publishers have kept."""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from functools import partial
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.event_handler import EventHandler, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from rtamt_ros.callbacks import Callback
from rtamt_ros.middleware import Level, Reception
from rtamt_ros.parameters import Qos


class Hearing(threading.Thread):
    """A thread that takes the messages of some subscriptions of a node.

    An executor of rclpy collects all entities of its nodes for every message, which takes as long
    as judging twenty requirements. This thread waits only for its subscriptions and their events,
    from which their `group` keeps executors away. An executor that waited for the events would also
    wake for every message, repeatedly until it is taken.

    Args:
        node: The node of rclpy.
        log: Takes the traceback of a message that cannot be taken.

    Attributes:
        group: The callback group of the subscriptions.
    """

    def __init__(self, node: Node, log: Callable[[str], object]) -> None:
        super().__init__(name="hearing", daemon=True)
        self.group = _Apart()
        self._context = node.context
        self._log = log
        self._lock = threading.Lock()
        self._taking = threading.RLock()  # rcl takes messages of a subscription in one thread
        self._callbacks: dict[Subscription, Callable[..., None]] = {}
        self._changed = GuardCondition(None, None, context=node.context)
        self._closed = False

    def add(self, subscription: Subscription, callback: Callable[..., None]) -> None:
        """Call back with messages of a subscription, and rclpy's information on each."""
        with self._lock:
            self._callbacks[subscription] = callback
            if self.ident is None:
                self.start()
        self._tell()

    def remove(self, subscription: Subscription) -> None:
        """End the callbacks of a subscription, except one in progress; it can be destroyed then."""
        with self._lock:
            self._callbacks.pop(subscription, None)
        self._tell()

    def take_waiting(self) -> None:
        """Call back with the messages that wait in the queues of all subscriptions."""
        with self._lock:
            callbacks = list(self._callbacks.items())
        for subscription, callback in callbacks:
            with suppress(InvalidHandle), subscription.handle:
                while self._hand_over(subscription, callback):
                    pass

    def _hand_over(self, subscription: Subscription, callback: Callable[..., None]) -> bool:
        """Call back with the next message of a subscription; return whether there was one."""
        with self._taking:
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is not None:
                callback(*taken)
        return taken is not None

    def close(self) -> None:
        """End all callbacks, and wait for one in progress."""
        self._closed = True
        self._tell()
        if self.ident is not None:
            self.join()

    def _tell(self) -> None:
        """Interrupt a wait of the thread."""
        if self.is_alive():
            self._changed.trigger()

    def run(self) -> None:
        """Take messages until it is closed."""
        while not self._closed:
            with ExitStack() as stack:  # destroyed entities stay until the end of the block
                with self._lock:
                    callbacks = dict(self._callbacks)
                    for entity in (self._context, self._changed, *callbacks):
                        stack.enter_context(entity.handle)
                    events = [event for callback in callbacks for event in callback.event_handlers]
                    for event in events:
                        stack.enter_context(event)
                with suppress(InvalidHandle):  # an entity was removed and destroyed
                    self._take(callbacks, events)

    def _take(
        self, callbacks: dict[Subscription, Callable[..., None]], events: Sequence[EventHandler]
    ) -> None:
        """Take messages of subscriptions until the set of subscriptions changes."""
        by_pointer = {each.handle.pointer: (each, callback) for each, callback in callbacks.items()}
        counts = len(callbacks), 1, 0, 0, 0, len(events)
        waits: Any = rclpy_implementation.WaitSet(*counts, self._context.handle)
        changed = self._changed.handle
        while not self._closed:
            waits.clear_entities()
            for callback in callbacks:
                waits.add_subscription(callback.handle)
            for event in events:
                event.add_to_wait_set(waits)
            waits.add_guard_condition(changed)
            waits.wait(-1)
            ready = [by_pointer[each] for each in waits.get_ready_entities("subscription")]
            occurred = [each for each in events if each.is_ready(waits)]
            try:
                for subscription, callback in ready:
                    self._hand_over(subscription, callback)
                for event in occurred:
                    if data := event.take_data():
                        event.callback(data)
            except InvalidHandle:
                raise
            except Exception:  # noqa: BLE001 - a text is not UTF-8
                self._log(traceback.format_exc())
            if waits.get_ready_entities("guard_condition"):
                return


class _Apart(MutuallyExclusiveCallbackGroup):  # type: ignore[misc] # rclpy has no types
    """A callback group that keeps executors away."""

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002
        return False


_QOS: dict[Qos, ReliabilityPolicy] = {
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
    "reliable": ReliabilityPolicy.RELIABLE,
}


_LOOK = 0.1
"""Seconds between checks of the publishers of a topic in its first seconds."""
_OFTEN = 25
"""The number of these checks: a kept message must arrive while a default waits for it."""


class Ros2Subscription:
    """A subscription that receives new messages, and those that publishers have kept.

    DDS gives kept messages (``transient_local``) only to a reader that requests them, and gives
    such a reader nothing from publishers that keep nothing. So the first reader, ``live``, requests
    nothing. If a publisher keeps messages, a second reader, ``late``, requests them. After the
    first message one of the two stays: ``late`` if every publisher keeps messages, because it also
    receives from restarted publishers.

    Args:
        node: The node of rclpy.
        topic: As in the specification.
        message: The class of its messages.
        callback: Takes every message, once.
        receptions: Whether the callback takes a `Reception` too.
        qos: ``"best_effort"`` receives from every publisher; ``"reliable"`` from reliable ones
            only.
        depth: The number of messages that wait for the callback.
        log: The log of the node.
        hearing: The thread that takes the messages; None for an executor of the node.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        message: type,
        callback: Callable[..., None],
        *,
        receptions: bool = False,
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
        self._receptions = receptions
        self._lost = 0
        self._qos: Qos = qos
        self._depth = depth
        self._log = log
        self._lock = threading.RLock()  # protects the readers
        self._readers: dict[str, Any] = {}
        self._closed = False
        self._came = False
        self._mixed = False  # whether `late` cannot receive from a publisher
        self._newest = 0  # the newest source time, until one reader stays
        # The source times of the last messages. One reader may be closed before the other has
        # delivered messages that both received, so some later ones are compared too.
        self._recent: deque[int] = deque(maxlen=2 * depth)
        self._compared = 2 * depth
        self._others: list[str] = []
        self._open_live()
        self._whole_name = self._readers["live"].topic_name
        # A steady clock: a simulated clock may stand still while publishers appear.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._looks = 0
        self._watch: Any = node.create_timer(_LOOK, self._tick, clock=clock)

    def close(self) -> None:
        """End the subscription."""
        self._callback.close()
        with self._lock:
            self._closed = True
            self._end_watch()
            for name in [*self._readers]:
                self._close(name)

    def _open_live(self) -> None:
        profile = QoSProfile(depth=self._depth, reliability=_QOS[self._qos])
        self._open("live", profile, self._log_unheard)

    def _open_late(self) -> None:
        profile = QoSProfile(depth=self._depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._open("late", profile, self._hear_all)

    def _open(self, name: str, profile: QoSProfile, unheard: Callable[[object], None]) -> None:
        """Open a reader; ``unheard`` is called for a publisher that it cannot receive from."""
        events = SubscriptionEventCallbacks(
            incompatible_qos=unheard, message_lost=self._lose, use_default_callbacks=False
        )
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
                return  # the other reader delivered it
            if watched and sent <= self._newest and len(self._readers) == 2:
                return  # it is older than a delivered one
            self._newest = max(sent, self._newest)
            self._recent.append(sent)
            self._compared -= not watched
        if not self._receptions:
            self._callback(message)
            return
        received = info["received_timestamp"] if self._hearing is not None else None
        number = info.get("publication_sequence_number")
        self._callback(message, Reception(received or None, number or None, self._lost))

    def _lose(self, event: Any) -> None:
        self._lost = event.total_count

    def _tick(self) -> None:
        """Check the publishers until one reader stays; at first often, then once a second."""
        self._looks += 1
        if self._looks <= _OFTEN or self._looks % round(1 / _LOOK) == 0:
            self._look()

    def _look(self) -> None:
        """Open or close readers as the publishers need; DDS reports few changes of them."""
        publishers = self._node.get_publishers_info_by_topic(self._whole_name)
        wanted = type_name(self._message)
        others = sorted({publisher.topic_type for publisher in publishers} - {wanted})
        if others not in ([], self._others):
            self._others = others
            self._log(
                Level.ERROR,
                f"a publisher of {self._whole_name} sends {', '.join(others)} instead of {wanted}: "
                "none of its messages come",
            )
        kept = any(
            publisher.topic_type == wanted and keeps(publisher.qos_profile)
            for publisher in publishers
        )
        with self._lock:
            if kept and not self._closed and "late" not in self._readers:
                self._open_late()
            elif self._came:
                self._end_watch()
                if len(self._readers) == 2:
                    self._close("late" if self._mixed else "live")

    def _end_watch(self) -> None:
        watch, self._watch = self._watch, None
        if watch is not None:
            self._node.destroy_timer(watch)

    def _log_unheard(self, _event: object) -> None:
        self._log(
            Level.ERROR,
            f"a publisher of {self._whole_name} is not {self._qos}: none of its messages come; "
            "set qos to best_effort",
        )

    def _hear_all(self, _event: object) -> None:
        """Return to the reader that receives from everybody."""
        with self._lock:
            self._mixed = True
            if not self._closed and "live" not in self._readers:
                self._open_live()
                self._close("late")


def type_name(message: type) -> str:
    """Return the name of a message class in the graph: ``std_msgs/msg/Float64``."""
    return f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"


def keeps(qos: QoSProfile) -> bool:
    """Return whether a publisher gives its last messages to late subscribers."""
    return (
        qos.durability is DurabilityPolicy.TRANSIENT_LOCAL
        and qos.reliability is ReliabilityPolicy.RELIABLE
    )
