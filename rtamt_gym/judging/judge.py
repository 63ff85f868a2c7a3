"""Specifications of a run: compiled once for many runs, and the values of their monitors."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import TYPE_CHECKING, Any, NamedTuple

from rtamt import Specification, Verdict
from rtamt.monitors import Evidence, Implications, TriggerCount
from rtamt.typing import End
from rtamt_gym.judging.monitor_set import Monitors, MonitorSet
from rtamt_gym.options.evaluation import AtTermination, EvaluationOptions
from rtamt_gym.signals.signals import SignalLike

if TYPE_CHECKING:
    from rtamt_gym.live.track import Track


class Judging(NamedTuple):
    """The specifications of a run, the signals that a call sets, and the evaluation options."""

    specs: Mapping[str, Specification]
    signals: Mapping[str, SignalLike] | None
    reading: EvaluationOptions


class TriggerCounter:
    """Counts how often runs trigger the implications of specifications.

    It is false without an implication: then no samples need to be kept.

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

        ``samples`` are the values of each variable, n of them or by default all; they may be empty
        without an implication. ``end`` is None if the run was stopped.
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
        period: Seconds between samples; None if bounds count samples.
        trigger_counter: Counts how often runs trigger the specifications.

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


class MonitorSetValues:
    """The values of a monitor set as read-only attributes: the base of `rtamt_gym.StepMonitor`.

    It is separate, because modules that recognize such a monitor run without MuJoCo too.
    """

    monitor_set: MonitorSet
    _live: Track | None = None

    @property
    def shown_live(self) -> bool:
        """True if a live view shows the samples."""
        return self._live is not None

    @property
    def robustness(self) -> float:
        """The minimum robustness over all specifications if the run ended now.

        It is nan before sample 0. With ``view="step"`` it is the minimum robustness at the newest
        instant with a complete horizon.
        """
        return self.monitor_set.robustness

    @property
    def lower(self) -> float:
        """The lower bound of the robustness."""
        return self.monitor_set.lower

    @property
    def upper(self) -> float:
        """The upper bound of the robustness; negative, -0.0 included: a violation is certain."""
        return self.monitor_set.upper

    @property
    def verdict(self) -> Verdict:
        """The verdict on all specifications together."""
        return min(judge.verdict for _, judge in self.monitor_set.monitors.values())

    @property
    def violated_by(self) -> str | None:
        """The specification that was violated first; None without a violation."""
        return self.monitor_set.violated_by

    @property
    def violated_at(self) -> int | None:
        """The sample that showed the first violation; None without a violation."""
        return self.monitor_set.violated_at

    @property
    def samples(self) -> int:
        """The number of samples since the reset, including sample 0."""
        return self.monitor_set.samples

    @property
    def period(self) -> Fraction | None:
        """Time between samples, in seconds."""
        return self.monitor_set.period

    @property
    def details(self) -> dict[str, dict[str, Any]]:
        """``{spec: {"robustness", "lower", "upper", "verdict"}}`` of the samples so far."""
        return self.monitor_set.describe()

    @property
    def outcomes(self) -> dict[str, dict[str, Any]]:
        """``{spec: {"robustness", "verdict", "satisfied", "decided_at"}}`` of the samples so far.

        ``decided_at`` is the sample that decided the verdict; it is absent while the verdict is
        open. If only the end decided it, ``ended_at`` is the last sample.
        """
        return self.monitor_set.outcomes()

    @property
    def monitors(self) -> Monitors:
        """The monitors of each specification: ``(robustness source, judge)``."""
        return dict(self.monitor_set.monitors)
