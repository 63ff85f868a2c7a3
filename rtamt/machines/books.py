"""Joint results of several banks of episodes, entry by entry, and the log of their verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.arrays import Floats
from rtamt.inputs.lanes import Lanes
from rtamt.machines.protocols import End, EpisodeBank

Banks = Sequence[EpisodeBank]
LaneCounts = NDArray[np.int64]
LaneValue = Literal["robustness", "lower", "upper"]


class BankOutcomes(NamedTuple):
    """The outcomes of episodes so far: fresh arrays with a row per bank, a column per entry.

    Robustness and verdict are 0 without a sample. ``settled_at`` is the sample that decided the
    verdict, or the last one if only the end did; -1 while it is open. ``by_end`` marks a verdict of
    -1 at a robustness that holds. ``success`` and ``undecided`` have one value per entry.
    """

    robustness: Floats
    verdicts: NDArray[np.int8]
    settled_at: LaneCounts
    settled: Lanes
    satisfied: Lanes
    by_end: Lanes
    success: Lanes
    undecided: Lanes


LaneColumn = tuple[dict[str, Any] | list[dict[str, Any]], str, str, NDArray[Any], Lanes | None]
"""``(place, key, mask_key, values, there)``: values of some entries, and where to write them.

The place is a dictionary or, for values of two dimensions, a list with one per row. The last
dimension of the values counts entries. ``there`` states which elements exist, None: all.
"""


@dataclass(frozen=True, slots=True)
class BookFunctions:
    """The functions of a back-end on banks of equal size; `VerdictBook` describes their results.

    In a log, a row belongs to a bank and a column to an entry; other arrays have one value per
    entry. ``least`` is the minimum over the banks: -0.0 where ``failed``, nan without a sample.
    """

    feed: Callable[[Banks, Sequence[tuple[int, ...]], Floats, Lanes | None], None]
    least: Callable[[Banks, LaneValue, Lanes | None], Floats]
    finish: Callable[[Banks, Lanes | None, End], None]
    note: Callable[[Banks, Lanes | None, LaneCounts, Lanes, Lanes, LaneCounts, LaneCounts], None]
    forget: Callable[[Lanes | None, LaneCounts, Lanes, Lanes, LaneCounts, LaneCounts], None]
    outcomes: Callable[[Banks, LaneCounts, Lanes, LaneCounts], BankOutcomes]
    spread: Callable[[list[LaneColumn], LaneCounts, int], None]
    reset: Callable[[Banks, Lanes | None], None]


def _feed(
    banks: Banks, columns: Sequence[tuple[int, ...]], table: Floats, mask: Lanes | None
) -> None:
    for bank, picked in zip(banks, columns, strict=True):
        bank.update(table[:, list(picked)], mask)


def _least(banks: Banks, value: LaneValue, failed: Lanes | None) -> Floats:
    values = np.array([getattr(bank, value) for bank in banks])
    if failed is not None:
        values[failed] = -0.0
    lowest: Floats = np.minimum.reduce(values)
    lowest[(lowest == 0.0) & np.signbit(values).any(axis=0)] = -0.0  # minimum gives either zero
    return lowest


def _finish(banks: Banks, mask: Lanes | None, end: End) -> None:
    for bank in banks:
        bank.finish(mask, end)


def _note(
    banks: Banks,
    mask: Lanes | None,
    settled_at: LaneCounts,
    violated: Lanes,
    failed: Lanes,
    first: LaneCounts,
    violated_at: LaneCounts,
) -> None:
    verdicts = _verdicts(banks, failed)
    last = banks[0].samples - 1
    new = (verdicts != 0) & (settled_at < 0) & (last >= 0)
    if mask is not None:
        new &= mask
    settled_at[new] = np.broadcast_to(last, new.shape)[new]
    broken = new & (verdicts < 0)
    violated |= broken
    lanes = broken.any(axis=0) & (violated_at < 0)
    first[lanes] = broken.argmax(axis=0)[lanes]
    violated_at[lanes] = last[lanes]


def _forget(
    mask: Lanes | None,
    settled_at: LaneCounts,
    violated: Lanes,
    failed: Lanes,
    first: LaneCounts,
    violated_at: LaneCounts,
) -> None:
    which = slice(None) if mask is None else mask
    settled_at[:, which] = first[which] = violated_at[which] = -1
    violated[:, which] = failed[:, which] = False


def _outcomes(
    banks: Banks, lanes: LaneCounts, failed: Lanes, settled_at: LaneCounts
) -> BankOutcomes:
    _check_lanes(lanes, len(banks[0].samples))
    begun = banks[0].samples[lanes] > 0
    robustness = np.where(begun, np.array([bank.robustness[lanes] for bank in banks]), 0.0)
    verdicts = np.where(begun, _verdicts(banks, failed)[:, lanes], np.int8(0))
    when, satisfied = settled_at[:, lanes], verdicts > 0
    by_end = (verdicts < 0) & ~np.signbit(robustness)
    success: Lanes = np.logical_and.reduce(satisfied)
    undecided: Lanes = np.logical_or.reduce(verdicts == 0)
    return BankOutcomes(
        robustness, verdicts, when, when >= 0, satisfied, by_end, success, undecided
    )


def spread(columns: list[LaneColumn], lanes: LaneCounts, num: int) -> None:
    """Write arrays of all entries, and masks, from values of some, as `VerdictBook.spread`."""
    _check_lanes(lanes, num)
    for position, key, mask_key, values, there in columns:
        rows = [position] if isinstance(position, dict) else position
        shape = len(rows), len(lanes)
        has = np.ones(shape, np.bool_) if there is None else np.reshape(there, shape)
        for group, row, known in zip(rows, np.reshape(values, shape), has, strict=True):
            if not known.any():
                continue
            empty = np.empty if values.dtype == object else np.zeros  # empty objects are None
            held, mask = empty(num, values.dtype), np.zeros(num, np.bool_)
            held[lanes[known]], mask[lanes[known]] = row[known], True
            group[key], group[mask_key] = held, mask


def _reset(banks: Banks, mask: Lanes | None) -> None:
    for bank in banks:
        bank.reset(mask)


def _check_lanes(lanes: LaneCounts, num: int) -> None:
    if ((lanes < 0) | (lanes >= num)).any():
        msg = "expected the numbers of lanes"
        raise IndexError(msg)


def _verdicts(banks: Banks, failed: Lanes) -> NDArray[np.int8]:
    return np.where(failed, np.int8(-1), np.array([bank.verdict for bank in banks]))


PYTHON_BOOKS = BookFunctions(_feed, _least, _finish, _note, _forget, _outcomes, spread, _reset)
"""The functions for banks of any back-end."""
