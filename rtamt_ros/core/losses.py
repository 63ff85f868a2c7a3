"""The evidence of a verdict: messages that were lost, that came late, or that came at once."""

from __future__ import annotations

from collections.abc import Iterable

from rtamt_ros.middleware import Reception


class LossCount:
    """Counts lost messages of a topic by the gaps in the numbers of its publisher.

    It counts from the first message on, while the topic has one publisher. A number that goes back
    is from a new publisher.

    Attributes:
        reported: The number of lost messages that ROS reported; they leave gaps too.
        unknown: Why losses cannot be counted now; empty if they are.
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
        """Take the number of a message; None if it has none."""
        if self._publishers > 1:
            return
        if number is None:
            self.unknown, self._last = "the messages have no numbers", None
            return
        if self._last is not None and number > self._last:
            self._gaps += number - self._last - 1
        self.unknown, self._last = "", number

    def follow(self, publishers: int) -> None:
        """Take the number of publishers of the topic."""
        if publishers > 1:
            self.unknown, self._last = f"{publishers} publishers", None
        elif self._publishers > 1:
            self.unknown = ""
        self._publishers = publishers


class TopicEvidence:
    """The counts of a topic on which verdicts rest.

    Attributes:
        topic: The names of its inputs.
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
        """Take the time of a sample, which is judged now."""
        self._judged = time
        self._before = self.taken, self.loss.lost

    def forget_after(self, now: int) -> None:
        """Take the time to which the clock went back."""
        self._judged = None if self._judged is None else min(self._judged, now)

    @property
    def since(self) -> tuple[int, int]:
        """The numbers of messages taken and lost since the last sample."""
        taken, lost = self._before
        return self.taken - taken, self.loss.lost - lost

    @property
    def text(self) -> str:
        """The losses for a reader: ``x: 12`` or ``x: unknown, 2 publishers``."""
        count = f"{self.topic}: {self.loss.lost}"
        if not self.loss.unknown:
            return count
        known = f"{count} and " if self.loss.lost else f"{self.topic}: "
        return f"{known}loss unknown: {self.loss.unknown}"


class Suspension:
    """A time in which nothing was judged, such as after SIGSTOP or on an overloaded computer.

    For a while an input may be stale only because its messages still wait.

    Args:
        duration: Its nanoseconds.
        now: Its end.
        period: The nanoseconds in which messages may still come at once.
        gap: The nanoseconds until an input without a message is stale.
    """

    def __init__(self, duration: int, now: int, period: int, gap: int) -> None:
        self._duration = duration
        self._since: dict[TopicEvidence, tuple[int, int]] = {}
        self.counts_until = now + period
        self.until = now + gap

    def add(self, topics: Iterable[TopicEvidence]) -> Suspension:
        """Count the messages of topics since the last sample; return itself."""
        for topic in topics:
            taken, lost = topic.since
            self._since[topic] = topic.taken - taken, topic.loss.lost - lost
        return self

    @property
    def text(self) -> str:
        """The reason for a restart."""
        parts = [f"nothing was judged for {self._duration / 1e9:.1f} s"]
        for topic, (taken, lost) in self._since.items():
            count = topic.taken - taken
            words = "message" if count == 1 else "messages"
            missing = f"{topic.loss.lost - lost} were lost"
            missing = "loss unknown" if topic.loss.unknown else missing
            if count:
                parts.append(f"{count} {words} of {topic.topic} came at once, {missing}")
        return "; ".join(parts)
