"""Folds of windows over a stream, one push per sample, and over lists of elements.

`SlidingWindow` is a two-stack queue whose flip is spread over the pushes (after Tangwongsan, Hirzel
and Schneider, "In-order sliding-window aggregation in worst-case constant time", 2021, for windows
of fixed length): at most four combinations per push, whatever the length and the fold.
"""

from __future__ import annotations

from itertools import accumulate

import numpy as np

from rtamt.machines.state import StateFields
from rtamt.program.algebra import FOLDS, Arrays, Element, LatticeFold


class FoldedWindow(StateFields):
    """A window over a stream of elements, and their fold; it starts full of identities."""

    __slots__ = ()

    def push(self, x: Element) -> Element:
        """Return the fold of the window that ends with the next element."""
        raise NotImplementedError


def make_window(fold: LatticeFold, length: int | None) -> FoldedWindow:
    """Return a window over the last ``length`` elements; None: over all of them."""
    if length is None:
        return RunningWindow(fold)
    return LatestWindow() if length == 1 else SlidingWindow(fold, length)


class LatestWindow(FoldedWindow):
    """A window of one element."""

    __slots__ = ()
    STATE = ()

    def push(self, x: Element) -> Element:
        return x

    def reset(self) -> None:
        pass


class RunningWindow(FoldedWindow):
    """A window over all elements so far."""

    __slots__ = ("_combine", "_identity", "_total")
    STATE = ("_total",)

    def __init__(self, fold: LatticeFold) -> None:
        self._combine = fold.combine
        self._identity = fold.identity
        self.reset()

    def reset(self) -> None:
        self._total = self._identity

    def push(self, x: Element) -> Element:
        self._total = self._combine(self._total, x)
        return self._total


class SlidingWindow(FoldedWindow):
    """A window over the last ``length`` elements, in blocks of half that length.

    The window covers the end of the block before the last one, the whole last block and the block
    that is being filled. ``_front`` has the suffix folds of the first, ``_middle`` is the fold of
    the second, ``_prefix`` the fold of the third. New elements replace the used ones of ``_front``;
    meanwhile the last block, in ``_back``, becomes suffix folds from its end, one per push. A
    missing block is empty and stands for identities, so a window takes memory only for seen
    elements.
    """

    STATE = ("_offset", "_front", "_back", "_middle", "_prefix", "_suffix")
    __slots__ = (*STATE, "_block", "_combine", "_identity", "_odd")

    def __init__(self, fold: LatticeFold, length: int) -> None:
        self._combine = fold.combine
        self._identity = fold.identity
        self._block = length // 2
        self._odd = length % 2
        self.reset()

    def reset(self) -> None:
        self._offset = 0
        self._front: list[Element] = []
        self._back: list[Element] = []
        self._middle = self._prefix = self._suffix = self._identity

    def push(self, x: Element) -> Element:
        combine, front, back, offset = self._combine, self._front, self._back, self._offset
        last = self._block - 1
        ahead = offset if self._odd else offset + 1
        oldest = front[ahead] if ahead < len(front) else self._identity
        if offset < len(front):
            front[offset] = x
        else:
            front.append(x)
        if back:
            position = last - offset
            self._suffix = back[position] = combine(back[position], self._suffix)
        self._prefix = combine(self._prefix, x)
        result = combine(combine(oldest, self._middle), self._prefix)
        if offset == last:
            self._front, self._back = back, front
            self._middle = self._prefix
            self._prefix = self._suffix = self._identity
            self._offset = 0
        else:
            self._offset = offset + 1
        return result


class DelayLine(StateFields):
    """A queue that returns every value ``length`` samples later."""

    __slots__ = ("_length", "_place", "_ring")
    STATE = ("_place", "_ring")

    def __init__(self, length: int) -> None:
        self._length = length
        self.reset()

    def reset(self) -> None:
        self._ring: list[float] = []
        self._place = 0

    def push(self, x: float) -> float:
        """Return the value of ``length`` pushes ago, 0.0 before there is one."""
        position = self._place
        late = 0.0
        if position < len(self._ring):
            late, self._ring[position] = self._ring[position], x
        else:
            self._ring.append(x)
        self._place = (position + 1) % self._length
        return late


def slide(
    fold: LatticeFold, elements: list[Element], rest: Element, width: int, count: int
) -> list[float]:
    """Return the results of `count` windows; window i starts with element i."""
    inside = max(0, min(count, len(elements) - width + 1))
    folds: list[Element] = []
    if inside:
        push = make_window(fold, width).push
        folds = [push(x) for x in elements[: width - 1 + inside]][width - 1 :]
    folds += suffixes(fold, elements[inside:], rest)[: count - inside]
    folds += [rest] * (count - len(folds))
    return [x[-1] for x in folds]


def suffixes(fold: LatticeFold, elements: list[Element], rest: Element) -> list[Element]:
    """Return for each element the fold from there to the end and of the rest, which comes last."""
    combine = FOLDS[fold.mirror].combine  # of the younger with the older
    return [*accumulate(reversed(elements), combine, initial=rest)][::-1]


def fold_all(fold: LatticeFold, elements: Arrays) -> Arrays:
    """Fold all elements into one, along the last axis, which then has the length 1."""
    while (count := elements[0].shape[-1]) > 1:
        half = count // 2
        pairs = fold.combine_arrays(
            tuple(a[..., 0 : 2 * half : 2] for a in elements),
            tuple(a[..., 1 : 2 * half : 2] for a in elements),
        )
        elements = tuple(
            np.concatenate([b, a[..., 2 * half :]], axis=-1)
            for a, b in zip(elements, pairs, strict=True)
        )
    return elements
