"""Dates and times of day in texts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError

RawTimes = NDArray[Any]
"""Times as a file holds them: doubles, integers, dates (``datetime64[ns]``) or durations."""

DateOrder = Literal["dmy", "mdy"]
"""Whether 03/04/2024 is in April or in March."""

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

    Args:
        texts: The texts of a column.
        order: The order of day and month in ambiguous dates.

    Example:
        >>> read_dates(["2024-05-01T12:00:00.5Z", "2024-05-01 14:00:01+02:00"]).tolist()
        [1714564800500000000, 1714564801000000000]
        >>> read_dates(["01.05.2024 12:00:00,5", "13/05/2024 1:00 PM"][:1]).tolist()
        [1714564800500000000]
        >>> read_dates(["2024-05-01T12:00:00Z", "2024-05-01T12:00:01"]), read_dates(["12"])
        (None, None)
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

    Args:
        texts: The texts of a column of times.
        days: The texts of a column of dates, for texts that are times of day; None without such a
            column.
        order: The order of day and month in ambiguous dates.
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

    Example:
        >>> read_clock(["12:00:00,5", "1 day 00:00:01"]), read_clock(["12:05"])
        (array([43200500000000, 86401000000000], dtype='timedelta64[ns]'), None)
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
