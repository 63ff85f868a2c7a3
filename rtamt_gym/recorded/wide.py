"""Tables with a row per object and time, read with a column per object (``--wide``)."""

from __future__ import annotations

import shlex
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.columns import may_tell_objects, objects_in
from rtamt.errors import no_such
from rtamt_gym.checks.names import listed
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.names import find_times
from rtamt_gym.recorded.recording import (
    Recording,
    Rows,
    Wanted,
    cell_texts,
    check_one_writing,
    places_of,
)
from rtamt_gym.recorded.times import TIME, same_as_before


class WideRecording(Recording):
    """A table as one trace of several objects: ``speed`` of ``Ego`` is the column ``speed.Ego``.

    A row for each time has the values of all objects. The cells of an absent object are empty, and
    marked as records without a number, so that earlier values do not hold.
    """

    def __init__(self, recording: Recording, columns: Columns, *, as_text: bool) -> None:
        key, names = str(columns.wide), recording.names
        self._recording, self._key, self._as_text = recording, key, as_text
        self.source = recording.source
        if key not in names:
            raise InputError(f"{self.source}: {no_such('column', key, names)}")
        time = find_times(recording, columns, read=())
        if time is None:
            raise InputError(
                f"{self.source}: expected a column of times for --wide, got none; give --time "
                f"COLUMN, such as one called {TIME}"
            )
        rows = recording.read(self._with_objects(Wanted([], where=columns.where)))
        objects = [*dict.fromkeys(self._objects(rows))]
        if "" in objects:
            row = self._objects(rows).index("")
            raise InputError(
                f"{rows.where(row)}, column '{key}': expected the name of an object for --wide, "
                "got an empty cell"
            )
        check_one_writing(self.source, key, dict.fromkeys(objects))
        row_columns = {key, *time.columns, *columns.where, *columns.by}
        # The columns and objects of each name; a name with several of them cannot be read.
        self._places: dict[str, list[tuple[str, str]]] = {}
        for name in dict.fromkeys(names):
            for owner in objects if name not in row_columns else ():
                self._places.setdefault(f"{name}.{owner}", []).append((name, owner))
        self._columns, self._one_trace = {*names}, columns.one_trace
        self._others = [name for name in dict.fromkeys(names) if name not in row_columns]
        self._are_single = False
        self.names = [*time.columns, *self._places]
        self.dates = [name for name in recording.dates if name in time.columns]
        self.days = [name for name in recording.days if name in time.columns]
        self.texts = [name for name in recording.texts if name in time.columns]

    def _with_objects(self, wanted: Wanted) -> Wanted:
        if self._as_text:
            return replace(wanted, texts=[self._key])
        return replace(wanted, cells=[self._key])

    def _objects(self, rows: Rows) -> list[str]:
        """Return the name of the object of each row."""
        if self._as_text:
            return [*rows.texts[self._key]]
        return [text.strip() for text in cell_texts(rows.cells[self._key])]

    def read(self, wanted: Wanted) -> Rows:
        """Read the wanted columns; each is empty where its object has no row."""
        numbers = [*dict.fromkeys(self._place(name)[0] for name in wanted.numbers)]
        gaps = numbers if wanted.gaps else ()
        base = replace(wanted, numbers=numbers, gaps=gaps, texts=(), cells=(), ends=False)
        rows = self._recording.read(self._with_objects(base))
        assert rows.times is not None, "wanted"  # noqa: S101 - for mypy
        objects = np.array(self._objects(rows))
        if not (self._one_trace or self._are_single):
            self._check_single(rows, objects, {*numbers}, wanted)
            self._are_single = True
        instants, first, places = find_instants(rows.times, _least_step(rows.times, objects))
        of_objects: dict[str, NDArray[np.intp]] = {}
        columns, absent = {}, {}
        for name in wanted.numbers:
            column, owner = self._place(name)
            if owner not in of_objects:
                (of_objects[owner],) = np.nonzero(objects == owner)
                self._check(rows, places, of_objects[owner], owner)
            own = of_objects[owner]
            columns[name] = np.full(len(instants), np.nan)
            columns[name][places[own]] = rows.numbers[column][own]
            absent[name] = np.isnan(columns[name])
        return Rows(
            columns,
            {},
            len(instants),
            places_of(rows.where, first),
            self.source,
            instants,
            rows.notes,
            rows.unit,
            invalid=absent,
        )

    def _check_single(
        self, rows: Rows, objects: NDArray[np.str_], read: set[str], wanted: Wanted
    ) -> None:
        """Check that the rows of each object belong to one run or episode."""
        names = [n for n in self._others if n not in read and may_tell_objects(n, read, timed=True)]
        if not names:
            return
        cells = self._recording.read(Wanted((), cells=names, where=wanted.where)).cells
        cells = {name: values for name, values in cells.items() if len(values) == rows.count}
        for owner in np.unique(objects).tolist():
            (own,) = np.nonzero(objects == owner)
            there = [np.ones(len(own), bool)]
            times = None if rows.times is None else rows.times[own]
            evidence = objects_in({n: c[own] for n, c in cells.items()}, times, there, read)
            if evidence is None or not evidence.column:
                continue
            column = shlex.quote(evidence.column)
            if evidence.row is not None:
                raise InputError(
                    f"{rows.where(int(own[evidence.row]))}: expected one trace of {owner!r}, but "
                    f"'{evidence.column}' shows that another one starts here. Cut the file there, "
                    "or give --one-trace if all rows are one trace."
                )
            raise InputError(
                f"{self.source}: expected one trace of {owner!r}, got {len(evidence.values)} "
                f"values of '{evidence.column}', which no requirement reads: "
                f"{listed(evidence.values)}. Give --by {column} for a trace of each, or "
                "--one-trace if all rows are one trace."
            )

    def _place(self, name: str) -> tuple[str, str]:
        """Return the column and the object of a name that can be read in one way only."""
        readings = [f"the column '{column}' of '{owner}'" for column, owner in self._places[name]]
        readings += ["a column of the file"] if name in self._columns else []
        if len(readings) > 1:
            raise InputError(
                f"{self.source}: expected one meaning of '{name}', got {' or '.join(readings)}. "
                "Give the column or the object another name."
            )
        return self._places[name][0]

    def _check(
        self, rows: Rows, places: NDArray[np.intp], own: NDArray[np.intp], name: str
    ) -> None:
        """Check that the times of an object increase."""
        steps = np.diff(places[own])
        if (steps <= 0).any():
            at = int((steps <= 0).argmax())
            words = "two rows at one time" if steps[at] == 0 else "a time before the row above"
            raise InputError(
                f"{rows.where(int(own[at + 1]))}: expected times of {name!r} that increase, got "
                f"{words}"
            )


