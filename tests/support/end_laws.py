"""The laws of the ends of a trace, on formulas and integer traces that are full of zeros.

For a formula and a trace, of which every beginning may be all there is:

* bounds never widen;
* the complete value of a beginning, and of every longer one, lies inside its open bounds;
* a decided open verdict is the sign of the complete value wherever the trace then ends;
* the bounds of a beginning that was cut lie inside the open ones;
* the robustness after `finish` is the complete value, moved to the bounds.

Zeros have a sign: -0.0 is below 0.0.
"""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from oracle import order

Bounds = tuple[float, float, float]
"""Robustness, lower and upper bound."""
Trace = Mapping[str, Sequence[float]]

_ATOMS = ("a > 0", "b >= 1", "a == b", "abs(a - b) < 2", "c != 0", "a", "true", "false")
_UNARY = ("not", "next", "s_next", "prev", "s_prev", "rise", "fall")
_BINARY = ("and", "or", "implies", "iff", "xor")
_WINDOWS = ("always", "eventually", "historically", "once")
_PAIRS = ("until", "unless", "since")


@dataclass
class Told:
    """What a machine says of a trace: after each sample, and of each beginning that ends there.

    Attributes:
        open: Robustness and bounds after every sample.
        complete: The same of every beginning as a whole.
        cut: The same of every beginning that was cut.
    """

    open: list[Bounds]
    complete: list[Bounds]
    cut: list[Bounds]


@dataclass
class Count:
    """Cases, zeros among the complete values, and what broke a law."""

    cases: int = 0
    zeros: int = 0
    broken: list[str] = field(default_factory=list)
    of: Counter[str] = field(default_factory=Counter)


def formula_text(choose: random.Random, depth: int = 3, *, endless: bool = True) -> str:
    """A formula of some depth, in which futures look over the past and past over the future."""
    if depth == 0 or choose.random() < 0.12:
        return f"({choose.choice(_ATOMS)})"

    def inner() -> str:
        return formula_text(choose, depth - 1, endless=endless)

    def interval() -> str:
        if endless and choose.random() < 0.3:
            return choose.choice(("", "", f"[{choose.randint(1, 3)}:inf]"))
        begin = choose.randint(0, 3)
        return f"[{begin}:{begin + choose.randint(0, 3)}]"

    match choose.random():
        case x if x < 0.2:
            return f"{choose.choice(_UNARY)}({inner()})"
        case x if x < 0.4:
            return f"({inner()} {choose.choice(_BINARY)} {inner()})"
        case x if x < 0.8:
            return f"({choose.choice(_WINDOWS)}{interval()} {inner()})"
        case _:
            return f"({inner()} {choose.choice(_PAIRS)}{interval()} {inner()})"


def drawn(
    choose: random.Random, most: int = 8, depth: int = 3
) -> tuple[str, dict[str, list[float]]]:
    """A formula, and a trace of up to so many samples."""
    values = (0.0, 0.0, -0.0, 1.0, -1.0, 2.0, -2.0, 3.0)
    n = choose.randint(1, most)
    trace = {name: [choose.choice(values) for _ in range(n)] for name in "abc"}
    return formula_text(choose, choose.randint(1, depth)), trace


def broken_laws(told: Told) -> list[str]:
    """Which laws a machine breaks on a trace."""
    found = []

    def law(holds: object, name: str) -> None:
        if not holds:
            found.append(name)

    before: tuple[float, float] = (-math.inf, math.inf)
    for n, (now, lower, upper) in enumerate(told.open):
        law(_at_most(before[0], lower) and _at_most(upper, before[1]), f"bounds widen at {n}")
        before = lower, upper
        law(_at_most(lower, now) and _at_most(now, upper), f"the value is outside at {n}")
        for end in range(n, len(told.open)):
            value = told.complete[end][0]
            inside = _at_most(lower, value) and _at_most(value, upper)
            law(inside, f"the value of an end at {end} is outside the bounds at {n}")
            decided = _sign(lower) if _sign(lower) == _sign(upper) else None
            law(decided in {None, _sign(value)}, f"the verdict at {n} is not that at {end}")
        value, least, greatest = told.complete[n]
        law(_same(told.complete[n], (now, now, now)), f"complete at {n} is not the value")
        value, least, greatest = told.cut[n]
        law(_at_most(lower, least) and _at_most(greatest, upper), f"cut is wider at {n}")
        moved = max(least, min(now, greatest, key=order), key=order)
        law(_same((value,), (moved,)), f"the value of a cut trace at {n} is not the moved one")
    return found


def _sign(value: float) -> bool:
    return math.copysign(1.0, value) > 0


def _at_most(x: float, y: float) -> bool:
    return order(x) <= order(y)


def _same(some: Sequence[float], others: Sequence[float]) -> bool:
    return list(map(order, some)) == list(map(order, others))


def differences(told: Told, expected: Told) -> list[str]:
    """Where two machines differ, in any bit."""
    return [
        f"{name} after sample {n}: {got}, expected {wanted}"
        for name in ("open", "complete", "cut")
        for n, (got, wanted) in enumerate(
            zip(getattr(told, name), getattr(expected, name), strict=True)
        )
        if not _same(got, wanted)
    ]


Machine = Callable[[str, Trace], Told]
