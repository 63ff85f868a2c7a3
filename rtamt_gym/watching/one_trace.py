"""Checks that the rows of a stream belong to one object or episode."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import islice, takewhile
from typing import Any, Final, NamedTuple

import numpy as np

from rtamt.columns import (
    are_flags,
    count_restart,
    flagged_row,
    may_tell_objects,
    names_objects,
    next_episode,
    objects_by_turns,
    tells_objects,
    turns_in,
)
from rtamt_gym.recorded.cells import floats_in
from rtamt_gym.recorded.recording import RawTimes
from rtamt_gym.recorded.roles import are_even, has_footer, names_totals, only_last_totals
from rtamt_gym.watching.clock import plain_times
from rtamt_gym.watching.rows import ColumnCells, RowFault, cell_text

_KEYS: Final = 10_000
"""The number of different values from which on a column counts rows, not objects."""


_MOST: Final = 1_000_000
"""The maximum number of stored values of a column of row numbers."""

_FEW, _FALLS = 64, 32
"""The rows after which, and the falls up to which, numbers of rows are checked again at once."""


class Guard:
    """Checks one column of a stream, as `objects_in` does in a file."""

    def __init__(self, name: str) -> None:
        self.name = name

    def check(self, cells: ColumnCells, times: RawTimes | None) -> None:
        """Take in the cells of a block and its times; raise RowFault at a row of another trace."""
        raise NotImplementedError

    def finish(self, *, early: bool, beyond: int = 0) -> str:
        """Return the fault that the rows so far show; empty without one.

        Args:
            early: Whether ``--stop`` has ended the stream, so that its last row is not known.
            beyond: The number of rows after the stop, which do not count.
        """
        del early, beyond
        return ""


class GuardedColumn(NamedTuple):
    """A column that no requirement reads, and that may show several traces.

    Attributes:
        name: Its name.
        read: The columns that requirements read.
        texts: Whether it holds texts.
        timed: Whether the stream has times; without them, numbers of rows may start again.
        first: Whether it is the first column.
        uneven: Whether times may be at uneven distances.
        totals: Whether its last cell may be the name of a row of totals.
    """

    name: str
    read: Collection[str]
    texts: bool
    timed: bool
    first: bool
    uneven: bool
    totals: bool = False

    def guards(self) -> list[Guard]:
        """Return the checks of the column in a trace."""
        name, read = self.name, self.read
        if flagged_row(name):
            return [FlagGuard(name, timed=self.timed)]
        guards: list[Guard] = [TotalsGuard(name)] if self.totals else []
        guards.append(ObjectGuard(name, read, texts=self.texts))
        if not self.timed:
            return [*guards, CountGuard(name, first=self.first)]
        if self.texts:
            return [*guards, OrderGuard(name, read)]
        return [*guards, TurnGuard(name)] if self.uneven else guards


def _another_trace(name: str) -> str:
    return (
        f"expected one trace, but '{name}' shows that another one has started. Cut the stream "
        "there, or give --one-trace if all rows are one trace."
    )


class FlagGuard(Guard):
    """Notices a row after the last row of an episode, or a second first row."""

    def __init__(self, name: str, *, timed: bool) -> None:
        super().__init__(name)
        self._timed = timed
        self._last: list[str] = []
        self._flags = True

    def check(self, cells: ColumnCells, times: RawTimes | None) -> None:
        """Take in the cells of a block."""
        del times
        if not self._flags:
            return
        texts = [cell_text(cell).strip().lower() for cell in cells]
        if not are_flags(texts):
            self._flags = False
            texts = [*takewhile(lambda text: are_flags([text]), texts)]
        before = len(self._last)
        row = next_episode(self.name, np.array([*self._last, *texts]), timed=self._timed)
        if row is not None:
            raise RowFault(row - before, _another_trace(self.name), skippable=False)
        self._last = texts[-1:]


class CountGuard(Guard):
    """Notices that times or numbers of rows start again, and a last row of totals."""

    def __init__(self, name: str, *, first: bool) -> None:
        super().__init__(name)
        self._first = first
        self._values: list[float] = []
        self._counts = True
        self._checked = self._falls = 0
        self._footer = False

    def check(self, cells: ColumnCells, times: RawTimes | None) -> None:
        """Take in the cells of a block."""
        del times
        if self._footer:
            self._counts = False
        if not self._counts:
            return
        texts = list(map(cell_text, cells))
        values = floats_in(texts, gaps=True)
        if values is None or not np.isfinite(values).all():
            values = floats_in(texts[:-1], gaps=True)
            self._footer = values is not None and bool(np.isfinite(values).all())
            self._counts = self._footer
            if values is None or not self._counts:
                return
        before = len(self._values)
        self._values += values.tolist()
        start = max(before - 1, 0)
        falls = int((np.diff(self._values[start:]) < 0).sum())
        self._falls += falls
        count = len(self._values)
        soon = count <= _FEW or (falls and self._falls <= _FALLS)
        if self._falls and (soon or count >= 2 * self._checked):
            self._checked = count
            row = self._restart(count)
            if row is not None:
                raise RowFault(max(row - before, 0), _another_trace(self.name), skippable=False)
        if count > 2 * _MOST:
            del self._values[1:-_MOST]

    def _restart(self, count: int) -> int | None:
        return count_restart(self.name, np.array(self._values[:count]), first=self._first)

    def finish(self, *, early: bool, beyond: int = 0) -> str:
        """Return the fault that the rows so far show; empty without one."""
        if not self._counts:
            return ""
        if self._footer:
            if not early and self._first and has_footer(np.array([*self._values, np.nan])):
                return (
                    f"expected samples, but the last row has no number in '{self.name}', as a row "
                    "of totals. Remove it, or give --one-trace if it is a sample."
                )
            return ""
        count = len(self._values) - beyond
        return _another_trace(self.name) if self._falls and self._restart(count) is not None else ""


def totals_fault(name: str, text: str) -> str:
    """Return the fault of a last row that a cell calls a row of totals."""
    return (
        f"expected a sample, but {text!r} in '{name}' of the last row names a row of totals. "
        "Remove it, or give --one-trace if it is a sample."
    )


class TotalsGuard(Guard):
    """Notices a last row that a column of texts calls a row of totals."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._last, self._words = "", set[str]()
        self._numbers = True
        """Whether all cells but the last are numbers or empty."""

    def check(self, cells: ColumnCells, times: RawTimes | None) -> None:
        """Take in the cells of a block."""
        del times
        others = {self._last, *map(cell_text, cells[:-1])}
        self._last = cell_text(cells[-1]).strip()
        others = {text.strip() for text in others} - {"", "nan"}
        self._words |= {text for text in others if names_totals(text)}
        self._numbers = self._numbers and floats_in([*others]) is not None

    def finish(self, *, early: bool, beyond: int = 0) -> str:
        """Return the fault that the rows so far show; empty without one."""
        del beyond
        last = self._last
        if early or not names_totals(last) or last in self._words:
            return ""
        others = [] if self._numbers else ["a text"]
        return totals_fault(self.name, last) if only_last_totals(["", *others, last]) else ""


