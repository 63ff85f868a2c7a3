"""Times of a stream: seconds since the first row of a trace, and the grid of its samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.recorded.columns import NEAR, Columns
from rtamt_gym.recorded.recording import Floats, RawTimes, Rows
from rtamt_gym.recorded.times import TimeAxis, in_seconds
from rtamt_gym.recorded.trace import Trace

_DRIFT = 0.01
"""The maximum difference of a step from the period, as a part of it, for clocks that drift."""


@dataclass(frozen=True, slots=True)
class ClockRules:
    """How the times of a stream are read.

    Attributes:
        source: The name of the stream, for messages.
        column: The column of times.
        columns: How columns are read.
        unit: The unit of times of two columns; empty for one column.
    """

    source: str
    column: str
    columns: Columns
    unit: str = ""

    def axis(self, raw: RawTimes, lines: Sequence[int]) -> TimeAxis:
        """Return the times of the first rows of a trace."""

        def where(row: int) -> str:
            return f"{self.source}, line {lines[row]}"

        rows = Rows({}, {}, len(raw), where, self.source, raw, unit=self.unit)
        axis = TimeAxis.of(rows, self.column, self.columns)
        if raw.dtype.kind not in "mM" and axis.unit == 1 and axis.start == 0.0 != float(raw[0]):
            raise InputError(
                f"{where(0)}, column '{self.column}': expected dates with marks, such as "
                f"2024-05-01, got {raw[0]}"
            )
        axis.check_distances(rows)
        axis.check_unit(self.source)
        return axis


def plain_times(raw: RawTimes) -> RawTimes:
    """Return dates and durations as integers of nanoseconds, and other times as they are."""
    if raw.dtype.kind in "mM":
        return raw.astype(f"{raw.dtype.kind}8[ns]").astype(np.int64)
    return raw


class StreamClock:
    """The times of one trace.

    Args:
        rules: How times are read.
        raw: The first time, or the first two.
        lines: Their lines.
    """

    def __init__(self, rules: ClockRules, raw: RawTimes, lines: Sequence[int]) -> None:
        axis = rules.axis(raw, lines)
        self.start, self._unit, self._dated = axis.start, axis.unit, raw.dtype.kind
        self._first = plain_times(raw[:1])[0]
        self._float = raw.dtype.kind == "f"
        self._axis = axis

    def since(self, raw: RawTimes) -> Floats:
        """Return seconds since the first row."""
        if (raw.dtype.kind in "mM") != (self._dated in "mM"):
            raise InputError("expected times like the first, got numbers and dates")
        self._float = self._float or raw.dtype.kind == "f"
        return in_seconds(plain_times(raw) - self._first, self._unit)

    def precision(self, raw: RawTimes, since: Floats) -> Floats:
        """Return by how much each time may be off because it was rounded."""
        precision = np.spacing(np.abs(since))
        if raw.dtype.kind == "f":
            precision = np.maximum(precision, np.spacing(np.abs(raw)) * (self._unit / 1e9))
        return precision

    @property
    def unit_doubt(self) -> str:
        """Why a period from the first two rows may be in another unit; empty without a doubt."""
        return self._axis.unit_doubt

    @property
    def certain(self) -> bool:
        """Whether the unit of the times is stated, or they are dates."""
        return self._axis.certain and not self._axis.decided

    def unit_note(self, raw: RawTimes, length: float) -> str:
        """Return the note on the unit of times; empty without one.

        Args:
            raw: The first times.
            length: The length of the trace in seconds.
        """
        return replace(self._axis, since=self.since(raw)).note_of_unit(length)

    def period(self, source: str, lines: Sequence[int], *, timed: bool) -> Fraction:
        """Return the distance of the first two rows.

        Args:
            source: The name of the stream, for messages.
            lines: The lines of the rows.
            timed: Whether a formula has time bounds, so that times are needed.
        """
        trace = Trace(source, {}, 2, self._axis, lambda row: f"{source}, line {lines[row]}")
        period = trace.period(timed=timed)
        assert period is not None, "there are two rows"  # noqa: S101 - for mypy
        return period


def on_grid(
    since: Floats, last: float, sample: int, period: float, precision: Floats
) -> NDArray[np.bool_]:
    """Return whether rows are the next samples of an even grid.

    Args:
        since: Their times since the first row.
        last: The time of the row before.
        sample: The number of the first row.
        period: The period in seconds.
        precision: By how much a time may be off.
    """
    places = np.arange(sample, sample + len(since)) * period
    steps = np.diff(since, prepend=last)
    near = np.abs(since - places) <= NEAR * period + 2 * precision
    drifts = np.abs(steps - period) <= _DRIFT * period + 4 * precision
    near &= np.abs(steps - period) < period / 2
    return near | drifts
