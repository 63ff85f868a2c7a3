"""Implications and bodies of a formula, and the instants at which the formula reads them.

An implication ``p implies q`` demands nothing where p fails. The meanings of operators run on a
builder whose registers are ways to operands, so a new row of the table needs no code here. An
implication counts in positive position: more robustness of it is never less of the whole. A formula
that is satisfied for any value of one of its parts is vacuous (Beer, Ben-David, Eisner and Rodeh,
"Efficient detection of vacuity in temporal model checking", FMSD 2001).

The bodies are the formulas that a requirement demands at one instant after the other: ``p`` and
``q`` in ``always(p and always[0:5] q)``. From the root down, ``always`` and ``and`` only divide the
demand; the first other formula on each way is a body. The requirement fails if and only if a body
fails at an instant where it is read, because a minimum is negative if and only if an operand is.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, cast

from rtamt.language.formula import Formula, make, with_operands
from rtamt.language.node import Node
from rtamt.language.operators import OPERATORS, Bounds

InstantRuns = tuple[tuple[int, float], ...]
"""The first and last instant of runs, in order; no run touches the next; the last may be inf.

Instants are samples, or positions of dense time: 2t is the tick t, 2t + 1 the time after it.
"""


Counted = tuple[int, int, int | None]
"""How often something is true at some instants: its length in samples or ticks, its number of
starts, and the first instant or None. A start of the trace counts.
"""


class _Step(NamedTuple):
    """The instants that an operator reads from an instant: offsets lo to hi, None if unbounded.

    ``begin`` is the offset at which the window of a future operator without an end starts;
    ``open_end`` excludes the offset farthest from 0.
    """

    lo: int | None
    hi: int | None
    begin: int | None = None
    open_end: bool = False


@dataclass(frozen=True, slots=True)
class _Way:
    """How the value of a register depends on an operand, which is some steps away.

    The value rises or falls with it; ``chosen`` has the folds that choose it among other values.
    """

    operand: int
    steps: tuple[_Step, ...] = ()
    positive: bool = True
    chosen: frozenset[str] = frozenset()

    def negated(self) -> _Way:
        return replace(self, positive=not self.positive, chosen=_dual(self.chosen))

    def among(self, *folds: str) -> _Way:
        return replace(self, chosen=self.chosen | {*folds})

    def after(self, step: _Step) -> _Way:
        return replace(self, steps=(step, *self.steps))


def _dual(chosen: frozenset[str]) -> frozenset[str]:
    return frozenset({"min": "max", "max": "min"}[fold] for fold in chosen)


class _Ways:
    """A builder of meanings whose registers are ways to operands."""

    def __init__(self, operands: int) -> None:
        self.registers = [[_Way(i)] for i in range(operands)]

    def constant(self, value: float) -> int:  # noqa: ARG002 - it reads nothing
        return self._new(())

    def map(self, function: str, *args: int) -> int:
        paths = [path for a in args for path in self.registers[a]]
        if function == "neg":
            return self._new(path.negated() for path in paths)
        return self._new(path.among(function) for path in paths)

    def window(self, fold: str, lo: int | None, hi: int | None, *args: int) -> int:
        step = _Step(lo, hi, lo if hi is None else None)
        folds = () if lo == hi else (fold,)
        paths = (path for a in args for path in self.registers[a])
        return self._new(path.among(*folds).after(step) for path in paths)

    def until(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds
        late = begin if end is None else None
        return self._both(
            p, q, _Step(0, end, late, open_end=end is not None), _Step(begin, end, late)
        )

    def since(self, bounds: Bounds, p: int, q: int) -> int:
        begin, end = bounds
        past = None if end is None else -end
        return self._both(p, q, _Step(past, 0, open_end=end is not None), _Step(past, -begin))

    def _both(self, p: int, q: int, held: _Step, reached: _Step) -> int:
        paths = [path.after(held) for path in self.registers[p]]
        paths += [path.after(reached) for path in self.registers[q]]
        return self._new(path.among("min", "max") for path in paths)

    def _new(self, paths: Iterable[_Way]) -> int:
        self.registers.append(list(paths))
        return len(self.registers) - 1


@functools.lru_cache(maxsize=1024)
def _ways(name: str, operands: int, bounds: Bounds) -> tuple[_Way, ...]:
    """Return the ways to operands with which an operator only rises or only falls."""
    row = OPERATORS[name]
    if row.operands == "term":
        return ()
    builder = _Ways(operands)
    arguments = range(operands)
    result = row.meaning(builder, *((bounds, *arguments) if row.timed else arguments))
    paths = dict.fromkeys(builder.registers[result])
    signs = {(path.operand, path.positive) for path in paths}
    return tuple(path for path in paths if (path.operand, not path.positive) not in signs)


_NO_BOUNDS: Bounds = (0, None)


def operand_signs(node: Node, bounds: Bounds = _NO_BOUNDS) -> Mapping[int, bool]:
    """Return whether operands keep the sign, without operands that count in both directions."""
    if node.op is None:
        return {}
    paths = _ways(node.op.name, len(node.args), bounds)
    return {path.operand: path.positive for path in paths}


@functools.lru_cache(maxsize=512)
def implications(formula: Formula) -> tuple[Formula, ...]:
    """Return the implications in positive position in the order of the text, the outer first.

    Implications with ``false`` on the right side cannot be answered, and are left out.

    Example:
        >>> from rtamt import parse
        >>> implications(parse("always(a > 0 implies b > 0) and not (a implies b)").formula)
        (<Formula a > 0 implies b > 0>,)
    """
    counted: dict[Formula, None] = {}
    seen: set[tuple[Node, bool]] = set()
    stack: list[tuple[Node, bool]] = [(formula, True)]
    while stack:
        position = node, positive = stack.pop()
        if position in seen:
            continue
        seen.add(position)
        if positive and _counts(node):
            counted[cast("Formula", node)] = None
        below = sorted(operand_signs(node).items(), reverse=True)
        stack += [(node.args[i], positive == same) for i, same in below]
    return tuple(counted)


def signs(formula: Formula) -> Mapping[Formula, frozenset[bool]]:
    """Return whether the formula rises (True) or falls (False) with each part, or both.

    Example:
        >>> from rtamt import parse
        >>> parts = signs(parse("(a > 0 implies b > 0) and (b > 0 iff c > 0)").formula)
        >>> {str(part): sorted(both) for part, both in parts.items() if not part.args[0].op}
        {'b > 0': [False, True], 'c > 0': [False, True], 'a > 0': [False]}
    """
    parts: dict[Formula, set[bool]] = {formula: {True}}
    for node in reversed([*formula.nodes()]):
        if not isinstance(node, Formula) or node.op is None or node not in parts:
            continue
        same = operand_signs(node)
        for i, arg in enumerate(node.args):
            if isinstance(arg, Formula):
                below = {True, False} if i not in same else {s == same[i] for s in parts[node]}
                parts.setdefault(arg, set()).update(below)
    return {node: frozenset(both) for node, both in parts.items()}


def _counts(node: Node) -> bool:
    return node.op is OPERATORS["implies"] and node.args[1].op is not OPERATORS["false"]


def unanswered(formula: Formula, answered: Sequence[Formula]) -> Formula:
    """Return the formula with ``false`` as the right side of implications in positive position."""
    changed: dict[tuple[Node, bool], Node] = {}
    false = make("false", ())
    for node in formula.nodes():
        signs = operand_signs(node)
        for positive in (True, False):
            args = [
                changed[arg, positive == signs[i]] if i in signs else arg
                for i, arg in enumerate(node.args)
            ]
            if positive and node in answered:
                args[1] = false
            changed[node, positive] = with_operands(node, args)
    return cast("Formula", changed[formula, True])


class Reads(NamedTuple):
    """The instants at which a formula reads a part of it in positive position.

    At the ``needed`` ones the formula fails if the part does.
    """

    all: InstantRuns
    needed: InstantRuns


class Routes:
    """The ways from a formula to its implications, for traces of any length."""

    __slots__ = ("_ends", "_legs", "_places")

    def __init__(self, formula: Formula, bounds: Callable[[Node], Bounds]) -> None:
        # A place is a node, its sign, and whether the formula fails whenever the node does.
        places: dict[Node, dict[tuple[bool, bool], int]] = {formula: {(True, True): 0}}
        count = 1
        legs: list[tuple[int, list[tuple[int, tuple[_Step, ...]]]]] = []
        for node in reversed([*formula.nodes()]):
            if node not in places or node.op is None:
                continue
            limits = bounds(node) if node.op.timed else _NO_BOUNDS
            paths = _ways(node.op.name, len(node.args), limits)
            for (positive, alone), position in places[node].items():
                goes: list[tuple[int, tuple[_Step, ...]]] = []
                for path in paths:
                    chosen = path.chosen if positive else _dual(path.chosen)
                    key = positive == path.positive, alone and "max" not in chosen
                    below = places.setdefault(node.args[path.operand], {})
                    if key not in below:
                        below[key], count = count, count + 1
                    goes.append((below[key], path.steps))
                legs.append((position, goes))
        self._legs, self._places = legs, count
        self._ends: list[tuple[Formula, int | None, int | None]] = []
        for implication in implications(formula):
            positions = places.get(implication, {})
            self._ends.append(
                (implication, positions.get((True, True)), positions.get((True, False)))
            )

    def reads(self, trace: TraceSpan) -> Mapping[Formula, Reads]:
        """Return the instants of a trace at which the formula reads its implications."""
        runs: list[list[tuple[int, float]]] = [[] for _ in range(self._places)]
        runs[0].append((0, 0))
        for position, goes in self._legs:
            known = merged_runs(runs[position])
            for below, steps in goes:
                runs[below] += trace.along(steps, known)
        reads = {}
        for implication, needed, others in self._ends:
            alone = () if needed is None else merged_runs(runs[needed])
            every = alone if others is None else merged_runs([*alone, *runs[others]])
            reads[implication] = Reads(every, alone)
        return reads


class TraceSpan(NamedTuple):
    """The instants of a trace, and how its end mode limits windows."""

    last: int  # the last recorded instant: a sample, or a position of dense time
    complete: bool  # whether every window is cut to the trace
    # whether windows of future operators without an end are cut if some of it was recorded
    cut: bool
    dense: bool = False  # whether instants are positions of dense time

    def window(self, bounds: Bounds, runs: InstantRuns) -> InstantRuns:
        """Return the instants that a window of a future operator at each of some instants reads."""
        begin, end = bounds
        return self.along((_Step(begin, end, begin if end is None else None),), runs)

    def along(self, steps: Sequence[_Step], runs: InstantRuns) -> InstantRuns:
        """Return the instants that steps reach from others."""
        for step in steps:
            reached = [run for first, final in runs for run in self._step(step, first, final)]
            runs = tuple(reached) if len(reached) < 2 else merged_runs(reached)
        return runs

    def _step(self, step: _Step, first: int, final: float) -> Iterator[tuple[int, float]]:
        """Return the instants that a window at each of a run of instants reads."""
        if step.open_end and step.lo == step.hi:
            return  # nothing is before the end of an interval without length
        unit, last = 2 if self.dense else 1, self.last
        low = 0 if step.lo is None else first + unit * step.lo
        high = math.inf if step.hi is None else final + unit * step.hi
        if step.open_end and step.lo == 0:
            high -= self._short(final)
        elif step.open_end:
            low += self._short(first)
        if self.complete:
            high = min(high, last)
        elif self.cut and step.begin is not None:
            within = last - unit * step.begin  # up to it something of the window was recorded
            if first <= within:
                yield max(0, low), last
            if final <= within:
                return
            low = max(first, within + 1) + unit * (step.lo or 0)
        if max(0, low) <= high:
            yield max(0, low), high

    def _short(self, instant: float) -> int:
        """Return how much shorter a window is without its farthest instant.

        From the time between two ticks it is not shorter.
        """
        return 0 if self.dense and instant % 2 else 1


def merged_runs(runs: Iterable[tuple[int, float]]) -> InstantRuns:
    """Return runs of instants in order, joined where they touch."""
    known = sorted(runs)
    if len(known) < 2:
        return tuple(known)
    merged: list[tuple[int, float]] = []
    for first, last in known:
        if merged and first <= merged[-1][1] + 1:
            merged[-1] = merged[-1][0], max(merged[-1][1], last)
        else:
            merged.append((first, last))
    return tuple(merged)


_DIVIDES = (OPERATORS["always"], OPERATORS["and"])


@functools.lru_cache(maxsize=512)
def bodies(formula: Formula) -> tuple[Formula, ...]:
    """Return the bodies of a formula in the order of the text, equal ones once.

    Example:
        >>> from rtamt import parse
        >>> bodies(parse("always(a > 0 and always[0:5](b > 0)) and eventually(c > 0)").formula)
        (<Formula a > 0>, <Formula b > 0>, <Formula eventually(c > 0)>)
    """
    reached: dict[Formula, None] = {}
    seen: set[Node] = set()
    stack: list[Node] = [formula]
    while stack:
        node = stack.pop()
        if node in seen:
            continue
        seen.add(node)
        if node.op in _DIVIDES:
            stack += reversed(node.args)
        else:
            reached[cast("Formula", node)] = None
    return tuple(reached)


def body_reads(
    formula: Formula, bounds: Callable[[Node], Bounds], span: TraceSpan
) -> Mapping[Formula, InstantRuns]:
    """Return the instants, also after the trace, at which a formula read at 0 reads its bodies."""
    runs: dict[Node, list[tuple[int, float]]] = {formula: [(0, 0)]}
    for node in reversed([*formula.nodes()]):
        if node not in runs or node.op not in _DIVIDES:
            continue
        instants = merged_runs(runs[node])
        if node.op is OPERATORS["always"]:
            instants = span.window(bounds(node), instants)
        for operand in node.args:
            runs.setdefault(operand, []).extend(instants)
    return {body: merged_runs(runs[body]) for body in bodies(formula)}


def with_one_body(formula: Formula, body: Formula) -> Formula:
    """Return the formula with ``true`` as each of its other bodies."""
    changed: dict[Node, Node] = dict.fromkeys(bodies(formula), make("true", ()))
    changed[body] = body
    for node in formula.nodes():  # operands first
        if node.op in _DIVIDES and node not in changed and all(a in changed for a in node.args):
            changed[node] = with_operands(node, [changed[operand] for operand in node.args])
    return cast("Formula", changed[formula])
