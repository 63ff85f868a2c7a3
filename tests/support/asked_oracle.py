"""How often implications are put to the test, by the definition; shares no code with the library.

The instants at which a formula reads its parts are walked one by one, from sample 0 on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from end_oracle import cut, ended, holds
from oracle import Read, Trace, bounds, opened, predicate, settled, values
from region_oracle import STEP, Regions, Signals, Time

from rtamt import Formula, parse
from rtamt.language.formula import make
from rtamt.language.node import Node

INF = math.inf
FALSE = parse("false").formula


class Row(NamedTuple):
    """What `rtamt.monitors.TriggerCount` says of an implication."""

    text: str
    samples: int
    occasions: int
    first: int | None
    vacuous: bool


class Evidence(NamedTuple):
    """What a judgement says of what its verdict stands on."""

    asked: tuple[Row, ...]
    never_asked: bool
    vacuous: bool


def evidence(formula: Formula, trace: Trace, n: int, end: str, read: Read = predicate) -> Evidence:
    """What the verdict on a trace of n samples stands on; ``read`` is the verdict's semantics."""

    def satisfied(changed: Node) -> bool:
        if end == "complete":
            return holds(values(changed, trace, n, read)[0][0])
        return holds(ended(changed, trace, n, end, read)[1])

    held = satisfied(formula)
    implications = implied(formula)
    at = _lower(trace, n, end)
    rows = []
    for each in implications:
        instants = reads(formula, each, n, end)
        true = sorted(i for i in instants if i < n and holds(at(each.args[0], i)))
        rows.append(
            Row(
                str(each),
                len(true),
                sum(i - 1 not in true for i in true),
                true[0] if true else None,
                held and satisfied(unanswered(formula, (each,))),
            )
        )
    return Evidence(
        tuple(rows),
        held and bool(rows) and not any(row.samples for row in rows),
        held and bool(rows) and satisfied(unanswered(formula, implications)),
    )


def implied(formula: Node) -> tuple[Node, ...]:
    """The implications in positive position, in the order of the text, the outer first."""

    def walk(f: Node, *, positive: bool) -> Iterator[Node]:
        if positive and _counts(f):
            yield f
        for operand, same in _operands(f):
            yield from walk(operand, positive=positive == same)

    return tuple(dict.fromkeys(walk(formula, positive=True)))


def unanswered(formula: Node, implications: tuple[Node, ...]) -> Node:
    """The formula with ``false`` as the right side of implications in positive position."""

    def changed(f: Node, *, positive: bool) -> Node:
        operands = _operands(f)
        if not operands:
            return f
        args = tuple(changed(g, positive=positive == same) for g, same in operands)
        if positive and f in implications:
            args = args[0], FALSE
        assert f.op is not None
        return make(f.op.name, args, f.interval)

    return changed(formula, positive=True)


def reads(formula: Node, implication: Node, n: int, end: str) -> set[int]:
    """The instants at which a formula reads an implication in positive position, from 0 on.

    Later ones than a window can bring back into the trace are left out.
    """
    horizon = n + settled(formula)  # no window leads back into the trace from behind it
    found: set[int] = set()
    seen: set[tuple[Node, int, bool]] = set()
    stack: list[tuple[Node, int, bool]] = [(formula, 0, True)]
    while stack:
        place = f, i, positive = stack.pop()
        if place in seen:
            continue
        seen.add(place)
        if f is implication and positive:
            found.add(i)
        cut = end == "complete" or (end == "cut" and _is_recorded(f, i, n))
        most = n - 1 if cut else horizon
        for (operand, same), (first, last) in zip(_operands(f), _windows(f, i), strict=True):
            window = range(max(0, first), int(min(last, most)) + 1)
            stack.extend((operand, j, positive == same) for j in window)
    return found


def _is_recorded(f: Node, i: int, n: int) -> bool:
    """Whether it is a future operator without end, something of whose window was recorded."""
    a, b = bounds(f)
    return _is_future(f) and b == INF and i + a < n


def _is_future(f: Node) -> bool:
    return f.op is not None and f.op.name in ("always", "eventually", "until", "unless")


def _windows(f: Node, i: int) -> list[tuple[int, float]]:
    """First and last instant at which a formula at an instant reads each of its operands."""
    assert f.op is not None
    a, b = bounds(f)
    ago = 0 if b == INF else i - int(b)
    match f.op.name:
        case "always" | "eventually":
            return [(i + a, i + b)]
        case "historically" | "once":
            return [(ago, i - a)]
        case "until":
            return [(i, i + b - 1), (i + a, i + b)]
        case "unless":
            return [(i, i + b), (i + a, i + b)]
        case "since":
            return [(ago if b == INF else ago + 1, i), (ago, i - a)]
        case "prev" | "s_prev":
            return [(i - 1, i - 1)]
        case "next" | "s_next":
            return [(i + 1, i + 1)]
        case _:
            return [(i, i)] * len(_operands(f))


