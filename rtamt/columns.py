"""Roles of the columns of a table: times with their unit, and ids of objects or episodes."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "NANOSECONDS",
    "Objects",
    "dates_of_numbers",
    "has_plain_time_name",
    "hinted_unit",
    "looks_like_times",
    "name_words",
    "names_objects",
    "objects_in",
    "plausible_units",
    "split_times",
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

    A name with a word such as ``clock`` or with a unit of time needs values that rise, or fall. Any
    other name needs values that rise in nearly even steps, and after the first column dates since
    1970, or steps that are even up to rounding. In the first column they may fall, too. It is not
    the name of a counter or another quantity, unless it has a word such as ``time`` too. Numbers
    0, 1, 2 and so on count rows.

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


# Objects and episodes. ----------------------------------------------------------------------------

_OBJECTS = _set(
    "name vehicle veh car truck agent actor entity object obj robot drone uav ego track "
    "participant pedestrian person player driver subject device unit episode ep run trial rollout "
    "trajectory traj session scenario scene experiment simulation sim env environment seed test "
    "testcase case demo fahrzeug objekt lauf versuch"
)
_ALONE = _set(
    "id name vehicle veh agent actor entity object obj robot drone uav participant player "
    "episode ep run trial rollout trajectory traj session scenario experiment simulation sim env "
    "environment seed fahrzeug objekt lauf versuch"
)
"""Names of objects, episodes or runs without another word; others may be flags or quantities."""

_KEY_WORDS = _set("id ids name no nr num number idx index uid uuid key label")
_COUNTERS = _set(
    "index step frameindex frameid stepindex stepid sampleindex sampleid rowindex rowid timeindex "
    "timestepindex globalindex messageid msgid packetid seqid sequenceid lineid"
)
"""Names of numbers of rows, which are not ids of objects."""


def names_objects(column: str) -> bool:
    """Whether a name is one of ids or names of objects, episodes or runs.

    Example:
        >>> [names_objects(name) for name in ("vehicle_id", "trackId", "episode_index", "run")]
        [True, True, True, True]
        >>> [names_objects(name) for name in ("frame_index", "index", "step", "pedestrian")]
        [False, False, False, False]
    """
    words = _read_name(column).words
    joined = "".join(words)
    if not words or joined in _COUNTERS or "".join(words[-2:]) in _COUNTERS - {"index", "step"}:
        return False
    if joined in _ALONE or (joined.endswith("id") and joined[:-2] in _OBJECTS):
        return True
    if len(words) < 2:
        return False
    return words[-1] in ("id", "index") or (words[-1] in _KEY_WORDS and words[-2] in _OBJECTS)


class Objects(NamedTuple):
    """Evidence that the rows of a table belong to several objects or episodes.

    Attributes:
        column: The column that tells them apart; empty if it is not known.
        values: Its values, in the order in which they occur; empty if it is not known.
    """

    column: str
    values: tuple[str, ...]


def objects_in(
    cells: Mapping[str, NDArray[Any]],
    times: NDArray[Any] | None = None,
    filled: Sequence[NDArray[np.bool_]] = (),
) -> Objects | None:
    """Return the evidence that a table holds several objects or episodes; None if there is none.

    Rows that record different variables each are not several objects.

    Args:
        cells: The columns that no formula reads: numbers, or texts where an empty one is no value.
        times: The time of each row; None if the table has no times.
        filled: For each variable, the rows in which it has a value.

    Example:
        >>> ids = {"vehicle_id": np.array([0, 1, 0, 1])}
        >>> objects_in(ids)
        Objects(column='vehicle_id', values=('0', '1'))
        >>> objects_in({"gear": np.array([1, 1, 2, 2])}) is None
        True
    """
    keys = {name: _keys(values) for name, values in cells.items()}
    for name, codes in keys.items():
        if codes is not None and names_objects(name) and _recur(codes) and _share(codes, filled):
            return Objects(name, _values(cells[name], codes))
    if times is None or len(times) < 2:
        return None
    late, back = times[1:] <= times[:-1], times[1:] < times[:-1]
    if not late.any():
        return None
    apart = {
        name: codes
        for name, codes in keys.items()
        if codes is not None
        and _recur(codes)
        and _share(codes, filled)
        and _ordered_within(codes, times)
    }
    if apart:
        name = min(apart, key=lambda n: (not names_objects(n), int(apart[n].max())))
        return Objects(name, _values(cells[name], apart[name]))
    if late.all() and back.any():  # the newest row comes first
        return None
    both = np.zeros(len(late), bool) if filled else np.ones(len(late), bool)
    for here in filled:
        both |= here[1:] & here[:-1]
    evident = late & (both | back)
    changes = (_changes(values) for values in cells.values() if not _counts_rows(values))
    if any((evident & change).any() for change in changes):
        return Objects("", ())
    return None


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
