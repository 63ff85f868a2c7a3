"""The episode machine on arrays: robustness at time 0 and its bounds, in fixed shapes.

It computes what `rtamt.machines.episode.machine` describes. Settled values are stored where they
are read: the values of streams as far back as others read them, and for each window the folds from
each of its settled elements to the newest one. A step folds one element into each of these. Values
that have not settled are computed in each continuation, at fixed offsets from now: each window is a
stored fold combined with the open elements. So all shapes are fixed, and the cost of a step grows
with the number of samples that a formula reads ahead.

Where values no longer depend on samples, such as upper bounds of unfinished windows, one number
(the tail) stands for all later ones. After a reset, folds start again and earlier values read as
identities, so a reset costs nothing.

An unknown stands for the fold of all future samples of an unbounded window. A value that depends on
it is a polynomial, stored by its values at the corners; each step rewrites it in terms of the next
unknown. Values have the axes time, corner and entry of the batch. The second axis has the length
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
from rtamt_arrays.continuations import EpisodeOutlook, EpisodeRows
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
    WORLDS,
    Arrival,
    BoundsReading,
    Cells,
    EpisodeState,
    Layout,
    Worldview,
)
from rtamt_arrays.operations import Operations, Tensor

INF = math.inf


class _Kept(NamedTuple):
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
        self._outlook = EpisodeOutlook(
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
            InputTypeError: If the state or the mask is of another kind.
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
            InputTypeError: If the state or the sample is of another kind.
        """
        now, following = self._arrived(state, sample)
        views = [self._outlook.view(now, world) for world in WORLDS]
        robustness, lower, upper = self._values(now, views)
        return following, self._reading(robustness, lower, upper, following.nan)

    def update_and_cut(
        self, state: EpisodeState, sample: ArraySample
    ) -> tuple[EpisodeState, BoundsReading, BoundsReading]:
        """Take a sample in every entry, and evaluate the trace as cut there too.

        It stores no more than `update`, and computes two more continuations.

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
        now, following = self._arrived(state, sample)
        views = [self._outlook.view(now, world) for world in WORLDS]
        robustness, lower, upper = self._values(now, views)
        reading = self._reading(robustness, lower, upper, following.nan)
        views = [self._outlook.view(now, view.world, opened=view) for view in views[1:]]
        lower, upper = self._values(now, views)
        moved = self._o.greater(lower, self._o.lesser(robustness, upper))
        return following, reading, self._reading(moved, lower, upper, following.nan)

    def begin(
        self, state: EpisodeState, sample: ArraySample, mask: Tensor | None = None
    ) -> tuple[EpisodeState, BoundsReading]:
        """Start the masked entries again with a sample; the others take none.

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
        begun, reading = self.update(self.reset(state, mask), sample)
        mask = checked_mask(self._reader, mask, state.age)
        kept = (self._o.where(mask, *pair) for pair in zip(begun, state, strict=True))
        return EpisodeState(*kept), reading

    def _arrived(self, state: EpisodeState, sample: ArraySample) -> tuple[Arrival, EpisodeState]:
        """Return the settled values with a sample, and the next state."""
        self._check(state)
        o, age = self._o, state.age
        entries = tuple(age.shape)
        values = columns(self.program, self._reader, sample, entries)
        known, wrong = terms(self.program, o, self._reader.dtype, values)
        now, following = self._settled(state, [o.broadcast(term, entries) for term in known])
        nan = state.nan if wrong is None else state.nan | wrong
        return now, following._replace(age=o.least(age + 1, self._layout.oldest), nan=nan)

    def _values(self, now: Arrival, views: Sequence[Worldview]) -> list[Tensor]:
        """Return the value at time 0 of each entry, in each continuation."""
        entries = tuple(now.age.shape)
        return [self._o.broadcast(self._outlook.value(now, view), entries) for view in views]

    def _reading(
        self, robustness: Tensor, lower: Tensor, upper: Tensor, nan: Tensor
    ) -> BoundsReading:
        o = self._o
        lower, upper = o.where(nan, -INF, lower), o.where(nan, INF, upper)
        verdict = o.as_integers(~o.signbit(lower)) - o.as_integers(o.signbit(upper))
        return BoundsReading(o.where(nan, math.nan, robustness), lower, upper, verdict, nan)

    def _check(self, state: EpisodeState) -> None:
        checked_state(self._reader, state, EpisodeState, self._fields)

    def _settled(self, state: EpisodeState, known: list[Tensor]) -> tuple[Arrival, EpisodeState]:
        """Return the values that settle with this sample, and the state that stores them."""
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
                now.settled[r] = self._rows.repeated(value, self._shapes[r].back + 1)
                continue
            newest = known[r][None, None] if r < self.program.terms else self._newer(now, kept, r)
            if r in self._layout.histories:
                cells = self._layout.histories[r]
                newest = self._rows.after(self._loaded(kept, cells), newest)
                self._store(kept, cells, newest[1:])
            now.settled[r] = newest
        for r, places in self._layout.initial.items():
            window = self._layout.windows[r]
            offset = -max(self._shapes[a].late for a in window.args)
            x = self._settled_element(now, window, offset)
            x = self._rows.fold(window).masked(
                o, self._rows.inside(now.age, window, offset, offset), x
            )
            old = tuple(self._loaded(kept, cells) for cells in places)
            now.initial[r] = self._rows.fold(window).combine(old, x)
            for cells, rows in zip(places, now.initial[r], strict=True):
                self._store(kept, cells, rows)
        plain, dependent = kept.tables[False], kept.tables[True]
        return now, state._replace(
            rows=o.concatenate(plain) if plain else state.rows,
            kept=o.concatenate(dependent) if dependent else state.kept,
            first=o.stack(list(first.values())) if first else state.first,
        )

    def _newer(self, now: Arrival, kept: _Kept, register: int) -> Tensor:
        """Return the value of a stream that settles with this sample."""
        match self.program.formula(register):
            case Map(function, args):
                late = self._shapes[register].late
                places = [(a, self._shapes[a].back - late) for a in args]
                operands = (now.settled[a][position][None] for a, position in places)
                return FUNCTIONS[function](self._o, *operands)
            case Window() as window:
                x = self._settled_element(now, window, self._layout.newest(register, window))
                if window.hi is None:
                    axis, fold = self._axes[register], self._rows.fold(window)
                    later = tuple(map(self._rows.array, fold.identity[:-1]))
                    newest = fold.combine(x, (*later, self._ends[axis]))[-1]
                    kept.unknowns[axis] = newest[0]
                    return newest
                return self._refolded(now, kept, register, window, x)

    def _refolded(
        self, now: Arrival, kept: _Kept, register: int, window: Window, x: Elements
    ) -> Tensor:
        """Fold an element into the folds of a window, the oldest of which has settled."""
        places, fold = self._layout.folds[register], self._rows.fold(window)
        rows, old = x, tuple(self._loaded(kept, cells) for cells in places)
        if old[0].shape[0]:
            rows = fold.combine(old, x)
            rows = rows if window.lo is None else tuple(map(self._rows.after, rows, x))
        now.folds[register] = rows
        for cells, a in zip(places, rows, strict=True):
            self._store(kept, cells, a if window.lo is None else a[1:])
        return rows[-1][:1]

    def _settled_element(self, now: Arrival, window: Window, at: int) -> Elements:
        """Return the element at an offset that has settled; the identity before time 0."""
        x = tuple(now.settled[a][at + self._shapes[a].back][None] for a in window.args)
        return self._rows.fold(window).masked(self._o, now.age >= -at, x) if at else x

    def _loaded(self, kept: _Kept, cells: Cells) -> Tensor:
        """Return stored rows, in terms of the unknowns of this step."""
        table = kept.state.kept if cells.depends else kept.state.rows[:, None]
        rows = table[cells.begin : cells.end]
        if cells.identity is not None:
            nothing = self._o.full((), cells.identity, self._reader.dtype)
            rows = self._o.where(kept.state.age == 0, nothing, rows)
        return self._rows.in_world(rows, kept.unknowns) if cells.depends else rows

    def _store(self, kept: _Kept, cells: Cells, rows: Tensor) -> None:
        """Store rows; the calls come in the order of the layout."""
        if cells.end > cells.begin:
            entries = tuple(kept.state.age.shape)
            rows, corners = (rows, (self._corners,)) if cells.depends else (rows[:, 0], ())
            shape = (cells.end - cells.begin, *corners, *entries)
            kept.tables[cells.depends].append(self._o.broadcast(rows, shape))
