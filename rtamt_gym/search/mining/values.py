"""The values that a parameter may have, by number: a grid of decimals, or all floats of a range."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, Protocol

from rtamt import InputError
from rtamt_gym.checks.arguments import check_number
from rtamt_gym.checks.numbers import exact

__all__ = ["Candidates", "FloatValues", "GridValues", "bounds_between", "text_of", "values_between"]


class Candidates(Protocol):
    """Increasing values of a parameter, counted from 0."""

    @property
    def last(self) -> int:
        """The number of the greatest value."""

    def at(self, place: int) -> Fraction:
        """The value of a number."""

    def near(self, part: Fraction) -> int:
        """The number of a value near a part of the range, from 0 to 1."""


@dataclass(frozen=True)
class GridValues:
    """The multiples of a step in a range, with both ends of the range.

    Attributes:
        low: The least value.
        high: The greatest value.
        step: The step; a value and the next differ by this or, at an end, less.
    """

    low: Fraction
    high: Fraction
    step: Fraction

    @property
    def last(self) -> int:
        """The number of the greatest value."""
        return math.ceil(self.high / self.step) - math.floor(self.low / self.step)

    def at(self, place: int) -> Fraction:
        """The value of a number."""
        value = (math.floor(self.low / self.step) + place) * self.step
        return min(max(value, self.low), self.high)

    def near(self, part: Fraction) -> int:
        """The number of a value near a part of the range, from 0 to 1."""
        return round(part * self.last)


@dataclass(frozen=True)
class FloatValues:
    """All floats of a range: a value and the next are neighbours.

    Those nearer to 0 than 1e-300 are left out: texts of specifications do not take them.

    Attributes:
        low: The least value.
        high: The greatest value.
    """

    low: float
    high: float

    @property
    def last(self) -> int:
        """The number of the greatest value."""
        return _ordinal(self.high) - _ordinal(self.low)

    def at(self, place: int) -> Fraction:
        """The value of a number."""
        return Fraction(_float(_ordinal(self.low) + place))

    def near(self, part: Fraction) -> int:
        """The number of a value near a part of the range, from 0 to 1."""
        value = Fraction(self.low) + part * (Fraction(self.high) - Fraction(self.low))
        return _ordinal(float(value)) - _ordinal(self.low)


def _bits(value: float) -> int:
    """The number of a float above 0 in the order of all of these."""
    (bits,) = struct.unpack("<q", struct.pack("<d", value))
    return int(bits)


_LEAST: Final = _bits(1e-300)


def _ordinal(value: float) -> int:
    """The number of a float in the order of all: 0 has the number 0, 1e-300 the number 1."""
    ordinal = max(0, _bits(abs(value)) - _LEAST + 1)
    return ordinal if value > 0 else -ordinal


def _float(ordinal: int) -> float:
    """The float of a number."""
    if ordinal == 0:
        return 0.0
    (value,) = struct.unpack("<d", struct.pack("<q", abs(ordinal) - 1 + _LEAST))
    return math.copysign(float(value), ordinal)


def values_between(low: float, high: float, tolerance: float | None) -> Candidates:
    """The candidate values of a constant: steps of a tolerance, or all floats of a range.

    Args:
        low: The least value.
        high: The greatest value.
        tolerance: The distance of two values; 0: all floats; None: the power of ten at or below a
            100,000th of the range.

    Raises:
        InputError: If the tolerance is not a finite number from 0 up to the width of the range.

    Example:
        >>> [text_of(values_between(1, 200, step).at(1)) for step in (None, 0.25, 0)]
        ['1.001', '1.25', '1.0000000000000002']
    """
    if tolerance == 0:
        return FloatValues(low, high)
    least, most = exact(low), exact(high)
    if tolerance is None:
        step = Fraction(10) ** (math.floor(math.log10(high - low)) - 5)
    else:
        step = exact(check_number("tolerance", tolerance, high - low))
    return GridValues(least, most, step)


def bounds_between(low: float, high: float, step: Fraction) -> Candidates:
    """The bounds of an interval that are multiples of a step.

    Raises:
        InputError: If there are less than two in the range.
    """
    least, most = exact(low), exact(high)
    values = GridValues(math.ceil(least / step) * step, math.floor(most / step) * step, step)
    if values.last < 1:
        raise InputError(
            f"expected a range with two multiples of the period at least, got {text_of(least)} to "
            f"{text_of(most)} where one is {text_of(step)}"
        )
    return values


def text_of(value: Fraction | float) -> str:
    """Write a value so that it is read as the same float.

    Example:
        >>> text_of(Fraction(120214, 1000)), text_of(2.0), text_of(Fraction(1, 3))
        ('120.214', '2', '0.3333333333333333')
    """
    return repr(float(value)).removesuffix(".0")
