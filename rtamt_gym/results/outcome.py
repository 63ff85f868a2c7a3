"""`Outcome`: the result of one requirement in one run or trace; `Moment`: its time.

To add a field of `Outcome`: the field with a default here, and its line in `plain_outcome` and
`outcome_of` of `rtamt_gym.results.codec`. To show it on the page, add it to `TrialRow` in
`rtamt_gym.reports.model`, to `_evidence` in `rtamt_gym.reports.requirements`, and to `standing_of`
in `rtamt_gym.reports.html` for the first line of the page.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from fractions import Fraction
from typing import Any, Final, Literal, Self

import rtamt
from rtamt import Verdict
from rtamt.monitors import Evidence, Occurrences, TriggerCount
from rtamt.renamed import OldName
from rtamt_gym.results.extent import LateStart

BY_END: Final = "by how it ended"
"""The remark on a violation at a robustness that holds."""

Word = Literal["failed", "violated", "undecided", "satisfied"]
"""The outcome of a requirement; failed: an error ended the run, or it could not be judged."""


@dataclass(frozen=True, slots=True)
class Moment:
    """An instant of a run or a trace.

    Attributes:
        sample: The number of its sample, from 0 on; None in dense time, or if it is unknown.
        seconds: Its time in seconds, for a recorded trace on the clock of the trace; None without a
            period.

    Example:
        >>> Moment.of(3, Fraction(1, 2)), Moment.of(3, None).time
        (Moment(sample=3, seconds=1.5), 3)
    """

    sample: int | None
    seconds: float | None

    @classmethod
    def of(cls, sample: int, period: Fraction | None, start: float = 0.0) -> Self:
        """Return the moment of a sample; ``start`` is the time of sample 0."""
        if period is None:
            return cls(sample, None)
        # equals the float of a Fraction in a tenth of the time
        return cls(sample, start + sample * period.numerator / period.denominator)

    @property
    def time(self) -> float | None:
        """The seconds; without a period, the number of the sample."""
        return self.sample if self.seconds is None else self.seconds


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a requirement in one run or on one trace.

    Attributes:
        robustness: The robustness at the end, or at the stop of a run.
        lower: The minimum robustness that was still possible then.
        upper: The maximum robustness that was still possible then.
        verdict: The verdict at the end.
        decided: The moment of the sample that decided the verdict; None if it is open, or if only
            the end decided it.
        text: The verdict in words; may be empty.
        not_recorded: The times that an open verdict needs and the trace lacks.
        way_out: How to decide an open verdict; empty if it is decided.
        explanation: The samples that decided; empty if it was not requested.
        triggers: How often each implication of the requirement was triggered, as
            `rtamt.Judgement.triggers` counts it; empty without implications, None if it was not
            counted.
        vacuous: Whether it was satisfied without an answer (`rtamt.Judgement.vacuous`).
        defaults: The declared defaults that it read in a recorded trace, by variable.
        unknown: The variables with unknown values (`rtamt.Judgement.unknown`).
        progress: The progress through its stages, from 0 to 1; 1 only if it is satisfied. None
            without stages (`rtamt.patterns.stages`), in dense time, or if it was not counted.
        late_start: The start of its trace, if it is later than the recording; otherwise None.
        ended: The moment of the last sample of a run, if only the end decided the verdict;
            otherwise None, as for a recorded trace.
        occurrences: All violations on a recorded trace; None if they were not requested.
    """

    robustness: float
    lower: float
    upper: float
    verdict: Verdict
    decided: Moment | None = None
    text: str = ""
    not_recorded: tuple[str, ...] = ()
    way_out: str = ""
    explanation: str = ""
    triggers: tuple[TriggerCount | rtamt.dense.TriggerCount, ...] | None = None
    vacuous: bool = False
    defaults: Mapping[str, float] = field(default_factory=dict, hash=False)
    unknown: tuple[str, ...] = ()
    progress: float | None = None
    late_start: LateStart | None = None
    ended: Moment | None = None
    occurrences: Occurrences | None = field(default=None, hash=False)

    asked = OldName("triggers")
    never_asked = OldName("never_triggered")
    occasions = OldName("trigger_count")

    def __repr__(self) -> str:
        shown = [f"{field.name}={getattr(self, field.name)!r}" for field in fields(self)]
        shown += ["by_end=True"] * self.by_end
        return f"{type(self).__name__}({', '.join(shown)})"

    @classmethod
    def at(
        cls,
        bounds: Sequence[float],
        verdict: Verdict,
        sample: int | None,
        period: Fraction | None,
        stands_on: Evidence[TriggerCount] | None = None,
        progress: float | None = None,
        *,
        ended: int | None = None,
    ) -> Self:
        """Return the outcome of a run of samples.

        Args:
            bounds: The robustness, and the minimum and maximum that were still possible.
            verdict: The verdict.
            sample: The sample that decided it, or None.
            period: Seconds between samples, or None.
            stands_on: How often it was triggered; None if it was not counted.
            progress: The progress through its stages, or None.
            ended: The last sample, if only the end decided it; otherwise None.
        """
        robustness, lower, upper = bounds
        decided, last = (
            None if sample_number is None else Moment.of(sample_number, period)
            for sample_number in (sample, ended)
        )
        triggers, vacuous = (
            (None, False) if stands_on is None else (stands_on.triggers, stands_on.vacuous)
        )
        return cls(
            *(robustness, lower, upper, verdict, decided),
            triggers=triggers,
            vacuous=vacuous,
            progress=progress,
            ended=last,
        )

    @classmethod
    def of_height(cls, robustness: float) -> Self:
        """Return the outcome of a robustness that is certain: satisfied from 0.0 on."""
        verdict = Verdict.VIOLATED if math.copysign(1.0, robustness) < 0 else Verdict.SATISFIED
        return cls(robustness, robustness, robustness, verdict)

    @property
    def decided_at(self) -> float | None:
        """The time of ``decided`` in seconds; without a period, the number of its sample."""
        return None if self.decided is None else self.decided.time

    @property
    def settled(self) -> Moment | None:
        """``decided``, or ``ended`` if only the end decided the verdict."""
        return self.decided or self.ended

    @property
    def violated(self) -> Moment | None:
        """``settled`` of a violation; None without one."""
        return self.settled if self.verdict is Verdict.VIOLATED else None

    @property
    def violated_at(self) -> float | None:
        """The time of ``violated``, as ``decided_at`` is the time of ``decided``."""
        return None if self.violated is None else self.violated.time

    @property
    def never_triggered(self) -> bool:
        """Whether it is satisfied and no implication was triggered."""
        return self.verdict is Verdict.SATISFIED and self.trigger_count == 0

    @property
    def answered(self) -> bool:
        """Whether it was triggered, and an answer or a missing answer decided it."""
        if not self.trigger_count or self.by_end:
            return False
        satisfied = self.verdict is Verdict.SATISFIED and not self.vacuous
        return satisfied or self.verdict is Verdict.VIOLATED

    @property
    def trigger_count(self) -> int | None:
        """How many times its implications were triggered.

        None without implications, or if it was not counted.
        """
        return sum(implication.count for implication in self.triggers) if self.triggers else None

    @property
    def evidence(self) -> Mapping[str, Any] | None:
        """``asked``, ``vacuous`` and ``never_asked`` for JSON; None if they were not counted."""
        if self.triggers is None:
            return None
        stored: dict[str, Any] = {
            "asked": [_plain_row(implication) for implication in self.triggers]
        }
        if self.triggers:
            stored |= {"vacuous": self.vacuous, "never_asked": self.never_triggered}
        return stored

    @property
    def by_end(self) -> bool:
        """Whether only the end violated it, at a robustness that holds.

        Only ``at_termination="failure"`` causes this.
        """
        return violated_by_end(self.verdict, self.robustness)

    @property
    def bounds(self) -> tuple[float, float]:
        """``lower`` and ``upper``."""
        return self.lower, self.upper


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a requirement could not be judged."""

    message: str
    traceback: str = ""


def triggers_of(
    stored: Mapping[str, Any],
) -> tuple[TriggerCount | rtamt.dense.TriggerCount, ...] | None:
    """Return the rows that `Outcome.evidence` has written; None if triggers were not counted."""
    rows = stored.get("asked")
    if rows is None:
        return None
    return tuple(_row_of(row) for row in rows)


def _plain_row(row: TriggerCount | rtamt.dense.TriggerCount) -> dict[str, Any]:
    names = (field.name for field in fields(row))
    return {"occasions" if name == "count" else name: getattr(row, name) for name in names}


def _row_of(stored: Mapping[str, Any]) -> TriggerCount | rtamt.dense.TriggerCount:
    fields = {"count" if key == "occasions" else key: value for key, value in stored.items()}
    return TriggerCount(**fields) if "samples" in fields else rtamt.dense.TriggerCount(**fields)


WORDS: Final[Mapping[Verdict, Word]] = {
    Verdict.VIOLATED: "violated",
    Verdict.UNDECIDED: "undecided",
    Verdict.SATISFIED: "satisfied",
}


def word(outcome: Outcome | Failure | None) -> Word:
    """Return the outcome in a word; ``"failed"`` for a failure or None."""
    return WORDS[outcome.verdict] if isinstance(outcome, Outcome) else "failed"


def violated_by_end(verdict: Verdict, robustness: float) -> bool:
    """Return whether the end alone violates a requirement: its robustness holds.

    Example:
        >>> violated_by_end(Verdict.VIOLATED, 0.0), violated_by_end(Verdict.VIOLATED, -0.0)
        (True, False)
    """
    return verdict is Verdict.VIOLATED and math.copysign(1.0, robustness) > 0


def verdict_text(verdict: Verdict, robustness: float) -> str:
    """Return the name of a verdict, with a remark if only the end violated it.

    Example:
        >>> verdict_text(Verdict.VIOLATED, -1.0), verdict_text(Verdict.VIOLATED, 1.0)
        ('VIOLATED', 'VIOLATED by how it ended')
    """
    return f"{verdict.name} {BY_END}" if violated_by_end(verdict, robustness) else verdict.name


def order(robustness: float) -> tuple[float, float]:
    """Order robustness; -0.0, which violates, comes before 0.0."""
    return robustness, math.copysign(1.0, robustness)
