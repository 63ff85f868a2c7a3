"""Numbers that stand as text in a table of another format, such as JSON lines or Parquet."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from rtamt_gym.recorded.cells import NumberColumns, is_number, times_in
from rtamt_gym.recorded.dates import RawTimes
from rtamt_gym.recorded.decimal_marks import FileMarks, convert
from rtamt_gym.recorded.recording import Floats, RowNumbers, Wanted

__all__ = ["holds_numbers", "numbers_in_texts"]


def holds_numbers(texts: Sequence[str]) -> bool:
    """Return whether the first text that is not empty is a number under some decimal mark."""
    first = next(filter(None, map(str.strip, texts)), "")
    return is_number(first, ".") or is_number(first, ",")


def numbers_in_texts(
    columns: Mapping[str, Sequence[str]],
    wanted: Wanted,
    decimal: str | None,
    source: str,
    where: Callable[[int], str],
    rows: Sequence[int] | None = None,
) -> tuple[dict[str, Floats], RawTimes | None, list[str]]:
    """Return the numbers and times in columns of text, and notes on how they were read.

    Args:
        columns: All columns of text of the file; an empty text is an empty cell.
        wanted: The columns to read; others than columns of text are left out. Times are read if
            they are numbers.
        decimal: The decimal mark that is stated; None to recognise it.
        source: Name of the file, for messages.
        where: Returns file and place of a row that is read, for messages.
        rows: The rows that are read; None: all.

    Raises:
        InputError: If a text is not a number, or the decimal mark is not certain.
    """
    read, time = [name for name in wanted.numbers if name in columns], wanted.time
    if time is None or time not in columns or not holds_numbers(columns[time]):
        time = None
    if not read and time is None:
        return {}, None, []
    numbers = NumberColumns(replace(wanted, numbers=read))
    marked = dict.fromkeys(read if time is None else [*read, time])
    marks = FileMarks(columns, marked, decimal, source, RowNumbers(source))
    marks.add(columns, 0)
    if rows is not None:
        columns = {name: [columns[name][row] for row in rows] for name in marked}
    numbers.add(columns, 0)
    mark = convert(numbers, marks, where)
    times = None
    if time is not None:
        times = times_in(columns[time], mark, lambda i: f"{where(i)}, column '{time}'")
        numbers.look_for_groups(columns[time], mark)
    return numbers.arrays, times, marks.notes(mark, numbers.grouped)
