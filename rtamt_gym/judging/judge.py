"""What is judged and how; and `Judge`, which has checked and compiled it once for many runs."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import NamedTuple

import rtamt
from rtamt_gym.judging.panel import Panel
from rtamt_gym.judging.questions import Questions
from rtamt_gym.options.evaluation import Reading
from rtamt_gym.signals.signals import SignalLike

__all__ = ["Judge", "Judging"]


class Judging(NamedTuple):
    """What is judged and how.

    Attributes:
        specs: The specifications by name.
        signals: What their variables read, as far as it was given.
        reading: How samples are judged.
    """

    specs: Mapping[str, rtamt.Specification]
    signals: Mapping[str, SignalLike] | None
    reading: Reading


class Judge:
    """Specifications and how samples are judged, checked and compiled once for many runs.

    Attributes:
        specs: The specifications by name.
        reading: How samples are judged.
        variables: The names that the specifications read, each once.
        period: Seconds between samples; None where bounds count samples.
        questions: Counts how often runs put the specifications to the test.

    Args:
        specs: The specifications by name.
        reading: How samples are judged, with the period of the samples.

    Raises:
        SpecificationError: As `Panel` does.
        InputError: As `Panel` does.

    Example:
        >>> judge = Judge({"near": rtamt.parse("always(x < 1)")}, Reading())
        >>> panel = judge.begin()
        >>> panel.feeder(judge.variables)([2.0])
        (-1.0, -inf, -1.0)
        >>> judge.end(panel)
        >>> judge.begin() is panel, panel.samples
        (True, 0)
    """

    def __init__(self, specs: Mapping[str, rtamt.Specification], reading: Reading) -> None:
        self.specs, self.reading = specs, reading
        self.variables = tuple(
            dict.fromkeys(name for spec in specs.values() for name in spec.variables)
        )
        self._free = [Panel(specs, reading)]
        self.period: Fraction | None = self._free[0].period
        self.questions = Questions(specs, reading)

    def begin(self) -> Panel:
        """The monitors for a run that begins: taken from a run that is over, or new ones."""
        if not self._free:
            return Panel(self.specs, self.reading)
        panel = self._free.pop()
        panel.reset()
        return panel

    def end(self, panel: Panel) -> None:
        """Takes back the monitors of a run that is over and of which nobody reads any more."""
        self._free.append(panel)
