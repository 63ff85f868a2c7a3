"""The value of an episode at time 0 in each continuation, from settled and open values.

A continuation is "now" (the episode ends), "lower" or "upper" (it continues with the smallest or
the largest possible values). `rtamt_arrays.episode` describes the algorithm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import assert_never

from rtamt.program import algebra
from rtamt.program.instructions import Const, Map, Window
from rtamt.program.placement import Placement
from rtamt_arrays.functions import (
    FUNCTIONS,
    Elements,
    Fold,
    exact,
    fold_all,
    prefixes,
    slide,
    suffixes,
)
from rtamt_arrays.layout import Arrival, Continuation, ContinuationName, Layout, StreamValues
from rtamt_arrays.operations import Operations, Tensor


class EpisodeRows:
    """Operations on rows of values: arrays with the axes time, corner and batch entry."""

    def __init__(self, operations: Operations, dtype: object) -> None:
        self._o = operations
        self._dtype = dtype
        self._lattice = exact(operations)

    def after(self, x: Tensor, y: Tensor) -> Tensor:
        """Return one array after the other, both broadcast to their common width."""
        wide = [max(pair) for pair in zip(x.shape[1:], y.shape[1:], strict=True)]
        parts = [self._o.broadcast(part, (part.shape[0], *wide)) for part in (x, y)]
        return self._o.concatenate(parts)

    def filled(self, rows: Tensor, tail: Tensor | float, count: int) -> Tensor:
        """Return rows, then ``count`` rows of the tail."""
        if count <= 0:
            return rows
        tail = self.array(tail)
        tails = self._o.broadcast(tail, (count, *tail.shape))
        return tails if rows is None else self.after(rows, tails)

    def array(self, value: Tensor | float) -> Tensor:
        """Return a value as an array with axes of corners and entries."""
        return self._o.full((1, 1), value, self._dtype) if isinstance(value, float) else value

    def same_width(self, x: Elements) -> Elements:
        """Return elements with all numbers broadcast to their common width."""
        wide = [max(sizes) for sizes in zip(*(a.shape[1:] for a in x), strict=True)]
        return tuple(self._o.broadcast(a, (a.shape[0], *wide)) for a in x)

    def repeated(self, rows: Tensor, count: int) -> Tensor:
        """Repeat a single row ``count`` times."""
        return self._o.broadcast(rows, (count, *rows.shape[1:]))

    def identities_of(self, fold: Fold, count: int) -> Elements | None:
        """Return ``count`` identity elements; None if ``count`` is not positive."""
        if count <= 0:
            return None
        return tuple(self._o.full((count, 1, 1), e, self._dtype) for e in fold.identity)

    def inside(self, age: Tensor, window: Window, begin: int, end: int) -> Tensor:
        """Return whether the times at offsets are in the window at time 0."""
        offsets = self._o.arange(begin, end + 1)[:, None, None]
        times = age + offsets
        inside = times >= max(0, window.lo or 0)
        return inside if window.hi is None else inside & (times <= window.hi)

    def at_unknowns(self, rows: Tensor, unknowns: Sequence[Tensor]) -> Tensor:
        """Return the values of polynomials at values of their unknowns."""
        count, corners, entries = rows.shape
        if corners == 1:  # they do not depend on unknowns
            return rows
        values = rows.reshape((count, *(2,) * len(unknowns), 1, entries))
        for u in unknowns:
            values = self._lattice.greater(values[:, 0], self._lattice.lesser(values[:, 1], u))
        return values

    def fold(self, window: Window) -> Fold:
        """Return the fold of a window."""
        return Fold.named(window.fold, self._lattice)


INF = math.inf
_DECIDES = {"min": -INF, "max": INF}
"""The operand that decides a function; its negative is neutral."""


class Continuations:
    """The value of a program at time 0 in a continuation."""

    def __init__(
        self,
        placement: Placement,
        layout: Layout,
        operations: Operations,
        rows: EpisodeRows,
        dtype: object,
    ) -> None:
        self.program = placement.program
        self._placement = placement
        self._layout = layout
        self._shapes, self._depends = layout.shapes, layout.depends
        self._axes = {register: axis for axis, register in enumerate(placement.unknowns)}
        self._o = operations
        self._rows = rows
        self._dtype = dtype

    def view(
        self, now: Arrival, name: ContinuationName, opened: Continuation | None = None
    ) -> Continuation:
        """Return the streams of a continuation.

        For a cut trace, ``opened`` is the same continuation of the uncut trace.
        """
        unknown = self._o.full((1, 1), 0.0, self._dtype)
        view = Continuation(name, {}, [unknown] * len(self._axes), opened)
        for r in self._placement.streams:
            instruction = self.program.instructions[r]
            if isinstance(instruction, Const):
                stream = StreamValues(None, -self._layout.oldest, instruction.value)
            elif r < self.program.terms:
                stream = StreamValues(None, 0, INF if name == "upper" else -INF)
            elif isinstance(formula := self.program.formula(r), Map):
                stream = self._pointwise(now, view, r, formula)
            elif isinstance(window := formula, Window):
                compute = self._future if window.hi is None else self._windowed
                stream = compute(now, view, r, window)
                if opened is None:
                    stream = self._replace_after_now(now, view, window, stream)
                elif window.endless or window.hi is None:
                    stream = self._merge_cut(r, window, stream, opened.streams[r])
            else:
                assert_never(formula)
            view.streams[r] = stream
        return view

    def value(self, now: Arrival, view: Continuation) -> Tensor:
        """Return the value at time 0 in a continuation."""
        values: dict[int, Tensor] = {}
        for r in self._placement.initial:
            if r < self.program.terms:
                values[r] = now.first[r]
                continue
            match self.program.formula(r):
                case Map(function, args):
                    values[r] = FUNCTIONS[function](self._o, *(values[a] for a in args))
                case Window() as window:
                    values[r] = self._at_zero(now, view, r, window)
        return values[self.program.result]

    def _read(
        self, now: Arrival, view: Continuation, register: int, begin: int, end: int
    ) -> tuple[Tensor, int]:
        """Return the values at offsets before the tail, and the last of these offsets."""
        shape, stream = self._shapes[register], view.streams[register]
        last = min(end, stream.last)
        if last < begin:
            return None, begin - 1
        parts = []
        if begin <= -shape.late:
            rows = now.settled[register][
                begin + shape.back : min(last, -shape.late) + shape.back + 1
            ]
            parts.append(
                self._rows.at_unknowns(rows, view.unknowns) if self._depends[register] else rows
            )
        first = 1 - shape.late
        if last >= first:
            parts.append(stream.values[max(begin, first) - first : last - first + 1])
        return (parts[0] if len(parts) == 1 else self._rows.after(*parts)), last

    def _pointwise(
        self, now: Arrival, view: Continuation, register: int, instruction: Map
    ) -> StreamValues:
        begin, end = self._open(view, register)
        operands = []
        for a in instruction.args:
            rows, last = self._read(now, view, a, begin, end)
            operands.append((last, rows, view.streams[a].tail))
        name = instruction.function
        tail = self._apply_to_tails(name, [operand[2] for operand in operands])
        if name in _DECIDES:
            (last, x, short), (longest, y, _) = sorted(operands, key=lambda operand: operand[0])
            count = last - begin + 1
            choose = FUNCTIONS[name]
            common = None if x is None else choose(self._o, x, y[:count])
            number = short if isinstance(short, float) else 0.0
            if longest == last or number == _DECIDES[name]:
                return StreamValues(common, last, tail)
            remainder = y[count:]
            if number != -_DECIDES[name]:
                remainder = choose(self._o, self._rows.array(short), remainder)
            rows = remainder if common is None else self._rows.after(common, remainder)
            return StreamValues(rows, longest, tail)
        filled = [self._rows.filled(rows, t, end - last) for last, rows, t in operands]
        if end < begin:
            return StreamValues(None, end, tail)
        return StreamValues(FUNCTIONS[name](self._o, *filled), end, tail)

    def _apply_to_tails(self, name: str, tails: Sequence[Tensor | float]) -> Tensor | float:
        """Apply a function to tails."""
        if all(isinstance(tail, float) for tail in tails):
            return algebra.FUNCTIONS[name].apply(*tails)
        return FUNCTIONS[name](self._o, *map(self._rows.array, tails))

    def _open(self, view: Continuation, register: int) -> tuple[int, int]:
        """Return the first and the last offset at which a stream has not settled."""
        shape = self._shapes[register]
        return 1 - shape.late, 0 if view.name == "now" else shape.past

    def _closed(self, view: Continuation, window: Window) -> bool:
        """Return whether missing samples count as identities."""
        if view.opened is not None:
            return window.hi is None
        return view.name == "now" or window.skips(best=view.name == "upper")

    def _elements(
        self, now: Arrival, view: Continuation, window: Window, begin: int, end: int
    ) -> tuple[Elements | None, int]:
        """Return the elements at offsets before the tail, and the last of these offsets."""
        streams = [self._read(now, view, a, begin, end) for a in window.args]
        last = max(stop for _, stop in streams)
        if last < begin:
            return None, last
        x = tuple(
            self._rows.filled(rows, view.streams[a].tail, last - stop)
            for a, (rows, stop) in zip(window.args, streams, strict=True)
        )
        return self._since_zero(now, window, begin, x), last

    def _since_zero(self, now: Arrival, window: Window, begin: int, x: Elements) -> Elements:
        """Return elements from an offset on, with identities before time 0."""
        if begin >= 0:
            return x
        offsets = self._o.arange(begin, begin + x[0].shape[0])
        return self._rows.fold(window).masked(self._o, now.age >= -offsets[:, None, None], x)

    def _extended(
        self, view: Continuation, window: Window, x: Elements | None, count: int
    ) -> Elements | None:
        """Return elements, then ``count`` elements of the tail."""
        if count <= 0:
            return x
        rows = x or (None,) * len(window.args)
        tails = (view.streams[a].tail for a in window.args)
        return tuple(self._rows.filled(a, tail, count) for a, tail in zip(rows, tails, strict=True))

    def _windowed(
        self, now: Arrival, view: Continuation, register: int, window: Window
    ) -> StreamValues:
        """Return the values of a bounded window: settled folds, then open elements."""
        fold, (first, end) = self._rows.fold(window), self._open(view, register)
        closed = self._closed(view, window)
        end = 0 if closed else end
        newest, count = self._layout.newest(register, window), end - first + 1
        limit = newest + count  # the offset of the last element of the last window
        limit = min(limit, 0) if closed else limit
        x, last = self._elements(now, view, window, newest + 1, limit)
        if last < min(limit, -1) and (window.lo is None or window.lo < 0):
            # The tail may start before time 0, where windows over the past read it.
            x = self._extended(view, window, x, min(limit, -1) - last)
            last = min(limit, -1)
            x = x and self._since_zero(now, window, newest + 1, x)
        ahead, width = last - newest, window.length
        tails = tuple(view.streams[a].tail for a in window.args)
        number = tails[0] if len(tails) == 1 and isinstance(tails[0], float) else 0.0
        skipped, decides = number == fold.identity[-1], number == -fold.identity[-1]
        if last < limit:
            # Whether every window after the last element reaches the tail.
            reaches_tail = not closed or (window.lo or 0) <= 0
            if decides and reaches_tail:
                count = min(count, ahead)
            elif not skipped:
                x, ahead = self._extended(view, window, x, limit - last), limit - newest
            elif width and reaches_tail:
                count = min(count, ahead + width - 1)
        settled = now.folds[register]
        if self._depends[register]:
            settled = tuple(self._rows.at_unknowns(rows, view.unknowns) for rows in settled)
        rows = self._fold_windows(fold, settled, x, ahead, count, width)
        if width is None and not decides:
            total = tuple(a[-1] for a in rows or settled)
            tail = fold.combine(total, tuple(map(self._rows.array, tails)))[-1]
        else:
            tail = self._equal_fold(fold, tails)
        return StreamValues(rows and rows[-1], first - 1 + count, tail)

    def _fold_windows(
        self,
        fold: Fold,
        settled: Elements,
        x: Elements | None,
        ahead: int,
        count: int,
        width: int | None,
    ) -> Elements | None:
        """Return the folds of windows that end at the first, second, ... element ahead."""
        if count <= 0:
            return None
        parts: list[Elements] = []
        old = count if width is None else min(count, width - 1)  # windows that start before
        if old:
            part = settled if width is None else tuple(a[1 : old + 1] for a in settled)
            if x is not None:
                newer = prefixes(self._o, fold, tuple(a[:old] for a in self._rows.same_width(x)))
                newer = tuple(self._rows.filled(a, a[-1], old - ahead) for a in newer)
                part = fold.combine(part, newer)
            parts.append(tuple(self._rows.repeated(a, old) for a in part))
        new = count - old
        if new and width is not None:
            if x is not None and ahead <= width:
                folds = suffixes(self._o, fold, self._rows.same_width(x))
                parts.append(tuple(a[:new] for a in folds))
                new -= ahead
            elif x is not None:
                identities = self._rows.identities_of(fold, new + width - 1 - ahead)
                padded = x if identities is None else tuple(map(self._rows.after, x, identities))
                parts.append(slide(fold, tuple(a[: new + width - 1] for a in padded), width))
                new = 0
            if (identities := self._rows.identities_of(fold, new)) is not None:
                parts.append(identities)
        joined = parts[0]
        for part in parts[1:]:
            joined = tuple(map(self._rows.after, joined, part))
        return joined

    def _future(
        self, now: Arrival, view: Continuation, register: int, window: Window
    ) -> StreamValues:
        """Return the values of an unbounded window; its unknown is the fold of its open part."""
        fold, (first, end) = self._rows.fold(window), self._open(view, register)
        closed = self._closed(view, window)
        end = 0 if closed else end
        x, last = self._elements(now, view, window, first, end)
        x = self._extended(view, window, x, end - last)
        tails = tuple(view.streams[a].tail for a in window.args)
        later = tuple(self._rows.array(t)[None] for t in (fold.identity if closed else tails))
        joined = later if x is None else tuple(map(self._rows.after, x, later))
        rows = suffixes(self._o, fold, self._rows.same_width(joined))
        view.unknowns[self._axes[register]] = rows[-1][0]
        values = None if x is None else rows[-1][:-1]
        return StreamValues(values, end, self._equal_fold(fold, tails))

    def _replace_after_now(
        self, now: Arrival, view: Continuation, window: Window, stream: StreamValues
    ) -> StreamValues:
        """Replace the windows after now by their own elements if later samples may be missing."""
        if view.name == "now" or not self._closed(view, window):
            return stream
        if window.lo:
            return stream._replace(tail=self._rows.fold(window).identity[-1])
        operand = window.args[-1]
        rows, last = self._read(now, view, operand, 1, view.streams[operand].last)
        if rows is None:
            return stream._replace(tail=view.streams[operand].tail)
        if stream.values is not None:
            rows = self._rows.after(stream.values, rows)
        return StreamValues(rows, last, view.streams[operand].tail)

    def _merge_cut(
        self, register: int, window: Window, stream: StreamValues, opened: StreamValues
    ) -> StreamValues:
        """Return the values of a cut trace, and open values for windows that were not recorded."""
        first = 1 - self._shapes[register].late
        # Windows after this offset were not recorded.
        last = max(first - 1, -window.begin if window.endless else 0)
        count = last - first + 1
        rows = stream.values[:count] if count and stream.last >= first else None
        rows = self._rows.filled(rows, stream.tail, last - max(stream.last, first - 1))
        if opened.last <= last:
            return StreamValues(rows, last, opened.tail)
        remainder = opened.values[count:]
        rows = remainder if rows is None else self._rows.after(rows, remainder)
        return StreamValues(rows, opened.last, opened.tail)

    def _equal_fold(self, fold: Fold, tails: tuple[Tensor | float, ...]) -> Tensor | float:
        """Return the fold of equal elements."""
        if len(tails) == 1:
            return tails[0]
        arrays = tuple(map(self._rows.array, tails))
        return fold.combine(arrays, arrays)[-1]

    def _at_zero(self, now: Arrival, view: Continuation, register: int, window: Window) -> Tensor:
        """Return the value of a window at time 0."""
        value = self._folded(now, view, register, window)
        if view.opened is None or not window.endless:
            return value
        opened = self._folded(now, view.opened, register, window)
        return self._o.where(now.age < window.begin, opened, value)

    def _folded(self, now: Arrival, view: Continuation, register: int, window: Window) -> Tensor:
        """Return the fold of a window at time 0 over its settled, open and later elements."""
        o, fold = self._o, self._rows.fold(window)
        total = now.initial[register]
        if any(self._depends[a] for a in window.args):
            total = tuple(self._rows.at_unknowns(rows, view.unknowns) for rows in total)
        begin = 1 - max(self._shapes[a].late for a in window.args)
        closed = self._closed(view, window)
        end = 0 if closed else max(self._shapes[a].past for a in window.args)
        x, last = self._elements(now, view, window, begin, end)
        if x is not None:
            x = fold.masked(o, self._rows.inside(now.age, window, begin, last), x)
            total = fold.combine(total, tuple(a[None] for a in fold_all(o, fold, x)))
        hi = window.hi
        if (last < 0 or not closed) and (hi is None or hi >= 0):
            tail = tuple(self._rows.array(view.streams[a].tail)[None] for a in window.args)
            if hi is not None:
                tail = fold.masked(o, now.age < hi - last, tail)
            if closed:
                tail = fold.masked(o, now.age >= max(0, window.lo or 0), tail)
            total = fold.combine(total, tail)
        return total[-1][0][0]
