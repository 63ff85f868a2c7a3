"""What the values of variables keep to on every trace: ranges, and how fast they change."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from rtamt.checking.graph import Graph, TermKey, Truth
from rtamt.errors import Argument, InputError, InputTypeError
from rtamt.language.ranges import range_text

__all__ = ["ValueRange", "VariableLimits", "checked_rates"]

ValueRange = tuple[float, float]


@dataclass(frozen=True, slots=True)
class VariableLimits:
    """What the values of variables keep to.

    Attributes:
        ranges: The least and the greatest value of variables.
        rates: How much variables change at least and at most in a second, or in a sample if there
            is no period.
        period: Seconds between samples, or None.
        steps: How much variables change at least and at most from one sample to the next.
    """

    ranges: Mapping[str, ValueRange] = field(default_factory=dict)
    rates: Mapping[str, ValueRange] = field(default_factory=dict)
    period: Fraction | None = None
    steps: Mapping[str, ValueRange] = field(init=False)

    def __post_init__(self) -> None:
        steps = {name: _per_sample(rate, self.period) for name, rate in self.rates.items()}
        object.__setattr__(self, "steps", steps)

    def of(self, variables: Iterable[str]) -> list[str]:
        """The limits of some variables in words, in the order of `truths`."""
        names = dict.fromkeys(variables)
        unit = " per sample" if self.period is None else " per second"
        return [
            *(
                f"declared: {name} in {range_text(self.ranges[name])}"
                for name in names
                if name in self.ranges
            ),
            *(
                f"rate: {name} in {range_text(self.rates[name])}{unit}"
                for name in names
                if name in self.rates
            ),
        ]

    def truths(
        self,
        graph: Graph,
        variables: Iterable[str],
        times: Sequence[int],
        loop: int,
        room: float = 0.0,
    ) -> list[Truth]:
        """Whether each limit of some variables is kept.

        Args:
            graph: Where truths are made.
            variables: The variables.
            times: The samples at which values may change, in order.
            loop: How many of the last samples repeat for ever; 0: they end.
            room: The share of a step that is left free at both of its ends.
        """
        names = dict.fromkeys(variables)
        pairs = [*itertools.pairwise(times)]
        if loop:
            pairs.append((times[-1], times[-loop]))
        return [
            *(
                graph.all(part for time in times for part in self._ranged(graph, name, time))
                for name in names
                if name in self.ranges
            ),
            *(
                graph.all(
                    part for pair in pairs for part in self._stepped(graph, name, *pair, room)
                )
                for name in names
                if name in self.steps
            ),
        ]

    def _ranged(self, graph: Graph, name: str, time: int) -> list[Truth]:
        return _between(graph, ("load", name, time), self.ranges[name])

    def _stepped(self, graph: Graph, name: str, time: int, after: int, room: float) -> list[Truth]:
        step = ("minus", ("load", name, after), ("load", name, time))
        least, most = self.steps[name]
        if room and not least == -most == -math.inf:
            wide = min(abs(x) for x in (least, most, most - least) if math.isfinite(x))
            least, most = least + room * wide, most - room * wide
        return _between(graph, step, (least, most))

    def kept(self, columns: Mapping[str, Sequence[float]], loop: int) -> bool:
        """Whether values keep all limits; what repeats keeps them too where it begins again."""
        for name, (lower, upper) in self.ranges.items():
            if not all(lower <= value <= upper for value in columns.get(name, ())):
                return False
        for name, (least, most) in self.steps.items():
            values = [*columns.get(name, ())]
            if loop:
                values.append(values[-loop])
            for before, after in itertools.pairwise(values):
                if before != after or not least <= 0 <= most:
                    if not (math.isfinite(before) and math.isfinite(after)):
                        return False
                    if not least <= Fraction(after) - Fraction(before) <= most:
                        return False
        return True


def _between(graph: Graph, term: TermKey, bounds: ValueRange) -> list[Truth]:
    lower, upper = bounds
    kept = []
    if lower > -math.inf:
        kept.append(graph.atom(("at_least", term, ("const", lower))))
    if upper < math.inf:
        kept.append(graph.atom(("at_least", ("const", upper), term)))
    return kept


def _per_sample(rate: ValueRange, period: Fraction | None) -> ValueRange:
    """How much a variable changes at least and at most from one sample to the next."""
    lower, upper = (
        each if period is None or math.isinf(each) else float(Fraction(each) * period)
        for each in rate
    )
    return lower, upper


def checked_rates(
    rates: Mapping[str, ValueRange] | None, variables: Iterable[str]
) -> dict[str, ValueRange]:
    """Rates whose variables there are, as pairs of numbers.

    Raises:
        InputError: If a variable is in no specification, or a rate is no pair of numbers, the
            lower one first.
        InputTypeError: If they are no mapping.
    """
    if rates is None:
        return {}
    if not isinstance(rates, Mapping):
        raise InputTypeError(
            Argument("rates"), f" expected a mapping of variables, got {type(rates).__name__}"
        )
    known = [*dict.fromkeys(variables)]
    checked = {}
    for name, rate in rates.items():
        if name not in known:
            has = ", ".join(known) or "none"
            msg = f" expected variables of the specification, which are {has}, got '{name}'"
            raise InputError(Argument("rates"), msg)
        try:
            lower, upper = map(float, rate)
        except (TypeError, ValueError):
            lower, upper = math.nan, math.nan
        if not lower <= upper or lower == math.inf or upper == -math.inf:
            msg = f" '{name}': expected (lower, upper) with lower <= upper, got {rate!r}"
            raise InputError(Argument("rates"), msg)
        checked[name] = lower, upper
    return checked
