"""The inputs of a node: the values of a topic over time, and their age."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from rtamt.inputs.stamps import StampOrder
from rtamt.language import SubscribedField
from rtamt_ros.core.losses import TopicEvidence
from rtamt_ros.core.settings import Settings

_UNREADABLE = (AttributeError, IndexError, KeyError, TypeError, ValueError, OverflowError)

_Arrival = tuple[int, int, list[float], int]


class Input:
    """A topic, and the fields that specifications read from its messages.

    `take` stores messages from any thread. One thread calls `gather`, and then `settle` for times
    that are whole periods apart: it selects the last message up to each time. Only numbers are
    stored. Between two such times only the last message is kept, and none that is older than a gap
    and a period.

    Attributes:
        default: The value before the first message; None if the input waits for one.
        waits: Whether the default does not count yet, because a kept message may still arrive.
        stale_after: The nanoseconds without a message after which the input is stale.
        several: The publishers of the topic in words if there are several; otherwise empty.
        blocked: Whether there is no run because there are several publishers.
        latest: The last accepted message, and its arrival; None before the first.
        package: The package of the message class.
        message: The name of the message class.
        fields: The fields that are read, in the order of `values`.
        values: The values of the selected message, the default, or nothing before the first.
        time: The time of the message in nanoseconds: its arrival or its stamp; None before the
            first.
        came: The arrival in nanoseconds. The age counts from here if the stamp is later, so that a
            publisher with a fast clock becomes stale as soon as others.
        taken: The number of accepted messages.
        errors: The number of messages left out because they could not be read.
        error: Why the last message could not be read; empty if it could.
        jumps: The number of times that the stamps jumped.
        jump: The size of the last jump in nanoseconds; negative if the stamps went back.
        jumped_at: The arrival of the first message after the last jump.
        evidence: The counts of the topic on which verdicts rest.
        order: The order of the stamps of the topic; None if stamps do not count.
    """

    def __init__(
        self, name: str, topic: str, settings: Settings, default: float | None = None
    ) -> None:
        self.name = name
        self.topic = topic
        self.package: str | None = None
        self.message: str | None = None
        self.stale_after = settings.stale_after(topic)
        self.fields: list[SubscribedField] = []
        self._reads: list[Callable[[Any], Any]] = []
        self._gap = settings.gap
        self._period = settings.period
        # Arrival, time, values, and the size of a jump of the stamps.
        self._arrived: deque[_Arrival] = deque()
        self._waiting: deque[_Arrival] = deque()  # the gathered ones
        self._settled: int | None = None
        self._lock = threading.Lock()
        self.default = default
        self.waits = self.blocked = False
        self.several = ""
        self.latest: tuple[Any, int] | None = None
        self.values: list[float] = []
        self.time: int | None = None
        self.came = 0
        self.taken = self.errors = 0
        self.jumps = self.jump = self.jumped_at = 0
        self.order: StampOrder | None = None
        self.evidence = TopicEvidence(topic)
        self.error = ""

    def add(self, field: SubscribedField) -> int:
        """Read another field; return its place in `values`."""
        paths = [known.path for known in self.fields]
        if field.path in paths:
            return paths.index(field.path)
        self.fields.append(field)
        self._reads.append(field.read)
        self.values = self._defaults()
        return len(paths)

    def take(self, time: int, came: int, message: Any, jump: int = 0) -> bool:  # noqa: ANN401 - the classes of ROS have no types
        """Store the fields of a message until it is settled; return False if it is left out.

        Args:
            time: The time of the message in nanoseconds.
            came: Its arrival in nanoseconds.
            message: The message.
            jump: The nanoseconds by which the stamps of the topic jumped at this message.
        """
        try:
            values = [float(read(message)) for read in self._reads]
        except _UNREADABLE as error:
            return self._refuse(message, error)
        for value in values:
            if value != value:  # noqa: PLR0124 - nan
                return self._refuse(message, None)
        with self._lock:
            arrived = self._arrived
            self._add(arrived, (came, time, values, jump))
            while len(arrived) > 1 and arrived[1][0] < came - self._gap - self._period:
                arrived.popleft()
            self.taken += 1
            self.error = ""
            self.latest = message, came
        return True

    def gather(self) -> None:
        """Make the messages that have arrived available to `settle`."""
        if self._arrived:
            with self._lock:
                for arrival in self._arrived:
                    self._add(self._waiting, arrival)
                self._arrived.clear()

    def settle(self, time: int) -> None:
        """Select the last gathered message up to a time."""
        self._settled = time
        waiting = self._waiting
        while waiting and waiting[0][0] <= time:
            self.came, self.time, self.values, jump = waiting.popleft()
            if jump:
                self.jumps += 1
                self.jump, self.jumped_at = jump, self.came

    def _add(self, queue: deque[_Arrival], arrival: _Arrival) -> None:
        """Add a message, and drop those before it that no time can select any more."""
        came, time, values, jump = arrival
        settled, period = self._settled, self._period
        while queue:
            before = queue[-1][0]
            if came > before and (  # otherwise, the clock stands still or went back
                settled is None
                or (came - settled - 1) // period != (before - settled - 1) // period
            ):
                break
            jump = queue.pop()[3] or jump
        queue.append((came, time, values, jump))

    def why_jumped(self) -> str:
        """Return the last jump of the stamps for a reader."""
        size = f"{abs(self.jump) / 1e9:.1f} s"
        words = "went back" if self.jump < 0 else "jumped ahead"
        return f"the stamps of {self.name} {words} by {size}"

    def age(self, now: int) -> int:
        """Return the nanoseconds since the last message; 0 before the first."""
        return 0 if self.time is None else now - min(self.time, self.came)

    def is_stale(self, now: int) -> bool:
        """Return whether the last message is too old; False before the first."""
        return self.age(now) > self.stale_after

    def is_awaited(self) -> bool:
        """Return whether there is neither a message nor a default that counts, or it is blocked."""
        return self.blocked or (self.time is None and (self.default is None or self.waits))

    def is_default(self) -> bool:
        """Return whether the default counts."""
        return self.time is None and self.default is not None and not self.waits

    def is_gone(self, now: int) -> bool:
        """Return whether there is no current value: it is awaited, blocked or stale."""
        time = self.time
        if time is None or self.blocked:
            return self.is_awaited()
        return now - min(time, self.came) > self.stale_after

    def forget_after(self, now: int) -> None:
        """Drop messages that arrived after ``now``, to which the clock went back."""
        with self._lock:
            if self.latest is not None and self.latest[1] > now:
                self.latest = None
            if self.time is not None and self.came > now:
                self.time = None
                self.values = self._defaults()
            for queue in (self._waiting, self._arrived):
                remaining = [arrival for arrival in queue if arrival[0] <= now]
                queue.clear()
                queue.extend(remaining)

    def came_before_the_clock(self, now: int) -> None:
        """Date messages that arrived before a simulated clock started to ``now``."""
        with self._lock:
            for queue in (self._waiting, self._arrived):
                dated = [
                    (came or now, time or now, values, jump) for came, time, values, jump in queue
                ]
                queue.clear()
                queue.extend(dated)
            if self.time is not None and not self.came:
                self.came = now
                self.time = self.time or now

    def _defaults(self) -> list[float]:
        return [] if self.default is None else [self.default] * len(self.fields)

    def _refuse(self, message: Any, error: Exception | None) -> bool:  # noqa: ANN401
        reason = self._reason(message, error)
        with self._lock:
            self.errors += 1
            self.error = reason
        return False

    def _reason(self, message: Any, error: Exception | None) -> str:  # noqa: ANN401
        """Return the first field that cannot be read, and why."""
        for field in self.fields:
            try:
                value = field.read(message)
                number = float(value)
            except _UNREADABLE as unreadable:
                return f"{field.variable} cannot be read: {unreadable}"
            if number != number:  # noqa: PLR0124 - nan
                return f"{field.variable} is nan"
        return f"a message of {self.topic} cannot be read: {error}"
