"""Occurrences: all violations of a requirement on a trace, and the answers to its triggers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar, Unpack, cast, overload

import numpy as np
from numpy.typing import NDArray

from rtamt.inputs.arrays import Floats
from rtamt.inputs.events import EventsLike, Until
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import Formula
from rtamt.language.operators import OPERATORS
from rtamt.machines.protocols import End
from rtamt.machines.segments import (
    Minima,
    PlaceNumbers,
    PlaceRuns,
    SegmentRuns,
    Segments,
    UnseenPlace,
)
from rtamt.machines.walk import numbers_of
from rtamt.monitors.evaluation import trace_between
from rtamt.monitors.evidence import text_of
from rtamt.monitors.options import (
    EventOptions,
    SampleOptions,
    Spec,
    checked_end,
    compiled,
    compiled_regions,
    listed_in_signature,
)
from rtamt.monitors.traces import DenseTrace, JudgedTrace, SampleTrace, scaled
from rtamt.monitors.verdict import Verdict
from rtamt.program.implications import InstantRuns, bodies, implications
from rtamt.program.memory import limit_beyond
from rtamt.program.timing import Period

_Columns = Mapping[str, NDArray[Any]]
_R = TypeVar("_R", bound=tuple[Any, ...])
_SHOWN = 5


class Occurrence(NamedTuple):
    """A run of neighbouring instants at which a body is violated.

    Attributes:
        start: The time of the first instant.
        end: The time of the next instant after the run, or the last recorded time if the run lasts
            until then. In dense time, the time at which the run ends; a single instant has its
            start as its end.
        duration: ``end - start``, in the unit of `Occurrences`.
        to_end: Whether the run lasts until the end of the trace.
        robustness: The minimum robustness in the run, -0.0 below +0.0.
        worst_at: The time of the first instant with this robustness; in dense time possibly right
            after it.
        unseen: Whether the violation is at an instant after the trace, which its past decides. Then
            it is the only row, for the first such instant.
        open_start: Whether the run starts right after ``start``, which is not part of it. Only in
            dense time.
        closed_end: Whether the instant ``end`` is part of the run. For samples, only at the end of
            the trace.
    """

    start: float
    end: float
    duration: float
    to_end: bool
    robustness: float
    worst_at: float
    unseen: bool
    open_start: bool = False
    closed_end: bool = False


class UnknownRun(NamedTuple):
    """A run of neighbouring instants at which the trace does not decide a formula.

    The attributes are as in `Occurrence`.
    """

    start: float
    end: float
    duration: float
    to_end: bool
    open_start: bool = False
    closed_end: bool = False


class Response(NamedTuple):
    """A run of neighbouring instants at which the left side of an implication holds for certain.

    Attributes that are not listed are as in `Occurrence`.

    Attributes:
        verdict: VIOLATED if the implication is violated at an instant of the run, SATISFIED if it
            is satisfied at all of them; otherwise, UNDECIDED.
        answer_time: The time from ``start`` to the first instant at which the right side of
            ``eventually`` or ``until`` answers the first instant of the run. nan without an answer,
            if the answer is not recorded, and for other right sides.
        margin: The minimum robustness of the implication in the run.
    """

    start: float
    end: float
    duration: float
    to_end: bool
    verdict: Verdict
    answer_time: float
    margin: float
    open_start: bool = False
    closed_end: bool = False


class RunTable(Sequence[_R], Generic[_R]):
    """Rows of one kind, stored as columns; a row is built when it is read.

    Attributes:
        columns: A column for each field of the rows. ``pandas.DataFrame(table.columns)`` is a data
            frame; a verdict is -1, 0 or 1 there.
    """

    __slots__ = ("_row", "columns")

    def __init__(self, row: Callable[..., _R], columns: Mapping[str, NDArray[Any]]) -> None:
        self._row, self.columns = row, columns

    def __len__(self) -> int:
        return len(self.columns["start"])

    @overload
    def __getitem__(self, place: int) -> _R: ...
    @overload
    def __getitem__(self, place: slice) -> RunTable[_R]: ...
    def __getitem__(self, place: int | slice) -> _R | RunTable[_R]:
        if isinstance(place, slice):
            return RunTable(
                self._row, {name: column[place] for name, column in self.columns.items()}
            )
        return self._row(
            **{name: _cell(name, column[place]) for name, column in self.columns.items()}
        )

    def __iter__(self) -> Iterator[_R]:
        return (self[index] for index in range(len(self)))

    def shifted(self, seconds: float) -> RunTable[_R]:
        """Return the same rows with later times."""
        moments = ("start", "end", "worst_at")
        return RunTable(
            self._row,
            {
                name: column + seconds if name in moments else column
                for name, column in self.columns.items()
            },
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RunTable):
            return NotImplemented
        return self.columns.keys() == other.columns.keys() and all(
            _same(column, other.columns[name]) for name, column in self.columns.items()
        )

    __hash__ = None  # type: ignore[assignment]  # columns are arrays

    def __repr__(self) -> str:
        return f"<{len(self)} rows of {', '.join(self.columns)}>"


def _cell(name: str, value: Any) -> Any:  # noqa: ANN401 - an element of an array
    if isinstance(value, np.datetime64):
        return value
    return Verdict(int(value)) if name == "verdict" else value.item()


def _same(column: NDArray[Any], other: NDArray[Any]) -> bool:
    return column.dtype == other.dtype and np.array_equal(
        column, other, equal_nan=column.dtype.kind == "f"
    )


@dataclass(frozen=True, slots=True)
class BodyOccurrences:
    """The occurrences of one body of a requirement.

    Attributes:
        text: The body as text.
        violations: An `Occurrence` for each run of violated instants.
        unknown: An `UnknownRun` for each run of instants that the trace does not decide.
        responses: A `Response` for each trigger of a body ``A implies B``; empty for other bodies.
        unknown_triggers: An `UnknownRun` for each run of instants at which it is not known whether
            ``A`` holds.
        length: The recorded time at which the requirement reads the body, in the unit of
            `Occurrences`: a period for each sample, or samples.
        violated: The violated part of ``length``.
        unit: The unit of durations: ``"s"`` or ``"samples"``.
    """

    text: str
    violations: RunTable[Occurrence]
    unknown: RunTable[UnknownRun]
    responses: RunTable[Response]
    unknown_triggers: RunTable[UnknownRun]
    length: float
    violated: float
    unit: str

    @property
    def share(self) -> float:
        """The share of the time in which the body is violated; nan without a length."""
        return self.violated / self.length if self.length else float("nan")

    @property
    def per_hour(self) -> float:
        """The violations in an hour; nan for samples without a period, and without a length."""
        timed = self.unit == "s" and self.length > 0
        return 3600 * len(self.violations) / self.length if timed else float("nan")

    @property
    def answer_times(self) -> Floats:
        """The answer times of `responses` that are known, sorted."""
        times: Floats = self.responses.columns["answer_time"]
        return np.sort(times[~np.isnan(times)])

    @property
    def outcomes(self) -> Mapping[Verdict, int]:
        """The number of responses with each verdict."""
        verdicts = self.responses.columns["verdict"]
        return {verdict: int(np.count_nonzero(verdicts == verdict)) for verdict in Verdict}

    def lines(self, moment: Callable[[Any], str], *, rates: bool = True) -> Iterator[str]:
        """Yield the lines of a text.

        ``moment`` returns the text of a time; ``rates`` adds the share of the time and the rate.
        """
        yield f"{self.text}: {self._count(rates=rates)}"
        for row in self.violations[:_SHOWN]:
            until = " (after the trace)" if row.unseen else ""
            if row.end != row.start:
                until = f" to {moment(row.end)}"
            end = ", up to the end" if row.to_end else ""
            worst = f"robustness {row.robustness + 0.0:.6g} at {moment(row.worst_at)}"
            yield f"  {moment(row.start)}{until}{end}: {worst}"
        if len(self.violations) > _SHOWN:
            yield f"  and {len(self.violations) - _SHOWN} more"
        if len(self.unknown):
            first = moment(self.unknown[0].start)
            yield f"  unknown {_times(len(self.unknown))}, first at {first}"
        if len(self.responses):
            yield f"  {self._answers()}"
        if len(self.unknown_triggers):
            first = moment(self.unknown_triggers[0].start)
            yield f"  possibly triggered {_times(len(self.unknown_triggers))}, first at {first}"

    def _count(self, *, rates: bool) -> str:
        if not len(self.violations):
            return "never violated"
        words = f"violated {_times(len(self.violations))}"
        if rates and not math.isnan(self.share):
            words += f", {100 * self.share:.3g} % of the time"
        if rates and not math.isnan(self.per_hour):
            words += f", {self.per_hour:.4g} an hour"
        return words

    def _answers(self) -> str:
        counts = self.outcomes
        parts = [
            f"{counts[verdict]} {word}"
            for verdict, word in (
                (Verdict.SATISFIED, "satisfied"),
                (Verdict.VIOLATED, "violated"),
                (Verdict.UNDECIDED, "unknown"),
            )
            if counts[verdict]
        ]
        times, unit = self.answer_times, "s" if self.unit == "s" else "samples"
        text = f"triggered {_times(len(self.responses))}: {', '.join(parts)}"
        if len(times):
            low, middle, high = np.quantile(times, (0, 0.5, 1)).tolist()
            span = f"{low:.6g} {unit}"
            if low < high:
                span = f"{low:.6g} to {high:.6g} {unit}, median {middle:.6g}"
            text += f"; answer time {span}"
        return text


def _times(count: int) -> str:
    return f"{count} time" if count == 1 else f"{count} times"


@dataclass(frozen=True, slots=True)
class Occurrences:
    """The violations of a requirement on a trace; returned by `rtamt.occurrences`.

    ``len`` is the number of violations, and iteration yields them, body after body.

    Attributes:
        formula: The formula as text.
        bodies: The occurrences of each body, in the order of the text.
        end: The end mode.
        unit: The unit of times: ``"s"``, or ``"samples"`` for sample numbers.
        at_start: Whether the formula is about the first instant only, because its root is neither
            ``always`` nor ``and``. Then the formula is its own body, read at one instant.
    """

    formula: str
    bodies: tuple[BodyOccurrences, ...]
    end: str
    unit: str
    at_start: bool

    def shifted(self, seconds: float) -> Occurrences:
        """Return the same rows with later times, such as for a trace that starts after 0 s."""
        if not seconds:
            return self
        tables = "violations", "unknown", "responses", "unknown_triggers"
        bodies = tuple(
            replace(body, **{name: getattr(body, name).shifted(seconds) for name in tables})
            for body in self.bodies
        )
        return replace(self, bodies=bodies)

    def __len__(self) -> int:
        return sum(len(body.violations) for body in self.bodies)

    def __bool__(self) -> bool:
        """Return True: an object without violations is also a result."""
        return True

    def __iter__(self) -> Iterator[Occurrence]:
        return (row for body in self.bodies for row in body.violations)

    def __str__(self) -> str:
        rates = not self.at_start
        lines = [line for body in self.bodies for line in body.lines(self.moment, rates=rates)]
        if self.at_start:
            lines.append("evaluated at the first instant only; always(...) covers the trace")
        return "\n".join(lines)

    def moment(self, time: Any) -> str:  # noqa: ANN401 - a number or a date
        """Return the text of a time of a row."""
        if isinstance(time, np.datetime64):
            return str(time)
        return f"{time:.12g} s" if self.unit == "s" else f"sample {time}"


class _Clock:
    """The times of the places of a trace, as arrays."""

    def __init__(self, trace: JudgedTrace) -> None:
        self.step, self._last = trace.step, trace.last
        self._tick, self._times = trace.tick, trace.times
        self.unit = trace.unit

    def lasting(self, count: PlaceNumbers) -> NDArray[Any]:
        """Return the duration of numbers of samples or ticks."""
        return scaled(count, self._tick)

    def at(self, places: PlaceNumbers) -> NDArray[Any]:
        """Return the times of places."""
        return self._times(self._steps(places))

    def columns(self, runs: PlaceRuns) -> dict[str, NDArray[Any]]:
        """Return the columns that all kinds of rows have."""
        first = self._steps(runs.first)
        after = np.minimum(self._steps(runs.last + 1), self._last // self.step)
        return {
            "start": self._times(first),
            "end": self._times(after),
            "duration": self.lasting(after - first),
            "to_end": runs.last == self._last,
            "open_start": runs.first % self.step != 0,
            # A run of samples lasts until the next sample, which is not part of it.
            "closed_end": runs.last % self.step == 0 if self.step > 1 else runs.last == self._last,
        }

    def _steps(self, places: PlaceNumbers) -> PlaceNumbers:
        return places if self.step == 1 else places // self.step


def _occurrences_of(trace: JudgedTrace) -> Occurrences:
    clock = _Clock(trace)
    rows = tuple(
        _of_body(trace, body, instants, clock) for body, instants in trace.body_reads().items()
    )
    at_start = bodies(trace.formula) == (trace.formula,)
    return Occurrences(text_of(trace.formula), rows, trace.end, clock.unit, at_start)


def _of_body(
    trace: JudgedTrace, body: Formula, instants: InstantRuns, clock: _Clock
) -> BodyOccurrences:
    recorded = PlaceRuns.of(instants, trace.last)
    values = trace.segments(body).divided(recorded)
    runs, worst = values.failing(recorded)
    failing, unknown = runs.places, values.undecided(recorded).places
    responses, unknown_triggers = _responses(trace, body, values, recorded, clock)
    del runs, values  # free memory, since these are as long as the trace
    violations = _violations(failing, worst, clock)
    if not len(failing.first) and instants:
        unseen = trace.unseen_violation(body, instants)
        if unseen is not None:
            violations = _unseen(unseen, clock)
    lengths = np.array([recorded.length(clock.step), failing.length(clock.step)])
    length, violated = clock.lasting(lengths).tolist()
    return BodyOccurrences(
        text_of(body),
        RunTable(Occurrence, violations),
        RunTable(UnknownRun, clock.columns(unknown)),
        RunTable(Response, responses),
        RunTable(UnknownRun, unknown_triggers),
        *(length, violated, clock.unit),
    )


def _violations(failing: PlaceRuns, worst: Minima, clock: _Clock) -> _Columns:
    return {
        **clock.columns(failing),
        "robustness": numbers_of(worst.values),
        "worst_at": clock.at(worst.places),
        "unseen": np.zeros(len(worst.values), bool),
    }


def _unseen(unseen: UnseenPlace, clock: _Clock) -> _Columns:
    time = clock.at(np.array([unseen.place]))
    return {
        "start": time,
        "end": time,
        "duration": clock.lasting(np.zeros(1, np.int64)),
        "to_end": np.zeros(1, bool),
        "open_start": np.full(1, unseen.place % clock.step != 0),
        "closed_end": np.full(1, unseen.place % clock.step == 0),
        "robustness": np.array([unseen.robustness]),
        "worst_at": time,
        "unseen": np.ones(1, bool),
    }


def _responses(
    trace: JudgedTrace, body: Formula, values: Segments, recorded: PlaceRuns, clock: _Clock
) -> tuple[_Columns, _Columns]:
    """Return the columns of the responses of a body, and of its unknown triggers."""
    none = PlaceRuns.of((), 0)
    runs = maybe = none
    answers = np.empty(0)
    if body in implications(body):
        left, right = (cast("Formula", operand) for operand in body.args)
        triggers = trace.segments(left, standard=True).divided(recorded)
        runs = triggers.holding(recorded).places
        maybe = triggers.undecided(recorded).places
        answers = _answer_times(trace, right, runs, clock)
    values = values.divided(runs)
    within = values.within(runs)
    margins = within.minima().values
    columns = {
        **clock.columns(runs),
        "verdict": _verdicts(within, margins),
        "answer_time": answers,
        "margin": numbers_of(margins),
    }
    return columns, clock.columns(maybe)


def _verdicts(runs: SegmentRuns, minima: PlaceNumbers) -> NDArray[np.int8]:
    """Return the verdict of each run: violated if a segment fails, satisfied if all hold."""
    segments = runs.segments
    if segments.known or not len(minima):
        verdicts = np.where(minima < 0, -1, 1)
    else:
        verdicts = np.where(runs.any(~segments.holds), 0, 1)
        verdicts[runs.any(segments.fails)] = -1
    return verdicts.astype(np.int8)


def _answer_times(
    trace: JudgedTrace, right: Formula, runs: PlaceRuns, clock: _Clock
) -> NDArray[np.float64]:
    """Return the time from the first place of each run to its answer; nan if there is none."""
    unanswered = np.full(len(runs.first), np.nan)
    if right.op not in (OPERATORS["eventually"], OPERATORS["until"]):
        return unanswered
    begin, end = trace.bounds_of(right)
    goal = trace.segments(cast("Formula", right.args[-1]))
    answer = goal.runs(goal.holds).places.at_or_after(runs.first + clock.step * begin)
    answered = answer >= 0
    if end is not None:
        answered &= answer <= runs.first + clock.step * end
    if right.op is OPERATORS["until"]:
        segments = trace.segments(cast("Formula", right.args[0]))
        broken = segments.runs(~segments.holds).places.at_or_after(runs.first)
        # The left side must hold before the answer, and in an open interval also at the answer,
        # unless that is the first place.
        needed = answer - ((answer % clock.step == 0) | (answer == runs.first))
        answered &= (broken < 0) | (broken > needed)
    ticks = answer // clock.step - runs.first // clock.step
    return np.where(answered, clock.lasting(ticks).astype(np.float64), unanswered)


@listed_in_signature(SampleOptions)
def occurrences(
    spec: Spec,
    signals: TraceColumns,
    period: Period | None = None,
    end: End = "cut",
    *,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> Occurrences:
    """Return all violations of a requirement on a recorded trace of samples.

    `judge` returns one verdict on a trace; this function returns every stretch of it at which the
    requirement is violated, and for ``A implies B`` every trigger with its answer.

    * A *body* is a formula that the requirement demands at one instant after the other: on each
      path from the root down through ``always`` and ``and``, the first formula with another
      operator. Any other root is its own body at sample 0.
    * The body is read at the recorded samples that the windows of these ``always`` reach from
      sample 0, as `Judgement.triggers` counts them.
    * Its outcome at sample i is the verdict of ``judge("always[i:i](BODY)", ...)`` with the same
      end mode: violated, satisfied or unknown.
    * An `Occurrence` is a longest run of neighbouring violated samples. It lasts until the time of
      the next sample, so neighbouring samples leave no gap.
    * A `Response` is a longest run of neighbouring samples at which ``A`` holds for certain; there
      are as many as triggers.

    There is a violation if and only if the verdict is VIOLATED. If it is UNDECIDED, there are
    unknown rows, or times that were not recorded (`Judgement.unrecorded`). The function takes one
    pass over the trace.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: As for `judge`.
        period: As for `Monitor`. Times are in seconds from the first sample; without a period, they
            are numbers of samples.
        end: As for `judge`: ``"complete"``, ``"cut"`` or ``"open"``.
        n: The length, for a formula without variables.
        **options: As for `judge`.

    Raises:
        SpecificationError: As for `judge`.
        InputError: As for `judge`.
        InputTypeError: As for `judge`.

    Example:
        >>> import rtamt
        >>> trace = {"x": [1, 7, 8, 2, 3, 6]}
        >>> result = rtamt.occurrences("always(x < 5)", trace, period="100ms")
        >>> print(result)
        x < 5: violated 2 times, 50 % of the time, 1.2e+04 an hour
          0.1 s to 0.3 s: robustness -3 at 0.2 s
          0.5 s, up to the end: robustness -1 at 0.5 s
        >>> result.bodies[0].violations[0].duration
        0.2
        >>> trace = {"req": [0, 4, 0, 0, 4, 0, 0], "gnt": [0, 0, 5, 0, 0, 0, 0]}
        >>> spec = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
        >>> print(rtamt.occurrences(spec, trace))
        req >= 3 implies eventually[0:2](gnt >= 3): violated 1 time, 14.3 % of the time
          sample 4 to sample 5: robustness -1 at sample 4
          triggered 2 times: 1 satisfied, 1 violated; answer time 1 samples
    """
    mode = checked_end(end)
    program = compiled(occurrences, spec, period, options, online=False)
    reader = SampleReader(program.program, program.nan, bounds=True)
    least, greatest, length = trace_between(reader, signals, n, period)
    limit_beyond(program.program, length, unknown=greatest is not least)
    return _occurrences_of(
        SampleTrace(*(program, mode, (least, greatest), length), by_columns=True)
    )


@listed_in_signature(EventOptions)
def occurrences_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    end: End = "cut",
    *,
    until: Until | None = None,
    resolution: Period = "1ns",
    **options: Unpack[EventOptions],
) -> Occurrences:
    """Return all violations of a requirement on a recorded trace in dense time.

    It is `rtamt.occurrences` for events. A run at a single instant has its start as its end. A run
    may start right after its ``start`` (``open_start``) and contain its ``end`` (``closed_end``).

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: As for `rtamt.dense.judge`.
        end: As for `rtamt.dense.judge`.
        until: As for `rtamt.dense.judge`.
        resolution: As for `rtamt.dense.Monitor`.
        **options: As for `rtamt.dense.judge`.

    Returns:
        The occurrences. Their times are of the kind of the events' times, also `numpy.datetime64`;
        durations are in seconds.

    Raises:
        SpecificationError: As for `rtamt.dense.judge`.
        InputError: As for `rtamt.dense.judge`.
        InputTypeError: As for `rtamt.dense.judge`.

    Example:
        >>> import rtamt
        >>> trace = {"x": [(0, 1), (2.5, 7), (3, 2), (8, 6), (9, 6)]}
        >>> for row in rtamt.dense.occurrences("always(x < 5)", trace):
        ...     print(row.start, row.end, row.robustness, row.to_end)
        2.5 3.0 -2.0 False
        8.0 9.0 -1.0 True
    """
    mode = checked_end(end)
    parts = compiled_regions(occurrences_dense, spec, resolution, options)
    return _occurrences_of(DenseTrace(parts, mode, signals, until))
