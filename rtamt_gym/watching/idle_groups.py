"""Groups of a stream that end after a time without rows."""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator
from typing import Final

from rtamt import InputError
from rtamt.errors import shown
from rtamt_gym.tables import counted
from rtamt_gym.watching.rows import RowFault

_ENDED: Final = 10_000_000
"""The maximum number of ended groups that are stored by name."""


_ROUNDED: Final = 1e-10
"""The part of the idle time by which a distance of rounded times may differ from it."""


class IdleGroups:
    """The last time of each group, and the names of ended groups.

    Args:
        idle: Seconds after which a group ends.
        source: The name of the stream, for messages.

    Example:
        >>> groups = IdleGroups(2.0, "stdin")
        >>> for time, group in ((0.0, "a"), (1.0, "b"), (2.5, "b")):
        ...     groups.add(group, time)
        ...     print([*groups.ended_at(time)])
        []
        []
        ['a']
    """

    def __init__(self, idle: float, source: str) -> None:
        self._source = source
        # A distance of rounded times, such as 1.1 - 0.4, is not longer than the time that it shows.
        self._idle = idle * (1 + _ROUNDED)
        self._queue: list[tuple[float, str]] = []
        self._last: dict[str, float] = {}
        self._newest = -math.inf
        self._ended: set[str] = set()
        self._late: dict[str, int] = {}

    def __contains__(self, group: str | None) -> bool:
        return group in self._ended

    def check(self, group: str, row: int) -> None:
        """Check that a group has not ended.

        Raises:
            RowFault: At this row, if the group has ended.
        """
        if group in self._ended:
            raise RowFault(row, f"group {shown(group)!r} has already ended by --group-idle")

    def add_late(self, group: str) -> None:
        """Note that a row of a group that has ended was left out."""
        self._late[group] = self._late.get(group, 0) + 1

    def late_text(self) -> str:
        """Return a sentence on rows that came after the end of their groups; empty without one."""
        if not self._late:
            return ""
        (first, rows), groups = next(iter(self._late.items())), len(self._late)
        more = f" (and {counted(groups - 1, 'more group')})" if groups > 1 else ""
        return (
            f"group {shown(first)!r} got {counted(rows, 'row')} after --group-idle had ended "
            f"it{more}: these rows were left out. Give a longer --group-idle to evaluate them."
        )

    def add(self, group: str, time: float) -> None:
        """Note the time of a row."""
        last = self._last.get(group)
        if last is None:
            heapq.heappush(self._queue, (time, group))
        self._last[group] = time if last is None else max(last, time)

    def ended_at(self, time: float) -> Iterator[str]:
        """Yield the groups that end at the time of a row."""
        self._newest = max(self._newest, time)
        while self._queue and self._newest - self._queue[0][0] > self._idle:
            _, group = heapq.heappop(self._queue)
            if self._newest - self._last[group] <= self._idle:
                heapq.heappush(self._queue, (self._last[group], group))
                continue
            del self._last[group]
            self._ended.add(group)
            yield group
            if len(self._ended) > _ENDED:
                raise InputError(f"{self._source}: more than {_ENDED} groups have ended")
