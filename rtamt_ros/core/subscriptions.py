"""The subscriptions of a node, which outlast a change of its specifications."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rtamt.inputs.stamps import StampOrder
from rtamt_ros.core.losses import TopicEvidence
from rtamt_ros.core.topics import Topic
from rtamt_ros.middleware import Handle, Middleware, Reception

Heard = Callable[[Any, Reception], None]
"""A callback with a message and its reception."""
Arrivals = list[tuple[Any, int]]
"""Messages with the times of their arrivals in nanoseconds, in order of arrival."""


class OpenSubscription:
    """A subscription that passes messages to a callback, and stores them while it has none.

    Attributes:
        message: The class of the messages.
        subscribed: The nanoseconds of a steady clock at the subscription.
        callback: The callback; None while the specifications of the node change.
        evidence: The counts of the topic, for the next callback.
        order: The order of the stamps, for the next callback; None if stamps do not count.
    """

    def __init__(self, middleware: Middleware, topic: str, message: type, callback: Heard) -> None:
        self.message = message
        self.callback: Heard | None = callback
        self.order: StampOrder | None = None
        self._now = middleware.now
        self._lock = threading.RLock()
        self._stored: Arrivals = []
        self.evidence: TopicEvidence | None = None
        self.subscribed = middleware.steady()
        self._handle: Handle = middleware.subscribe(topic, message, self._hear, receptions=True)

    def detach(self) -> None:
        """Store messages from now on; wait for a callback in progress."""
        with self._lock:
            self.callback = None

    def keep(self, arrivals: Arrivals) -> None:
        """Store messages that arrived before those that are stored already."""
        with self._lock:
            self._stored[:0] = arrivals

    def stored(self) -> Arrivals:
        """Return the stored messages, and forget them."""
        with self._lock:
            stored, self._stored = self._stored, []
        return stored

    def attach(self, callback: Heard) -> None:
        """Pass messages to a callback, first the stored ones."""
        with self._lock:
            for message, came in self.stored():
                callback(message, Reception(came))
            self.callback = callback

    def close(self) -> None:
        """End the subscription."""
        self._handle.close()

    def _hear(self, message: Any, reception: Reception) -> None:  # noqa: ANN401 - the classes of ROS have no types
        with self._lock:
            if self.callback is None:
                self._stored.append((message, reception.received or self._now()))
            else:
                self.callback(message, reception)


class Subscriptions:
    """The open subscriptions of a node, by topic.

    A change of specifications detaches all of them, attaches those with the same topic and class
    again, and closes the rest. So messages that publishers have sent only once are not lost.
    """

    def __init__(self, middleware: Middleware) -> None:
        self._middleware = middleware
        self._open: dict[str, OpenSubscription] = {}

    def kept(self, topic: str, message: type) -> OpenSubscription | None:
        """Return the detached subscription of a topic and class, if there is one."""
        known = self._open.get(topic)
        return known if known is not None and known.message is message else None

    def open(self, topic: str, message: type, callback: Heard) -> OpenSubscription:
        """Subscribe to a topic; a subscription with another class is closed.

        Raises:
            InputError: If ROS refuses the topic.
        """
        if (before := self._open.pop(topic, None)) is not None:
            before.close()
        self._open[topic] = OpenSubscription(self._middleware, topic, message, callback)
        return self._open[topic]

    def detach(self) -> None:
        """Store the messages of all subscriptions from now on."""
        for subscription in self._open.values():
            subscription.detach()

    def keep(self, topics: Mapping[str, Topic]) -> None:
        """Store the last messages of topics, for the next callback of their subscriptions."""
        for name, topic in topics.items():
            if name in self._open:
                self._open[name].keep(topic.latest())
                self._open[name].order = topic.order
                self._open[name].evidence = topic.evidence

    def close(self, topics: Sequence[str] | None = None) -> None:
        """Close all subscriptions except those of some topics."""
        for topic in [topic for topic in self._open if topic not in (topics or ())]:
            self._open.pop(topic).close()
