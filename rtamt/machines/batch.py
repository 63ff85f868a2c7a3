"""The Python machines of a batch, and the joint results of several batches of episodes.

A batch is a list of single machines; either all of them take a sample or none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt.inputs.arrays import Floats
from rtamt.inputs.batch import BatchReader, Entries, numbers_of
from rtamt.inputs.between import UncertainValue
from rtamt.inputs.samples import ends_of, in_between
from rtamt.machines.discrete import PythonDiscreteMachine
from rtamt.machines.episode.machine import PythonEpisodeVariants
from rtamt.machines.protocols import End, EpisodeBatch
from rtamt.machines.state import StateFields, verdicts_of
from rtamt.program.program import Program

_Machine = PythonDiscreteMachine | PythonEpisodeVariants
_M = TypeVar("_M", PythonDiscreteMachine, PythonEpisodeVariants)


class _PythonBatch(StateFields, Generic[_M]):
    """Machines of one program, each with its own time."""

    STATE = ("_machines",)

    def __init__(self, machines: Iterable[_M], reader: BatchReader) -> None:
        self._machines: list[_M] = list(machines)
        self._reader = reader

    @property
    def samples(self) -> NDArray[np.int64]:
        return np.array([machine.samples for machine in self._machines], dtype=np.int64)

    def reset(self, mask: ArrayLike | None = None) -> None:
        for entry in numbers_of(self._reader.mask(mask), len(self._machines)):
            self._machines[entry].reset()

    def _each(self, name: str) -> Floats:
        return np.array([getattr(machine, name) for machine in self._machines], dtype=np.float64)


def _inputs(machine: _Machine, width: int) -> Sequence[float | UncertainValue]:
    """Return the last sample of a machine without the rates; 0 before the first."""
    return machine.inputs[:width] or [0.0] * width


def _rates(machine: _Machine, values: Sequence[float | UncertainValue]) -> list[Any]:
    """Return the rates of the next sample of a machine, which follow its values."""
    return machine.reader.rates.of_sample(values, machine.inputs)


def _absent(values: object) -> bool:
    """Return whether there are no values, because they are passed by name."""
    return isinstance(values, tuple) and not values


class PythonDiscreteBatch(_PythonBatch[PythonDiscreteMachine]):
    """Machines on samples in a batch."""

    def __init__(self, program: Program, num: int, reader: BatchReader) -> None:
        machines = (PythonDiscreteMachine(program, reader.entry(i), ()) for i in range(num))
        super().__init__(machines, reader)
        self._variables = program.inputs

    @property
    def inputs(self) -> Floats:
        width = len(self._variables)
        return np.array([_inputs(machine, width) for machine in self._machines])

    def update(
        self, values: ArrayLike = (), mask: ArrayLike | None = None, **named: object
    ) -> Floats:
        if named or _absent(values):
            return self._reader.update(self, values, mask, **named)
        table, chosen = self._reader.values(values), self._reader.mask(mask)
        entries = numbers_of(chosen, len(self._machines))
        inputs = np.array([_inputs(m, table.shape[1]) for m in self._machines])
        table = self._reader.without_nan(table, chosen, self.samples, inputs)
        rows = table.tolist()
        for entry in entries:
            rows[entry] += _rates(self._machines[entry], rows[entry])
        terms = [self._machines[entry].terms(rows[entry]) for entry in entries]
        for entry, known in zip(entries, terms, strict=True):
            self._machines[entry].take(known, rows[entry])
        return self._each("result")


class PythonEpisodeBatch(_PythonBatch[PythonEpisodeVariants]):
    """Machines that bound the robustness of episodes, in a batch."""

    def __init__(self, program: Program, num: int, reader: BatchReader) -> None:
        super().__init__(
            (PythonEpisodeVariants(program, reader.entry(i)) for i in range(num)), reader
        )
        self._variables = program.inputs

    def update(
        self,
        values: ArrayLike = (),
        mask: ArrayLike | None = None,
        upper: ArrayLike | None = None,
        **named: object,
    ) -> Floats:
        if named or _absent(values):
            return self._reader.update(self, values, mask, upper, **named)
        table = self._reader.values(values)
        above = None if upper is None else self._reader.values(upper)
        chosen = self._reader.mask(mask)
        entries = numbers_of(chosen, len(self._machines))
        self._require_open(entries)
        last = [_inputs(m, table.shape[1]) for m in self._machines]
        before = tuple(np.array([[ends_of(x)[i] for x in row] for row in last]) for i in (0, 1))
        ends = self._reader.ends(table, above, chosen, self.samples, (before[0], before[1]))
        lower, upper_ends = (column.tolist() for column in ends)
        samples = []
        for entry in entries:
            machine = self._machines[entry]
            row = [*map(in_between, lower[entry], upper_ends[entry])]
            samples.append(machine.terms(row + _rates(machine, row)))
        for entry, sample in zip(entries, samples, strict=True):
            self._machines[entry].take(sample)
        return self._each("result")

    @property
    def inputs(self) -> Floats:
        rows = [_inputs(machine, len(self._variables)) for machine in self._machines]
        return np.array([[ends_of(value)[0] for value in row] for row in rows])

    @property
    def robustness(self) -> Floats:
        return self._each("robustness")

    @property
    def lower(self) -> Floats:
        return self._each("lower")

    @property
    def upper(self) -> Floats:
        return self._each("upper")

    @property
    def unknown(self) -> NDArray[np.bool_]:
        rows = [_inputs(m, len(self._variables)) for m in self._machines]
        return np.array(
            [[isinstance(x, UncertainValue) for x in row] for row in rows], dtype=np.bool_
        )

    @property
    def verdict(self) -> NDArray[np.int8]:
        return verdicts_of(self.lower, self.upper)

    @property
    def finished(self) -> NDArray[np.bool_]:
        return np.array([machine.finished for machine in self._machines])

    def finish(self, mask: ArrayLike | None = None, end: End = "complete") -> Floats:
        entries = numbers_of(self._reader.mask(mask), len(self._machines))
        for entry in entries:
            if self._machines[entry].samples == 0:
                self._reader.refuse_finish(entry)
        for entry in entries:
            self._machines[entry].finish(end)
        return self.robustness

    def _require_open(self, entries: Sequence[int]) -> None:
        for entry in entries:
            if self._machines[entry].finished:
                self._reader.refuse_update(entry)


Batches = Sequence[EpisodeBatch]
EntryCounts = NDArray[np.int64]
EntryValue = Literal["robustness", "lower", "upper"]


class BatchOutcomes(NamedTuple):
    """The outcomes of episodes so far: fresh arrays with a row per batch, a column per entry.

    Robustness and verdict are 0 without a sample. ``settled_at`` is the sample that decided the
    verdict, or the last one if only the end did; -1 while it is open. ``by_end`` marks a verdict of
    -1 at a robustness that holds. ``success`` and ``undecided`` have one value per entry.
    """

    robustness: Floats
    verdicts: NDArray[np.int8]
    settled_at: EntryCounts
    settled: Entries
    satisfied: Entries
    by_end: Entries
    success: Entries
    undecided: Entries


EntryColumn = tuple[dict[str, Any] | list[dict[str, Any]], str, str, NDArray[Any], Entries | None]
"""``(place, key, mask_key, values, there)``: values of some entries, and where to write them.

