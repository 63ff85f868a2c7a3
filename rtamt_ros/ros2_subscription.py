"""Subscriptions of ROS 2 in their own thread, which also receive kept messages."""

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


class Receiver(threading.Thread):
    """A thread that takes the messages of some subscriptions of a node.

    For every message, an executor of rclpy collects all entities of its nodes, which takes as long
    as evaluating twenty requirements. This thread waits only for its subscriptions and their
    events, and `group` hides these from executors. An executor that waited for the events would
    also wake for every message, repeatedly until the message is taken.

    Args:
        node: The node of rclpy.
        log: A function that gets the traceback of a message that cannot be read.

    Attributes:
        group: The callback group of the subscriptions.
    """

    def __init__(self, node: Node, log: Callable[[str], object]) -> None:
        super().__init__(name="receiver", daemon=True)
        self.group = _HiddenGroup()
        self._context = node.context
        self._log = log
        self._lock = threading.Lock()
        self._taking = threading.RLock()  # rcl takes messages of a subscription in one thread
        self._callbacks: dict[Subscription, Callable[..., None]] = {}
        self._changed = GuardCondition(None, None, context=node.context)
        self._closed = False

    def add(self, subscription: Subscription, callback: Callable[..., None]) -> None:
        """Pass messages of a subscription, with their information from rclpy, to a callback."""
        with self._lock:
            self._callbacks[subscription] = callback
            if self.ident is None:
                self.start()
        self._wake()

    def remove(self, subscription: Subscription) -> None:
        """End the callbacks of a subscription, which can then be destroyed; a running one ends."""
        with self._lock:
            self._callbacks.pop(subscription, None)
        self._wake()

    def take_waiting(self) -> None:
        """Pass the messages that wait in the queues of all subscriptions to their callbacks."""
        with self._lock:
            callbacks = list(self._callbacks.items())
        for subscription, callback in callbacks:
            with suppress(InvalidHandle), subscription.handle:
                while self._take_one(subscription, callback):
                    pass

    def _take_one(self, subscription: Subscription, callback: Callable[..., None]) -> bool:
        """Pass the next message to its callback; return False if there is none."""
        with self._taking:
            arrival = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if arrival is not None:
                callback(*arrival)
        return arrival is not None

    def close(self) -> None:
        """End all callbacks, and wait for a running one."""
        self._closed = True
        self._wake()
        if self.ident is not None:
            self.join()

    def _wake(self) -> None:
        """Wake the thread, so that it reads the set of subscriptions again."""
        if self.is_alive():
            self._changed.trigger()

    def run(self) -> None:
        """Take messages until it is closed."""
        while not self._closed:
            with ExitStack() as stack:  # keeps destroyed entities until the end of the block
                with self._lock:
                    callbacks = dict(self._callbacks)
                    for entity in (self._context, self._changed, *callbacks):
                        stack.enter_context(entity.handle)
                    events = [event for entity in callbacks for event in entity.event_handlers]
                    for event in events:
                        stack.enter_context(event)
                with suppress(InvalidHandle):  # an entity was removed and destroyed
                    self._take(callbacks, events)

    def _take(
        self, callbacks: dict[Subscription, Callable[..., None]], events: Sequence[EventHandler]
    ) -> None:
        """Take messages of subscriptions until the set of subscriptions changes."""
        by_pointer = {
            subscription.handle.pointer: (subscription, callback)
            for subscription, callback in callbacks.items()
        }
        counts = len(callbacks), 1, 0, 0, 0, len(events)
        waits: Any = rclpy_implementation.WaitSet(*counts, self._context.handle)
        changed = self._changed.handle
        while not self._closed:
            waits.clear_entities()
            for subscription in callbacks:
                waits.add_subscription(subscription.handle)
            for event in events:
                event.add_to_wait_set(waits)
            waits.add_guard_condition(changed)
            waits.wait(-1)
            ready = [by_pointer[pointer] for pointer in waits.get_ready_entities("subscription")]
            ready_events = [event for event in events if event.is_ready(waits)]
            try:
                for subscription, callback in ready:
                    self._take_one(subscription, callback)
                for event in ready_events:
                    if data := event.take_data():
                        event.callback(data)
            except InvalidHandle:
                raise
            except Exception:  # noqa: BLE001 - such as a text that is not UTF-8
                self._log(traceback.format_exc())
            if waits.get_ready_entities("guard_condition"):
                return


class _HiddenGroup(MutuallyExclusiveCallbackGroup):  # type: ignore[misc] # rclpy has no types
    """A callback group that executors skip."""

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002
        return False


_QOS: dict[Qos, ReliabilityPolicy] = {
    "best_effort": ReliabilityPolicy.BEST_EFFORT,
    "reliable": ReliabilityPolicy.RELIABLE,
}


_LOOK = 0.1
"""Seconds between checks of the publishers of a topic in its first seconds."""
_OFTEN = 25
"""The number of these checks; meanwhile a default waits for a kept message."""


