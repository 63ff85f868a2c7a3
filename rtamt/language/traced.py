"""Numbers and intervals that know how they follow from the constants of a text.

A formula with numbers is compiled to a program with numbers, and the names of constants are gone.
A text that is read with traced constants has numbers in their place that remember the names. They
are floats, so everything that is made of them is the same, and what is computed of them is traced.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Self

from rtamt.language.interval import Interval

__all__ = ["Traced", "TracedInterval", "applied"]


class Traced(float):
    """A number that follows from constants of a text.

    It is equal to any equal number. Its text tells it from them.

    Attributes:
        source: The name of the constant, or of the function that gave the number.
        operands: The operands of the function; empty for a constant.

    Example:
        >>> limit = Traced(4.0, "limit")
        >>> root = applied("sqrt", lambda x: x**0.5, limit)
        >>> float(root), root, sorted(root.constants)
        (2.0, sqrt(limit), ['limit'])
    """

    source: str
    operands: tuple[float, ...]

    def __new__(cls, value: float, source: str, operands: tuple[float, ...] = ()) -> Self:
        """A number that is this function of the operands, or the constant of this name."""
        traced = super().__new__(cls, value)
        traced.source, traced.operands = source, operands
        return traced

    @cached_property
    def constants(self) -> frozenset[str]:
        """The names of the constants from which this number follows."""
        if not self.operands:
            return frozenset((self.source,))
        traced = [each for each in self.operands if isinstance(each, Traced)]
        return frozenset[str]().union(*(each.constants for each in traced))

    @cached_property
    def text(self) -> str:
        """The term that it is the value of."""
        operands = ", ".join(repr(each).removesuffix(".0") for each in self.operands)
        return f"{self.source}({operands})" if self.operands else self.source

    def __repr__(self) -> str:
        return self.text


def applied(name: str, function: Callable[..., float], *operands: float) -> float:
    """The function of the operands; traced if an operand is."""
    value = function(*(float(each) for each in operands))
    traced = any(isinstance(each, Traced) for each in operands)
    return Traced(value, name, operands) if traced else value


@dataclass(frozen=True, slots=True)
class TracedInterval(Interval):
    """An interval with a bound that is a constant of a text, times a factor for sign and unit.

    It differs from one with the same bounds of other names. Here it may be ``[0, inf)``.

    Attributes:
        begin_of: The name of the constant that is the begin, and the factor; None if a number is.
        end_of: The same of the end.
    """

    begin_of: tuple[str, Fraction] | None = None
    end_of: tuple[str, Fraction] | None = None

    @property
    def constants(self) -> frozenset[str]:
        """The names of the constants that are its bounds."""
        return frozenset(of[0] for of in (self.begin_of, self.end_of) if of is not None)

    def at(self, values: Mapping[str, Fraction]) -> Interval | None:
        """The interval of these values; None, which is ``[0, inf)``, if there is nothing to bound.

        Raises:
            SpecificationError: If they make no interval.
        """
        begin = self.begin if self.begin_of is None else values[self.begin_of[0]] * self.begin_of[1]
        end = self.end if self.end_of is None else values[self.end_of[0]] * self.end_of[1]
        return None if end is None and begin == 0 else Interval(begin, end, self.unit)
