"""The columns that variables need, and the defaults of variables without a column.

To change when a variable gets its default, change three places: this module for files and bags, and
`rtamt.inputs.samples` and `rtamt.inputs.event_reader` for the arguments of callers.
`Specification.defaults` lists the variables that have one.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import rtamt
from rtamt import InputError
from rtamt.columns import name_words, read_name
from rtamt.errors import near_name, nearest
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.recording import Recording
from rtamt_gym.recorded.times import TIME
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
    """Return the columns that may hold values of a variable under a misspelt name.

    Args:
        columns: How columns are read. ``--signal speed=speed`` leaves a variable out.
        variables: The variables that have a column.
        names: The columns that nothing reads.

    Example:
        >>> misspellings(Columns(), ["speed", "acc_x"], ["Speed", "sped", "acc_y", "time"])
        [('speed', 'Speed'), ('speed', 'sped')]
    """
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
    """Return the columns of variables, each once.

    Args:
        recording: The file.
        variables: The variables of the specifications.
        columns: The options with the names of the columns.
        if_events: Advice for a file whose rows are events, not samples.
    """
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

    Raises:
        InputError: If two specifications give a variable different columns.
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
    """Return the note on a variable that has its default; raise InputError if defaults are refused.

    Args:
        source: Name of the file, for messages.
        name: The variable.
        columns: The options with the defaults, and with the permission to use them.
        why: The reason for the default.
        on_topic: The topic of a bag, such as `` of /odom``; empty for a table.
    """
    value = number(columns.starts[name])
    if columns.no_defaults and name not in columns.defaults:
        raise InputError(
            f"{source}: expected records of '{name}'{on_topic}, as --no-defaults requires, got its "
            f"default {value}: {why}; give --signal {name}=COLUMN, or --default {name} to take it"
        )
    return f"'{name}'{on_topic} is {value}, its default: {why}"
