"""The column of times of a recording: how it is recognised, and its times in seconds."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError, unit_of_times
from rtamt.errors import nearest
from rtamt_gym.checks.names import listed, listing
from rtamt_gym.recorded.columns import UNITS, Columns
from rtamt_gym.recorded.recording import Floats, Recording, Rows
from rtamt_gym.tables import number

__all__ = ["TIME", "RawTimes", "TimeAxis", "find_times", "read_dates", "simple"]

TIME = "time"
"""The column with the time of a sample or an event that is taken where several have times."""

RawTimes = NDArray[Any]
"""Times as a file holds them: doubles, integers, or dates of ``datetime64[ns]``."""

_FEW = 100

_ABSURD_STEP, _ABSURD_TIME = 1e3, 1e11
"""Seconds between samples, and since 1970 or a start, from which on a number of unknown unit is no
number of seconds: samples of 1 kHz in ns are 10^6 apart, a date in ms is above 10^12."""


def find_times(recording: Recording, columns: Columns) -> str | None:
    """The column of times: that which is named, else the one whose name tells it, else None.

    A column ``time`` goes before others. Where no name does, a column of dates counts, and then a
    name behind a dot or a slash, as in ``header.stamp``.

    Raises:
        InputError: If the named column is missing, or if several names tell of times.
    """
    names = dict.fromkeys(recording.names)
    if columns.time is not None:
        if columns.time not in names:
            raise InputError(
                f"{recording.source}: no column '{columns.time}', which --time names; the columns "
                f"are {listed(names, columns.time)}{nearest(columns.time, names)}"
            )
        return columns.time
    if TIME in names:
        return TIME
    found = [name for name in names if unit_of_times(name) is not None]
    if not found:
        found = list(recording.dates)
    if not found:
        parts = {name: re.split(r"[./]", name)[-1] for name in names}
        found = [n for n, last in parts.items() if last != "t" and unit_of_times(last) is not None]
    if len(found) > 1:
        raise InputError(
            f"{recording.source}: expected one column of times, got {listing(found)}; "
            f"say which with --time {found[0]!r}"
        )
    return found[0] if found else None


def read_dates(texts: Sequence[str]) -> RawTimes | None:
    """Dates of ISO 8601 as ``datetime64[ns]``, in UTC if they have offsets; None if one is no date.

    A date without a time is the begin of the day.

    Example:
        >>> read_dates(["2024-05-01T12:00:00.5Z", "2024-05-01 14:00:01+02:00"]).tolist()
        [1714564800500000000, 1714564801000000000]
        >>> read_dates(["2024-05-01T12:00:00Z", "2024-05-01T12:00:01"]), read_dates(["12"])
        (None, None)
    """
    parts = [_DATE.fullmatch(text.strip()) for text in texts]
    matches = [part for part in parts if part is not None]
    if len(matches) < len(parts) or len({part["zone"] is None for part in matches}) > 1:
        return None
    try:
        dates = np.array([part["date"] for part in matches], "M8[ns]")
    except ValueError:  # such as a month 13
        return None
    offsets = {zone: _offset(zone) for zone in {part["zone"] for part in matches}}
    shift = np.array([offsets[part["zone"]] for part in matches], "m8[m]")
    utc: RawTimes = dates - shift
    return utc


_DATE = re.compile(
    r"(?P<date>\d{4}-\d\d-\d\d(?:(?P<time>[T ])\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?)?)"
    r"(?(time)(?P<zone>Z|[+-]\d\d(?::?\d\d)?)?)",
    re.ASCII,
)


def _offset(zone: str | None) -> int:
    """Minutes that a zone is ahead of UTC."""
    if zone in (None, "Z"):
        return 0
    sign, digits = -1 if zone[0] == "-" else 1, zone[1:].replace(":", "")
    return sign * (60 * int(digits[:2]) + int(digits[2:] or 0))


@dataclass(frozen=True, slots=True)
class TimeAxis:
    """Times in seconds.

    Attributes:
        column: The name of the column.
        since: Seconds since the first time, exact for integers and dates before they are rounded.
        start: The first time in seconds; 0 for dates, whose origin is no time of a trace.
        precision: How far a time may be off because it was rounded to a double.
        certain: Whether somebody has said that the unit is the unit.
        step: The distance of all neighbours, if it is the same and the times are whole numbers of
            nanoseconds or longer units.
    """

    column: str
    since: Floats
    start: float
    precision: float
    certain: bool
    step: Fraction | None = None

    @staticmethod
    def of(rows: Rows, column: str, columns: Columns) -> TimeAxis:
        """The times of the rows of a recording.

        Raises:
            InputError: If a time is not finite, or if the name of the column has an unknown unit.
        """
        raw = rows.times
        assert raw is not None, "the column was read"  # noqa: S101 - for mypy
        if raw.dtype.kind == "f":
            raw = raw.astype(np.float64)
        wrong = np.isnat(raw) if raw.dtype.kind in "mM" else ~np.isfinite(raw)
        if wrong.any():
            at = int(wrong.argmax())
            raise InputError(
                f"{rows.where(at)}, column '{column}': expected a finite number, got {raw[at]}"
            )
        if raw.dtype.kind in "mM":
            whole = raw.astype(f"{raw.dtype.kind}8[ns]").astype(np.int64)
            start = 0.0 if raw.dtype.kind == "M" else float(whole[0] / 1e9)
            step = _step(whole, 1)
            return TimeAxis(column, (whole - whole[0]) / 1e9, start, 1e-9, certain=True, step=step)
        said = columns.time_unit or rows.unit or unit_of_times(column) or ""
        if said and said not in UNITS:
            raise InputError(
                f"{rows.source}, column '{column}': expected a unit of time, got {said!r}; "
                f"say the unit with --time-unit ({', '.join(UNITS)})"
            )
        unit = UNITS[said or "s"]
        with np.errstate(over="ignore"):  # of times that `check_distances` refuses
            since = _scaled(raw - raw[0], unit)
        most = float(np.abs(raw).max())
        ulp = math.ulp(most) if raw.dtype.kind == "f" else 0.0
        start = float(_scaled(raw[:1], unit)[0])
        precision = max(ulp * unit / 1e9, math.ulp(float(np.abs(since).max())))
        step = None if raw.dtype.kind == "f" else _step(raw, unit)
        return TimeAxis(column, since, start, precision, bool(said), step)

    @property
    def seconds(self) -> Floats:
        """The times in seconds."""
        return self.start + self.since

    def check_distances(self, rows: Rows) -> None:
        """Checks that each time has a distance to the first, where it is not left aside.

        Raises:
            InputError: If one is not finite.
        """
        far = ~np.isfinite(self.since)
        if far.any():
            raw, at = rows.times, int(far.argmax())
            assert raw is not None, "the column was read"  # noqa: S101 - for mypy
            raise InputError(
                f"{rows.where(at)}, column '{self.column}': expected times whose distances are "
                f"finite, got {raw[at]} after {raw[0]}; --period reads samples and leaves the "
                "column aside"
            )

    def check_unit(self, where: str) -> None:
        """Checks that the times can be seconds, if nobody has said so.

        Raises:
            InputError: If they are too far apart, or too great.
        """
        if self.certain or len(self.since) < 2:
            return
        usual = float(np.median(np.diff(self.since)))
        most = max(abs(self.start), abs(self.start + float(self.since[-1])))
        if usual < _ABSURD_STEP and most < _ABSURD_TIME:
            return
        got = f"{usual:.6g} s apart"
        if usual < _ABSURD_STEP:
            got = f"{most:.6g} s, a time after the year 5000"
        raise InputError(
            f"{where}: expected times in seconds in the column '{self.column}', got {got}; "
            "say the unit with --time-unit, such as ns, ms or s"
        )

    @property
    def unit_note(self) -> str:
        """Says that the times may be milliseconds; empty if they can hardly be, or are not.

        These are times whose unit nobody has said, and which are whole numbers 1 or more apart.
        """
        if self.certain or len(self.since) < 2:
            return ""
        steps = np.diff(self.since[:_FEW])
        if not (steps >= 1).all() or (steps % 1).any():  # most times say it in a few
            return ""
        steps = np.diff(self.since)
        if not (steps >= 1).all() or (steps % 1).any():
            return ""
        length = number(float(self.since[-1]))
        return (
            f"the times have no unit and count as seconds, {length} s in all: if these are "
            "milliseconds, --time-unit ms"
        )

    def text(self, at: int) -> str:
        """The time of a row in seconds, since the first row if the time is long."""
        if abs(self.start) < 1e6:
            return f"{self.start + self.since[at]:.15g}"
        return f"{self.since[at]:.15g} s since the first"


def _step(whole: NDArray[Any], unit: int) -> Fraction | None:
    """The distance of whole numbers of a unit in seconds, if it is the same everywhere."""
    if len(whole) < 2:
        return None
    first = int(whole[1]) - int(whole[0])
    return Fraction(first * unit, UNITS["s"]) if (np.diff(whole) == first).all() else None


def _scaled(raw: RawTimes, unit: int) -> Floats:
    """Numbers of a unit in seconds, rounded once."""
    second = UNITS["s"]
    floats: Floats = raw.astype(np.float64)
    return floats * (unit // second) if unit >= second else floats / (second // unit)


def simple(value: float, blur: float) -> Fraction:
    """A fraction with a small denominator within ``blur`` of a value."""
    near = Fraction(value)
    for power in range(1, 12):
        simple_ = near.limit_denominator(10**power)
        if abs(simple_ - near) <= blur:
            return simple_
    return near
