"""Rows of values of an episode: arrays with the axes time, corner, lane."""

from __future__ import annotations

from collections.abc import Sequence

from rtamt.program.instructions import Window
from rtamt_arrays.functions import Elements, Fold, exact
from rtamt_arrays.operations import Operations, Tensor

__all__ = ["EpisodeRows"]


class EpisodeRows:
    """What is made of rows: longer ones, elements of folds, and their values in a world.

    Args:
        operations: The array library.
        dtype: The kind of floats.
    """

    def __init__(self, operations: Operations, dtype: object) -> None:
        self._o = operations
        self._dtype = dtype
        self._lattice = exact(operations)

    def after(self, x: Tensor, y: Tensor) -> Tensor:
        """One array after the other, both as wide as the wider one."""
        wide = [max(pair) for pair in zip(x.shape[1:], y.shape[1:], strict=True)]
        parts = [self._o.broadcast(each, (each.shape[0], *wide)) for each in (x, y)]
        return self._o.concatenate(parts)

    def filled(self, rows: Tensor, tail: Tensor | float, count: int) -> Tensor:
        """Rows with so many of a tail after them."""
        if count <= 0:
            return rows
        tail = self.array(tail)
        later = self._o.broadcast(tail, (count, *tail.shape))
        return later if rows is None else self.after(rows, later)

    def array(self, value: Tensor | float) -> Tensor:
        """A value as an array with axes of corners and lanes."""
        return self._o.full((1, 1), value, self._dtype) if isinstance(value, float) else value

    def even(self, x: Elements) -> Elements:
        """Elements whose numbers are all as wide as the widest."""
        wide = [max(sizes) for sizes in zip(*(a.shape[1:] for a in x), strict=True)]
        return tuple(self._o.broadcast(a, (a.shape[0], *wide)) for a in x)

    def repeated(self, rows: Tensor, count: int) -> Tensor:
        """A row as often as that, if it is one."""
        return self._o.broadcast(rows, (count, *rows.shape[1:]))

    def identities_of(self, fold: Fold, count: int) -> Elements | None:
        """So many elements that change nothing; None of none."""
        if count <= 0:
            return None
        return tuple(self._o.full((count, 1, 1), e, self._dtype) for e in fold.identity)

    def inside(self, age: Tensor, window: Window, begin: int, end: int) -> Tensor:
        """Whether the times at offsets are in the window of time 0."""
        offsets = self._o.arange(begin, end + 1)[:, None, None]
        times = age + offsets
        inside = times >= max(0, window.lo or 0)
        return inside if window.hi is None else inside & (times <= window.hi)

    def in_world(self, rows: Tensor, unknowns: Sequence[Tensor]) -> Tensor:
        """Polynomials in the unknowns for given values of these."""
        count, corners, lanes = rows.shape
        if corners == 1:  # the same at every corner
            return rows
        values = rows.reshape((count, *(2,) * len(unknowns), 1, lanes))
        for u in unknowns:
            values = self._lattice.greater(values[:, 0], self._lattice.lesser(values[:, 1], u))
        return values

    def fold(self, window: Window) -> Fold:
        """The fold of a window."""
        return Fold.named(window.fold, self._lattice)
