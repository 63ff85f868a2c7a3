"""The episode machine on arrays: robustness at time 0 and its bounds, in fixed shapes.

It finds what `rtamt.machines.episode.machine` describes; the words are explained there. That one
keeps the settled values of every stream. Here the samples of the last times alone are kept, and
each step finds every stream anew, at the offsets from now that others read: the same numbers, with
no shape that depends on how many samples there were. Times before a lane's reset read as the
identity, so that a reset costs nothing. What is folded over all times so far is kept: the windows
that are read at time 0, and the totals of unbounded pasts. They are polynomials in the unknowns,
stored by their values at the corners.

Streams have the axes time, corner, lane. The first is an offset from now, the second has the length
1 in the worlds, and 2^k where a program of k unknowns settles.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from rtamt.errors import SpecificationError
from rtamt.program.instructions import Const, Map, Window
from rtamt.program.placement import place
from rtamt.program.program import Program
from rtamt_arrays.functions import FUNCTIONS, Elements, Fold, exact, fold_all, slide
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
    Offsets,
    StreamValues,
    WorldName,
    Worldview,
)

__all__ = ["EpisodeArrays"]

INF = math.inf
_WORLDS: tuple[WorldName, ...] = ("now", "lower", "upper")
_LONGEST = 2**30


def _reach(instruction: Map | Window) -> int:
    """How much further back than its own offsets an instruction reads its operands."""
    if isinstance(instruction, Map) or instruction.hi is None:
        return 0
    return 1 - instruction.hi if instruction.lo is None else max(0, -instruction.lo)


def _joined(o: Operations, arrays: Sequence[Tensor], otherwise: Tensor) -> Tensor:
    return o.concatenate(arrays) if arrays else otherwise


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
        self._shapes = self._offsets()
        streams = self._shapes.items()
        self._histories = {
            r: shape.back
            for r, shape in streams
            if r < self.program.terms and not self._is_constant(r)
        }
        self._identities: list[float] = []  # of what is kept
        self._totals: dict[int, int] = {}
        for register, window in self._windows():
            if register in self._placement.initial:
                self._totals[~register] = self._keep(window)
            if register in self._placement.streams and window.lo is None:
                self._totals[register] = self._keep(window)
        self._firsts = [r for r in self._placement.initial if r < self.program.terms]
        self._oldest = self._last_age()

    def _is_constant(self, register: int) -> bool:
        return isinstance(self.program.instructions[register], Const)

    def _windows(self) -> list[tuple[int, Window]]:
        instructions = enumerate(self.program.instructions)
        return [(r, each) for r, each in instructions if isinstance(each, Window)]

    def _keep(self, window: Window) -> int:
        identity = self._fold(window).identity
        self._identities += identity
        return len(self._identities) - len(identity)

    def _fold(self, window: Window) -> Fold:
        return Fold.named(window.fold, self._lattice)

    def _offsets(self) -> dict[int, Offsets]:
        late, past = dict[int, int](), dict[int, int]()
        for r in self._placement.streams:
            late[r] = past[r] = 0
            if r < self.program.terms:
                continue
            instruction = self.program.formula(r)
            late[r] = max(late[a] for a in instruction.args)
            past[r] = max(past[a] for a in instruction.args)
            if isinstance(instruction, Window) and instruction.hi is not None:
                late[r] = max(0, late[r] + instruction.hi)
                lo = instruction.hi if instruction.lo is None else instruction.lo
                past[r] = max(0, past[r] - lo)
        back = dict(late)
        for register in range(len(self.program.instructions) - 1, self.program.terms - 1, -1):
            instruction = self.program.formula(register)
            for a in instruction.args:
                if register in self._placement.initial and isinstance(instruction, Window):
                    back[a] = max(back[a], *(late[each] for each in instruction.args))
                if register in back:
                    back[a] = max(back[a], back[register] + _reach(instruction))
        return {r: Offsets(late[r], past[r], back[r]) for r in late}

    def _last_age(self) -> int:
        bounds = [b for _, w in self._windows() for b in (w.lo, w.hi) if b is not None]
        reach = max((sum(shape) for shape in self._shapes.values()), default=0)
        last = 2 + reach + max(map(abs, bounds), default=0)
        if last > _LONGEST:
            formula = self.program.specification.formula
            raise SpecificationError(
                f"{formula} reaches over {last} samples; arrays count up to {_LONGEST}"
            )
        return last

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
            history=o.full((sum(self._histories.values()), lanes), 0.0, dtype),
            kept=o.full((len(self._identities), self._corners, lanes), 0.0, dtype),
            first=o.full((len(self._firsts), lanes), 0.0, dtype),
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
        now = self._moment(state, [o.broadcast(term, lanes) for term in known])
        robustness, lower, upper = (o.broadcast(each, lanes) for each in self._results(now))
        nan = state.nan if wrong is None else state.nan | wrong
        lower, upper = o.where(nan, -INF, lower), o.where(nan, INF, upper)
        verdict = o.as_integers(~o.signbit(lower)) - o.as_integers(o.signbit(upper))
        reading = BoundsReading(o.where(nan, math.nan, robustness), lower, upper, verdict, nan)
        following = EpisodeState(
            history=_joined(o, [rows[1:] for rows in now.histories.values()], state.history),
            kept=o.stack(now.kept) if now.kept else state.kept,
            first=o.stack(list(now.first.values())) if now.first else state.first,
            age=o.least(age + 1, self._oldest),
            nan=nan,
        )
        return following, reading

    def _check(self, state: EpisodeState) -> None:
        checked_state(
            state,
            EpisodeState,
            {
                "history": sum(self._histories.values()),
                "kept": len(self._identities),
                "first": len(self._firsts),
            },
        )

    def _moment(self, state: EpisodeState, known: list[Tensor]) -> Arrival:
        o, dtype = self._o, self._reader.dtype
        begins = state.age == 0
        kept: list[Tensor] = []
        for i, identity in enumerate(self._identities):
            kept.append(o.where(begins, o.full((), identity, dtype), state.kept[i]))
        histories: dict[int, Tensor] = {}
        row = 0
        for r, length in self._histories.items():
            histories[r] = o.concatenate([state.history[row : row + length], known[r][None]])
            row += length
        first = {r: o.where(begins, known[r], state.first[i]) for i, r in enumerate(self._firsts)}
        return Arrival(state.age, known, histories, kept, first)

    def _results(self, now: Arrival) -> list[Tensor]:
        """The value at time 0 in each world; what is kept takes in what has settled."""
        if self._axes:
            self._fold_in(now, self._walk(now, "settled"))
        found = []
        for world in _WORLDS:
            view = self._walk(now, world)
            if view.settles:
                self._fold_in(now, view)
            values: dict[int, Tensor] = {}
            for register in self._placement.initial:
                values[register] = self._at_zero(now, view, register, values)
            found.append(values[self.program.result])
        return found

    def _at_zero(
        self, now: Arrival, view: Worldview, register: int, values: dict[int, Tensor]
    ) -> Tensor:
        if register < self.program.terms:
            return now.first[register]
        match self.program.formula(register):
            case Map(function, args):
                return FUNCTIONS[function](self._o, *(values[a] for a in args))
            case Window() as window:
                return self._initial(now, view, register, window)

    def _walk(self, now: Arrival, world: WorldName) -> Worldview:
        o, dtype = self._o, self._reader.dtype
        settles = world == "settled" or (world == "now" and not self._axes)
        unknowns = [o.full((1, 1), 0.0, dtype)] * len(self._axes)
        view = Worldview(world, settles, {}, unknowns)
        for register in self._placement.streams:
            begin, end = self._span(register, world)
            instruction = self.program.instructions[register]
            if isinstance(instruction, Const):
                constant = o.full((1, 1), instruction.value, dtype)
                values = o.broadcast(constant, (end - begin + 1, 1, 1))
                stream = StreamValues(values, -begin, constant)
            elif register < self.program.terms:
                tail = {"lower": -INF, "upper": INF}.get(world, 0.0)
                values = now.histories[register][:, None]
                stream = StreamValues(values, -begin, o.full((1, 1), tail, dtype))
            else:
                match self.program.formula(register):
                    case Window() as window:
                        stream = self._windowed(now, view, register, window)
                    case Map() as pointwise:
                        stream = self._pointwise(view, register, pointwise)
            view.streams[register] = stream
        return view

    def _span(self, register: int, world: WorldName) -> tuple[int, int]:
        """The first and the last offset at which a world has a stream."""
        shape = self._shapes[register]
        if world == "settled":
            return -shape.back, -shape.late
        return -shape.back, 0 if world == "now" else shape.past

    def _pointwise(self, view: Worldview, register: int, instruction: Map) -> StreamValues:
        begin, end = self._span(register, view.world)
        streams = [view.streams[a] for a in instruction.args]
        choose = FUNCTIONS[instruction.function]
        values = choose(self._o, *(each.read(self._o, begin, end) for each in streams))
        return StreamValues(values, -begin, choose(self._o, *(each.tail for each in streams)))

    def _windowed(
        self, now: Arrival, view: Worldview, register: int, window: Window
    ) -> StreamValues:
        begin, end = self._span(register, view.world)
        fold = self._fold(window)
        tail = tuple(view.streams[a].tail for a in window.args)
        if window.lo is None:
            values, last = self._past(now, view, register, window)
            return StreamValues(values, -begin, last)
        if window.hi is None:
            values = self._future(now, view, register, window)
        else:
            seen = self._closed(view, window)
            x = self._elements(now, view, window, begin + window.lo, end + window.hi, seen=seen)
            values = slide(fold, x, window.hi - window.lo + 1)[-1]
        last = fold.combine(tail, tail)[-1]
        if view.world in {"lower", "upper"} and self._closed(view, window):
            # After now each window has its own element alone.
            operand = view.streams[window.args[-1]]
            if window.lo:
                last = self._o.full((1, 1), fold.identity[-1], self._reader.dtype)
                operand = StreamValues(last[None], 0, last)
            else:
                last = operand.tail
            if end > 0:
                rest = operand.read(self._o, 1, end)
                rest = self._o.broadcast(rest, (end, *values.shape[1:]))
                values = self._o.concatenate([values[: 1 - begin], rest])
        return StreamValues(values, -begin, last)

    def _closed(self, view: Worldview, window: Window) -> bool:
        """Whether samples that are not seen count nothing."""
        if view.world in {"lower", "upper"}:
            return window.skips(best=view.world == "upper")
        return view.world == "now"

    def _elements(
        self, now: Arrival, view: Worldview, window: Window, begin: int, end: int, *, seen: bool
    ) -> Elements:
        """The elements at offsets; identities before time 0, and after now if they must be seen."""
        o, fold = self._o, self._fold(window)
        last = min(end, 0) if seen else end
        x: Elements = ()
        if begin <= last:
            x = tuple(view.streams[a].read(o, begin, last) for a in window.args)
            if begin < 0:
                offsets = o.arange(begin, last + 1)
                x = fold.masked(o, now.age >= -offsets[:, None, None], x)
        rest = end - max(begin - 1, last)
        if rest > 0:
            shape = x[0].shape[1:] if x else (1, 1)
            nothing = self._identities_of(fold, (rest, *shape))
            x = tuple(map(self._after, x, nothing)) if x else nothing
        return x

    def _identities_of(self, fold: Fold, shape: tuple[int, ...]) -> Elements:
        return tuple(self._o.full(shape, e, self._reader.dtype) for e in fold.identity)

    def _after(self, x: Tensor, y: Tensor) -> Tensor:
        """One array after the other, both as wide as the wider one."""
        wide = [max(pair) for pair in zip(x.shape[1:], y.shape[1:], strict=True)]
        parts = [self._o.broadcast(each, (each.shape[0], *wide)) for each in (x, y)]
        return self._o.concatenate(parts)

    def _past(
        self, now: Arrival, view: Worldview, register: int, window: Window
    ) -> tuple[Tensor, Tensor]:
        begin, end = self._span(register, view.world)
        fold, hi = self._fold(window), window.hi or 0
        if view.settles:
            oldest = begin + hi - 1
            newest = self._elements(now, view, window, oldest, oldest, seen=False)
            self._keep_also(now, view, self._totals[register], fold, newest)
        total = self._kept(now, view, self._totals[register], fold)
        seen = view.world == "now"
        x = self._elements(now, view, window, begin + hi, end + hi, seen=seen)
        count = end - begin + 1
        x = tuple(self._after(a[None], b) for a, b in zip(total, x, strict=True))
        before = self._identities_of(fold, (count, 1, 1))
        prefixes = slide(fold, tuple(map(self._after, before, x)), count + 1)
        tail = tuple(view.streams[a].tail for a in window.args)
        last = fold.combine(tuple(a[-1] for a in prefixes), tail)[-1]
        return prefixes[-1][1:], last

    def _future(self, now: Arrival, view: Worldview, register: int, window: Window) -> Tensor:
        begin, end = self._span(register, view.world)
        fold, axis, seen = self._fold(window), self._axes[register], self._closed(view, window)
        x = self._elements(now, view, window, begin, end, seen=seen)
        tail = self._identities_of(fold, (1, 1))
        if view.world == "settled":
            tail = (*tail[:-1], self._ends[axis])
        elif not seen:
            tail = tuple(view.streams[a].tail for a in window.args)
        count = end - begin + 1
        x = tuple(self._after(a, b[None]) for a, b in zip(x, tail, strict=True))
        after = self._identities_of(fold, (count, 1, 1))
        suffixes = slide(fold, tuple(map(self._after, x, after)), count + 1)[-1]
        late = self._shapes[register].late
        view.unknowns[axis] = suffixes[(-late if view.world == "settled" else 1 - late) - begin]
        return suffixes[:count]

    def _initial(self, now: Arrival, view: Worldview, register: int, window: Window) -> Tensor:
        """The fold of a window at time 0: settled, open and later elements."""
        o, fold = self._o, self._fold(window)
        total = self._kept(now, view, self._totals[~register], fold)
        late = max(self._shapes[a].late for a in window.args)
        past = max(self._shapes[a].past for a in window.args)
        recorded = self._closed(view, window)
        begin, end = 1 - late, 0 if recorded else past
        if begin <= end:
            x = self._elements(now, view, window, begin, end, seen=recorded)
            x = fold.masked(o, self._inside(now, window, begin, end), x)
            total = fold.combine(total, fold_all(fold, x))
        if not recorded:
            tail = tuple(view.streams[a].tail for a in window.args)
            if window.hi is not None:
                tail = fold.masked(o, now.age < window.hi - past, tail)
            total = fold.combine(total, tail)
        return total[-1][0]

    def _inside(self, now: Arrival, window: Window, begin: int, end: int) -> Tensor:
        """Whether the times at offsets are in the window of time 0."""
        offsets = self._o.arange(begin, end + 1)[:, None, None]
        times = now.age + offsets
        inside = times >= max(0, window.lo or 0)
        return inside if window.hi is None else inside & (times <= window.hi)

    def _fold_in(self, now: Arrival, view: Worldview) -> None:
        """Fold what has settled into the windows that are read at time 0."""
        for register, window in self._windows():
            if ~register in self._totals:
                at = -max(self._shapes[a].late for a in window.args)
                fold = self._fold(window)
                x = self._elements(now, view, window, at, at, seen=False)
                x = fold.masked(self._o, self._inside(now, window, at, at), x)
                self._keep_also(now, view, self._totals[~register], fold, x)

    def _keep_also(
        self, now: Arrival, view: Worldview, place: int, fold: Fold, x: Elements
    ) -> None:
        """Fold one element into what is kept, in terms of the unknowns of this step."""
        before = tuple(self._in_world(now.kept[place + i], view.unknowns) for i in range(len(x)))
        total = fold.combine(before, tuple(a[0] for a in x))
        shape = (self._corners, *now.age.shape)
        for i, number in enumerate(total):
            now.kept[place + i] = self._o.broadcast(number, shape)

    def _kept(self, now: Arrival, view: Worldview, place: int, fold: Fold) -> Elements:
        """What is kept, in a world."""
        kept = tuple(now.kept[place + i] for i in range(len(fold.identity)))
        if view.settles:
            return kept
        return tuple(self._in_world(each, view.unknowns) for each in kept)

    def _in_world(self, kept: Tensor, unknowns: Sequence[Tensor]) -> Tensor:
        """Polynomials in the unknowns for given values of these."""
        settled = kept.reshape((2,) * len(unknowns) + (1, *kept.shape[1:]))
        for u in unknowns:
            settled = self._lattice.greater(settled[0], self._lattice.lesser(settled[1], u))
        return settled
