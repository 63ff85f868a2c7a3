"""Simpler traces: fewer changes and simpler numbers, with the same truths."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Final, cast

from rtamt.checking.answers import ExampleTrace
from rtamt.checking.graph import Graph, KnownTrace, Truth, subterms, term_value
from rtamt.checking.search import Goal
from rtamt.errors import InputError
from rtamt.language import formula as syntax
from rtamt.language.formula import predicates
from rtamt.machines.protocols import End
from rtamt.monitors.monitor import EpisodeMonitor

_CHANGE: Final = 1.0
_RUN: Final = 0.5
_LATE: Final = 0.001
_AT_BORDER: Final = 3.0
_ODD: Final = 6.0
"""The costs of a change of a value, of a sample with changes, of a late value, of a threshold as a
value, and of an odd value."""

_WORK: Final = 1_000_000
"""The maximum number of graph nodes and terms to evaluate for one trace."""

_SAMPLES_PER_NODE: Final = 5
"""The number of monitored samples that cost as much as a node of a graph."""

_FEW: Final = 12
"""The maximum length of a trace for which every run of samples is tried."""

_Columns = Mapping[str, Sequence[float]]


def last_digit(value: float) -> float:
    """Return one unit of the last digit of a number as it is written, at most 1: 0.01 of 0.25."""
    exponent = Decimal(repr(value)).normalize().as_tuple().exponent
    return 10.0 ** min(0, cast("int", exponent))


class GoalMonitors:
    """Monitors that quickly reject a finite trace that misses its goals.

    ``work`` is the cost of a trace in nodes of a graph. SpecificationError is raised if a monitor
    cannot run one of the formulas.
    """

    def __init__(
        self, goals: Sequence[Goal], period: Fraction | None, end: End, samples: int
    ) -> None:
        self._end = end
        self._monitors = [
            (EpisodeMonitor(goal.program.specification, period), goal.holds)
            for goal in goals
            if goal.program.variables
        ]
        self.work = 1 + samples * len(self._monitors) // _SAMPLES_PER_NODE

    def __call__(self, columns: _Columns) -> bool:
        """Return whether a trace reaches the goals; False if a term is nan."""
        for monitor, holds in self._monitors:
            monitor.reset()
            try:
                for row in zip(*(columns[name] for name in monitor.variables), strict=True):
                    monitor.update(*row)
            except InputError:  # a term is nan
                return False
            monitor.finish(self._end)
            if (monitor.verdict > 0) is not holds:
                return False
        return True


class Plainness:
    """The plain values of variables, each with a cost.

    A value is plain if it is clearly on one side of each threshold; 0 is the plainest value.
    """

    def __init__(
        self,
        formulas: Iterable[syntax.Formula],
        integers: frozenset[str],
        ranges: Mapping[str, tuple[float, float]],
    ) -> None:
        self._integers, self._ranges = integers, ranges
        borders: dict[str, dict[float, None]] = {}
        for predicate in (p for formula in formulas for p in predicates(formula)):
            sides = cast("tuple[syntax.Term, ...]", predicate.args)
            numbers = [
                cast("float", part.leaf)
                for side in sides
                for part in side.nodes()
                if part.op is None and not isinstance(part.leaf, str)
            ]
            bare = any(side.op is None and isinstance(side.leaf, str) for side in sides)
            signs = (1,) if bare and len(numbers) == 1 else (1, -1)
            values = [s * x + 0.0 for x in numbers or [0.0] for s in signs]
            for name in predicate.variables:
                borders.setdefault(name, {}).update(dict.fromkeys(values))
        self.values = {name: self._ranked(name, [*borders[name]]) for name in borders}

    def cost(self, name: str, value: float) -> float:
        """Return the cost of a value; 0 for the plainest."""
        known = self.values[name].get(value) if name in self.values else abs(value) or 0.0
        return _ODD + 0.1 * len(repr(value)) if known is None else known

    def of(self, name: str) -> list[float]:
        """Return the plain values of a variable, the plainest first."""
        return [*self.values.get(name, ())] or [0.0]

    def _ranked(self, name: str, borders: Sequence[float]) -> dict[float, float]:
        ranked: dict[float, float] = {}
        lower, upper = self._ranges.get(name, (-math.inf, math.inf))
        remainder = min(max(0.0, lower), upper)
        clear = [remainder, *(b + sign * _distance(b) for b in borders for sign in (1, -1))]
        near = [b + sign * last_digit(b) for b in borders for sign in (1, -1)]
        between = [(x + y) / 2 for x, y in itertools.pairwise(sorted(borders))]
        for rank, exact in enumerate([*clear, *near, *between, *borders]):
            value = float(f"{exact:.12g}") + 0.0
            if not lower <= value <= upper or (name in self._integers and value != int(value)):
                continue
            cost = 1.0 + 0.01 * rank if value != remainder else 0.0
            if any(value != b and abs(value - b) < 0.99 * _distance(b) for b in borders):
                cost += 1.0
            if value in borders:
                cost += _AT_BORDER
            ranked.setdefault(value, cost)
        return ranked


def _distance(border: float) -> float:
    """Return the minimum distance of a value that is clearly on one side of a threshold."""
    tenth = 10.0 ** (math.floor(math.log10(abs(border))) - 1) if border else 1.0
    return max(last_digit(border), tenth)


def simplified(
    trace: ExampleTrace,
    graph: Graph,
    truths: Sequence[Truth],
    plainness: Plainness,
    monitors: GoalMonitors | None = None,
) -> ExampleTrace:
    """Return a simpler trace that keeps the truths.

    Runs of samples get plainer values as long as the truths hold, the largest gain first. Monitors
    quickly reject a trace.
    """
    holds = _TruthTest(graph, truths, monitors)
    columns: _Columns = trace.columns
    if not holds(columns):
        return trace
    columns = _halved(columns, holds, plainness)
    cost = _cost(columns, plainness)
    again = True
    while again:
        again = False
        for changed in _changes(columns, plainness, cost, loop=trace.loop):
            if holds.work > _WORK:
                break
            if holds(changed):
                columns, cost, again = changed, _cost(changed, plainness), True
                break
    simple = {name: tuple(values) for name, values in columns.items()}
    return ExampleTrace(simple, trace.samples, trace.loop)


def _halved(columns: _Columns, holds: _TruthTest, plainness: Plainness) -> _Columns:
    """Return columns with plain values in the whole trace, in halves, quarters and so on."""
    count = max((len(values) for values in columns.values()), default=0)
    size = count
    while size:
        for name, first in itertools.product(columns, range(0, count, size)):
            values = columns[name]
            part = values[first : first + size]
            now = sum(plainness.cost(name, value) for value in part)
            for value in (*plainness.of(name), *_rounded(part)):
                if plainness.cost(name, value) * len(part) >= now:
                    continue
                same = [value] * len(part)
                changed = {**columns, name: [*values[:first], *same, *values[first + size :]]}
                if holds.work > _WORK:
                    return columns
                if holds(changed):
                    columns = changed
                    break
        size //= 2
    return columns


def _cost(columns: _Columns, plainness: Plainness) -> float:
    rows = [*zip(*columns.values(), strict=True)]
    rows.append(tuple(plainness.of(name)[0] for name in columns))
    total = _RUN * sum(x != y for x, y in itertools.pairwise(rows))
    return total + sum(_column_cost(name, values, plainness) for name, values in columns.items())


def _column_cost(name: str, values: Sequence[float], plainness: Plainness) -> float:
    ended = [*values, plainness.of(name)[0]]  # so that a value that lasts to the end costs more
    total = _CHANGE * sum(x != y for x, y in itertools.pairwise(ended))
    costs = {value: plainness.cost(name, value) for value in {*values}}
    return total + sum(costs[v] * (1 + _LATE * i) for i, v in enumerate(values) if costs[v])


def _changes(columns: _Columns, plainness: Plainness, cost: float, *, loop: int) -> list[_Columns]:
    """Return plainer columns, the plainest first."""
    offers = [
        *({**columns, name: values} for name, values in _runs(columns, plainness)),
        *([] if loop else _earlier(columns, plainness)),
    ]
    ranked = [(_cost(offer, plainness), position) for position, offer in enumerate(offers)]
    return [offers[position] for now, position in sorted(ranked) if now < cost - 1e-9]


def _runs(columns: _Columns, plainness: Plainness) -> Iterator[tuple[str, list[float]]]:
    """Yield a variable and its column with one plain value in a run of samples."""
    rows = [*zip(*columns.values(), strict=True)]
    cuts = {0, 1, len(rows) - 1, len(rows)}
    for i, (x, y) in enumerate(itertools.pairwise(rows)):
        if x != y or len(rows) <= _FEW:
            cuts |= {i, i + 1, i + 2}
    ends = sorted(cut for cut in cuts if 0 <= cut <= len(rows))
    spans = [*itertools.combinations(ends, 2)]
    many = len(ends) > 2 * _FEW
    if many:
        spans = [
            *itertools.pairwise(ends),
            *((0, end) for end in ends),
            *((e, len(rows)) for e in ends),
        ]
    for name, values in columns.items():
        plain = dict.fromkeys([*plainness.of(name), *_rounded(values)])
        for first, last in [*spans, *_equal_runs(values)] if many else spans:
            now = sum(plainness.cost(name, value) for value in values[first:last])
            for value in plain:
                # A run that costs much more can only save changes.
                if plainness.cost(name, value) * (last - first) > now + 2:
                    continue
                if any(value != old for old in values[first:last]):
                    yield name, [*values[:first], *[value] * (last - first), *values[last:]]


def _equal_runs(values: Sequence[object]) -> Iterator[tuple[int, int]]:
    """Yield the start and the end of each run of equal values."""
    begin = 0
    for _, run in itertools.groupby(values):
        end = begin + len([*run])
        yield begin, end
        begin = end


def _earlier(columns: _Columns, plainness: Plainness) -> Iterator[_Columns]:
    """Yield columns with all variables, or one variable, moved some samples earlier."""

    def moved(name: str, values: Sequence[float], step: int) -> list[float]:
        return [*values[step:], *[plainness.of(name)[0]] * step]

    for step in _steps([*zip(*columns.values(), strict=True)]):
        yield {name: moved(name, values, step) for name, values in columns.items()}
    for name, values in columns.items():
        for step in _steps(values):
            yield {**columns, name: moved(name, values, step)}


def _steps(values: Sequence[object]) -> Iterator[int]:
    """Yield numbers of samples to move values by: up to a change, and halves of the length."""
    count, starts = len(values), itertools.islice(_equal_runs(values), 1, _FEW)
    halves = itertools.takewhile(bool, (count >> power for power in itertools.count(1)))
    yield from dict.fromkeys([*(begin for begin, _ in starts), *halves])


def _rounded(values: Iterable[float]) -> Iterable[float]:
    """Yield values with fewer digits."""
    for value in dict.fromkeys(values):
        if math.isfinite(value):
            yield from (round(value, digits) + 0.0 for digits in (0, 1, 2))


class _TruthTest:
    """A test of truths on columns; ``work`` counts the nodes and terms of all tests."""

    def __init__(
        self, graph: Graph, truths: Sequence[Truth], monitors: GoalMonitors | None
    ) -> None:
        self._graph, self._truths, self._monitors, self.work = graph, truths, monitors, 0
        nodes = graph.reached(truths)
        atoms = [atom for node in nodes if (atom := graph.atom_at(node)) is not None]
        self._terms = {part for atom in atoms for term in atom[1:] for part in subterms(term)}
        self._size = len(nodes) + len(self._terms)

    def __call__(self, columns: _Columns) -> bool:
        if self._monitors is not None:
            self.work += self._monitors.work
            if not self._monitors(columns):
                return False
        self.work += self._size

        def load(name: str, sample: int) -> float:
            return columns[name][sample]

        return KnownTrace(self._graph, load).fulfils(self._truths) and not any(
            math.isnan(term_value(term, load)) for term in self._terms
        )
