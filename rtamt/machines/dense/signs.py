"""Where a formula fails or holds for certain, on a whole trace in dense time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.event_reader import EventReader
from rtamt.inputs.events import Given
from rtamt.machines.dense.outlook import recorded
from rtamt.machines.dense.rows import FindBoth, rows_between
from rtamt.machines.protocols import End
from rtamt.machines.ranges import term_ranges
from rtamt.machines.terms import term_columns
from rtamt.program.dense_regions import RegionProgram
from rtamt.program.implications import Counted, InstantRuns

__all__ = ["PythonDenseSigns"]


class PythonDenseSigns:
    """The signs of a formula, for certain, at the positions of a whole trace.

    Args:
        regions: The program.
        reader: Counts the times of its variables.
        given: The events of its variables, which a machine has taken in before.
        trace: The first and the last tick of the trace.
        end: The reading of the end.
        terms: Evaluates terms.
    """

    def __init__(
        self,
        regions: RegionProgram,
        reader: EventReader,
        given: Sequence[Given],
        trace: tuple[int, int],
        end: End,
        terms: FindBoth = (term_columns, term_ranges),
    ) -> None:
        counted = reader.counted(given, [-np.inf] * len(given), None)
        rows = rows_between(regions, counted, trace, reader, terms)
        self._last = 2 * (trace[1] - trace[0])
        self._least, self._greatest = recorded(regions.program, rows, self._last, end)

    def fails_at(self, instants: InstantRuns) -> Counted:
        fails = _Spans.of(np.signbit(self._greatest.last), self._greatest.starts, self._last)
        begins, ends = fails.within(instants)
        ticks = int(np.sum((ends + 1) // 2 - begins // 2))  # the odd positions
        return ticks, len(begins), int(begins[0]) if len(begins) else None

    def holds_at(self, instants: InstantRuns) -> bool:
        found = _Spans.of(~np.signbit(self._least.last), self._least.starts, self._last)
        return found.cover(instants, self._last)


class _Spans(NamedTuple):
    """Runs of instants, in order; of the recorded ones (`rtamt.program.implications`).

    Attributes:
        begins: The first one of each run.
        ends: The last one.
    """

    begins: NDArray[np.int64]
    ends: NDArray[np.int64]

    @classmethod
    def of(cls, true: NDArray[np.bool_], starts: NDArray[np.int64] | None, last: int) -> _Spans:
        """The runs at which something is so.

        Args:
            true: Whether it is so, for each of the runs that begin at ``starts``.
            starts: In order; None: at each instant from 0 on.
            last: The last instant.
        """
        changes = np.flatnonzero(true[1:] != true[:-1]) + 1
        if true[0]:
            changes = np.concatenate([np.zeros(1, np.int64), changes])
        places = changes if starts is None else starts[changes]
        begins, after = places[::2], places[1::2]
        if len(after) < len(begins):
            after = np.append(after, last + 1)
        return cls(begins, after - 1)

    def within(self, instants: InstantRuns) -> _Spans:
        """The parts of the runs that lie in others."""
        if not len(self.begins):
            return self
        if len(instants) == 1:
            ((first, final),) = instants
            if first <= self.begins[0] and self.ends[-1] <= final:
                return self
        begins, ends = [], []
        for first, final in instants:
            low = int(np.searchsorted(self.ends, first))
            high = int(np.searchsorted(self.begins, final, "right"))
            begins.append(np.maximum(self.begins[low:high], first))
            ends.append(np.minimum(self.ends[low:high], final).astype(np.int64))
        if not begins:
            return _Spans(self.begins[:0], self.ends[:0])
        return _Spans(np.concatenate(begins), np.concatenate(ends))

    def cover(self, instants: InstantRuns, last: int) -> bool:
        """Whether all of some instants are in them, and none is after the last recorded one."""
        if instants and instants[-1][1] > last:
            return False
        found = self.within(instants)
        length = int(np.sum(found.ends - found.begins + 1))
        return length == sum(int(final) - first + 1 for first, final in instants)
