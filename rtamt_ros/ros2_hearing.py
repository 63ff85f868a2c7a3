"""A thread that takes the messages of subscriptions of ROS 2, and does nothing else."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.event_handler import EventHandler
from rclpy.exceptions import InvalidHandle
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.subscription import Subscription

__all__ = ["Hearing"]


class Hearing(threading.Thread):
    """Takes messages of some subscriptions of a node as soon as they come.

    An executor of rclpy gathers all entities of its nodes for every message, which takes as long as
    twenty requirements take to be judged. This thread waits for its subscriptions and their events
    alone, from which their `group` keeps executors. An executor that waited for the events would
    also wake for every message, again and again until it is taken.

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
        self._callbacks: dict[Subscription, Callable[..., None]] = {}
        self._changed = GuardCondition(None, None, context=node.context)
        self._closed = False

    def add(self, subscription: Subscription, callback: Callable[..., None]) -> None:
        """Call back with messages of a subscription, and what rclpy knows of each."""
        with self._lock:
            self._callbacks[subscription] = callback
            if self.ident is None:
                self.start()
        self._tell()

    def remove(self, subscription: Subscription) -> None:
        """Call back no more, unless it is under way; then the subscription may be destroyed."""
        with self._lock:
            self._callbacks.pop(subscription, None)
        self._tell()

    def close(self) -> None:
        """Take nothing more, and wait for a callback that is under way."""
        self._closed = True
        self._tell()
        if self.ident is not None:
            self.join()

    def _tell(self) -> None:
        """Ends the wait of the thread, if it is in one."""
        if self.is_alive():
            self._changed.trigger()

    def run(self) -> None:
        """Takes messages until it is closed."""
        while not self._closed:
            with ExitStack() as held:  # what is destroyed meanwhile stays until it is left
                with self._lock:
                    callbacks = dict(self._callbacks)
                    for each in (self._context, self._changed, *callbacks):
                        held.enter_context(each.handle)
                    events = [event for each in callbacks for event in each.event_handlers]
                    for event in events:
                        held.enter_context(event)
                with suppress(InvalidHandle):  # of what was removed, and then destroyed
                    self._take(callbacks, events)

    def _take(
        self, callbacks: dict[Subscription, Callable[..., None]], events: Sequence[EventHandler]
    ) -> None:
        """Takes messages of subscriptions until others are wanted."""
        by_pointer = {each.handle.pointer: (each, of) for each, of in callbacks.items()}
        counts = len(callbacks), 1, 0, 0, 0, len(events)
        waits: Any = rclpy_implementation.WaitSet(*counts, self._context.handle)
        changed = self._changed.handle
        while not self._closed:
            waits.clear_entities()
            for each in callbacks:
                waits.add_subscription(each.handle)
            for event in events:
                event.add_to_wait_set(waits)
            waits.add_guard_condition(changed)
            waits.wait(-1)
            ready = [by_pointer[each] for each in waits.get_ready_entities("subscription")]
            told = [each for each in events if each.is_ready(waits)]
            try:
                _hand_over(ready, told)
            except InvalidHandle:
                raise
            except Exception:  # noqa: BLE001 - of a message whose texts are no UTF-8
                self._log(traceback.format_exc())
            if waits.get_ready_entities("guard_condition"):
                return


def _hand_over(
    ready: Sequence[tuple[Subscription, Callable[..., None]]], told: Sequence[EventHandler]
) -> None:
    """Calls back with what came of subscriptions, and with events."""
    for subscription, callback in ready:
        taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
        if taken is not None:
            callback(*taken)
    for event in told:
        if what := event.take_data():
            event.callback(what)


class _Apart(MutuallyExclusiveCallbackGroup):  # type: ignore[misc] # rclpy has no types
    """Keeps executors away."""

    def can_execute(self, entity: object) -> bool:  # noqa: ARG002
        return False
