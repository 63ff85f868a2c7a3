"""Objects, episodes and runs whose rows are in one table, by names, values and times."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.columns.times import (
    CLOCKS,
    INDEX,
    QUANTITIES,
    calendar_unit,
    is_date,
    median,
    read_name,
    unit_of_times,
    word_set,
)

_OBJECTS = word_set(
    "name vehicle veh car truck agent actor entity object obj robot drone uav ego track "
    "participant pedestrian person player driver subject device unit episode ep eps run trial "
    "rollout trajectory traj session scenario scene experiment simulation sim env environment seed "
    "test testcase case demo trip flight aircraft vessel ship bot specimen dut part serial patient "
    "game match attempt replicate repetition fahrzeug objekt lauf versuch fahrt"
)
_ALONE = word_set(
    "id name vehicle veh agent actor entity object obj robot drone uav participant player "
    "subject episode episodes ep eps run trial rollout trajectory traj session scenario experiment "
    "simulation sim env environment seed trip aircraft vessel specimen dut replicate repetition "
    "rep vin mmsi imei uuid guid icao24 callsign fahrzeug objekt lauf versuch fahrt"
)
"""Names of objects, episodes or runs without another word; others may be flags or quantities."""

_OF_TEXTS = _OBJECTS | word_set(
    "topic metric sensor device host hostname instance machine station site tag tagname series "
    "variable var varname parameter param camera joint link body marker turbine pump motor user "
    "client customer patient units policy algorithm algo config variant frameid childframeid node "
    "address port pin register asset equipment wheel leg finger limb ecu mac ip peer axis "
    "filename sourcefile logfile signalname channel channelname"
) - word_set("scene test case track")
"""Names of objects if their values are texts; numbers may be flags or quantities."""

_NUMBERED = word_set(
    "unit device driver flight case test scene demo bot patient game match attempt"
)
"""Names of objects if their values are numbers other than 0 and 1, which may be flags."""

_LAST = word_set("seed episode rollout trajectory trial")
"""Names of episodes even after other words: random seed."""

_KEY_WORDS = word_set("id ids name no nr num number idx index uid uuid key label")
_COUNTERS = word_set(
    "index step frameindex frameid stepindex stepid sampleindex sampleid rowindex rowid timeindex "
    "timestepindex globalindex messageid msgid packetid seqid sequenceid lineid"
)
"""Numbers of rows, which are not ids of objects."""

_VALUES = word_set(
    "value values val wert messwert reading valeur valor varvalue tagvalue datavalue signalvalue "
    "numericvalue"
)
"""The values in a table whose rows belong to different signals."""

_STATES = word_set(
    "state status mode quality validity valid comment note notes remark severity flag gear color "
    "colour weather date datum day time timestamp zeit hour month year"
)
"""Words of texts that may change next to one signal."""


def names_objects(column: str, *, texts: bool = False) -> bool:
    """Return whether a name is an id or a name of objects, episodes or runs.

    Example:
        >>> [names_objects(name) for name in ("vehicle_id", "trackId", "episode_index", "run")]
        [True, True, True, True]
        >>> [names_objects(name) for name in ("frame_index", "index", "step", "pedestrian")]
        [False, False, False, False]
        >>> names_objects("sensor"), names_objects("sensor", texts=True)
        (False, True)
    """
    words = ["index" if word == "idx" else word for word in read_name(column).words]
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
    """Return whether a column may separate objects or episodes, by its name; its values decide.

    Without times, times and numbers of rows may start again.
    """
    if names_objects(column) or names_objects(column, texts=True) or flagged_row(column):
        return True
    words = {*read_name(column).words}
    if words <= _NUMBERED or "run" in words or (_reads_values(read) and not _STATES & words):
        return True
    if timed:
        return False
    joined = "".join(read_name(column).words)
    return first or _counts_time(column) or bool(INDEX.fullmatch(column)) or joined in _ROWS


def _counts_time(column: str) -> bool:
    words = read_name(column).words
    return unit_of_times(column) is not None or bool(CLOCKS & {*words}) or words == ("clk",)


def _reads_values(read: Collection[str]) -> bool:
    return any("".join(read_name(name).words) in _VALUES for name in read)


class Objects(NamedTuple):
    """Evidence that the rows of a table belong to several objects or episodes."""

    column: str  # the column that separates them; empty if unknown
    values: tuple[str, ...]  # its values, in order of appearance; empty if unknown
    # the row at which another episode starts, by a column of flags or of a count that starts
    # again; None if the values separate objects
    row: int | None = None


def objects_in(
    cells: Mapping[str, NDArray[Any]],
    times: NDArray[Any] | None = None,
    filled: Sequence[NDArray[np.bool_]] = (),
    read: Collection[str] = (),
    first: str | None = None,
) -> Objects | None:
    """Return the evidence that a table has several objects or episodes; None if there is none.

    Rows that record different variables each are not several objects. ``cells`` has the columns
    that no formula reads, ``filled`` the rows with a value of each variable, and ``read`` the
    columns that formulas read: next to a column ``value``, any column of texts that are not states
    names signals.

    Example:
        >>> objects_in({"vehicle_id": np.array([0, 1, 0, 1])})
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
        if tells_objects(name, cells[name], read):
            return Objects(name, _values(cells[name], codes))
    rising = times is not None and bool((times[1:] > times[:-1]).all())
    for name, values in cells.items():
        row = next_episode(name, values, timed=rising)
        if row is None and times is None:
            row = count_restart(name, values, first=name == first)
        if row is not None:
            return Objects(name, (), row)
    if times is None or len(times) < 2 or rising:
        return None
    ordered = {name: codes for name, codes in several.items() if _ordered_within(codes, times)}
    if ordered:
        name = min(ordered, key=lambda n: (not names_objects(n), int(ordered[n].max())))
        return Objects(name, _values(cells[name], ordered[name]))
    return Objects("", ()) if _mixed(cells, times, filled) else None


