"""Intervals of time offsets, exact numbers, and numbers that remember the constants of a text.

Compilation replaces the names of constants by numbers. With traced constants, these numbers are
`Traced`. They are floats, so the program stays the same.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from functools import cached_property
from typing import Self, cast

from rtamt.errors import InputTypeError, SpecificationError, brief, is_one_of

UNITS: dict[str, Fraction] = {
    "s": Fraction(1),
    "ms": Fraction(1, 10**3),
    "us": Fraction(1, 10**6),
    "ns": Fraction(1, 10**9),
    "ps": Fraction(1, 10**12),
    "min": Fraction(60),
    "h": Fraction(3600),
}
"""Time units in seconds."""

Exact = int | float | str | Decimal | Fraction

MAX_DIGITS = 1000
"""The most characters of a number: more would take long to compute with."""

_TEXT = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e([+-]?\d+)|/\d+)?", re.ASCII | re.IGNORECASE)
_LARGEST = 10**300


def no_unit(text: object) -> str:
    """Return the reason to refuse an unknown unit."""
    return f"expected a unit ({', '.join(UNITS)}), got {brief(text)}"


def exact(value: Exact, label: str) -> Fraction:
    """Return the exact value of a finite number; a float means its shortest decimal text.

    Errors call the number by its label, such as ``"the period"``. The length of a text is checked
    first, because long numbers take long to compute with.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str | Decimal | Fraction):
        msg = f"expected a number for {label}, got {type(value).__name__} {brief(value)}"
        raise InputTypeError(msg)
    if isinstance(value, int | Fraction):
        longest = max(abs(value.numerator), value.denominator)
        number = None if longest > 10**MAX_DIGITS else Fraction(value)
    else:
        number = _read(repr(float(value)) if isinstance(value, float) else str(value), value, label)
    if number is not None and (number == 0 or Fraction(1, _LARGEST) <= abs(number) <= _LARGEST):
        return number
    shown = value if isinstance(value, str) and len(value) <= MAX_DIGITS else brief(value)
    msg = f"expected a number between 1e-300 and 1e300 for {label}, got {shown}"
    raise SpecificationError(msg)


def _read(text: str, value: object, label: str) -> Fraction | None:
    """Return the number in a text; None if it is too large or too small to compute with."""
    if len(text) > MAX_DIGITS:
        msg = f"expected a number of at most {MAX_DIGITS} characters for {label}, got {len(text)}"
        raise SpecificationError(msg)
    match = _TEXT.fullmatch(text.strip())
    try:
        if match is not None:
            return Fraction(text) if abs(int(match[4] or 0)) <= MAX_DIGITS else None
    except ZeroDivisionError:
        pass
    msg = f"expected a finite number for {label}, got {brief(value)}"
    raise SpecificationError(msg)


def is_decimal(value: Fraction) -> bool:
    """Return whether a decimal text can write a fraction exactly."""
    remainder = value.denominator
    for prime in (2, 5):
        while remainder % prime == 0:
            remainder //= prime
    return remainder == 1


def decimal_text(value: Fraction) -> str:
    """Return the shortest exact decimal text of a fraction.

    Raises:
        SpecificationError: If the fraction has no exact decimal text, as one third.
    """
    scale = 0
    while (value * 10**scale).denominator != 1:
        scale += 1
        if 2**scale > value.denominator**4 + 2**64:
            msg = f"expected a decimal number, got {value}, which has no exact decimal text"
            raise SpecificationError(msg)
    digits = str(abs(int(value * 10**scale))).rjust(scale + 1, "0")
    sign = "-" if value < 0 else ""
    return sign + (f"{digits[:-scale]}.{digits[-scale:]}" if scale else digits)


def number_text(value: float) -> str:
    """Return the shortest text that reads back as the number."""
    return repr(value).removesuffix(".0")


