"""Values of variables for terms that a solver does not know, such as distances.

A predicate reads one sample. So it is enough to know, of the variables of such terms, a few points
at which the predicates are what they can be; the solver chooses among them at each sample. The
points are made of the numbers in the predicates: where a difference is 0, and around there.
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, cast

from rtamt.checking.graph import Atom, Graph, TermKey, Truth
from rtamt.checking.limits import ValueRange
from rtamt.checking.samples import function_of
from rtamt.checking.solver import is_linear, reached

__all__ = ["PointChoices"]

_TRIED: Final = 500
"""The most points that are tried until another way is found in which predicates can be."""

_ROOTS: Final = 1000
"""The most points of roots alone."""

_KEPT: Final = 32
"""The most points among which a solver chooses."""

_Point = Mapping[str, float]
_Ways = tuple[bool | None, ...]


class PointChoices:
    """Makes points for the terms of a graph that a solver does not know.

    Args:
        graph: The graph.
        whole: The variables that are whole numbers.
        ranges: The least and the greatest value of variables.
    """

    def __init__(
        self, graph: Graph, whole: frozenset[str], ranges: Mapping[str, ValueRange]
    ) -> None:
        self._graph, self._whole, self._ranges = graph, whole, ranges
        self._known: dict[tuple[Atom, ...], list[_Point]] = {}

    def choices(self, truths: Sequence[Truth]) -> list[Truth]:
        """For each sample: that the variables of unknown terms have the values of some point.

        Args:
            truths: Truths that depend on such terms.
        """
        by_sample: dict[int, list[tuple[Truth, Atom]]] = {}
        for node in reached(self._graph, truths):
            found = self._graph.nodes[node]
            if found is None or not isinstance(found[0], str):
                continue
            atom: Atom = found
            loads = {load for term in atom[1:] for load in _loads(term)}
            samples = {sample for _, sample in loads}
            if len(samples) == 1:
                by_sample.setdefault(samples.pop(), []).append((2 * node, atom))
        return [
            self._chosen(sample, some)
            for sample, atoms in by_sample.items()
            for some in _together(atoms)
        ]

    def _chosen(self, sample: int, atoms: Sequence[tuple[Truth, Atom]]) -> Truth:
        graph = self._graph
        bare = tuple(_without_sample(atom) for _, atom in atoms)
        if bare not in self._known:
            self._known[bare] = self._points(bare)
        chosen = []
        for point in self._known[bare]:
            parts = [
                graph.atom(("equal", ("load", name, sample), ("const", value)))
                for name, value in point.items()
            ]
            parts += [
                truth if _holds(atom, point) else graph.no(truth)
                for (truth, _), atom in zip(atoms, bare, strict=True)
            ]
            chosen.append(graph.all(parts))
        return graph.any(chosen)

    def _points(self, atoms: Sequence[Atom]) -> list[_Point]:
        """Points at which predicates are in all the ways that were found."""
        kept: dict[_Ways, _Point] = {}
        left = _TRIED
        for point in self._tried(atoms, kept):
            ways = tuple(_holds(atom, point) for atom in atoms)
            if None not in ways and ways not in kept:
                kept[ways] = point
                left = _TRIED
            left -= 1
            if not left or len(kept) == _KEPT:
                break
        return [*kept.values()]

    def _tried(self, atoms: Sequence[Atom], kept: Mapping[_Ways, _Point]) -> Iterator[_Point]:
        """Points of which each variable has a root; then others near them and near numbers."""
        names = sorted({name for atom in atoms for term in atom[1:] for name, _ in _loads(term)})
        roots: dict[str, dict[float, None]] = {name: {} for name in names}
        numbers = {0.0, 1.0}
        for atom in atoms:
            for term in atom[1:]:
                for part in _parts(term):
                    if part[0] == "const" and math.isfinite(cast("float", part[1])):
                        numbers.add(abs(cast("float", part[1])))
                    for name, value in _root(part):
                        roots[name][value] = None
        zeros = [[*(roots[name] or {0.0: None})] for name in names]
        chance = random.Random(0)  # the same points each time
        every = math.prod(map(len, zeros))
        if every <= _ROOTS:
            yield from (self._point(names, values) for values in itertools.product(*zeros))
        sizes = sorted(numbers)
        while True:
            base = [chance.choice(values) for values in zeros]
            near = [*kept.values()]
            if near and chance.random() < 0.5:
                base = [*chance.choice(near).values()]
            yield self._point(
                names,
                [
                    value
                    if chance.random() < 0.5
                    else value + chance.choice((-1, 1)) * chance.choice(sizes) * chance.random() * 2
                    for value in base
                ],
            )

    def _point(self, names: Sequence[str], values: Sequence[float]) -> _Point:
        point = {}
        for name, value in zip(names, values, strict=True):
            lower, upper = self._ranges.get(name, (-math.inf, math.inf))
            near = float(f"{value:.3g}")
            near = float(round(near)) if name in self._whole else near
            point[name] = min(max(near, lower), upper) + 0.0
        return point


def _together(atoms: Sequence[tuple[Truth, Atom]]) -> list[list[tuple[Truth, Atom]]]:
    """Predicates of one sample that share variables of unknown terms, with others on these."""
    groups: list[set[str]] = []
    for _, atom in atoms:
        if all(map(is_linear, atom[1:])):
            continue
        names = _names(atom)
        joined = [group for group in groups if group & names]
        groups = [group for group in groups if not group & names]
        groups.append(names.union(*joined))
    return [[each for each in atoms if _names(each[1]) <= group] for group in groups]


def _names(atom: Atom) -> set[str]:
    return {name for term in atom[1:] for name, _ in _loads(term)}


def _parts(term: TermKey) -> Iterator[TermKey]:
    """A term and all below it."""
    yield term
    if term[0] not in {"load", "const"}:
        for part in term[1:]:
            yield from _parts(cast("TermKey", part))


def _loads(term: TermKey) -> Iterator[tuple[str, int]]:
    for part in _parts(term):
        if part[0] == "load":
            yield cast("tuple[str, int]", part[1:])


def _root(term: TermKey) -> Iterator[tuple[str, float]]:
    """Where the sum or difference of a variable and a number is 0."""
    if term[0] not in {"add", "sub"}:
        return
    x, y = cast("tuple[TermKey, TermKey]", term[1:])
    if x[0] == "const":
        x, y = y, x
    if x[0] == "load" and y[0] == "const" and math.isfinite(cast("float", y[1])):
        sign = -1.0 if term[0] == "add" else 1.0
        yield cast("str", x[1]), sign * cast("float", y[1])


def _without_sample(atom: Atom) -> Atom:
    def without(term: TermKey) -> TermKey:
        if term[0] == "load":
            return "load", term[1], 0
        if term[0] == "const":
            return term
        return (term[0], *(without(cast("TermKey", part)) for part in term[1:]))

    return atom[0], without(atom[1]), without(atom[2])


def _holds(atom: Atom, point: _Point) -> bool | None:
    """Whether a predicate holds at a point; None if a term is nan there."""
    x, y = _value(atom[1], point), _value(atom[2], point)
    if math.isnan(x) or math.isnan(y):
        return None
    return x >= y if atom[0] == "at_least" else x == y


def _value(term: TermKey, point: _Point) -> float:
    function, *parts = term
    if function == "load":
        return point[cast("str", parts[0])]
    if function == "const":
        return cast("float", parts[0])
    values = (_value(cast("TermKey", part), point) for part in parts)
    return cast("float", function_of(cast("str", function))(*values))
