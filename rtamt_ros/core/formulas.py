"""The named formulas of a requirement for which no monitor can wait as a whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from rtamt import EpisodeMonitor, Monitor, Specification, SpecificationError

__all__ = ["Formulas"]


class Formulas:
    """Gives the robustness of every named formula by itself.

    `Monitor` gives it, late by the latency of the formula. Where the formula has an unbounded
    future inside, for which no monitor can wait, `EpisodeMonitor` gives the robustness if the run
    ended now.

    Args:
        specification: The requirement.
        variables: The order of the values of a sample.
        options: The options of the monitors.

    Attributes:
        values: The robustness of every named formula with the last sample.
        latencies: Samples by which the value of every named formula is late.
    """

    def __init__(
        self, specification: Specification, variables: Sequence[str], options: Mapping[str, Any]
    ) -> None:
        self.values: dict[str, float] = {}
        self._monitors: dict[str, tuple[Monitor | EpisodeMonitor, list[int]]] = {}
        self._result: list[str] = []
        for name, formula in specification.formulas.items():
            if formula is specification.formula:
                self._result.append(name)
                continue
            monitor = _monitor(
                replace(specification, formula=formula, formulas={}, uses={}), options
            )
            places = [variables.index(each) for each in monitor.variables]
            self._monitors[name] = monitor, places
        self.latencies = dict.fromkeys(self._result, 0) | {
            name: monitor.latency if isinstance(monitor, Monitor) else 0
            for name, (monitor, _) in self._monitors.items()
        }

    def update(self, sample: Sequence[float], robustness: float) -> None:
        """Take in a sample, with which the requirement has this robustness.

        Raises:
            InputError: If a term is no number.
        """
        self.values = dict.fromkeys(self._result, robustness)
        for name, (monitor, places) in self._monitors.items():
            self.values[name] = monitor.update(*[sample[place] for place in places])

    def reset(self) -> None:
        """Forget every sample."""
        for monitor, _ in self._monitors.values():
            monitor.reset()


def _monitor(specification: Specification, options: Mapping[str, Any]) -> Monitor | EpisodeMonitor:
    try:
        return Monitor(specification, **options)
    except SpecificationError:  # an unbounded future inside the formula
        return EpisodeMonitor(specification, **options)
