"""Recorded traces: comma-separated samples below a line of names."""

from __future__ import annotations

import csv
import difflib
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError

__all__ = ["TIME", "Trace", "read_trace"]

TIME = "time"
"""The column that says when a sample was taken, in seconds."""

_JITTER = 0.01
"""Part of the period by which the distance of two samples may be off."""


@dataclass(frozen=True, slots=True)
class Trace:
    """Samples of the variables of a specification.

    Attributes:
        source: Where they come from, for messages.
        columns: The variables and their values.
        samples: How many there are.
        times: The column of times, if there is one.
        lines: The line of each sample in the file, from 1.
    """

    source: str
    columns: dict[str, NDArray[np.float64]]
    samples: int
    times: NDArray[np.float64] | None
    lines: Sequence[int]

    @property
    def start(self) -> float:
        """Time of the first sample; 0 if no column says."""
        return 0.0 if self.times is None else float(self.times[0])

    def period(self) -> Fraction | None:
        """Seconds between samples by the column of times; None if there is none, or one sample.

        Raises:
            InputError: If the times do not increase, or not evenly.
        """
        if self.times is None or self.samples < 2:
            return None
        steps = np.diff(self.times)
        usual = float(np.median(steps))
        if usual <= 0 or (odd := np.abs(steps - usual) > _JITTER * usual).any():
            at = int((steps <= 0).argmax() if usual <= 0 else odd.argmax())
            before, after = self.times[at], self.times[at + 1]
            rest = "" if usual <= 0 else f", elsewhere {usual:.6g} s"
            raise InputError(
                f"{self.source}, line {self.lines[at + 1]}: expected samples at even distances, "
                f"got time {after:.6g} after {before:.6g}{rest}; "
                f"resample the trace, or give period= to leave the column '{TIME}' aside"
            )
        mean = float(self.times[-1] - self.times[0]) / (self.samples - 1)
        # What the times cannot resolve, 0.1 + 0.2 = 0.30000000000000004, is no part of the period.
        blur = max(1e-9 * mean, 2 * math.ulp(float(np.abs(self.times).max())) / (self.samples - 1))
        return _simple(mean, blur)


def read_trace(lines: Iterable[str], source: str, variables: Sequence[str]) -> Trace:
    """The samples of the variables; other columns but that of times are not looked at.

    Args:
        lines: The lines of the file; the first names the columns.
        source: Name of the file, for messages.
        variables: Names of the columns that are needed.

    Raises:
        InputError: On a missing column, a line with too few or too many values, or a value that is
            no number; nan is none. Says which line.

    Example:
        >>> trace = read_trace(["time,x", "0,5", "0.5,4"], "trace.csv", ["x"])
        >>> trace.columns["x"].tolist(), trace.period()
        ([5.0, 4.0], Fraction(1, 2))
    """
    rows = _rows(lines, source)
    _, names = next(rows, (1, []))
    names = [name.strip() for name in names]
    if not names:
        raise InputError(f"{source}: expected a first line with the names of the columns, got none")
    _check_names(names, source, variables)
    wanted = [v for v in dict.fromkeys((*variables, TIME)) if v in names]
    places = [names.index(name) for name in wanted]
    values: list[list[float]] = [[] for _ in wanted]
    numbers: list[int] = []
    for line, row in rows:
        if len(row) != len(names):
            raise InputError(
                f"{source}, line {line}: expected {len(names)} values "
                f"({', '.join(names)}), got {len(row)}"
            )
        for place, column in zip(places, values, strict=True):
            try:
                value = float(row[place])
            except ValueError:
                value = math.nan
            if math.isnan(value) or (names[place] == TIME and math.isinf(value)):
                raise InputError(
                    f"{source}, line {line}, column '{names[place]}': "
                    f"expected a number, got {row[place]!r}"
                )
            column.append(value)
        numbers.append(line)
    if not numbers:
        raise InputError(f"{source}: expected at least one sample below the line of names")
    arrays = {name: np.array(column) for name, column in zip(wanted, values, strict=True)}
    columns = {name: arrays[name] for name in variables}
    return Trace(source, columns, len(numbers), arrays.get(TIME), numbers)


def _rows(lines: Iterable[str], source: str) -> Iterator[tuple[int, list[str]]]:
    """The rows that are not empty, with the numbers of their lines."""
    reader = csv.reader(lines, skipinitialspace=True)
    try:
        for row in reader:
            if row:
                yield reader.line_num, row
    except UnicodeDecodeError:
        raise InputError(f"{source}: expected UTF-8 text") from None
    except csv.Error as error:
        raise InputError(f"{source}, line {reader.line_num}: {error}") from None


def _check_names(names: Sequence[str], source: str, variables: Sequence[str]) -> None:
    if all(map(_is_number, names)):
        raise InputError(
            f"{source}, line 1: expected the names of the columns, got {', '.join(names)}; "
            f"write a line of names first, such as {','.join((TIME, *variables))}"
        )
    for name in variables:
        if name not in names:
            near = difflib.get_close_matches(name, names, 1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            if len(names) == 1 and any(mark in names[0] for mark in ";\t"):
                hint = "; columns are separated by commas"
            raise InputError(
                f"{source}: no column '{name}', which the specification reads; "
                f"the columns are {', '.join(names)}{hint}"
            )
        if names.count(name) > 1:
            raise InputError(f"{source}, line 1: expected one column '{name}', got two")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _simple(value: float, blur: float) -> Fraction:
    """A fraction of few digits within ``blur`` of a value."""
    near = Fraction(value)
    for power in range(1, 12):
        simple = near.limit_denominator(10**power)
        if abs(simple - near) <= blur:
            return simple
    return near