class Ros2Subscription:
    """A subscription that receives new messages and kept messages.

    DDS sends kept messages (``transient_local``) only to a reader that requests them, and that
    reader receives nothing from publishers that keep nothing. The first reader, ``live``, requests
    no kept messages. If a publisher keeps messages, a second reader, ``late``, requests them. After
    the first message one of the two stays: ``late`` if every publisher keeps messages, because it
    also receives the kept messages of restarted publishers.

    Args:
        node: The node of rclpy.
        topic: As in the specification.
        message: The class of its messages.
        callback: A function that gets every message, once.
        receptions: Whether the callback also gets a `Reception`.
        qos: ``"best_effort"`` receives from every publisher; ``"reliable"`` from reliable ones
            only.
        depth: The maximum number of messages that wait for the callback.
        log: A function that writes a line to the log of the node.
        receiver: The thread that takes the messages; None for an executor of the node.
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
        receiver: Receiver | None = None,
    ) -> None:
        self._node = node
        self._receiver = receiver
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
        self._received = False
        self._mixed = False  # whether `late` cannot receive from a publisher
        self._newest = 0  # the newest source time, until one reader stays
        # The source times of the last messages. One reader may be closed before the other has
        # delivered messages that both received, so some later messages are compared too.
        self._recent: deque[int] = deque(maxlen=2 * depth)
        self._compared = 2 * depth
        self._others: list[str] = []
        self._open_live()
        self._full_name = self._readers["live"].topic_name
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
        self._open("live", profile, self._log_incompatible)

    def _open_late(self) -> None:
        profile = QoSProfile(depth=self._depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._open("late", profile, self._reopen_live)

    def _open(self, name: str, profile: QoSProfile, incompatible: Callable[[object], None]) -> None:
        """Open a reader; ``incompatible`` is called for a publisher that it cannot receive."""
        events = SubscriptionEventCallbacks(
            incompatible_qos=incompatible, message_lost=self._lose, use_default_callbacks=False
        )
        receiver = self._receiver
        self._readers[name] = self._node.create_subscription(
            self._message,
            self._topic,
            self._receive,
            profile,
            event_callbacks=events,
            callback_group=receiver.group if receiver is not None else None,
        )
        if receiver is not None:
            receiver.add(self._readers[name], self._receive)

    def _close(self, name: str) -> None:
        reader = self._readers.pop(name)
        if self._receiver is not None:
            self._receiver.remove(reader)
        self._node.destroy_subscription(reader)

    def _receive(self, message: Any, info: dict[str, int]) -> None:
        self._received = True
        if self._compared:
            sent, watched = info["source_timestamp"], self._watch is not None
            if sent in self._recent:
                return  # the other reader delivered it
            if watched and sent <= self._newest and len(self._readers) == 2:
                return  # it is older than a delivered message
            self._newest = max(sent, self._newest)
            self._recent.append(sent)
            self._compared -= not watched
        if not self._receptions:
            self._callback(message)
            return
        received = info["received_timestamp"] if self._receiver is not None else None
        number = info.get("publication_sequence_number")
        self._callback(message, Reception(received or None, number or None, self._lost))

    def _lose(self, event: Any) -> None:
        self._lost = event.total_count

    def _tick(self) -> None:
        """Check the publishers until one reader stays: often at first, then once per second."""
        self._looks += 1
        if self._looks <= _OFTEN or self._looks % round(1 / _LOOK) == 0:
            self._look()

    def _look(self) -> None:
        """Open or close readers to suit the publishers; DDS reports few changes of publishers."""
        publishers = self._node.get_publishers_info_by_topic(self._full_name)
        wanted = type_name(self._message)
        others = sorted({publisher.topic_type for publisher in publishers} - {wanted})
        if others not in ([], self._others):
            self._others = others
            self._log(
                Level.ERROR,
                f"a publisher of {self._full_name} sends {', '.join(others)} instead of {wanted}: "
                "its messages are not received",
            )
        any_keeps = any(
            publisher.topic_type == wanted and keeps(publisher.qos_profile)
            for publisher in publishers
        )
        with self._lock:
            if any_keeps and not self._closed and "late" not in self._readers:
                self._open_late()
            elif self._received:
                self._end_watch()
                if len(self._readers) == 2:
                    self._close("late" if self._mixed else "live")

    def _end_watch(self) -> None:
        watch, self._watch = self._watch, None
        if watch is not None:
            self._node.destroy_timer(watch)

    def _log_incompatible(self, _event: object) -> None:
        self._log(
            Level.ERROR,
            f"a publisher of {self._full_name} is not {self._qos}: its messages are not received; "
            "set qos to best_effort",
        )

    def _reopen_live(self, _event: object) -> None:
        """Return to the reader that receives from every publisher."""
        with self._lock:
            self._mixed = True
            if not self._closed and "live" not in self._readers:
                self._open_live()
                self._close("late")


def type_name(message: type) -> str:
    """Return the name of a message class in the graph: ``std_msgs/msg/Float64``."""
    return f"{message.__module__.partition('.')[0]}/msg/{message.__name__}"


def keeps(qos: QoSProfile) -> bool:
    """Return whether a publisher sends its last messages to late subscribers."""
    return (
        qos.durability is DurabilityPolicy.TRANSIENT_LOCAL
        and qos.reliability is ReliabilityPolicy.RELIABLE
    )
