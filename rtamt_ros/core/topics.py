"""The topics of a node: their inputs, their publishers, and how long a default waits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from rtamt_ros.core.inputs import Input
from rtamt_ros.core.settings import Settings
from rtamt_ros.middleware import TopicPublisher

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
        publishers: The publishers that the graph shows.
        may_keep: Whether a publisher may still give a kept message to the node; None while unknown.
        subscribed: The nanoseconds of a steady clock at the subscription; None before.
    """

    def __init__(self, name: str, settings: Settings) -> None:
        self.name = name
        self.inputs: list[Input] = []
        self.publishers: tuple[TopicPublisher, ...] = ()
        self.may_keep: bool | None = None
        self.subscribed: int | None = None
        self._never_stale = name not in settings.stale_of
        self._stale_after = settings.stale_after(name)

    def add(self, source: Input) -> None:
        """Add an input, whose default waits for the topic."""
        source.waits = source.default is not None
        self.inputs.append(source)

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

    def follow(self, publishers: Sequence[TopicPublisher]) -> None:
        """Take the publishers of the topic; it is never stale if all keep their last message."""
        self.publishers = tuple(publishers)
        kept = bool(publishers) and all(publisher.keeps for publisher in publishers)
        for source in self.inputs:
            source.stale_after = math.inf if kept and self._never_stale else self._stale_after

    def latest(self) -> list[tuple[Any, int]]:
        """Return the messages that the inputs hold, with their arrivals, in order of arrival."""
        held = {id(each.latest[0]): each.latest for each in self.inputs if each.latest is not None}
        return sorted(held.values(), key=lambda arrival: arrival[1])
