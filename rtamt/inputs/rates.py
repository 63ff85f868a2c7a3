"""The rates of change in a program: values that readers derive from two samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from rtamt.inputs.arrays import Floats
from rtamt.inputs.between import UncertainValue
from rtamt.program.program import Program


class Rates:
    """Computes the rates of a program.

    The rate is 0 at sample 0 and between two equal values, infinite ones included.
    """

    __slots__ = ("_places", "_seconds")

    def __init__(self, program: Program) -> None:
        self._places = [program.variables.index(name) for name in program.rates.values()]
        self._seconds = program.seconds

    def __bool__(self) -> bool:
        return bool(self._places)

    def of_sample(
        self, values: Sequence[float | UncertainValue], previous: Sequence[float | UncertainValue]
    ) -> list[float | UncertainValue]:
        """Return the rates at a sample; `previous` is empty for the first one."""
        if not previous:
            return [0.0] * len(self._places)
        return [self._rate(values[position], previous[position]) for position in self._places]

    def _rate(
        self, value: float | UncertainValue, before: float | UncertainValue
    ) -> float | UncertainValue:
        if not (isinstance(value, UncertainValue) or isinstance(before, UncertainValue)):
            return 0.0 if value == before else (value - before) / self._seconds
        low, high = _ends(value)
        low_before, high_before = _ends(before)
        lower = (low - high_before) / self._seconds
        upper = (high - low_before) / self._seconds
        if lower != lower or upper != upper:  # noqa: PLR0124 - nan
            return UncertainValue(-np.inf, np.inf)
        return lower if lower == upper != 0 else UncertainValue(lower, upper)

    def of_columns(self, columns: Sequence[Floats], previous: Sequence[float] = ()) -> list[Floats]:
        """Return the rates at each sample of a block; nan if a value is nan."""
        return [
            self._column(columns[position], previous[position : position + 1])
            for position in self._places
        ]

    def _column(self, column: Floats, previous: Sequence[float]) -> Floats:
        before = np.concatenate([previous if len(previous) else column[:1], column[:-1]])
        with np.errstate(invalid="ignore", over="ignore"):
            rates = (column - before) / self._seconds
        rates[column == before] = 0.0
        if len(rates) and not len(previous):
            rates[0] = 0.0
        return cast("Floats", rates)

    def of_bounds(
        self, lower: Sequence[Floats], upper: Sequence[Floats]
    ) -> tuple[list[Floats], list[Floats]]:
        """Return the smallest and largest rates of a trace with values between columns."""
        low_rates: list[Floats] = []
        high_rates: list[Floats] = []
        for position in self._places:
            low, high = lower[position], upper[position]
            known = low == high
            known[1:] &= known[:-1].copy()
            known[:1] = True
            exact = self._column(low, ())
            with np.errstate(invalid="ignore", over="ignore"):
                least = (low[1:] - high[:-1]) / self._seconds
                greatest = (high[1:] - low[:-1]) / self._seconds
            absent = np.isnan(least) | np.isnan(greatest)
            for rates, ends, unknown in (
                (low_rates, least, -np.inf),
                (high_rates, greatest, np.inf),
            ):
                ends[absent] = unknown
                rates.append(np.where(known, exact, np.concatenate([exact[:1], ends])))
        return low_rates, high_rates


def _ends(value: float | UncertainValue) -> tuple[float, float]:
    if isinstance(value, UncertainValue):
        return cast("tuple[float, float]", (value.lower, value.upper))
    return value, value
