"""A check during the first episodes whether a clip hides robustness from a learner."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rtamt_gym.shaping import Shaping
from rtamt_gym.signals.columns import Entries, Floats

EPISODES = 10
"""The number of episodes that are checked."""

_BLOCK = 1000
"""The number of values of a specification that are counted together."""


class _Watch:
    """Watches the samples of all environments until ten episodes have ended.

    An infinite robustness does not count, because no clip could show it. A step only stores its
    values, which are counted in blocks. The value of a specification is a number, or an array with
    an element for each environment, which the caller must not change.
    """

    def __init__(self, num: int) -> None:
        self._all = np.ones(num, np.bool_)
        self._running = np.zeros(num, np.bool_)
        self._episodes = 0
        self._stored: list[Sequence[Any]] = []
        self._most = max(1, _BLOCK // num)

    @property
    def finished(self) -> bool:
        """Whether ten episodes have ended."""
        return self._episodes >= EPISODES

    def reset(self, values: Sequence[Any], entries: Entries | None = None) -> None:
        """Watch the first samples of the environments in the mask; None: of all.

        A running episode has ended without a last sample.
        """
        self._count_stored()
        started = self._all if entries is None else entries
        self._episodes += int(np.count_nonzero(self._running & started))
        if not self.finished:
            self._running = self._running | started
            self._count([np.atleast_1d(column)[started] for column in values], last=False)

    def step(self, values: Sequence[Any]) -> None:
        """Watch a sample of every environment."""
        self._stored.append(values)
        self._running = self._all
        if len(self._stored) >= self._most:
            self._count_stored()

    def end(self, values: Sequence[Any], ended: Entries | None = None) -> None:
        """Watch the ends of the episodes in the mask in the newest step; None: of all."""
        entries = self._all if ended is None else ended
        self._count_stored()
        self._count([np.atleast_1d(column)[entries] for column in values], last=True)
        self._episodes += int(np.count_nonzero(entries))
        self._running = ~entries

    def _count_stored(self) -> None:
        if self._stored:
            columns = zip(*self._stored, strict=True)
            self._count([np.ravel(column) for column in columns], last=False)
            self._stored = []

    def _count(self, values: Sequence[Floats], *, last: bool) -> None:
        """Count samples; ``last``: the last samples of episodes, which were counted already."""
        raise NotImplementedError


class _Extent:
    """The finite numbers so far, and how many of them a bound clips."""

    def __init__(self, bound: float) -> None:
        self.bound = bound
        self.seen = self.clipped = self.below = 0
        self.low, self.high = math.inf, -math.inf

    def add(self, numbers: Floats) -> None:
        finite = numbers[np.isfinite(numbers)]
        if len(finite):
            self.seen += len(finite)
            self.clipped += int(np.count_nonzero(np.abs(finite) > self.bound))
            self.below += int(np.count_nonzero(finite < -self.bound))
            self.low = min(self.low, finite.min())
            self.high = max(self.high, finite.max())

    @property
    def advice(self) -> str:
        """The range of the numbers, and a clip that shows them."""
        return (
            f"it ranged from {self.low:.3g} to {self.high:.3g}; take a clip= about that range, "
            f"such as clip={max(-self.low, self.high):.3g}"
        )


class ClipWatch(_Watch):
    """Counts the samples of the first episodes where the clip flattens the reward.

    ``mode="terminal"`` pays at the last samples of episodes only, so only these count.
    """

    def __init__(self, shaping: Shaping, num: int) -> None:
        super().__init__(num)
        self._shaping = shaping
        self._extent = _Extent(shaping.clip)

    @property
    def report(self) -> str | None:
        """The warning; None if the clip changes at most 9 of 10 values and raises at most half.

        Below -clip, a step towards satisfaction does not change the reward.
        """
        extent, bound = self._extent, self._extent.bound
        if 10 * extent.clipped > 9 * extent.seen:
            count, where = extent.clipped, f"outside of [-{bound:g}, {bound:g}]"
        elif 2 * extent.below > extent.seen:
            count = extent.below
            where = f"below -{bound:g}, where no step towards satisfaction shows"
        else:
            return None
        return (
            f"clip={bound:g} flattens the reward: at {count} of {extent.seen} samples of the first "
            f"episodes the robustness that decides it was {where}; {extent.advice}, or weights= "
            "that bring the robustness inside"
        )

    def _count(self, values: Sequence[Floats], *, last: bool) -> None:
        if last is self._shaping.pays_episode:
            self._extent.add(self._shaping.deciding(values))


class ObservedWatch(_Watch):
    """Counts the samples of the first episodes where the clip flattens the observation."""

    def __init__(
        self, observe: str, names: Sequence[str], weights: Sequence[float], bound: float, num: int
    ) -> None:
        super().__init__(num)
        self._observe, self._names, self._weights = observe, names, weights
        self._extents = [_Extent(bound) for _ in names]

    @property
    def report(self) -> str | None:
        """The warning about the specification that is clipped most; None if at most half is.

        A policy sees the robustness itself, so half of the samples are too many.
        """
        pairs = zip(self._names, self._extents, strict=True)
        name, extent = max(pairs, key=lambda pair: pair[1].clipped / max(pair[1].seen, 1))
        if 2 * extent.clipped <= extent.seen:
            return None
        bound = extent.bound
        return (
            f"clip={bound:g} flattens the values of observe={self._observe!r}: at {extent.clipped} "
            f"of {extent.seen} samples of the first episodes the robustness of {name!r} was "
            f"outside of [-{bound:g}, {bound:g}], where the observation is the same; "
            f"{extent.advice}"
        )

    def _count(self, values: Sequence[Floats], *, last: bool) -> None:
        if not last:
            for extent, column, weight in zip(self._extents, values, self._weights, strict=True):
                extent.add(column * weight)
