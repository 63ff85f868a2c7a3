"""Times by the name and by the values of a column.

To add a name of a column of times, or of a unit in it, change `unit_of_times` and its tables. Files
and data frames both use them.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


def word_set(words: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(words.split())


_UNIT_WORDS = {
    "ns": "ns nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds nanosekunden",
    "us": "us µs μs usec usecs micros microsec microsecs microsecond microseconds mikrosekunden",
    "ms": "ms msec msecs millis millisec millisecs millisecond milliseconds millisekunden",
    "s": "s sec secs second seconds sek sekunde sekunden seconde secondes segundos secondi",
    "min": "min mins minute minutes minuten",
    "h": "h hr hrs hour hours std stunde stunden",
}
UNIT_OF = {word: unit for unit, words in _UNIT_WORDS.items() for word in words.split()}
"""How names of columns write units, in lower case."""

NANOSECONDS: Mapping[str, int] = {
    "ns": 1,
    "us": 10**3,
    "ms": 10**6,
    "s": 10**9,
    "min": 60 * 10**9,
    "h": 3600 * 10**9,
}
"""The units of times, in nanoseconds."""

_PLAIN = re.compile(
    r"(?:time|timestamp|time[ _]stamp|stamp|datetime|tout|t)s?"
    r"(?:\s*[\[(]\s*(?P<inside>[^\])]*?)\s*[\])]|[\s_/.-]+(?P<behind>[^\W\d_]+))?",
    re.IGNORECASE,
)

_TIME_NAMES = word_set(
    # General names.
    "time times timestamp timestamps stamp stamps datetime tout "
    "elapsed elapsedtime timeelapsed reltime relativetime timerelative timerel "
    "abstime absolutetime currenttime globaltime localtime realtime walltime wallclock "
    "utctime timeutc unixtime timeunix posixtime epochtime timeepoch gpstime timegps "
    "systime systemtime timesystem hosttime devicetime boottime timeboot uptime "
    "simtime timesim simulationtime timesteptime physicstime missiontime flighttime "
    "testtime experimenttime measurementtime "
    # Loggers.
    "logtime recordtime recordingtime rectime recvtime receivetime publishtime rostime "
    "frametimeepoch frametimerelative "
    # Other languages.
    "zeit zeitstempel zeitpunkt messzeit uhrzeit simulationszeit systemzeit "
    "temps horodatage heure tempsecoule tiempo tempo tijd tijdstempel czas "
    "时间 時間 время"
)
"""Names of times without marks between words, in lower case and without accents."""

_TIME_UNITS = {
    **dict.fromkeys(("seconds", "secs", "sekunden", "secondes", "elapsedseconds"), "s"),
    **dict.fromkeys(("milliseconds", "millis", "millisekunden"), "ms"),
    **dict.fromkeys(("microseconds", "micros", "mikrosekunden"), "us"),
    **dict.fromkeys(("nanoseconds", "nanos", "nanosekunden", "rosbagtimestamp"), "ns"),
}
"""Names of times that state their unit."""

_ZONES = frozenset({"utc", "gmt", "local", "z", "est", "pst", "cet", "cest", "mez", "mesz"})

HINTS = word_set(
    "time times timestamp timestamps stamp zeit zeitstempel temps tiempo tempo tijd tid czas clock "
    "clk date datum epoch utc elapsed uptime tick ticks ts"
) | (UNIT_OF.keys() - {"h", "min", "s", "std"})
"""Words in possible names of times."""

CLOCKS = word_set(
    "time times timestamp timestamps stamp clock elapsed uptime zeit zeitstempel temps tiempo "
    "tempo tijd czas"
)
"""Words that make even the name of a counter a time, if its values rise evenly: step time."""

QUANTITIES = word_set(
    # Counters.
    "count counter cnt index idx frame frames sample samples seq sequence step steps cycle cycles "
    "n i k id row line nr no num number iteration iter epoch round lap total cumulative progress "
    "zaehler zahler nummer anzahl zyklus takt bild packet packets pkt msg message messages alive "
    "revolution revolutions pulse pulses encoder bytes page event events evt frm "
    # Distances and other quantities that rise evenly.
    "odo odometer distance dist mileage km station ramp pos position x y z lat lon latitude "
    "longitude alt altitude height depth angle heading yaw pitch roll phi theta psi steering "
    "setpoint ref reference target command cmd energy charge soc volume fuel temp temperature "
    "speed velocity vel v rpm freq frequency percent percentage throttle load torque force "
    "xpos ypos zpos chainage arc length travel travelled traveled driven path route displacement "
    "wheel rot rotation sweep phase amplitude gain battery radius width size area mass weight "
    "offset flow rate accel acceleration stress strain elevation work heat "
    "pressure voltage current power gear level score reward return weg strecke kilometerstand "
    "winkel drehzahl geschwindigkeit rampe sollwert hohe"
)
"""Words of quantities that may rise evenly and are not times."""


ABSCISSAS = {("x", "value"), ("x", "axis"), ("xaxis",), ("abscissa",), ("abszisse",)}
"""Names of the horizontal axis in LabVIEW and ControlDesk."""


_MANY = 4096
"""The names whose meaning is kept, because files of one folder have the same columns."""


class ColumnName(NamedTuple):
    """A name of a column."""

    words: tuple[str, ...]  # its words in lower case, without accents, unit and marks
    unit: str | None  # the text in brackets after them; None without brackets


INDEX = re.compile(r"Unnamed: \d+|level_\d+|__index_level_\d+__|index|idx|", re.IGNORECASE)
"""Names that pandas uses for an index of rows, which may hold times."""

_BRACKETS = re.compile(
    r"(?P<name>.*?)[\s_,:]*[\[(<{]\s*(?P<unit>[^\])>}]*?)\s*[\])>}]\s*", re.DOTALL
)
_WORD_ENDS = re.compile(r"(?<=[a-zß-ÿ])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


@lru_cache(maxsize=_MANY)
def read_name(column: str) -> ColumnName:
    """Return the words and the unit in a column's name."""
    match = _BRACKETS.fullmatch(column)
    bare, unit = (match["name"], match["unit"]) if match and match["name"] else (column, None)
    if unit is not None and unit.lower() in _ZONES:
        unit = None
    split = unicodedata.normalize("NFKD", _WORD_ENDS.sub(" ", bare.replace("µ", "u")))
    plain = "".join(c for c in split if not unicodedata.combining(c)).lower()
    return ColumnName(tuple(re.findall(r"[^\W_]+", plain)), unit)


