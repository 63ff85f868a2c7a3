"""The order of stamps: which messages of a topic count, with two clocks that may disagree."""

from __future__ import annotations

from typing import Any, NamedTuple

LIMIT = 1_000_000_000
"""The nanoseconds by which a stamp may be older than the newest, or jump ahead of the clock."""
AHEAD = 100_000_000
"""The nanoseconds from which a stamp is ahead of the clock of its arrival."""


class StampedMessage(NamedTuple):
    """A message with two times in nanoseconds.

    Attributes:
        stamp: The time in its header.
        arrival: The time at which it arrived, or was recorded.
        message: The message.
        jump: The nanoseconds by which the stamps jumped at this message; negative if they went
            back, 0 if they did not jump.
    """

    stamp: int
    arrival: int
    message: Any
    jump: int = 0

    @property
    def offset(self) -> int:
        """The nanoseconds by which the stamp is ahead of the arrival."""
        return self.stamp - self.arrival


class StampOrder:
    """Classifies the messages of one topic by their stamps and their arrivals.

    A message is *out of line* if its stamp is more than 1 s older than the newest accepted stamp,
    or if its offset (stamp minus arrival) is more than 1 s above the largest offset accepted since
    the last jump. The first message, a silence and a late delivery are not out of line.

    A message out of line is held until the next one. If that one is in line, the held message is a
    stray and left out. If both offsets are within 1 s, the stamps jumped, and both count. Otherwise
    the held message is left out, and the next one is held. A message in line that is older than the
    newest is late and left out.

    Args:
        strict: Whether a message with the newest stamp is late too, as in dense time.

    Attributes:
        strict: As the argument.
        late: The number of messages left out because they are late.
        strays: The number of messages left out because they are out of line.
        ahead: The number of accepted messages whose offset is more than 0.1 s.
        offset: The offset of the last accepted message.
        held: The message out of line that waits for the next one, or None.
    """

    def __init__(self, *, strict: bool = False) -> None:
        self.strict = strict
        self.late = self.strays = self.ahead = self.offset = 0
        self.held: StampedMessage | None = None
        self._newest: int | None = None
        self._largest = 0

    @property
    def started(self) -> bool:
        """Whether a message was accepted."""
        return self._newest is not None

    def forget(self) -> None:
        """Take the next message as the first; the counts stay."""
        self.held = self._newest = None

    def take(self, stamp: int, arrival: int, message: Any) -> list[StampedMessage]:  # noqa: ANN401 - messages have no types
        """Return the messages that count from now on: none, this one, or a held one and this."""
        new, held = StampedMessage(stamp, arrival, message), self.held
        if not self._is_out_of_line(new):
            self.strays += held is not None
            self.held = None
            return self._accept(new)
        self.held = None
        if held is not None and abs(new.offset - held.offset) <= LIMIT:
            newest = self._newest or 0
            back = held.stamp - newest
            jump = back if -back > LIMIT else held.offset - self._largest
            self._newest = None
            return [*self._accept(held._replace(jump=jump)), *self._accept(new)]
        self.strays += held is not None
        self.held = new
        return []

    def _is_out_of_line(self, new: StampedMessage) -> bool:
        newest = self._newest
        if newest is None:
            return False
        return newest - new.stamp > LIMIT or new.offset - self._largest > LIMIT

    def _accept(self, new: StampedMessage) -> list[StampedMessage]:
        """Return a message in line, unless it is late."""
        newest, offset = self._newest, new.offset
        if newest is None:
            self._largest = offset
        elif new.stamp < newest or (self.strict and new.stamp == newest):
            self.late += 1
            return []
        self._newest = new.stamp
        self._largest = max(self._largest, offset)
        self.offset = offset
        self.ahead += offset > AHEAD
        return [new]
