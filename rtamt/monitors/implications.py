"""Triggers of implications on a judged trace, and on traces with a known verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Unpack, cast

from rtamt.errors import InputTypeError, brief
from rtamt.inputs.events import EventsLike
from rtamt.inputs.samples import SampleReader, TraceColumns
from rtamt.language.formula import Formula
from rtamt.machines.protocols import End
from rtamt.machines.state import verdict_of
from rtamt.monitors.dense_trace import DenseTrace
from rtamt.monitors.evaluation import trace_between
from rtamt.monitors.options import (
    EventOptions,
    SampleOptions,
    Spec,
    checked_end,
    compiled,
    compiled_regions,
    listed_in_signature,
)
from rtamt.monitors.sample_trace import SampleTrace
from rtamt.monitors.triggers import DenseTriggerCount, Evidence, TriggerCount, text_of, texts_of
from rtamt.monitors.verdict import Verdict
from rtamt.program.implications import Counted, implications
from rtamt.program.timing import Period

JudgedTrace = SampleTrace | DenseTrace
"""A trace with a verdict."""

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


_NOTHING: Evidence[Any] = Evidence((), vacuous=False, never_triggered=False)