def _operands(f: Node) -> list[tuple[Node, bool]]:
    """The operands in which an implication can stand, and whether they have the formula's sign."""
    assert f.op is not None
    if f.op.operands == "term" or f.op.name in ("iff", "xor", "rise", "fall"):
        return []
    signs = {"not": (False,), "implies": (False, True)}.get(f.op.name, (True,) * len(f.args))
    return list(zip(f.args, signs, strict=True))


def _counts(f: Node) -> bool:
    return f.op is not None and f.op.name == "implies" and f.args[1] is not FALSE


def _lower(trace: Trace, n: int, end: str) -> Callable[[Node, int], float]:
    """The least robustness of a formula at a recorded instant, by standard semantics."""
    if end == "complete":
        return lambda f, i: values(f, trace, n)[i][0]
    if end == "cut":
        return lambda f, i: cut(f, trace, n, i)[0]
    return lambda f, i: opened(f, trace, n)(f, i)[0]


class DenseRow(NamedTuple):
    """What `rtamt.dense.TriggerCount` says of an implication."""

    text: str
    duration: Time
    occasions: int
    first: Time | None
    vacuous: bool


def dense_evidence(
    formula: Formula, signals: Signals, end: str, read: Read = predicate
) -> tuple[tuple[DenseRow, ...], bool, bool]:
    """What the verdict on a trace in dense time stands on: rows, never asked, vacuous."""
    regions = Regions(signals, STEP, read)
    plain = Regions(signals, STEP)
    last = 2 * regions.steps

    def satisfied(changed: Node) -> bool:
        return holds(regions.ended(changed, end)[1])

    held = satisfied(formula)
    implications = implied(formula)
    rows = []
    for each in implications:
        instants = _dense_reads(formula, each, last, end)
        at = plain.at(each.args[0], end)
        true = sorted(i for i in instants if i <= last and holds(at(i)[0]))
        first = regions.begin + true[0] // 2 * STEP if true else None
        runs = sum(i - 1 not in true for i in true)
        vacuous = held and satisfied(unanswered(formula, (each,)))
        lasting = sum(i % 2 for i in true) * STEP
        rows.append(DenseRow(str(each), lasting, runs, first, vacuous))
    never = held and bool(rows) and not any(row.occasions for row in rows)
    return (
        tuple(rows),
        never,
        held and bool(rows) and satisfied(unanswered(formula, implications)),
    )


def _dense_reads(formula: Node, implication: Node, last: int, end: str) -> set[int]:
    """The regions in which a formula reads an implication in positive position, from 0 on."""
    horizon = last + _far(formula)  # no window leads back into the trace from behind it
    found: set[int] = set()
    seen: set[tuple[Node, int, bool]] = set()
    stack: list[tuple[Node, int, bool]] = [(formula, 0, True)]
    while stack:
        place = f, i, positive = stack.pop()
        if place in seen:
            continue
        seen.add(place)
        if f is implication and positive:
            found.add(i)
        a, b = bounds(f)
        cut = end == "cut" and _is_future(f) and b == INF and i + 2 * a / STEP <= last
        most = last if cut or end == "complete" else horizon
        for (operand, same), window in zip(_operands(f), _dense_windows(f), strict=True):
            stack.extend(
                (operand, j, positive == same)
                for j in range(most + 1)
                if _meet(window, _apart(i, j))
            )
    return found


def _far(f: Node) -> int:
    a, b = bounds(f)
    own = int(2 * (a if b == INF else b) / STEP)
    return 2 + own + max(map(_far, f.args), default=0)


Interval = tuple[float, float, bool, bool]
"""Begin and end, and whether they belong to it."""


def _dense_windows(f: Node) -> list[Interval]:
    """How much later than a formula its operands are read."""
    assert f.op is not None
    a, b = bounds(f)
    match f.op.name:
        case "always" | "eventually":
            return [(a, b, True, True)]
        case "historically" | "once":
            return [(-b, -a, True, True)]
        case "until":
            return [(0, b, True, False), (a, b, True, True)]
        case "unless":
            return [(0, b, True, True), (a, b, True, True)]
        case "since":
            return [(-b, 0, False, True), (-b, -a, True, True)]
        case _:
            return [(0, 0, True, True)] * len(_operands(f))


def _apart(i: int, j: int) -> Interval:
    """By how much an instant of region j can be later than one of region i."""
    own, its = ((k // 2 * STEP, (k + 1) // 2 * STEP) for k in (i, j))
    closed = i % 2 == j % 2 == 0
    return its[0] - own[1], its[1] - own[0], closed, closed


def _meet(some: Interval, others: Interval) -> bool:
    low, high = max(some[0], others[0]), min(some[1], others[1])
    if low < high:
        return True
    return low == high and all(
        (each[2] or each[0] < low) and (each[3] or each[1] > high) for each in (some, others)
    )
