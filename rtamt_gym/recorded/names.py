"""The columns of variables and of times, and the defaults of variables without a column.

To change when a variable gets its default, change three places: this module for files and bags, and
`rtamt.inputs.samples` and `rtamt.inputs.event_reader` for the arguments of callers.
`Specification.defaults` lists the variables that have one.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import rtamt
from rtamt import InputError
from rtamt.columns import (
    has_plain_time_name,
    name_words,
    read_name,
    split_times,
    unit_of_times,
)
from rtamt.errors import near_name, nearest
from rtamt_gym.checks.names import listed, listing
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Recording, TimePart
from rtamt_gym.recorded.times import DATE_NAMES, TIME
from rtamt_gym.tables import number

VARIABLE, VALUE = "variable", "value"
"""The columns that a recording has, beside the time, where each row is one event."""


def are_long(names: Collection[str], variables: Collection[str]) -> bool:
    """Return whether each row of a recording with these columns is one event."""
    return {VARIABLE, VALUE} <= {*names} and not {*variables} <= {*names}


def long_columns(
    names: Collection[str], variables: Collection[str], columns: Columns
) -> tuple[str, str] | None:
    """Return the columns of names and values if each row is one event; otherwise, None."""
    if columns.long is not None:
        return columns.long
    return (VARIABLE, VALUE) if are_long(names, variables) else None


def recorded_variables(
    names: Collection[str], variables: Sequence[str], columns: Columns
) -> list[str]:
    """Return the variables that a recording has, or must have because they have no default."""
    return [
        name
        for name in variables
        if columns.column(name) in names or name in columns.signals or name not in columns.starts
    ]


def check_recorded(
    source: str, names: Sequence[str], variables: Sequence[str], columns: Columns
) -> None:
    """Raise InputError if a recording has no variable of a specification with defaults only."""
    if not variables or recorded_variables(names, variables, columns):
        return
    needed = [columns.column(name) for name in variables]
    near = next(filter(None, (nearest(column, names) for column in needed)), "")
    raise InputError(
        f"{source}: expected a record of {', '.join(map(repr, needed))}, got none: defaults alone "
        f"are not a trace; it has {listed(names, needed[0])}{near}"
    )


def check_near(
    source: str, names: Sequence[str], variables: Sequence[str], columns: Columns
) -> None:
    """Raise InputError if a variable with a default may have a misspelt column.

    No other variable reads such a column.
    """
    read = {columns.column(name) for name in variables} | {columns.time, TIME}
    free = [name for name in names if name not in read]
    there = recorded_variables(names, variables, columns)
    for name in variables:
        if name in there or name in columns.defaults:
            continue
        near = near_name(name, free)
        if near is not None:
            signal = shlex.quote(f"{name}={near}")
            raise InputError(
                f"{source}: no column '{name}', which has a default, but '{near}'; give --signal "
                f"{signal} to read it{_if_in_unit(near)}, or --default {name} to take the default "
                f"{number(columns.starts[name])}"
            )


def misspellings(columns: Columns, variables: Sequence[str], names: Sequence[str]) -> Spellings:
    """Return the columns that may hold values of a variable under a misspelt name."""
    read = [columns.column(name) for name in variables if columns.signals.get(name) != name]
    return [
        (column, name)
        for column in dict.fromkeys(read)
        for name in dict.fromkeys(names)
        if near_name(column, [name]) and not _other_axis(column, name)
    ]


def misspelt_value(column: str, name: str) -> str:
    """Return the error text for a row with a value under a misspelt column name."""
    signal = shlex.quote(f"{column}={column}")
    return (
        f"no value of '{column}', but one of '{name}', which nothing reads. Write one name in all "
        f"rows, or give --signal {signal} if '{name}' is another signal."
    )


Spellings = list[tuple[str, str]]
"""Columns of variables, each with a column whose name may be its misspelt name."""


def _other_axis(column: str, name: str) -> bool:
    """Return whether one short word differs, as in ``acc_x`` and ``acc_y``."""
    words = [name_words(text) for text in (column, name)]
    if len(words[0]) != len(words[1]):
        return False
    unlike = [pair for pair in zip(*words, strict=True) if pair[0] != pair[1]]
    return len(words[0]) > 1 and len(unlike) == 1 and max(map(len, unlike[0])) <= _SHORT


_SHORT = 2
"""The most letters of a word that names an axis or a side: x, y, fl, fr."""


def needed_columns(
    recording: Recording, variables: Sequence[str], columns: Columns, if_events: str = ""
) -> list[str]:
    """Return the columns of variables, each once."""
    for variable in columns.signals:
        if variable not in variables:
            raise InputError(
                f"--signal: expected a variable of a specification, got {variable!r}; "
                f"the variables are {', '.join(variables)}{nearest(variable, variables)}"
            )
    _check_header(recording, list(map(columns.column, variables)))
    for variable in variables:
        column = columns.column(variable)
        if column in recording.names:
            continue
        hint = nearest(column, recording.names)
        similar = [name for name in recording.names if column.lower() in name.lower()]
        if column == variable and len(column) > 2 and len(similar) == 1:
            hint = f"; give --signal {shlex.quote(f'{variable}={similar[0]}')}"
            hint += _if_in_unit(similar[0])
        elif column == variable and not hint:
            hint = f"; give --signal {variable}=COLUMN"
        if len(recording.names) == 1 and re.search(r"[^\w.]", recording.names[0]):
            hint = (
                "; say with --separator what stands between columns, or with --skip N how many "
                "lines stand before the names"
            )
        above = recording.lines_above(column)
        if above:
            hint = f"; give --skip {above} if line {above + 1}, which has '{column}', has the names"
        if if_events and {VARIABLE, VALUE} <= set(recording.names):
            hint = f"; {if_events}"
        raise _missing(recording, column, "the specification", hint)
    needed = list(dict.fromkeys(map(columns.column, variables)))
    check_names(recording, needed)
    return needed


def check_names(recording: Recording, needed: Sequence[str]) -> None:
    """Check that the columns have names, and that each needed column exists once."""
    _check_header(recording, needed)
    names = recording.names
    for name in needed:
        if name not in names:
            hint = "; give --time COLUMN" if name == TIME else nearest(name, names)
            raise _missing(recording, name, "--dense", hint)
        if names.count(name) > 1:
            others = [other for other in names if other.endswith(f".{name}")]
            if others:
                raise InputError(
                    f"{recording.source}: expected one column '{name}', got {names.count(name)}; "
                    f"choose one with --signal, such as {name}={others[0]}"
                )
            raise InputError(f"{recording.source}, line 1: expected one column '{name}', got two")


def _check_header(recording: Recording, needed: Sequence[str]) -> None:
    source, names = recording.source, recording.names
    if not names:
        raise InputError(f"{source}: expected columns with names, got none")
    if all(map(_is_number, names)):
        raise InputError(
            f"{source}, line 1: expected the names of the columns, got {listed(names)}; "
            f"write a line of names first, such as {','.join(dict.fromkeys((TIME, *needed)))}"
        )


def _if_in_unit(column: str) -> str:
    """Return the condition under which a column with a unit has the values of a variable."""
    unit = read_name(column).unit
    return f" if the specification counts in {unit}" if unit else ""


def _missing(recording: Recording, name: str, reader: str, hint: str) -> InputError:
    return InputError(
        f"{recording.source}: no column '{name}', which {reader} reads; "
        f"the columns are {listed(recording.names, name)}{hint}"
    )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def starts_of(specs: Mapping[str, rtamt.Specification], columns: Columns) -> dict[str, float]:
    """Return the defaults of variables, which they have before their first record."""
    starts: dict[str, float] = {}
    for spec in specs.values():
        for name, start in spec.defaults.items():
            if starts.setdefault(name, start) != start:
                raise InputError(
                    f"expected one default for '{name}', which two specifications read, got "
                    f"{number(starts[name])} and {number(start)}; rename one variable, or judge "
                    "the specifications separately"
                )
    read = {name for spec in specs.values() for name in spec.variables}
    return starts | {name: start for name, start in columns.starts.items() if name in read}


def with_columns(specs: Mapping[str, rtamt.Specification], columns: Columns) -> Columns:
    """Return the column options with the ``@ column`` annotations of specifications.

    ``--signal`` overrides an annotation.
    """
    named: dict[str, str] = {}
    for spec in specs.values():
        for name, column in spec.columns.items():
            if name in columns.signals or name not in spec.variables:
                continue
            if named.setdefault(name, column) != column:
                raise InputError(
                    f"two specifications name different columns of '{name}', '{named[name]}' and "
                    f"'{column}'. Give --signal {name}=COLUMN, or rename one variable."
                )
    return replace(columns, signals={**named, **columns.signals}) if named else columns


def take_default(source: str, name: str, columns: Columns, why: str, on_topic: str = "") -> str:
    """Return the note on a variable that has its default; refused defaults are an error."""
    value = number(columns.starts[name])
    if columns.no_defaults and name not in columns.defaults:
        raise InputError(
            f"{source}: expected records of '{name}'{on_topic}, as --no-defaults requires, got its "
            f"default {value}: {why}; give --signal {name}=COLUMN, or --default {name} to take it"
        )
    return f"'{name}'{on_topic} is {value}, its default: {why}"


class TimeColumn(NamedTuple):
    """The columns of times.

    Attributes:
        name: The column.
        part: A second column, with parts of seconds or dates; None without such a column.
    """

    name: str
    part: TimePart | None = None

    @property
    def columns(self) -> list[str]:
        """The names of the columns."""
        return [self.name] if self.part is None else [self.name, self.part.column]

    @property
    def label(self) -> str:
        """The columns as ``--time`` names them."""
        return "+".join(self.columns)


_CLOCK_NAMES = {"time", "zeit", "uhrzeit", "heure", "hora", "ora", "tijd", "utctime", "localtime"}


_SHORT_NAMES = {"s", "ns", "us", "ms"}
"""Last words of names that may as well be units of other quantities."""


def find_times(
    recording: Recording, columns: Columns, *, read: Collection[str] = (), needed: bool = True
) -> TimeColumn | None:
    """Return the column of times that an option or a known name selects, or None.

    A column ``time`` has priority. Other plain names come before seconds with a column of
    nanoseconds, dates, less usual names and fields such as ``header.stamp``. A column of dates
    completes a column ``time`` that holds times of day. Columns that specifications read do not
    count as times by a less usual name, and several such names are an error if times are needed.
    """
    column = _found(recording, columns, read, needed=needed)
    if column is not None and column.part is not None and column.part.unit and columns.time_unit:
        raise InputError(
            f"{recording.source}: expected --time-unit for one column of times, got the columns "
            f"{listing(column.columns)} with their units in their names"
        )
    return column


def _found(
    recording: Recording, columns: Columns, read: Collection[str], *, needed: bool
) -> TimeColumn | None:
    names = [*dict.fromkeys(recording.names)]
    if columns.time is not None:
        return _named(recording, columns.time)
    blank = recording.blank
    if TIME in names:
        return _with_date(TIME, recording)
    plain = [name for name in names if has_plain_time_name(name) and name not in blank]
    if plain:
        return _with_date(_only(recording, [TimeColumn(name) for name in plain]).name, recording)
    pairs = _second_pairs(names)
    dates = [name for name in recording.dates if name not in blank]
    known = [n for n in names if unit_of_times(n) is not None and n not in (*read, *blank)]
    if len(both := [name for name in dates if name in known]) == 1:
        return TimeColumn(both[0])
    if len(dates) == 1 and dates[0] in recording.days and len(known) == 1:
        return _with_date(known[0], recording)
    if dates:
        return _only(recording, [TimeColumn(name) for name in dates])
    fields = {name: re.split(r"[./]", name)[-1] for name in names if name not in blank}
    usual = [n for n, last in fields.items() if last != "t" and has_plain_time_name(last)]
    candidates = pairs or [TimeColumn(name) for name in known]
    if not candidates and usual:
        return _only(recording, [TimeColumn(name) for name in usual])
    candidates = candidates or [
        TimeColumn(name)
        for name, last in fields.items()
        if name not in read and last not in (name, "t") and unit_of_times(last) is not None
    ]
    if not candidates or (len(candidates) > 1 and not needed):
        return None
    one = _only(recording, candidates)
    return one if one.part else _with_date(one.name, recording)


def _named(recording: Recording, name: str) -> TimeColumn:
    """Return the column that ``--time`` names, or the two columns, as in ``secs+nsecs``."""
    names = [*dict.fromkeys(recording.names)]
    if name in names:
        return TimeColumn(name)
    first, plus, second = name.partition("+")
    if plus and {first, second} <= {*names}:
        units = {part: unit for _, part, unit in split_times([first, second])}
        return TimeColumn(first, TimePart(second, units.get(second, "")))
    raise InputError(
        f"{recording.source}: no column '{name}', which --time names; the columns "
        f"are {listed(names, name)}{nearest(name, names)}"
    )


def _only(recording: Recording, candidates: Sequence[TimeColumn]) -> TimeColumn:
    if len(candidates) > 1:
        labels = [candidate.label for candidate in candidates]
        raise InputError(
            f"{recording.source}: expected one column of times, got {listing(labels)}; choose one "
            f"with --time {labels[0]!r}"
        )
    return candidates[0]


def _with_date(name: str, recording: Recording) -> TimeColumn:
    """Return a column of times, with the only column of dates if it may hold times of day."""
    dates = [n for n in recording.names if "".join(name_words(n)) in DATE_NAMES]
    if "".join(name_words(name)) in _CLOCK_NAMES and len(dates) == 1 and dates[0] != name:
        return TimeColumn(name, TimePart(dates[0]))
    return TimeColumn(name)


def _second_pairs(names: Sequence[str]) -> list[TimeColumn]:
    """Return the columns of seconds that have a column of nanoseconds or other parts of seconds."""
    return [
        TimeColumn(name, TimePart(part, unit))
        for name, part, unit in split_times(names)
        if not _SHORT_NAMES & {name_words(name)[-1], name_words(part)[-1]}
    ]