The place is a dictionary or, for values of two dimensions, a list with one per row. The last
dimension of the values counts entries. ``there`` states which elements exist, None: all.
"""


@dataclass(frozen=True, slots=True)
class VerdictLogFunctions:
    """The functions of a back-end on batches of equal size; `VerdictLog` describes their results.

    In a log, a row belongs to a batch and a column to an entry; other arrays have one value per
    entry. ``least`` is the minimum over the batches: -0.0 where ``failed``, nan without a sample.
    """

    feed: Callable[[Batches, Sequence[tuple[int, ...]], Floats, Entries | None], None]
    least: Callable[[Batches, EntryValue, Entries | None], Floats]
    finish: Callable[[Batches, Entries | None, End], None]
    note: Callable[
        [Batches, Entries | None, EntryCounts, Entries, Entries, EntryCounts, EntryCounts], None
    ]
    forget: Callable[
        [Entries | None, EntryCounts, Entries, Entries, EntryCounts, EntryCounts], None
    ]
    outcomes: Callable[[Batches, EntryCounts, Entries, EntryCounts], BatchOutcomes]
    spread: Callable[[list[EntryColumn], EntryCounts, int], None]
    reset: Callable[[Batches, Entries | None], None]


def _feed(
    batches: Batches, columns: Sequence[tuple[int, ...]], table: Floats, mask: Entries | None
) -> None:
    for batch, picked in zip(batches, columns, strict=True):
        batch.update(table[:, list(picked)], mask)


def _least(batches: Batches, value: EntryValue, failed: Entries | None) -> Floats:
    values = np.array([getattr(batch, value) for batch in batches])
    if failed is not None:
        values[failed] = -0.0
    lowest: Floats = np.minimum.reduce(values)
    lowest[(lowest == 0.0) & np.signbit(values).any(axis=0)] = -0.0  # minimum gives either zero
    return lowest


def _finish(batches: Batches, mask: Entries | None, end: End) -> None:
    for batch in batches:
        batch.finish(mask, end)


def _note(
    batches: Batches,
    mask: Entries | None,
    settled_at: EntryCounts,
    violated: Entries,
    failed: Entries,
    first: EntryCounts,
    violated_at: EntryCounts,
) -> None:
    verdicts = _verdicts(batches, failed)
    last = batches[0].samples - 1
    new = (verdicts != 0) & (settled_at < 0) & (last >= 0)
    if mask is not None:
        new &= mask
    settled_at[new] = np.broadcast_to(last, new.shape)[new]
    broken = new & (verdicts < 0)
    violated |= broken
    entries = broken.any(axis=0) & (violated_at < 0)
    first[entries] = broken.argmax(axis=0)[entries]
    violated_at[entries] = last[entries]


def _forget(
    mask: Entries | None,
    settled_at: EntryCounts,
    violated: Entries,
    failed: Entries,
    first: EntryCounts,
    violated_at: EntryCounts,
) -> None:
    which = slice(None) if mask is None else mask
    settled_at[:, which] = first[which] = violated_at[which] = -1
    violated[:, which] = failed[:, which] = False


def _outcomes(
    batches: Batches, entries: EntryCounts, failed: Entries, settled_at: EntryCounts
) -> BatchOutcomes:
    _check_entries(entries, len(batches[0].samples))
    begun = batches[0].samples[entries] > 0
    robustness = np.where(begun, np.array([batch.robustness[entries] for batch in batches]), 0.0)
    verdicts = np.where(begun, _verdicts(batches, failed)[:, entries], np.int8(0))
    when, satisfied = settled_at[:, entries], verdicts > 0
    by_end = (verdicts < 0) & ~np.signbit(robustness)
    success: Entries = np.logical_and.reduce(satisfied)
    undecided: Entries = np.logical_or.reduce(verdicts == 0)
    return BatchOutcomes(
        robustness, verdicts, when, when >= 0, satisfied, by_end, success, undecided
    )


def spread(columns: list[EntryColumn], entries: EntryCounts, num: int) -> None:
    """Write arrays of all entries, and masks, from values of some, as `VerdictLog.spread`."""
    _check_entries(entries, num)
    for position, key, mask_key, values, there in columns:
        rows = [position] if isinstance(position, dict) else position
        shape = len(rows), len(entries)
        has = np.ones(shape, np.bool_) if there is None else np.reshape(there, shape)
        for group, row, known in zip(rows, np.reshape(values, shape), has, strict=True):
            if not known.any():
                continue
            empty = np.empty if values.dtype == object else np.zeros  # empty objects are None
            held, mask = empty(num, values.dtype), np.zeros(num, np.bool_)
            held[entries[known]], mask[entries[known]] = row[known], True
            group[key], group[mask_key] = held, mask


def _reset(batches: Batches, mask: Entries | None) -> None:
    for batch in batches:
        batch.reset(mask)


def _check_entries(entries: EntryCounts, num: int) -> None:
    if ((entries < 0) | (entries >= num)).any():
        msg = "expected the numbers of entries"
        raise IndexError(msg)


def _verdicts(batches: Batches, failed: Entries) -> NDArray[np.int8]:
    return np.where(failed, np.int8(-1), np.array([batch.verdict for batch in batches]))


PYTHON_VERDICT_LOGS = VerdictLogFunctions(
    _feed, _least, _finish, _note, _forget, _outcomes, spread, _reset
)
"""The functions for batches of any back-end."""
