"""Rows that ``--where`` selects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import nearest, shown
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.recording import Rows
from rtamt_gym.tables import counted

__all__ = ["RowFilter", "cell_texts", "selection_notes"]


class RowFilter:
    """The rows in which some columns have the texts that ``--where`` names.

    Args:
        where: The text of each column.
        names: The columns of the file.
        source: The name of the file, for messages.

    Raises:
        InputError: If a column does not exist.
    """

    def __init__(self, where: Mapping[str, str], names: Sequence[str], source: str) -> None:
        for name in where:
            if name not in names:
                raise InputError(
                    f"{source}: no column '{name}', which --where names; the columns are "
                    f"{listed(names, name)}{nearest(name, names)}"
                )
        self._where, self._source = where, source
        self._values: dict[str, dict[str, None]] = {name: {} for name in where}
        self._kept = 0

    def mask(self, cells: Mapping[str, Sequence[str]]) -> NDArray[np.bool_]:
        """Return whether each row is selected.

        Args:
            cells: The texts in the columns that ``--where`` names.
        """
        columns = {name: [text.strip() for text in cells[name]] for name in self._where}
        kept = np.ones(len(next(iter(columns.values()))), bool)
        for name, texts in columns.items():
            self._values[name] |= dict.fromkeys(texts)
            kept &= np.fromiter((text == self._where[name] for text in texts), bool, len(texts))
        self._kept += int(kept.sum())
        return kept

    def check(self) -> None:
        """Check that a row was selected.

        Raises:
            InputError: If there was none. The message lists the values of the columns.
        """
        if self._kept:
            return
        for name, value in self._where.items():
            values = [shown(each) for each in self._values[name]]
            if values and value not in self._values[name]:
                raise InputError(
                    f"{self._source}: no row with {value!r} in the column '{name}', which --where "
                    f"names; its values are {listed(values, value)}{nearest(value, values)}"
                )
        rows = " and ".join(f"{name}={value}" for name, value in self._where.items())
        raise InputError(f"{self._source}: no row with {rows}, which --where selects")


def cell_texts(values: NDArray[Any]) -> list[str]:
    """Return the texts of cells that are not texts in the file: 1 and 1.0 are ``1``.

    Example:
        >>> cell_texts(np.array([1.0, 0.5, np.nan])), cell_texts(np.array([True]))
        (['1', '0.5', ''], ['true'])
    """
    return [_text(value) for value in values.tolist()]


def _text(value: object) -> str:
    if value is None or value != value:  # noqa: PLR0124 - nan
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and value.is_integer():
        return str(int(value))
    return str(value)


def selection_notes(rows: Rows, where: Mapping[str, str]) -> list[str]:
    """Return a note about the rows that were selected; an empty list if all were read."""
    if not where:
        return []
    texts = " and ".join(f"{name}={value}" for name, value in where.items())
    return [f"--where {texts} selects {counted(rows.count, 'row')}"]
