"""The groups of a sorted Parquet file, for a file larger than memory.

Only the key columns are read at first, in parts. Each group is then read with its neighbours, from
the row groups of the file that hold them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.errors import no_such
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.parts import file_of, group_names
from rtamt_gym.recorded.readers import open_recording
from rtamt_gym.recorded.recording import RowFilter, Rows, Wanted, cell_texts, check_one_writing

PART_ROWS: Final = 1 << 20
"""The rows after which a part of a file ends with its group."""


class SortedGroups:
    """The places of the groups in a Parquet file.

    Args:
        file: The path of the file.
        columns: The column options; ``by`` names the key columns.

    Attributes:
        values: The keys of each group with their types, by the texts of the keys, in order.

    Raises:
        InputError: If the rows of a group do not follow each other, or have no key.
    """

    def __init__(self, file: str, columns: Columns) -> None:
        self._file, self._by = file, tuple(columns.by)
        self.values: dict[tuple[str, ...], dict[str, object]] = {}
        self._begins: dict[tuple[str, ...], int] = {}
        self._last: tuple[str, ...] | None = None
        self._end = 0
        self._steps: dict[str, float | None] = {}
        with open_recording(file, columns) as recording:
            self._source, names = recording.source, recording.names
        for name in self._by:
            if name not in names:
                raise InputError(f"{self._source}: {no_such('column', name, names)}")
        selection = RowFilter(columns.where, names, self._source)
        from rtamt_gym.recorded.arrow_reader import parquet_batches

        wanted = [*dict.fromkeys([*self._by, *columns.where])]
        for first, rows in parquet_batches(file, columns, wanted, PART_ROWS):
            for name in wanted:
                if name not in rows.cells:
                    raise InputError(f"{self._source}: expected numbers or texts in '{name}'")
            chosen = np.arange(rows.count)
            if columns.where:
                texts = {name: cell_texts(rows.cells[name]) for name in columns.where}
                (chosen,) = np.nonzero(selection.mask(texts))
            self._add(first, rows, chosen)
        if columns.where:
            selection.check()
        if not self.values:
            raise InputError(f"{self._source}: expected at least one row, got none")
        for i, name in enumerate(self._by):
            check_one_writing(self._source, name, {key[i] for key in self.values})
        self._spans = self._parts()

    def _add(self, first: int, rows: Rows, chosen: NDArray[np.intp]) -> None:
        """Add the selected rows of a part of the file."""
        if not len(chosen):
            return
        cells = [rows.cells[name][chosen] for name in self._by]
        for name, column in zip(self._by, cells, strict=True):
            empty = np.isnan(column) if column.dtype.kind == "f" else column == ""
            if np.any(empty):
                row = int(chosen[int(np.argmax(empty))])
                raise InputError(
                    f"{rows.where(row)}, column '{name}': expected a value of this --by column, "
                    "got an empty cell"
                )
        starts = np.append(0, np.flatnonzero(_changes(cells)) + 1)
        texts = zip(*(cell_texts(column[starts]) for column in cells), strict=True)
        typed = zip(*(column[starts].tolist() for column in cells), strict=True)
        for key, values, start in zip(texts, typed, chosen[starts].tolist(), strict=True):
            if key == self._last:
                continue
            if key in self.values:
                group = ", ".join(map("=".join, zip(self._by, key, strict=True)))
                raise InputError(
                    f"{rows.where(start)}: expected the rows of {group} to follow each other, as "
                    f"--sorted states, got one after other groups. Sort the file by "
                    f"{', '.join(self._by)}, or leave --sorted out to read it into memory."
                )
            self.values[key] = dict(zip(self._by, values, strict=True))
            self._begins[key], self._last = first + start, key
        self._end = first + int(chosen[-1]) + 1

    def _parts(self) -> dict[tuple[str, ...], tuple[int, int]]:
        """Return the rows of the part that holds each group."""
        spans: dict[tuple[str, ...], tuple[int, int]] = {}
        keys = [*self._begins]
        ends = [*list(self._begins.values())[1:], self._end]
        part: list[tuple[str, ...]] = []
        for key, end in zip(keys, ends, strict=True):
            part.append(key)
            begin = self._begins[part[0]]
            if end - begin >= PART_ROWS or key is keys[-1]:
                spans |= dict.fromkeys(part, (begin, end))
                part = []
        return spans

    def traces(self, chosen: Mapping[str, str]) -> Mapping[str, tuple[str, ...]]:
        """Return the keys of each group by the name of its trace.

        Args:
            chosen: The keys that select this table in its file.
        """
        return group_names(file_of(self._file), self._by, self.values, chosen)

    def usual_step(
        self, wanted: Wanted, step_in: Callable[[tuple[int, int], Wanted], float | None]
    ) -> float | None:
        """Return the smallest usual distance of times in the groups of all parts, or None.

        Args:
            wanted: The columns of times.
            step_in: Returns the distance in a part.
        """
        key = repr((wanted.time, wanted.part, wanted.where, wanted.date_order))
        if key not in self._steps:
            steps = [step_in(span, wanted) for span in dict.fromkeys(self._spans.values())]
            self._steps[key] = min((step for step in steps if step is not None), default=None)
        return self._steps[key]

    def span(self, keys: tuple[str, ...]) -> tuple[int, int] | None:
        """Return the rows of the part that holds a group; None without such a group."""
        return self._spans.get(keys)


def _changes(cells: Sequence[NDArray[Any]]) -> NDArray[np.bool_]:
    """Return whether each row after the first differs from the row before."""
    changes = np.zeros(len(cells[0]) - 1, bool)
    for column in cells:
        changes |= column[1:] != column[:-1]
    return changes
