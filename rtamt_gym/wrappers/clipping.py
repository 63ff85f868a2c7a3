"""Whether a clip hides what robustness could tell a learner: the first episodes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from rtamt_gym.shaping import Shaping
from rtamt_gym.signals.columns import Floats, Lanes

__all__ = ["ClipWatch", "ObservedWatch", "flattening"]

EPISODES = 10
"""How many episodes are looked at."""

_BLOCK = 1000
"""How many numbers of a specification are kept until they are counted."""


class _Watch:
    """Looks at the samples of all environments until ten episodes have ended, in whichever of them.

    An infinite robustness does not count: no clip could show it. A step only keeps its values,
    which are counted in blocks. For each specification they are a number, or an array with an
    element for each environment that the caller does not change.
    """

    def __init__(self, num: int) -> None:
        self._all = np.ones(num, np.bool_)
        self._running = np.zeros(num, np.bool_)
        self._episodes = 0
        self._kept: list[Sequence[Any]] = []
        self._most = max(1, _BLOCK // num)

    @property
    def finished(self) -> bool:
        """Whether ten episodes have ended."""
        return self._episodes >= EPISODES

    def reset(self, values: Sequence[Any], lanes: Lanes | None = None) -> None:
        """Sees the first samples of the environments of the mask; None: of all.

        An episode that was running has ended without a last sample.
        """
        self._count_kept()
        begun = self._all if lanes is None else lanes
        self._episodes += int(np.count_nonzero(self._running & begun))
        if not self.finished:
            self._running = self._running | begun
            self._count([np.atleast_1d(each)[begun] for each in values], last=False)

    def step(self, values: Sequence[Any]) -> None:
        """Sees a sample of every environment."""
        self._kept.append(values)
        self._running = self._all
        if len(self._kept) >= self._most:
            self._count_kept()

    def end(self, values: Sequence[Any], ended: Lanes | None = None) -> None:
        """Sees that the newest step has ended the episodes of the mask; None: of all."""
        lanes = self._all if ended is None else ended
        self._count_kept()
        self._count([np.atleast_1d(each)[lanes] for each in values], last=True)
        self._episodes += int(np.count_nonzero(lanes))
        self._running = ~lanes

    def _count_kept(self) -> None:
        if self._kept:
            columns = zip(*self._kept, strict=True)
            self._count([np.ravel(column) for column in columns], last=False)
            self._kept = []

    def _count(self, values: Sequence[Floats], *, last: bool) -> None:
        """Counts samples; ``last``: the last ones of episodes, which were counted already."""
        raise NotImplementedError


class _Extent:
    """The finite numbers that were seen, and how many of them a bound clips."""

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


class ClipWatch(_Watch):
    """Counts over the first episodes at how many samples the clip flattens the reward.

    With ``mode="terminal"`` the last samples of episodes count alone, as no other is paid.

    Args:
        shaping: What makes the reward of the robustness.
        num: The number of environments.
    """

    def __init__(self, shaping: Shaping, num: int) -> None:
        super().__init__(num)
        self._shaping = shaping
        self._extent = _Extent(shaping.clip)

    @property
    def report(self) -> str | None:
        """What is to be said of the samples seen; None if the clip does not flatten."""
        found = self._extent
        counts = found.seen, found.clipped, found.below
        return flattening(*counts, found.low, found.high, found.bound)

    def _count(self, values: Sequence[Floats], *, last: bool) -> None:
        if last is (self._shaping.mode == "terminal"):
            self._extent.add(self._shaping.deciding(values))


class ObservedWatch(_Watch):
    """Counts over the first episodes at how many samples the clip flattens what is observed.

    Args:
        observe: The argument that asks for it.
        names: The names of the specifications.
        weights: A factor of the robustness of each.
        bound: To what their robustness is clipped.
        num: The number of environments.
    """

    def __init__(
        self, observe: str, names: Sequence[str], weights: Sequence[float], bound: float, num: int
    ) -> None:
        super().__init__(num)
        self._observe, self._names, self._weights = observe, names, weights
        self._extents = [_Extent(bound) for _ in names]

    @property
    def report(self) -> str | None:
        """What is to be said of the specification that is clipped most, if that is at most samples.

        A policy sees the robustness itself, so that half of the samples are too many.
        """
        pairs = zip(self._names, self._extents, strict=True)
        name, found = max(pairs, key=lambda each: each[1].clipped / max(each[1].seen, 1))
        if 2 * found.clipped <= found.seen:
            return None
        bound = found.bound
        return (
            f"clip={bound:g} flattens what observe={self._observe!r} appends: at {found.clipped} "
            f"of {found.seen} samples of the first episodes the robustness of {name!r} was outside "
            f"of [-{bound:g}, {bound:g}], where the observation is the same; it ranged from "
            f"{found.low:.3g} to {found.high:.3g}; take a clip= about that range, such as "
            f"clip={max(-found.low, found.high):.3g}"
        )

    def _count(self, values: Sequence[Floats], *, last: bool) -> None:
        if not last:
            for extent, column, weight in zip(self._extents, values, self._weights, strict=True):
                extent.add(column * weight)


def flattening(
    seen: int, clipped: int, below: int, low: float, high: float, bound: float
) -> str | None:
    """What to say to a user whose clip hides what robustness could tell a learner.

    Args:
        seen: How many values of `Shaping.deciding` were seen, infinite ones not counted.
        clipped: How many of them the clip changes: ``abs(value) > bound``.
        below: How many of these are negative: a step towards satisfaction changes no reward there.
        low: The least of them.
        high: The greatest of them.
        bound: The bound to which the robustness is clipped.

    Returns:
        The warning; None if the clip changes at most 9 of 10 values, and raises at most half.

    Example:
        >>> print(flattening(seen=200, clipped=190, below=0, low=0.5, high=48.0, bound=1.0))
        clip=1 flattens the reward: at 190 of 200 samples of the first episodes the robustness
        that decides it was outside of [-1, 1]; it ranged from 0.5 to 48; take a clip= about that
        range, such as clip=48, or weights= that bring the robustness inside
        >>> flattening(seen=200, clipped=180, below=100, low=-1.5, high=48.0, bound=1.0)
        >>> print(flattening(seen=200, clipped=101, below=101, low=-1.8, high=0.5, bound=1.0))
        clip=1 flattens the reward: at 101 of 200 samples of the first episodes the robustness
        that decides it was below -1, where no step towards satisfaction shows; it ranged from
        -1.8 to 0.5; take a clip= about that range, such as clip=1.8, or weights= that bring the
        robustness inside
    """
    if 10 * clipped > 9 * seen:
        count, where = clipped, f"outside of [-{bound:g}, {bound:g}]"
    elif 2 * below > seen:
        count, where = below, f"below -{bound:g}, where no step towards satisfaction shows"
    else:
        return None
    return (
        f"clip={bound:g} flattens the reward: at {count} of {seen} samples of the first episodes "
        f"the robustness that decides it was {where}; it ranged from "
        f"{low:.3g} to {high:.3g}; take a clip= about that range, such as "
        f"clip={max(-low, high):.3g}, or weights= that bring the robustness inside"
    )
