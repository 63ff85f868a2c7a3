"""The episode machine on arrays: robustness at time 0 and its bounds, in fixed shapes.

It finds what `rtamt.machines.episode.machine` describes; the words are explained there. What has
settled is kept, each number where it is read: the values of streams, as far back as others read
them, and for a window of a stream the folds from each of its settled elements on to the newest one.
A step folds one element into each of these. What has not settled is found anew in each world, at
offsets from now: the windows are the folds that are kept, each with the elements that are open. So
all shapes are fixed, and a step costs as many folds as a formula reaches samples ahead.

Where values no longer depend on samples, as the upper bounds of windows that are not over, a number
stands for all later ones. Folds begin anew where a lane was reset, and values of times before that
are read as the identity, so that a reset costs nothing.

An unknown stands for the fold of all samples still to come of a window without an end. What depends
on it is a polynomial in it, stored by its values at the corners, and each step writes it in terms
of the next unknown. Values have the axes time, corner, lane; the second has the length 2^k where
they depend on k unknowns, and 1 elsewhere and in the worlds.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

from rtamt.program import algebra
from rtamt.program.instructions import Const, Map, Window
from rtamt.program.placement import place
from rtamt.program.program import Program
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
from rtamt_arrays.layout import Cells, Layout
from rtamt_arrays.operations import Operations, Tensor
from rtamt_arrays.terms import (
    ArrayReader,
    ArraySample,
    checked_lanes,
    checked_state,
    columns,
    terms,
)
from rtamt_arrays.worlds import (
    Arrival,
    BoundsReading,
    EpisodeState,
    StreamValues,
    WorldName,
    Worldview,
)

__all__ = ["EpisodeArrays"]

INF = math.inf
_WORLDS: tuple[WorldName, ...] = ("now", "lower", "upper")
_DECIDES = {"min": -INF, "max": INF}
"""What decides a function, whatever the other operand is; its negative leaves the other."""


class _Kept(NamedTuple):
    """A state, its unknowns at this step, and the rows of the next one."""

    state: EpisodeState
    unknowns: list[Tensor]
    tables: dict[bool, list[Tensor]]


class EpisodeArrays:
    """`rtamt.VectorEpisodeMonitor` as pure functions of arrays; made by ``episode``.

    Attributes:
        program: The compiled program.
        variables: Names of the variables, in the order of the last axis of a sample.
    """

    def __init__(self, program: Program, operations: Operations, reader: ArrayReader) -> None:
        self.variables = program.variables
        self._placement = place(program)
        self.program = self._placement.program
        self._o = operations
        self._reader = reader
        self._lattice = exact(operations)
        self._axes = {register: axis for axis, register in enumerate(self._placement.unknowns)}
        self._corners = 1 << len(self._axes)
        corners = list(itertools.product((-INF, INF), repeat=len(self._axes)))
        self._ends = [  # each unknown at each corner
            operations.constant([corner[axis] for corner in corners], reader.dtype)[:, None]
            for axis in range(len(self._axes))
        ]
        self._layout = Layout(self._placement)
        self._shapes, self._depends = self._layout.shapes, self._layout.depends

    def _fold(self, window: Window) -> Fold:
        return Fold.named(window.fold, self._lattice)

    def init(self, lanes: int) -> EpisodeState:
        """The state before the first sample.

        Args:
            lanes: How many signals run side by side, 1 or more.

        Raises:
            InputError: On fewer lanes than 1.
            InputTypeError: On a number of lanes that is not an ``int``.
        """
        o, dtype, lanes = self._o, self._reader.dtype, checked_lanes(lanes)
        return EpisodeState(
            rows=o.full((self._layout.sizes[False], lanes), 0.0, dtype),
            kept=o.full((self._layout.sizes[True], self._corners, lanes), 0.0, dtype),
            first=o.full((len(self._layout.firsts), lanes), 0.0, dtype),
            age=o.full((lanes,), 0, o.count),
            nan=o.full((lanes,), 0.0, dtype) != 0.0,
        )

    def reset(self, state: EpisodeState, mask: Tensor | None = None) -> EpisodeState:
        """The state in which the lanes of the mask have forgotten every sample.

        Args:
            state: What `init`, `update` or `reset` of this monitor gave.
            mask: A boolean for each lane; None: all lanes.

        Raises:
            InputError: On a state of another monitor, or a mask of another shape.
            InputTypeError: On what is no state, or a mask that is not of booleans.
        """
        self._check(state)
        keep = ~self._reader.mask(mask, state.age)
        return state._replace(age=state.age * self._o.as_integers(keep), nan=state.nan & keep)

    def update(
        self, state: EpisodeState, sample: ArraySample
    ) -> tuple[EpisodeState, BoundsReading]:
        """Take in a sample in every lane.

        Args:
            state: What `init`, `update` or `reset` of this monitor gave.
            sample: An array of shape (lanes,) for each variable by name, others are ignored; or one
                of shape (lanes, variables).

        Returns:
            The next state, and the reading of each lane.

        Raises:
            InputError: On a state of another monitor, a missing variable or a wrong shape.
            InputTypeError: On what is no state, or no arrays of real numbers.
        """
        self._check(state)
        o, age = self._o, state.age
        lanes = tuple(age.shape)
        values = columns(self.program, self._reader, sample, lanes)
        known, wrong = terms(self.program, o, self._reader.dtype, values)
        now, following = self._settled(state, [o.broadcast(term, lanes) for term in known])
        robustness, lower, upper = (
            o.broadcast(self._value(now, world), lanes) for world in _WORLDS
        )
        nan = state.nan if wrong is None else state.nan | wrong
        lower, upper = o.where(nan, -INF, lower), o.where(nan, INF, upper)
        verdict = o.as_integers(~o.signbit(lower)) - o.as_integers(o.signbit(upper))
        reading = BoundsReading(o.where(nan, math.nan, robustness), lower, upper, verdict, nan)
        return following._replace(age=o.least(age + 1, self._layout.oldest), nan=nan), reading

    def _check(self, state: EpisodeState) -> None:
        checked_state(
            state,
            EpisodeState,
            {
                "rows": self._layout.sizes[False],
                "kept": self._layout.sizes[True],
                "first": len(self._layout.firsts),
            },
        )

    def _settled(self, state: EpisodeState, known: list[Tensor]) -> tuple[Arrival, EpisodeState]:
        """What has settled with this sample, and the state that keeps it."""
        o, dtype = self._o, self._reader.dtype
        begins = state.age == 0
        firsts = enumerate(self._layout.firsts)
        first = {r: o.where(begins, known[r], state.first[i]) for i, r in firsts}
        now = Arrival(state.age, {}, {}, {}, first)
        unknowns: list[Tensor] = [o.full((1, 1), 0.0, dtype)] * len(self._axes)
        kept = _Kept(state, unknowns, {False: [], True: []})
        for r in self._placement.streams:
            instruction = self.program.instructions[r]
            if isinstance(instruction, Const):
                value = o.full((1, 1, 1), instruction.value, dtype)
                now.settled[r] = self._repeated(value, self._shapes[r].back + 1)
                continue
            newest = known[r][None, None] if r < self.program.terms else self._newer(now, kept, r)
            if r in self._layout.histories:
                cells = self._layout.histories[r]
                newest = self._after(self._loaded(kept, cells), newest)
                self._store(kept, cells, newest[1:])
            now.settled[r] = newest
        for r, places in self._layout.initial.items():
            window = self._layout.windows[r]
            at = -max(self._shapes[a].late for a in window.args)
            x = self._settled_element(now, window, at)
            x = self._fold(window).masked(o, self._inside(now, window, at, at), x)
            old = tuple(self._loaded(kept, cells) for cells in places)
            now.initial[r] = self._fold(window).combine(old, x)
            for cells, rows in zip(places, now.initial[r], strict=True):
                self._store(kept, cells, rows)
        plain, dependent = kept.tables[False], kept.tables[True]
        return now, state._replace(
            rows=o.concatenate(plain) if plain else state.rows,
            kept=o.concatenate(dependent) if dependent else state.kept,
            first=o.stack(list(first.values())) if first else state.first,
        )

    def _newer(self, now: Arrival, kept: _Kept, register: int) -> Tensor:
        """The value of a stream that settles with this sample."""
        match self.program.formula(register):
            case Map(function, args):
                late = self._shapes[register].late
                places = [(a, self._shapes[a].back - late) for a in args]
                operands = (now.settled[a][place][None] for a, place in places)
                return FUNCTIONS[function](self._o, *operands)
            case Window() as window:
                x = self._settled_element(now, window, self._newest(register, window))
                if window.hi is None:
                    axis, fold = self._axes[register], self._fold(window)
                    later = tuple(map(self._array, fold.identity[:-1]))
                    newest = fold.combine(x, (*later, self._ends[axis]))[-1]
                    kept.unknowns[axis] = newest[0]
                    return newest
                return self._refolded(now, kept, register, window, x)

    def _refolded(
        self, now: Arrival, kept: _Kept, register: int, window: Window, x: Elements
    ) -> Tensor:
        """Fold an element into the folds of a window, the oldest of which has settled."""
        places, fold = self._layout.folds[register], self._fold(window)
        rows, old = x, tuple(self._loaded(kept, cells) for cells in places)
        if old[0].shape[0]:
            rows = fold.combine(old, x)
            rows = rows if window.lo is None else tuple(map(self._after, rows, x))
        now.folds[register] = rows
        for cells, a in zip(places, rows, strict=True):
            self._store(kept, cells, a if window.lo is None else a[1:])
        return rows[-1][:1]

    def _settled_element(self, now: Arrival, window: Window, at: int) -> Elements:
        """The element at an offset at which all of it has settled; the identity before time 0."""
        x = tuple(now.settled[a][at + self._shapes[a].back][None] for a in window.args)
        return self._fold(window).masked(self._o, now.age >= -at, x) if at else x

    def _loaded(self, kept: _Kept, cells: Cells) -> Tensor:
        """What is kept, in terms of the unknowns of this step."""
        table = kept.state.kept if cells.depends else kept.state.rows[:, None]
        rows = table[cells.begin : cells.end]
        if cells.identity is not None:
            nothing = self._o.full((), cells.identity, self._reader.dtype)
            rows = self._o.where(kept.state.age == 0, nothing, rows)
        return self._in_world(rows, kept.unknowns) if cells.depends else rows

    def _store(self, kept: _Kept, cells: Cells, rows: Tensor) -> None:
        """Keep rows; they are stored in the order of the layout."""
        if cells.end > cells.begin:
            lanes = tuple(kept.state.age.shape)
            rows, corners = (rows, (self._corners,)) if cells.depends else (rows[:, 0], ())
            shape = (cells.end - cells.begin, *corners, *lanes)
            kept.tables[cells.depends].append(self._o.broadcast(rows, shape))

    def _newest(self, register: int, window: Window) -> int:
        """The offset of the element that settles into the folds of a stream."""
        if window.hi is None:
            return -self._shapes[register].late
        return window.hi - self._shapes[register].late

    def _value(self, now: Arrival, world: WorldName) -> Tensor:
        """The value at time 0 in a world."""
        unknown = self._o.full((1, 1), 0.0, self._reader.dtype)
        view = Worldview(world, {}, [unknown] * len(self._axes))
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
                made = self._future if window.hi is None else self._windowed
                stream = made(now, view, r, window)
                stream = self._own_elements(now, view, window, stream)
            view.streams[r] = stream
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
        """The values at offsets that do not lie in the tail, and the last of these offsets."""
        shape, stream = self._shapes[register], view.streams[register]
        last = min(end, stream.last)
        if last < begin:
            return None, begin - 1
        parts = []
        if begin <= -shape.late:
            rows = now.settled[register][
                begin + shape.back : min(last, -shape.late) + shape.back + 1
            ]
            parts.append(self._in_world(rows, view.unknowns) if self._depends[register] else rows)
        first = 1 - shape.late
        if last >= first:
            parts.append(stream.values[max(begin, first) - first : last - first + 1])
        return (parts[0] if len(parts) == 1 else self._after(*parts)), last

    def _filled(self, rows: Tensor, tail: Tensor | float, count: int) -> Tensor:
        """Rows with so many of a tail after them."""
        if count <= 0:
            return rows
        tail = self._array(tail)
        later = self._o.broadcast(tail, (count, *tail.shape))
        return later if rows is None else self._after(rows, later)

    def _after(self, x: Tensor, y: Tensor) -> Tensor:
        """One array after the other, both as wide as the wider one."""
        wide = [max(pair) for pair in zip(x.shape[1:], y.shape[1:], strict=True)]
        parts = [self._o.broadcast(each, (each.shape[0], *wide)) for each in (x, y)]
        return self._o.concatenate(parts)

    def _pointwise(
        self, now: Arrival, view: Worldview, register: int, instruction: Map
    ) -> StreamValues:
        begin, end = self._open(view, register)
        operands = []
        for a in instruction.args:
            rows, last = self._read(now, view, a, begin, end)
            operands.append((last, rows, view.streams[a].tail))
        name = instruction.function
        tail = self._of_tails(name, [each[2] for each in operands])
        if name in _DECIDES:
            (last, x, short), (longest, y, _) = sorted(operands, key=lambda each: each[0])
            count = last - begin + 1
            choose = FUNCTIONS[name]
            common = None if x is None else choose(self._o, x, y[:count])
            number = short if isinstance(short, float) else 0.0
            if longest == last or number == _DECIDES[name]:
                return StreamValues(common, last, tail)
            rest = y[count:]
            if number != -_DECIDES[name]:
                rest = choose(self._o, self._array(short), rest)
            rows = rest if common is None else self._after(common, rest)
            return StreamValues(rows, longest, tail)
        filled = [self._filled(rows, t, end - last) for last, rows, t in operands]
        if end < begin:
            return StreamValues(None, end, tail)
        return StreamValues(FUNCTIONS[name](self._o, *filled), end, tail)

    def _of_tails(self, name: str, tails: Sequence[Tensor | float]) -> Tensor | float:
        """A function of what stands for later values."""
        if all(isinstance(each, float) for each in tails):
            return algebra.FUNCTIONS[name].apply(*tails)
        return FUNCTIONS[name](self._o, *map(self._array, tails))

    def _open(self, view: Worldview, register: int) -> tuple[int, int]:
        """The first and the last offset at which a stream has not settled in a world."""
        shape = self._shapes[register]
        return 1 - shape.late, 0 if view.world == "now" else shape.past

    def _closed(self, view: Worldview, window: Window) -> bool:
        """Whether samples that are not seen count nothing."""
        return view.world == "now" or window.skips(best=view.world == "upper")

    def _elements(
        self, now: Arrival, view: Worldview, window: Window, begin: int, end: int
    ) -> tuple[Elements | None, int]:
        """The elements at offsets that do not lie in the tail, and the last of these offsets."""
        read = [self._read(now, view, a, begin, end) for a in window.args]
        last = max(each[1] for each in read)
        if last < begin:
            return None, last
        x = tuple(
            self._filled(rows, view.streams[a].tail, last - here)
            for a, (rows, here) in zip(window.args, read, strict=True)
        )
        return self._since_zero(now, window, begin, x), last

    def _since_zero(self, now: Arrival, window: Window, begin: int, x: Elements) -> Elements:
        """Elements from an offset on; identities before time 0."""
        if begin >= 0:
            return x
        offsets = self._o.arange(begin, begin + x[0].shape[0])
        return self._fold(window).masked(self._o, now.age >= -offsets[:, None, None], x)

    def _extended(
        self, view: Worldview, window: Window, x: Elements | None, count: int
    ) -> Elements | None:
        """Elements with so many of the tail after them."""
        if count <= 0:
            return x
        rows = x or (None,) * len(window.args)
        tails = (view.streams[a].tail for a in window.args)
        return tuple(self._filled(a, tail, count) for a, tail in zip(rows, tails, strict=True))

    def _identities_of(self, fold: Fold, count: int) -> Elements | None:
        if count <= 0:
            return None
        return tuple(self._o.full((count, 1, 1), e, self._reader.dtype) for e in fold.identity)

    def _array(self, value: Tensor | float) -> Tensor:
        """A value as an array with axes of corners and lanes."""
        return (
            self._o.full((1, 1), value, self._reader.dtype) if isinstance(value, float) else value
        )

    def _even(self, x: Elements) -> Elements:
        """Elements whose numbers are all as wide as the widest."""
        wide = [max(sizes) for sizes in zip(*(a.shape[1:] for a in x), strict=True)]
        return tuple(self._o.broadcast(a, (a.shape[0], *wide)) for a in x)

    def _repeated(self, rows: Tensor, count: int) -> Tensor:
        """A row as often as that, if it is one."""
        return self._o.broadcast(rows, (count, *rows.shape[1:]))

    def _windowed(
        self, now: Arrival, view: Worldview, register: int, window: Window
    ) -> StreamValues:
        """A window with an end: what is kept of it, and the elements that are open."""
        fold, (first, end) = self._fold(window), self._open(view, register)
        closed = self._closed(view, window)
        end = 0 if closed else end
        newest, count = self._newest(register, window), end - first + 1
        limit = newest + count  # the offset of the last element of the last window
        limit = min(limit, 0) if closed else limit
        x, last = self._elements(now, view, window, newest + 1, limit)
        if last < min(limit, -1) and (window.lo is None or window.lo < 0):
            # A tail may stand for times before time 0, which windows of the past reach.
            x = self._extended(view, window, x, min(limit, -1) - last)
            last = min(limit, -1)
            x = x and self._since_zero(now, window, newest + 1, x)
        ahead, width = last - newest, window.length
        tails = tuple(view.streams[a].tail for a in window.args)
        number = tails[0] if len(tails) == 1 and isinstance(tails[0], float) else 0.0
        skipped, decides = number == fold.identity[-1], number == -fold.identity[-1]
        if last < limit:
            # Whether every window behind the last element reaches the tail.
            reached = not closed or (window.lo or 0) <= 0
            if decides and reached:
                count = min(count, ahead)
            elif not skipped:
                x, ahead = self._extended(view, window, x, limit - last), limit - newest
            elif width and reached:
                count = min(count, ahead + width - 1)
        kept = now.folds[register]
        if self._depends[register]:
            kept = tuple(self._in_world(each, view.unknowns) for each in kept)
        rows = self._over(fold, kept, x, ahead, count, width)
        if width is None and not decides:
            total = tuple(a[-1] for a in rows or kept)
            tail = fold.combine(total, tuple(map(self._array, tails)))[-1]
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
        """The folds of windows that end at the first, second, ... element ahead; None of none."""
        if count <= 0:
            return None
        parts: list[Elements] = []
        old = count if width is None else min(count, width - 1)  # windows that began before
        if old:
            part = kept if width is None else tuple(a[1 : old + 1] for a in kept)
            if x is not None:
                begun = prefixes(self._o, fold, tuple(a[:old] for a in self._even(x)))
                begun = tuple(self._filled(a, a[-1], old - ahead) for a in begun)
                part = fold.combine(part, begun)
            parts.append(tuple(self._repeated(a, old) for a in part))
        new = count - old
        if new and width is not None:
            if x is not None and ahead <= width:
                parts.append(tuple(a[:new] for a in suffixes(self._o, fold, self._even(x))))
                new -= ahead
            elif x is not None:
                nothing = self._identities_of(fold, new + width - 1 - ahead)
                padded = x if nothing is None else tuple(map(self._after, x, nothing))
                parts.append(slide(fold, tuple(a[: new + width - 1] for a in padded), width))
                new = 0
            if (nothing := self._identities_of(fold, new)) is not None:
                parts.append(nothing)
        whole = parts[0]
        for part in parts[1:]:
            whole = tuple(map(self._after, whole, part))
        return whole

    def _future(self, now: Arrival, view: Worldview, register: int, window: Window) -> StreamValues:
        """A window without an end; the fold of what has not settled is its unknown."""
        fold, (first, end) = self._fold(window), self._open(view, register)
        closed = self._closed(view, window)
        end = 0 if closed else end
        x, last = self._elements(now, view, window, first, end)
        x = self._extended(view, window, x, end - last)
        tails = tuple(view.streams[a].tail for a in window.args)
        later = tuple(self._array(t)[None] for t in (fold.identity if closed else tails))
        whole = later if x is None else tuple(map(self._after, x, later))
        rows = suffixes(self._o, fold, self._even(whole))
        view.unknowns[self._axes[register]] = rows[-1][0]
        values = None if x is None else rows[-1][:-1]
        return StreamValues(values, end, self._together(fold, tails))

    def _own_elements(
        self, now: Arrival, view: Worldview, window: Window, stream: StreamValues
    ) -> StreamValues:
        """After now a window of what may not be there has its own element alone."""
        if view.world == "now" or not self._closed(view, window):
            return stream
        if window.lo:
            return stream._replace(tail=self._fold(window).identity[-1])
        operand = window.args[-1]
        rows, last = self._read(now, view, operand, 1, view.streams[operand].last)
        if rows is None:
            return stream._replace(tail=view.streams[operand].tail)
        if stream.values is not None:
            rows = self._after(stream.values, rows)
        return StreamValues(rows, last, view.streams[operand].tail)

    def _together(self, fold: Fold, tails: tuple[Tensor | float, ...]) -> Tensor | float:
        """The fold of elements that are all the same."""
        if len(tails) == 1:
            return tails[0]
        arrays = tuple(map(self._array, tails))
        return fold.combine(arrays, arrays)[-1]

    def _at_zero(self, now: Arrival, view: Worldview, register: int, window: Window) -> Tensor:
        """The fold of a window at time 0: settled, open and later elements."""
        o, fold = self._o, self._fold(window)
        total = now.initial[register]
        if any(self._depends[a] for a in window.args):
            total = tuple(self._in_world(each, view.unknowns) for each in total)
        begin = 1 - max(self._shapes[a].late for a in window.args)
        closed = self._closed(view, window)
        end = 0 if closed else max(self._shapes[a].past for a in window.args)
        x, last = self._elements(now, view, window, begin, end)
        if x is not None:
            x = fold.masked(o, self._inside(now, window, begin, last), x)
            total = fold.combine(total, tuple(a[None] for a in fold_all(o, fold, x)))
        hi = window.hi
        if (last < 0 or not closed) and (hi is None or hi >= 0):
            tail = tuple(self._array(view.streams[a].tail)[None] for a in window.args)
            if hi is not None:
                tail = fold.masked(o, now.age < hi - last, tail)
            if closed:
                tail = fold.masked(o, now.age >= max(0, window.lo or 0), tail)
            total = fold.combine(total, tail)
        return total[-1][0][0]

    def _inside(self, now: Arrival, window: Window, begin: int, end: int) -> Tensor:
        """Whether the times at offsets are in the window of time 0."""
        offsets = self._o.arange(begin, end + 1)[:, None, None]
        times = now.age + offsets
        inside = times >= max(0, window.lo or 0)
        return inside if window.hi is None else inside & (times <= window.hi)

    def _in_world(self, rows: Tensor, unknowns: Sequence[Tensor]) -> Tensor:
        """Polynomials in the unknowns for given values of these."""
        count, _, lanes = rows.shape
        values = rows.reshape((count, *(2,) * len(unknowns), 1, lanes))
        for u in unknowns:
            values = self._lattice.greater(values[:, 0], self._lattice.lesser(values[:, 1], u))
        return values
