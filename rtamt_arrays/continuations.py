"""The value of an episode at time 0 in each continuation, from settled and open values.

A continuation is "now" (the episode ends), "lower" or "upper" (it goes on with the lowest or the
highest possible values). `rtamt_arrays.episode` describes the algorithm.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

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
from rtamt_arrays.layout import Arrival, Layout, StreamValues, WorldName, Worldview
from rtamt_arrays.operations import Operations, Tensor


class EpisodeRows:
    """Operations on rows of values: arrays with the axes time, corner and entry of the batch."""

    def __init__(self, operations: Operations, dtype: object) -> None:
        self._o = operations
        self._dtype = dtype
        self._lattice = exact(operations)

    def after(self, x: Tensor, y: Tensor) -> Tensor:
        """Return one array after the other, both as wide as the wider one."""
        wide = [max(pair) for pair in zip(x.shape[1:], y.shape[1:], strict=True)]
        parts = [self._o.broadcast(part, (part.shape[0], *wide)) for part in (x, y)]
        return self._o.concatenate(parts)

    def filled(self, rows: Tensor, tail: Tensor | float, count: int) -> Tensor:
        """Return rows with a tail repeated ``count`` times after them."""
        if count <= 0:
            return rows
        tail = self.array(tail)
        later = self._o.broadcast(tail, (count, *tail.shape))
        return later if rows is None else self.after(rows, later)

    def array(self, value: Tensor | float) -> Tensor:
        """Return a value as an array with axes of corners and entries."""
        return self._o.full((1, 1), value, self._dtype) if isinstance(value, float) else value

    def even(self, x: Elements) -> Elements:
        """Return elements whose numbers are all as wide as the widest."""
        wide = [max(sizes) for sizes in zip(*(a.shape[1:] for a in x), strict=True)]
        return tuple(self._o.broadcast(a, (a.shape[0], *wide)) for a in x)

    def repeated(self, rows: Tensor, count: int) -> Tensor:
        """Repeat a single row ``count`` times."""
        return self._o.broadcast(rows, (count, *rows.shape[1:]))

    def identities_of(self, fold: Fold, count: int) -> Elements | None:
        """Return ``count`` identity elements; None if there are none."""
        if count <= 0:
            return None
        return tuple(self._o.full((count, 1, 1), e, self._dtype) for e in fold.identity)

    def inside(self, age: Tensor, window: Window, begin: int, end: int) -> Tensor:
        """Return whether the times at offsets are in the window of time 0."""
        offsets = self._o.arange(begin, end + 1)[:, None, None]
        times = age + offsets
        inside = times >= max(0, window.lo or 0)
        return inside if window.hi is None else inside & (times <= window.hi)

    def in_world(self, rows: Tensor, unknowns: Sequence[Tensor]) -> Tensor:
        """Return polynomials in the unknowns, evaluated at values of the unknowns."""
        count, corners, entries = rows.shape
        if corners == 1:  # the same at every corner
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


class EpisodeOutlook:
    """Computes the value of a program at time 0 in a continuation."""

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

    def view(self, now: Arrival, world: WorldName, opened: Worldview | None = None) -> Worldview:
        """Return the streams of a continuation; ``opened`` is the same one of the uncut trace."""
        unknown = self._o.full((1, 1), 0.0, self._dtype)
        view = Worldview(world, {}, [unknown] * len(self._axes), opened)
        for r in self._placement.streams:
            instruction = self.program.instructions[r]
            if isinstance(instruction, Const):
                stream = StreamValues(None, -self._layout.oldest, instruction.value)
            elif r < self.program.terms:
                stream = StreamValues(None, 0, INF if world == "upper" else -INF)
            elif isinstance(instruction, Map):
                stream = self._pointwise(now, view, r, instruction)
            else:
                window = self._layout.windows[r]
                compute = self._future if window.hi is None else self._windowed
                stream = compute(now, view, r, window)
                if opened is None:
                    stream = self._own_elements(now, view, window, stream)
                elif window.endless or window.hi is None:
                    stream = self._recorded(r, window, stream, opened.streams[r])
            view.streams[r] = stream
        return view

    def value(self, now: Arrival, view: Worldview) -> Tensor:
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
        self, now: Arrival, view: Worldview, register: int, begin: int, end: int
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
                self._rows.in_world(rows, view.unknowns) if self._depends[register] else rows
            )
        first = 1 - shape.late
        if last >= first:
            parts.append(stream.values[max(begin, first) - first : last - first + 1])
        return (parts[0] if len(parts) == 1 else self._rows.after(*parts)), last

    def _pointwise(
        self, now: Arrival, view: Worldview, register: int, instruction: Map
    ) -> StreamValues:
        begin, end = self._open(view, register)
        operands = []
        for a in instruction.args:
            rows, last = self._read(now, view, a, begin, end)
            operands.append((last, rows, view.streams[a].tail))
        name = instruction.function
        tail = self._of_tails(name, [operand[2] for operand in operands])
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

    def _of_tails(self, name: str, tails: Sequence[Tensor | float]) -> Tensor | float:
        """Apply a function to tails."""
        if all(isinstance(tail, float) for tail in tails):
            return algebra.FUNCTIONS[name].apply(*tails)
        return FUNCTIONS[name](self._o, *map(self._rows.array, tails))

    def _open(self, view: Worldview, register: int) -> tuple[int, int]:
        """Return the first and the last offset at which a stream has not settled."""
        shape = self._shapes[register]
        return 1 - shape.late, 0 if view.world == "now" else shape.past

    def _closed(self, view: Worldview, window: Window) -> bool:
        """Return whether samples that do not exist count as identities."""
        if view.opened is not None:
            return window.hi is None
        return view.world == "now" or window.skips(best=view.world == "upper")

    def _elements(
        self, now: Arrival, view: Worldview, window: Window, begin: int, end: int
    ) -> tuple[Elements | None, int]:
        """Return the elements at offsets before the tail, and the last of these offsets."""
        read = [self._read(now, view, a, begin, end) for a in window.args]
        last = max(end for _, end in read)
        if last < begin:
            return None, last
        x = tuple(
            self._rows.filled(rows, view.streams[a].tail, last - here)
            for a, (rows, here) in zip(window.args, read, strict=True)
        )
        return self._since_zero(now, window, begin, x), last

    def _since_zero(self, now: Arrival, window: Window, begin: int, x: Elements) -> Elements:
        """Return elements from an offset on; identities before time 0."""
        if begin >= 0:
            return x
        offsets = self._o.arange(begin, begin + x[0].shape[0])
        return self._rows.fold(window).masked(self._o, now.age >= -offsets[:, None, None], x)

    def _extended(
        self, view: Worldview, window: Window, x: Elements | None, count: int
    ) -> Elements | None:
        """Return elements with ``count`` elements of the tail after them."""
        if count <= 0:
            return x
        rows = x or (None,) * len(window.args)
        tails = (view.streams[a].tail for a in window.args)
        return tuple(self._rows.filled(a, tail, count) for a, tail in zip(rows, tails, strict=True))

    def _windowed(
        self, now: Arrival, view: Worldview, register: int, window: Window
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
            # The tail may start before time 0, where windows of the past read it.
            x = self._extended(view, window, x, min(limit, -1) - last)
            last = min(limit, -1)
            x = x and self._since_zero(now, window, newest + 1, x)
        ahead, width = last - newest, window.length
        tails = tuple(view.streams[a].tail for a in window.args)
        number = tails[0] if len(tails) == 1 and isinstance(tails[0], float) else 0.0
        skipped, decides = number == fold.identity[-1], number == -fold.identity[-1]
        if last < limit:
            # Whether every window after the last element reaches the tail.
            reached = not closed or (window.lo or 0) <= 0
            if decides and reached:
                count = min(count, ahead)
            elif not skipped:
                x, ahead = self._extended(view, window, x, limit - last), limit - newest
            elif width and reached:
                count = min(count, ahead + width - 1)
        kept = now.folds[register]
        if self._depends[register]:
            kept = tuple(self._rows.in_world(rows, view.unknowns) for rows in kept)
        rows = self._over(fold, kept, x, ahead, count, width)
        if width is None and not decides:
            total = tuple(a[-1] for a in rows or kept)
            tail = fold.combine(total, tuple(map(self._rows.array, tails)))[-1]
        else:
            tail = self._together(fold, tails)
        return StreamValues(rows and rows[-1], first - 1 + count, tail)

    def _over(
        self,
        fold: Fold,
        kept: Elements,
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
            part = kept if width is None else tuple(a[1 : old + 1] for a in kept)
            if x is not None:
                begun = prefixes(self._o, fold, tuple(a[:old] for a in self._rows.even(x)))
                begun = tuple(self._rows.filled(a, a[-1], old - ahead) for a in begun)
                part = fold.combine(part, begun)
            parts.append(tuple(self._rows.repeated(a, old) for a in part))
        new = count - old
        if new and width is not None:
            if x is not None and ahead <= width:
                parts.append(tuple(a[:new] for a in suffixes(self._o, fold, self._rows.even(x))))
                new -= ahead
            elif x is not None:
                nothing = self._rows.identities_of(fold, new + width - 1 - ahead)
                padded = x if nothing is None else tuple(map(self._rows.after, x, nothing))
                parts.append(slide(fold, tuple(a[: new + width - 1] for a in padded), width))
                new = 0
            if (nothing := self._rows.identities_of(fold, new)) is not None:
                parts.append(nothing)
        joined = parts[0]
        for part in parts[1:]:
            joined = tuple(map(self._rows.after, joined, part))
        return joined

    def _future(self, now: Arrival, view: Worldview, register: int, window: Window) -> StreamValues:
        """Return the values of an unbounded window; the fold of its open part is its unknown."""
        fold, (first, end) = self._rows.fold(window), self._open(view, register)
        closed = self._closed(view, window)
        end = 0 if closed else end
        x, last = self._elements(now, view, window, first, end)
        x = self._extended(view, window, x, end - last)
        tails = tuple(view.streams[a].tail for a in window.args)
        later = tuple(self._rows.array(t)[None] for t in (fold.identity if closed else tails))
        joined = later if x is None else tuple(map(self._rows.after, x, later))
        rows = suffixes(self._o, fold, self._rows.even(joined))
        view.unknowns[self._axes[register]] = rows[-1][0]
        values = None if x is None else rows[-1][:-1]
        return StreamValues(values, end, self._together(fold, tails))

    def _own_elements(
        self, now: Arrival, view: Worldview, window: Window, stream: StreamValues
    ) -> StreamValues:
        """Reduce windows after now to their own element, where later samples may not exist."""
        if view.world == "now" or not self._closed(view, window):
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

    def _recorded(
        self, register: int, window: Window, stream: StreamValues, opened: StreamValues
    ) -> StreamValues:
        """Return the values of a cut trace, and open values where nothing was recorded."""
        first = 1 - self._shapes[register].late
        # After it, the window of the operator was not recorded.
        last = max(first - 1, -window.begin if window.endless else 0)
        count = last - first + 1
        rows = stream.values[:count] if count and stream.last >= first else None
        rows = self._rows.filled(rows, stream.tail, last - max(stream.last, first - 1))
        if opened.last <= last:
            return StreamValues(rows, last, opened.tail)
        remainder = opened.values[count:]
        rows = remainder if rows is None else self._rows.after(rows, remainder)
        return StreamValues(rows, opened.last, opened.tail)

    def _together(self, fold: Fold, tails: tuple[Tensor | float, ...]) -> Tensor | float:
        """Return the fold of equal elements."""
        if len(tails) == 1:
            return tails[0]
        arrays = tuple(map(self._rows.array, tails))
        return fold.combine(arrays, arrays)[-1]

    def _at_zero(self, now: Arrival, view: Worldview, register: int, window: Window) -> Tensor:
        """Return the value of a window at time 0."""
        value = self._folded(now, view, register, window)
        if view.opened is None or not window.endless:
            return value
        opened = self._folded(now, view.opened, register, window)
        return self._o.where(now.age < window.begin, opened, value)

    def _folded(self, now: Arrival, view: Worldview, register: int, window: Window) -> Tensor:
        """Fold a window at time 0: settled, open and later elements."""
        o, fold = self._o, self._rows.fold(window)
        total = now.initial[register]
        if any(self._depends[a] for a in window.args):
            total = tuple(self._rows.in_world(rows, view.unknowns) for rows in total)
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