def name_words(column: str) -> tuple[str, ...]:
    """Return the words of a column's name in lower case, without a unit in brackets.

    Example:
        >>> name_words("#trackId [-]"), name_words("header.stamp_secs")
        (('track', 'id'), ('header', 'stamp', 'secs'))
    """
    return read_name(column).words


def has_plain_time_name(column: str) -> bool:
    """Return whether a name is ``time``, ``timestamp``, ``stamp``, ``datetime``, ``t`` or ``tout``.

    A unit may follow. These names have priority over the others that `unit_of_times` knows.
    """
    return _unit_of_plain(column) is not None


@lru_cache(maxsize=_MANY)
def _unit_of_plain(column: str) -> str | None:
    match = _PLAIN.fullmatch(column)
    if match is None or column.lower() == "ts" or column == "T":  # rather names of quantities
        return None
    inside, behind = match["inside"], match["behind"]
    if inside is not None:
        if inside.lower() in _ZONES:
            return ""
        known = UNIT_OF.get(inside.lower())
        temperature = known is None and column[:1] in "tT" and not column[1:2].isalpha()
        return None if temperature else known or inside
    return UNIT_OF.get(behind.lower()) if behind else ""


@lru_cache(maxsize=_MANY)
def unit_of_times(column: str) -> str | None:
    """Return the unit in the name of a column of times; None for other names.

    The unit is empty if the name states none, and unchanged if it is unknown. Marks before the name
    (``#``, ``%``, ``_``), case and marks between words do not count.

    Example:
        >>> [unit_of_times(name) for name in ("Time [s]", "timestamp_ns", "t", "time (µs)")]
        ['s', 'ns', '', 'us']
        >>> [unit_of_times(name) for name in ("__time", "TimeUS", "time_boot_ms", "Zeit [s]")]
        ['', 'us', 'ms', 's']
        >>> [unit_of_times(name) for name in ("time_zone", "T", "timer", "Time [ticks]")]
        [None, None, None, 'ticks']
    """
    plain = _unit_of_plain(column)
    if plain is not None:
        return plain
    if _FIELD.search(_BRACKETS.sub(r"\g<name>", column)):
        return None
    words, inside = read_name(column)
    unit = "" if words == ("t",) and "T" not in column else _unit_of_words(words)
    return unit if inside is None or unit is None else UNIT_OF.get(inside.lower())


