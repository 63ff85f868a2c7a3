"""What several banks of episodes find together, lane by lane, and the book of their verdicts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.lanes import Floats, Lanes
from rtamt.machines.protocols import End, EpisodeBank

__all__ = ["PYTHON_BOOKS", "BankOutcomes", "BookFunctions", "LaneValue"]

Banks = Sequence[EpisodeBank]
LaneCounts = NDArray[np.int64]
LaneValue = Literal["robustness", "lower", "upper"]
BankOutcomes = tuple[Floats, NDArray[np.int8]]


@dataclass(frozen=True, slots=True)
class BookFunctions:
    """The functions of a back-end on banks of as many lanes.

    A row of a book is of a bank, a column of a lane; an array of one dimension is of the lanes.

    Attributes:
        feed: ``(banks, columns, table, mask)``: feeds each bank its columns of a table.
        least: ``(banks, value, failed)``: the least over the banks; where ``failed`` is true, -0.0
            stands for the value. nan where a lane has no sample.
        finish: ``(banks, mask, end)``: ends the episodes of the mask.
        note: ``(banks, decided_at, violated, failed, first, violated_at)``: writes the verdicts
            that are new.
        forget: ``(mask, decided_at, violated, failed, first, violated_at)``.
        outcomes: ``(banks, mask, failed)``: the robustness and the verdicts by all banks; 0 in
            lanes that the mask leaves out or that have no sample.
    """

    feed: Callable[[Banks, Sequence[tuple[int, ...]], Floats, Lanes | None], None]
    least: Callable[[Banks, LaneValue, Lanes | None], Floats]
    finish: Callable[[Banks, Lanes | None, End], None]
    note: Callable[[Banks, LaneCounts, Lanes, Lanes, LaneCounts, LaneCounts], None]
    forget: Callable[[Lanes | None, LaneCounts, Lanes, Lanes, LaneCounts, LaneCounts], None]
    outcomes: Callable[[Banks, Lanes | None, Lanes], BankOutcomes]


def _feed(
    banks: Banks, columns: Sequence[tuple[int, ...]], table: Floats, mask: Lanes | None
) -> None:
    for bank, picked in zip(banks, columns, strict=True):
        bank.update(table[:, list(picked)], mask)


def _least(banks: Banks, value: LaneValue, failed: Lanes | None) -> Floats:
    found = np.array([getattr(bank, value) for bank in banks])
    if failed is not None:
        found[failed] = -0.0
    lowest: Floats = np.minimum.reduce(found)
    lowest[(lowest == 0.0) & np.signbit(found).any(axis=0)] = -0.0  # minimum gives either zero
    return lowest


def _finish(banks: Banks, mask: Lanes | None, end: End) -> None:
    for bank in banks:
        bank.finish(mask, end)


def _note(
    banks: Banks,
    decided_at: LaneCounts,
    violated: Lanes,
    failed: Lanes,
    first: LaneCounts,
    violated_at: LaneCounts,
) -> None:
    verdicts = _verdicts(banks, failed)
    last = banks[0].samples - 1
    new = (verdicts != 0) & (decided_at < 0) & (last >= 0)
    decided_at[new] = np.broadcast_to(last, new.shape)[new]
    broken = new & (verdicts < 0)
    violated |= broken
    lanes = broken.any(axis=0) & (violated_at < 0)
    first[lanes] = broken.argmax(axis=0)[lanes]
    violated_at[lanes] = last[lanes]


def _forget(
    mask: Lanes | None,
    decided_at: LaneCounts,
    violated: Lanes,
    failed: Lanes,
    first: LaneCounts,
    violated_at: LaneCounts,
) -> None:
    which = slice(None) if mask is None else mask
    decided_at[:, which] = first[which] = violated_at[which] = -1
    violated[:, which] = failed[:, which] = False


def _outcomes(banks: Banks, mask: Lanes | None, failed: Lanes) -> BankOutcomes:
    begun = banks[0].samples > 0
    chosen = begun if mask is None else begun & mask
    robustness = np.array([bank.robustness for bank in banks])
    verdicts = _verdicts(banks, failed)
    return np.where(chosen, robustness, 0.0), np.where(chosen, verdicts, np.int8(0))


def _verdicts(banks: Banks, failed: Lanes) -> NDArray[np.int8]:
    return np.where(failed, np.int8(-1), np.array([bank.verdict for bank in banks]))


PYTHON_BOOKS = BookFunctions(_feed, _least, _finish, _note, _forget, _outcomes)
"""On banks of any back-end."""
