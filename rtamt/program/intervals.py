"""Interval arithmetic: the values of a function of unknown operands.

The rules take the smallest and the largest value of each operand, with -0.0 below 0.0, so bounds
keep the sign bit that states whether a predicate holds. Each row of
`rtamt.program.algebra.FUNCTIONS` names its rule; `everything` is right for all of them. The C++
machines have the same rules in ``core/intervals.hpp`` and the same bounds, bit for bit.

Operands without a value, such as -1 of a square root, are left out. An end that is not a number,
such as inf - inf, makes the range everything.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

INF = math.inf
Ends = tuple[float, float]
"""The smallest and the largest value."""

EVERYTHING: Ends = (-INF, INF)


class Range(NamedTuple):
    """The possible values of a term."""

    lower: float  # the smallest one
    upper: float  # the largest one
    known: bool = False  # whether the term reads no unknown sample, so that both are its value


def of_ends(lower: float, upper: float) -> Range:
    """Return the range of a variable, which is known if its ends are the same to the bit."""
    same = lower == upper and math.copysign(1.0, lower) == math.copysign(1.0, upper)
    return Range(lower, upper, same)


_Apply = Callable[..., float]
IntervalRule = Callable[..., Ends | None]
"""Takes the function and the range of each operand; None if the function has no value there."""


def range_of(apply: _Apply, rule: IntervalRule, *operands: Range) -> Range | None:
    """Return the values of a function; None without a value, or if known operands give nan."""
    if all(operand.known for operand in operands):
        value = apply(*(operand.lower for operand in operands))
        return None if value != value else Range(value, value, known=True)  # noqa: PLR0124 - nan
    ends = rule(apply, *operands)
    return None if ends is None else Range(*ends)


def everything(apply: _Apply, *operands: Range) -> Ends:  # noqa: ARG001 - it is a rule
    """Return the rule of a function about which nothing is known."""
    return EVERYTHING


def monotone(directions: str, *, least: float = -INF, wider: bool = False) -> IntervalRule:
    """Return the rule of a function that rises (``+``) or falls (``-``) with each operand."""

    def rule(apply: _Apply, *operands: Range) -> Ends | None:
        low, high = [], []
        for direction, operand in zip(directions, operands, strict=True):
            if operand.upper < least:
                return None
            ends = _greatest((operand.lower, least)), operand.upper
            low.append(ends[direction == "-"])
            high.append(ends[direction == "+"])
        hull = _hull((apply(*low), apply(*high)))
        return _outward(hull) if wider else hull

    return rule


def even(apply: _Apply, x: Range) -> Ends:
    """Return the rule of the absolute value."""
    ends = apply(x.lower), apply(x.upper)
    spans = _negative(x.lower) and not _negative(x.upper)
    return 0.0 if spans else _least(ends), _greatest(ends)


def corners(apply: _Apply, *operands: Range) -> Ends:
    """Return the rule of a function that is monotone in each operand, up or down."""
    return _hull(apply(*values) for values in itertools.product(*(o[:2] for o in operands)))


def quotient(apply: _Apply, x: Range, y: Range) -> Ends:
    """Return the rule of a division: everything if an unknown divisor may be 0."""
    if not y.known and y.lower <= 0.0 <= y.upper:
        return EVERYTHING
    return corners(apply, x, y)


def near(apply: _Apply, x: Range, y: Range) -> Ends:  # noqa: ARG001 - it is a rule
    """Return the rule of ``-abs(x - y)``, which is 0.0 where both are equal."""
    lower, upper = _hull((x.lower - y.upper, x.upper - y.lower))
    far = max(abs(lower), abs(upper))
    close = 0.0 if lower <= 0.0 <= upper else min(abs(lower), abs(upper))
    return 0.0 - far, 0.0 - close


def meeting(apply: _Apply, x: Range, y: Range) -> Ends:  # noqa: ARG001 - it is a rule
    """Return the rule of ``x == y`` without a margin."""
    always = x.lower == x.upper == y.lower == y.upper
    ever = x.lower <= y.upper and y.lower <= x.upper
    return INF if always else -INF, INF if ever else -INF


def opposite(rule: IntervalRule) -> IntervalRule:
    """Return the rule of the function with the other sign."""

    def negated(apply: _Apply, *operands: Range) -> Ends | None:
        ends = rule(apply, *operands)
        return None if ends is None else (-ends[1], -ends[0])

    return negated


def power(apply: _Apply, x: Range, y: Range) -> Ends | None:
    """Return the rule of ``pow``: everything, unless it is monotone in both operands."""
    if _negative(x.lower):
        if x.lower > -INF and not _has_whole(y):  # a negative base has no such power
            if x.upper < 0.0:
                return None
            x = Range(0.0, x.upper + 0.0)
        elif not _is_monotone_power(x, y):
            return EVERYTHING
    return _outward(corners(apply, x, y))


def _has_whole(y: Range) -> bool:
    """Return whether a whole number lies in a range; both infinities count as whole."""
    if math.isinf(y.lower) or math.isinf(y.upper):
        return True
    return math.ceil(y.lower) <= y.upper


def _is_monotone_power(x: Range, y: Range) -> bool:
    """Return whether a power is monotone on a range with negative bases or -0.0."""
    n = y.lower
    if n != y.upper or not _has_whole(y):
        return False
    if not math.isinf(n) and math.fmod(n, 2.0) != 0.0:
        return n > 0.0 or _negative(x.upper)  # an odd one jumps at 0 if it is negative
    return n == 0.0 or x.upper <= 0.0 or x.lower >= 0.0


def logarithm(ln: Callable[[float], float], div: Callable[[float, float], float]) -> IntervalRule:
    """Return the rule of ``log``, a quotient of two natural logarithms."""
    logarithm_of = functools.partial(monotone("+", least=-0.0), ln)

    def rule(apply: _Apply, x: Range, base: Range) -> Ends | None:  # noqa: ARG001 - it is a rule
        over, under = logarithm_of(x), logarithm_of(base)
        if over is None or under is None:
            return None
        if not base.known and under[0] <= 0.0 <= under[1]:
            return EVERYTHING
        exact = corners(div, Range(*over), Range(*under))
        # A step of the logarithm may be larger than a step of the quotient.
        under = under if base.known else _outward(under)
        stepped = corners(div, Range(*_outward(over)), Range(*under))
        return _hull((*_outward(exact), *stepped))

    return rule


def _hull(values: Iterable[float]) -> Ends:
    """Return the smallest and the largest of some numbers; everything if one is nan."""
    numbers = list(values)
    return EVERYTHING if any(map(math.isnan, numbers)) else (_least(numbers), _greatest(numbers))


def _outward(ends: Ends) -> Ends:
    """Return the range with each end one step further, but never of the other sign."""
    lower, upper = ends
    if lower != 0.0 or _negative(lower):
        lower = math.nextafter(lower, -INF)
    if upper != 0.0 or not _negative(upper):
        upper = math.nextafter(upper, INF)
    return lower, upper


def _order(x: float) -> tuple[float, float]:
    return x, math.copysign(1.0, x)


def _least(values: Iterable[float]) -> float:
    return min(values, key=_order)


def _greatest(values: Iterable[float]) -> float:
    return max(values, key=_order)


def _negative(x: float) -> bool:
    return math.copysign(1.0, x) < 0.0
