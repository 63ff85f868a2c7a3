"""Reads long CSV files by pyarrow, and leaves what that does not read to others.

The columns are read as text, because the decimal mark of a file depends on how its numbers are
written; the conversion to numbers costs about a third of the time.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv

from rtamt_gym.recorded.arrow_columns import floats_of, is_time, raw_times_of
from rtamt_gym.recorded.cells import GROUP_MARKS, NOT_KNOWN, TRUTH, cells_in
from rtamt_gym.recorded.dates import RawTimes
from rtamt_gym.recorded.recording import Floats, Wanted
from rtamt_gym.recorded.selection import RowFilter

__all__ = ["CsvColumns", "Text", "read_text"]

_OTHER: Final = {".": ",", ",": "."}


@dataclass(frozen=True, slots=True)
class Text:
    """A file of text, and how it is read.

    Attributes:
        path: The file, which may be compressed.
        names: The names of its columns.
        width: The cells of each row; those beyond the names are empty.
        above: The lines above the first row of values.
        separator: The character between cells.
        decimal: The decimal mark to try.
        dates: The columns that hold dates.
    """

    path: str
    names: Sequence[str]
    width: int
    above: int
    separator: str
    decimal: str
    dates: Collection[str]


@dataclass(frozen=True, slots=True)
class CsvColumns:
    """The wanted columns of a text, as in `Rows`.

    Attributes:
        decimal: The decimal mark of the file.
        thousands: The longest cell of each column in which every number has three digits after the
            mark.
        rows: The row of the file for each row; None: all rows were read.
    """

    numbers: Mapping[str, Floats]
    texts: Mapping[str, Sequence[str]]
    count: int
    times: RawTimes | None
    decimal: str
    thousands: Mapping[str, str]
    cells: Mapping[str, NDArray[Any]]
    rows: NDArray[np.intp] | None


class _UnclearError(Exception):
    """The other reader has to look closer."""


def read_text(text: Text, wanted: Wanted, chosen: RowFilter, *, certain: bool) -> CsvColumns | None:
    """Read the wanted columns of a text, or return None if another reader has to look closer.

    That is so if a cell is wrong or is one that pyarrow does not read, and if the decimal mark is
    not certain.

    Args:
        text: The file.
        wanted: The columns.
        chosen: The rows that are read.
        certain: Whether the decimal mark is certain.

    Raises:
        InputError: If no row is chosen.
    """
    try:
        return _read(text, wanted, chosen, certain=certain)
    except _UnclearError:
        return None


def _read(text: Text, wanted: Wanted, chosen: RowFilter, *, certain: bool) -> CsvColumns:
    if wanted.part is not None:
        raise _UnclearError
    time = [] if wanted.time is None else [wanted.time]
    names = list(dict.fromkeys([*wanted.numbers, *wanted.texts, *time])) or text.names[:1]
    places = [text.names.index(name) for name in names]  # a name may come twice
    beyond = range(len(text.names), text.width)
    dated = [name for name in time if name in text.dates and name not in wanted.numbers]
    others = [name for name in dict.fromkeys([*wanted.cells, *wanted.where]) if name not in names]
    also = [*map(text.names.index, others)]
    table = _table(text, [*places, *also, *beyond], [*map(text.names.index, dated)])
    if any(_bytes(column).strip() for column in table.columns[len(names) + len(also) :]):
        raise _UnclearError
    columns = dict(zip([*names, *others], table.columns, strict=False))
    rows = None
    if wanted.where:
        if not set(dated).isdisjoint(wanted.where):
            raise _UnclearError
        kept = chosen.mask({name: _strings(columns[name]) for name in wanted.where})
        chosen.check()
        (rows,) = np.nonzero(kept)
    numbers, marked = {}, {}
    for name in dict.fromkeys([*wanted.numbers, *(name for name in time if name not in dated)]):
        read = _numbers(columns[name], text.decimal, wanted)
        if rows is not None:
            read = _Numbers(read.cells, read.values[rows], read.blank[rows])
        values = read.values
        allowed = np.isnan(values) if wanted.nan else read.blank
        if (np.isnan(values) & ~(allowed & (name in wanted.gaps))).any():
            raise _UnclearError
        numbers[name] = values
        if text.decimal.encode() in _bytes(read.cells):
            marked[name] = read.cells
    unclear = {n: c for n, c in marked.items() if _all_match(c, _LIKE_GROUPS, text.decimal)}
    if unclear and not certain:
        _check_mark(text, places, sure=len(unclear) < len(marked))
    taken = table if rows is None else table.take(pa.array(rows)).combine_chunks()
    columns = dict(zip([*names, *others], taken.columns, strict=False))
    return CsvColumns(
        {name: numbers[name] for name in wanted.numbers},
        {name: [cell.strip() for cell in columns[name].to_pylist()] for name in wanted.texts},
        taken.num_rows,
        _times(columns[wanted.time], numbers.get(wanted.time)) if wanted.time is not None else None,
        text.decimal if marked or certain else ".",
        _thousands(unclear, text.decimal) if certain else {},
        {name: cells_in(_strings(columns[name]), text.decimal) for name in wanted.cells},
        rows,
    )


def _strings(column: pa.ChunkedArray) -> list[str]:
    """Return the texts of a column, an empty one for null."""
    return ["" if cell is None else str(cell) for cell in column.to_pylist()]


def _thousands(columns: Mapping[str, pa.ChunkedArray], mark: str) -> dict[str, str]:
    """Return the longest cell of each column whose numbers all have three digits after the mark."""
    found = {}
    for name, cells in columns.items():
        if _all_match(cells, _GROUPS, mark):
            marked = cells.filter(pc.match_substring(cells, mark))
            lengths = pc.utf8_length(marked)
            found[name] = marked[pc.index(lengths, pc.max(lengths)).as_py()].as_py().strip()
    return found


def _table(text: Text, places: Sequence[int], typed: Collection[int] = ()) -> pa.Table:
    """Return columns as text, but for those whose types are to be recognised."""
    try:
        return csv.read_csv(
            text.path,
            csv.ReadOptions(column_names=list(map(str, range(text.width))), skip_rows=text.above),
            csv.ParseOptions(delimiter=text.separator),
            csv.ConvertOptions(
                column_types={str(place): pa.string() for place in places if place not in typed},
                include_columns=list(map(str, places)),
                null_values=[""],
                strings_can_be_null=False,
            ),
        )
    except (pa.ArrowException, OSError):
        raise _UnclearError from None


class _Numbers(NamedTuple):
    """The numbers of a column of text.

    Attributes:
        cells: The cells, without words for empty cells.
        values: The numbers; nan where a cell is empty.
        blank: Where a cell is empty.
    """

    cells: pa.ChunkedArray
    values: Floats
    blank: NDArray[np.bool_]


def _numbers(column: pa.ChunkedArray, decimal: str, wanted: Wanted) -> _Numbers:
    """Return the numbers of a column."""
    with suppress(pa.ArrowInvalid):
        values = _floats(column, decimal)
        return _Numbers(column, values, np.zeros(len(values), bool))
    cells = pc.utf8_lower(pc.utf8_trim_whitespace(column))
    empty = pc.is_in(cells, value_set=pa.array(["", *(NOT_KNOWN if wanted.nan else ())]))
    plain = pc.if_else(empty, pa.scalar(None, pa.string()), cells)
    for word, value in TRUTH.items():
        plain = pc.if_else(pc.equal(cells, word), f"{value:g}", plain)
    try:
        values = _floats(plain, decimal)
    except pa.ArrowInvalid:
        raise _UnclearError from None
    blank = floats_of(empty.cast(pa.float64())) > 0
    return _Numbers(pc.if_else(empty, "", cells), values, blank)


def _floats(cells: pa.ChunkedArray, decimal: str) -> Floats:
    if decimal == ",":
        if b"." in _bytes(cells):
            raise _UnclearError
        cells = pc.replace_substring(cells, ",", ".")
    return floats_of(cells.cast(pa.float64()))


def _times(column: pa.ChunkedArray, numbers: Floats | None) -> RawTimes:
    """Return dates, integers if all cells are whole numbers, or doubles."""
    times: RawTimes | None = numbers
    if numbers is None:
        times = raw_times_of(column) if is_time(column.type) and not column.null_count else None
    elif np.isnan(numbers).any():
        times = None
    elif not _bytes(column).translate(None, b"0123456789- "):
        with suppress(pa.ArrowInvalid):
            times = raw_times_of(pc.utf8_trim_whitespace(column).cast(pa.int64()))
    if times is None:
        raise _UnclearError
    return times


def _check_mark(text: Text, read: Collection[int], *, sure: bool) -> None:
    """Check that the decimal mark that was tried is the mark of the file.

    Args:
        text: The file.
        read: The columns that are read, whose numbers have no other mark.
        sure: Whether one of them has a number that can be read with this mark only.
    """
    mark, other = text.decimal, _OTHER[text.decimal]
    others = [place for place in range(len(text.names)) if place not in read]
    for column in _table(text, others).columns if others else ():
        inside = _bytes(column)
        if other.encode() in inside and _any_match(column, _MARKED, other):
            raise _UnclearError
        if mark.encode() in inside:
            if _any_match(column, _SEVERAL, mark):
                raise _UnclearError
            with suppress(_UnclearError):
                cells = _numbers(column, mark, Wanted([], nan=True)).cells
                sure = sure or not _all_match(cells, _LIKE_GROUPS, mark)
    if not sure:
        raise _UnclearError


_OPEN: Final = r"[+-]?[1-9]\d{0,2}MARK\d{3}"

_GROUPS: Final = rf"^\s*(?:{_OPEN}|\D*)\s*$"
"""A number that has three digits after the mark, or a word."""

_LIKE_GROUPS: Final = rf"^\s*(?:{_OPEN}|[+-]?\d{{1,4}}|\D*)\s*$"
"""The same, or a whole number that needs no groups."""

_MARKED: Final = rf"^\s*[+-]?[\d.,{GROUP_MARKS}]*MARK[\d.,{GROUP_MARKS}]*(?:[eE][+-]?\d+)?\s*$"
"""What may be a number with a mark."""

_SEVERAL: Final = r"^\s*[+-]?[\d.,]*MARK[\d.,]*MARK[\d.,]*\s*$"
"""What may be a number with groups of digits between marks."""


def _all_match(column: pa.ChunkedArray, pattern: str, mark: str) -> bool:
    """Return whether all cells match a pattern with a decimal mark; null matches."""
    return all(pc.all(found).as_py() is not False for found in _matches(column, pattern, mark))


def _any_match(column: pa.ChunkedArray, pattern: str, mark: str) -> bool:
    return any(pc.any(found).as_py() for found in _matches(column, pattern, mark))


def _matches(column: pa.ChunkedArray, pattern: str, mark: str) -> Iterator[pa.Array]:
    """Yield for each part of a column which cells match; the first parts often suffice."""
    pattern = pattern.replace("MARK", re.escape(mark))
    for part in column.chunks:
        yield pc.match_substring_regex(part, pattern)


def _bytes(column: pa.ChunkedArray) -> bytes:
    """Return the bytes of all cells of a column of text."""
    data = (part.buffers()[2] for part in column.chunks)
    return b"".join(memoryview(buffer) for buffer in data if buffer is not None)
