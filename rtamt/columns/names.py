"""Names of the columns of a table: times with their unit, and parts of dates.

To add a name of a column of times, or of a unit in it, change `unit_of_times` and its tables. Files
and data frames both use them.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import NamedTuple


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
