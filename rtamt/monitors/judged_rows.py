"""The judgements of a batch as objects, as `judge` returns them for single traces."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import Any

from rtamt.machines.protocols import End
from rtamt.monitors.judgement import Judgement
from rtamt.monitors.judgements import Judgements
from rtamt.monitors.triggers import Evidence, TriggerCount
from rtamt.monitors.unrecorded import Unrecorded
from rtamt.monitors.verdict import Verdict


class _RowDetails:
    """What the verdict on a trace of a batch rests on; the batch does not list unrecorded times."""

    __slots__ = "_alone", "_open", "decided_at", "evidence"

    early_end = ""

    def __init__(
        self,
        verdict: Verdict,
        end: End,
        decided_at: int | None,
        evidence: Evidence[Any],
        alone: Callable[[], Judgement],
    ) -> None:
        self._open = verdict is Verdict.UNDECIDED and end != "complete"
        self.decided_at, self.evidence, self._alone = decided_at, evidence, alone

    @property
    def unrecorded(self) -> tuple[Unrecorded, ...]:
        return self._alone().unrecorded if self._open else ()


def judgements_of(
    columns: Judgements, alone: Callable[[int], Judgement]
) -> Iterator[Judgement | None]:
    """Yield the judgement of each trace as `judge` returns it; None for one with an error.

    Args:
        columns: The judgements of the traces.
        alone: Judges the trace of a number, for the times that an open verdict needs.
    """
    verdicts = {verdict.value: verdict for verdict in Verdict}
    parts = [
        (part.text, *(column.tolist() for column in columns_of))
        for part in columns.triggers
        for columns_of in [(part.samples, part.count, part.first, part.vacuous)]
    ]
    none: Evidence[Any] = Evidence((), vacuous=False, never_triggered=False)
    numbers = zip(
        columns.robustness.tolist(),
        columns.lower.tolist(),
        columns.upper.tolist(),
        columns.verdict.tolist(),
        columns.complete.tolist(),
        columns.decided_at.tolist(),
        columns.vacuous.tolist(),
        strict=True,
    )
    end, formula = columns.end, columns.formula
    for i, (robustness, lower, upper, code, complete, decided, vacuous) in enumerate(numbers):
        if i in columns.errors:
            yield None
            continue
        verdict, evidence = verdicts[code], none
        if parts:
            triggers = tuple(
                TriggerCount(
                    text, samples[i], count[i], None if first[i] < 0 else first[i], alone_[i]
                )
                for text, samples, count, first, alone_ in parts
            )
            never = verdict is Verdict.SATISFIED and not any(row.count for row in triggers)
            evidence = Evidence(triggers, vacuous, never)
        details: Any = _RowDetails(
            verdict, end, None if decided < 0 else decided, evidence, functools.partial(alone, i)
        )
        yield Judgement(
            *(robustness, lower, upper, verdict, end, formula, verdicts[complete], ()),
            details,
        )
