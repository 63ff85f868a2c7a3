"""Explanations of a robustness, over samples and over dense time, and the table that they print."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple, cast

import numpy as np

from rtamt.language.formula import Formula
from rtamt.language.interval import number_text
from rtamt.monitors.verdict import holds, rounded, wrapped, zero_text
from rtamt.program.interface import PredicateValue
from rtamt.renamed import OldName

ShareRole = Literal["held", "missing", "broken"]
"""The way in which a formula contributes to a violation; see `Contribution`."""


class Cause(NamedTuple):
    """A value that a variable had at a sample."""

    variable: str
    sample: int
    value: float


@dataclass(frozen=True, slots=True)
class ExplanationStep:
    """A formula on the path from the specification down to the cause of its robustness.

    Attributes:
        formula: The formula.
        name: The name of the formula in the specification, or None.
        text: The formula as text; named formulas inside it are shown by their names.
        sample: The sample at which it was evaluated.
        time: The time of that sample in seconds; None without a period.
        value: The robustness at that sample.
        witness: For ``until``, ``since`` and ``unless``: the sample at which the right side was
            reached, whichever side decided, or the sample that comes nearest to reaching it if the
            formula fails; None without such a sample.
        outside: First and last sample of the formula's window if the window lies outside the trace
            and that decided: the formula is then +inf or -inf whatever the samples are. The first
            is None for a window without a start, the last for a window without an end.
        reading: The value of a predicate under the semantics: its usual ``"value"``, +inf or -inf
            by its ``"sign"``, or ``"zero"``.
        aligned: The interval of the operator under ``align=``; None if its bounds fit.
    """

    formula: Formula
    name: str | None
    text: str
    sample: int
    time: float | None
    value: float
    witness: int | None = None
    outside: tuple[int | None, int | None] | None = None
    reading: PredicateValue = "value"
    aligned: str | None = None


@dataclass(frozen=True, slots=True)
class Contribution:
    """A formula that contributes to a violation, in addition to the steps.

    For a violated response these are the request and the missing answer; for an ``until`` the left
    side that broke, and the right side that was not reached before.

    Attributes:
        formula: The formula.
        name: The name of the formula in the specification, or None.
        text: The formula as text; named formulas inside it are shown by their names.
        role: ``"held"``: it holds at all samples of ``window``. ``"missing"``: it fails at all
            samples of ``window``; to hold at one of them could have prevented the violation.
            ``"broken"``: it fails, and had to hold on a stretch of samples.
        window: The first and the last of the samples.
        sample: The first of these samples at which it comes nearest to the other sign.
        value: The robustness at ``sample``.
        outside: First and last sample of the formula's window if the window lies outside the trace;
            see `ExplanationStep`.
    """

    formula: Formula
    name: str | None
    text: str
    role: ShareRole
    window: tuple[int, int]
    sample: int
    value: float
    outside: tuple[int | None, int | None] | None = None


class DenseCause(NamedTuple):
    """A value that a variable had from a time on."""

    variable: str
    time: float
    value: float


@dataclass(frozen=True, slots=True)
class DenseExplanationStep:
    """A formula on the path from the specification down to the cause, in dense time.

    Times are of the kind of the events' times: numbers in the specification's unit, or
    `numpy.datetime64`. Attributes that are not listed are as for `ExplanationStep`, with times
    instead of samples.

    Attributes:
        time: The time at which it was evaluated.
        value: The robustness exactly at this time, or right after it.
        after: Whether it was evaluated right after ``time``: up to the next tick, excluding it.
        witness_after: Whether the right side was reached right after ``witness``.
    """

    formula: Formula
    name: str | None
    text: str
    time: float
    value: float
    witness: float | None = None
    outside: tuple[float | None, float | None] | None = None
    reading: PredicateValue = "value"
    after: bool = False
    witness_after: bool = False


@dataclass(frozen=True, slots=True)
class DenseContribution:
    """A formula that contributes to a violation in dense time, in addition to the steps.

    Attributes that are not listed are as for `Contribution`, with times instead of samples.

    Attributes:
        window: Start and end of the times at which it holds, or fails.
        time: The first of these times at which it comes nearest to the other sign.
        value: The robustness exactly at this time, or right after it.
        after: Whether it comes nearest right after ``time``.
        open_begin: Whether the start of ``window`` is not part of it.
        open_end: Whether the end of ``window`` is not part of it.
    """

    formula: Formula
    name: str | None
    text: str
    role: ShareRole
    window: tuple[float, float]
    time: float
    value: float
    outside: tuple[float | None, float | None] | None = None
    after: bool = False
    open_begin: bool = False
    open_end: bool = False


class _TextExplanation:
    """The common part of explanations; ``_place`` is the attribute of a step with its place."""

    _place: ClassVar[str]
    steps: tuple[Any, ...]
    causes: tuple[tuple[str, Any, float], ...]
    contributions: tuple[Any, ...]

    def _at(self, place: Any, *, after: bool = False) -> str:  # noqa: ANN401 - sample or time
        """Return the text of a place."""
        raise NotImplementedError

    def _begins_after(self, first: object) -> bool:  # noqa: ARG002 - only in dense time
        """Return whether a window outside the trace starts right after its end."""
        return False

    @property
    def robustness(self) -> float:
        """The robustness that is explained."""
        value: float = self.steps[0].value
        return value

    @property
    def predicate(self) -> Formula | None:
        """The predicate that decided; None if a window outside the trace did."""
        last = self.steps[-1]
        return cast("Formula", last.formula) if last.outside is None else None

    @property
    def reason(self) -> str:
        """The deciding predicate, its time or sample, and the values there, in a phrase."""
        values = " and ".join(f"{name} = {rounded(value)}" for name, _, value in self.causes)
        return f"{self._decision}{f', where {values}' if values else ''}"

    @property
    def _decision(self) -> str:
        last = self.steps[-1]
        cause = last.text if last.outside is None else "a window outside the trace"
        when = self._at_step(last)
        return f"decided by {cause} {when if when.startswith('after ') else f'at {when}'}"

    def __str__(self) -> str:
        first, start = self.steps[0], self._at_step(self.steps[0])
        head = f"robustness {self._value_text(first, ',')} at {start}, {self._decision}"
        rows = [("at", "value", "formula"), *self._rows()]
        widths = [max(len(row[i]) for row in rows) for i in range(2)]
        lines = [*wrapped(head), ""]
        for where, value, shown in rows:
            lines += wrapped(shown, f"{where:>{widths[0]}}  {value:>{widths[1]}}  ")
        return "\n".join(lines)

    def _rows(self) -> Iterator[tuple[str, str, str]]:
        for step in self.steps:
            yield self._at_step(step), self._value_text(step), _shown(step)
            for note in self._notes(step):
                yield "", "", f"  {note}"
        for variable, position, value in self.causes:
            yield self._at(position), rounded(value), variable
        for part in self.contributions[:_MAX_SHOWN]:
            yield self._at_step(part), rounded(part.value), f"{part.role}: {_shown(part)}"
            first, last = part.window
            if first != last:
                missing = part.role == "missing"
                where, this = ("never", "nearest") if missing else ("always", "minimum")
                span = f"from {self._at(first)} to {self._at(last)}"
                yield "", "", f"  {where} {span}; this is the {this}"
            if part.outside is not None:
                yield "", "", f"  {self._outside(part.outside)}"
        if len(self.contributions) > _MAX_SHOWN:
            yield "", "", f"and {len(self.contributions) - _MAX_SHOWN} more"

    def _at_step(self, step: Any) -> str:  # noqa: ANN401 - a step or a contribution
        return self._at(getattr(step, self._place), after=getattr(step, "after", False))

    def _value_text(self, step: Any, ending: str = "") -> str:  # noqa: ANN401 - a step
        """Return a robustness as text; for 0, also whether the formula holds."""
        if step.value or self.steps[-1].reading == "zero":
            return rounded(step.value)
        return f"{zero_text(held=holds(step.value))}{ending}"

    def _notes(self, step: Any) -> Iterator[str]:  # noqa: ANN401 - a step
        if aligned := getattr(step, "aligned", None):
            yield aligned
        if step.witness is not None:
            # A 0 that depends on a predicate of no concern neither holds nor fails.
            held = holds(step.value) and (step.value != 0 or self.steps[-1].reading != "zero")
            position = self._at(step.witness, after=getattr(step, "witness_after", False))
            yield f"{'witness' if held else 'nearest'}: the right side at {position}"
        if step.outside is not None:
            yield self._outside(step.outside)
        if step.reading == "sign":
            yield "counts only whether it holds"
        elif step.reading == "zero":
            yield "of no concern: counts 0"

    def _outside(self, outside: tuple[Any, Any]) -> str:
        first, last = (None if position is None else self._at(position) for position in outside)
        window = f"{first} to {last}" if first != last else first
        if first is None:
            window = f"up to {last}"
        elif last is None:
            window = f"from {first} on"
        after = "right after that time, " if self._begins_after(outside[0]) else ""
        return f"{after}its window lies outside the trace: {window}"


@dataclass(frozen=True)
class Explanation(_TextExplanation):
    """The formulas and samples that decided a robustness.

    ``str`` returns a table of at most 80 columns.

    Attributes:
        steps: The path from the specification down; each step takes its value, or the opposite,
            from the step below it. The last step is the predicate that decided, ``true`` or
            ``false``, or a temporal operator whose window lies outside the trace.
        causes: The variables of that predicate with their values at the sample of the last step;
            empty if a window outside the trace decided.
        period: Seconds between samples, or None.
        start: Time of the first sample in seconds.
        contributions: The other formulas that contribute to a violation; empty without a violation.
            The violation stays as long as the last step and these formulas keep their signs.
    """

    _place: ClassVar = "sample"

    steps: tuple[ExplanationStep, ...]
    causes: tuple[Cause, ...]
    period: float | None = None
    start: float = 0.0
    contributions: tuple[Contribution, ...] = ()

    circumstances = OldName("contributions")

    @property
    def sample(self) -> int:
        """The sample whose robustness is explained."""
        return self.steps[0].sample

    def _at(self, place: int, *, after: bool = False) -> str:  # noqa: ARG002 - samples last no time
        if self.period is None:
            return f"sample {place}"
        time = self.start + place * self.period
        # Enough digits to distinguish two samples.
        count = max(abs(time) / self.period, 1.0)
        if count > _MAX_COUNT:
            return f"{number_text(time)} s"
        return f"{time:.{max(int(math.log10(count)) + 3, 6)}g} s"


@dataclass(frozen=True)
class DenseExplanation(_TextExplanation):
    """The formulas and times that decided a robustness in dense time.

    ``str`` returns a table of at most 80 columns.

    Attributes:
        steps: As for `Explanation`.
        causes: The variables of the predicate with their values at the time of the last step;
            empty if a window outside the trace decided.
        end: The time at which the trace ends.
        unit: The unit of the times, ``"s"`` unless the specification has another.
        contributions: As for `Explanation`.
    """

    _place: ClassVar = "time"

    steps: tuple[DenseExplanationStep, ...]
    causes: tuple[DenseCause, ...]
    end: float
    unit: str = "s"
    contributions: tuple[DenseContribution, ...] = ()

    circumstances = OldName("contributions")

    @property
    def time(self) -> float:
        """The time whose robustness is explained."""
        return self.steps[0].time

    def _at(self, place: object, *, after: bool = False) -> str:
        if after:
            return f"after {self._at(place)}"
        if isinstance(place, np.datetime64):
            date, point, part = str(place).partition(".")
            part = part.rstrip("0")
            return f"{date}{point}{part}" if part else date
        return f"{number_text(float(cast('float', place)))} {self.unit}"

    def _begins_after(self, first: object) -> bool:
        return first == self.end


_MAX_SHOWN = 20
"""The maximum number of contributions in a text."""

_MAX_COUNT = 1e14
"""The number of samples above which doubles cannot distinguish their times."""


def _shown(step: Any) -> str:  # noqa: ANN401 - a step or a contribution
    text: str = step.text
    return text if step.name is None else f"{step.name} = {text}"