def _several_values(row: int, name: str, value: str) -> RowFault:
    return RowFault(
        row,
        f"expected one trace, but '{name}', which no requirement reads, has several values, the "
        f"last of which is {value!r}. Give --by {name} to judge each by itself, or --one-trace if "
        "all rows are one trace.",
        skippable=False,
    )


class ObjectGuard(Guard):
    """Notices that a column names several objects or episodes."""

    def __init__(self, name: str, read: Collection[str], *, texts: bool) -> None:
        super().__init__(name)
        self._read, self._texts = read, texts
        self._certain = names_objects(name) or (texts and names_objects(name, texts=True))
        self._named = self._certain or may_tell_objects(name, read, timed=True)
        self._values: dict[str, None] = {}
        self._repeats = False

    def check(self, cells: ColumnCells, times: RawTimes | None) -> None:
        """Take in the cells of a block."""
        del times
        if not self._named or len(self._values) > _KEYS:
            return
        different = {cell_text(cell).strip() for cell in cells}
        known = len(different) == 1 and different <= self._values.keys()
        if known and (self._repeats or len(self._values) == 1):
            self._repeats = True
            return
        for row, cell in enumerate(cells):
            value = cell_text(cell).strip()
            if value and self._shows_another(value):
                raise _several_values(row, self.name, value)

    def _shows_another(self, value: str) -> bool:
        """Take in one value; return whether it shows another object."""
        if value in self._values:
            if self._repeats:
                return False
            self._repeats = True
        else:
            self._values[value] = None
        return self._repeats and 1 < len(self._values) <= _KEYS and self._tells()

    def _tells(self) -> bool:
        if self._certain:
            return True
        texts = [*islice(self._values, _SHOWN)]
        numbers = None if self._texts else floats_in(texts)
        return tells_objects(self.name, np.array(texts if numbers is None else numbers), self._read)


