"""The online machine on arrays: one step is a pure function of fixed shapes.

A window is a ladder of doublings: a rung is the fold of the last 2^i elements, made of the rung
below and what that was 2^i samples ago; the last one overlaps, which folds of a lattice allow. So a
window of k samples is log2(k) delays, which add up to k - 1 numbers. All delays of a program lie in
one table of cells and lanes: a step reads all of them at once and writes all of them at once, and
the compiler keeps the table in place.

All lanes have one clock. A lane that is reset has age 0: what is older than its age reads as the
identity of the fold, so that a reset costs nothing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple, SupportsIndex, assert_never

from rtamt.program.instructions import Map, Window
from rtamt.program.program import Delay, Program, schedule
from rtamt_arrays.functions import FUNCTIONS, Elements, Fold, exact
from rtamt_arrays.inputs import (
    ArrayReader,
    ArraySample,
    StateField,
    checked_lanes,
    checked_mask,
    checked_state,
    columns,
    dtype_name,
    terms,
    zeros,
)
from rtamt_arrays.operations import Operations, Tensor


class OnlineState(NamedTuple):
    """What an online monitor knows of its lanes.

    Attributes:
        ring: The cells of all delays, of shape (cells, lanes).
        place: The cell of each delay that is read and written next.
        totals: The folds since the begin, a row for each number.
        age: Samples of each lane since its reset, up to those that matter.
        nan: Whether a lane has had a nan since its reset.
    """

    ring: Tensor
    place: Tensor
    totals: Tensor
    age: Tensor
    nan: Tensor


class OnlineReading(NamedTuple):
    """What an online monitor says after a sample, an array with a value for each lane.

    Attributes:
        robustness: The robustness of the time that is the latency ago; nan before there is one,
            and from a nan on until the lane is reset.
        nan: Whether a variable or a term has been nan since the lane's reset.
    """

    robustness: Tensor
    nan: Tensor


class OnlineMonitor:
    """`rtamt.VectorMonitor` as pure functions of arrays; made by ``online``.

    Attributes:
        program: The compiled program.
        variables: Names of the variables, in the order of the last axis of a sample.
        latency: Samples by which the robustness is late.
    """

    def __init__(self, program: Program, operations: Operations, reader: ArrayReader) -> None:
        self.program = program
        self.variables = program.variables
        self.latency = program.latency or 0
        self._o = operations
        self._reader = reader
        self._lattice = exact(operations)
        self._schedule = tuple(schedule(program))
        self._lengths: list[int] = []  # of the delays
        self._identities: list[float] = []  # what stands for times before a lane's reset
        self._totals: list[float] = []
        self._rungs: dict[int, list[tuple[int, int]]] = {}  # by slot: delay, length
        for slot, scheduled in self._schedule:
            if isinstance(scheduled, Delay):
                self._rungs[slot] = [(self._delayed(scheduled.length, (0.0,)), scheduled.length)]
            elif isinstance(scheduled, Window):
                self._rungs[slot] = self._ladder(scheduled)
        o, dtype = operations, reader.dtype
        ends = list(itertools.accumulate(self._lengths))
        self._table = _Table(
            o.constant([0, *ends[:-1]] if ends else [], o.row),
            o.constant(ends, o.row),
            o.constant(self._lengths, o.count)[:, None],
            o.constant(self._identities, dtype)[:, None],
            o.constant(self._totals, dtype)[:, None],
        )
        self._fields = {
            "ring": StateField((sum(self._lengths),), dtype),
            "place": StateField((len(self._lengths),), o.row, lanes=False),
            "totals": StateField((len(self._totals),), dtype),
            "age": StateField((), o.count),
            "nan": StateField((), o.truth),
        }
        starts = [program.start(s) for s, each in self._schedule if isinstance(each, Window)]
        self._oldest = 1 + max(self.latency, *self._lengths, *starts, 0)

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__} of {self.program.specification.formula}, latency "
            f"{self.latency}, {dtype_name(self._reader.dtype)}>"
        )

    def _delayed(self, length: int, identity: Sequence[float]) -> int:
        self._lengths += [length] * len(identity)
        self._identities += identity
        return len(self._lengths) - len(identity)

    def _ladder(self, window: Window) -> list[tuple[int, int]]:
        identity = Fold.named(window.fold, self._lattice).identity
        if window.length is None:
            self._totals += identity
            return [(len(self._totals) - len(identity), 0)]
        size, lengths = 1, []
        while 2 * size <= window.length:
            lengths.append(size)
            size *= 2
        if size < window.length:
            lengths.append(window.length - size)
        return [(self._delayed(length, identity), length) for length in lengths]

    def init(self, lanes: SupportsIndex) -> OnlineState:
        """The state before the first sample.

        Args:
            lanes: How many signals run side by side, 1 or more.

        Raises:
            InputError: On fewer lanes than 1.
            InputTypeError: On a number of lanes that is not a whole number.
        """
        made = zeros(self._o, self._fields, checked_lanes(self._reader, lanes))
        place = self._o.concatenate(
            [self._table.begins]
        )  # one of its own, which may be overwritten
        return OnlineState(**made | {"place": place})

    def reset(self, state: OnlineState, mask: Tensor | None = None) -> OnlineState:
        """The state in which the lanes of the mask have forgotten every sample.

        Args:
            state: What `init`, `update` or `reset` of this monitor gave.
            mask: A boolean for each lane; None: all lanes.

        Raises:
            InputError: On a state of other shapes, or a mask of another shape.
            InputTypeError: On what is no state of this kind of numbers, or a mask that is not of
                booleans.
        """
        self._check(state)
        keep = ~checked_mask(self._reader, mask, state.age)
        return state._replace(age=state.age * self._o.as_integers(keep), nan=state.nan & keep)

    def update(self, state: OnlineState, sample: ArraySample) -> tuple[OnlineState, OnlineReading]:
        """Take in a sample in every lane.

        Args:
            state: What `init`, `update` or `reset` of this monitor gave.
            sample: An array of shape (lanes,) for each variable by name, others are ignored; or one
                of shape (lanes, variables).

        Returns:
            The next state, and the reading of each lane.

        Raises:
            InputError: On a state of other shapes, a missing variable or a wrong shape.
            InputTypeError: On what is no state of this kind of numbers, or no arrays of real
                numbers.
        """
        self._check(state)
        o, age = self._o, state.age
        lanes = tuple(age.shape)
        values = columns(self.program, self._reader, sample, lanes)
        known, wrong = terms(self.program, o, self._reader.dtype, values)
        slots: dict[int, Tensor] = dict(enumerate(known))
        step = _Step(o, state, self._table)
        for slot, scheduled in self._schedule:
            match scheduled:
                case Map(function, args):
                    slots[slot] = FUNCTIONS[function](o, *(slots[a] for a in args))
                case Delay(_, operand):
                    ((delay, _),) = self._rungs[slot]
                    (slots[slot],) = step.delayed(delay, (slots[operand],))
                case Window(name, _, _, args):
                    fold, x = Fold.named(name, self._lattice), tuple(slots[a] for a in args)
                    start = self.program.start(slot)
                    x = fold.masked(o, age >= start, x)
                    for place, length in self._rungs[slot]:
                        if length:
                            x = fold.combine(step.delayed(place, x), x)
                        else:
                            x = step.total(place, fold, x)
                    slots[slot] = x[-1]
                case _ as never:
                    assert_never(never)
        nan = state.nan if wrong is None else state.nan | wrong
        robustness = o.where((age >= self.latency) & ~nan, slots[self.program.result], math.nan)
        following = step.following(nan, o.least(age + 1, self._oldest))
        return following, OnlineReading(robustness, nan)

    def begin(
        self, state: OnlineState, sample: ArraySample, mask: Tensor | None = None
    ) -> tuple[OnlineState, OnlineReading]:
        """Begin lanes anew with a sample, while the others take none.

        Lanes share a clock: the sample counts as taken with the newest one of the others.

        Args:
            state: As for `update`.
            sample: As for `update`; what it has of other lanes is ignored.
            mask: A boolean for each lane; None: all lanes.

        Returns:
            The next state, and the reading, which says nothing of the other lanes.

        Raises:
            InputError: As `update` and `reset` do.
            InputTypeError: As `update` and `reset` do.
        """
        self._check(state)
        o, place, table = self._o, state.place, self._table
        before = state._replace(place=o.where(place == table.begins, table.ends, place) - 1)
        mask = checked_mask(self._reader, mask, state.age)
        begun, reading = self.update(self.reset(before, mask), sample)
        parts = {
            name: place if name == "place" else o.where(mask, new, getattr(state, name))
            for name, new in begun._asdict().items()
        }
        return OnlineState(**parts), reading

    def _check(self, state: OnlineState) -> None:
        checked_state(self._reader, state, OnlineState, self._fields)


class _Table(NamedTuple):
    """Where the delays lie in the ring, and what stands for times before a lane's reset.

    Attributes:
        begins: The first cell of each delay.
        ends: The cell behind the last one of each delay.
        lengths: Samples by which each delay is late, as a column.
        identities: What a delay gives of times before the reset, as a column.
        totals: The folds of no samples, as a column.
    """

    begins: Tensor
    ends: Tensor
    lengths: Tensor
    identities: Tensor
    totals: Tensor


class _Step:
    """Reads and writes of one step, which are gathered until its end."""

    def __init__(self, o: Operations, state: OnlineState, table: _Table) -> None:
        self._o, self._state, self._table = o, state, table
        self._lanes = tuple(state.age.shape)
        self._written: list[Tensor] = [None] * len(table.lengths)
        self._totals: list[Tensor] = [None] * len(table.totals)
        if self._written:
            there = state.age >= table.lengths
            late = o.gather(state.ring, state.place)
            self._late = o.where(there, late, table.identities)
        if self._totals:
            self._sums = o.where(state.age > 0, state.totals, table.totals)

    def delayed(self, delay: int, x: Elements) -> Elements:
        """Give numbers to a delay, and what it was given as many samples ago as it is long."""
        for i, number in enumerate(x):
            self._written[delay + i] = self._o.broadcast(number, self._lanes)
        return tuple(self._late[delay + i] for i in range(len(x)))

    def total(self, place: int, fold: Fold, x: Elements) -> Elements:
        """Fold an element into the total since the begin."""
        before = tuple(self._sums[place + i] for i in range(len(x)))
        total = fold.combine(before, x)
        for i, number in enumerate(total):
            self._totals[place + i] = self._o.broadcast(number, self._lanes)
        return total

    def following(self, nan: Tensor, age: Tensor) -> OnlineState:
        """The state after the step."""
        o, state, table = self._o, self._state, self._table
        ring, place, totals = state.ring, state.place, state.totals
        if self._written:
            ring = o.scatter(ring, place, o.stack(self._written))
            place = place + 1
            place = o.where(place == table.ends, table.begins, place)
        if self._totals:
            totals = o.stack(self._totals)
        return OnlineState(ring, place, totals, age, nan)
