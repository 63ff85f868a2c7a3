"""Numbers, dates and times of day in the texts of cells, from any splitter."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from itertools import chain, compress
from typing import Any, Final, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.recorded.columns import DateOrder
from rtamt_gym.recorded.recording import Floats, RawTimes

NOT_KNOWN: Final = frozenset(
    [
        *("nan", "+nan", "-nan", "na", "n/a", "#n/a", "#na", "<na>", "null", "none", "nil"),
        *("-", "--", "1.#qnan", "-1.#qnan", "1.#ind", "-1.#ind"),
        *("nan(ind)", "-nan(ind)", "nan(snan)", "-nan(snan)"),
    ]
)
"""Words, in lower case, that tools write for a missing number."""

TRUTH: Final = {"true": 1.0, "false": 0.0}
"""The numbers of truth values, which are written in any case."""

OTHER_MARK: Final = {".": ",", ",": "."}
"""Both decimal marks, each with the other one."""

_GROUP_MARKS: Final = " '\u2019\u00a0\u2009\u202f"
"""Marks between groups of three digits that are not decimal marks anywhere."""

_PLAIN: Final = {
    mark: re.compile(
        rf"[+-]?(?:\d+(?:{re.escape(mark)}\d*)?|{re.escape(mark)}\d+)(?:[eE][+-]?\d+)?", re.ASCII
    )
    for mark in OTHER_MARK
}

_GROUPED: Final = {
    mark: re.compile(
        rf"[+-]?[1-9]\d{{0,2}}(?P<group>[{re.escape(other + _GROUP_MARKS)}])\d{{3}}"
        rf"(?:(?P=group)\d{{3}})*(?:{re.escape(mark)}\d*)?",
        re.ASCII,
    )
    for mark, other in OTHER_MARK.items()
}

_EXACT: Final = 2.0**53
"""Integers below are exact as doubles."""


class CellNumbers(NamedTuple):
    """The numbers of a column, and the first cell with digits in groups, or an empty text."""

    values: Floats
    grouped: str = ""


class TextCells(Sequence[str]):
    """The texts of a column, or of a block of its rows."""

    def __init__(self, texts: Sequence[str]) -> None:
        self._texts = texts

    @overload
    def __getitem__(self, place: int) -> str: ...
    @overload
    def __getitem__(self, place: slice) -> Sequence[str]: ...
    def __getitem__(self, place: int | slice) -> str | Sequence[str]:
        """Return one or several texts."""
        return self._texts[place]

    def __len__(self) -> int:
        """Return the number of cells."""
        return len(self._texts)

    def __iter__(self) -> Iterator[str]:
        """Iterate over the texts."""
        return iter(self._texts)

    @cached_property
    def _together(self) -> str:
        return "".join(self._texts)

    def has(self, character: str) -> bool:
        """Return whether a character of ASCII occurs in a cell."""
        return character in self._together

    def selected(self, rows: NDArray[np.bool_]) -> TextCells:
        """Return the cells of some rows."""
        return TextCells([*compress(self, rows)])

    @staticmethod
    def joined(blocks: Sequence[TextCells]) -> TextCells:
        """Return the cells of all blocks."""
        return blocks[0] if len(blocks) == 1 else TextCells([*chain.from_iterable(blocks)])

    def numbers(self, decimal: str, *, gaps: bool = False, nan: bool = False) -> CellNumbers | None:
        """Return the numbers, as `floats_in` does; None if a cell is not a number."""
        return _numbers_in(self._texts, decimal, gaps=gaps, nan=nan)

    def integers(self) -> NDArray[np.int64] | None:
        """Return the cells as 64-bit integers; None if a cell is not an integer."""
        if set(self._together) <= set("0123456789- ") and all(map(str.strip, self)):
            try:
                return np.array(list(map(int, self)), np.int64)
            except (ValueError, OverflowError):
                pass
        return None

    def dates(self, order: DateOrder | None = None) -> RawTimes | None:
        """Return dates, times of day or durations; None if a cell is not such a time."""
        return times_of_texts(self._texts, None, order)


def is_number(cell: str, decimal: str) -> bool:
    """Return whether a cell without blanks around it is a number under a decimal mark.

    Example:
        >>> is_number("1.250", "."), is_number("1.250", ","), is_number("3,5", ".")
        (True, True, False)
    """
    return bool(_PLAIN[decimal].fullmatch(cell) or _GROUPED[decimal].fullmatch(cell))


def floats_in(
    cells: Sequence[str], decimal: str = ".", *, gaps: bool = False, nan: bool = False
) -> Floats | None:
    """Return the numbers in cells, nan for an empty cell; None if a cell is not a number.

    Example:
        >>> floats_in(["1,5", " 2"], ","), floats_in(["1.5"], ","), floats_in(["nan"])
        (array([1.5, 2. ]), None, None)
        >>> floats_in(["1", "", "N/A"], gaps=True, nan=True), floats_in(["1", "N/A"], gaps=True)
        (array([ 1., nan, nan]), None)
        >>> floats_in(["True", "1,250", "1 000.5"])
        array([1.0000e+00, 1.2500e+03, 1.0005e+03])
    """
    numbers = _numbers_in(cells, decimal, gaps=gaps, nan=nan)
    return None if numbers is None else numbers.values


def _numbers_in(cells: Sequence[str], decimal: str, *, gaps: bool, nan: bool) -> CellNumbers | None:
    read = None
    if decimal == ".":
        read = read_floats(cells)
    elif "." not in "".join(cells):
        read = read_floats([cell.replace(",", ".") for cell in cells])
    if read is not None:
        values = np.array(read, np.float64)
        return None if not (gaps and nan) and np.isnan(values).any() else CellNumbers(values)
    values, grouped = np.empty(len(cells)), ""
    for index, text in enumerate(cells):
        cell = text.strip()
        groups = _GROUPED[decimal].fullmatch(cell)
        if groups is not None:
            grouped = grouped or cell
            cell = cell.replace(groups["group"], "")
        number = _number(cell, decimal, gaps=gaps, nan=nan)
        if number is None:
            return None
        values[index] = number
    return CellNumbers(values, grouped)


def _number(cell: str, decimal: str, *, gaps: bool, nan: bool) -> float | None:
    word = cell.lower()
    if not cell or word in NOT_KNOWN:
        return math.nan if gaps and (nan or not cell) else None
    if word in TRUTH:
        return TRUTH[word]
    if decimal == "," and "." in cell:
        return None
    read = read_floats([cell.replace(decimal, ".")])
    return None if read is None else read[0]


def values_in(cells: TextCells, decimal: str) -> NDArray[Any]:
    """Return integers, doubles with nan in empty cells, or texts, as the cells look."""
    numbers = cells.numbers(decimal, gaps=True, nan=True)
    if numbers is None:
        return np.array([cell.strip() for cell in cells] or [""])[: len(cells)]
    values = numbers.values
    integers = values.astype(np.int64) if np.isfinite(values).all() else values
    return integers if (np.abs(values) < _EXACT).all() and (integers == values).all() else values


def times_in(
    cells: TextCells,
    decimal: str,
    where: Callable[[int], str],
    days: Iterable[str] | None = None,
    order: DateOrder | None = None,
) -> tuple[RawTimes, str]:
    """Return times, and the first cell with digits in groups, or an empty text.

    The times are integers, doubles, dates as ``datetime64[ns]``, or times of day.
    """
    integers = cells.integers()
    if integers is not None:
        return integers, ""
    numbers = None if floats_in(cells[:1], decimal) is None else cells.numbers(decimal)
    if numbers is not None:
        return numbers.values, numbers.grouped
    try:
        dates = cells.dates(order) if days is None else times_of_texts(cells, [*days], order)
    except InputError as error:
        raise InputError(f"{where(0)}: {error}") from None
    if dates is not None:
        return dates, ""
    expected = "a number"
    if read_dates(cells[:1]) is not None:
        expected = "a date like the first"
        wrong = next(i for i in range(len(cells)) if read_dates([cells[0], cells[i]]) is None)
    else:
        wrong = next(i for i, cell in enumerate(cells) if floats_in([cell], decimal) is None)
    raise InputError(f"{where(wrong)}: expected {expected}, got {cells[wrong]!r}")


_ISO = re.compile(
    r"(?P<date>\d{4}-\d\d-\d\d(?:(?P<time>[T ])\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?)?)"
    r"(?(time)(?P<zone>Z|[+-]\d\d(?::?\d\d)?)?)",
    re.ASCII,
)

_CLOCK: Final = (
    r"(?P<hour>\d{1,2}):?(?P<minute>\d\d)(?::?(?P<second>\d\d)(?:[.,](?P<part>\d{1,9}))?)?"
    r"(?:\s*(?P<half>[AaPp])\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)?"
)
_FORMS: Final = tuple(
    re.compile(rf"{date}(?:(?:T|,?\s+|[:_-]){_CLOCK})?", re.ASCII)
    for date in (
        r"(?P<year>\d{4})(?P<mark>[-/.])(?P<month>\d{1,2})(?P=mark)(?P<day>\d{1,2})",
        r"(?P<year>\d{4})(?P<month>\d\d)(?P<day>\d\d)(?=[T:_ -]\d)",
        r"(?P<day>\d{1,2})\.\s?(?P<month>\d{1,2})\.\s?(?P<year>\d{4}|\d\d)",
        r"(?P<first>\d{1,2})(?P<mark>[/-])(?P<other>\d{1,2})(?P=mark)(?P<year>\d{4})",
        r"(?P<day>\d{1,2})[-. ]{1,2}(?P<name>[^\W\d_]{3,9})\.?[-, ]{1,2}(?P<year>\d{4})",
        r"(?P<name>[^\W\d_]{3,9})\.?[- ](?P<day>\d{1,2}),?[- ](?P<year>\d{4})",
    )
)
_MONTHS: Final = {
    name: number
    for number, names in enumerate(
        (
            *("jan", "feb fev fév", "mar mär maa mrz", "apr avr", "may mai mei", "jun juin"),
            *("jul juil", "aug aou aoû", "sep", "oct okt", "nov", "dec dez déc"),
        ),
        1,
    )
    for name in names.split()
}


def read_dates(texts: Sequence[str], order: DateOrder | None = None) -> RawTimes | None:
    """Return dates as ``datetime64[ns]``, in UTC if they have offsets; None if one is not a date.

    These are dates of ISO 8601, also without marks between year, month and day, and dates with a
    certain order of day and month: the year first, dots (31.12.2024), a month in letters. In other
    dates (03/04/2024), the order is certain if a number is greater than 12, or if it does not
    matter for the distances. A date without a time is the start of its day.
    """
    bare = [text.strip() for text in texts]
    parts = [_ISO.fullmatch(text) for text in bare]
    matches = [part for part in parts if part is not None]
    if matches and len(matches) == len(parts):
        if len({part["zone"] is None for part in matches}) > 1:
            return None
        return _utc([part["date"] for part in matches], [part["zone"] for part in matches])
    if not bare or not bare[0]:
        return None
    for form in _FORMS:
        if form.fullmatch(bare[0]):
            results = [form.fullmatch(text) for text in bare]
            complete = [match for match in results if match is not None]
            dates = _dates_of(complete, order) if len(complete) == len(results) else None
            if dates is not None:
                return dates
    return None


def times_of_texts(
    texts: Sequence[str], days: Sequence[str] | None = None, order: DateOrder | None = None
) -> RawTimes | None:
    """Return the dates, times of day or durations in texts; None if one is not such a time.

    The days are the dates of texts that are times of day, in a column of their own.
    """
    joined = texts if days is None else [f"{d} {t}" for d, t in zip(days, texts, strict=True)]
    for candidates in (joined, texts) if days is not None else (texts,):
        dates = read_dates(candidates, order)
        if dates is not None:
            return dates
        if read_dates(candidates, "dmy") is not None and read_dates(candidates, "mdy") is not None:
            raise InputError(
                f"the date {candidates[0].strip()!r} may have the day or the month first; give "
                "--date-order dmy or --date-order mdy"
            )
    return read_clock(texts)


def _dates_of(matches: Sequence[re.Match[str]], order: DateOrder | None) -> RawTimes | None:
    """Return the dates of texts of one form; None if one does not exist or two readings differ."""
    fields = [match.groupdict() for match in matches]
    if len({field["zone"] is None for field in fields}) > 1:
        return None
    zones = [field["zone"] for field in fields]
    if "first" not in fields[0]:
        return _utc([_iso(field, field.get("month"), field["day"]) for field in fields], zones)
    orders: tuple[DateOrder, ...] = ("dmy", "mdy") if order is None else (order,)
    readings = []
    for choice in orders:
        month, day = ("other", "first") if choice == "dmy" else ("first", "other")
        read = _utc([_iso(field, field[month], field[day]) for field in fields], zones)
        if read is not None:
            readings.append(read)
    if not readings:
        return None
    since = [read - read[0] for read in readings]
    return readings[0] if all(np.array_equal(since[0], choice) for choice in since) else None


def _iso(field: dict[str, Any], month: str | None, day: str) -> str:
    """Return a date of ISO 8601; an empty text if it does not exist."""
    year = field["year"] if len(field["year"]) > 2 else f"20{field['year']}"
    number = _MONTHS.get(field["name"].lower()[:4]) if month is None else int(month)
    if month is None and number is None:
        number = _MONTHS.get(field["name"].lower()[:3])
    if number is None:
        return ""
    date = f"{year}-{number:02d}-{int(day):02d}"
    if field["hour"] is None:
        return date
    hour = int(field["hour"])
    if field["half"]:
        if not 1 <= hour <= 12:
            return ""
        hour = hour % 12 + 12 * (field["half"] in "pP")
    part = f".{field['part']}" if field["part"] else ""
    return f"{date}T{hour:02d}:{field['minute']}:{field['second'] or '00'}{part}"


def _utc(texts: Sequence[str], zones: Iterable[str | None]) -> RawTimes | None:
    if not all(texts):
        return None
    try:
        dates = np.array(texts, "M8[ns]")
    except ValueError:  # such as a month 13
        return None
    utc: RawTimes = dates - np.array([_offset(zone) for zone in zones], "m8[m]")
    return utc


def _offset(zone: str | None) -> int:
    """Return the minutes that a zone is ahead of UTC."""
    if zone is None or zone[0] not in "+-":
        return 0
    sign, digits = -1 if zone[0] == "-" else 1, zone[1:].replace(":", "")
    return sign * (60 * int(digits[:2]) + int(digits[2:] or 0))


_DURATION = re.compile(
    r"(?:(?P<days>\d+) days? )?(?P<hours>\d{1,3}):(?P<minutes>[0-5]\d):(?P<seconds>[0-5]\d)"
    r"(?:[.,](?P<part>\d{1,9}))?",
    re.ASCII,
)
_SECONDS = re.compile(r"(?P<number>\d+(?:\.\d*)?(?:[eE][+-]?\d+)?) ?(?P<unit>sec|s|ms|min|hr)")


def read_clock(texts: Sequence[str]) -> RawTimes | None:
    """Return times of day or durations as ``timedelta64[ns]``; None if one is not such a time.

    These are hours, minutes and seconds with an optional number of days, and the durations of
    MATLAB, such as ``0.5 sec``.
    """
    nanoseconds = []
    for text in texts:
        match = _DURATION.fullmatch(text.strip())
        if match is None:
            return _read_durations(texts)
        seconds = 86400 * int(match["days"] or 0) + 3600 * int(match["hours"])
        seconds += 60 * int(match["minutes"]) + int(match["seconds"])
        nanoseconds.append(seconds * 10**9 + int((match["part"] or "0").ljust(9, "0")))
    return np.array(nanoseconds, "m8[ns]")


def _read_durations(texts: Sequence[str]) -> RawTimes | None:
    nanoseconds = {"ms": 1e6, "s": 1e9, "sec": 1e9, "min": 60e9, "hr": 3600e9}
    matches = [_SECONDS.fullmatch(text.strip()) for text in texts]
    if not all(matches):
        return None
    durations = [round(float(m["number"]) * nanoseconds[m["unit"]]) for m in matches if m]
    return np.array(durations, "m8[ns]")