_NEAR = 1e-9
"""The part of a step by which clocks of two objects may differ at one instant."""


def find_instants(
    times: NDArray[Any], step: float = 0.0
) -> tuple[NDArray[Any], NDArray[np.intp], NDArray[np.intp]]:
    """Return the instants of rows in order, the first row of each, and the instant of each row.

    Floating-point times are one instant if they differ by at most one unit in the last place, or a
    billionth of a step, as sums of steps do.
    """
    order = np.argsort(times, kind="stable")
    same = same_as_before(times[order])
    if times.dtype.kind == "f":
        same |= np.diff(times[order]) <= _NEAR * step
    starts = np.append(True, ~same)
    places = np.empty(len(times), np.intp)
    places[order] = np.cumsum(starts) - 1
    return times[order][starts], order[starts], places


def _least_step(times: NDArray[Any], objects: NDArray[np.str_]) -> float:
    """Return the smallest step of an object; 0 if the times are not floating-point numbers."""
    if times.dtype.kind != "f":
        return 0.0
    _, owners = np.unique(objects, return_inverse=True)
    order = np.lexsort((times, owners))
    steps = np.diff(times[order])[np.diff(owners[order]) == 0]
    steps = steps[steps > 0]
    return float(steps.min()) if len(steps) else 0.0
