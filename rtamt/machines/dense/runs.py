"""Signals over the regions of dense time as runs of equal values, and their folds.

`rtamt.program.dense_lowering` explains positions. A run lasts from its start to the next one; the
last run lasts as far as the caller knows the signal. The last axis of values counts runs; previous
axes count corners (`rtamt.machines.episode.machine`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.arrays import Floats
from rtamt.program.algebra import FOLDS, Arrays, LatticeFold, greater, lesser

Positions = NDArray[np.int64]


def distinct(*positions: Positions) -> Positions:
    """Return the sorted positions of arrays, each once; `np.unique` is slower, as it hashes."""
    every = np.concatenate(positions)
    every.sort(kind="stable")  # lines that are sorted: in linear time
    new = np.append(True, every[1:] != every[:-1])[: len(every)]
    once: Positions = every[new]
    return once


class Runs(NamedTuple):
    """Runs of one signal, or of elements of several numbers.

    Attributes:
        starts: The positions of the starts, increasing.
        values: For every number of an element its values in each run.
    """

    starts: Positions
    values: Arrays

    @property
    def last(self) -> Floats:
        """The values of the last number of each element."""
        return self.values[-1]

    def places(self, positions: Positions) -> NDArray[np.intp]:
        """Return the run of each position."""
        return self.starts.searchsorted(positions, "right") - 1

    def merged(self) -> Runs:
        """Return the signal without runs that equal the previous run, signs of zeros included."""
        if len(self.starts) < 2:
            return self
        new = np.zeros(len(self.starts), bool)
        new[0] = True
        for values in self.values:
            bits = values.view(np.int64).reshape(-1, values.shape[-1])
            new[1:] |= (bits[:, 1:] != bits[:, :-1]).any(axis=0)
        return (
            self if new.all() else Runs(self.starts[new], tuple(a[..., new] for a in self.values))
        )


def clipped(runs: Runs, begin: int, end: int | None = None) -> Runs:
    """Return the runs from a position on and, with an end, those that start up to there."""
    first = max(0, int(runs.starts.searchsorted(begin, "right")) - 1)
    after = len(runs.starts) if end is None else int(runs.starts.searchsorted(end, "right"))
    starts = runs.starts[first:after]
    if len(starts) and starts[0] < begin:
        starts = starts.copy()
        starts[0] = begin
    return Runs(starts, tuple(a[..., first:after] for a in runs.values))


def concatenated(*parts: Runs) -> Runs:
    """Return consecutive parts of a signal as one."""
    parts = tuple(part for part in parts if len(part.starts)) or parts[:1]
    if len(parts) == 1:
        return parts[0]
    starts = np.concatenate([part.starts for part in parts])
    numbers = zip(*(part.values for part in parts), strict=True)
    return Runs(starts, tuple(np.concatenate(number, axis=-1) for number in numbers))


def joint(signals: Sequence[Runs]) -> Runs:
    """Return signals with a common start as one signal with all their numbers."""
    if len(signals) == 1:
        return signals[0]
    starts = distinct(*(signal.starts for signal in signals))
    return Runs(starts, tuple(signal.last[..., signal.places(starts)] for signal in signals))


def paired(name: str, runs: Runs, end: int | None) -> Runs:
    """Return the elements of a fold: with two operands p and q, at instants and at intervals.

    At an instant the last number is q, at an interval also p is needed (for dual folds: p is
    enough). Inside a run an instant differs from an interval only at the start of the fold: the
    first position for futures, the last one for pasts.
    """
    if len(runs.values) == 1 or not len(runs.starts):
        return runs
    starts, (p, q) = runs
    reduced = (greater if FOLDS[name].identity[-1] > 0 else lesser)(p, q)
    after = np.append(starts[1:], np.iinfo(np.int64).max if end is None else end + 1)
    if name in ("until", "release"):
        single = (starts % 2 == 0) & (after - starts > 1)  # an instant, then intervals
        last = np.where(starts % 2 == 0, q, reduced)
        more, values = starts[single] + 1, reduced[..., single]
    else:
        ends = (after % 2 == 1) & (after < np.iinfo(np.int64).max)
        single = ends & (after - starts > 1)
        last = np.where(ends & ~single, q, reduced)
        more, values = after[single] - 1, q[..., single]
    if not len(more):
        return Runs(starts, (p, last))
    every = np.concatenate([starts, more])
    order = np.argsort(every, kind="stable")
    return Runs(
        every[order],
        (
            np.concatenate([p, p[..., single]], axis=-1)[..., order],
            np.concatenate([last, values], axis=-1)[..., order],
        ),
    )


def identities(fold: LatticeFold, corners: tuple[int, ...], start: int) -> Runs:
    """Return a run of elements that are the identity of a fold."""
    return Runs(np.array([start]), tuple(np.full((*corners, 1), e) for e in fold.identity))


def scanned(fold: LatticeFold, elements: Arrays) -> Arrays:
    """Return for each element the fold of all up to it."""
    size, count = 1, elements[0].shape[-1]
    while size < count:
        later = fold.combine_arrays(
            tuple(a[..., :-size] for a in elements), tuple(a[..., size:] for a in elements)
        )
        elements = tuple(
            np.concatenate([a[..., :size], b], axis=-1)
            for a, b in zip(elements, later, strict=True)
        )
        size *= 2
    return elements


def suffixes(fold: LatticeFold, elements: Arrays) -> Arrays:
    """Return for each element the fold of all from it on."""
    mirror = FOLDS[fold.mirror]
    backwards = scanned(mirror, tuple(a[..., ::-1] for a in elements))
    return tuple(np.ascontiguousarray(a[..., ::-1]) for a in backwards)


def slid(fold: LatticeFold, runs: Runs, lo: int, hi: int, begin: int, end: int | None) -> Runs:
    """Return the fold over offsets lo to hi of every position from begin to end."""
    corners = runs.last.shape[:-1]
    if not len(runs.starts) or begin + lo < runs.starts[0]:
        runs = concatenated(identities(fold, corners, begin + lo), runs)
    starts = np.concatenate([np.array([begin]), runs.starts - hi, runs.starts - lo])
    starts = distinct(
        starts[starts >= begin if end is None else (starts >= begin) & (starts <= end)]
    )
    first, last = runs.places(starts + lo), runs.places(starts + hi)
    folds = np.empty((*corners, len(starts)))
    power, size = runs.values, 1
    width = last - first + 1
    while True:
        now = (width >= size) & (width < 2 * size)
        if now.any():
            # Folds are idempotent: two windows of a power of two may overlap.
            left = tuple(a[..., first[now]] for a in power)
            right = tuple(a[..., last[now] - size + 1] for a in power)
            folds[..., now] = fold.combine_arrays(left, right)[-1]
        if not (width >= 2 * size).any():
            return Runs(starts, (folds,)).merged()
        power = fold.combine_arrays(
            tuple(a[..., :-size] for a in power), tuple(a[..., size:] for a in power)
        )
        size *= 2