def _mixed(
    cells: Mapping[str, NDArray[Any]], times: NDArray[Any], filled: Sequence[NDArray[np.bool_]]
) -> bool:
    """Return whether other columns change at times that repeat or go back."""
    late, back = times[1:] <= times[:-1], times[1:] < times[:-1]
    if late.all() and back.any():  # the newest row comes first
        return False
    both = np.zeros(len(late), bool) if filled else np.ones(len(late), bool)
    for here in filled:
        both |= here[1:] & here[:-1]
    evident = late & (both | back)
    changes = (_changes(values) for values in cells.values() if not _counts_rows(values))
    return any((evident & change).any() for change in changes)


def tells_objects(name: str, values: NDArray[Any], read: Collection[str]) -> bool:
    """Return whether values that occur again are names or numbers of objects.

    Example:
        >>> plates = np.array(["P3", "P7", "P12"] * 2)
        >>> tells_objects("plate", plates, ["speed"]), tells_objects("test", np.arange(3), [])
        (True, True)
        >>> tells_objects("plate", np.sort(plates), ["speed"])
        False
    """
    if names_objects(name):
        return True
    named = read_name(name).words
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
    """Return whether texts change in most rows, as names of interleaved objects do."""
    there = values[values != ""]
    if len(there) < _MANY_TEXTS:
        return False
    _, counts = np.unique(there, return_counts=True)
    changes = float((there[1:] != there[:-1]).mean())
    return (
        changes >= 0.5 and len(counts) > 1 and int(counts.min()) > 1 and len(counts) <= _FEW_TEXTS
    )


_MANY_TEXTS, _FEW_TEXTS = 6, 50
"""The fewest texts, and the most different ones, that name objects by their order alone."""


_FLAGS = word_set("true false on off yes no ok good bad ja nein 0 1") | {""}

_LAST_ROWS = word_set(
    "terminated truncated terminal terminals timeout timeouts islast isterminal nextdone "
    "episodeend episodeends episodedone endofepisode lastinepisode"
)
_FIRST_ROWS = word_set("isfirst episodestart episodestarts firstinepisode")
_DONE = word_set("done dones")
"""Flags of the last or the first row of an episode; ``done`` may be another flag."""


