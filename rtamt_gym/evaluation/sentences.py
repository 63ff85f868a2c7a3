"""A comparison in words: what is shown, and what is not."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

from rtamt_gym.evaluation.evaluation import SUCCESS
from rtamt_gym.evaluation.paired import Effect
from rtamt_gym.tables import counted

if TYPE_CHECKING:
    from rtamt_gym.evaluation.comparison import Compared

__all__ = ["LEVEL", "effect_sentence", "p_text", "points", "sentence_of", "short"]

LEVEL: Final = 0.05
"""Rates are called different if the adjusted p-value lies below."""


def sentence_of(compared: Compared) -> str:
    """What is shown about the rates of one requirement, and about its robustness."""
    parts = [_rates(compared)]
    if compared.robustness is not None:
        parts.append(effect_sentence(compared.robustness, "its robustness"))
    return " ".join(parts)


def _rates(compared: Compared) -> str:
    name = SUCCESS if compared.name == SUCCESS else f"`{compared.name}`"
    gap, pairs = compared.difference, compared.pairs
    low, high = (points(end, pairs) for end in compared.interval)
    if compared.adjusted < LEVEL:
        ends = sorted(abs(end) for end in compared.interval)
        low, high = (points(end, pairs) for end in ends)
        return (
            f"B satisfies {name} in {_counted_points(abs(gap), pairs)} "
            f"{'more' if gap > 0 else 'less'} of the episodes "
            f"(95%: {low} to {high}; {p_text(compared.adjusted)})."
        )
    start = f"No difference is shown for {name}:"
    if compared.only_a == compared.only_b == 0:
        agree = "agree in the only episode" if pairs == 1 else f"agree in all {pairs} episodes"
        return f"{start} A and B {agree} (95%: {low} to {high} points)."
    return (
        f"{start} {_counted_points(gap, pairs)}, {low} to {high} "
        f"(95%; {p_text(compared.adjusted)})."
    )


def effect_sentence(effect: Effect, what: str) -> str:
    """What is shown about a measurement, such as ``"the return"``."""
    middle = "on average" if effect.statistic == "mean" else "in the median"
    low, high = effect.interval
    name = what[0].upper() + what[1:]
    if all(a == b for a, b in effect.pairs):
        return f"{name} is the same in each pair."
    if low > 0 or high < 0:
        ends = sorted(abs(end) for end in effect.interval)
        return (
            f"{name} is {short(abs(effect.value))} {'greater' if low > 0 else 'less'} "
            f"{middle} (95%: {short(ends[0])} to {short(ends[1])})."
        )
    if math.isinf(low) and math.isinf(high):
        return f"{counted(len(effect.pairs), 'pair')} can say nothing of {what}."
    return (
        f"No difference of {what} is shown: {short(effect.value)} {middle} "
        f"(95%: {short(low)} to {short(high)})."
    )


def points(share: float, pairs: int) -> str:
    """A difference of rates in points of a hundred, in tenths where so many pairs tell them apart.

    Example:
        >>> points(0.118, 100), points(-0.0043, 2000), points(-0.001, 100)
        ('12', '-0.4', '0')
    """
    digits = 1 if pairs >= 500 else 0
    rounded = round(100 * share, digits)
    return f"{rounded + 0.0:.{digits}f}"  # -0.0 becomes 0.0


def _counted_points(share: float, pairs: int) -> str:
    text = points(share, pairs)
    return f"{text} {'point' if text in {'1', '-1'} else 'points'}"


def p_text(p: float) -> str:
    """A p-value in words: two digits that count, not below 0.001.

    Example:
        >>> p_text(0.0213), p_text(0.00001), p_text(0.73), p_text(1.0)
        ('p = 0.021', 'p < 0.001', 'p = 0.73', 'p = 1')
    """
    return "p < 0.001" if p < 0.001 else f"p = {p:.2g}"


def short(value: float, digits: int = 3) -> str:
    """A number in a few digits.

    Example:
        >>> short(0.21345), short(-12.0), short(-0.0), short(float("inf")), short(0.21345, 2)
        ('0.213', '-12', '0', 'inf', '0.21')
    """
    return f"{value + 0.0:.{digits}g}"
