"""`Compared`: one requirement under two policies, with the significant differences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from rtamt_gym.evaluation.paired import Effect, mcnemar, tango
from rtamt_gym.results.intervals import IntervalKind, rate_interval
from rtamt_gym.results.statistics import SUCCESS
from rtamt_gym.tables import counted, p_text, short

LEVEL: Final = 0.05
"""Rates are called different if the adjusted p-value lies below."""


@dataclass(frozen=True)
class Compared:
    """One requirement in the episodes of two policies, A and B, with the same seeds.

    An episode that an error has ended, or that leaves the requirement open, does not satisfy it.

    Attributes:
        name: The name of the requirement.
        formula: Its text.
        both: With how many seeds both satisfy it.
        only_a: With how many A alone does.
        only_b: With how many B alone does.
        neither: With how many none does.
        interval_a: The 95 % interval of the rate of A, of the kind that its evaluation has.
        interval_b: The same of B.
        interval: The 95 % interval of Tango for the difference, `paired.tango`.
        p: The p-value of McNemar's exact test.
        adjusted: The same, adjusted by Holm's method for the number of requirements.
        robustness: The robustness of B minus the robustness of A, over seeds without a failure;
            None without such a seed.
    """

    name: str
    formula: str
    both: int
    only_a: int
    only_b: int
    neither: int
    interval_a: tuple[float, float]
    interval_b: tuple[float, float]
    interval: tuple[float, float]
    p: float
    adjusted: float
    robustness: Effect | None

    @property
    def pairs(self) -> int:
        """The number of seeds."""
        return self.both + self.only_a + self.only_b + self.neither

    @property
    def rate_a(self) -> float:
        """The share of seeds where A satisfies it."""
        return (self.both + self.only_a) / self.pairs

    @property
    def rate_b(self) -> float:
        """The share of seeds where B satisfies it."""
        return (self.both + self.only_b) / self.pairs

    @property
    def difference(self) -> float:
        """The rate of B minus the rate of A."""
        return (self.only_b - self.only_a) / self.pairs

    @property
    def shown(self) -> bool:
        """Whether a difference of the rates is shown: the adjusted p-value lies below 0.05."""
        return self.adjusted < LEVEL

    @property
    def sentence(self) -> str:
        """The significant differences of rates and robustness, in a sentence."""
        return self.sentence_of("episode")

    def sentence_of(self, noun: str) -> str:
        """Return the same with a word for a pair, such as ``"recording"``."""
        parts = [_rates(self, noun)]
        if self.robustness is not None:
            parts.append(effect_sentence(self.robustness, "its robustness"))
        return " ".join(parts)


def compared_of(
    name: str,
    formula: str,
    counts: Mapping[tuple[bool, bool], int],
    robustness: Effect | None,
    kinds: tuple[IntervalKind, IntervalKind] = ("exact", "exact"),
) -> Compared:
    """Return one requirement from the counts of joint results of A and B, A first.

    The kinds are the interval kinds of both rates.
    """
    both, neither = counts[True, True], counts[False, False]
    only_a, only_b = counts[True, False], counts[False, True]
    pairs = both + neither + only_a + only_b
    p = mcnemar(only_a, only_b)
    return Compared(
        name,
        formula,
        both,
        only_a,
        only_b,
        neither,
        rate_interval(both + only_a, pairs, kinds[0]),
        rate_interval(both + only_b, pairs, kinds[1]),
        tango(only_a, only_b, pairs),
        p,
        p,
        robustness,
    )


def _rates(compared: Compared, noun: str) -> str:
    name = SUCCESS if compared.name == SUCCESS else f"`{compared.name}`"
    gap, pairs = compared.difference, compared.pairs
    low, high = (points(end, pairs) for end in compared.interval)
    if compared.shown:
        ends = sorted(abs(end) for end in compared.interval)
        low, high = (points(end, pairs) for end in ends)
        return (
            f"B satisfies {name} in {counted_points(abs(gap), pairs)} "
            f"{'more' if gap > 0 else 'less'} of the {noun}s "
            f"(95%: {low} to {high}; {p_text(compared.adjusted)})."
        )
    start = f"No difference is shown for {name}:"
    if compared.only_a == compared.only_b == 0:
        agree = f"agree in the only {noun}" if pairs == 1 else f"agree in all {pairs} {noun}s"
        return f"{start} A and B {agree} (95%: {low} to {high} points)."
    return (
        f"{start} {counted_points(gap, pairs)}, {low} to {high} (95%; {p_text(compared.adjusted)})."
    )


def effect_sentence(effect: Effect, what: str) -> str:
    """Return the significant difference of a measurement, such as ``"the return"``, in words."""
    middle = "on average" if effect.statistic == "mean" else "in the median"
    low, high = effect.interval
    name = what[0].upper() + what[1:]
    if all(a == b for a, b in effect.pairs):
        return f"{name} is the same in each pair."
    if low > 0 or high < 0:
        ends = sorted(abs(end) for end in effect.interval)
        return (
            f"{name} is {short(abs(effect.value))} {'greater' if low > 0 else 'less'} "
            f"{middle} (95%: {short(ends[0])} to {short(ends[1])})."
        )
    if math.isinf(low) and math.isinf(high):
        return f"{counted(len(effect.pairs), 'pair')} can say nothing of {what}."
    return (
        f"No difference of {what} is shown: {short(effect.value)} {middle} "
        f"(95%: {short(low)} to {short(high)})."
    )


def points(share: float, pairs: int) -> str:
    """Return a difference of rates in percentage points, with tenths for 500 pairs or more.

    Example:
        >>> points(0.118, 100), points(-0.0043, 2000), points(-0.001, 100)
        ('12', '-0.4', '0')
    """
    digits = 1 if pairs >= 500 else 0
    rounded = round(100 * share, digits)
    return f"{rounded + 0.0:.{digits}f}"  # -0.0 becomes 0.0


def counted_points(share: float, pairs: int) -> str:
    """Return the same with its unit: ``1 point``, ``12 points``."""
    text = points(share, pairs)
    return f"{text} {'point' if text in {'1', '-1'} else 'points'}"
