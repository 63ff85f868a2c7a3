"""Times and periods of many groups of a table at once, if their samples are plainly even."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt.columns import calendar_unit, median
from rtamt_gym.recorded.columns import NEAR, UNITS, Columns
from rtamt_gym.recorded.grid import HOLE
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.times import TimeAxis, in_seconds, same_as_before, simple, stated_unit
from rtamt_gym.recorded.trace import PERIODS
from rtamt_gym.results.extent import Gap

Booleans = NDArray[np.bool_]

_SINCE_START, _DAYS, _CLOCKS = 1e7, 3e4, 60.0
"""Numbers below these are not dates such as 20240501, days of dates, and times of day."""

_SINCE_1970 = 3e8, 1e11
"""Numbers between these are seconds since 1970, if steps are short enough."""

_STEPS = 1e-4, 990.0
"""Steps between these are neither days nor another unit than seconds."""

_TRIED = 64
"""The periods that are compared with all groups."""


@dataclass(frozen=True, slots=True)
class GroupRows:
    """Neighbouring rows that belong to one group each.

    Attributes:
        begins: The first row of each group.
        lengths: The number of rows, one or more.
    """

    begins: NDArray[np.int64]
    lengths: NDArray[np.int64]

    def least(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the minimum of each group."""
        return np.minimum.reduceat(values, self.begins)

    def greatest(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the maximum of each group."""
        return np.maximum.reduceat(values, self.begins)

    def any(self, marks: Booleans) -> Booleans:
        """Return whether each group has a mark."""
        return np.logical_or.reduceat(marks, self.begins)

    def repeated(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the value of its group for each row."""
        return np.repeat(values, self.lengths)

    @property
    def numbers(self) -> NDArray[np.int64]:
        """The number of each row in its group."""
        return np.asarray(np.arange(int(self.lengths.sum())) - self.repeated(self.begins))

    def medians(self, values: Floats) -> Floats:
        """Return the median of each group, as `median` does."""
        result = np.empty(len(self.lengths))
        for n in np.unique(self.lengths).tolist():
            (chosen,) = np.nonzero(self.lengths == n)
            if n > 10_000 or len(chosen) == 1:
                for i in chosen.tolist():
                    result[i] = median(values[self.begins[i] : self.begins[i] + n])
                continue
            ordered = np.sort(values[self.begins[chosen][:, None] + np.arange(n)], axis=1)
            middle = n // 2
            result[chosen] = ordered[:, middle]
            if not n % 2:
                result[chosen] = (ordered[:, middle - 1] + ordered[:, middle]) / 2
        return result


class GroupAxes:
    """The times of groups.

    Args:
        raw: The times of all rows, group after group.
        rows: The rows of the groups.
        column: The name of the column.
        unit: The unit that the format states; empty if it states none.
        columns: How columns are read.

    Attributes:
        plain: Whether the times of each group increase, and are certainly not dates, days or times
            of day. Other attributes are meaningless for groups that are not plain.
        since: Seconds since the first time of the group, for each row.
        uneven: Whether steps differ by more than about a tenth.
    """

    def __init__(
        self, raw: NDArray[Any], rows: GroupRows, column: str, unit: str, columns: Columns
    ) -> None:
        self._rows, self._column, kind = rows, column, raw.dtype.kind
        if kind == "f":
            raw = raw.astype(np.float64)
        wrong = np.isnat(raw) if kind in "mM" else ~np.isfinite(raw)
        self.plain = ~rows.any(wrong)
        raw = np.where(wrong, raw.dtype.type(0), raw) if wrong.any() else raw
        inner = np.ones(len(raw), bool)
        inner[rows.begins] = False
        self._inner = inner
        rises = np.ones(len(raw), bool)
        rises[1:] = raw[1:] > raw[:-1]
        self.plain &= ~rows.any(~rises & inner)
        stated = "s" if kind in "mM" else stated_unit(column, unit, columns)
        self._certain, self._decided = bool(stated), ""
        if kind in "mM":
            integers = raw.astype(f"{kind}8[ns]").astype(np.int64)
            self.since = (integers - rows.repeated(integers[rows.begins])) / 1e9
            first = integers[rows.begins] / 1e9
            self._starts = np.zeros(len(first)) if kind == "M" else first
            self._precisions, self._unit, exact_times = np.full(len(first), 1e-9), 1, integers
        else:
            named = stated or calendar_unit(column) or ""
            self.plain &= named == "" or named in UNITS
            self._certain = bool(named)
            self._unit = UNITS.get(named or "s", UNITS["s"])
            with np.errstate(over="ignore"):
                self.since = in_seconds(raw - rows.repeated(raw[rows.begins]), self._unit)
            most = rows.greatest(np.abs(raw)).astype(np.float64)
            ulps = np.spacing(most) if kind == "f" else np.zeros(len(most))
            ends = np.spacing(rows.greatest(np.abs(self.since)))
            self._precisions = np.maximum(ulps * self._unit / 1e9, ends)
            self._starts = in_seconds(raw[rows.begins], self._unit)
            exact_times = raw
        self.plain &= ~rows.any(~np.isfinite(self.since))
        with np.errstate(over="ignore", invalid="ignore"):
            same = np.append(False, same_as_before(self.since))
            self._all_steps = np.diff(self.since, prepend=self.since[:1])
        self.plain &= ~rows.any((same | ~(self._all_steps > 0)) & inner)
        (self._many,) = np.nonzero(rows.lengths > 1)
        lengths = rows.lengths[self._many] - 1
        self._steps = GroupRows(np.cumsum(lengths) - lengths, lengths)
        self.steps = self._all_steps[inner]
        self._exact = self._exact_steps(exact_times, kind)
        self.usual = self._usual()
        self.uneven = self._spread_steps(0.0999)
        if not stated:
            self._leave_doubtful(raw)

    def _exact_steps(self, exact_times: NDArray[Any], kind: str) -> list[int | None]:
        """Return the distance of whole numbers of each group with steps, if it is the same."""
        if kind == "f" or not len(self._many):
            return [None] * len(self._many)
        steps = np.diff(exact_times.astype(np.int64), prepend=exact_times[:1].astype(np.int64))[
            self._inner
        ]
        least, most = self._steps.least(steps), self._steps.greatest(steps)
        return [a if a == b else None for a, b in zip(least.tolist(), most.tolist(), strict=True)]

    def _usual(self) -> Floats:
        """Return the usual step of each group; 0 for a group of one row."""
        usual = np.zeros(len(self._rows.lengths))
        if len(self._many):
            medians = self._steps.medians(self.steps)
            for i, step in enumerate(self._exact):
                if step is not None:
                    medians[i] = float(self._fraction(step))
            usual[self._many] = medians
        return usual

    def _fraction(self, step: int) -> Fraction:
        return Fraction(step * self._unit, UNITS["s"])

    def _spread_steps(self, part: float) -> Booleans:
        """Return whether the steps of each group differ by more than a part of the usual step."""
        spread = np.zeros(len(self._rows.lengths), bool)
        if len(self._many):
            least, most = self._steps.least(self.steps), self._steps.greatest(self.steps)
            with np.errstate(invalid="ignore", over="ignore"):
                spread[self._many] = ~(most - least <= part * self.usual[self._many])
        return spread

    def _leave_doubtful(self, raw: NDArray[Any]) -> None:
        """Leave out groups whose times may be dates, days, times of day or in another unit."""
        most = self._rows.greatest(np.abs(raw)).astype(np.float64)
        low = self._rows.least(raw).astype(np.float64)
        many = self._rows.lengths > 1
        steps = np.where(many, self.usual * UNITS["s"] / self._unit, 1.0)
        dated = (low >= _SINCE_1970[0]) & (most < _SINCE_1970[1])
        self.plain &= (most < _SINCE_START) | dated
        if raw.dtype.kind == "f":
            self.plain &= ~many | (((low < _DAYS) | dated) & (steps >= _STEPS[0]))
        self.plain &= ~(self._spread_steps(0.0099) & (most >= _CLOCKS) & ~dated)
        self.plain &= ~many | (steps < _STEPS[1])

    def axis(self, i: int) -> TimeAxis:
        """Return the times of a group, as `TimeAxis.of` does."""
        begin, n = int(self._rows.begins[i]), int(self._rows.lengths[i])
        exact = self._exact_of.get(i)
        return TimeAxis(
            self._column,
            self.since[begin : begin + n],
            float(self._starts[i]),
            float(self._precisions[i]),
            self._certain,
            None if exact is None else self._fraction(exact),
            self._decided,
            unit=self._unit,
        )

    @cached_property
    def _exact_of(self) -> dict[int, int]:
        pairs = zip(self._many.tolist(), self._exact, strict=True)
        return {place: step for place, step in pairs if step is not None}

    def far_apart(self, step: float) -> Booleans:
        """Return which groups have two rows only, farther apart than the steps of other groups.

        Args:
            step: The usual step of other groups in the unit of the column.
        """
        most = HOLE * step * self._unit / UNITS["s"]
        return np.asarray((self._rows.lengths == 2) & (self.usual >= most))

    def starts_at(self, i: int) -> float:
        """Return the time of the first row of a group in seconds."""
        return float(self._starts[i])

    @property
    def doubtful(self) -> Booleans:
        """Whether `TimeAxis.unit_note` of each group may have a text."""
        result = np.zeros(len(self._rows.lengths), bool)
        if not self._certain and len(self._many):
            result[self._many] = self._steps.least(self.steps) >= 1
        return result

    def gaps(self, usual: float | None) -> list[Gap | None]:
        """Return the longest gap of each group.

        Args:
            usual: The usual step; None for the usual step of each group.
        """
        gaps: list[Gap | None] = [None] * len(self._rows.lengths)
        if not len(self._many):
            return gaps
        most = self._steps.greatest(self.steps)
        (longest,) = np.nonzero(self.steps == self._steps.repeated(most))
        first = longest[np.searchsorted(longest, self._steps.begins)]
        # The steps of a group lack one row of each group up to it with several rows.
        before = self._rows.begins[self._many] + first - self._steps.begins
        begins = self.since[before] + self._starts[self._many]
        usuals = self.usual[self._many] if usual is None else np.full(len(most), usual)
        rows = zip(
            *(self._many.tolist(), most.tolist(), begins.tolist(), usuals.tolist()), strict=True
        )
        for place, seconds, begin, step in rows:
            gaps[place] = Gap(seconds, begin, step)
        return gaps

    def near(self, period: float) -> Booleans:
        """Return whether all steps of each group are a stated period; also for one row."""
        result = np.ones(len(self._rows.lengths), bool)
        if len(self._many):
            least, most = self._steps.least(self.steps), self._steps.greatest(self.steps)
            room = NEAR * period
            result[self._many] = (period - least <= room) & (most - period <= room)
        return result

    def periods(self) -> list[Fraction | None]:
        """Return the period of each group; None for one row or uneven times."""
        periods: list[Fraction | None] = [None] * len(self._rows.lengths)
        many = self._many[self.plain[self._many]]
        exact = self._exact_of
        usual = self.usual
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            last = self.since[self._rows.begins + self._rows.lengths - 1]
            slopes = last / np.maximum(self._rows.lengths - 1, 1)
            evenly = [*exact]
            slopes[evenly] = usual[evenly]
            off = self.since - self._rows.numbers * self._rows.repeated(slopes)
            spreads = self._rows.greatest(off) - self._rows.least(off)
            room = 2 * self._precisions
            even = spreads <= 2 * NEAR * slopes + room
            even &= (usual >= PERIODS[0]) & (usual <= PERIODS[1])
            blurs = np.maximum(
                1e-9 * slopes, (room + 2 * spreads) / np.maximum(self._rows.lengths - 1, 1)
            )
        many = many[even[many]]
        left = []
        for place in many.tolist():
            if place in exact:
                periods[place] = self._fraction(exact[place])
            else:
                left.append(place)
        pending = np.array(left, np.intp)
        for _ in range(_TRIED):
            if not len(pending):
                return periods
            period = simple(float(slopes[pending[0]]), float(blurs[pending[0]]))
            same = _are_simplest(period, slopes[pending], blurs[pending])
            same[0] = True
            for place in pending[same].tolist():
                periods[place] = period
            pending = pending[~same]
        for place in pending.tolist():
            periods[place] = simple(float(slopes[place]), float(blurs[place]))
        return periods


def _are_simplest(period: Fraction, values: Floats, blurs: Floats) -> Booleans:
    """Return for which values `simple` certainly returns this period.

    Two fractions with denominators up to D are at least 1 / D**2 apart. So a period with such a
    denominator is unique if it is nearer than half of this distance.
    """
    power = max(1, len(str(period.denominator - 1)))
    if power > 7:  # floats are too coarse
        return np.zeros(len(values), bool)
    room = 0.49 / 10.0 ** (2 * power)
    return np.asarray((np.abs(values - float(period)) <= 0.999 * blurs) & (blurs <= room))