_FIELD = re.compile(r"[^\W_][./][^\W_]{3}")
"""A field of a structure, as in ``header.stamp``."""


def _unit_of_words(words: Sequence[str]) -> str | None:
    joined = "".join(words)
    if len(words) > 1 and (unit := UNIT_OF.get(words[-1])):
        remainder = "".join(words[:-2] if words[-2] == "in" else words[:-1])
        if remainder == "t" or _unit_of_joined(remainder) == "":
            return unit
    if len(words) > 2 and words[1] == "since" and words[0] in UNIT_OF:
        return UNIT_OF[words[0]]  # ms since boot
    behind = re.fullmatch(r"(?:time|timestamp)(ns|nsec|us|usec|ms|msec|sec)", joined)
    return UNIT_OF[behind[1]] if behind else _unit_of_joined(joined)


def hinted_unit(column: str) -> str | None:
    """Return the unit in a name, even if the name may not be a time; None without one.

    Example:
        >>> hinted_unit("clock_us"), hinted_unit("recv [ms]"), hinted_unit("clk")
        ('us', 'ms', None)
    """
    unit = unit_of_times(column)
    if unit in NANOSECONDS:
        return unit
    words, inside = read_name(column)
    if inside is not None:
        return UNIT_OF.get(inside.lower())
    return UNIT_OF.get(words[-1]) if len(words) > 1 else None


_CALENDAR = {
    **dict.fromkeys(("minute", "minutes"), "min"),
    **dict.fromkeys(("hour", "hours", "hr", "hrs", "stunde", "stunden"), "h"),
    **dict.fromkeys(("day", "days", "doy", "yday", "tag", "tage", "date", "datum"), "day"),
    **dict.fromkeys(("dayofyear", "dayofmonth", "dayofweek", "weekday", "wochentag"), "day"),
    **dict.fromkeys(("week", "weeks", "woche", "wochen", "kw"), "week"),
    **dict.fromkeys(("month", "months", "monat", "monate"), "month"),
    **dict.fromkeys(("year", "years", "jahr", "jahre"), "year"),
}


def calendar_unit(column: str) -> str | None:
    """Return the unit that a column counts by its name; None for other names.

    Example:
        >>> calendar_unit("Hour"), calendar_unit("day of year"), calendar_unit("runtime [h]")
        ('h', 'day', None)
    """
    words, inside = read_name(column)
    return _CALENDAR.get("".join(words)) or (inside and _CALENDAR.get(inside.lower())) or None


_PARTS = ("ns", "us", "ms")


def split_times(names: Sequence[str]) -> list[tuple[str, str, str]]:
    """Return pairs of columns named as seconds and parts of seconds, with the unit of the parts.

    Example:
        >>> split_times(["v", "s", "ns", "stamp.sec", "stamp.nanosec"])
        [('s', 'ns', 'ns'), ('stamp.sec', 'stamp.nanosec', 'ns')]
        >>> split_times(["start_s", "end_ns"])
        []
    """
    ends = {name: words for name in names if (words := name_words(name))}
    parts = {
        words[:-1]: (name, unit)
        for name, words in ends.items()
        if (unit := UNIT_OF.get(words[-1])) in _PARTS
    }
    return [
        (name, *parts[words[:-1]])
        for name, words in ends.items()
        if UNIT_OF.get(words[-1]) == "s" and words[:-1] in parts
    ]


def _unit_of_joined(joined: str) -> str | None:
    if joined in _TIME_UNITS:
        return _TIME_UNITS[joined]
    if joined in _TIME_NAMES or joined.startswith("timesince"):
        return ""
    return "" if re.fullmatch(r"\w+(?:timestamps?|zeitstempel)", joined) else None


_CLOCK_WORDS = word_set(
    "t ts time times timestamp timestamps stamp zeit zeitstempel temps tiempo tempo"
)


