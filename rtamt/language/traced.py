"""Numbers that know how they follow from the constants of a text.

A formula with numbers is compiled to a program with numbers, and the names of constants are gone.
A text that is read with traced constants has numbers in their place that remember the names. They
are floats, so everything that is made of them is the same, and what is computed of them is traced.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Self

__all__ = ["Traced", "applied"]


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
