"""How often the implications of a requirement were put to the test up to now."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast

from rtamt import Formula, Monitor, Specification, SpecificationError
from rtamt.program.implications import implications
from rtamt_ros.core.report import holds
from rtamt_ros.core.requirements import unbounded

__all__ = ["AskedCounts"]


class AskedCounts:
    """Counts the samples at which the left sides of implications hold for certain.

    Of implications that a requirement asks at every sample: ``always(p implies q)``, several joined
    by ``and``. They are counted as `rtamt.judge` counts them on the whole trace, a sample as
    soon as the latency of the left side has passed since.

    Args:
        specification: The requirement.
        variables: The order of the values of a sample.
        options: The period, and how bounds are aligned.

    Attributes:
        counts: For each implication, in the order of the text, its samples; None if nobody can
            count them: the requirement has none, or others too, a left side is about a future
            without an end, or not all values of a sample were known.
    """

    def __init__(
        self, specification: Specification, variables: Sequence[str], options: Mapping[str, Any]
    ) -> None:
        self._monitors: list[tuple[Monitor, list[int]]] = []
        formula = specification.formula
        found = list(dict.fromkeys(_asked_always(specification, formula, always=False)))
        self._countable = bool(found) and {*found} == {*implications(formula)}
        for each in implications(formula) if self._countable else ():
            left = replace(
                specification, formula=cast("Formula", each.args[0]), formulas={}, uses={}
            )
            try:
                monitor = Monitor(left, **options)
            except SpecificationError:  # an unbounded future
                self._countable = False
                break
            places = [variables.index(name) for name in monitor.variables]
            self._monitors.append((monitor, places))
        self.reset()

    def reset(self) -> None:
        """Forget every sample."""
        self.counts: tuple[int, ...] | None = None
        if self._countable:
            self.counts = (0,) * len(self._monitors)
        for monitor, _ in self._monitors:
            monitor.reset()

    def update(self, sample: Sequence[float]) -> None:
        """Take in a sample."""
        if self.counts is not None:
            found = [
                monitor.update(*[sample[place] for place in places])
                for monitor, places in self._monitors
            ]
            # nan: the latency of the left side has not passed yet.
            news = [value == value and holds(value) for value in found]  # noqa: PLR0124
            self.counts = tuple(map(sum, zip(self.counts, news, strict=True)))

    def stop(self) -> None:
        """Count no more, as values are not known."""
        self.counts = None


def _asked_always(specification: Specification, formula: Formula, *, always: bool) -> list[Formula]:
    """The implications that a formula asks at every sample."""
    name = "" if formula.op is None else formula.op.name
    parts = cast("Sequence[Formula]", formula.args)
    if name == "and":
        return [
            each for part in parts for each in _asked_always(specification, part, always=always)
        ]
    if not always and unbounded(specification, formula) == "always":
        return _asked_always(specification, parts[0], always=True)
    return [formula] if always and name == "implies" else []
