"""Why an operator in dense time has its value at a position, checked at every position.

Positions are the regions of `region_oracle`. Shares no code with the library.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from oracle import order

Part = tuple[int, int, int, str]
"""An operand, 0 or 1, the first and the last of several positions, and its role there."""

INF = math.inf


class Reasons(NamedTuple):
    """Why an operator of two operands has its value at a position.

    Attributes:
        value: The value.
        decided: The operand and position of the value; None if the window is empty.
        witness: The position of the right side; None without one.
        parts: The parts that make the sign of the value.
    """

    value: float
    decided: tuple[int, int] | None
    witness: int | None
    parts: list[Part]


class Operands:
    """The values of two operands at the positions of a trace."""

    def __init__(self, left: Sequence[float], right: Sequence[float] = ()) -> None:
        self.left, self.right = left, right
        self.last = len(left) - 1

    def reasons(self, name: str, now: int, lo: int, hi: float) -> Reasons:
        if name != "unless":
            return self.reached(name, now, lo, hi)
        until = self.reached("until", now, lo, hi)
        stretch = range(now, int(min(self.last, now + hi)) + 1)
        value = min((self.left[k] for k in stretch), key=order)
        least = next(k for k in stretch if same(self.left[k], value))
        always = order(value) >= order(until.value)
        if always and holds(value):
            return Reasons(value, (0, least), None, [(0, now, stretch[-1], "held")])
        if holds(until.value):
            return until
        # Report the earliest place at which the left side fails, unless the path leads through
        # another one.
        fails = next(k for k in stretch if not holds(self.left[k]))
        ranges = [(fails, fails), *(span for side, *span, _ in until.parts if side == 0)]
        if always and not any(first <= least <= last for first, last in ranges):
            fails = least
        parts = [(0, fails, fails, "broken" if hi else "missing"), *until.parts]
        if always:
            return Reasons(value, (0, least), None, parts)
        return until._replace(parts=parts)

    def windowed(self, fold: str, now: int, lo: float, hi: float) -> Reasons:
        """Return the reasons of a fold of the left operand over positions from lo to hi."""
        window = range(int(max(0, now + lo)), int(min(self.last, now + hi)) + 1)
        if not window:
            return Reasons(INF if fold == "min" else -INF, None, None, [])
        choose = min if fold == "min" else max
        value = choose((self.left[k] for k in window), key=order)
        place = next(k for k in window if same(self.left[k], value))
        parts = [(0, place, place, "held" if holds(value) else "missing")]
        if (fold == "min") == holds(value):
            parts = [(0, window[0], window[-1], parts[0][3])]
        elif fold == "min" and lo != hi:
            first = next(k for k in window if not holds(self.left[k]))
            parts = [(0, first, first, "broken")]
        return Reasons(value, (0, place), None, parts)

    def reached(self, name: str, now: int, lo: int, hi: float) -> Reasons:
        """Return the reasons of since and until, from all positions of the window."""
        left, right = self.left, self.right
        if name == "since":
            window = range(int(max(0, now - hi)), now - lo + 1)
            ways = {j: range(j + (j % 2 == 0 or j == now), now + 1) for j in window}
        else:
            window = range(now + lo, int(min(self.last, now + hi)) + 1)
            ways = {j: range(now, j + (j % 2 == 1 and j != now)) for j in window}
        if not window:
            return Reasons(-INF, None, None, [])
        values = [min([right[j], *(left[k] for k in ways[j])], key=order) for j in window]
        value = max(values, key=order)
        witness = next(j for j, its in zip(window, values, strict=True) if same(its, value))
        way = ways[witness]
        decided = next(((0, k) for k in way if same(left[k], value)), (1, witness))
        if holds(value):
            held = [(0, way[0], way[-1], "held")] if way else []
            return Reasons(value, decided, witness, [*held, (1, witness, witness, "held")])
        # The right side fails at every place where the left side holds on the path. At the end of
        # the path the left side itself fails.
        free = [j for j in window if all(holds(left[k]) for k in ways[j])]
        parts = [(1, free[0], free[-1], "missing")] if free else []
        if free != [*window]:
            fails = {k for way in ways.values() for k in way if not holds(left[k])}
            nearest = max(fails) if name == "since" else min(fails)
            parts.insert(0, (0, nearest, nearest, "broken"))
        return Reasons(value, decided, witness, parts)


def same(one: float, other: float) -> bool:
    return order(one) == order(other)


def holds(value: float) -> bool:
    return math.copysign(1.0, value) > 0.0
