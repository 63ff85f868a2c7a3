"""Judges recorded traces: verdicts, and the robustness of named formulas over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

import rtamt
from rtamt import InputError, Verdict
from rtamt.typing import SemanticsName
from rtamt_gym.judging.formulas import require_whole_episode
from rtamt_gym.judging.monitors import EXACT, robustness_text
from rtamt_gym.judging.stages import progress_of, progress_of_events
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.results.extent import Extent, LateStart
from rtamt_gym.results.outcome import Moment
from rtamt_gym.results.statistics import progress_text
from rtamt_gym.results.warnings import trigger_texts
from rtamt_gym.tables import counted, number, sample_text, time_text


@dataclass(frozen=True, slots=True)
class Series:
    """A signal, or the robustness of a formula, over a trace.

    Attributes:
        times: The time of each value; sample numbers if the period is unknown.
        values: The values.
        step: The usual distance of two times; None if they are sample numbers.
        text: The formula; empty for a signal.
        held: Whether each value holds until the next, as in dense time.
        first: The value at the first instant of dense time, which may differ from the value right
            after it; None if it does not.
    """

    times: Floats
    values: Floats
    step: float | None
    text: str = ""
    held: bool = False
    first: float | None = None

    @property
    def instants(self) -> Series:
        """The series with the first instant as a place of its own."""
        if self.first is None:
            return self
        times = np.concatenate([self.times[:1], self.times])
        return replace(self, times=times, values=np.concatenate([[self.first], self.values]))

    def at(self, place: int) -> str:
        """Return the text of the time of the value at an index."""
        return time_text(float(self.times[place]), self.step)

    @property
    def least(self) -> int:
        """The index of the first minimum."""
        return int(self.values.argmin())

    @property
    def below(self) -> int | None:
        """The index of the first negative value, including -0.0, or None."""
        below = np.signbit(self.values)
        return int(below.argmax()) if below.any() else None


@dataclass(frozen=True, slots=True)
class TraceJudgement:
    """The verdict on a whole trace.

    Attributes:
        found: The verdict, its bounds, and the unrecorded intervals.
        series: The robustness of the named formulas, with the result last. It is empty if
            ``formulas`` is false, or if values are unknown, because robustness then has no single
            value at a sample.
        semantics: The semantics of predicates.
        start: The time of the first sample; 0 for events.
        period: Seconds between samples; None for events, or if bounds count samples.
        step: The usual distance of two times in seconds; None if they are sample numbers.
        dense: Whether the trace was judged in dense time.
        progress: The progress in the stages of the requirement. None without stages; in dense time,
            also None if stages have their own times or values are unknown.
        cut: The verdict on a recording that was cut; None unless `verdict` is SATISFIED under
            ``--end complete``.
        late_start: The start of the trace of the requirement, if it is later than the start of the
            recording.
        from_start: The verdict on the trace from ``late_start``, which the series use. It differs
            from ``found`` only if ``found`` includes the time before.
    """

    found: rtamt.Judgement
    series: Mapping[str, Series]
    semantics: SemanticsName
    start: float
    period: Fraction | None
    step: float | None
    dense: bool = False
    progress: float | None = None
    cut: Verdict | None = None
    late_start: LateStart | None = None
    from_start: rtamt.Judgement = field(kw_only=True)

    def __str__(self) -> str:
        if self.progress is None:
            return self._verdict_text()
        return f"{self._verdict_text()}, progress {progress_text(self.progress)}"

    def _verdict_text(self) -> str:
        judgement, words = self.found, f"{self.verdict.name}, robustness {self.robustness_text}"
        if judgement.unknown and judgement.lower < judgement.upper:
            ends = f"{self._end_text(judgement.lower)} and {self._end_text(judgement.upper)}"
            words = f"{self.verdict.name}, robustness between {ends}"
        if self.verdict == Verdict.UNDECIDED:
            return words
        time = self.certain_from
        if time is None:
            return f"{words}, at the end of the trace"
        return f"{words}, certain from {time_text(time, self.step)} on"

    def _end_text(self, value: float) -> str:
        """Return a bound of the robustness as text; a 0 states whether the formula holds."""
        word, comma, holds = self.text_of(value).partition(", ")
        return f"{word} ({holds})" if comma else number(value)

    @property
    def verdict(self) -> Verdict:
        """The verdict under the end mode of the evaluation options."""
        return self.found.verdict

    @property
    def decided(self) -> Moment | None:
        """The first sample or time from which no continuation can change the verdict, or None."""
        decided = self.found.decided_at
        if decided is None:
            return None
        if self.dense:
            return Moment(None, decided)
        return Moment.of(int(decided), self.period, self.start)

    @property
    def certain_from(self) -> float | None:
        """The time of `decided` in seconds, or its sample number without a period."""
        return None if self.decided is None else self.decided.time

    @property
    def not_recorded(self) -> tuple[str, ...]:
        """The unrecorded intervals that an open verdict needs, in words."""
        if self.period is None:
            return tuple(map(str, self.found.unrecorded))
        return tuple(
            str(
                replace(
                    part,
                    at=part.at + self.start,
                    start=part.start + self.start,
                    end=None if part.end is None else part.end + self.start,
                )
            )
            for part in self.found.unrecorded
        )

    @property
    def way_out(self) -> str:
        """A remedy for an open verdict; empty if the verdict is decided."""
        if self.verdict != Verdict.UNDECIDED:
            return ""
        if self.found.complete == Verdict.UNDECIDED:
            return f"undecided under every --end: it depends on {self.found.undecided_because}"
        return f"if nothing follows (--end complete), the verdict is {self.found.complete.name}"

    @property
    def asked(self) -> list[str]:
        """The trigger counts of implications, in words; empty if no implication was triggered."""
        return trigger_texts(self.found.triggers, self._instant)

    def _instant(self, at: float) -> str:
        """Return the text of a sample, or of a time in dense time."""
        if self.dense:
            return time_text(at, self.step)
        return sample_text(int(at), self.period, self.start)

    @property
    def otherwise_complete(self) -> str:
        """The verdict under ``complete`` if it differs; otherwise, an empty text."""
        verdicts = {self.verdict, self.found.complete}
        return self.found.complete.name if verdicts == _DECIDED else ""

    def note_of_end(self, name: str = "") -> str:
        """Return a note if only ``--end complete`` satisfies it; otherwise an empty text."""
        if self.verdict is not Verdict.SATISFIED or self.cut is not Verdict.UNDECIDED:
            return ""
        phrase = f"{name} is " if name else ""
        return (
            f"{phrase}SATISFIED because --end complete assumes that nothing follows; windows reach "
            "past the end, so --end cut leaves it UNDECIDED"
        )

    @property
    def robustness_text(self) -> str:
        """The robustness in words; a 0 without a verdict states whether it holds."""
        text = robustness_text(self.found.robustness, self.semantics, self.found.complete)
        return text if self.verdict == Verdict.UNDECIDED else text.partition(", ")[0]

    def text_of(self, value: float) -> str:
        """Return the text of the robustness of a formula at some time."""
        return robustness_text(value, self.semantics, Verdict.UNDECIDED)


_DECIDED = {Verdict.VIOLATED, Verdict.SATISFIED}


def extent_of(trace: Trace | EventTrace, period: Fraction | None = None) -> Extent:
    """Return the extent of a trace, of samples at a period."""
    return trace.extent() if isinstance(trace, EventTrace) else trace.extent(period)


RESULT = "(result)"
"""Shown instead of a name for a result that has none."""


def viewed(spec: rtamt.Specification, view: str) -> rtamt.Specification:
    """Return the specification that a trace must satisfy at its first sample."""
    if view == "step":
        return spec.always()
    named = spec.requirement is not None
    phrase = f"requirement {spec.requirement!r}" if named else "the specification"
    require_whole_episode(phrase, spec, "--view step")
    return spec


def judge(
    spec: rtamt.Specification,
    trace: Trace | EventTrace,
    period: Fraction | None,
    reading: EvaluationOptions,
    *,
    formulas: bool = True,
) -> TraceJudgement:
    """Judge samples, or events in dense time, whose trace ends with the recording."""
    if isinstance(trace, Trace):
        return _judge_samples(spec, trace, period, reading, formulas=formulas)
    try:
        return _judge_events(spec, trace, reading, formulas=formulas)
    except InputError as error:
        raise InputError(f"{trace.source}: ", error) from error


def arguments(
    spec: rtamt.Specification,
    trace: Trace | EventTrace,
    period: Fraction | None,
    reading: EvaluationOptions,
    late: LateStart | None,
    *,
    beginning: bool = False,
) -> tuple[Mapping[str, Floats], dict[str, Any]]:
    """Return the signals and options with which `rtamt` and `rtamt.dense` judge a trace.

    They are the signals from the start at which all variables of the specification have a value,
    or with the time before it, in which values are unknown.
    """
    if isinstance(trace, EventTrace):
        return _dense_arguments(spec, trace, reading, late, beginning=beginning)
    names = spec.variables
    trace = trace.with_beginning(names) if beginning else trace.known(names)
    reading = reading.having(period=period)
    if beginning or not {*trace.unknown}.isdisjoint(names):
        reading = reading.having(nan="unknown")
    return trace.columns, {"n": trace.samples, **reading.from_monitors({"": spec})[""]}


def _dense_arguments(
    spec: rtamt.Specification,
    trace: EventTrace,
    reading: EvaluationOptions,
    late: LateStart | None,
    *,
    beginning: bool,
) -> tuple[Mapping[str, Floats], dict[str, Any]]:
    options: dict[str, Any] = {"semantics": reading.semantics}
    if beginning or trace.unknown or trace.max_gap is not None:
        options["nan"] = "unknown"
    if trace.max_gap is not None:
        options["max_gap"] = trace.max_gap
    # A declared default leaves no hole, other than an event of the same value.
    declared = {*trace.absent} & spec.defaults.keys()
    names = [name for name in spec.variables if name not in declared] or spec.variables
    if late is None or not beginning:
        return trace.tables_from(late, names), options
    return trace.tables_with_beginning(late, names), options


class _Verdicts(NamedTuple):
    """The verdicts on a trace whose variables may start at different times.

    Attributes:
        result: The verdict.
        from_start: The verdict from the start at which all variables have a value.
        late: The start; None if it is the start of the recording.
        cut: The verdict under ``cut``; None unless `result` is SATISFIED under ``complete``.
        arguments: The signals and options of `from_start`.
    """

    result: rtamt.Judgement
    from_start: rtamt.Judgement
    late: LateStart | None
    cut: Verdict | None
    arguments: tuple[Mapping[str, Floats], dict[str, Any]]


def _verdicts(
    spec: rtamt.Specification,
    trace: Trace | EventTrace,
    period: Fraction | None,
    reading: EvaluationOptions,
    late: LateStart | None,
) -> _Verdicts:
    """Judge from the start, and with the time before it if that may be worse."""
    end, dense = reading.end, isinstance(trace, EventTrace)
    judge_: Callable[..., rtamt.Judgement] = rtamt.dense.judge if dense else rtamt.judge
    from_start = signals, options = arguments(spec, trace, period, reading, late)
    first = result = judge_(spec, signals, end=end, **options)
    if late is not None:
        late = replace(late, verdict=first.verdict.name)
        if late.of and not trace.start_known and first.verdict is not Verdict.VIOLATED:
            every, unknown = arguments(spec, trace, period, reading, late, beginning=True)
            complete = judge_(spec, every, end=end, **unknown)
            if complete.verdict < first.verdict:
                result, signals, options = complete, every, unknown
                late = replace(late, counted=True)
    cut = None
    if end == "complete" and result.verdict is Verdict.SATISFIED:
        cut = judge_(spec, signals, end="cut", **options).verdict
    return _Verdicts(result, first, late, cut, from_start)


def _judge_samples(
    spec: rtamt.Specification,
    trace: Trace,
    period: Fraction | None,
    reading: EvaluationOptions,
    *,
    formulas: bool,
) -> TraceJudgement:
    requirement, semantics = viewed(spec, reading.view), reading.semantics
    late = trace.late_start(requirement.variables)
    verdicts = _verdicts(requirement, trace, period, reading, late)
    judgement, known, late, cut, (columns, options) = verdicts
    trace = trace.known(requirement.variables)
    passed = trace.passed
    if (
        passed is not None
        and judgement.verdict is Verdict.SATISFIED
        and not {*passed.lower}.isdisjoint(requirement.variables)
    ):
        ranges = {n: rtamt.UncertainValue(v, passed.upper[n]) for n, v in passed.lower.items()}
        every = rtamt.judge(requirement, {**columns, **ranges}, end=reading.end, **options)
        if every.verdict is not Verdict.SATISFIED:
            raise InputError(
                f"{passed.place}: SATISFIED if samples are resampled, but this depends on "
                f"{counted(passed.count, 'row')} between samples, of which this is the first. "
                "Give --dense to read every row."
            )
    times, step = _clock(trace, period)
    series = {
        name: Series(
            times,
            _signed(rtamt.evaluate(part, columns, **options), semantics),
            step,
            str(part.formula),
        )
        for name, part in (_parts(spec) if formulas and not known.unknown else {}).items()
    }
    before = late is not None and late.counted
    reading = reading.having(period=period, nan=options["nan"])
    progress = None if before else progress_of(requirement, columns, reading)
    start = late.begin if late is not None and before else trace.start
    return TraceJudgement(
        *(judgement, series, semantics, start, period, step),
        progress=progress,
        cut=cut,
        late_start=late,
        from_start=known,
    )


def noticed(
    mutants: Sequence[rtamt.mutation.Mutant],
    trace: Trace | EventTrace,
    period: Fraction | None,
    reading: EvaluationOptions,
) -> tuple[bool, ...]:
    """Return which mutants of a requirement a trace kills."""
    if reading.view == "step":
        mutants = [
            replace(m, requirement=m.requirement.always(), specification=m.specification.always())
            for m in mutants
        ]
    requirement = mutants[0].requirement
    if isinstance(trace, Trace):
        columns, options = arguments(requirement, trace, period, reading, None)
        return rtamt.mutation.killed(mutants, columns, end=reading.end, **options)
    late = trace.late_start(requirement.variables)

    def verdict(spec: rtamt.Specification) -> Verdict | None:
        try:
            return _verdicts(spec, trace, period, reading, late).result.verdict
        except rtamt.RtamtError:  # for instance, the requirement counts samples
            return None

    its = verdict(requirement)
    return tuple({its, verdict(m.specification)} == _DECIDED for m in mutants)


def signals_of(trace: Trace | EventTrace, period: Fraction | None) -> dict[str, Series]:
    """Return the signals of a trace, by the names of the variables."""
    if isinstance(trace, EventTrace):
        return {
            name: Series(times, values, trace.step, held=True)
            for name, (times, values) in trace.signals.items()
        }
    times, step = _clock(trace, period)
    return {name: Series(times, values, step) for name, values in trace.columns.items()}


def _clock(trace: Trace, period: Fraction | None) -> tuple[Floats, float | None]:
    step = None if period is None else float(period)
    return _times(trace.start, trace.samples, period), step


@lru_cache(maxsize=1)
def _times(start: float, samples: int, period: Fraction | None) -> Floats:
    """Return the times of samples, or their numbers; one array for all requirements of a trace."""
    times = np.arange(float(samples))
    if period is not None:
        times *= period.numerator
        times /= period.denominator
        times += start
    times.flags.writeable = False
    return times


def _judge_events(
    spec: rtamt.Specification, trace: EventTrace, reading: EvaluationOptions, *, formulas: bool
) -> TraceJudgement:
    semantics, signals, requirement = reading.semantics, trace.tables, viewed(spec, reading.view)
    late = trace.late_start(requirement.variables)
    judgement, known, late, cut, _ = _verdicts(requirement, trace, None, reading, late)
    series = {}
    for name, part in (_parts(spec) if formulas and not known.unknown else {}).items():
        events = rtamt.dense.evaluate(part, signals, semantics=semantics)
        values = _signed(events.values, semantics)
        first = None
        if part.timed:
            judged = rtamt.dense.judge(part, signals, "complete", semantics=semantics)
            (first,) = _signed(np.array([judged.robustness]), semantics).tolist()
        series[name] = Series(
            *(events.times, values, trace.step, str(part.formula)), held=True, first=first
        )
    progress = None
    counted = late is not None and late.counted
    if not (trace.unknown or counted) and trace.max_gap is None and requirement.variables:
        lines = {name: trace.signals[name] for name in requirement.variables}
        satisfied = judgement.verdict is Verdict.SATISFIED
        progress = progress_of_events(requirement, lines, reading, satisfied=satisfied)
    return TraceJudgement(
        *(judgement, series, semantics, 0.0, None, trace.step),
        dense=True,
        progress=progress,
        cut=cut,
        late_start=late,
        from_start=known,
    )


def _signed(values: Floats, semantics: SemanticsName) -> Floats:
    """Return the values, with -0.0 as 0.0 where the sign of zero has no meaning."""
    return values if semantics in EXACT else values + 0.0


def _parts(spec: rtamt.Specification) -> dict[str, rtamt.Specification]:
    """Return a specification for each named formula and, last, for the result."""
    formulas = {**spec.formulas, _result(spec): spec.formula}
    return {name: replace(spec, formula=formula) for name, formula in formulas.items()}


def _result(spec: rtamt.Specification) -> str:
    return next((n for n, formula in spec.formulas.items() if formula is spec.formula), RESULT)
