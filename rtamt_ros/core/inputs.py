"""The inputs of a node: the values of a topic over time, their age, and the lost messages."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any

from rtamt.inputs.stamps import StampOrder
from rtamt.language import SubscribedField
from rtamt_ros.core.settings import Settings
from rtamt_ros.middleware import Reception

_UNREADABLE = (AttributeError, IndexError, KeyError, TypeError, ValueError, OverflowError)

_Arrival = tuple[int, int, list[float], int]


class Input:
    """A topic, and the fields that specifications read from its messages.

    `take` stores the numbers of messages, from any thread. One thread calls `gather`, and then
    `settle` for times that are whole periods apart, which selects the last message up to each time.
    Messages that no time can select, or that are older than a gap and a period, are dropped.

    Attributes:
        default: The value before the first message; None if the input waits for one.
        waits: Whether the default does not count yet, because a kept message may still arrive.
        stale_after: The nanoseconds without a message after which the input is stale.
        several: A text that names the publishers if there are several; otherwise empty.
        blocked: Whether there is no run because there are several publishers.
        latest: The last accepted message and its arrival; None before the first.
        package: The package of the message class.
        message: The name of the message class.
        fields: The fields that are read, in the order of `values`.
        values: The values of the selected message, the default, or nothing before the first.
        time: The time of the message in nanoseconds: its arrival or its stamp; None before the
            first.
        came: The arrival in nanoseconds. If the stamp is later, the age counts from here, so that a
            publisher with a fast clock becomes stale like others.
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
        self._waiting: deque[_Arrival] = deque()  # gathered, not selected
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
        """Make the stored messages available to `settle`."""
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
        """Add a message, and drop earlier messages that no time can select any more."""
        came, time, values, jump = arrival
        settled, period = self._settled, self._period
        while queue:
            before = queue[-1][0]
            if came > before and (  # otherwise, the clock stands still or jumped back
                settled is None
                or (came - settled - 1) // period != (before - settled - 1) // period
            ):
                break
            jump = queue.pop()[3] or jump
        queue.append((came, time, values, jump))

    def why_jumped(self) -> str:
        """Return a text about the last jump of the stamps."""
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
        """Return whether it is blocked, or has neither a message nor a default that counts."""
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
        """Set the time of messages from before the start of a simulated clock to ``now``."""
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
        """Return which field cannot be read, and why."""
        for field in self.fields:
            try:
                value = field.read(message)
                number = float(value)
            except _UNREADABLE as unreadable:
                return f"{field.variable} cannot be read: {unreadable}"
            if number != number:  # noqa: PLR0124 - nan
                return f"{field.variable} is nan"
        return f"a message of {self.topic} cannot be read: {error}"


class LossCount:
    """The number of lost messages of a topic, from gaps in the sequence numbers of its publisher.

    It counts after the first message, while the topic has one publisher. A smaller number than
    before is from a restarted publisher.

    Attributes:
        reported: The number of lost messages that ROS reported; they leave gaps too.
        unknown: Why losses cannot be counted now; empty if they can.
    """

    def __init__(self) -> None:
        self.reported = 0
        self.unknown = ""
        self._gaps = 0
        self._publishers = 1
        self._last: int | None = None

    @property
    def lost(self) -> int:
        """The number of lost messages."""
        return max(self._gaps, self.reported)

    def take(self, number: int | None) -> None:
        """Count the gap before a message; its number is None if messages have no numbers."""
        if self._publishers > 1:
            return
        if number is None:
            self.unknown, self._last = "the messages have no numbers", None
            return
        if self._last is not None and number > self._last:
            self._gaps += number - self._last - 1
        self.unknown, self._last = "", number

    def follow(self, publishers: int) -> None:
        """Set the number of publishers of the topic."""
        if publishers > 1:
            self.unknown, self._last = f"{publishers} publishers", None
        elif self._publishers > 1:
            self.unknown = ""
        self._publishers = publishers


class TopicEvidence:
    """The counts of a topic that show how reliable verdicts are.

    Attributes:
        topic: The names of its inputs, separated by commas.
        loss: The lost messages.
        taken: The number of messages taken.
        late: The number of messages that arrived before a judged time and were taken after it.
    """

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.loss = LossCount()
        self.taken = self.late = 0
        self._judged: int | None = None
        self._before = 0, 0

    def count(self, reception: Reception, time: int) -> None:
        """Count a message with its time in nanoseconds."""
        self.taken += 1
        self.loss.reported = reception.lost
        self.loss.take(reception.number)
        dated = time if reception.received is None else reception.received
        self.late += self._judged is not None and dated < self._judged

    def judge(self, time: int) -> None:
        """Set the time of the last evaluated sample."""
        self._judged = time
        self._before = self.taken, self.loss.lost

    def forget_after(self, now: int) -> None:
        """Set the clock back to ``now``."""
        self._judged = None if self._judged is None else min(self._judged, now)

    @property
    def since(self) -> tuple[int, int]:
        """The numbers of messages that were taken and lost since the last sample."""
        taken, lost = self._before
        return self.taken - taken, self.loss.lost - lost

    @property
    def text(self) -> str:
        """The losses as a text: ``x: 12`` or ``x: loss unknown: 2 publishers``."""
        count = f"{self.topic}: {self.loss.lost}"
        if not self.loss.unknown:
            return count
        start = f"{count} and " if self.loss.lost else f"{self.topic}: "
        return f"{start}loss unknown: {self.loss.unknown}"
