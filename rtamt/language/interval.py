"""Intervals of time offsets, with bounds that are exact decimal numbers."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import cast

from rtamt.errors import InputTypeError, SpecificationError, brief, is_one_of

__all__ = ["UNITS", "Exact", "Interval", "decimal_text", "exact", "is_decimal", "no_unit"]

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


def no_unit(text: object) -> str:
    """The reason to refuse what is not a unit."""
    return f"expected one of the units {', '.join(UNITS)}, got {brief(text)}"


MAX_DIGITS = 1000
"""The most characters of a number: more would take long to compute with."""

_TEXT = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)(e([+-]?\d+)|/\d+)?", re.ASCII | re.IGNORECASE)
_LARGEST = 10**300


def exact(value: Exact, what: str) -> Fraction:
    """The exact value of a finite number; a float means its shortest decimal text.

    Raises:
        SpecificationError: If it is not a number between 1e-300 and 1e300 or 0, or has more than
            `MAX_DIGITS` digits. The text is checked before it is computed with.
        InputTypeError: If it is no number.
    """
    if isinstance(value, bool) or not isinstance(value, int | float | str | Decimal | Fraction):
        msg = f"expected a number for {what}, got {type(value).__name__} {brief(value)}"
        raise InputTypeError(msg)
    if isinstance(value, int | Fraction):
        longest = max(abs(value.numerator), value.denominator)
        number = None if longest > 10**MAX_DIGITS else Fraction(value)
    else:
        number = _read(repr(float(value)) if isinstance(value, float) else str(value), value, what)
    if number is not None and (number == 0 or Fraction(1, _LARGEST) <= abs(number) <= _LARGEST):
        return number
    shown = value if isinstance(value, str) and len(value) <= MAX_DIGITS else brief(value)
    msg = f"expected a number between 1e-300 and 1e300 for {what}, got {shown}"
    raise SpecificationError(msg)


def _read(text: str, value: object, what: str) -> Fraction | None:
    """The number that a text writes; None if it is too large or too small to compute with."""
    if len(text) > MAX_DIGITS:
        msg = f"expected a number of at most {MAX_DIGITS} characters for {what}, got {len(text)}"
        raise SpecificationError(msg)
    match = _TEXT.fullmatch(text.strip())
    try:
        if match is not None:
            return Fraction(text) if abs(int(match[4] or 0)) <= MAX_DIGITS else None
    except ZeroDivisionError:
        pass
    msg = f"expected a finite number for {what}, got {brief(value)}"
    raise SpecificationError(msg)


def is_decimal(value: Fraction) -> bool:
    """Return whether a decimal text writes a fraction exactly."""
    rest = value.denominator
    for prime in (2, 5):
        while rest % prime == 0:
            rest //= prime
    return rest == 1


def decimal_text(value: Fraction) -> str:
    """The shortest decimal text that is exactly the fraction; one third has none."""
    scale = 0
    while (value * 10**scale).denominator != 1:
        scale += 1
        if 2**scale > value.denominator**4 + 2**64:
            msg = f"expected a decimal number, got {value}, which no decimal text writes exactly"
            raise SpecificationError(msg)
    digits = str(abs(int(value * 10**scale))).rjust(scale + 1, "0")
    sign = "-" if value < 0 else ""
    return sign + (f"{digits[:-scale]}.{digits[-scale:]}" if scale else digits)


@dataclass(frozen=True, slots=True)
class Interval:
    """Offsets ``[begin, end]`` from now, both included.

    Attributes:
        begin: Least offset, not negative.
        end: Greatest offset, or None for no end.
        unit: Unit of both bounds, or None: samples without a period, else the specification's unit.
    """

    begin: Fraction
    end: Fraction | None
    unit: str | None = None

    def __post_init__(self) -> None:
        """Check the bounds and the unit.

        Raises:
            SpecificationError: On a negative bound, ``end < begin`` or an unknown unit.
        """
        bounds: tuple[object, ...] = (self.begin,) if self.end is None else (self.begin, self.end)
        for bound in bounds:
            if not isinstance(bound, Fraction):
                msg = f"expected a Fraction as the bound of an interval, got {brief(bound)}"
                raise InputTypeError(f"{msg}; Interval.of takes numbers")
        if self.begin < 0 or (self.end is not None and self.end < self.begin):
            least = "0" if self.begin < 0 else decimal_text(self.begin)
            wrong = self.begin if self.begin < 0 else cast("Fraction", self.end)
            msg = f"expected a bound of at least {least}, got {decimal_text(wrong)}"
            raise SpecificationError(msg)
        if self.unit is not None and not is_one_of(self.unit, UNITS):
            raise SpecificationError(no_unit(self.unit))
        decimal_text(self.begin)
        if self.end is not None:
            decimal_text(self.end)

    @classmethod
    def of(cls, begin: Exact, end: Exact | None) -> Interval | None:
        """The interval of two bounds; the end may carry a unit: ``of(0, "500ms")``.

        None, which is ``[0, inf)``, if there is nothing to bound.
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
        first = exact(begin, "the begin of an interval")
        last = None if end is None else exact(end, "the end of an interval")
        return None if last is None and first == 0 else cls(first, last, unit)

    def __str__(self) -> str:
        end = "inf" if self.end is None else decimal_text(self.end)
        # "inf" is a word: its unit needs a space before it.
        unit = "" if self.unit is None else (" " if self.end is None else "") + self.unit
        return f"[{decimal_text(self.begin)}:{end}{unit}]"
