"""Roles of the columns of a table: times with their unit, and ids of objects or episodes."""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "NANOSECONDS",
    "Objects",
    "are_clock_numbers",
    "are_days",
    "calendar_unit",
    "dates_of_numbers",
    "has_plain_time_name",
    "hinted_unit",
    "is_date",
    "looks_like_times",
    "may_tell_objects",
    "name_words",
    "names_objects",
    "objects_in",
    "own_times",
    "plausible_units",
    "split_times",
    "stated_period",
    "unit_of_times",
]


def _set(words: str) -> frozenset[str]:
    return frozenset(words.split())


_UNIT_WORDS = {
    "ns": "ns nsec nsecs nanos nanosec nanosecs nanosecond nanoseconds nanosekunden",
    "us": "us µs μs usec usecs micros microsec microsecs microsecond microseconds mikrosekunden",
    "ms": "ms msec msecs millis millisec millisecs millisecond milliseconds millisekunden",
    "s": "s sec secs second seconds sek sekunde sekunden seconde secondes segundos secondi",
    "min": "min mins minute minutes minuten",
    "h": "h hr hrs hour hours std stunde stunden",
}
_UNIT_OF = {word: unit for unit, words in _UNIT_WORDS.items() for word in words.split()}
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

_TIME_NAMES = _set(
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

_HINTS = _set(
    "time times timestamp timestamps stamp zeit zeitstempel temps tiempo tempo tijd tid czas clock "
    "clk date datum epoch utc elapsed uptime tick ticks ts"
) | (_UNIT_OF.keys() - {"h", "min", "s", "std"})
"""Words of names that may be names of times."""

_CLOCKS = _set(
    "time times timestamp timestamps stamp clock elapsed uptime zeit zeitstempel temps tiempo "
    "tempo tijd czas"
)
"""Words that make even a name of a counter one of times, if its values rise evenly: step time."""

_QUANTITIES = _set(
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
"""Words of names of quantities that may rise evenly, and are not times."""


_ABSCISSAS = {("x", "value"), ("x", "axis"), ("xaxis",), ("abscissa",), ("abszisse",)}
"""Names of the horizontal axis, as LabVIEW and ControlDesk write them."""


class _Name(NamedTuple):
    """A name of a column.

    Attributes:
        words: Its words in lower case, without accents, unit and marks.
        unit: The text in brackets behind them; None if there are no brackets.
    """

    words: tuple[str, ...]
    unit: str | None


_INDEX = re.compile(r"Unnamed: \d+|level_\d+|__index_level_\d+__|index|idx|", re.IGNORECASE)
"""Names that pandas gives to an index of rows, which may hold times."""

_BRACKETS = re.compile(
    r"(?P<name>.*?)[\s_,:]*[\[(<{]\s*(?P<unit>[^\])>}]*?)\s*[\])>}]\s*", re.DOTALL
)
_WORD_ENDS = re.compile(r"(?<=[a-zß-ÿ])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")


def _read_name(column: str) -> _Name:
    found = _BRACKETS.fullmatch(column)
    bare, unit = (found["name"], found["unit"]) if found and found["name"] else (column, None)
    if unit is not None and unit.lower() in _ZONES:
        unit = None
    split = unicodedata.normalize("NFKD", _WORD_ENDS.sub(" ", bare.replace("µ", "u")))
    plain = "".join(c for c in split if not unicodedata.combining(c)).lower()
    return _Name(tuple(re.findall(r"[^\W_]+", plain)), unit)


def name_words(column: str) -> tuple[str, ...]:
    """Return the words of a column's name in lower case, without a unit in brackets.

    Example:
        >>> name_words("#trackId [-]"), name_words("header.stamp_secs")
        (('track', 'id'), ('header', 'stamp', 'secs'))
    """
    return _read_name(column).words


def has_plain_time_name(column: str) -> bool:
    """Whether a name is ``time``, ``timestamp``, ``stamp``, ``datetime``, ``t`` or ``tout``.

    A unit may follow. These names go before others that `unit_of_times` knows.
    """
    return _unit_of_plain(column) is not None


def _unit_of_plain(column: str) -> str | None:
    found = _PLAIN.fullmatch(column)
    if found is None or column.lower() == "ts" or column == "T":  # rather names of quantities
        return None
    inside, behind = found["inside"], found["behind"]
    if inside is not None:
        if inside.lower() in _ZONES:
            return ""
        known = _UNIT_OF.get(inside.lower())
        temperature = known is None and column[:1] in "tT" and not column[1:2].isalpha()
        return None if temperature else known or inside
    return _UNIT_OF.get(behind.lower()) if behind else ""


def unit_of_times(column: str) -> str | None:
    """Return the unit in the name of a column of times; None if the name is not one of times.

    The unit is empty if the name states none, and stands as it is written if it is unknown. Marks
    before the name (``#``, ``%``, ``_``), case and marks between words do not count.

    Args:
        column: The name of the column.

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
    words, inside = _read_name(column)
    unit = "" if words == ("t",) and "T" not in column else _unit_of_words(words)
    return unit if inside is None or unit is None else _UNIT_OF.get(inside.lower())


_FIELD = re.compile(r"[^\W_][./][^\W_]{3}")
"""A field of a structure, as in ``header.stamp``."""


def _unit_of_words(words: Sequence[str]) -> str | None:
    joined = "".join(words)
    if len(words) > 1 and (unit := _UNIT_OF.get(words[-1])):
        rest = "".join(words[:-2] if words[-2] == "in" else words[:-1])
        if rest == "t" or _unit_of_joined(rest) == "":
            return unit
    if len(words) > 2 and words[1] == "since" and words[0] in _UNIT_OF:
        return _UNIT_OF[words[0]]  # ms since boot
    behind = re.fullmatch(r"(?:time|timestamp)(ns|nsec|us|usec|ms|msec|sec)", joined)
    return _UNIT_OF[behind[1]] if behind else _unit_of_joined(joined)


def hinted_unit(column: str) -> str | None:
    """Return the unit that a name states, even if it may not be one of times; None if none.

    Example:
        >>> hinted_unit("clock_us"), hinted_unit("recv [ms]"), hinted_unit("clk")
        ('us', 'ms', None)
    """
    unit = unit_of_times(column)
    if unit in NANOSECONDS:
        return unit
    words, inside = _read_name(column)
    if inside is not None:
        return _UNIT_OF.get(inside.lower())
    return _UNIT_OF.get(words[-1]) if len(words) > 1 else None


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
    """Return what a column counts by its name: min, h, day, week, month or year; None for others.

    Example:
        >>> calendar_unit("Hour"), calendar_unit("day of year"), calendar_unit("runtime [h]")
        ('h', 'day', None)
    """
    words, inside = _read_name(column)
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
        if (unit := _UNIT_OF.get(words[-1])) in _PARTS
    }
    return [
        (name, *parts[words[:-1]])
        for name, words in ends.items()
        if _UNIT_OF.get(words[-1]) == "s" and words[:-1] in parts
    ]


def _unit_of_joined(joined: str) -> str | None:
    if joined in _TIME_UNITS:
        return _TIME_UNITS[joined]
    if joined in _TIME_NAMES or joined.startswith("timesince"):
        return ""
    return "" if re.fullmatch(r"\w+(?:timestamps?|zeitstempel)", joined) else None


_CLOCK_WORDS = _set(
    "t ts time times timestamp timestamps stamp zeit zeitstempel temps tiempo tempo"
)


def own_times(column: str, names: Sequence[str]) -> str | None:
    """Return the column with the times of one column, where several have their own; None without.

    It is called ``time_x`` or ``x.time``, say; or the table starts with times, and it is the
    nearest column to the left that is called ``time.1`` or ``t2``, say.

    Args:
        column: The column.
        names: The columns of the table, in order.

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


def _is_clock(name: str) -> bool:
    """Whether a name is one of times, also with a number behind it."""
    bare = re.sub(r"(?<=[^\W\d])[\s._]?\d+$", "", name)
    return unit_of_times(bare) is not None


# Times by their values. ---------------------------------------------------------------------------

_FINEST, _COARSEST = 5e-5, 100.0
"""The shortest and the longest usual step of a plausible reading, in seconds."""

_FIRST_DATE, _LAST_DATE, _LONGEST = 9.4e8, 4.2e9, 1e8
"""Seconds since 1970 in the years 2000 and 2100, and the longest time since a start."""

_FEW = 4
"""The least number of values that tell anything without a name."""


def plausible_units(values: NDArray[Any]) -> list[str]:
    """Return the units in which times would have a plausible usual step, the likeliest first.

    A step is plausible from 50 µs to 100 s; fractions below 1 are fractions of seconds. Times are
    since a start, or dates since 1970; units that make them dates of this century exclude others.

    Args:
        values: Two times or more, as numbers.

    Example:
        >>> plausible_units(np.array([0.0, 0.01])), plausible_units(np.array([0, 10, 20]))
        (['s'], ['s', 'ms'])
        >>> plausible_units(np.array([1_700_000_000_000_000_000, 1_700_000_000_010_000_000]))
        ['ns']
    """
    with np.errstate(over="ignore"):
        step = float(np.median(np.abs(np.diff(values).astype(np.float64))))
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
    """Whether a column is probably one of times, by its name and its values.

    A name such as ``hour`` or ``day`` needs numbers that change. A name with a word such as
    ``clock`` or with a unit of time needs values that rise, or fall. Any other name needs values
    that rise in nearly even steps, and after the first column dates since 1970, or steps that are
    even up to rounding. In the first column they may fall, too. It is not the name of a counter or
    another quantity, unless it has a word such as ``time`` too. Numbers 0, 1, 2 and so on count
    rows.

    Args:
        column: Its name.
        values: Its values, as numbers.
        first: Whether it is the first column of the table.

    Example:
        >>> steady = np.arange(6) * 0.25
        >>> [looks_like_times(name, steady, first=True) for name in ("clk", "A", "odometer")]
        [True, True, False]
        >>> looks_like_times("A", np.arange(6), first=True)
        False
    """
    if values.dtype.kind not in "iuf" or len(values) < 2:
        return False
    if not np.isfinite(values.astype(np.float64)).all():
        return False
    if calendar_unit(column) is not None and (values != values[0]).any():
        return True
    name = _read_name(column)
    unit = None if name.unit is None else _UNIT_OF.get(name.unit.lower())
    hinted = bool(_HINTS & {*name.words}) or unit is not None
    with np.errstate(over="ignore"):
        steps = np.diff(values).astype(np.float64)
    if (hinted or first) and (steps < 0).all():  # the newest first
        values, steps = values[::-1], -steps[::-1]
    dated = hinted and dates_of_numbers(values) is not None
    if not (steps > 0).all() or ((steps == 1).all() and not dated):
        return False
    if name.words in _ABSCISSAS or unit_of_times(column) is not None:
        return True
    quantity = bool(_QUANTITIES & {*name.words}) or (name.unit is not None and unit is None)
    if _INDEX.fullmatch(column):
        first, quantity = True, not (values % 1).any()
    if hinted and (dated or not quantity):
        return True
    if quantity and not hinted:
        return False
    clock = unit is not None or bool(_CLOCKS & {*name.words})
    whole = clock or not quantity
    return _ticks(values, steps, rough=clock or (first and whole), whole=whole)


def _ticks(values: NDArray[Any], steps: NDArray[np.float64], *, rough: bool, whole: bool) -> bool:
    """Whether values rise in nearly even steps.

    If not ``rough``, they are dates or the steps are even up to rounding. If not ``whole``, numbers
    without fractions are not times either.
    """
    usual = float(np.median(steps))
    off = np.abs(steps - usual)
    if len(values) < _FEW or float((off <= 0.2 * usual).mean()) < 0.9:
        return False
    most = float(values[-1])
    dates = any(
        _FIRST_DATE <= most * NANOSECONDS[unit] / 1e9 <= _LAST_DATE
        for unit in plausible_units(values)
    )
    fractions = bool((values % 1).any())
    even = bool((off <= (0.02 * usual if fractions else max(0.02 * usual, 1))).all())
    return rough or dates or (even and (whole or fractions))


_PERIODS = _set(
    "dt deltat tsample sampletime samplingtime sampleperiod samplingperiod sampleinterval "
    "samplinginterval timestep stepsize deltax xincrement xincr xinc horizontalinterval abtastzeit"
)
_RATES = _set(
    "fs fps samplerate samplingrate samplefrequency samplingfrequency samplefreq samplingfreq "
    "framerate abtastrate abtastfrequenz"
)


def stated_period(name: str, value: float, *, single: bool) -> Fraction | None:
    """Return the seconds between samples that a constant states by its name; None for others.

    Args:
        name: The name, as ``dt``, ``sample_time [ms]`` or ``fs``.
        value: The value.
        single: Whether it is one number of a file, not a column.

    Example:
        >>> stated_period("dt", 0.1, single=False), stated_period("Fs [kHz]", 2.0, single=True)
        (Fraction(1, 10), Fraction(1, 2000))
    """
    if not 0 < value < math.inf:
        return None
    words, inside = _read_name(name)
    joined, exact = "".join(words), Fraction(repr(float(value)))
    if joined in _RATES:
        return 1 / (exact * (1000 if (inside or "").lower() == "khz" else 1))
    unit = _UNIT_OF.get((inside or "s").lower())
    if len(words) > 1 and _UNIT_OF.get(words[-1]) and "".join(words[:-1]) in _PERIODS:
        joined, unit = "".join(words[:-1]), _UNIT_OF[words[-1]]
    if unit is None or not (joined in _PERIODS or (single and joined in ("ts", "period"))):
        return None
    return exact * NANOSECONDS[unit] / NANOSECONDS["s"]


_SERIAL_DAYS = ((3e4, 8e4), (7.2e5, 7.7e5), (2.44e6, 2.49e6))
"""Days of dates from 1982 on, counted as spreadsheets, MATLAB and astronomers do."""

_DAY = 86400
_PARTS_OF_DAY = (0.01, 0.1, 0.5, 1, 2, 5, 10, 15, 20, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200)


def are_days(values: NDArray[Any]) -> bool:
    """Whether numbers are probably days and parts of days, and hardly seconds.

    Their usual step is a usual number of seconds in days, and as seconds it is no short decimal
    number. Either it is too short for seconds, or the numbers have the size of dates.

    Example:
        >>> are_days(45413.5 + np.arange(5) / 86400), are_days(45413.5 + np.arange(5) / 100)
        (True, False)
    """
    if values.dtype.kind != "f" or len(values) < 2 or not np.isfinite(values).all():
        return False
    low, high = float(values.min()), float(values.max())
    dates = any(begin <= low <= high <= end for begin, end in _SERIAL_DAYS)
    step = float(np.median(np.abs(np.diff(values)))) if -_LONGEST < low <= high < _LONGEST else 0.0
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
    """Whether a text looks like a date or a time of day in digits.

    Example:
        >>> is_date("2024-05-01T12:00Z"), is_date("12:00:01.5"), is_date("1.5")
        (True, True, False)
    """
    return _DATE.fullmatch(text.strip()) is not None


def dates_of_numbers(values: NDArray[Any]) -> NDArray[Any] | None:
    """Return the dates that numbers such as 20240501 or 20240501123000 write; None for others.

    Args:
        values: Numbers.

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
    """Whether numbers such as 115945 or 1159 are probably times of day without marks.

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
    rest, low = np.divmod(numbers, 100)
    hours, middle = np.divmod(rest, 100)
    clocks = [3600 * hours + 60 * middle + low] if (middle < 60).all() else []
    if (rest < 24).all():
        clocks.append(60 * rest + low)
    return any(
        (low < 60).all() and float(np.ptp(each)) <= 0.02 * float(each.min())
        for each in map(np.diff, clocks)
    )


# Objects and episodes. ----------------------------------------------------------------------------

_OBJECTS = _set(
    "name vehicle veh car truck agent actor entity object obj robot drone uav ego track "
    "participant pedestrian person player driver subject device unit episode ep eps run trial "
    "rollout trajectory traj session scenario scene experiment simulation sim env environment seed "
    "test testcase case demo trip flight aircraft vessel ship bot specimen dut part serial patient "
    "game match attempt replicate repetition fahrzeug objekt lauf versuch fahrt"
)
_ALONE = _set(
    "id name vehicle veh agent actor entity object obj robot drone uav participant player "
    "subject episode episodes ep eps run trial rollout trajectory traj session scenario experiment "
    "simulation sim env environment seed trip aircraft vessel specimen dut replicate repetition "
    "rep vin mmsi imei uuid guid icao24 callsign fahrzeug objekt lauf versuch fahrt"
)
"""Names of objects, episodes or runs without another word; others may be flags or quantities."""

_OF_TEXTS = _OBJECTS | _set(
    "topic metric sensor device host hostname instance machine station site tag tagname series "
    "variable var varname parameter param camera joint link body marker turbine pump motor user "
    "client customer patient units policy algorithm algo config variant frameid childframeid node "
    "address port pin register asset equipment wheel leg finger limb ecu mac ip peer axis "
    "filename sourcefile logfile signalname channel channelname"
) - _set("scene test case track")
"""Names of objects if their values are texts; numbers may be flags or quantities."""

_NUMBERED = _set("unit device driver flight case test scene demo bot patient game match attempt")
"""Names of objects if their values are numbers other than 0 and 1, which may be flags."""

_LAST = _set("seed episode rollout trajectory trial")
"""Names of episodes also behind other words: random seed."""

_KEY_WORDS = _set("id ids name no nr num number idx index uid uuid key label")
_COUNTERS = _set(
    "index step frameindex frameid stepindex stepid sampleindex sampleid rowindex rowid timeindex "
    "timestepindex globalindex messageid msgid packetid seqid sequenceid lineid"
)
"""Names of numbers of rows, which are not ids of objects."""

_VALUES = _set(
    "value values val wert messwert reading valeur valor varvalue tagvalue datavalue signalvalue "
    "numericvalue"
)
"""Names of the values in a table whose rows belong to different signals."""

_STATES = _set(
    "state status mode quality validity valid comment note notes remark severity flag gear color "
    "colour weather date datum day time timestamp zeit hour month year"
)
"""Words of names of texts that may change next to one signal."""


def names_objects(column: str, *, texts: bool = False) -> bool:
    """Whether a name is one of ids or names of objects, episodes or runs.

    Args:
        column: The name.
        texts: Whether the values are texts, which cannot be flags or quantities.

    Example:
        >>> [names_objects(name) for name in ("vehicle_id", "trackId", "episode_index", "run")]
        [True, True, True, True]
        >>> [names_objects(name) for name in ("frame_index", "index", "step", "pedestrian")]
        [False, False, False, False]
        >>> names_objects("sensor"), names_objects("sensor", texts=True)
        (False, True)
    """
    words = ["index" if word == "idx" else word for word in _read_name(column).words]
    joined = "".join(words)
    if texts and joined in _OF_TEXTS:
        return True
    if not words or joined in _COUNTERS or "".join(words[-2:]) in _COUNTERS - {"index", "step"}:
        return False
    if joined in _ALONE or (joined.endswith("id") and joined[:-2] in _OBJECTS):
        return True
    if len(words) < 2:
        return False
    if words[-1] in _LAST:
        return True
    return words[-1] in ("id", "index") or (words[-1] in _KEY_WORDS and words[-2] in _OBJECTS)


def may_tell_objects(
    column: str, read: Collection[str], *, timed: bool, first: bool = False
) -> bool:
    """Whether a column may tell objects or episodes apart, by its name; its values decide.

    Args:
        column: The name.
        read: The columns that formulas read.
        timed: Whether the table has times; if not, times and numbers of rows may start again.
        first: Whether it is the first column of the table.
    """
    if names_objects(column) or names_objects(column, texts=True) or _ends_episodes(column):
        return True
    words = {*_read_name(column).words}
    if words <= _NUMBERED or "run" in words or (_reads_values(read) and not _STATES & words):
        return True
    if timed:
        return False
    joined = "".join(_read_name(column).words)
    return first or _counts_time(column) or bool(_INDEX.fullmatch(column)) or joined in _ROWS


def _counts_time(column: str) -> bool:
    words = _read_name(column).words
    return unit_of_times(column) is not None or bool(_CLOCKS & {*words}) or words == ("clk",)


def _reads_values(read: Collection[str]) -> bool:
    return any("".join(_read_name(name).words) in _VALUES for name in read)


class Objects(NamedTuple):
    """Evidence that the rows of a table belong to several objects or episodes.

    Attributes:
        column: The column that tells them apart; empty if it is not known.
        values: Its values, in the order in which they occur; empty if it is not known.
        row: The row at which another episode starts, by a column of flags or of a count that
            starts again; None if the values tell objects apart.
    """

    column: str
    values: tuple[str, ...]
    row: int | None = None


def objects_in(
    cells: Mapping[str, NDArray[Any]],
    times: NDArray[Any] | None = None,
    filled: Sequence[NDArray[np.bool_]] = (),
    read: Collection[str] = (),
    first: str | None = None,
) -> Objects | None:
    """Return the evidence that a table holds several objects or episodes; None if there is none.

    Rows that record different variables each are not several objects.

    Args:
        cells: The columns that no formula reads: numbers, or texts where an empty one is no value.
        times: The time of each row; None if the table has no times.
        filled: For each variable, the rows in which it has a value.
        read: The columns that formulas read. Next to a column ``value``, any column of texts that
            are not states names signals.
        first: The first column of the table, which may hold times by any name.

    Example:
        >>> ids = {"vehicle_id": np.array([0, 1, 0, 1])}
        >>> objects_in(ids)
        Objects(column='vehicle_id', values=('0', '1'), row=None)
        >>> objects_in({"gear": np.array([1, 1, 2, 2])}) is None
        True
        >>> objects_in({"step": np.array([0, 1, 0, 1])})
        Objects(column='step', values=(), row=2)
    """
    keys = {name: _keys(values) for name, values in cells.items()}
    several = {
        name: codes
        for name, codes in keys.items()
        if codes is not None and _recur(codes) and _share(codes, filled)
    }
    for name, codes in several.items():
        if _tells_objects(name, cells[name], read):
            return Objects(name, _values(cells[name], codes))
    rising = times is not None and bool((times[1:] > times[:-1]).all())
    for name, values in cells.items():
        row = _next_episode(name, values, timed=rising)
        if row is None and times is None:
            row = _restart(name, values, first=name == first)
        if row is not None:
            return Objects(name, (), row)
    if times is None or len(times) < 2 or rising:
        return None
    apart = {name: codes for name, codes in several.items() if _ordered_within(codes, times)}
    if apart:
        name = min(apart, key=lambda n: (not names_objects(n), int(apart[n].max())))
        return Objects(name, _values(cells[name], apart[name]))
    return Objects("", ()) if _mixed(cells, times, filled) else None


def _mixed(
    cells: Mapping[str, NDArray[Any]], times: NDArray[Any], filled: Sequence[NDArray[np.bool_]]
) -> bool:
    """Whether other columns change where times repeat or go back."""
    late, back = times[1:] <= times[:-1], times[1:] < times[:-1]
    if late.all() and back.any():  # the newest row comes first
        return False
    both = np.zeros(len(late), bool) if filled else np.ones(len(late), bool)
    for here in filled:
        both |= here[1:] & here[:-1]
    evident = late & (both | back)
    changes = (_changes(values) for values in cells.values() if not _counts_rows(values))
    return any((evident & change).any() for change in changes)


def _tells_objects(name: str, values: NDArray[Any], read: Collection[str]) -> bool:
    """Whether values that occur again are names or numbers of objects."""
    if names_objects(name):
        return True
    named = _read_name(name).words
    words = {*named}
    if values.dtype.kind not in "OUT":
        numbered = (len(named) == 1 and words <= _NUMBERED) or named[-1:] == ("run",)
        return numbered and not {*values.tolist()} <= {0, 1}
    if {str(value).strip().lower() for value in values.tolist()} <= _FLAGS:
        return False
    if names_objects(name, texts=True):
        return True
    if all(map(is_date, {*map(str, values.tolist())} - {""})):
        return False
    return not _STATES & words and (_reads_values(read) or _alternate(values))


def _alternate(values: NDArray[Any]) -> bool:
    """Whether texts change in most rows, as names of objects do whose records are interleaved."""
    there = values[values != ""]
    if len(there) < _MANY_TEXTS:
        return False
    _, counts = np.unique(there, return_counts=True)
    changes = float((there[1:] != there[:-1]).mean())
    return (
        changes >= 0.5 and len(counts) > 1 and int(counts.min()) > 1 and len(counts) <= _FEW_TEXTS
    )


_MANY_TEXTS, _FEW_TEXTS = 6, 50
"""The fewest texts, and the most different ones, that may name objects by their order alone."""


_FLAGS = _set("true false on off yes no ok good bad ja nein 0 1") | {""}

_LAST_ROWS = _set(
    "terminated truncated terminal terminals timeout timeouts islast isterminal nextdone "
    "episodeend episodeends episodedone endofepisode lastinepisode"
)
_FIRST_ROWS = _set("isfirst episodestart episodestarts firstinepisode")
_DONE = _set("done dones")
"""Names of flags of the last or the first row of an episode; ``done`` may be another flag."""


def _ends_episodes(column: str) -> bool:
    return "".join(_read_name(column).words) in _LAST_ROWS | _FIRST_ROWS | _DONE


def _next_episode(name: str, values: NDArray[Any], *, timed: bool) -> int | None:
    """Return the first row of another episode by a flag of last or first rows; None without one."""
    joined = "".join(_read_name(name).words)
    if not _ends_episodes(name) or (timed and joined in _DONE):
        return None
    texts = [str(value).strip().lower() for value in values.tolist()]
    if not {*texts} <= {"true", "false", "0", "1", "0.0", "1.0"}:
        return None
    flags = np.array([text in ("true", "1", "1.0") for text in texts])
    if joined in _FIRST_ROWS:
        (rows,) = np.nonzero(flags[1:])
    else:
        (rows,) = np.nonzero(flags[:-1] & ~flags[1:])
    return int(rows[0]) + 1 if len(rows) else None


_ROWS = _set(
    "step steps timestep timesteps frame frames index idx row rows sample samples stepindex "
    "frameindex sampleindex rowindex timeindex timestepindex stepid sampleid rowid"
)
"""Names of numbers of rows."""


def _restart(name: str, values: NDArray[Any], *, first: bool) -> int | None:
    """Return the row at which times or numbers of rows start again; None if they do not.

    Args:
        name: The column.
        values: Its values.
        first: Whether it is the first column of a table, which may hold times by any name.
    """
    if values.dtype.kind not in "iuf" or len(values) < 4 or calendar_unit(name) is not None:
        return None
    if not np.isfinite(values.astype(np.float64)).all():
        return None
    with np.errstate(over="ignore"):
        steps = np.diff(values.astype(np.float64))
    (falls,) = np.nonzero(steps < 0)
    if not len(falls) or len(falls) == len(steps):
        return None
    words = _read_name(name)
    row = int(falls[0]) + 1
    if unit_of_times(name) is not None:
        return row
    counts = bool(_INDEX.fullmatch(name)) or "".join(words.words) in _ROWS
    rises = steps[steps >= 0]
    usual = float(np.median(rises))
    even = float((np.abs(rises - usual) <= 0.2 * usual).mean()) >= 0.9
    if not (rises > 0).all() or not even or (np.abs(values[falls + 1] - values[0]) >= usual).any():
        return None
    if counts:
        return row
    shortest = int(np.diff([0, *(falls + 1), len(values)]).min())
    quantity = bool(_QUANTITIES & {*words.words}) or words.unit is not None
    return row if _counts_time(name) or (first and not quantity and shortest >= _FEW) else None


def _keys(values: NDArray[Any]) -> NDArray[np.intp] | None:
    """Numbers of the values in a column of texts or integers, -1 without one; None for others."""
    kind = values.dtype.kind
    if kind == "f":
        absent = np.isnan(values)
        if (values[~absent] % 1).any() or np.isinf(values).any():
            return None
    elif kind in "iu":
        absent = np.zeros(len(values), bool)
    elif kind in "OUT":
        values = np.array([str(value) for value in values.tolist()])
        absent = values == ""
    else:
        return None
    codes = np.full(len(values), -1)
    codes[~absent] = np.unique(values[~absent], return_inverse=True)[1]
    return codes


def _recur(codes: NDArray[np.intp]) -> bool:
    """Whether there are several values, most of which occur more than once."""
    counts = np.bincount(codes[codes >= 0])
    return len(counts) > 1 and 2 * int((counts == 1).sum()) <= len(counts)


def _share(codes: NDArray[np.intp], filled: Collection[NDArray[np.bool_]]) -> bool:
    """Whether a variable has values in the rows of several objects."""
    return not filled or any(len(np.unique(codes[here & (codes >= 0)])) > 1 for here in filled)


def _ordered_within(codes: NDArray[np.intp], times: NDArray[Any]) -> bool:
    """Whether the times of each value rise, or fall."""
    if (codes < 0).any():
        return False
    order = np.argsort(codes, kind="stable")
    same = np.diff(codes[order]) == 0
    later, before = times[order][1:][same], times[order][:-1][same]
    return bool((later > before).all() or (later < before).all())


def _counts_rows(values: NDArray[Any]) -> bool:
    """Whether numbers rise, or fall, from each row to the next."""
    if values.dtype.kind not in "iufmM":
        return False
    return bool((values[1:] > values[:-1]).all() or (values[1:] < values[:-1]).all())


def _changes(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Whether each row has another value than the one before."""
    changed = values[1:] != values[:-1]
    if values.dtype.kind == "f":
        changed &= ~(np.isnan(values[1:]) & np.isnan(values[:-1]))
    return np.asarray(changed, bool)


def _values(cells: NDArray[Any], codes: NDArray[np.intp]) -> tuple[str, ...]:
    """The texts of the values in the order in which they occur."""
    _, places = np.unique(codes[codes >= 0], return_index=True)
    rows = np.nonzero(codes >= 0)[0][np.sort(places)]
    found = cells[rows]
    if found.dtype.kind == "f":
        found = found.astype(np.int64)
    return tuple(str(value) for value in found.tolist())
