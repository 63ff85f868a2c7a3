"""The episode machine on arrays: robustness at time 0 and its bounds, in fixed shapes.

It computes the same as `rtamt.machines.episode.machine`. The state stores settled values: of each
stream, as far back as others read it, and of each window, the folds from each settled element to
the newest one. A step folds one element into each of these. Values that have not settled are
computed in each continuation, at fixed offsets from now: each window is a stored fold, combined
with the open elements. All shapes are therefore fixed, and the cost of a step grows with the number
of samples that a formula reads ahead.

If later values no longer depend on samples, such as upper bounds of unfinished windows, one number
(the tail) stands for all of them. After a reset, folds start again and earlier values read as
identities, so a reset costs nothing.

An unknown stands for the fold of all future samples of an unbounded window. A value that depends on
unknowns is a polynomial, stored by its values at the corners; each step rewrites it in terms of the
next unknowns. Values have the axes time, corner and batch entry. The second axis has the length
2^k for values of k unknowns; otherwise, and in continuations, it has the length 1.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple, SupportsIndex

from rtamt.program.instructions import Const, Map, Window
from rtamt.program.placement import place
from rtamt.program.program import Program
from rtamt.renamed import old_keywords
from rtamt_arrays.continuations import Continuations, EpisodeRows
from rtamt_arrays.functions import FUNCTIONS, Elements
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
from rtamt_arrays.layout import (
    CONTINUATIONS,
    Arrival,
    BoundsReading,
    Cells,
    Continuation,
    EpisodeState,
    Layout,
)
from rtamt_arrays.operations import Operations, Tensor

INF = math.inf


class _Storage(NamedTuple):
    """The old state, the unknowns of this step, and the rows of the next state."""

    state: EpisodeState
    unknowns: list[Tensor]
    tables: dict[bool, list[Tensor]]


class EpisodeArrays:
    """`rtamt.VectorEpisodeMonitor` as pure functions of arrays; ``episode`` returns one.

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
        self._rows = EpisodeRows(operations, reader.dtype)
        self._axes = {register: axis for axis, register in enumerate(self._placement.unknowns)}
        self._corners = 1 << len(self._axes)
        corners = list(itertools.product((-INF, INF), repeat=len(self._axes)))
        self._ends = [  # each unknown at each corner
            operations.constant([corner[axis] for corner in corners], reader.dtype)[:, None]
            for axis in range(len(self._axes))
        ]
        self._layout = Layout(self._placement)
        self._shapes = self._layout.shapes
        o, dtype = operations, reader.dtype
        self._fields = {
            "rows": StateField((self._layout.sizes[False],), dtype),
            "kept": StateField((self._layout.sizes[True], self._corners), dtype),
            "first": StateField((len(self._layout.firsts),), dtype),
            "age": StateField((), o.count),
            "nan": StateField((), o.truth),
        }
        self._continuations = Continuations(
            self._placement, self._layout, operations, self._rows, reader.dtype
        )

    def __repr__(self) -> str:
        return (
            f"<{type(self).__name__} of {self.program.specification.formula}, "
            f"{dtype_name(self._reader.dtype)}>"
        )

    @old_keywords
    def init(self, batch_size: SupportsIndex) -> EpisodeState:
        """Return the state of ``batch_size`` entries (1 or more) before the first sample.

        Raises:
            InputError: If ``batch_size`` is less than 1.
            InputTypeError: If ``batch_size`` is not a whole number.
        """
        return EpisodeState(
            **zeros(self._o, self._fields, checked_batch_size(self._reader, batch_size))
        )

    def reset(self, state: EpisodeState, mask: Tensor | None = None) -> EpisodeState:
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

    def update(
        self, state: EpisodeState, sample: ArraySample
    ) -> tuple[EpisodeState, BoundsReading]:
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
        now, following = self._take(state, sample)
        views = [self._continuations.view(now, name) for name in CONTINUATIONS]
        robustness, lower, upper = self._values(now, views)
        return following, self._reading(robustness, lower, upper, following.nan)

    def update_and_cut(
        self, state: EpisodeState, sample: ArraySample
    ) -> tuple[EpisodeState, BoundsReading, BoundsReading]:
        """Take a sample in every entry, and also evaluate the trace as cut after it.

        It stores the same state as `update`, and computes two more continuations.

        Args:
            state: As for `update`.
            sample: As for `update`.

        Returns:
            The result of `update`, and the reading of `rtamt.VectorEpisodeMonitor` after
            ``finish(end="cut")``: windows that extend past the end are open in the bounds, and the
            robustness is moved into the bounds.

        Raises:
            InputError: As `update` does.
            InputTypeError: As `update` does.
        """
        now, following = self._take(state, sample)
        views = [self._continuations.view(now, name) for name in CONTINUATIONS]
        robustness, lower, upper = self._values(now, views)
        reading = self._reading(robustness, lower, upper, following.nan)
        views = [self._continuations.view(now, view.name, opened=view) for view in views[1:]]
        lower, upper = self._values(now, views)
        moved = self._o.greater(lower, self._o.lesser(robustness, upper))
        return following, reading, self._reading(moved, lower, upper, following.nan)

    def begin(
        self, state: EpisodeState, sample: ArraySample, mask: Tensor | None = None
    ) -> tuple[EpisodeState, BoundsReading]:
        """Start the masked entries again with a sample; the other entries take no sample.

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
        updated, reading = self.update(self.reset(state, mask), sample)
        mask = checked_mask(self._reader, mask, state.age)
        arrays = (self._o.where(mask, *pair) for pair in zip(updated, state, strict=True))
        return EpisodeState(*arrays), reading

    def _take(self, state: EpisodeState, sample: ArraySample) -> tuple[Arrival, EpisodeState]:
        """Return the settled values after a sample, and the next state."""
        self._check(state)
        o, age = self._o, state.age
        entries = tuple(age.shape)
        values = columns(self.program, self._reader, sample, entries)
        values, is_nan = terms(self.program, o, self._reader.dtype, values)
        now, following = self._settle(state, [o.broadcast(term, entries) for term in values])
        nan = state.nan if is_nan is None else state.nan | is_nan
        return now, following._replace(age=o.least(age + 1, self._layout.oldest), nan=nan)

    def _values(self, now: Arrival, views: Sequence[Continuation]) -> list[Tensor]:
        """Return the value at time 0 of each entry, in each continuation."""
        entries = tuple(now.age.shape)
        return [self._o.broadcast(self._continuations.value(now, view), entries) for view in views]

    def _reading(
        self, robustness: Tensor, lower: Tensor, upper: Tensor, nan: Tensor
    ) -> BoundsReading:
        o = self._o
        lower, upper = o.where(nan, -INF, lower), o.where(nan, INF, upper)
        verdict = o.as_integers(~o.signbit(lower)) - o.as_integers(o.signbit(upper))
        return BoundsReading(o.where(nan, math.nan, robustness), lower, upper, verdict, nan)

    def _check(self, state: EpisodeState) -> None:
        checked_state(self._reader, state, EpisodeState, self._fields)

    def _settle(self, state: EpisodeState, values: list[Tensor]) -> tuple[Arrival, EpisodeState]:
        """Return the values that settle with this sample, and the state that stores them."""
        o, dtype = self._o, self._reader.dtype
        begins = state.age == 0
        firsts = enumerate(self._layout.firsts)
        first = {r: o.where(begins, values[r], state.first[i]) for i, r in firsts}
        now = Arrival(state.age, {}, {}, {}, first)
        unknowns: list[Tensor] = [o.full((1, 1), 0.0, dtype)] * len(self._axes)
        storage = _Storage(state, unknowns, {False: [], True: []})
        for r in self._placement.streams:
            instruction = self.program.instructions[r]
            if isinstance(instruction, Const):
                value = o.full((1, 1, 1), instruction.value, dtype)
                now.settled[r] = self._rows.repeated(value, self._shapes[r].back + 1)
                continue
            if r < self.program.terms:
                newest = values[r][None, None]
            else:
                newest = self._newest(now, storage, r)
            if r in self._layout.histories:
                cells = self._layout.histories[r]
                newest = self._rows.after(self._load(storage, cells), newest)
                self._store(storage, cells, newest[1:])
            now.settled[r] = newest
        for r, blocks in self._layout.initial.items():
            window = self._layout.windows[r]
            offset = -max(self._shapes[a].late for a in window.args)
            x = self._settled_element(now, window, offset)
            x = self._rows.fold(window).masked(
                o, self._rows.inside(now.age, window, offset, offset), x
            )
            old = tuple(self._load(storage, cells) for cells in blocks)
            now.initial[r] = self._rows.fold(window).combine(old, x)
            for cells, rows in zip(blocks, now.initial[r], strict=True):
                self._store(storage, cells, rows)
        plain, dependent = storage.tables[False], storage.tables[True]
        return now, state._replace(
            rows=o.concatenate(plain) if plain else state.rows,
            kept=o.concatenate(dependent) if dependent else state.kept,
            first=o.stack(list(first.values())) if first else state.first,
        )

    def _newest(self, now: Arrival, storage: _Storage, register: int) -> Tensor:
        """Return the value of a stream that settles with this sample."""
        match self.program.formula(register):
            case Map(function, args):
                late = self._shapes[register].late
                positions = [(a, self._shapes[a].back - late) for a in args]
                operands = (now.settled[a][position][None] for a, position in positions)
                return FUNCTIONS[function](self._o, *operands)
            case Window() as window:
                x = self._settled_element(now, window, self._layout.newest(register, window))
                if window.hi is None:
                    axis, fold = self._axes[register], self._rows.fold(window)
                    later = tuple(map(self._rows.array, fold.identity[:-1]))
                    newest = fold.combine(x, (*later, self._ends[axis]))[-1]
                    storage.unknowns[axis] = newest[0]
                    return newest
                return self._refold(now, storage, register, window, x)

    def _refold(
        self, now: Arrival, storage: _Storage, register: int, window: Window, x: Elements
    ) -> Tensor:
        """Fold an element into the folds of a window; return the oldest fold, which has settled."""
        blocks, fold = self._layout.folds[register], self._rows.fold(window)
        rows, old = x, tuple(self._load(storage, cells) for cells in blocks)
        if old[0].shape[0]:
            rows = fold.combine(old, x)
            rows = rows if window.lo is None else tuple(map(self._rows.after, rows, x))
        now.folds[register] = rows
        for cells, a in zip(blocks, rows, strict=True):
            self._store(storage, cells, a if window.lo is None else a[1:])
        return rows[-1][:1]

    def _settled_element(self, now: Arrival, window: Window, offset: int) -> Elements:
        """Return the settled element at an offset; the identity before time 0."""
        x = tuple(now.settled[a][offset + self._shapes[a].back][None] for a in window.args)
        return self._rows.fold(window).masked(self._o, now.age >= -offset, x) if offset else x

    def _load(self, storage: _Storage, cells: Cells) -> Tensor:
        """Return stored rows, in terms of the unknowns of this step."""
        table = storage.state.kept if cells.depends else storage.state.rows[:, None]
        rows = table[cells.begin : cells.end]
        if cells.identity is not None:
            identity = self._o.full((), cells.identity, self._reader.dtype)
            rows = self._o.where(storage.state.age == 0, identity, rows)
        return self._rows.at_unknowns(rows, storage.unknowns) if cells.depends else rows

    def _store(self, storage: _Storage, cells: Cells, rows: Tensor) -> None:
        """Store rows; callers follow the order of the layout."""
        if cells.end > cells.begin:
            entries = tuple(storage.state.age.shape)
            rows, corners = (rows, (self._corners,)) if cells.depends else (rows[:, 0], ())
            shape = (cells.end - cells.begin, *corners, *entries)
            storage.tables[cells.depends].append(self._o.broadcast(rows, shape))
