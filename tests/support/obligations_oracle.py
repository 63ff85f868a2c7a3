"""Clocks of temporal operators by their definition, over a recorded trace, without a state.

Every number is computed from all samples so far. The patterns state the kind of clock of their
operators, and the condition under which it runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import boolean_oracle
import oracle

import rtamt

Trace = Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class Expected:
    """An operator and its clock.

    Attributes:
        formula: The operator, as text.
        name: Its name.
        kind: ``"oldest"``, ``"newest"`` or ``"last"``.
        begin: The start of its window.
        end: The end; None if it is unbounded.
        operands: Its operands, as texts.
        asked: The formula that holds at its triggers; None for every sample; ``"first"`` for sample
            0.
    """

    formula: str
    name: str
    kind: str
    begin: int
    end: int | None
    operands: tuple[str, ...]
    asked: str | None = None


def truth(text: str, trace: Trace, i: int) -> bool:
    n = len(next(iter(trace.values())))
    return boolean_oracle.holds(rtamt.parse(text).formula, trace, n, i)


def clock(expected: Expected, trace: Trace, t: int) -> float:
    """Return the clock at sample t."""
    return _KINDS[expected.kind](expected, trace, t)


def margin(text: str, trace: Trace, t: int) -> float:
    """Return the newest known robustness of an operand at sample t; 0 before the first one."""
    formula = rtamt.parse(text).formula
    instant = t - int(oracle.horizon(formula))
    n = len(next(iter(trace.values())))
    return oracle.robustness(formula, trace, n)[instant] if instant >= 0 else 0.0


def _late(expected: Expected) -> int:
    return max(int(oracle.horizon(rtamt.parse(text).formula)) for text in expected.operands)


def _asked(expected: Expected, trace: Trace, s: int) -> bool:
    if expected.asked is None:
        return True
    return s == 0 if expected.asked == "first" else truth(expected.asked, trace, s)


def _full(expected: Expected, late: int) -> int:
    """Return the count of a clock at 1."""
    return expected.begin + late + 2 if expected.end is None else expected.end + late + 1


def _oldest(expected: Expected, trace: Trace, t: int) -> float:
    late = _late(expected)
    full = _full(expected, late)
    counted = [_count(expected, trace, then, late, full) for then in range(t + 1)]
    if expected.asked == "first" and full in counted:
        return 1.0
    return counted[-1] / full


def _count(expected: Expected, trace: Trace, t: int, late: int, full: int) -> int:
    """Return the time from the oldest pending instant to t; ``full`` if it is overdue or done."""
    newest = t - late  # the newest instant with known operands
    first, *second = [
        [truth(text, trace, u) for u in range(newest + 1)] for text in expected.operands
    ]
    a = expected.begin

    def ends(s: int, u: int) -> bool:
        """Return whether an instant is no longer pending after u."""
        match expected.name:
            case "eventually":
                return first[u] and u >= s + a
            case "always":
                return not first[u] and u >= s + a
            case "until":
                return (second[0][u] and u >= s + a) or (not first[u] and u >= s)
            case _:
                return not first[u] and u >= s

    def pending(before: int) -> list[int]:
        return [
            s
            for s in range(t + 1)
            if _asked(expected, trace, s) and not any(ends(s, u) for u in range(before))
        ]

    if newest >= 0 and expected.name in {"until", "unless"}:
        waiting = [s for s in pending(newest) if s <= t]
        met = [s for s in waiting if second[0][newest] and newest >= s + a]
        broken = [s for s in waiting if s not in met and not first[newest] and newest >= s]
        if expected.name == "until" and broken:
            return full
        if expected.name == "unless" and met:
            return full
    left = pending(newest + 1)
    most = full if expected.end is not None else full - 1
    return min(t - left[0] + 1, most) if left else 0


def _newest(expected: Expected, trace: Trace, t: int) -> float:
    late = _late(expected)
    asked = [s for s in range(t + 1) if _asked(expected, trace, s)]
    if not asked:
        return 0.0
    s = asked[-1]
    known = range(s, t - late + 1)
    if expected.name == "until" and not all(truth(expected.operands[0], trace, u) for u in known):
        return 0.0
    if expected.name == "unless" and any(
        truth(expected.operands[1], trace, u) for u in known if u >= s + expected.begin
    ):
        return 0.0
    if expected.end is None:
        return 1.0
    end = expected.end + late
    return max(end - (t - s), 0) / max(end, 1)


def _last(expected: Expected, trace: Trace, t: int) -> float:
    newest = t - _late(expected)
    full = 1 if expected.end is None else expected.end + 1
    wanted = expected.name not in {"historically", "fall"}
    times = [u for u in range(newest + 1) if truth(expected.operands[-1], trace, u) is wanted]
    if not times:
        return 1.0
    since = range(times[-1] + 1, newest + 1)
    if expected.name == "since" and not all(truth(expected.operands[0], trace, u) for u in since):
        return 1.0
    return 0.0 if expected.end is None else min(len(since), full) / full


_KINDS: dict[str, Callable[[Expected, Trace, int], float]] = {
    "oldest": _oldest,
    "newest": _newest,
    "last": _last,
}
