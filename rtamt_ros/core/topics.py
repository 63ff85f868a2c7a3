"""The topics of a node: their inputs, their publishers and their subscriptions."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rtamt.inputs.stamps import StampedMessage, StampOrder
from rtamt_ros.core.inputs import Input, TopicEvidence
from rtamt_ros.core.settings import Settings
from rtamt_ros.middleware import Handle, Level, Middleware, Reception, TopicPublisher

_SECOND = 1_000_000_000
DISCOVERY = _SECOND
"""The nanoseconds after a subscription from which the graph of ROS is complete."""
DEFAULT_WAIT = 2 * _SECOND
"""The nanoseconds after a subscription from which a default always counts."""


class Topic:
    """A topic, and the inputs that read its messages.

    Attributes:
        name: The topic, as in the specification.
        inputs: Its inputs.
        evidence: The counts of its messages.
        publishers: The publishers that the graph shows.
        several: A text that names the publishers if there are several; otherwise empty.
        may_keep: Whether a publisher may still send a kept message to the node; None while unknown.
        subscribed: The nanoseconds of a steady clock at the subscription; None before.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        self.name = name
        self.inputs: list[Input] = []
        self.publishers: tuple[TopicPublisher, ...] = ()
        self.may_keep: bool | None = None
        self.subscribed: int | None = None
        self.order = StampOrder(strict=settings.dense) if settings.stamps else None
        self.evidence = TopicEvidence(name)
        self.several = ""
        self._full_name = name
        self._one = settings.publishers == "one"
        self._tolerance = settings.period
        self._came = 0
        self._never_stale = name not in settings.stale_of
        self._stale_after = settings.stale_after(name)

    def add(self, source: Input) -> None:
        """Add an input, whose default waits for the topic."""
        source.waits = source.default is not None
        source.order, source.evidence = self.order, self.evidence
        self.inputs.append(source)
        self.evidence.topic = ", ".join(dict.fromkeys(source.name for source in self.inputs))

    def take(self, message: Any, time: int, came: int) -> Iterator[set[Input]]:  # noqa: ANN401 - the classes of ROS have no types
        """Pass a message to the inputs; yield the inputs that took it, for each accepted message.

        With stamps, an earlier message may be accepted too, or this one may wait.
        """
        accepted = [StampedMessage(time, came, message)]
        if self.order is not None:
            if self._came - came > self._tolerance:  # the clock went back
                self.order.forget()
            self._came = came
            accepted = self.order.take(time, came, message)
        for stamped in accepted:
            yield {source for source in self.inputs if source.take(*stamped)}

    def restore(self, message: Any, time: int, came: int) -> None:  # noqa: ANN401
        """Pass a message that earlier monitors accepted to the inputs."""
        for source in self.inputs:
            source.take(time, came, message)
        if self.order is not None and not self.order.started:
            self.order.take(time, came, message)

    def continue_from(self, order: StampOrder | None, evidence: TopicEvidence | None) -> None:
        """Continue the order and the counts of earlier monitors on the same subscription."""
        if evidence is not None:
            self.evidence.loss = evidence.loss
        if order is not None and self.order is not None:
            order.strict = self.order.strict
            order.late = order.strays = order.ahead = 0
            self.order = order
            for source in self.inputs:
                source.order = order

    def forget_after(self, now: int) -> None:
        """Drop messages that arrived after ``now``, to which the clock went back."""
        for source in self.inputs:
            source.forget_after(now)
        self.evidence.forget_after(now)
        if self._came > now:
            self._came = now
            if self.order is not None:
                self.order.forget()

    def needs_answer(self, steady: int) -> bool:
        """Return whether a default waits for the answer of the graph about kept messages."""
        return self.waits and steady - (self.subscribed or 0) >= DISCOVERY

    def look(self, steady: int) -> None:
        """Let defaults count if enough time of a steady clock has passed since the subscription."""
        if self.subscribed is None or not self.waits:
            return
        age = steady - self.subscribed
        if age >= DEFAULT_WAIT or (age >= DISCOVERY and self.may_keep is False):
            for source in self.inputs:
                source.waits = False

    @property
    def waits(self) -> bool:
        """Whether a default of an input still waits for a first message."""
        return any(source.waits and source.time is None for source in self.inputs)

    def follow(self, publishers: Sequence[TopicPublisher], full_name: str) -> None:
        """Set the publishers of the topic; it is never stale if all keep their last message."""
        self.publishers = tuple(publishers)
        count = len(publishers)
        nodes = ", ".join(sorted(publisher.node for publisher in publishers))
        self._full_name = full_name
        self.several = f"{count} publishers of {full_name}: {nodes}" if count > 1 else ""
        self.evidence.loss.follow(count)
        for source in self.inputs:
            source.several = self.several
            source.blocked = self._one and count > 1
        all_keep = bool(publishers) and all(publisher.keeps for publisher in publishers)
        for source in self.inputs:
            source.stale_after = math.inf if all_keep and self._never_stale else self._stale_after

    def news(self) -> tuple[Level, str]:
        """Return the level and the text of a log line about the number of publishers."""
        if not self.several:
            return Level.OK, f"no more than 1 publisher of {self._full_name}"
        effect = "no run until one is left" if self._one else "their messages are mixed"
        killed = "a killed one stays in the graph of ROS 2 for up to 20 s"
        return Level.WARN, f"{self.several}; {effect}; {killed}"

    def latest(self) -> list[tuple[Any, int]]:
        """Return the messages that the inputs hold, with their arrivals, in order of arrival."""
        arrivals = [source.latest for source in self.inputs if source.latest is not None]
        by_message = {id(arrival[0]): arrival for arrival in arrivals}
        return sorted(by_message.values(), key=lambda arrival: arrival[1])


