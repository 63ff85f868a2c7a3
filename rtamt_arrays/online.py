"""The online machine on arrays: one step is a pure function with fixed shapes.

A window is a ladder of doublings. Rung i is the fold of the last 2^i elements, combined from the
rung below and its earlier value. The last rung overlaps, which does not change a minimum or a
maximum. A window of k samples needs log2(k) delays with k - 1 numbers in total. All delays of a
program are in one table of cells and entries. A step reads the table once and then writes it once,
so the compiler updates it in place.

All entries share a clock. A reset sets the age of an entry to 0: older values read as the identity
of the fold, so a reset costs nothing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple, SupportsIndex, assert_never

from rtamt.program.instructions import Map, Window
from rtamt.program.program import Delay, Program, schedule
from rtamt.renamed import old_keywords
from rtamt_arrays.functions import FUNCTIONS, Elements, Fold, exact
from rtamt_arrays.inputs import (
    ArrayReader,
    ArraySample,
    StateField,
    checked_batch_size,
    checked_mask,
    checked_state,
    columns,
    dtype_name,
    terms,
    zeros,
)
from rtamt_arrays.operations import Operations, Tensor


class OnlineState(NamedTuple):
    """The state of an online monitor.

    Attributes:
        ring: The cells of all delays, of shape (cells, entries).
        place: For each delay, the cell that the next step reads and writes.
        totals: The folds since the start, a row for each number.
        age: The number of samples of each entry since its reset, up to a maximum.
        nan: Whether an entry has had a nan since its reset.
    """

    ring: Tensor
    place: Tensor
    totals: Tensor
    age: Tensor
    nan: Tensor


class OnlineReading(NamedTuple):
    """The result of an online monitor: arrays with a value for each batch entry.

    Attributes:
        robustness: The robustness, late by the latency; nan before the first value, and from a nan
            to the reset.
        nan: Whether a variable or a term has been nan since the reset.
    """

    robustness: Tensor
    nan: Tensor


class OnlineMonitor:
    """`rtamt.VectorMonitor` as pure functions of arrays; ``online`` returns one.

    Attributes:
        program: The compiled program.
        variables: Names of the variables, in the order of the last axis of a sample.
        latency: The number of samples by which the robustness is late.
    """

    def __init__(self, program: Program, operations: Operations, reader: ArrayReader) -> None:
        self.program = program
        self.variables = program.variables
        self.latency = program.latency or 0
        self._o = operations
        self._reader = reader
        self._lattice = exact(operations)
        self._schedule = tuple(schedule(program))
        self._lengths: list[int] = []
        self._identities: list[float] = []  # the values of times before a reset
        self._totals: list[float] = []
        self._rungs: dict[int, list[tuple[int, int]]] = {}  # by slot: delay, length
        for slot, scheduled in self._schedule:
            if isinstance(scheduled, Delay):
                self._rungs[slot] = [(self._add_delay(scheduled.length, (0.0,)), scheduled.length)]
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
            "place": StateField((len(self._lengths),), o.row, entries=False),
            "totals": StateField((len(self._totals),), dtype),
            "age": StateField((), o.count),
            "nan": StateField((), o.truth),
        }
        starts = [program.start(s) for s, step in self._schedule if isinstance(step, Window)]
        self._oldest = 1 + max(self.latency, *self._lengths, *starts, 0)

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__} of {self.program.specification.formula}, latency "
            f"{self.latency}, {dtype_name(self._reader.dtype)}>"
        )

    def _add_delay(self, length: int, identity: Sequence[float]) -> int:
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
        return [(self._add_delay(length, identity), length) for length in lengths]

    @old_keywords
    def init(self, batch_size: SupportsIndex) -> OnlineState:
        """Return the state of ``batch_size`` entries (1 or more) before the first sample.

        Raises:
            InputError: If ``batch_size`` is less than 1.
            InputTypeError: If ``batch_size`` is not a whole number.
        """
        arrays = zeros(self._o, self._fields, checked_batch_size(self._reader, batch_size))
        # Callers may overwrite the state, so return a copy.
        position = self._o.concatenate([self._table.begins])
        return OnlineState(**arrays | {"place": position})

    def reset(self, state: OnlineState, mask: Tensor | None = None) -> OnlineState:
        """Return the state in which the masked entries have no samples.

        Args:
            state: A state of this monitor.
            mask: A boolean for each entry; None for all.

        Raises:
            InputError: If a shape is wrong.
            InputTypeError: If the state or the mask has a wrong type.
        """
        self._check(state)
        keep = ~checked_mask(self._reader, mask, state.age)
        return state._replace(age=state.age * self._o.as_integers(keep), nan=state.nan & keep)

    def update(self, state: OnlineState, sample: ArraySample) -> tuple[OnlineState, OnlineReading]:
        """Take a sample in every entry.

        Args:
            state: A state of this monitor.
            sample: An array of shape (entries,) for each variable by name, others are ignored; or
                an array of shape (entries, variables).

        Returns:
            The next state, and the reading.

        Raises:
            InputError: If a variable is missing, or a shape is wrong.
            InputTypeError: If the state or the sample has a wrong type.
        """
        self._check(state)
        o, age = self._o, state.age
        entries = tuple(age.shape)
        values = columns(self.program, self._reader, sample, entries)
        values, is_nan = terms(self.program, o, self._reader.dtype, values)
        slots: dict[int, Tensor] = dict(enumerate(values))
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
                    for position, length in self._rungs[slot]:
                        if length:
                            x = fold.combine(step.delayed(position, x), x)
                        else:
                            x = step.total(position, fold, x)
                    slots[slot] = x[-1]
                case _ as never:
                    assert_never(never)
        nan = state.nan if is_nan is None else state.nan | is_nan
        robustness = o.where((age >= self.latency) & ~nan, slots[self.program.result], math.nan)
        following = step.following(nan, o.least(age + 1, self._oldest))
        return following, OnlineReading(robustness, nan)

    def begin(
        self, state: OnlineState, sample: ArraySample, mask: Tensor | None = None
    ) -> tuple[OnlineState, OnlineReading]:
        """Start the masked entries again with a sample; the other entries take no sample.

        Entries share a clock: the sample has the time of the newest sample of the others.

        Args:
            state: As for `update`.
            sample: As for `update`.
            mask: A boolean for each entry; None for all.

        Returns:
            The next state, and the reading, which is meaningless in the other entries.

        Raises:
            InputError: As `update` and `reset` do.
            InputTypeError: As `update` and `reset` do.
        """
        self._check(state)
        o, position, table = self._o, state.place, self._table
        before = state._replace(place=o.where(position == table.begins, table.ends, position) - 1)
        mask = checked_mask(self._reader, mask, state.age)
        updated, reading = self.update(self.reset(before, mask), sample)
        parts = {
            name: position if name == "place" else o.where(mask, new, getattr(state, name))
            for name, new in updated._asdict().items()
        }
        return OnlineState(**parts), reading

    def _check(self, state: OnlineState) -> None:
        checked_state(self._reader, state, OnlineState, self._fields)


class _Table(NamedTuple):
    """The layout of the delays in the ring; all but the first two are columns.

    Attributes:
        begins: The first cell of each delay.
        ends: The cell after the last cell of each delay.
        lengths: The number of samples of each delay.
        identities: The values of times before the reset.
        totals: The folds of no samples.
    """

    begins: Tensor
    ends: Tensor
    lengths: Tensor
    identities: Tensor
    totals: Tensor


class _Step:
    """The reads and writes of one step; the writes are collected until its end."""

    def __init__(self, o: Operations, state: OnlineState, table: _Table) -> None:
        self._o, self._state, self._table = o, state, table
        self._entries = tuple(state.age.shape)
        self._written: list[Tensor] = [None] * len(table.lengths)
        self._totals: list[Tensor] = [None] * len(table.totals)
        if self._written:
            late = o.gather(state.ring, state.place)
            self._late = o.where(state.age >= table.lengths, late, table.identities)
        if self._totals:
            self._sums = o.where(state.age > 0, state.totals, table.totals)

    def delayed(self, delay: int, x: Elements) -> Elements:
        """Write numbers to a delay, and return its delayed numbers."""
        for i, number in enumerate(x):
            self._written[delay + i] = self._o.broadcast(number, self._entries)
        return tuple(self._late[delay + i] for i in range(len(x)))

    def total(self, row: int, fold: Fold, x: Elements) -> Elements:
        """Fold an element into the total since the start."""
        before = tuple(self._sums[row + i] for i in range(len(x)))
        total = fold.combine(before, x)
        for i, number in enumerate(total):
            self._totals[row + i] = self._o.broadcast(number, self._entries)
        return total

    def following(self, nan: Tensor, age: Tensor) -> OnlineState:
        o, state, table = self._o, self._state, self._table
        ring, position, totals = state.ring, state.place, state.totals
        if self._written:
            ring = o.scatter(ring, position, o.stack(self._written))
            position = position + 1
            position = o.where(position == table.ends, table.begins, position)
        if self._totals:
            totals = o.stack(self._totals)
        return OnlineState(ring, position, totals, age, nan)