def flagged_row(column: str) -> str:
    """Return which row of an episode a column of flags marks by its name; empty for others.

    Example:
        >>> flagged_row("is_first"), flagged_row("terminated"), flagged_row("speed")
        ('first', 'last', '')
    """
    joined = "".join(read_name(column).words)
    if joined in _FIRST_ROWS:
        return "first"
    return "last" if joined in _LAST_ROWS | _DONE else ""


_TRUE, _FALSE = {"true", "1", "1.0"}, {"false", "0", "0.0", "", "nan"}
"""The texts of flags in lower case; a flag that is not written is not set."""


def are_flags(texts: Collection[str]) -> bool:
    """Return whether texts in lower case are flags of the last or the first row of an episode."""
    return {*texts} <= _TRUE | _FALSE


def next_episode(name: str, values: NDArray[Any], *, timed: bool) -> int | None:
    """Return the first row of another episode by a flag of last or first rows; None without one."""
    joined = "".join(read_name(name).words)
    if not flagged_row(name) or (timed and joined in _DONE):
        return None
    texts = [str(value).strip().lower() for value in values.tolist()]
    if not are_flags(texts):
        return None
    flags = np.array([text in _TRUE for text in texts], bool)
    if flagged_row(name) == "first":
        (rows,) = np.nonzero(flags[1:])
    else:
        (rows,) = np.nonzero(flags[:-1] & ~flags[1:])
    return int(rows[0]) + 1 if len(rows) else None


_ROWS = word_set(
    "step steps timestep timesteps frame frames index idx row rows sample samples stepindex "
    "frameindex sampleindex rowindex timeindex timestepindex stepid sampleid rowid"
)
"""Numbers of rows."""


def missing_row(name: str, values: NDArray[Any]) -> int | None:
    """Return the row before which rows are missing by the numbers of rows; None if there is none.

    Example:
        >>> missing_row("frame", np.array([0, 1, 5, 6])), missing_row("frame", np.array([0, 5, 10]))
        (2, None)
    """
    if not (INDEX.fullmatch(name) or "".join(read_name(name).words) in _ROWS):
        return None
    if values.dtype.kind not in "iuf" or len(values) < 3:
        return None
    steps = np.diff(values.astype(np.float64))
    if not (steps > 0).all() or (steps % 1).any():
        return None
    (far,) = np.nonzero(steps > steps.min())
    return int(far[0]) + 1 if len(far) else None


_FEW_ROWS = 4
"""The minimum number of rows of a run in times under any name."""


def count_restart(name: str, values: NDArray[Any], *, first: bool) -> int | None:
    """Return the row at which times or numbers of rows start again; None if they do not."""
    if values.dtype.kind not in "iuf" or len(values) < 4 or calendar_unit(name) is not None:
        return None
    if not np.isfinite(values.astype(np.float64)).all():
        return None
    with np.errstate(over="ignore"):
        steps = np.diff(values.astype(np.float64))
    (falls,) = np.nonzero(steps < 0)
    if not len(falls) or len(falls) == len(steps):
        return None
    words = read_name(name)
    row = int(falls[0]) + 1
    if unit_of_times(name) is not None:
        return row
    counts = bool(INDEX.fullmatch(name)) or "".join(words.words) in _ROWS
    rises = steps[steps >= 0]
    usual = float(np.median(rises))
    even = float((np.abs(rises - usual) <= 0.2 * usual).mean()) >= 0.9
    if not (rises > 0).all() or not even or (np.abs(values[falls + 1] - values[0]) >= usual).any():
        return None
    if counts:
        return row
    shortest = int(np.diff([0, *(falls + 1), len(values)]).min())
    quantity = bool(QUANTITIES & {*words.words}) or words.unit is not None
    return row if _counts_time(name) or (first and not quantity and shortest >= _FEW_ROWS) else None


def _keys(values: NDArray[Any]) -> NDArray[np.intp] | None:
    """Return numbers of the values of texts or integers, -1 without a value; None for others."""
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
    """Return whether there are several values, most of which occur more than once."""
    counts = np.bincount(codes[codes >= 0])
    return len(counts) > 1 and 2 * int((counts == 1).sum()) <= len(counts)