def own_times(column: str, names: Sequence[str]) -> str | None:
    """Return the column with the times of one column, if several have their own; None without one.

    The column is called ``time_x`` or ``x.time``, for example. Otherwise, if the table starts with
    times, it is the nearest column to the left with a name such as ``time.1`` or ``t2``.

    Example:
        >>> own_times("w", ["time", "v", "time_w", "w"]), own_times("x2", ["t1", "x1", "t2", "x2"])
        ('time_w', 't2')
        >>> own_times("w", ["time", "v", "w"])
        'time'
        >>> own_times("w", ["index", "v", "w"]) is None
        True
    """
    words = name_words(column)
    owner = words[:-1] if words[-1:] and words[-1] in ("value", "values", "data") else words
    for name in names:
        clock = name_words(name)
        if name != column and len(clock) == len(owner) + 1 and owner:
            if clock[1:] == owner and clock[0] in _CLOCK_WORDS:
                return name
            if clock[:-1] == owner and clock[-1] in _CLOCK_WORDS:
                return name
    if not names or not _is_clock(names[0]) or column not in names:
        return None
    return next(filter(_is_clock, reversed(names[: names.index(column)])), None)


@lru_cache(maxsize=_MANY)
def _is_clock(name: str) -> bool:
    """Return whether a name is a time, possibly with a number after it."""
    bare = re.sub(r"(?<=[^\W\d])[\s._]?\d+$", "", name)
    return unit_of_times(bare) is not None


_FINEST, _COARSEST = 5e-5, 100.0
"""The shortest and the longest usual step of a plausible unit, in seconds."""

_FIRST_DATE, _LAST_DATE, _LONGEST = 9.4e8, 4.2e9, 1e8
"""Seconds since 1970 in the years 2000 and 2100, and the longest time since a start."""

_FEW = 4
"""The minimum number of values for a decision without a name; one less with exactly even steps."""


def median(values: NDArray[Any]) -> float:
    """Return the median of doubles, as NumPy does, which is slow for a few."""
    n = len(values)
    if not 0 < n <= _SHORT:
        return float(np.median(values))
    ordered = np.sort(values)
    if math.isnan(ordered[-1]):  # nan comes last
        return math.nan
    middle = n // 2
    return float(ordered[middle] if n % 2 else (ordered[middle - 1] + ordered[middle]) / 2)


_SHORT = 10_000
"""The values up to which sorting is faster."""


def plausible_units(values: NDArray[Any]) -> list[str]:
    """Return the units in which times would have a plausible usual step, the likeliest first.

    Plausible steps are 50 µs to 100 s long; fractions below 1 are fractions of seconds. Times count
    from a start, or from 1970; units that give dates of this century exclude others.

    Example:
        >>> plausible_units(np.array([0.0, 0.01])), plausible_units(np.array([0, 10, 20]))
        (['s'], ['s', 'ms'])
    """
    with np.errstate(over="ignore"):
        step = median(np.abs(np.diff(values).astype(np.float64)))
    most = float(np.abs(values.astype(np.float64)).max())
    parts = values.dtype.kind == "f" and bool((values % 1).any())
    dates, durations = [], []
    for unit in ("s", "ms", "us", "ns"):
        scale = NANOSECONDS[unit] / 1e9
        if not _FINEST <= step * scale <= _COARSEST or (parts and unit in ("us", "ns")):
            continue
        if parts and step < 1 and unit == "ms":
            continue
        if _FIRST_DATE <= most * scale <= _LAST_DATE:
            dates.append(unit)
        elif most * scale <= _LONGEST:
            durations.append(unit)
    return dates or durations


