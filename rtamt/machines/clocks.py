"""Clocks of temporal operators, counted from the values of their operands, sample by sample.

A clock knows the values of its operands, delayed by some samples, and whether its operator is
required at an instant; `rtamt.internal.OperatorClocks` describes the counts.

To add the clock of an operator: its class here, and the same clock in
``rtamt/native/batch/clocks.cpp``. `rtamt_gym.judging.obligations` describes the rest.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from math import copysign
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.arrays import Floats
from rtamt.inputs.batch import Entries, numbers_of
from rtamt.machines.state import StateFields

ClockKind = Literal["oldest", "newest", "last"]
"""The start of the count."""

ClockEvent = Literal["holds", "fails", "until", "unless", "since"]
"""The end of the count: the only operand holds or fails, or an operator of two operands."""


class OperatorClock(NamedTuple):
    """The clock of a temporal operator, over parts whose values are fed.

    Attributes:
        kind: The start of the count.
        event: The effect of its operands.
        begin: The first sample of the window, from an instant to the newest known values.
        end: The last; None if the window has no end.
        late: The age of the newest known values, in samples.
        operands: For each operand its part, and the samples for which it waits for the others.
        asked: The part that holds where the operator is required; None: see ``first``.
        first: Whether it is required only at the first sample; otherwise, at every one.
    """

    kind: ClockKind
    event: ClockEvent
    begin: int
    end: int | None
    late: int
    operands: tuple[tuple[int, int], ...]
    asked: int | None = None
    first: bool = False


class PythonClockBatch(StateFields):
    """Clocks over the same parts, in batch entries with their own time."""

    STATE = ("_entries",)

    def __init__(self, rows: Sequence[OperatorClock], _parts: int, num: int) -> None:
        self._entries = [_Entry(rows) for _ in range(num)]

    @property
    def samples(self) -> NDArray[np.int64]:
        return np.array([entry.samples for entry in self._entries], dtype=np.int64)

    def feed(self, values: Floats, mask: Entries | None = None) -> None:
        columns = values.T.tolist()
        for entry in numbers_of(mask, len(self._entries)):
            self._entries[entry].feed(columns[entry])

    def reset(self, mask: Entries | None = None) -> None:
        for entry in numbers_of(mask, len(self._entries)):
            self._entries[entry].reset()

    @property
    def fractions(self) -> Floats:
        return _rows([entry.fractions() for entry in self._entries])

    @property
    def margins(self) -> Floats:
        return _rows([entry.margins() for entry in self._entries])


def _rows(columns: list[list[float]]) -> Floats:
    return np.ascontiguousarray(np.array(columns, dtype=np.float64).T)


class _Entry(StateFields):
    """The clocks of one batch entry."""

    STATE = ("samples", "_clocks")

    def __init__(self, rows: Sequence[OperatorClock]) -> None:
        self.samples = 0
        self._clocks = [_CLOCKS[row.kind](row) for row in rows]

    def reset(self) -> None:
        self.samples = 0
        for clock in self._clocks:
            clock.reset()

    def feed(self, parts: Sequence[float]) -> None:
        for clock in self._clocks:
            clock.feed(parts, self.samples)
        self.samples += 1

    def fractions(self) -> list[float]:
        return [clock.fraction() for clock in self._clocks]

    def margins(self) -> list[float]:
        values = [value for clock in self._clocks for value in clock.values]
        return [0.0 if math.isnan(value) else value for value in values]


class _Clock(StateFields):
    """A clock, with the newest matching values of its operands; nan before there are any."""

    STATE: ClassVar[tuple[str, ...]] = ("values", "_count", "_waiting")

    def __init__(self, row: OperatorClock) -> None:
        self._row = row
        self._start: float = 0
        self._count: float = 0
        self._waiting = [deque([math.nan] * waits) for _, waits in row.operands]
        self.values = [math.nan] * len(row.operands)

    def reset(self) -> None:
        self._count = self._start
        self._waiting = [deque([math.nan] * waits) for _, waits in self._row.operands]
        self.values = [math.nan] * len(self.values)

    def feed(self, parts: Sequence[float], samples: int) -> None:
        """Update with the newest values of the parts, after this number of samples."""
        for index, (part, _) in enumerate(self._row.operands):
            self._waiting[index].append(parts[part])
            self.values[index] = self._waiting[index].popleft()
        self._step(self._is_asked(parts, samples), samples)

    def fraction(self) -> float:
        """Return the clock, from 0 to 1."""
        raise NotImplementedError

    def _step(self, asked: bool, samples: int) -> None:  # noqa: FBT001 - of an instant
        raise NotImplementedError

    def _is_asked(self, parts: Sequence[float], samples: int) -> bool:
        if self._row.asked is not None:
            return copysign(1.0, parts[self._row.asked]) > 0.0
        return not self._row.first or samples == 0

    def _holds(self, operand: int) -> bool:
        value = self.values[operand]
        return value >= 0.0 and copysign(1.0, value) > 0.0

    def _fails(self, operand: int) -> bool:
        value = self.values[operand]
        return value <= 0.0 and copysign(1.0, value) < 0.0

    def _happens(self, operand: int) -> bool:
        return self._fails(operand) if self._row.event == "fails" else self._holds(operand)


class _Oldest(_Clock):
    """Counts the instants from the oldest pending one to now, both included; 0 if none is."""

    STATE = (*_Clock.STATE, "_shown", "_recent")

    def __init__(self, row: OperatorClock) -> None:
        super().__init__(row)
        self._full = row.begin + 2 if row.end is None else row.end + 1
        self._most = row.begin + 1 if row.end is None else self._full
        self._shown: float = 0
        # Whether it was required at each of the last instants.
        self._recent: deque[bool] = deque(maxlen=max(row.begin, row.late))

    def reset(self) -> None:
        super().reset()
        self._shown = 0
        self._recent.clear()

    def fraction(self) -> float:
        return self._shown / self._full

    def _step(self, asked: bool, samples: int) -> None:  # noqa: ARG002, FBT001
        before = self._count
        self._recent.append(asked)
        count = min(before + 1, self._most) if before > 0 else int(asked)
        if len(self.values) == 1:
            count = shown = self._ended(self._happens(0), self._row.begin, count)
        else:
            count, shown = self._of_two(count)
        if self._row.first and before >= self._full:
            count = shown = self._full
        self._count, self._shown = count, shown

    def _of_two(self, count: float) -> tuple[float, float]:
        """Return the new counts of ``until`` and ``unless``, internal and shown."""
        row, reached, failed = self._row, self._holds(1), self._fails(0)
        if row.event == "until":
            count = self._ended(reached, row.begin, count)
            done = failed and count > row.late
            left = self._ended(failed, row.late, count)
            shown = self._full if done else count
        else:
            done = reached and count > row.begin
            left = self._ended(failed, row.late, count)
            shown = self._full if done else left
        return self._full if done and row.first else left, shown

    def _ended(self, event: bool, last: int, count: float) -> float:  # noqa: FBT001
        """Return the count after an event that ends everything older than ``last`` instants."""
        if not event or count <= last:
            return count
        if last == 0 or self._row.first:
            return 0
        asked = list(self._recent)[-last:]
        return next((len(asked) - index for index, is_asked in enumerate(asked) if is_asked), 0)


class _Newest(_Clock):
    """Counts the instants after the newest required one; infinity while none is pending."""

    def __init__(self, row: OperatorClock) -> None:
        super().__init__(row)
        self._start = self._count = math.inf

    def fraction(self) -> float:
        end = self._row.end
        if end is None:
            return float(self._count < math.inf)
        return max(end - self._count, 0.0) / max(end, 1)

    def _step(self, asked: bool, samples: int) -> None:  # noqa: ARG002, FBT001
        row, age = self._row, 0.0 if asked else self._count + 1.0
        if (row.event == "until" and self._fails(0) and age >= row.late) or (
            row.event == "unless" and self._holds(1) and age >= row.begin
        ):
            age = math.inf
        self._count = age


class _Last(_Clock):
    """Counts the samples since the operand of the past last held, or failed."""

    def __init__(self, row: OperatorClock) -> None:
        super().__init__(row)
        self._start = self._count = 1 if row.end is None else row.end + 1

    def fraction(self) -> float:
        return self._count / self._start

    def _step(self, asked: bool, samples: int) -> None:  # noqa: ARG002, FBT001
        row = self._row
        if self._happens(len(self.values) - 1):
            self._count = 0
        elif samples < row.late or (row.event == "since" and self._fails(0)):
            self._count = self._start
        elif row.end is not None:
            self._count = min(self._count + 1, self._start)


_CLOCKS: dict[ClockKind, Any] = {"oldest": _Oldest, "newest": _Newest, "last": _Last}