_SHOWN: Final = 16
"""The values of a column that show whether they are flags."""


_EARLY: Final = 64
"""The rows after which an order is checked first; again at twice as many each, and at the end."""


class TurnGuard(Guard):
    """Notices whole numbers that take turns at uneven times, as numbers of interleaved objects do.

    The order of all rows so far is checked at numbers of rows that double.
    """

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._cells: list[Any] = []
        self._times: list[RawTimes] = []
        self._next, self._ordered = _EARLY, True

    def check(self, cells: ColumnCells, times: RawTimes | None) -> None:
        """Take in the cells of a block and its times."""
        if times is None or not self._ordered or len(self._cells) > _KEYS:
            return
        values = self._values(list(map(cell_text, cells)))
        if values is None:
            self._ordered = False
            self._cells, self._times = [], []
            return
        before = len(self._cells)
        self._cells += values
        self._times.append(plain_times(times))
        while self._next <= len(self._cells):
            count, self._next = self._next, 2 * self._next
            if self._shows_objects(count):
                raise self._fault(count, max(count - 1 - before, 0))

    def finish(self, *, early: bool, beyond: int = 0) -> str:
        """Return the fault that the rows so far show; empty without one."""
        del early
        count = len(self._cells) - beyond
        shows = 0 < count <= _KEYS and self._shows_objects(count)
        return self._fault(count, 0).reason if shows else ""

    def _shows_objects(self, count: int) -> bool:
        """Return whether the first rows show objects in turns."""
        times = np.concatenate(self._times)[:count]
        if are_even(times) or not (times[1:] > times[:-1]).all():
            return False
        turns = turns_in(times)
        values = np.array(self._cells[:count])
        return bool(turns) and objects_by_turns({self.name: values}, turns) is not None

    def _values(self, texts: Sequence[str]) -> list[Any] | None:
        """Return the cells to compare; None if the column does not number objects."""
        values = floats_in(texts, gaps=True)
        return None if values is None else list(values)

    def _fault(self, count: int, row: int) -> RowFault:
        return _several_values(row, self.name, f"{self._cells[count - 1]:.0f}")


class OrderGuard(TurnGuard):
    """Notices texts that alternate at uneven times, as names of interleaved objects do."""

    def __init__(self, name: str, read: Collection[str]) -> None:
        super().__init__(name)
        self._read = read

    def _shows_objects(self, count: int) -> bool:
        if not tells_objects(self.name, np.array(self._cells[:count]), self._read):
            return False
        return not are_even(np.concatenate(self._times)[:count])

    def _values(self, texts: Sequence[str]) -> list[Any]:
        return [text.strip() for text in texts]

    def _fault(self, count: int, row: int) -> RowFault:
        return _several_values(row, self.name, self._cells[count - 1])
