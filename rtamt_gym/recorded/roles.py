"""The roles of the columns of a table, and checks that it is one trace that overlooks no times."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError, Specification
from rtamt.columns import (
    are_clock_numbers,
    are_days,
    calendar_unit,
    dates_of_numbers,
    hinted_unit,
    looks_like_times,
    may_tell_objects,
    median,
    missing_row,
    name_words,
    names_objects,
    objects_by_turns,
    objects_in,
    own_times,
    plausible_units,
    split_times,
    stated_period,
    turns_in,
    unit_of_times,
)
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.cells import floats_in, times_of_texts
from rtamt_gym.recorded.columns import UNITS, Columns
from rtamt_gym.recorded.names import (
    TimeColumn,
    check_near,
    find_times,
    misspellings,
    misspelt_value,
    needed_columns,
    recorded_variables,
)
from rtamt_gym.recorded.recording import Recording, Rows, Wanted
from rtamt_gym.recorded.times import join_times, rises
from rtamt_gym.tables import counted


@lru_cache(maxsize=256)
def has_time_bounds(spec: Specification) -> bool:
    """Return whether a specification has a finite bound other than 0, or a rate of change.

    Example:
        >>> from rtamt import parse
        >>> [has_time_bounds(parse(f"{each}(x > 0)")) for each in ("always[0:2]", "always[0:0]")]
        [True, False]
        >>> has_time_bounds(parse("next(rise(x > 0))"))
        False
    """
    if any(node.op is not None and node.op.name == "rate" for node in spec.nodes()):
        return True
    intervals = [node.interval for node in spec.nodes() if node.interval is not None]
    return any(begin or end for begin, end in map(spec.bounds, intervals))


def counts_rows(spec: Specification) -> bool:
    """Return whether a specification without times counts rows: by time bounds, or neighbours.

    Example:
        >>> from rtamt import parse
        >>> [counts_rows(parse(text)) for text in ("always(rise(x > 0))", "always(x > 0)")]
        [True, False]
    """
    steps = any(node.op is not None and node.op.sampled for node in spec.nodes())
    return steps or has_time_bounds(spec)


@dataclass(frozen=True, slots=True)
class RowTable:
    """A recording of rows, and the roles of its columns: variables, times, or none.

    Attributes:
        recording: The file, whose columns can be read again.
        columns: How its columns are read.
        read: The columns that specifications read.
        time: The columns of times; None without them.
    """

    recording: Recording
    columns: Columns
    read: Collection[str]
    time: TimeColumn | None

    @staticmethod
    def of(
        recording: Recording, variables: Collection[str], columns: Columns, *, needed: bool = True
    ) -> RowTable:
        """Return the table with its columns of times; several are an error if they are needed."""
        read = {columns.column(name) for name in variables}
        time = find_times(recording, columns, read=read, needed=needed)
        return RowTable(recording, columns, read, time)

    def assign(self, variables: Sequence[str], if_events: str = "") -> tuple[list[str], list[str]]:
        """Return the variables that have a column, and their columns, each once."""
        recording, columns = self.recording, self.columns
        check_near(recording.source, recording.names, variables, columns)
        there = recorded_variables(recording.names, variables, columns)
        return there, needed_columns(recording, there, columns, if_events)

    def with_times(self, wanted: Wanted) -> Wanted:
        """Return the columns to read, with the columns of times and the rows of ``--where``."""
        columns, time = self.columns, self.time
        timed = replace(wanted, where=columns.where, date_order=columns.date_order)
        return timed if time is None else replace(timed, time=time.name, part=time.part)

    def rows(self, wanted: Wanted) -> Rows:
        """Read columns, and the times of the rows that ``--where`` selects."""
        rows = self.recording.read(self.with_times(wanted))
        if not rows.count:
            raise InputError(f"{rows.source}: expected at least one sample below the line of names")
        return rows

    @property
    def unread(self) -> list[str]:
        """The columns that nothing reads."""
        times = [] if self.time is None else self.time.columns
        used = {*self.read, *times, *self.columns.where, *self.columns.by}
        return [name for name in dict.fromkeys(self.recording.names) if name not in used]

    @property
    def clocks(self) -> Mapping[str, str]:
        """The columns of times, the main one first, with a column that each belongs to.

        It is empty unless a column that is read has times of its own.
        """
        if self.columns.time is not None or (self.time is not None and self.time.part is not None):
            return {}
        names = self.recording.names
        owned = {name: own_times(name, names) for name in names if name in self.read}
        clocks = {own: name for name, own in owned.items() if own is not None}
        first = [] if self.time is None else [(self.time.name, "")]
        clocks = {**dict(first), **clocks}
        return clocks if len(clocks) > 1 else {}

    def check_rows(
        self, rows: Rows, filled: Mapping[str, NDArray[np.bool_]], variables: Sequence[str]
    ) -> None:
        """Check that the rows are one trace, with one clock and one spelling of each name."""
        self.check_objects(rows, filled)
        self.check_clocks(rows)
        self.check_spelling(rows, variables)

    def check_valid(self, rows: Rows) -> None:
        """Check that all records hold numbers, unless an option states the treatment of others."""
        if self.columns.missing != "raise":
            return
        for name, invalid in rows.invalid.items():
            if invalid.any():
                index, count = int(invalid.argmax()), int(invalid.sum())
                when = "" if rows.times is None else f", at {float(rows.times[index]):.9g} s"
                raise InputError(
                    f"{rows.source}{when}, channel '{name}': expected a number, got a sample that "
                    f"is nan or marked as not valid ({counted(count, 'sample')} in all); give "
                    "--missing unknown, --missing hold or --missing drop"
                )

    def check_objects(self, rows: Rows, filled: Mapping[str, NDArray[np.bool_]]) -> None:
        """Check that the rows belong to one object or episode."""
        if self.columns.one_trace:
            return
        self._check_totals(rows)
        timed = rows.times is not None
        late = rows.times is not None and not rises(rows.times)
        uneven = rows.times is not None and not are_even(rows.times)
        first = self.recording.names[0]
        names = [
            name
            for name in self.unread
            if late
            or may_tell_objects(name, self.read, timed=timed, first=name == first)
            or (uneven and name in self.recording.texts)
        ]
        cells = self._cells(rows, names) if names else {}
        if not timed and first in cells and has_footer(cells[first]):
            raise InputError(
                f"{rows.source}: expected samples, but the last row has no number in '{first}', as "
                "a row of totals. Remove it, or give --one-trace if it is a sample."
            )
        evidence = objects_in(cells, rows.times, [*filled.values()], self.read, first)
        turns = turns_in(rows.times) if rows.times is not None and uneven and not late else 0
        if evidence is None and turns:
            evidence = objects_by_turns(self._cells(rows, self.unread), turns)
        if evidence is None:
            return
        source = rows.source
        if evidence.row is not None:
            position = rows.where(evidence.row).removeprefix(f"{source}, ")
            raise InputError(
                f"{source}: expected one trace, but '{evidence.column}' shows that another one "
                f"starts in {position}. Cut the file there, or give --one-trace if all rows are "
                "one trace."
            )
        if evidence.column:
            value = shlex.quote(f"{evidence.column}={evidence.values[0]}")
            column = shlex.quote(evidence.column)
            raise InputError(
                f"{source}: expected one trace, got {len(evidence.values)} values of "
                f"'{evidence.column}', which no requirement reads: "
                f"{listed(evidence.values)}. Give --by {column} for a trace of each, --where "
                f"{value} to judge the rows of one, or --one-trace if all rows are one trace."
            )
        raise InputError(
            f"{source}: expected one trace, but times repeat or go back while other columns "
            "change, as with several objects or episodes. Give --by COLUMN for a trace of each, "
            "--where COLUMN=VALUE to judge the rows of one, or --one-trace if all rows are one "
            "trace."
        )

    def check_spelling(self, rows: Rows, variables: Sequence[str]) -> None:
        """Check that no misspelt column has values in rows without a value of a variable.

        A column that has a value next to a value of the variable is another signal.
        """
        near = misspellings(self.columns, variables, self.unread)
        near = [(column, name) for column, name in near if np.isnan(rows.numbers[column]).any()]
        cells = self._cells(rows, [name for _, name in near]) if near else {}
        for column, name in near:
            if name not in cells:
                continue
            there, others = ~np.isnan(rows.numbers[column]), _filled(cells[name])
            if others.any() and not (there & others).any():
                row = int(others.argmax())
                raise InputError(f"{rows.where(row)}: {misspelt_value(column, name)}")

    def _check_totals(self, rows: Rows) -> None:
        """Check that no text in the last row names totals."""
        if self.columns.where or self.columns.by:
            return
        last = self.recording.last_texts()
        for name in self.unread:
            if not names_totals(last.get(name, "")):
                continue
            values = [str(value).strip() for value in self._cells(rows, [name]).get(name, [])]
            if only_last_totals(values):
                raise InputError(
                    f"{rows.where(rows.count - 1)}: expected a sample, but {values[-1]!r} in "
                    f"'{name}' names a row of totals. Remove it, or give --one-trace if it is a "
                    "sample."
                )

    def check_selection(self, rows: Rows) -> None:
        """Check that ``--where`` leaves out no row between samples that a formula counts.

        A column of object names may leave rows out, because the rows of one object follow each
        other.
        """
        states = {n: t for n, t in self.columns.where.items() if not names_objects(n, texts=True)}
        if not states:
            return
        objects = {n: t for n, t in self.columns.where.items() if n not in states}
        chosen = self.recording.selected(states)
        chosen = chosen[self.recording.selected(objects)] if objects else chosen
        (places,) = np.nonzero(chosen)
        gaps = np.diff(places) > 1
        if not gaps.any():
            return
        raise InputError(
            f"{rows.where(int(gaps.argmax()) + 1)}: --where leaves out rows before this one, so a "
            "formula that counts rows may reach too far. State the condition in the requirement, "
            "or give --one-trace if the selected rows follow each other."
        )

    def check_clocks(self, rows: Rows) -> None:
        """Check that variables with columns of times of their own have the times of the rows."""
        clocks = self.clocks
        cells = self._cells(rows, [*clocks]) if clocks else {}
        main = next(iter(clocks), "")
        for own, name in clocks.items():
            if own == main or own in self.read or _same_clock(cells.get(main), cells.get(own)):
                continue
            raise InputError(
                f"{rows.source}: expected one column of times, but '{name}' seems to have its own, "
                f"'{own}', which differs from '{main}'. Write a row with time, variable and value "
                f"for each record and judge it with --dense, or give --time {shlex.quote(main)} if "
                "each row is one instant."
            )

    def check_times(self, rows: Rows) -> None:
        """Check that no unread column looks like times."""
        if not rows.count:
            return
        every = [*dict.fromkeys(self.recording.names)]
        named = [n for n in every if n in self.read and unit_of_times(n) is not None]
        names = [*self.unread, *named]
        cells = self._cells(rows, names)
        expected = f"{rows.source}: expected a column of times for the time bounds, got none, but"
        for name, part, unit in split_times(self.unread):
            if _are_split(cells.get(name), cells.get(part), unit):
                raise InputError(
                    f"{expected} '{name}' and '{part}', which nothing reads, look like seconds and "
                    f"their {unit}. Give --time {shlex.quote(f'{name}+{part}')}, or --period 1 to "
                    "count samples."
                )
        self._check_period(expected, cells)
        self._check_row_numbers(rows, cells)
        parts = {n: v for n, v in cells.items() if calendar_unit(n) or name_words(n) in _SECONDS}
        for name in names:
            if name not in cells:
                continue
            values = cells[name]
            readings = _readings(name, values, self.columns, first=name == every[0])
            if readings is None:
                continue
            option = f"--time {shlex.quote(name)}"
            times = [f"{option}{reading}" for reading in readings] or [f"{option} --time-unit UNIT"]
            reads = "nothing reads" if name in self.unread else "a requirement reads as a value"
            several = calendar_unit(name) is not None and sum(map(_varies, parts.values())) > 1
            if several or (not readings and (calendar_unit(name) or are_days(values))):
                raise InputError(
                    f"{expected} '{name}', which {reads}, is part of a date. Write one "
                    "column of dates, or give --period SECONDS, the time between two rows, or "
                    "--period 1 to count samples."
                )
            if values.dtype.kind in "iufmM" and rises(values[::-1]):
                raise InputError(
                    f"{expected} '{name}', which {reads}, looks like one with the newest row "
                    f"first. Sort the rows by '{name}', the oldest first, and give "
                    f"{', '.join(times)}, or give --period 1 to count the samples in this order."
                )
            raise InputError(
                f"{expected} '{name}', which {reads}, looks like one. Give {', '.join(times)}, or "
                "--period 1 to count samples."
            )

    def _check_row_numbers(self, rows: Rows, cells: Mapping[str, NDArray[np.generic]]) -> None:
        """Check that the row numbers of the file show no missing row."""
        for name in self.unread:
            row = missing_row(name, cells[name]) if name in cells else None
            if row is not None:
                before, after = cells[name][row - 1 : row + 1].tolist()
                column = shlex.quote(name)
                raise InputError(
                    f"{rows.where(row)}: expected rows at even distances in '{name}', got "
                    f"{after:.15g} after {before:.15g}, so time bounds that count rows may reach "
                    f"too far. Give --time {column} --time-unit s to count in '{name}', or "
                    "--period 1 to count rows."
                )

    def _check_period(self, expected: str, cells: Mapping[str, NDArray[np.generic]]) -> None:
        """Check that no constant in the file states the time between samples."""
        above = self.recording.above.items()
        singles = {name: value for name, value in above if name not in self.read}
        unread_names = [name for name in self.unread if name not in cells]
        read = self.recording.read(Wanted((), cells=unread_names)).cells if unread_names else {}
        for name, values in read.items():
            if len(values) == 1 and values.dtype.kind in "iuf":
                singles[name] = float(values.tolist()[0])
        columns = {
            name: float(values.tolist()[0])
            for name, values in cells.items()
            if name in self.unread and values.dtype.kind in "iuf" and (values == values[0]).all()
        }
        for name, value in [*singles.items(), *columns.items()]:
            period = stated_period(name, value, single=name in singles)
            if period is not None:
                raise InputError(
                    f"{expected} '{name}' is {value:g}, as if samples were {float(period):.6g} s "
                    f"apart. Give --period {period}, or --period 1 to count samples."
                )

    def _cells(self, rows: Rows, names: Sequence[str]) -> dict[str, NDArray[np.generic]]:
        wanted = Wanted((), cells=names, where=self.columns.where)
        cells = self.recording.read(wanted).cells
        return {name: values for name, values in cells.items() if len(values) == rows.count}


def _filled(values: NDArray[Any]) -> NDArray[np.bool_]:
    """Return whether each cell has a value."""
    if values.dtype.kind in "mM":
        return np.asarray(~np.isnat(values), bool)
    return (
        ~np.isnan(values.astype(np.float64))
        if values.dtype.kind == "f"
        else np.asarray(values != "", bool)
    )


_RATE = 0.01
_SCALES = sorted({a / b for a in UNITS.values() for b in UNITS.values()})


def _same_clock(times: NDArray[np.generic] | None, other: NDArray[np.generic] | None) -> bool:
    """Return whether two columns have the same instants in each row, or one is not a clock.

    They may count from different origins, in different units, and be a step apart.
    """
    first, second = _instants(times), _instants(other)
    if first is None or second is None:
        return True
    there = np.isfinite(second)
    if len(first) < 3 or not (np.isfinite(first).all() and rises(first) and rises(second[there])):
        return True
    if not there.all():
        return int(there.sum()) < 2
    length = first[-1] - first[0]
    rate = float((second[-1] - second[0]) / length)
    scale = min(_SCALES, key=lambda ratio: abs(rate / ratio - 1))
    offset = abs(float(np.median(second / scale - first)))
    staggered = float(np.median(np.diff(first))) < offset <= length
    return abs(rate / scale - 1) <= _RATE and not staggered


def _instants(values: NDArray[np.generic] | None) -> NDArray[np.float64] | None:
    """Return times as numbers; None if they are not times."""
    if values is not None and values.dtype.kind in "OUT":
        try:
            values = times_of_texts(values.tolist())
        except InputError:
            return None
    if values is None or values.dtype.kind not in "iufmM":
        return None
    return values.astype(np.int64 if values.dtype.kind in "mM" else np.float64).astype(np.float64)


def _are_split(
    seconds: NDArray[np.generic] | None, part: NDArray[np.generic] | None, unit: str
) -> bool:
    """Return whether two columns are whole seconds and parts of seconds in order."""
    if seconds is None or part is None or len(seconds) < 2:
        return False
    if not all(v.dtype.kind in "iuf" and np.isfinite(v).all() for v in (seconds, part)):
        return False
    try:
        times = join_times(seconds, part, unit, str)
    except InputError:
        return False
    return rises(times) or rises(times[::-1])


_SECONDS = (("second",), ("seconds",), ("sec",))


def _varies(values: NDArray[np.generic]) -> bool:
    return bool((values != values[0]).any())


def has_footer(values: NDArray[np.generic]) -> bool:
    """Return whether all cells except the last are increasing numbers."""
    if values.dtype.kind not in "fOUT" or len(values) < 3:
        return False
    if values.dtype.kind == "f":
        numbers = values.astype(np.float64)
        return bool(np.isnan(numbers[-1])) and rises(numbers[:-1])
    *body, last = map(str, values.tolist())
    read = floats_in(body)
    return read is not None and rises(read) and floats_in([last]) is None


_TOTALS = re.compile(
    r"((grand|sub|over)[ -]?)?totals?|totale|sums?|summe|gesamt(summe|ergebnis)?|somme|suma|soma|"
    r"summary|average|avg|mean|median|mittel(wert)?|durchschnitt|moyenne|promedio|media"
)
_STATISTICS = re.compile(r"min|max|(mini|maxi)mum|count|std([ .-]?dev)?|variance|anzahl")
"""Names that states have, too: they are of totals only next to numbers or empty cells."""


def names_totals(text: str) -> bool:
    """Return whether a cell may be the name of a row of totals."""
    word = text.lower().rstrip(" :")
    return bool(_TOTALS.fullmatch(word) or _STATISTICS.fullmatch(word))


def only_last_totals(texts: Sequence[str]) -> bool:
    """Return whether the last cell of a column names totals, and no other cell is like it."""
    if len(texts) < 2 or not names_totals(texts[-1]) or texts[-1] in texts[:-1]:
        return False
    word = texts[-1].lower().rstrip(" :")
    others = [text for text in texts[:-1] if text not in ("", "nan")]
    return bool(_TOTALS.fullmatch(word)) or floats_in(others) is not None


def are_even(times: NDArray[np.generic]) -> bool:
    """Return whether times are at even distances, up to 5% of the usual one."""
    kind = times.dtype.kind
    with np.errstate(over="ignore", invalid="ignore"):
        steps = np.diff(times.astype(np.int64 if kind in "mM" else np.float64)).astype(np.float64)
        return len(steps) < 2 or float(np.ptp(steps)) <= 0.1 * median(steps)


def _readings(
    name: str, values: NDArray[np.generic], columns: Columns, *, first: bool
) -> list[str] | None:
    """Return the options to read a column as times; None if it does not look like times."""
    if values.dtype.kind in "mM":
        return [""]
    if values.dtype.kind in "OUT" and len(values) > 1:
        try:
            dates = times_of_texts(values.tolist(), order=columns.date_order)
        except InputError:
            return [" --date-order dmy", " --date-order mdy"]
        return None if dates is None or not rises(dates) else [""]
    if not looks_like_times(name, values, first=first):
        return None
    if dates_of_numbers(values) is not None or are_clock_numbers(values):
        return [""]
    if are_days(values):
        return []
    unit = calendar_unit(name) or hinted_unit(name)
    if unit is not None:
        falls = calendar_unit(name) and not (rises(values) or rises(values[::-1]))
        return [] if falls or unit not in UNITS else [f" --time-unit {unit}"]
    step = float(np.median(np.abs(np.diff(values.astype(np.float64)))))
    return [
        f" --time-unit {candidate} (a sample every {step * UNITS[candidate] / UNITS['s']:.6g} s)"
        for candidate in plausible_units(values)
    ]
