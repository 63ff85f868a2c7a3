"""The dates of a stream: their form and their order of day and month, row by row."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Final

from rtamt_gym.recorded.cells import read_dates
from rtamt_gym.recorded.columns import DateOrder
from rtamt_gym.watching.rows import ColumnCells, RowFault

_NO_ORDER: Final = re.compile(r"\d{1,2}([/-])\d{1,2}\1\d{4}", re.ASCII)
"""The start of a date with the day or the month first."""


class StreamDates:
    """The first date of a stream, and the order of day and month that the rows so far show.

    All rows of a file can decide the order. A stream refuses the first row if its distance to the
    first date depends on the order, regardless of the number of rows that arrive together.

    Attributes:
        first: The first cell of times, and its day if it is a time of day; None before it.
        dated: Whether it is a date, a time of day or a duration, not a number.

    Example:
        >>> StreamDates().order("time", ["13/04/2024", "01/05/2024"], None)
        'dmy'
        >>> StreamDates().order("time", ["2024-05-01"], None)
    """

    def __init__(self) -> None:
        self.first: tuple[Any, str] | None = None
        self.dated = False
        self._begin: str | None = None
        self._order: DateOrder | None = None
        self._sure = False
        self._texts: bool | None = None

    def check_kind(self, column: str, cells: ColumnCells) -> None:
        """Check that times in JSON are all texts or all numbers, as in the first row.

        Raises:
            RowFault: At the first row with another kind.
        """
        if self._texts is not None and {*map(type, cells)} <= (
            {str} if self._texts else {int, float}
        ):
            return
        for row, cell in enumerate(cells):
            if not isinstance(cell, str | int | float) or isinstance(cell, bool):
                return  # not a time
            texts = isinstance(cell, str)
            if self._texts is None:
                self._texts = texts
            elif texts != self._texts:
                expected, kind = ("a text", "a number") if self._texts else ("a number", "a text")
                raise RowFault(
                    row,
                    f"column '{column}': expected {expected}, as in the first row, got {cell!r}, "
                    f"{kind}",
                )

    def order(
        self, column: str, cells: ColumnCells, days: Sequence[str] | None
    ) -> DateOrder | None:
        """Return the order of day and month; None if it does not matter for the rows so far.

        Args:
            column: The column of times, for messages.
            cells: Its cells in a block.
            days: The dates of times of day; None for other times.

        Raises:
            RowFault: At the first row in which the order matters and is not certain.
        """
        for row, cell in enumerate(cells if days is None else days):
            if self._sure:
                break
            text = cell.strip() if isinstance(cell, str) else ""
            if not _NO_ORDER.match(text):
                self._sure = self._begin is None  # the first row has another form
                break
            self._take(column, row, text.split()[0].rstrip(","))
        return self._order

    def _take(self, column: str, row: int, text: str) -> None:
        """Compare the day of a row with the first day."""
        date = _NO_ORDER.match(text)
        day = text if date is None else date[0]
        begin = self._begin or day
        orders: tuple[DateOrder, DateOrder] = ("dmy", "mdy")
        readings = {order: read_dates([begin, day], order) for order in orders}
        possible = {order: dates for order, dates in readings.items() if dates is not None}
        self._begin = begin
        if len(possible) == 1:
            (self._order,) = possible
            self._sure = True
        elif len({int((dates[1] - dates[0]).astype(int)) for dates in possible.values()}) > 1:
            raise RowFault(
                row,
                f"column '{column}': the date {day!r} may have the day or the month first; give "
                "--date-order dmy or --date-order mdy",
                skippable=False,
            )
