"""Events that wait until all variables are known, as arrays."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.inputs.clock import Ticks
from rtamt.inputs.event_reader import TimedColumn
from rtamt.machines.state import StateFields

__all__ = ["Waiting", "together", "values_at"]


class Waiting(StateFields):
    """Events of a variable, and its value before them.

    They stay in the arrays in which they came, so that a call costs what it takes in and reads,
    however many events of a variable that runs ahead wait.

    Args:
        before: The value before the first event; nan if there is none.
    """

    __slots__ = ("_before", "_chunks", "_declared")
    STATE = ("_chunks", "_before")

    def __init__(self, before: float = math.nan) -> None:
        self._declared = before
        self.reset()

    def reset(self) -> None:
        self._chunks: deque[TimedColumn] = deque()
        self._before: float | tuple[float, ...] = self._declared

    def extend(self, new: TimedColumn) -> None:
        """Take in a copy of new events."""
        ticks, values = new
        if len(ticks):
            self._chunks.append((ticks.copy(), values.copy()))

    def retract(self, new: TimedColumn) -> None:
        """Remove the events that came last."""
        if len(new[0]):
            self._chunks.pop()

    def upto(self, last: int) -> TimedColumn:
        """The events up to a tick; in front of their values the one before."""
        times: list[Ticks] = []
        values: list[Floats] = [np.array([self._before])]
        for chunk in self._chunks:
            first, after = _divided(chunk, last)
            times.append(first[0])
            values.append(first[1])
            if len(after[0]):
                break
        ticks = times[0] if len(times) == 1 else np.concatenate([*times, _NO_TICKS])
        return ticks, _concatenated(values)

    def drop(self, last: int) -> None:
        """Forget the events up to a tick but the last value."""
        while self._chunks:
            first, after = _divided(self._chunks[0], last)
            if len(first[1]):
                value = first[1][-1].tolist()
                self._before = tuple(value) if isinstance(value, list) else value
            if len(after[0]):
                self._chunks[0] = after
                return
            self._chunks.popleft()


def _concatenated(values: Sequence[Floats]) -> Floats:
    """Values one after the other: pairs of ends, if some are."""
    if len({each.ndim for each in values}) > 1:
        values = [v if v.ndim > 1 else np.column_stack([v, v]) for v in values]
    return np.concatenate(values)


_NO_TICKS: Ticks = np.empty(0, np.int64)


def _divided(events: TimedColumn, last: int) -> tuple[TimedColumn, TimedColumn]:
    """The events up to a tick, and those after it."""
    ticks, values = events
    read = len(ticks) if ticks[-1] <= last else int(ticks.searchsorted(last, "right"))
    return (ticks[:read], values[:read]), (ticks[read:], values[read:])


def together(waiting: Sequence[Waiting], begin: int, last: int) -> tuple[Ticks, list[Floats]]:
    """The ticks from begin to last at which a variable has an event, and all values there.

    At ``begin`` all variables have values. Those of a variable are numbers, or pairs of ends.
    """
    signals = [variable.upto(last) for variable in waiting]
    ticks = signals[0][0]
    for other, _ in signals[1:]:
        if not np.array_equal(ticks, other):
            both = np.concatenate([ticks, other])
            both.sort(kind="stable")  # two lines that are sorted, in linear time
            ticks = both[np.append(True, both[1:] != both[:-1])]
    ticks = ticks[ticks.searchsorted(begin) :]
    return ticks, [values_at(ticks, signal) for signal in signals]


def values_at(ticks: Ticks, signal: TimedColumn) -> Floats:
    """The values at ticks of a signal that `Waiting.upto` gave."""
    steps, values = signal
    if len(steps) == len(ticks) and np.array_equal(steps, ticks):
        return values[1:]
    return values[steps.searchsorted(ticks, "right")]
