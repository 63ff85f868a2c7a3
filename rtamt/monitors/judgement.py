"""Judgements of recorded traces, over samples and over dense time."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Unpack, cast

from rtamt.errors import InputTypeError, brief
from rtamt.inputs.between import identical
from rtamt.inputs.events import EventsLike, Until
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import Formula
from rtamt.machines.protocols import End
from rtamt.machines.state import verdict_of
from rtamt.monitors.evaluation import trace_between
from rtamt.monitors.evidence import (
    DenseTriggerCount,
    Evidence,
    TriggerCount,
    Unrecorded,
    text_of,
    texts_of,
    unrecorded_intervals,
)
from rtamt.monitors.options import (
    Compiled,
    EventOptions,
    SampleOptions,
    Spec,
    checked_end,
    compiled,
    compiled_regions,
    listed_in_signature,
)
from rtamt.monitors.traces import DenseTrace, JudgedTrace, SampleTrace
from rtamt.monitors.verdict import Verdict, holds, rounded, wrapped, zero_text
from rtamt.program.implications import Counted, implications
from rtamt.program.memory import limit_beyond
from rtamt.program.timing import Period
from rtamt.renamed import OldName

_NEVER: Counted = 0, 0, None


def evidence_of(trace: JudgedTrace, *, satisfied: bool) -> Evidence[Any]:
    """Return the evidence for the verdict on a trace."""
    rows, vacuous = _rows(trace, implications(trace.formula), satisfied=satisfied)
    never = satisfied and bool(rows) and not any(counted[1] for _, counted, _ in rows)
    triggers = (trace.triggers(text, counted, vacuous=alone) for text, counted, alone in rows)
    return Evidence(tuple(triggers), vacuous, never)


def _rows(
    trace: JudgedTrace, counted: Sequence[Formula], *, satisfied: bool
) -> tuple[list[tuple[str, Counted, bool]], bool]:
    """Return text, count and vacuity of each implication, and the vacuity of all together."""
    if not counted:
        return [], False
    places = trace.reads()
    rows, redundant = [], []
    for implication in counted:
        every, needed = places[implication]
        text = text_of(implication)
        if not every:
            rows.append((text, _NEVER, satisfied))
            redundant.append(True)
            continue
        opposite = trace.opposite(cast("Formula", implication.args[0]))
        count = opposite.fails_at(every)
        vacuous = False
        if satisfied:
            _, answers, _ = count if needed == every else opposite.fails_at(needed)
            vacuous = not answers
            # If the left side fails, the right side does not matter.
            redundant.append(not count[1] and not trace.hides and opposite.holds_at(every))
            if vacuous and not redundant[-1]:
                vacuous = trace.satisfied_without((implication,))
        rows.append((text, count, vacuous))
    # With more false right sides, fewer traces satisfy the formula.
    vacuous = satisfied and all(alone for _, _, alone in rows)
    if vacuous and len(rows) > 1 and not all(redundant):
        vacuous = trace.satisfied_without(counted)
    return rows, vacuous


class _Details:
    """The evidence of a verdict, computed when it is first read; a pickle has all parts."""

    def __init__(self, trace: JudgedTrace, verdict: Verdict) -> None:
        self._trace, self._verdict = trace, verdict

    @functools.cached_property
    def unrecorded(self) -> tuple[Unrecorded, ...]:
        if self._trace.end == "complete" or self._verdict is not Verdict.UNDECIDED:
            return ()
        trace = self._trace
        intervals = unrecorded_intervals(trace.registers(), trace.extent)
        return tuple(
            Unrecorded(
                *(str(node), trace.seconds(place), trace.seconds(begin)),
                *(None if end is None else trace.seconds(end + trace.step - 1), trace.unit),
            )
            for (node, place), (begin, end) in sorted(intervals.items(), key=lambda row: row[0][1])
        )

    @functools.cached_property
    def decided_at(self) -> float | None:
        return self._trace.decided_at()

    @functools.cached_property
    def evidence(self) -> Evidence[Any]:
        return evidence_of(self._trace, satisfied=self._verdict is Verdict.SATISFIED)

    @functools.cached_property
    def early_end(self) -> str:
        return self._trace.early_end()

    def __getstate__(self) -> dict[str, object]:
        parts = "unrecorded", "decided_at", "evidence", "early_end"
        return {name: getattr(self, name) for name in parts}


@dataclass(frozen=True, slots=True, repr=False, eq=False)
class Judgement:
    """The verdict on a trace and its evidence; returned by `judge` and `rtamt.dense.judge`.

    ``str`` returns a text of at most 80 columns with the unrecorded intervals and the triggers. In
    dense time, times replace sample numbers. `unrecorded`, `decided_at`, `triggers`, `vacuous` and
    `never_triggered` are computed when they are first read.

    Attributes:
        robustness: The robustness at the first sample of the complete trace, as `evaluate` returns
            it; under ``"cut"`` moved to the nearest bound if it lies outside.
        lower: The smallest robustness that is possible under the end mode.
        upper: The largest robustness that is possible under the end mode.
        verdict: VIOLATED if ``upper`` is below 0 or -0.0, SATISFIED if ``lower`` is above 0 or
            +0.0; otherwise, UNDECIDED.
        end: The end mode: ``"complete"``, ``"cut"`` or ``"open"``.
        formula: The formula as text.
        complete: The verdict if the trace is complete.
        unknown: The variables with an unknown value (`UncertainValue`, ``nan="unknown"``).
    """

    robustness: float
    lower: float
    upper: float
    verdict: Verdict
    end: End
    formula: str
    complete: Verdict
    unknown: tuple[str, ...]
    _details: _Details

    open_for = OldName("undecided_because")
    untested = OldName("unrecorded")
    asked = OldName("triggers")
    never_asked = OldName("never_triggered")

    @staticmethod
    def of(
        trace: JudgedTrace,
        bounds: tuple[float, float, float],
        complete: tuple[float, float],
        unknown: tuple[str, ...],
    ) -> Judgement:
        """Return the judgement of a trace from its bounds and the bounds of the complete trace."""
        verdict = Verdict(verdict_of(*bounds[1:]))
        return Judgement(
            *(*bounds, verdict, trace.end, text_of(trace.formula)),
            *(Verdict(verdict_of(*complete)), unknown, _Details(trace, verdict)),
        )

    @property
    def undecided_because(self) -> str:
        """Why the verdict on the complete trace is undecided; empty if it is decided."""
        if self.complete is not Verdict.UNDECIDED:
            return ""
        if self.unknown:
            return f"values of {', '.join(self.unknown)} that are not known"
        return "a predicate that counts 0"

    @property
    def unrecorded(self) -> tuple[Unrecorded, ...]:
        """The times that the verdict needs and the trace lacks; empty if it is decided."""
        return self._details.unrecorded

    @property
    def decided_at(self) -> float | None:
        """The sample at which `EpisodeMonitor` decides; None if no sample decides."""
        return self._details.decided_at

    @property
    def triggers(self) -> tuple[Any, ...]:
        """How often each implication was triggered, a `TriggerCount` for each.

        Only implications in positive position count: if their robustness rises, the robustness of
        the formula does not fall. They are in the order of the text, the outer implication first.
        """
        return self._details.evidence.triggers

    @property
    def vacuous(self) -> bool:
        """Whether the verdict is SATISFIED, and would be with all right sides ``false``.

        It is False for a formula without an implication.
        """
        return self._details.evidence.vacuous

    @property
    def never_triggered(self) -> bool:
        """Whether the verdict is SATISFIED, and no implication of the formula was triggered."""
        return self._details.evidence.never_triggered

    def _robustness_text(self) -> str:
        open_ = {self.verdict, self.complete} == {Verdict.UNDECIDED}
        if self.robustness == 0.0 and not open_:
            return zero_text(held=bool(holds(self.robustness)))
        return rounded(self.robustness)

    def _values(self) -> tuple[object, ...]:
        return (
            *(self.robustness, self.lower, self.upper, self.verdict, self.end, self.formula),
            *(self.complete, self.unknown, self.unrecorded, self.decided_at),
            *(self.triggers, self.vacuous),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Judgement):
            return NotImplemented
        return self._values() == other._values()

    def __hash__(self) -> int:
        return hash((self.robustness, self.lower, self.upper, self.end, self.formula))

    def __repr__(self) -> str:
        values = f"robustness={self.robustness}, lower={self.lower}, upper={self.upper}"
        return f"<Judgement {self.verdict.name}, {values}, end={self.end!r}>"

    def __str__(self) -> str:
        lines = [f"{self.verdict.name}: {self.formula}", *self._lines()]
        return "\n".join(part for line in lines for part in wrapped(line))

    def _repr_html_(self) -> str:
        """Return the text for notebooks, with a coloured verdict."""
        head = f"{self.verdict._repr_html_()} <code>{escape(self.formula)}</code>"
        return "<br>".join([head, *map(escape, self._lines())])

    def _lines(self) -> Iterator[str]:
        """Yield the lines below the formula, before they are wrapped."""
        bounds = f"bounds {rounded(self.lower)} to {rounded(self.upper)}"
        yield f'robustness {self._robustness_text()}, {bounds} under end="{self.end}"'
        yield from map(str, self.unrecorded)
        if early_end := self._details.early_end:
            yield early_end
        for trigger in self.triggers:
            # The left side may hold at an instant with unknown values.
            never = trigger.first is None and bool(self.unknown)
            text = "not certainly triggered" if never else str(trigger)
            yield text if len(self.triggers) == 1 else f"{text}: {trigger.text}"
        if self.verdict is Verdict.UNDECIDED:
            if self.complete is Verdict.UNDECIDED:
                yield f"undecided under every end mode: it depends on {self.undecided_because}"
            else:
                yield f'if nothing follows (end="complete"), the verdict is {self.complete.name}'


@listed_in_signature(SampleOptions)
def judge(
    spec: Spec,
    signals: TraceColumns,
    period: Period | None = None,
    end: End = "cut",
    *,
    n: int | None = None,
    **options: Unpack[SampleOptions],
) -> Judgement:
    """Return the verdict on a recorded trace of samples, by what its end means.

    It is the verdict of `EpisodeMonitor` after ``finish(end)``, about the first sample; write
    invariants with ``always(...)``. A million samples take 1.3 to 4.2 times as long as `evaluate`.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: As for `evaluate`; a column may also be an `UncertainValue` of two arrays.
        period: As for `Monitor`.
        end: The end mode. ``"complete"``: nothing follows, and windows are cut to the trace.
            ``"cut"``: the trace is a recording; samples after it are unknown to bounded windows,
            and future operators without an end cover the recorded time. ``"open"``: anything may
            follow, so the verdict holds for every continuation. See `EpisodeMonitor.finish`.
        n: The length, for a formula without variables.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `Monitor`; ``nan="unknown"`` reads nan as an unknown value.

    Raises:
        SpecificationError: As for `evaluate`.
        InputError: As for `evaluate`, and on another end mode.
        InputTypeError: As for `evaluate`.

    Example:
        >>> trace = {"req": [0, 4, 0, 0, 4], "gnt": [0, 0, 5, 0, 0]}
        >>> spec = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
        >>> print(judge(spec, trace, period=1))
        UNDECIDED: always(req >= 3 implies eventually[0:2](gnt >= 3))
        robustness -1, bounds -1 to 2 under end="cut"
        eventually[0:2](gnt >= 3) at 4 s: not recorded: 5 s to 6 s
        triggered 2 times, first at sample 1
        if nothing follows (end="complete"), the verdict is VIOLATED
        >>> judge(spec, trace, period=1, end="complete").verdict.name
        'VIOLATED'
        >>> quiet = judge(spec, {"req": [0, 0, 0], "gnt": [0, 0, 0]}, end="complete")
        >>> quiet.verdict.name, quiet.never_triggered, quiet.triggers[0].count
        ('SATISFIED', True, 0)

        >>> print(judge("always(x > 1)", {"x": [3, float("nan"), 5]}, nan="unknown"))
        UNDECIDED: always(x > 1)
        robustness -inf, bounds -inf to 2 under end="cut"
        undecided under every end mode: it depends on values of x that are not known
    """
    mode = checked_end(end)
    program = compiled(judge, spec, period, options, online=False)
    return judge_compiled(program, mode, signals, n)


def judge_compiled(program: Compiled, mode: End, signals: TraceColumns, n: int | None) -> Judgement:
    """Return the judgement of `judge` for a specification that is already compiled."""
    reader = SampleReader(program.program, program.nan, bounds=True)
    period = program.period
    least, greatest, length = trace_between(reader, signals, n, period)
    limit_beyond(program.program, length, unknown=greatest is not least)
    unknown = []
    if greatest is not least:
        pairs = zip(program.program.inputs, least, greatest, strict=False)  # rates follow
        unknown = [name for name, low, high in pairs if not identical(low, high)]
    trace = SampleTrace(program, mode, (least, greatest), length)
    bounds, complete = trace.judge()
    return Judgement.of(trace, bounds, complete, tuple(unknown))


@listed_in_signature(EventOptions)
def judge_dense(
    spec: Spec,
    signals: Mapping[str, EventsLike],
    end: End = "cut",
    *,
    until: Until | None = None,
    resolution: Period = "1ns",
    **options: Unpack[EventOptions],
) -> Judgement:
    """Return the verdict on a recorded trace in dense time, by what its end means.

    It is about the first time at which all variables are known, and exact at that instant: values
    at single instants count, unlike in `rtamt.dense.evaluate`. The trace ends at the earliest of
    the variables' last events. If others have later events, the text of the result names that
    variable; ``until`` holds its last value. Write invariants with ``always(...)``.

    Args:
        spec: Text, a formula, or a parsed specification.
        signals: As for `rtamt.dense.evaluate`; a value may also be an `UncertainValue`.
        end: As for `judge`: ``"complete"``, ``"cut"`` or ``"open"``.
        until: A time up to which the last value of each variable holds, as if an event at that time
            repeated it; ``"latest"`` for the time of the last event of all variables of the
            formula. Beyond ``max_gap`` the value is unknown. Default: the trace ends with the
            earliest of the last events.
        resolution: As for `rtamt.dense.Monitor`.
        **options: ``semantics``, ``inputs``, ``outputs`` and ``backend``, as for `Monitor`; ``nan``
            and ``max_gap``, as for `rtamt.dense.EpisodeMonitor`.

    Returns:
        The judgement. Its ``decided_at`` is a time of the kind of the events' times, also
        `numpy.datetime64`; ``unrecorded`` is in seconds, for dates since 1970.

    Raises:
        SpecificationError: As for `rtamt.dense.evaluate`.
        InputError: As for `rtamt.dense.evaluate`; on another end mode; on a time ``until``
            before the last event of every variable; and on a trace that with the bounds of the
            formula lasts 2^62 ticks or more.
        InputTypeError: As for `rtamt.dense.evaluate`.

    Example:
        >>> import rtamt
        >>> trace = {"req": [(0, 0), (1, 4), (1.5, 0), (6, 0)], "gnt": [(0, 0), (2.25, 5), (6, 5)]}
        >>> response = "always(req >= 3 implies eventually[0:2](gnt >= 3))"
        >>> verdict = rtamt.dense.judge(response, trace)
        >>> print(verdict.verdict.name, verdict.triggers[0], sep=", ")
        SATISFIED, triggered 1 time, first at time 1
        >>> print(rtamt.dense.judge("always[0:8](gnt < 9)", trace))
        UNDECIDED: always[0:8](gnt < 9)
        robustness 4, bounds -inf to 4 under end="cut"
        always[0:8](gnt < 9): not recorded: 6 s to 8 s
        if nothing follows (end="complete"), the verdict is SATISFIED

        With ``until="latest"``, a value that was written once holds to the end:

        >>> flight = {"z": [(0, -10), (6, -500), (9, -10)], "home": [(0, 0)]}
        >>> print(rtamt.dense.judge("always(z - home > -100)", flight))
        SATISFIED: always(z - home > -100)
        robustness 90, bounds 90 to 90 under end="cut"
        the trace ends at time 0 with the last event of 'home' and leaves out 2 later
            events; until="latest" holds its value
        >>> rtamt.dense.judge("always(z - home > -100)", flight, until="latest").verdict.name
        'VIOLATED'

    Source: see `rtamt.dense.Monitor`.
    """
    mode = checked_end(end)
    parts = compiled_regions(judge_dense, spec, resolution, options)
    trace = DenseTrace(parts, mode, signals, until)
    return Judgement.of(trace, trace.values, trace.complete, trace.unknown())


_NOTHING: Evidence[Any] = Evidence((), vacuous=False, never_triggered=False)


class _Implications:
    """The common part of both kinds of implications."""

    __slots__ = ("_formula", "texts", "variables")

    def _describe(self, formula: Formula, variables: tuple[str, ...]) -> None:
        self._formula, self.texts, self.variables = formula, texts_of(formula), variables

    def __bool__(self) -> bool:
        return bool(self.texts)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._formula}: {len(self.texts)}>"

    def _needs_trace(self, verdict: object) -> bool:
        """Check a verdict, and return whether there are implications to count."""
        if verdict is not None and not isinstance(verdict, Verdict):
            raise InputTypeError(f"expected an rtamt.Verdict, got {brief(verdict)}")
        return bool(self.texts)


class Implications(_Implications):
    """The implications of a specification, and their triggers on traces with a known verdict.

    The specification is compiled once, for many traces. `judge` counts the same for one trace.

    Attributes:
        texts: The implications that count, in positive position, as text; empty if a verdict on the
            specification needs no trigger.
        variables: The variables of the specification, in the order of columns.

    Args:
        spec: Text, a formula, or a parsed specification.
        period: As for `Monitor`.
        **options: ``semantics``, ``inputs``, ``outputs``, ``backend``, ``nan`` and ``align``, as
            for `judge`.

    Raises:
        SpecificationError: As for `judge`.

    Example:
        >>> response = Implications("always(req >= 3 implies eventually[0:2](gnt >= 3))")
        >>> response.texts
        ('req >= 3 implies eventually[0:2](gnt >= 3)',)
        >>> evidence = response.evidence({"req": [0, 4, 0, 4], "gnt": [0, 0, 5, 5]})
        >>> print(evidence.triggers[0], evidence.vacuous, evidence.never_triggered)
        triggered 2 times, first at sample 1 False False
        >>> bool(Implications("always(gnt >= 3)"))
        False
    """

    __slots__ = ("_compiled", "_period")

    @listed_in_signature(SampleOptions)
    def __init__(
        self, spec: Spec, period: Period | None = None, **options: Unpack[SampleOptions]
    ) -> None:
        self._compiled = compiled(Implications, spec, period, options, online=False)
        self._period = period
        self._describe(self._compiled.specification.formula, self._compiled.program.inputs)

    def evidence(
        self,
        signals: TraceColumns,
        end: End = "complete",
        verdict: Verdict | None = None,
        *,
        n: int | None = None,
    ) -> Evidence[TriggerCount]:
        """Return how often a trace triggers the implications, as `judge` does.

        Args:
            signals: As for `judge`. It is ignored if there is no implication.
            end: The end mode, as for `judge`.
            verdict: The verdict on the trace. Default: the verdict of `judge`.
            n: The length, for a formula without variables.

        Raises:
            InputError: As for `judge`.
            InputTypeError: As for `judge`, and if ``verdict`` is not a verdict.
        """
        mode = checked_end(end)
        if not self._needs_trace(verdict):
            return _NOTHING
        reader = SampleReader(self._compiled.program, self._compiled.nan, bounds=True)
        least, greatest, length = trace_between(reader, signals, n, self._period)
        trace = SampleTrace(*(self._compiled, mode, (least, greatest), length), by_columns=True)
        satisfied = trace.satisfied_without(()) if verdict is None else verdict > 0
        return evidence_of(trace, satisfied=satisfied)


class DenseImplications(_Implications):
    """The implications of a specification, and their triggers in dense time: see `Implications`.

    Attributes:
        texts: As for `Implications`.
        variables: The variables of the specification.

    Args:
        spec: Text, a formula, or a parsed specification.
        resolution: As for `rtamt.dense.Monitor`.
        **options: As for `rtamt.dense.judge`.

    Raises:
        SpecificationError: As for `rtamt.dense.judge`.

    Example:
        >>> from rtamt.dense import Implications
        >>> response = Implications("always(req >= 3 implies eventually[0:2](gnt >= 3))")
        >>> trace = {"req": [(0, 0), (1, 4), (1.5, 0), (6, 0)], "gnt": [(0, 5), (6, 5)]}
        >>> print(response.evidence(trace).triggers[0])
        triggered 1 time, first at time 1
    """

    __slots__ = ("_compiled",)

    @listed_in_signature(EventOptions)
    def __init__(
        self, spec: Spec, *, resolution: Period = "1ns", **options: Unpack[EventOptions]
    ) -> None:
        self._compiled = compiled_regions(DenseImplications, spec, resolution, options)
        self._describe(
            self._compiled.specification.formula, self._compiled.program.program.variables
        )

    def evidence(
        self,
        signals: Mapping[str, EventsLike],
        end: End = "complete",
        verdict: Verdict | None = None,
    ) -> Evidence[DenseTriggerCount]:
        """Return how often a trace triggers the implications, as `rtamt.dense.judge` does.

        Args:
            signals: As for `rtamt.dense.judge`. It is ignored if there is no implication.
            end: As for `Implications.evidence`.
            verdict: As for `Implications.evidence`.

        Raises:
            InputError: As for `rtamt.dense.judge`.
            InputTypeError: As for `rtamt.dense.judge`, and if ``verdict`` is not a verdict.
        """
        mode = checked_end(end)
        if not self._needs_trace(verdict):
            return _NOTHING
        trace = DenseTrace(self._compiled, mode, signals)
        satisfied = verdict_of(*trace.values[1:]) if verdict is None else verdict
        return evidence_of(trace, satisfied=satisfied > 0)
