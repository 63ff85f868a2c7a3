"""The names of the groups of a stream."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Final

from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.parts import group_name
from rtamt_gym.recorded.recording import whole_number
from rtamt_gym.watching.rows import ColumnCells, RowBlock, RowFault, cell_text

_KINDS: Final[Mapping[type, str]] = {
    str: "a text",
    bool: "a truth value",
    int: "a number",
    float: "a number",
}
"""The kinds of values in JSON; null is of any kind."""


class GroupNames:
    """Reads the names of groups from the columns of ``--by``.

    The name of a group is the text of its column, or of several columns ``car=7,lap=2``.

    Args:
        by: The columns.

    Example:
        >>> block = RowBlock([2, 3], {"car": ["7", "8"], "lap": ["2", "2"]})
        >>> GroupNames(["car"]).of(block), GroupNames(["car", "lap"]).of(block)
        (['7', '8'], ['car=7,lap=2', 'car=8,lap=2'])
    """

    def __init__(self, by: Sequence[str]) -> None:
        self._by = by
        self._kinds: dict[str, str] = {}
        self._names: dict[tuple[str, ...], str] = {}
        self._texts: dict[str, set[str]] = {}
        self._numbers: dict[tuple[str, str], str] = {}
        """The first text of each number in each column."""

    def check(self, source: str, names: Sequence[str], times: Sequence[str]) -> None:
        """Check that a stream has the columns, and that they are not its times."""
        for column in self._by:
            if column in times:
                raise InputError(
                    f"{source}: expected a column of objects for --by, got '{column}', the times "
                    "of the rows"
                )
            if column not in names:
                raise InputError(
                    f"{source}: no column '{column}', which --by names; the columns are "
                    f"{listed(names, column)}{nearest(column, names)}"
                )

    def of(self, block: RowBlock) -> list[str]:
        """Return the name of the group of each row.

        Raises:
            RowFault: At the first row without a group.
        """
        faults, texts = list[RowFault](), []
        for column in self._by:
            cells = block.columns[column]
            try:
                self._check_kinds(column, cells)
            except RowFault as fault:
                faults.append(fault)
            texts.append([cell_text(cell).strip() for cell in cells])
            if "" in texts[-1]:
                row = texts[-1].index("")
                faults.append(RowFault(row, f"column '{column}': expected a group, got none"))
            faults += self._two_writings(column, texts[-1])
        if faults:
            raise min(faults, key=lambda fault: fault.row)
        if len(texts) == 1:
            return texts[0]
        return list(map(self._name, zip(*texts, strict=True)))

    def at(self, block: RowBlock, row: int) -> str | None:
        """Return the group of a bad row; None without groups, or if a cell is not a name."""
        texts = []
        for column in self._by:
            cell = block.columns[column][row]
            if _KINDS.get(type(cell), "") != self._kinds.get(column, ""):
                return None
            texts.append(cell_text(cell).strip())
        return self._name(tuple(texts)) if texts and all(texts) else None

    def _two_writings(self, column: str, texts: Sequence[str]) -> list[RowFault]:
        """Return the fault of a row that writes a number otherwise than a row before it."""
        known = self._texts.setdefault(column, set())
        for text in dict.fromkeys(texts):
            if text in known:
                continue
            whole = whole_number(text)
            other = self._numbers.get((column, whole), text)
            if other != text and whole in (other, text):
                return [
                    RowFault(
                        texts.index(text),
                        f"column '{column}': got '{text}' after '{other}', which may be one object "
                        "or two. Write the number in one way.",
                        skippable=False,
                    )
                ]
            self._numbers[column, whole] = other
            known.add(text)
        return []

    def _name(self, texts: tuple[str, ...]) -> str:
        if len(texts) == 1:
            return texts[0]
        if texts not in self._names:
            parts = dict(zip(self._by, texts, strict=True))
            self._names[texts] = group_name("", parts).removeprefix("[").removesuffix("]")
        return self._names[texts]

    def _check_kinds(self, column: str, cells: ColumnCells) -> None:
        """Check that the names of groups in JSON are of one kind, as 7 and "7" are not."""
        kinds, known = {_KINDS.get(type(cell), "") for cell in cells}, self._kinds.get(column, "")
        if kinds <= {"", known}:
            return
        for row, cell in enumerate(cells):
            kind = _KINDS.get(type(cell), "")
            known = known or kind
            if kind not in ("", known):
                raise RowFault(
                    row,
                    f"column '{column}': expected {known}, as in the first row, got "
                    f"{json.dumps(cell)}, {kind}. Write all names of groups as texts.",
                )
        self._kinds[column] = known
