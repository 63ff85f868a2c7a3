"""Numbers of a comparison in words, and what a difference shows."""

from __future__ import annotations

import math

from rtamt_gym.evaluation.paired import Effect
from rtamt_gym.tables import counted, short

__all__ = ["counted_points", "effect_sentence", "points"]


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


def counted_points(share: float, pairs: int) -> str:
    """The same with its unit: ``1 point``, ``12 points``."""
    text = points(share, pairs)
    return f"{text} {'point' if text in {'1', '-1'} else 'points'}"
