"""Traces that were found before, tried before a solver is asked."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from typing import Final, cast

from rtamt.checking.graph import Atom, Graph, TermKey, Truth
from rtamt.checking.samples import function_of

__all__ = ["KnownTrace", "TracePool"]

_MOST: Final = 200


class KnownTrace:
    """A trace, on which each truth of a graph is true, false, or nobody knows.

    Args:
        graph: The graph.
        columns: The value of each variable at each sample.
        other: The values of variables that the trace does not have.
    """

    def __init__(
        self,
        graph: Graph,
        columns: Mapping[str, Sequence[float]],
        other: Callable[[str], float],
    ) -> None:
        self._graph, self._columns, self._other = graph, columns, other
        self._known: dict[int, bool | None] = {0: False}

    def fulfils(self, truths: Sequence[Truth]) -> bool:
        """Whether truths are true on it, for certain."""
        return all(self._at(truth) is True for truth in truths)

    def _at(self, truth: Truth) -> bool | None:
        if truth >> 1 not in self._known:
            self._find(truth >> 1)
        known = self._known[truth >> 1]
        return known if known is None or not truth & 1 else not known

    def _find(self, node: int) -> None:
        stack = [node]  # depth first, without recursion
        while stack:
            each = self._graph.nodes[stack[-1]]
            if each is None or isinstance(each[0], str):
                self._known[stack.pop()] = self._compared(cast("Atom", each))
                continue
            missing = [part >> 1 for part in each if part >> 1 not in self._known]
            if missing:
                stack += missing
                continue
            found = [self._at(part) for part in each]
            self._known[stack.pop()] = False if False in found else None if None in found else True

    def _compared(self, atom: Atom) -> bool | None:
        x, y = self._value(atom[1]), self._value(atom[2])
        if math.isnan(x) or math.isnan(y):
            return None
        return x >= y if atom[0] == "at_least" else x == y

    def _value(self, key: TermKey) -> float | Fraction:
        function, *parts = key
        if function == "load":
            name, sample = cast("tuple[str, int]", tuple(parts))
            column = self._columns.get(name)
            return self._other(name) if column is None else column[sample]
        if function == "const":
            return cast("float", parts[0])
        values = (self._value(cast("TermKey", part)) for part in parts)
        return function_of(cast("str", function))(*values)


class TracePool:
    """The newest traces that end, by their lengths."""

    def __init__(self, graph: Graph, other: Callable[[str], float]) -> None:
        self._graph, self._other = graph, other
        self._traces: dict[tuple[tuple[str, tuple[float, ...]], ...], KnownTrace] = {}

    def add(self, columns: Mapping[str, tuple[float, ...]]) -> None:
        """Keeps a trace."""
        key = tuple(columns.items())
        if columns and key not in self._traces:
            self._traces[key] = KnownTrace(self._graph, columns, self._other)
            if len(self._traces) > _MOST:
                del self._traces[next(iter(self._traces))]

    def of_length(self, count: int) -> Iterator[tuple[dict[str, tuple[float, ...]], KnownTrace]]:
        """The traces of some samples, the newest first."""
        for key in reversed([*self._traces]):
            if len(key[0][1]) == count:
                yield dict(key), self._traces[key]
