"""Truths of a trace whose samples are unknown, as a graph of conjunctions and disjunctions.

A truth is a number: 0 is false, 1 is true, others name a node, and a node's negation is the node
with its last bit changed. Equal nodes are one, so that what formulas and worlds have in common is
there once.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

__all__ = ["FALSE", "TRUE", "Atom", "Graph", "TermKey", "Truth"]

Truth = int
TermKey = tuple[object, ...]
"""A term at a sample: ``("load", name, sample)``, ``("const", value)``, ``(function, *terms)``."""

Atom = tuple[str, TermKey, TermKey]
"""``("at_least", x, y)`` or ``("equal", x, y)``; all comparisons are made of these."""

FALSE: Final = 0
TRUE: Final = 1


class Graph:
    """Truths, made from atoms.

    Attributes:
        nodes: What each node is: None for the constants, an `Atom`, or the conjunction of truths.

    Example:
        >>> graph = Graph()
        >>> p = graph.atom(("at_least", ("load", "x", 0), ("const", 1.0)))
        >>> graph.all([p, TRUE, p]) == p, graph.all([p, graph.no(p)]), graph.any([p, TRUE])
        (True, 0, 1)
    """

    def __init__(self) -> None:
        self.nodes: list[Atom | tuple[Truth, ...] | None] = [None]
        self._atoms: dict[Atom, Truth] = {}
        self._all: dict[tuple[Truth, ...], Truth] = {}

    def atom(self, atom: Atom) -> Truth:
        """The truth of a comparison."""
        known = self._atoms.get(atom)
        if known is None:
            known = self._atoms[atom] = self._new(atom)
        return known

    @staticmethod
    def no(truth: Truth) -> Truth:
        """The negation."""
        return truth ^ 1

    def all(self, truths: Iterable[Truth]) -> Truth:
        """The conjunction."""
        parts = {*truths}
        parts.discard(TRUE)
        if FALSE in parts or any(part ^ 1 in parts for part in parts):
            return FALSE
        if len(parts) < 2:
            return parts.pop() if parts else TRUE
        key = tuple(sorted(parts))
        known = self._all.get(key)
        if known is None:
            known = self._all[key] = self._new(key)
        return known

    def any(self, truths: Iterable[Truth]) -> Truth:
        """The disjunction."""
        return self.all(truth ^ 1 for truth in truths) ^ 1

    def _new(self, node: Atom | tuple[Truth, ...]) -> Truth:
        self.nodes.append(node)
        return 2 * len(self.nodes) - 2