MessageCallback = Callable[[Any, Reception], None]
"""A callback that takes a message and its reception."""
Arrivals = list[tuple[Any, int]]
"""Messages with the times of their arrivals in nanoseconds, in order of arrival."""


class OpenSubscription:
    """A subscription that passes messages to a callback, and stores them while it has none.

    Attributes:
        message: The class of the messages.
        subscribed: The nanoseconds of a steady clock at the subscription.
        callback: The callback; None while the node changes its specifications.
        evidence: The counts of the topic, for the next callback.
        order: The order of the stamps, for the next callback; None if stamps do not count.
    """

    def __init__(
        self, middleware: Middleware, topic: str, message: type, callback: MessageCallback
    ) -> None:
        self.message = message
        self.callback: MessageCallback | None = callback
        self.order: StampOrder | None = None
        self._now = middleware.now
        self._lock = threading.RLock()
        self._stored: Arrivals = []
        self.evidence: TopicEvidence | None = None
        self.subscribed = middleware.steady()
        self._handle: Handle = middleware.subscribe(topic, message, self._receive, receptions=True)

    def detach(self) -> None:
        """Store messages from now on; wait for a callback in progress."""
        with self._lock:
            self.callback = None

    def keep(self, arrivals: Arrivals) -> None:
        """Store messages that arrived before those that are stored already."""
        with self._lock:
            self._stored[:0] = arrivals

    def take_stored(self) -> Arrivals:
        """Remove and return the stored messages."""
        with self._lock:
            stored, self._stored = self._stored, []
        return stored

    def attach(self, callback: MessageCallback) -> None:
        """Pass messages to a callback, first the stored ones."""
        with self._lock:
            for message, came in self.take_stored():
                callback(message, Reception(came))
            self.callback = callback

    def close(self) -> None:
        """End the subscription."""
        self._handle.close()

    def _receive(self, message: Any, reception: Reception) -> None:  # noqa: ANN401 - the classes of ROS have no types
        with self._lock:
            if self.callback is None:
                self._stored.append((message, reception.received or self._now()))
            else:
                self.callback(message, reception)


class Subscriptions:
    """The open subscriptions of a node, by topic.

    A change of specifications detaches all subscriptions, attaches those with the same topic and
    class again, and closes the others. This way, messages that were sent only once are not lost.
    """

    def __init__(self, middleware: Middleware) -> None:
        self._middleware = middleware
        self._open: dict[str, OpenSubscription] = {}

    def detached(self, topic: str, message: type) -> OpenSubscription | None:
        """Return the detached subscription of a topic and class, if there is one."""
        known = self._open.get(topic)
        return known if known is not None and known.message is message else None

    def open(self, topic: str, message: type, callback: MessageCallback) -> OpenSubscription:
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
