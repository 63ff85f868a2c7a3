"""Records of one variable at one instant: equal ones are one record, others need a choice."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.tables import counted, number

SameTime = Literal["first", "last"]
"""Which of several different records at one instant counts."""


_ROUNDED = 3
"""From so many instants on with different records, most times may be rounded."""


def same_as_before(times: NDArray[Any]) -> NDArray[np.bool_]:
    """Return, for each time from the second on, whether it is the instant of the one before.

    Integers and dates are one instant if they are equal. Floating-point times are one instant if
    they differ by at most one unit in the last place, as clocks do that count k * 0.01.

    Example:
        >>> same_as_before(np.array([0.3, 0.1 + 0.2, 0.4])).tolist()
        [True, False]
    """
    before, after = times[:-1], times[1:]
    if times.dtype.kind != "f":
        return np.asarray(before == after, np.bool_)
    largest = np.maximum(np.abs(before), np.abs(after))
    ulp = np.where(largest < np.finfo(np.float64).tiny, 0.0, np.spacing(largest))
    return np.asarray(np.abs(after - before) <= ulp, np.bool_)


def check_rising(times: Floats, what: str) -> None:
    """Refuse times in seconds that go back.

    Args:
        times: The times in the order of the file.
        what: The file and the signal, for messages.
    """
    back = (np.diff(times) < 0) & ~same_as_before(times)
    if back.any():
        at = int(back.argmax())
        raise InputError(
            f"{what}: expected times that increase, got {_text(times[at + 1])} s after "
            f"{_text(times[at])} s"
        )


def one_record(
    times: NDArray[Any],
    values: NDArray[Any],
    choice: SameTime | None,
    what: str,
    seconds: Floats | None = None,
) -> tuple[NDArray[np.intp], str]:
    """Keep one record of a signal for each instant.

    Args:
        times: The times of the records, shape (n,), which do not decrease.
        values: The values, shape (n,); nan stands for a record without a number.
        choice: Which record counts where records of one instant differ; None: that is an error.
        what: The file and the signal, for messages.
        seconds: The times in seconds, shape (n,); None: the times are seconds.

    Returns:
        The places of the records that are kept, and a note on those that differ and are left out;
        empty if there are none.

    Example:
        >>> times, values = np.array([0.0, 1.0, 1.0]), np.array([5.0, 3.0, 3.0])
        >>> one_record(times, values, None, "log.mf4, 'a'")
        (array([0, 1]), '')
        >>> one_record(times, np.array([5.0, 3.0, -3.0]), "last", "log.mf4, 'a'")
        (array([0, 2]), "log.mf4, 'a': the last of 2 different records at 1 s counts")
    """
    same = same_as_before(times)
    if not same.any():
        return np.arange(len(times)), ""
    before, after = values[:-1], values[1:]
    unequal = before != after
    if values.dtype.kind == "f":
        unequal &= ~(np.isnan(before) & np.isnan(after))
    starts = np.append(True, ~same)
    group = np.cumsum(starts) - 1
    differing = np.unique(group[1:][same & unequal])
    at = times if seconds is None else seconds
    ends = np.append(~same, True)
    if not len(differing):
        return np.nonzero(starts)[0], ""
    (first,) = np.nonzero(starts)
    place = int(first[differing[0]])
    count = int((group == differing[0]).sum())
    if choice is None:
        change = place + int((same & unequal)[place:].argmax())
        more = f" (and at {counted(len(differing) - 1, 'more time')})" * (len(differing) > 1)
        way = "; choose with --same-time first or --same-time last"
        if len(differing) >= _ROUNDED and 2 * len(differing) > len(first):
            way = ", as if times were rounded. Write times that tell the records apart."
        raise InputError(
            f"{what}: expected one value at {_text(at[place])} s, got {number(values[change])} and "
            f"{number(values[change + 1])}{more}{way}"
        )
    more = f" and at {counted(len(differing) - 1, 'more time')}" * (len(differing) > 1)
    note = f"the {choice} of {count} different records at {_text(at[place])} s{more} counts"
    return np.nonzero(starts if choice == "first" else ends)[0], f"{what}: {note}"


def common_instants(columns: list[Floats]) -> Floats:
    """Return all times of several signals, with one time for each instant, in order."""
    times = np.unique(np.concatenate([*columns, np.zeros(0)]))
    return times[np.append(True, ~same_as_before(times))] if len(times) else times


def _text(seconds: float) -> str:
    return f"{seconds:.9g}"
