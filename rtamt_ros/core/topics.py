"""The topics of a node: their inputs, their publishers, and how long a default waits."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from rtamt.inputs.stamps import StampedMessage, StampOrder
from rtamt_ros.core.inputs import Input
from rtamt_ros.core.losses import TopicEvidence
from rtamt_ros.core.settings import Settings
from rtamt_ros.middleware import Level, TopicPublisher

_SECOND = 1_000_000_000
DISCOVERY = _SECOND
"""The nanoseconds after a subscription from which the graph of ROS is complete."""
DEFAULT_WAIT = 2 * _SECOND
"""The nanoseconds after a subscription at which a default counts in any case."""


class Topic:
    """A topic, and the inputs that read its messages.

    Attributes:
        name: The topic, as in the specification.
        inputs: Its inputs.
        evidence: The counts on which verdicts rest.
        publishers: The publishers that the graph shows.
        several: The publishers in words if there are several; otherwise empty.
        may_keep: Whether a publisher may still give a kept message to the node; None while unknown.
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
        self.evidence.topic = ", ".join(dict.fromkeys(each.name for each in self.inputs))

    def take(self, message: Any, time: int, came: int) -> Iterator[set[Input]]:  # noqa: ANN401 - the classes of ROS have no types
        """Pass a message to the inputs; yield for each accepted message the inputs that took it.

        With stamps an earlier message may be accepted too, or this one may have to wait.
        """
        accepted = [StampedMessage(time, came, message)]
        if self.order is not None:
            if self._came - came > self._tolerance:  # the clock went back
                self.order.forget()
            self._came = came
            accepted = self.order.take(time, came, message)
        for each in accepted:
            yield {source for source in self.inputs if source.take(*each)}

    def restore(self, message: Any, time: int, came: int) -> None:  # noqa: ANN401
        """Pass a message to the inputs that an earlier node accepted."""
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
        """Let defaults count if the time of a steady clock is late enough."""
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
        """Take the publishers of the topic; it is never stale if all keep their last message."""
        self.publishers = tuple(publishers)
        count = len(publishers)
        nodes = ", ".join(sorted(publisher.node for publisher in publishers))
        self._full_name = full_name
        self.several = f"{count} publishers of {full_name}: {nodes}" if count > 1 else ""
        self.evidence.loss.follow(count)
        for source in self.inputs:
            source.several = self.several
            source.blocked = self._one and count > 1
        kept = bool(publishers) and all(publisher.keeps for publisher in publishers)
        for source in self.inputs:
            source.stale_after = math.inf if kept and self._never_stale else self._stale_after

    def news(self) -> tuple[Level, str]:
        """Return the line of the log about the number of publishers."""
        if not self.several:
            return Level.OK, f"no more than 1 publisher of {self._full_name}"
        effect = "no run until there is one" if self._one else "their messages are mixed"
        killed = "a killed one stays in the graph of ROS 2 for up to 20 s"
        return Level.WARN, f"{self.several}; {effect}; {killed}"

    def latest(self) -> list[tuple[Any, int]]:
        """Return the messages that the inputs hold, with their arrivals, in order of arrival."""
        held = {id(each.latest[0]): each.latest for each in self.inputs if each.latest is not None}
        return sorted(held.values(), key=lambda arrival: arrival[1])
