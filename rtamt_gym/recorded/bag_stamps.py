"""The messages of a bag that count by the stamps in their headers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError
from rtamt.internal import StampOrder
from rtamt_gym.recorded.bag_reader import Bag
from rtamt_gym.recorded.sampling import Stamps
from rtamt_gym.tables import counted


def span(stamps: Sequence[int], logged: Sequence[int]) -> Iterable[int]:
    """Return the first and the last stamp of a topic, without strays."""
    order = StampOrder()
    kept = [
        each.stamp
        for stamp, time in zip(stamps, logged, strict=True)
        for each in order.take(stamp, time, None)
    ]
    return min(kept), max(kept)


def in_line(
    bag: Bag, topic: str, stamps: Stamps, logged: Stamps, notes: list[str]
) -> NDArray[np.intp]:
    """Return the places of the messages that count by their stamps, in order of recording."""
    by_log = np.argsort(logged, kind="stable")
    order, kept = StampOrder(), list[int]()
    largest = 0
    for position in by_log.tolist():
        for each in order.take(int(stamps[position]), int(logged[position]), position):
            kept.append(each.message)
            largest = max(largest, each.offset)
            if each.jump:
                size = f"{abs(each.jump) / 1e9:.6g} s"
                jump = (
                    f"that is {size} older than the one before it"
                    if each.jump < 0
                    else f"that jumps ahead of the recording by {size}"
                )
                raise InputError(
                    f"{bag.source}: expected stamps of {topic} that increase, got one {jump}, in "
                    f"message {each.message + 1} of {len(stamps)}: the clock restarted; cut the "
                    "bag there, or give --time log"
                )
    strays = order.strays + (order.held is not None)
    if strays > len(kept):
        raise InputError(
            f"{bag.source}: expected stamps of {topic} from a clock as fast as the recording, got "
            f"{counted(strays, 'message')} of {len(stamps)} out of line; give --time log"
        )
    if order.late:
        notes.append(
            f"{topic}: {counted(order.late, 'message')} older than the one before left out"
        )
    if strays:
        notes.append(
            f"{topic}: {counted(strays, 'message')} left out, more than 1 s out of line with the "
            "stamps before and after"
        )
    if order.ahead:
        most = round(largest / 1e9, 1)
        notes.append(
            f"{topic}: {counted(order.ahead, 'stamp')} up to {most:g} s ahead of the recording"
        )
    return np.array(kept, np.intp)