def _share(codes: NDArray[np.intp], filled: Collection[NDArray[np.bool_]]) -> bool:
    """Return whether a variable has values in the rows of several objects."""
    return not filled or any(len(np.unique(codes[here & (codes >= 0)])) > 1 for here in filled)


def _ordered_within(codes: NDArray[np.intp], times: NDArray[Any]) -> bool:
    """Return whether the times of each value rise, or fall."""
    if (codes < 0).any():
        return False
    order = np.argsort(codes, kind="stable")
    same = np.diff(codes[order]) == 0
    later, before = times[order][1:][same], times[order][:-1][same]
    return bool((later > before).all() or (later < before).all())


def _counts_rows(values: NDArray[Any]) -> bool:
    """Return whether numbers rise, or fall, from each row to the next."""
    if values.dtype.kind not in "iufmM":
        return False
    return bool((values[1:] > values[:-1]).all() or (values[1:] < values[:-1]).all())


def _changes(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Return whether each row differs from the previous one."""
    changed = values[1:] != values[:-1]
    if values.dtype.kind == "f":
        changed &= ~(np.isnan(values[1:]) & np.isnan(values[:-1]))
    return np.asarray(changed, bool)


def _values(cells: NDArray[Any], codes: NDArray[np.intp]) -> tuple[str, ...]:
    """Return the texts of the values in order of appearance."""
    _, places = np.unique(codes[codes >= 0], return_index=True)
    rows = np.nonzero(codes >= 0)[0][np.sort(places)]
    values = cells[rows]
    if values.dtype.kind == "f":
        values = values.astype(np.int64)
    return tuple(str(value) for value in values.tolist())


_NEAR = 0.1
"""The part of the usual step by which the lengths of two rounds may differ."""

_MOST, _ROUNDS, _REGULAR = 50, 3, 0.9
"""The most objects, the fewest rounds, and the part of the rows that must follow the pattern."""

_SIGNALS = word_set(
    "state status mode phase stage quality flag gear counter count cnt seq sequence alive rolling "
    "cycle tick ticks toggle"
)
"""Words of numbers that go round in one signal: states, and counters that start again."""


def turns_in(times: NDArray[Any]) -> int:
    """Return the number of rows in a round if uneven times repeat round by round; otherwise 0.

    Example:
        >>> (
        ...     turns_in(np.array([0, 1, 4, 5, 8, 9])),
        ...     turns_in(np.arange(6)),
        ...     turns_in(np.arange(6) ** 2),
        ... )
        (2, 0, 0)
    """
    kind = times.dtype.kind
    numbers = times.astype(np.int64 if kind in "mM" else np.float64)
    numbers = (numbers - numbers[:1]).astype(np.float64)
    room = _NEAR * median(np.diff(numbers)) if len(numbers) > 1 else 0.0
    for turns in range(1, min(_MOST, len(numbers) // _ROUNDS) + 1):
        rounds = numbers[turns:] - numbers[:-turns]
        if float((np.abs(rounds - median(rounds)) <= room).mean()) >= _REGULAR:
            return turns if turns > 1 else 0
    return 0


def objects_by_turns(cells: Mapping[str, NDArray[Any]], turns: int) -> Objects | None:
    """Return the column of whole numbers whose values take turns; None if there is none.

    Values 0 and 1, which may be flags, and names of states or counters are not evidence.

    Example:
        >>> objects_by_turns({"zone": np.array([3, 7, 3, 7, 3, 7])}, 2)
        Objects(column='zone', values=('3', '7'), row=None)
    """
    for name, values in cells.items():
        if values.dtype.kind not in "iuf" or _SIGNALS & {*read_name(name).words}:
            continue
        first = values[:turns].astype(np.float64)
        distinct = len({*first.tolist()}) == turns and not {*first.tolist()} <= {0, 1}
        if not distinct or (first % 1 != 0).any():  # nan and infinity too
            continue
        if float((values[turns:] == values[:-turns]).mean()) >= _REGULAR:
            return Objects(name, tuple(str(int(value)) for value in first.tolist()))
    return None
