"""The distances of rows: for a note on a stated period, and to find a gap between two rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from fractions import Fraction
from typing import Final

import numpy as np

from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import HOLE
from rtamt_gym.recorded.trace import AsideTimes
from rtamt_gym.tables import number

_MOST: Final = 10_000
"""The maximum number of different distances for the median."""


class StepCounter:
    """The distances of the rows of a trace, for the note on a stated period.

    Args:
        source: The name of the stream, for messages.

    Example:
        >>> steps = StepCounter("stdin")
        >>> steps.add(np.array([0.0, 0.1, 0.2, 6.6]), range(2, 6))
        >>> times = steps.times()
        >>> round(times.usual, 9), round(times.largest, 9), times.place
        (0.1, 6.4, 'stdin, line 4')
    """

    def __init__(self, source: str) -> None:
        self.source = source
        self._counts = Counter[float]()
        self._last: float | None = None
        self._line = self._largest_line = self._lost = 0
        self._smallest, self._largest = np.inf, -np.inf

    def lose(self) -> None:
        """Note that a row is missing, so the next distance spans two steps."""
        self._lost += 1

    def add(self, since: Floats, lines: Sequence[int]) -> None:
        """Add the times of rows.

        Args:
            since: Seconds since the first row, shape (rows,).
            lines: The lines of the rows.
        """
        before = since[0] if self._last is None else self._last
        steps = np.diff(since, prepend=before)
        steps[0] /= self._lost + 1
        at = [self._line, *lines[:-1]]
        if self._last is None:
            steps, at = steps[1:], at[1:]
        self._last, self._line, self._lost = float(since[-1]), lines[-1], 0
        if not len(steps):
            return
        place = int(steps.argmax())
        if steps[place] > self._largest:
            self._largest, self._largest_line = float(steps[place]), at[place]
        self._smallest = min(self._smallest, float(steps.min()))
        if len(self._counts) < _MOST:
            self._counts.update(np.round(steps, 9).tolist())

    def times(self) -> AsideTimes | None:
        """Return the distances so far; None before the second row."""
        if self._last is None or not self._counts:
            return None
        place = f"{self.source}, line {self._largest_line}"
        steps = np.array(sorted(self._counts))
        counts = np.cumsum([self._counts[step] for step in steps.tolist()])
        middle = np.array([(counts[-1] - 1) // 2, counts[-1] // 2])
        usual = float(steps[np.searchsorted(counts, middle, side="right")].mean())
        return AsideTimes(usual, self._smallest, self._largest, place, self._last)


class GroupPeriods:
    """The periods of groups, to find a group whose only two rows may have a gap between them.

    Example:
        >>> periods = GroupPeriods()
        >>> periods.add("a", Fraction(1), 6)
        >>> periods.add("b", Fraction(5), 2)
        >>> periods.fault().partition(":")[0]
        "group 'b'"
    """

    def __init__(self) -> None:
        self._counts = Counter[Fraction]()
        self._widest, self._group = Fraction(0), ""

    def add(self, group: str, period: Fraction, samples: int) -> None:
        """Add a group that has ended, with two samples or more."""
        self._counts[period] += samples - 1
        if samples == 2 and period > self._widest:
            self._widest, self._group = period, group

    def fault(self) -> str:
        """Return the error for the two rows that are farthest apart; empty without a gap."""
        steps = sorted(self._counts)
        ends = np.cumsum([self._counts[step] for step in steps])
        usual = steps[int(np.searchsorted(ends, ends[-1] / 2))] if steps else Fraction(0)
        if self._widest < HOLE * usual or not self._widest:
            return ""
        own, other = number(float(self._widest)), number(float(usual))
        return (
            f"group {self._group!r}: expected samples at even distances, got two rows {own} s "
            f"apart, elsewhere {other} s. Give --dense to take rows as events, or watch this group "
            f"alone with --period {own}s if {own} s is its step."
        )
