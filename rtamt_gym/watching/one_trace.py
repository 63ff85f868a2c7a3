"""Checks that the rows of a stream belong to one object or episode."""

from __future__ import annotations

from itertools import takewhile
from typing import Final, Protocol

import numpy as np

from rtamt.columns import are_flags, count_restart, flagged_row, names_objects, next_episode
from rtamt_gym.recorded.cells import floats_in
from rtamt_gym.recorded.roles import has_footer
from rtamt_gym.watching.rows import ColumnCells, RowFault, cell_text

_KEYS: Final = 10_000
"""Different values of a column after which it does not tell objects: it counts rows."""


_MOST: Final = 1_000_000
"""The most values of a column of numbers of rows that are kept."""

_FEW, _FALLS = 64, 32
"""The rows after which, and the falls up to which, numbers of rows are checked again at once."""


class Guard(Protocol):
    """Checks one column of a stream, as `objects_in` does in a file."""

    name: str

    def check(self, cells: ColumnCells) -> None:
        """Take in the cells of a block; raise RowFault at the row that shows another trace."""

    def finish(self) -> str:
        """Return the fault that the end of the stream shows; empty without one."""


def guards_of(name: str, *, texts: bool, timed: bool, first: bool) -> list[Guard]:
    """Return the checks of a column that no requirement reads.

    Args:
        name: The column.
        texts: Whether it holds texts.
        timed: Whether the stream has times; without them, numbers of rows may start again.
        first: Whether it is the first column.
    """
    if flagged_row(name):
        return [FlagGuard(name, timed=timed)]
    guards: list[Guard] = [ObjectGuard(name, texts=texts)]
    return guards if timed else [*guards, CountGuard(name, first=first)]


def _another_trace(name: str) -> str:
    return (
        f"expected one trace, but '{name}' shows that another one has started. Cut the stream "
        "there, or give --one-trace if all rows are one trace."
    )


class FlagGuard:
    """Notices a row after the last row of an episode, or a second first row.

    Args:
        name: The column of flags.
        timed: Whether the stream has times.
    """

    def __init__(self, name: str, *, timed: bool) -> None:
        self.name, self._timed = name, timed
        self._last: list[str] = []
        self._flags = True

    def check(self, cells: ColumnCells) -> None:
        """Take in the cells of a block."""
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

    def finish(self) -> str:
        """Return no fault: every row has been checked."""
        return ""


class CountGuard:
    """Notices that times or numbers of rows start again, and a last row of totals.

    Args:
        name: The column.
        first: Whether it is the first column.
    """

    def __init__(self, name: str, *, first: bool) -> None:
        self.name, self._first = name, first
        self._values: list[float] = []
        self._counts = True
        self._checked = self._falls = 0
        self._footer = False

    def check(self, cells: ColumnCells) -> None:
        """Take in the cells of a block."""
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
            row = self._restart()
            if row is not None:
                raise RowFault(max(row - before, 0), _another_trace(self.name), skippable=False)
        if count > 2 * _MOST:
            del self._values[1:-_MOST]

    def _restart(self) -> int | None:
        return count_restart(self.name, np.array(self._values), first=self._first)

    def finish(self) -> str:
        """Return the fault that the end of the stream shows; empty without one."""
        if not self._counts:
            return ""
        if self._footer:
            if self._first and has_footer(np.array([*self._values, np.nan])):
                return (
                    f"expected samples, but the last row has no number in '{self.name}', as a row "
                    "of totals. Remove it, or give --one-trace if it is a sample."
                )
            return ""
        return _another_trace(self.name) if self._falls and self._restart() is not None else ""


class ObjectGuard:
    """Notices that a column tells several objects or episodes.

    Args:
        name: The column.
        texts: Whether it holds texts.
    """

    def __init__(self, name: str, *, texts: bool) -> None:
        self.name, self._texts = name, texts
        self._named = names_objects(name) or (texts and names_objects(name, texts=True))
        self._values: set[str] = set()
        self._repeats = False

    def check(self, cells: ColumnCells) -> None:
        """Take in the cells of a block.

        Raises:
            RowFault: At the row that shows another object.
        """
        if not self._named or len(self._values) > _KEYS:
            return
        different = set(map(cell_text, cells))
        if len(different) == 1 and different <= self._values:
            self._repeats = True
            return
        for row, cell in enumerate(cells):
            try:
                self.try_next(cell)
            except RowFault as fault:
                raise RowFault(row, fault.reason, skippable=False) from None

    def try_next(self, cell: object) -> None:
        """Take in one cell."""
        value = cell_text(cell).strip()
        if not self._named or not value:
            return
        if value in self._values:
            self._repeats = True
        elif len(self._values) <= _KEYS:
            self._values.add(value)
        if self._repeats and 1 < len(self._values) <= _KEYS:
            raise RowFault(
                0,
                f"expected one trace, but '{self.name}', which no requirement reads, has several "
                f"values, the last of which is {value!r}. Give --by {self.name} to judge each by "
                "itself, or --one-trace if all rows are one trace.",
                skippable=False,
            )

    def finish(self) -> str:
        """Return no fault: every row has been checked."""
        return ""
