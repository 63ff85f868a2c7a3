"""How a sample comes to the monitors of a panel: in one call of C++, or one after the other."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import rtamt
from rtamt import EpisodeMonitor, Verdict
from rtamt_gym.signals.signals import ElementRead, MovingRead, Read, SlotRead

__all__ = ["Assessment", "Fed", "Feed", "Take", "joint_read", "one_by_one"]

Assessment = tuple[float, float, float]
"""Robustness of the samples so far, and the lower and upper bound of what it can become."""

Feed = Callable[..., Assessment]
"""Feeds one sample to the monitors of a panel; takes the arguments of a `Read`."""

Take = Callable[..., object]
"""A `Feed` whose result nobody looks at."""

_Pick = Callable[[Sequence[float]], tuple[float, ...]]


class Fed(Protocol):
    """Whose monitors are fed.

    Attributes:
        settled: How many verdicts are decided.
        number: The class of the numbers of an `Assessment`.
    """

    settled: int
    number: type[float]

    def read(self) -> Assessment:
        """Reads robustness, lower and upper bound of the samples so far."""


def joint_read(read: Read) -> rtamt.JointRead:
    """What reads the signal in C++: without a call, where it is known what is read."""
    if isinstance(read, ElementRead):
        key: int | str | tuple[int, ...] = read.index
        return key
    if isinstance(read, MovingRead):
        read = read.now()
    if isinstance(read, SlotRead):
        return read.array, read.index
    return read


def one_by_one(  # noqa: C901 - each part in a function of its own would double its time
    parts: Sequence[tuple[Callable[..., float], int, _Pick | None, EpisodeMonitor]],
    size: int,
    reads: Sequence[Read] | None,
    fed: Fed,
    note: Callable[[], None],
    see: Callable[[Sequence[float]], None] | None,
) -> Feed:
    """Makes the function that reads a sample and feeds one monitor after the other.

    It gives what `rtamt.joint_feed` does, for all monitors.

    Args:
        parts: Of each monitor its update, the place of its only variable or -1 and what picks
            several, and the judge.
        size: How many values a sample has.
        reads: What reads each of them; None: the first argument is the sample itself.
        fed: Whose monitors they are.
        note: Called after a sample that has decided a verdict.
        see: Called with the values of every sample that all monitors have taken in.
    """
    numbered = list(enumerate(reads or ()))
    elements = [(i, read.index) for i, read in numbered if isinstance(read, ElementRead)]
    others = [(i, read) for i, read in numbered if not isinstance(read, ElementRead)]
    read_values = [math.nan] * size
    number, undecided = fed.number, Verdict.UNDECIDED

    def feed(  # noqa: C901 - see above
        obs: Any = None,  # noqa: ANN401
        action: Any = None,  # noqa: ANN401
        reward: Any = None,  # noqa: ANN401
        info: Any = None,  # noqa: ANN401
    ) -> Assessment:
        if reads is None:
            values = obs
        else:
            values = read_values
            for place, index in elements:
                values[place] = float(obs[index])
            for place, read in others:
                values[place] = read(obs, action, reward, info)
        robustness = lower = upper = math.inf
        decided = 0
        for update, alone, pick, judge in parts:
            value = update(values[alone]) if pick is None else update(*pick(values))
            low = judge.lower
            high = judge.upper
            # Calls of min() would cost as much as all the rest.
            if value < robustness:  # noqa: PLR1730
                robustness = value
            if low < lower:  # noqa: PLR1730
                lower = low
            if high < upper:  # noqa: PLR1730
                upper = high
            if judge.verdict is not undecided:
                decided += 1
        if decided > fed.settled:
            note()
        if see is not None:
            see(values)
        if not (robustness and lower and upper):  # comparisons do not see the sign of a zero
            return fed.read()
        return number(robustness), number(lower), number(upper)

    return feed
