"""Checks that the rows of a stream belong to one object or episode."""

from __future__ import annotations

from typing import Final

from rtamt.columns import names_objects
from rtamt_gym.watching.rows import ColumnCells, RowFault, cell_text

_KEYS: Final = 10_000
"""Different values of a column after which it does not tell objects: it counts rows."""


class Guard:
    """Notices that a column tells several objects or episodes, as `objects_in` does in a file.

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
