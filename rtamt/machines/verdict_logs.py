"""Joint results of several batches of episodes, entry by entry, and the log of their verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.arrays import Floats
from rtamt.inputs.batch import Entries
from rtamt.machines.protocols import End, EpisodeBatch

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
