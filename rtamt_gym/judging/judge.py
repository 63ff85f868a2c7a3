"""Specifications that are checked and compiled once for many runs."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any, NamedTuple

from rtamt import Specification, Verdict
from rtamt.monitors import Evidence, Implications, TriggerCount
from rtamt.typing import End
from rtamt_gym.judging.monitor_set import MonitorSet
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions
from rtamt_gym.signals.signals import SignalLike


class Judging(NamedTuple):
    """The specifications of a run with their evaluation options.

    Attributes:
        specs: The specifications by name.
        signals: The signals of their variables that a call sets.
        reading: The evaluation options.
    """

    specs: Mapping[str, Specification]
    signals: Mapping[str, SignalLike] | None
    reading: EvaluationOptions


class TriggerCounter:
    """Counts how often runs trigger the implications of specifications.

    It is false without an implication: then no samples need to be kept.

    Args:
        specs: The specifications by name.
        reading: The evaluation options, with the period.

    Example:
        >>> import rtamt
        >>> specs = {"answered": rtamt.parse("always(req > 3 implies gnt > 3)")}
        >>> counter = TriggerCounter(specs, EvaluationOptions())
        >>> verdicts = {"answered": rtamt.Verdict.SATISFIED}
        >>> samples = {"req": [0.0, 5.0], "gnt": [0.0, 4.0]}
        >>> evidence = counter.evidence(samples, 2, "cut", verdicts)
        >>> evidence["answered"].triggers[0].count
        1
    """

    def __init__(self, specs: Mapping[str, Specification], reading: EvaluationOptions) -> None:
        step = reading.view == "step"  # the verdict is about every instant
        self._implications = {
            name: Implications(specs[name].always() if step else specs[name], **options)
            for name, options in reading.from_monitors(specs).items()
        }
        self._any = any(map(bool, self._implications.values()))
        self._without = {
            name: implications.evidence({}, verdict=Verdict.UNDECIDED)
            for name, implications in self._implications.items()
            if not implications
        }

    def __bool__(self) -> bool:
        return self._any

    def evidence(
        self,
        samples: Mapping[str, Any],
        n: int | None,
        end: AtTermination | End | None,
        verdicts: Mapping[str, Verdict],
    ) -> Mapping[str, Evidence[TriggerCount]]:
        """Return the evidence of the verdict on each specification.

        Args:
            samples: The values of every variable, by name; may be empty without an implication.
            n: The number of samples; None: the number of values.
            end: The end mode; None if the run was stopped.
            verdicts: The verdict on each specification.
        """
        if not self._any:
            return self._without
        # Nothing follows an end that is a failure.
        mode: End = "complete" if end == "failure" else end or "open"
        return {
            name: self._implications[name].evidence(samples, mode, verdict, n=n)
            for name, verdict in verdicts.items()
        }


class Judge:
    """Specifications and evaluation options, checked and compiled once for many runs.

    Attributes:
        specs: The specifications by name.
        reading: The evaluation options.
        variables: The variables of the specifications, without repetition.
        period: Seconds between samples; None if bounds count samples.
        trigger_counter: Counts how often runs trigger the specifications.

    Args:
        specs: The specifications by name.
        reading: The evaluation options, with the period of the samples.

    Example:
        >>> import rtamt
        >>> judge = Judge({"near": rtamt.parse("always(x < 1)")}, EvaluationOptions())
        >>> monitor_set = judge.begin()
        >>> monitor_set.feeder(judge.variables)([2.0])
        (-1.0, -inf, -1.0)
        >>> judge.end(monitor_set)
        >>> judge.begin() is monitor_set, monitor_set.samples
        (True, 0)
    """

    def __init__(self, specs: Mapping[str, Specification], reading: EvaluationOptions) -> None:
        self.specs, self.reading = specs, reading
        self.variables = tuple(
            dict.fromkeys(name for spec in specs.values() for name in spec.variables)
        )
        self._free = [MonitorSet(specs, reading)]
        self.period: Fraction | None = self._free[0].period
        self.trigger_counter = TriggerCounter(specs, reading)

    def begin(self) -> MonitorSet:
        """Return monitors for a run, reused from a finished run if possible."""
        if not self._free:
            return MonitorSet(self.specs, self.reading)
        monitor_set = self._free.pop()
        monitor_set.reset()
        return monitor_set

    def end(self, monitor_set: MonitorSet) -> None:
        """Take back the monitors of a finished run, for another run."""
        self._free.append(monitor_set)