def looks_like_times(column: str, values: NDArray[Any], *, first: bool) -> bool:
    """Return whether a column is probably a column of times, by its name and its values.

    A name such as ``hour`` or ``day`` needs numbers that change. A name with a word such as
    ``clock`` or with a unit of time needs values that rise, or fall. Any other name needs values
    that rise in nearly even steps and, after the first column, dates since 1970 or steps that are
    even up to rounding. The first column may fall, too. Counters and other quantities are not
    times unless their name has a word such as ``time``. Numbers 0, 1, 2 and so on count rows.

    Example:
        >>> steady = np.arange(6) * 0.25
        >>> [looks_like_times(name, steady, first=True) for name in ("clk", "A", "odometer")]
        [True, True, False]
    """
    if values.dtype.kind not in "iuf" or len(values) < 2:
        return False
    if not np.isfinite(values.astype(np.float64)).all():
        return False
    if calendar_unit(column) is not None and (values != values[0]).any():
        return True
    name = read_name(column)
    unit = None if name.unit is None else UNIT_OF.get(name.unit.lower())
    hinted = bool(HINTS & {*name.words}) or unit is not None
    with np.errstate(over="ignore"):
        steps = np.diff(values).astype(np.float64)
    if (hinted or first) and (steps < 0).all():  # the newest first
        values, steps = values[::-1], -steps[::-1]
    dated = hinted and dates_of_numbers(values) is not None
    if not (steps > 0).all() or ((steps == 1).all() and not dated):
        return False
    if name.words in ABSCISSAS or unit_of_times(column) is not None:
        return True
    quantity = bool(QUANTITIES & {*name.words}) or (name.unit is not None and unit is None)
    if INDEX.fullmatch(column):
        first, quantity = True, not (values % 1).any()
    if hinted and (dated or not quantity):
        return True
    if quantity and not hinted:
        return False
    clock = unit is not None or bool(CLOCKS & {*name.words})
    whole = clock or not quantity
    return _ticks(values, steps, rough=clock or (first and whole), whole=whole)


def _ticks(values: NDArray[Any], steps: NDArray[np.float64], *, rough: bool, whole: bool) -> bool:
    """Return whether values rise in nearly even steps.

    Unless ``rough``, they are dates or the steps are even up to rounding. Unless ``whole``, numbers
    without fractions are not times either.
    """
    usual = median(steps)
    off = np.abs(steps - usual)
    exact = rough and bool((off <= 1e-6 * usual).all())
    if len(values) < _FEW - exact or float((off <= 0.2 * usual).mean()) < 0.9:
        return False
    most = float(values[-1])
    dates = any(
        _FIRST_DATE <= most * NANOSECONDS[unit] / 1e9 <= _LAST_DATE
        for unit in plausible_units(values)
    )
    fractions = bool((values % 1).any())
    even = bool((off <= (0.02 * usual if fractions else max(0.02 * usual, 1))).all())
    return rough or dates or (even and (whole or fractions))


_PERIODS = word_set(
    "dt deltat tsample sampletime samplingtime sampleperiod samplingperiod sampleinterval "
    "samplinginterval timestep stepsize deltax xincrement xincr xinc horizontalinterval abtastzeit"
)
_RATES = word_set(
    "fs fps samplerate samplingrate samplefrequency samplingfrequency samplefreq samplingfreq "
    "framerate abtastrate abtastfrequenz"
)


def stated_period(name: str, value: float, *, single: bool) -> Fraction | None:
    """Return the seconds between samples that a constant states by its name; None for others.

    Example:
        >>> stated_period("dt", 0.1, single=False), stated_period("Fs [kHz]", 2.0, single=True)
        (Fraction(1, 10), Fraction(1, 2000))
    """
    if not 0 < value < math.inf:
        return None
    words, inside = read_name(name)
    joined, exact = "".join(words), Fraction(repr(float(value)))
    if joined in _RATES:
        return 1 / (exact * (1000 if (inside or "").lower() == "khz" else 1))
    unit = UNIT_OF.get((inside or "s").lower())
    if len(words) > 1 and UNIT_OF.get(words[-1]) and "".join(words[:-1]) in _PERIODS:
        joined, unit = "".join(words[:-1]), UNIT_OF[words[-1]]
    if unit is None or not (joined in _PERIODS or (single and joined in ("ts", "period"))):
        return None
    return exact * NANOSECONDS[unit] / NANOSECONDS["s"]


_SERIAL_DAYS = ((3e4, 8e4), (7.2e5, 7.7e5), (2.44e6, 2.49e6))
"""Days of dates from 1982 on, as spreadsheets, MATLAB and astronomers count them."""

_DAY = 86400
_PARTS_OF_DAY = (0.01, 0.1, 0.5, 1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200)


