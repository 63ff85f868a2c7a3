"""The readings of the end of a trace in dense time, written down naively.

All times are multiples of `STEP`, and every function of time is constant from one of them to the
next. So the definitions are those of samples at all these times, except that a witness between two
of them needs p on the rest of that step. Shares no code with the library.
"""

from __future__ import annotations

import functools

from dense_oracle import STEP, Signals
from end_oracle import INF, UNKNOWN, holds
from oracle import Read, Trace, Value, all_, any_, bounds, not_, predicate, settled

from rtamt.language.node import Node

_STEPS = round(1 / STEP)


def recorded(signals: Signals) -> tuple[Trace, int]:
    """Samples of all variables from the begin of the trace to its end, and how many."""
    begin = max(events[0][0] for events in signals.values())
    end = min(events[-1][0] for events in signals.values())
    n = round((end - begin) / STEP) + 1
    times = [begin + i * STEP for i in range(n)]
    return {
        name: [[value for t, value in events if t <= time][-1] for time in times]
        for name, events in signals.items()
    }, n


def first_decided(formula: Node, trace: Trace, n: int) -> int | None:
    """The first sample after which the open reading is decided."""
    for seen in range(1, n + 1):
        low, high = dense_bounds(formula, trace, seen, cut=False)
        if holds(low) == holds(high):
            return seen - 1
    return None


def dense_bounds(  # noqa: C901
    formula: Node, trace: Trace, n: int, *, cut: bool, read: Read = predicate
) -> Value:
    """The bounds at the first of n samples, if the trace was cut or goes on for ever."""
    last = n + _STEPS * settled(formula)

    @functools.cache
    def at(f: Node, i: int) -> Value:  # noqa: C901 - a table
        i = i if cut else min(i, last)
        assert f.op is not None
        if f.op.operands == "term":
            return read(f, trace, i if i < n else None)
        a, b = _STEPS * bounds(f)[0], _STEPS * bounds(f)[1]
        p, q = (functools.partial(at, g) for g in (f.args[0], f.args[-1]))
        back = range(int(max(i - b, 0)), i - a + 1)
        end = i + b
        if b == INF and f.op.future:
            if cut and i >= n:
                return UNKNOWN
            end = n - 1 if cut else max(i + a, last)
        ahead = range(i + a, int(end) + 1) if f.op.future else range(0)
        unknown = [UNKNOWN] if f.op.future and not ahead else []
        match f.op.name:
            case "not":
                return not_(p(i))
            case "and":
                return all_(at(g, i) for g in f.args)
            case "or":
                return any_(at(g, i) for g in f.args)
            case "implies":
                return any_([not_(p(i)), q(i)])
            case "iff":
                return all_([any_([not_(p(i)), q(i)]), any_([not_(q(i)), p(i)])])
            case "xor":
                return any_([all_([p(i), not_(q(i))]), all_([not_(p(i)), q(i)])])
            case "historically":
                return all_(map(p, back))
            case "once":
                return any_(map(p, back))
            case "always":
                return all_([*map(p, ahead), *unknown])
            case "eventually":
                return any_([*map(p, ahead), *unknown])
            case "since":
                return any_(all_([q(j), *map(p, _rest(j, i, a))]) for j in back)
        # p is needed on [i, t'), and t' may lie inside the step at the begin of the interval.
        least = i + a + 1 if a else i
        found = [all_([q(j), *map(p, range(i, max(j, least)))]) for j in ahead]
        until = any_([*found, *(all_([u, *map(p, range(i, least))]) for u in unknown)])
        if f.op.name == "until":
            return until
        assert f.op.name == "unless"
        return any_([all_(map(p, range(i, int(end) + 1))), until])

    return at(formula, 0)


def _rest(j: int, i: int, a: int) -> range:
    """The samples on which since needs p: a witness lies inside its step, unless it is now."""
    return range(i, i) if j == i and not a else range(j, i + 1)
