"""The note on times that a stated period ignores."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np

from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.stated_period import AsideTimes

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
