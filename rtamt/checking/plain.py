"""Traces made plain: as few changes and as simple numbers as what they show allows."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, cast

from rtamt.checking.goal_monitors import GoalMonitors
from rtamt.checking.graph import Atom, Graph, TermKey, Truth
from rtamt.checking.kinds import last_digit
from rtamt.checking.samples import function_of
from rtamt.checking.solver import reached
from rtamt.checking.witness import ExampleTrace
from rtamt.language.formula import Formula, Term
from rtamt.language.scaling import predicates

__all__ = ["Plainness", "made_plain"]

_CHANGE: Final = 1.0
_RUN: Final = 0.5
_LATE: Final = 0.001
_AT_BORDER: Final = 3.0
_ODD: Final = 6.0
_WORK: Final = 1_000_000
"""The most parts of formulas that are looked at for one trace."""

_FEW: Final = 12
"""In traces of that many samples at most every run is tried."""

_Columns = Mapping[str, Sequence[float]]


class Plainness:
    """Which values of variables are plain.

    A value is plain if it tells at a glance on which side of each threshold it is; 0 is the
    plainest such value.

    Args:
        formulas: The formulas whose thresholds are meant.
        whole: The variables that are whole numbers.
        ranges: The least and the greatest value of variables.
    """

    def __init__(
        self,
        formulas: Iterable[Formula],
        whole: frozenset[str],
        ranges: Mapping[str, tuple[float, float]],
    ) -> None:
        self._whole, self._ranges = whole, ranges
        self._borders: dict[str, dict[float, None]] = {}
        for formula in formulas:
            for predicate in predicates(formula):
                sides = cast("tuple[Term, ...]", predicate.args)
                numbers = [
                    cast("float", part.leaf)
                    for side in sides
                    for part in side.nodes()
                    if part.op is None and not isinstance(part.leaf, str)
                ]
                bare = any(side.op is None and isinstance(side.leaf, str) for side in sides)
                signs = (1,) if bare and len(numbers) == 1 else (1, -1)
                for name in predicate.variables:
                    known = self._borders.setdefault(name, {})
                    known.update(
                        dict.fromkeys(s * x + 0.0 for x in numbers or [0.0] for s in signs)
                    )
        self.values = {name: self._ranked(name) for name in self._borders}

    def cost(self, name: str, value: float) -> float:
        """How far from plain a value is."""
        known = self.values[name].get(value) if name in self.values else abs(value) or 0.0
        return _ODD + 0.1 * len(repr(value)) if known is None else known

    def of(self, name: str) -> list[float]:
        """The plain values of a variable, the plainest first."""
        return [*self.values.get(name, ())] or [0.0]

    def _ranked(self, name: str) -> dict[float, float]:
        """Values with their cost, the plainest first."""
        borders = self._borders[name]
        ranked: dict[float, float] = {}
        lower, upper = self._ranges.get(name, (-math.inf, math.inf))
        rest = min(max(0.0, lower), upper)
        clear = [rest, *(b + sign * _away(b) for b in borders for sign in (1, -1))]
        near = [b + sign * last_digit(b) for b in borders for sign in (1, -1)]
        between = [(x + y) / 2 for x, y in itertools.pairwise(sorted(borders))]
        for rank, value in enumerate(map(self._tidy, [*clear, *near, *between, *borders])):
            if not lower <= value <= upper or (name in self._whole and value != int(value)):
                continue
            cost = 1.0 + 0.01 * rank if value != rest else 0.0
            if any(value != b and abs(value - b) < 0.99 * _away(b) for b in borders):
                cost += 1.0
            if value in borders:
                cost += _AT_BORDER
            ranked.setdefault(value, cost)
        return ranked

    @staticmethod
    def _tidy(value: float) -> float:
        return float(f"{value:.12g}") + 0.0


def _away(border: float) -> float:
    """How far from a threshold a value is clearly on one side."""
    tenth = 10.0 ** (math.floor(math.log10(abs(border))) - 1) if border else 1.0
    return max(last_digit(border), tenth)


def made_plain(
    trace: ExampleTrace,
    graph: Graph,
    truths: Sequence[Truth],
    plainness: Plainness,
    judges: GoalMonitors | None = None,
) -> ExampleTrace:
    """A plainer trace on which truths hold too.

    Runs of samples take plainer values as long as the truths hold: the greatest gain first.

    Args:
        trace: A trace on which they hold.
        graph: Where the truths are.
        truths: The truths.
        plainness: Which values are plain.
        judges: The monitors that tell fast where truths do not hold; None: there are none.
    """
    holds = _Test(graph, truths, judges)
    columns: _Columns = trace.columns
    if not holds(columns):
        return trace
    columns = _coarsely(columns, holds, plainness)
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
    found = {name: tuple(values) for name, values in columns.items()}
    return ExampleTrace(found, trace.samples, trace.loop)


def _coarsely(columns: _Columns, holds: _Test, plainness: Plainness) -> _Columns:
    """Columns with plain values in halves, quarters and so on."""
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
    return total + sum(_own_cost(name, values, plainness) for name, values in columns.items())


def _own_cost(name: str, values: Sequence[float], plainness: Plainness) -> float:
    ended = [*values, plainness.of(name)[0]]  # what is over before the end costs no more
    total = _CHANGE * sum(x != y for x, y in itertools.pairwise(ended))
    costs = {value: plainness.cost(name, value) for value in {*values}}
    return total + sum(costs[v] * (1 + _LATE * i) for i, v in enumerate(values) if costs[v])


def _changes(columns: _Columns, plainness: Plainness, cost: float, *, loop: int) -> list[_Columns]:
    """Plainer columns, the plainest first."""
    offers = [
        *({**columns, name: values} for name, values in _runs(columns, plainness)),
        *([] if loop else _earlier(columns, plainness)),
    ]
    ranked = [(_cost(offer, plainness), place) for place, offer in enumerate(offers)]
    return [offers[place] for now, place in sorted(ranked) if now < cost - 1e-9]


def _runs(columns: _Columns, plainness: Plainness) -> Iterator[tuple[str, list[float]]]:
    """Columns with a plain value in a run of samples."""
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
        for first, last in [*spans, *_runs_of(values)] if many else spans:
            now = sum(plainness.cost(name, value) for value in values[first:last])
            for value in plain:
                # A run that costs much more can only save changes.
                if plainness.cost(name, value) * (last - first) > now + 2:
                    continue
                if any(value != each for each in values[first:last]):
                    yield name, [*values[:first], *[value] * (last - first), *values[last:]]


def _runs_of(values: Sequence[object]) -> Iterator[tuple[int, int]]:
    """Where each run of equal values begins and ends."""
    begin = 0
    for _, run in itertools.groupby(values):
        end = begin + len([*run])
        yield begin, end
        begin = end


def _earlier(columns: _Columns, plainness: Plainness) -> Iterator[_Columns]:
    """Columns, of all variables or of one, that are some samples earlier."""
    rows = [*zip(*columns.values(), strict=True)]
    for step in _steps(rows):
        yield {name: _moved(name, values, step, plainness) for name, values in columns.items()}
    for name, values in columns.items():
        for step in _steps(values):
            yield {**columns, name: _moved(name, values, step, plainness)}


def _steps(values: Sequence[object]) -> Iterator[int]:
    """By how many samples values may come earlier: to where they change, and by halves."""
    count, starts = len(values), itertools.islice(_runs_of(values), 1, _FEW)
    halves = itertools.takewhile(bool, (count >> power for power in itertools.count(1)))
    yield from dict.fromkeys([*(begin for begin, _ in starts), *halves])


def _moved(name: str, values: Sequence[float], step: int, plainness: Plainness) -> list[float]:
    return [*values[step:], *[plainness.of(name)[0]] * step]


def _rounded(values: Iterable[float]) -> Iterable[float]:
    """Odd values with fewer digits."""
    for value in dict.fromkeys(values):
        if math.isfinite(value):
            yield from (round(value, digits) + 0.0 for digits in (0, 1, 2))


class _Test:
    """Tells whether truths hold on columns.

    Attributes:
        work: How many parts it has looked at.
    """

    def __init__(self, graph: Graph, truths: Sequence[Truth], judges: GoalMonitors | None) -> None:
        self._judges, self.work = judges, 0
        self._numbers: dict[TermKey, int] = {}
        self._terms: list[_Step] = []
        order = reached(graph, truths)
        places = {node: place for place, node in enumerate(order)}
        self._steps = [self._step(graph.nodes[node], places) for node in order]
        self._wanted = _placed(truths, places)
        self._size = len(order) + len(self._terms)

    def _step(self, found: Atom | tuple[Truth, ...] | None, places: Mapping[int, int]) -> _Step:
        """How the truth of a node is found from nodes before it."""
        if found is None:
            return lambda *_: False
        if isinstance(found[0], str):
            kind, left, right = found
            x, y = self._number(left), self._number(right)
            if kind == "equal":
                return lambda values, _: values[x] == values[y]
            return lambda values, _: values[x] >= values[y]
        parts = _placed(cast("Sequence[Truth]", found), places)
        return lambda _, known: all(known[place] is wanted for place, wanted in parts)

    def _number(self, term: TermKey) -> int:
        """The place of a term among all."""
        if term not in self._numbers:
            made = self._made(term)
            self._numbers[term] = len(self._terms)
            self._terms.append(made)
        return self._numbers[term]

    def _made(self, term: TermKey) -> _Step:
        function, *parts = term
        if function == "load":
            name, sample = cast("tuple[str, int]", tuple(parts))
            return lambda columns, _: columns[name][sample]
        if function == "const":
            return lambda *_: parts[0]
        apply = function_of(cast("str", function))
        places = [self._number(cast("TermKey", part)) for part in parts]
        return lambda _, values: apply(*(values[place] for place in places))

    def __call__(self, columns: _Columns) -> bool:
        if self._judges is not None:
            self.work += self._judges.work
            if not self._judges(columns):
                return False
        self.work += self._size
        values: list[float] = []
        for made in self._terms:
            value = made(columns, values)
            if math.isnan(value):
                return False
            values.append(value)
        known: list[bool] = []
        for step in self._steps:
            known.append(step(values, known))
        return all(known[place] is wanted for place, wanted in self._wanted)


_Step = Callable[[Any, Any], Any]
"""The value of a term from columns and terms before it, or a truth from terms and truths."""


def _placed(truths: Sequence[Truth], places: Mapping[int, int]) -> list[tuple[int, bool]]:
    """Where nodes are, and whether they are to hold."""
    return [(places[truth >> 1], not truth & 1) for truth in truths]
