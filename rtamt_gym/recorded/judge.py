"""Judges recorded traces: the verdict, and where the named formulas are violated."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

import rtamt
from rtamt import SpecificationError, Verdict
from rtamt_gym.judges.interface import EXACT, Semantics, robustness_text
from rtamt_gym.recorded.progress import progress
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.tables import number, sample_text, shorten, table, time_text

__all__ = [
    "RESULT",
    "Judgement",
    "Series",
    "described",
    "judge",
    "judge_events",
    "report",
    "signals_of",
    "viewed",
]

_BLOCK = 1 << 14
"""Samples after which the progress bar moves."""


@dataclass(frozen=True, slots=True)
class Series:
    """A signal, or the robustness of a formula, over a trace.

    Attributes:
        times: The time of each value; sample numbers if the period is unknown.
        values: The values.
        step: The usual distance of two times; None if they are sample numbers.
        text: The formula; empty for a signal.
        held: Whether each value holds until the next, as in dense time.
    """

    times: Floats
    values: Floats
    step: float | None
    text: str = ""
    held: bool = False

    def at(self, place: int) -> str:
        """Writes the time of the value at a place."""
        return time_text(float(self.times[place]), self.step)

    @property
    def least(self) -> int:
        """The place of the least value, of the first if there are several."""
        return int(self.values.argmin())

    @property
    def below(self) -> int | None:
        """The place of the first negative value, -0.0 included, or None."""
        below = np.signbit(self.values)
        return int(below.argmax()) if below.any() else None


@dataclass(frozen=True, slots=True)
class Judgement:
    """The verdict on a whole trace.

    Attributes:
        verdict: The sign of the robustness; UNDECIDED if it hangs on a predicate that the semantics
            leaves out.
        robustness: The robustness of the trace, which ends with its last sample or event.
        certain: Words that tell from when on the verdict was certain.
        series: The robustness of the named formulas, the last of which is the result.
        period: Seconds between samples; None for events, or if bounds count samples.
        semantics: How predicates counted.
    """

    verdict: Verdict
    robustness: float
    certain: str
    series: Mapping[str, Series]
    period: Fraction | None = None
    semantics: Semantics = "standard"

    def __str__(self) -> str:
        return f"{self.verdict.name}, robustness {self.robustness_text}, {self.certain}"

    @property
    def robustness_text(self) -> str:
        """The robustness in words; a 0 says whether the specification holds."""
        return robustness_text(self.robustness, self.semantics, self.verdict)

    def text_of(self, value: float) -> str:
        """The robustness of a formula at some time, in words."""
        return robustness_text(value, self.semantics, Verdict.UNDECIDED)


def described(trace: Trace | EventTrace, period: Fraction | None = None) -> str:
    """Describes a trace in words: the number of its samples or events, its first and last time."""
    if isinstance(trace, EventTrace):
        begin, end = (time_text(time, trace.step) for time in trace.span)
        return f"{trace.source}: {_count(trace.events, 'event')}, {begin} to {end}"
    samples = f"{trace.source}: {_count(trace.samples, 'sample')}"
    if period is None:
        return f"{samples}, bounds count samples"
    begin, end = (sample_text(i, period, trace.start) for i in (0, trace.samples - 1))
    return f"{samples}, one every {number(float(period))} s, {begin} to {end}"


def _count(number: int, what: str) -> str:
    return f"1 {what}" if number == 1 else f"{number} {what}s"


RESULT = "(result)"
"""Shown instead of a name for a result that has none."""


def report(judgements: Mapping[str, Judgement], trace: str) -> list[str]:
    """Writes judgements in words and as a table.

    Args:
        judgements: The judgements by name of the specification, which is shown if there are
            several.
        trace: A description of the trace.
    """
    several = len(judgements) > 1
    rows = [("spec", "formula", "at the start", "least", "at", "violated from")]
    for name, judgement in judgements.items():
        for formula, series in judgement.series.items():
            least, below = series.least, series.below
            rows.append(
                (
                    name if several and formula == next(iter(judgement.series)) else "",
                    formula,
                    judgement.text_of(float(series.values[0])),
                    judgement.text_of(float(series.values[least])),
                    series.at(least),
                    "-" if below is None else series.at(below),
                )
            )
    room = 80 - sum(2 + max(map(len, column)) for column in list(zip(*rows, strict=True))[2:])
    width = max(8, (room - 2) // 2 if several else room)
    cells = [[shorten(text, width) for text in row[:2]] + [*row[2:]] for row in rows]
    return [
        *(f"{shorten(n, 20)}: {j}" if several else str(j) for n, j in judgements.items()),
        trace,
        "",
        *table(cells, "<<>>>>"),
    ]


def viewed(spec: rtamt.Specification, view: str) -> rtamt.Specification:
    """The specification that a whole trace has to satisfy at its first sample.

    Args:
        spec: The specification.
        view: ``"episode"``: the specification as it is; ``"step"``: ``always`` of it, so that it
            has to hold at every sample.

    Raises:
        SpecificationError: If the specification reads no sample but the first and ``view`` is
            ``"episode"``.
    """
    if view == "step":
        return spec.always()
    if not spec.looks_ahead:
        raise SpecificationError(
            "the specification speaks of the first sample only; "
            f"write always({shorten(str(spec.formula), 60)}) or --view step"
        )
    return spec


def judge(
    spec: rtamt.Specification,
    trace: Trace,
    period: Fraction | str | None,
    view: str,
    semantics: Semantics = "standard",
) -> Judgement:
    """Judges samples; the trace ends with the last.

    Args:
        spec: The specification.
        trace: The samples.
        period: Seconds between samples, text with a unit, or None.
        view: The argument of `viewed`.
        semantics: How predicates count, as for `rtamt.Monitor`.

    Raises:
        SpecificationError: If a bound is not a multiple of the period, and as `viewed` does.
    """
    monitor = rtamt.EpisodeMonitor(viewed(spec, view), period, semantics=semantics)
    certain_at = _feed(monitor, trace)
    robustness = monitor.finish()
    period = monitor.period
    times, step = _clock(trace, period)
    series = {
        name: Series(
            times,
            _signed(
                rtamt.evaluate(part, trace.columns, period, n=trace.samples, semantics=semantics),
                semantics,
            ),
            step,
            str(part.formula),
        )
        for name, part in _parts(spec).items()
    }
    certain = "at the end of the trace"
    if certain_at is not None:
        certain = f"certain from {time_text(float(times[certain_at]), step)} on"
    return Judgement(monitor.verdict, robustness, certain, series, period, semantics)


def signals_of(trace: Trace | EventTrace, period: Fraction | None) -> dict[str, Series]:
    """The signals of a trace, by the names of the variables."""
    if isinstance(trace, EventTrace):
        return {
            name: Series(times, values, trace.step, held=True)
            for name, (times, values) in trace.signals.items()
        }
    times, step = _clock(trace, period)
    return {name: Series(times, values, step) for name, values in trace.columns.items()}


def _clock(trace: Trace, period: Fraction | None) -> tuple[Floats, float | None]:
    times = np.arange(float(trace.samples))
    if period is None:
        return times, None
    return trace.start + times * period.numerator / period.denominator, float(period)


def judge_events(
    spec: rtamt.Specification, trace: EventTrace, view: str, semantics: Semantics = "standard"
) -> Judgement:
    """Judges events in dense time; the trace ends with the last.

    Raises:
        SpecificationError: If an operator counts samples, and as `viewed` does.
        InputError: If the variables have no time in common.
    """
    whole = viewed(spec, view)
    signals = trace.tables

    def robustness(part: rtamt.Specification) -> Series:
        events = rtamt.evaluate_dense(part, signals, semantics=semantics)
        values = _signed(events.values, semantics)
        return Series(events.times, values, trace.step, str(part.formula), held=True)

    series = {name: robustness(part) for name, part in _parts(spec).items()}
    result = robustness(whole) if whole is not spec else series[_result(spec)]
    least = float(result.values[0])
    verdict = Verdict.SATISFIED
    if not rtamt.holds(least):
        verdict = Verdict.VIOLATED
    elif least == 0.0 and semantics not in EXACT:
        verdict = Verdict.UNDECIDED  # the bounds of dense time are not known here
    return Judgement(verdict, least, "at the end of the trace", series, semantics=semantics)


def _signed(values: Floats, semantics: Semantics) -> Floats:
    """The values, with zeros whose sign says nothing as 0.0: a predicate left out counts so."""
    return values if semantics in EXACT else values + 0.0


def _parts(spec: rtamt.Specification) -> dict[str, rtamt.Specification]:
    """The specifications of the named formulas and, last, that of the result."""
    formulas = {**spec.formulas, _result(spec): spec.formula}
    return {name: replace(spec, formula=formula) for name, formula in formulas.items()}


def _result(spec: rtamt.Specification) -> str:
    return next((n for n, formula in spec.formulas.items() if formula is spec.formula), RESULT)


def _feed(monitor: rtamt.EpisodeMonitor, trace: Trace) -> int | None:
    """Feeds all samples; returns the first at which the verdict was certain, or None."""
    columns = [trace.columns[name].tolist() for name in monitor.variables]
    samples = zip(*columns, strict=True) if columns else iter([()] * trace.samples)
    certain_at = None
    with progress("judging", trace.samples, " samples") as advance:
        at = 0
        while block := list(itertools.islice(samples, _BLOCK)):
            for sample in block:
                monitor.update(*sample)
                if certain_at is None and monitor.verdict:
                    certain_at = at
                at += 1
            advance(len(block))
    return certain_at
