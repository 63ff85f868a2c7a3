"""A recorded trace under a specification: the verdict, and where the named formulas fail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

import rtamt
from rtamt import SpecificationError, Verdict
from rtamt_gym.tables import moment, number, shorten, table
from rtamt_gym.trace import Trace

__all__ = ["Judgement", "Row", "judge"]


@dataclass(frozen=True, slots=True)
class Row:
    """What became of one formula.

    Attributes:
        name: Its name.
        robustness: At the first sample.
        least: The least over all samples.
        least_at: The sample of the least robustness.
        below_at: The first sample of negative robustness, or None.
    """

    name: str
    robustness: float
    least: float
    least_at: int
    below_at: int | None

    @classmethod
    def of(cls, name: str, values: NDArray[np.float64]) -> Row:
        """The row of a formula of these robustness values."""
        below = values < 0
        least_at = int(values.argmin())
        return cls(
            name,
            float(values[0]),
            float(values[least_at]),
            least_at,
            int(below.argmax()) if below.any() else None,
        )


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdict on a whole trace.

    Attributes:
        verdict: The sign of the robustness; UNDECIDED if that is 0.
        robustness: Of the trace, which ends with its last sample.
        certain_at: The sample from which the verdict was certain whatever came; None if only the
            end of the trace decided it.
        rows: The named formulas, the last of which is the result.
        trace: The samples.
        period: Seconds between samples, or None.
        view: What was judged.
    """

    verdict: Verdict
    robustness: float
    certain_at: int | None
    rows: Sequence[Row]
    trace: Trace
    period: Fraction | None
    view: str

    def lines(self) -> list[str]:
        """The judgement in words and a table."""
        certain = "at the end of the trace"
        if self.certain_at is not None:
            certain = f"certain from {self._at(self.certain_at)} on"
        pace = "bounds count samples" if self.period is None else self._pace()
        cells = [("formula", "at the start", "least", "at", "below 0 from")]
        cells += [
            (
                shorten(row.name, 30),
                number(row.robustness),
                number(row.least),
                self._at(row.least_at),
                "-" if row.below_at is None else self._at(row.below_at),
            )
            for row in self.rows
        ]
        return [
            f"{self.verdict.name}, robustness {number(self.robustness)}, {certain}",
            f"{self.trace.source}: {_count(self.trace.samples)}, {pace}",
            "",
            *table(cells, "<>>>>"),
        ]

    def _at(self, sample: int) -> str:
        return moment(sample, self.period, self.trace.start)

    def _pace(self) -> str:
        period = self.period or Fraction(0)
        last = moment(self.trace.samples - 1, self.period, self.trace.start)
        return f"one every {number(float(period))} s, {self._at(0)} to {last}"


def judge(
    spec: rtamt.Specification,
    trace: Trace,
    period: str | Fraction | None = None,
    view: str = "episode",
) -> Judgement:
    """Judges a trace that ends with its last sample.

    Args:
        spec: The specification.
        trace: The samples.
        period: Seconds between samples, or text with a unit; None reads the column of times.
        view: ``"episode"``: the formula speaks of the first sample, and through its operators of
            what follows; ``"step"``: of every sample, as ``always(formula)`` does.

    Raises:
        SpecificationError: If a bound is not a multiple of the period, or if the formula says
            nothing of any sample but the first and ``view`` is ``"episode"``.
        InputError: If the times of the trace do not go up in even steps.
    """
    if period is None:
        period = trace.period()
    if period is None and trace.times is not None and spec.timed:
        raise SpecificationError(
            f"{trace.source}: expected at least two samples to read the period from, got one; "
            "give period= in seconds"
        )
    monitor = rtamt.EpisodeMonitor(spec, period)
    period = monitor.period
    if view == "step":
        monitor = rtamt.EpisodeMonitor(spec.always(), period)
    elif not spec.looks_ahead:
        raise SpecificationError(
            f"the specification speaks of the first sample only: {spec.formula}; "
            f"write always({spec.formula}) or view='step'"
        )
    certain_at = _feed(monitor, trace)
    robustness = monitor.finish()
    verdict = monitor.verdict
    formulas = dict(spec.formulas)
    if spec.formula not in formulas.values():
        formulas["(result)"] = spec.formula
    rows = [
        Row.of(name, rtamt.evaluate(formula, trace.columns, period, n=trace.samples))
        for name, formula in formulas.items()
    ]
    return Judgement(verdict, robustness, certain_at, rows, trace, period, view)


def _feed(monitor: rtamt.EpisodeMonitor, trace: Trace) -> int | None:
    """Feeds all samples; the first at which the verdict was certain."""
    columns = [trace.columns[name].tolist() for name in monitor.variables]
    samples = zip(*columns, strict=True) if columns else iter([()] * trace.samples)
    for at, sample in enumerate(samples):
        monitor.update(*sample)
        if monitor.verdict != Verdict.UNDECIDED:
            for later in samples:
                monitor.update(*later)
            return at
    return None


def _count(samples: int) -> str:
    return "1 sample" if samples == 1 else f"{samples} samples"