@dataclass(frozen=True, slots=True)
class Interval:
    """Offsets ``[begin, end]`` from now, both included.

    Attributes:
        begin: The smallest offset; not negative.
        end: The largest offset; None if unbounded.
        unit: Unit of both bounds. None: the unit of the specification, or samples without a period.

    Raises:
        SpecificationError: If a bound is negative, the end is before the start, or the unit is
            unknown.
    """

    begin: Fraction
    end: Fraction | None
    unit: str | None = None

    def __post_init__(self) -> None:
        """Check the bounds and the unit."""
        bounds: tuple[object, ...] = (self.begin,) if self.end is None else (self.begin, self.end)
        for bound in bounds:
            if not isinstance(bound, Fraction):
                msg = f"expected a Fraction as the bound of an interval, got {brief(bound)}"
                raise InputTypeError(f"{msg}; Interval.of takes numbers")
        if self.begin < 0 or (self.end is not None and self.end < self.begin):
            minimum = "0" if self.begin < 0 else decimal_text(self.begin)
            wrong = self.begin if self.begin < 0 else cast("Fraction", self.end)
            msg = f"expected a bound of at least {minimum}, got {decimal_text(wrong)}"
            raise SpecificationError(msg)
        if self.unit is not None and not is_one_of(self.unit, UNITS):
            raise SpecificationError(no_unit(self.unit))
        decimal_text(self.begin)
        if self.end is not None:
            decimal_text(self.end)

    @classmethod
    def of(cls, begin: Exact, end: Exact | None) -> Interval | None:
        """Return the interval of two bounds; the end may have a unit: ``of(0, "500ms")``.

        Returns:
            The interval; None for ``[0, inf)``.
        """
        unit = None
        if isinstance(end, str):
            text = end.strip()
            digits = text.rstrip("abcdefghijklmnopqrstuvwxyz")
            if text.startswith("inf"):
                digits, end = "inf", None
            else:
                end = digits.strip() or text
            unit = text[len(digits) :].strip() or None
        elif isinstance(end, float) and end == math.inf:
            end = None
        first = exact(begin, "the start of an interval")
        last = None if end is None else exact(end, "the end of an interval")
        return None if last is None and first == 0 else cls(first, last, unit)

    def __str__(self) -> str:
        end = "inf" if self.end is None else decimal_text(self.end)
        # "inf" is a word: its unit needs a space before it.
        unit = "" if self.unit is None else (" " if self.end is None else "") + self.unit
        return f"[{decimal_text(self.begin)}:{end}{unit}]"


class Traced(float):
    """A number that depends on constants of a text; it equals any equal number.

    Example:
        >>> limit = Traced(4.0, "limit")
        >>> root = applied("sqrt", lambda x: x**0.5, limit)
        >>> float(root), root, sorted(root.constants)
        (2.0, sqrt(limit), ['limit'])
    """

    source: str  # the name of the constant, or of the function that returned the number
    operands: tuple[float, ...]  # the operands of the function; empty for a constant

    def __new__(cls, value: float, source: str, operands: tuple[float, ...] = ()) -> Self:
        """Return a number with its source and operands."""
        traced = super().__new__(cls, value)
        traced.source, traced.operands = source, operands
        return traced

    @cached_property
    def constants(self) -> frozenset[str]:
        """The names of all constants in the computation of this number."""
        if not self.operands:
            return frozenset((self.source,))
        traced = [operand for operand in self.operands if isinstance(operand, Traced)]
        return frozenset[str]().union(*(operand.constants for operand in traced))

    @cached_property
    def text(self) -> str:
        """The term of this number, with the names of its constants."""
        operands = ", ".join(number_text(operand) for operand in self.operands)
        return f"{self.source}({operands})" if self.operands else self.source

    def __repr__(self) -> str:
        return self.text


def applied(name: str, function: Callable[..., float], *operands: float) -> float:
    """Return the function of the operands; traced if an operand is."""
    value = function(*map(float, operands))
    traced = any(isinstance(operand, Traced) for operand in operands)
    return Traced(value, name, operands) if traced else value


@dataclass(frozen=True, slots=True)
class TracedInterval(Interval):
    """An interval with a constant as a bound, times a factor for sign and unit.

    Intervals with the same bounds but other constants differ. It may be ``[0, inf)``.
    """

    # the constant of the start and its factor; None if the start is a number
    begin_of: tuple[str, Fraction] | None = None
    # the constant of the end and its factor; None if the end is a number
    end_of: tuple[str, Fraction] | None = None

    @property
    def constants(self) -> frozenset[str]:
        """The names of the constants that are bounds."""
        return frozenset(bound[0] for bound in (self.begin_of, self.end_of) if bound is not None)

    def at(self, values: Mapping[str, Fraction]) -> Interval | None:
        """Return the interval for values of the constants; None if it is ``[0, inf)``."""
        begin = self.begin if self.begin_of is None else values[self.begin_of[0]] * self.begin_of[1]
        end = self.end if self.end_of is None else values[self.end_of[0]] * self.end_of[1]
        return None if end is None and begin == 0 else Interval(begin, end, self.unit)