def are_days(values: NDArray[Any]) -> bool:
    """Return whether numbers are probably days and parts of days, and hardly seconds.

    Their usual step is a usual number of seconds in days, and not a short decimal number of
    seconds. It is too short for seconds, or the numbers have the size of dates.

    Example:
        >>> are_days(45413.5 + np.arange(5) / 86400), are_days(45413.5 + np.arange(5) / 100)
        (True, False)
    """
    if values.dtype.kind != "f" or len(values) < 2 or not np.isfinite(values).all():
        return False
    low, high = float(values.min()), float(values.max())
    dates = any(begin <= low <= high <= end for begin, end in _SERIAL_DAYS)
    step = median(np.abs(np.diff(values))) if -_LONGEST < low <= high < _LONGEST else 0.0
    if step <= 0 or (step >= _FINEST and not dates):
        return False
    if step < _FINEST and dates:
        return True
    usual = min(_PARTS_OF_DAY, key=lambda seconds: abs(seconds - step * _DAY))
    if abs(usual - step * _DAY) > 0.01 * usual:
        return False
    digits = step / 10.0 ** math.floor(math.log10(step)) * 100
    return abs(digits - round(digits)) > 0.02


_DATE = re.compile(
    r"\d{1,4}[-./]\d{1,2}[-./]\d{1,4}([T, ]+\d{1,2}:\d\d.*)?|\d{1,2}:\d\d(:\d\d.*)?", re.ASCII
)


def is_date(text: str) -> bool:
    """Return whether a text looks like a date or a time of day in digits.

    Example:
        >>> is_date("2024-05-01T12:00Z"), is_date("12:00:01.5"), is_date("1.5")
        (True, True, False)
    """
    return _DATE.fullmatch(text.strip()) is not None


def dates_of_numbers(values: NDArray[Any]) -> NDArray[Any] | None:
    """Return the dates in numbers such as 20240501 or 20240501123000; None for others.

    Example:
        >>> dates_of_numbers(np.array([20240430, 20240501])).astype("datetime64[D]").tolist()
        [datetime.date(2024, 4, 30), datetime.date(2024, 5, 1)]
    """
    if values.dtype.kind not in "iuf" or not len(values):
        return None
    if values.dtype.kind == "f" and not (np.isfinite(values) & (values % 1 == 0)).all():
        return None
    low, high = float(values.min()), float(values.max())
    for digits in (8, 12, 14):
        scale = 10 ** (digits - 8)
        if not 19500101 * scale <= low <= high < 21010101 * scale:
            continue
        days, clock = np.divmod(values.astype(np.int64), scale)
        clock = clock * 10 ** (14 - digits)
        month, day = days // 100 % 100, days % 100
        hour, minute, second = clock // 10000, clock // 100 % 100, clock % 100
        if not ((month > 0) & (month < 13) & (hour < 24) & (minute < 60) & (second < 60)).all():
            return None
        months = ((days // 10000 - 1970) * 12 + month - 1).astype("datetime64[M]")
        dates = months.astype("datetime64[D]") + (day - 1)
        if (day < 1).any() or (dates.astype("datetime64[M]") != months).any():
            return None
        seconds = (hour * 3600 + minute * 60 + second).astype("timedelta64[s]")
        return np.asarray(dates.astype("datetime64[ns]") + seconds)
    return None


def are_clock_numbers(values: NDArray[Any]) -> bool:
    """Return whether numbers such as 115945 or 1159 are probably times of day without marks.

    Their steps are even as hours, minutes and seconds, and uneven as numbers.

    Example:
        >>> are_clock_numbers(np.array([115930, 115945, 120000])), are_clock_numbers(np.arange(90))
        (True, False)
    """
    if values.dtype.kind not in "iuf" or len(values) < 3:
        return False
    numbers = values.astype(np.float64)
    if not (np.isfinite(numbers).all() and (numbers >= 0).all() and (numbers < 240000).all()):
        return False
    steps = np.diff(numbers)
    if (steps <= 0).any() or float(np.ptp(steps)) <= 0.02 * float(steps.min()):
        return False
    remainder, low = np.divmod(numbers, 100)
    hours, middle = np.divmod(remainder, 100)
    clocks = [3600 * hours + 60 * middle + low] if (middle < 60).all() else []
    if (remainder < 24).all():
        clocks.append(60 * remainder + low)
    return any(
        (low < 60).all() and float(np.ptp(gaps)) <= 0.02 * float(gaps.min())
        for gaps in map(np.diff, clocks)
    )
