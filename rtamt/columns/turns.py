"""Objects whose rows take turns in one table, by the pattern of their times."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rtamt.columns.names import read_name, word_set
from rtamt.columns.objects import Objects
from rtamt.columns.times import median

_NEAR = 0.1
"""The part of the usual step by which the lengths of two rounds may differ."""

_MOST, _ROUNDS, _REGULAR = 50, 3, 0.9
"""The most objects, the fewest rounds, and the part of the rows that must follow the pattern."""

_SIGNALS = word_set(
    "state status mode phase stage quality flag gear counter count cnt seq sequence alive rolling "
    "cycle tick ticks toggle"
)
"""Words of numbers that go round in one signal: states, and counters that start again."""


def turns_in(times: NDArray[Any]) -> int:
    """Return the number of rows in a round if uneven times repeat round by round; otherwise 0.

    Args:
        times: The time of each row, increasing, shape (n,).

    Example:
        >>> (
        ...     turns_in(np.array([0, 1, 4, 5, 8, 9])),
        ...     turns_in(np.arange(6)),
        ...     turns_in(np.arange(6) ** 2),
        ... )
        (2, 0, 0)
    """
    kind = times.dtype.kind
    numbers = times.astype(np.int64 if kind in "mM" else np.float64)
    numbers = (numbers - numbers[:1]).astype(np.float64)
    room = _NEAR * median(np.diff(numbers)) if len(numbers) > 1 else 0.0
    for turns in range(1, min(_MOST, len(numbers) // _ROUNDS) + 1):
        rounds = numbers[turns:] - numbers[:-turns]
        if float((np.abs(rounds - median(rounds)) <= room).mean()) >= _REGULAR:
            return turns if turns > 1 else 0
    return 0


def objects_by_turns(cells: Mapping[str, NDArray[Any]], turns: int) -> Objects | None:
    """Return the column of whole numbers whose values take turns; None if there is none.

    Values 0 and 1, which may be flags, and names of states or counters are not evidence.

    Args:
        cells: The columns that no formula reads.
        turns: The number of rows in a round.

    Example:
        >>> objects_by_turns({"zone": np.array([3, 7, 3, 7, 3, 7])}, 2)
        Objects(column='zone', values=('3', '7'), row=None)
    """
    for name, values in cells.items():
        if values.dtype.kind not in "iuf" or _SIGNALS & {*read_name(name).words}:
            continue
        first = values[:turns].astype(np.float64)
        distinct = len({*first.tolist()}) == turns and not {*first.tolist()} <= {0, 1}
        if not distinct or (first % 1 != 0).any():  # nan and infinity too
            continue
        if float((values[turns:] == values[:-turns]).mean()) >= _REGULAR:
            return Objects(name, tuple(str(int(value)) for value in first.tolist()))
    return None
