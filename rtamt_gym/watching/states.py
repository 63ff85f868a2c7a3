"""The monitors of one requirement on the trace of one group, and its lines."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from operator import itemgetter
from typing import Any, Final, Literal

import rtamt
from rtamt import Verdict
from rtamt.typing import End
from rtamt_gym.judging.monitors import EXACT
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.recorded.recording import Floats
from rtamt_gym.tables import number
from rtamt_gym.watching.evidence import StreamEvidence
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.notes import StreamNotes
from rtamt_gym.watching.period_note import GroupPeriods

StreamStop = Literal["end", "violation", "decided"]
"""When a stream stops: at its end, at the first violation, or once everything is decided."""

RowValues = Sequence[float]


@dataclass
class StreamRules:
    """How the traces of a stream are judged.

    Attributes:
        specs: The requirements by name.
        variables: The variables in the order of the values of a row.
        reading: The options of evaluation, which allow unknown values if there may be some.
        emit: Takes each line.
        every: Whether every sample has lines.
        stop: When the stream stops.
        show: Takes a group and its newest row, after its lines; None: nothing shows rows.
        options: The keywords of monitors by the period.
        undecided: The number of undecided verdicts of all groups so far.
        source: The name of the stream, for messages.
        notes: The notes on how rows were read.
        evidence: The triggers of implications.
        periods: The periods of groups that have ended.
    """

    specs: Mapping[str, rtamt.Specification]
    variables: Sequence[str]
    reading: EvaluationOptions
    emit: Callable[[Line], None]
    every: bool = False
    stop: StreamStop = "end"
    show: Callable[[Any, RowValues], None] | None = None
    options: dict[Fraction | None, Mapping[str, Mapping[str, Any]]] = field(default_factory=dict)
    undecided: int = 0
    source: str = ""
    notes: StreamNotes = field(default_factory=StreamNotes)
    evidence: StreamEvidence = field(init=False)
    periods: GroupPeriods = field(default_factory=GroupPeriods)

    def __post_init__(self) -> None:
        self.evidence = StreamEvidence(self.specs, self.reading.view)

    @property
    def by_step(self) -> bool:
        """Whether lines are about instants."""
        return self.reading.view == "step"

    def objects_hint(self, group: str | None) -> str:
        """Return the advice for two values at one time; empty in a group."""
        return "" if group is not None else "; give --by COLUMN if rows are of several objects"

    def keywords(self, name: str, period: Fraction | None) -> Mapping[str, Any]:
        """Return the keywords of a monitor of a requirement."""
        if period not in self.options:
            reading = self.reading if period is None else self.reading.having(period=period)
            viewed_specs = {n: viewed(spec, self.reading.view) for n, spec in self.specs.items()}
            self.options[period] = reading.from_monitors(viewed_specs)
        return self.options[period][name]

    def picker(self, variables: Sequence[str]) -> Callable[[RowValues], RowValues]:
        """Return the function that takes the values of some variables from a row."""
        places = [self.variables.index(name) for name in variables]
        if places == [*range(len(self.variables))]:
            return _all_values
        if len(places) == 1:
            (position,) = places
            return lambda row: (row[position],)
        return itemgetter(*places) if places else lambda _: ()

    def values_text(self, variables: Sequence[str], row: RowValues) -> str:
        """Return the values of variables as text."""
        values = dict(zip(self.variables, row, strict=True))
        return ", ".join(
            f"{name} = {'unknown' if math.isnan(values[name]) else number(values[name])}"
            for name in variables
        )


def _all_values(row: RowValues) -> RowValues:
    return row


class InstantTail:
    """The samples of the instants that no monitor has settled.

    Args:
        spec: The requirement at one instant.
        pending: The number of instants that wait for later samples; None if all wait for the end.
        keywords: The keywords of monitors.
    """

    def __init__(
        self, spec: rtamt.Specification, pending: int | None, keywords: Mapping[str, Any]
    ) -> None:
        self._spec, self._pending, self._keywords = spec, pending, keywords
        looks_back = any(
            node.op is not None and (node.op.sampled or node.op.timed) and not node.op.future
            for node in spec.formula.nodes()
        )
        # An operator of the past may reach back to the first sample.
        self._rows: deque[RowValues] = deque(maxlen=None if looks_back and pending else pending)

    @property
    def whole(self) -> bool:
        """Whether the counts are of all instants, and not of the pending ones."""
        return self._rows.maxlen is None

    def add(self, row: RowValues) -> None:
        """Keep a sample."""
        self._rows.append(row)

    def counts(self, end: End) -> Counter[Verdict]:
        """Return the numbers of decided instants among the kept samples.

        Args:
            end: The end mode.
        """
        counts, n = Counter[Verdict](), len(self._rows)
        if not n or self._keywords["semantics"] not in EXACT:
            return counts
        columns = {
            name: [row[place] for row in self._rows]
            for place, name in enumerate(self._spec.variables)
        }
        formula = self._spec.formula
        for verdict, left in ((Verdict.SATISFIED, formula), (Verdict.VIOLATED, ~formula)):
            # An implication that is read at every sample is triggered where its left side is
            # certain.
            counted = self._spec.with_result(left.implies(_NEVER).always())
            judgement = rtamt.judge(counted, columns, end=end, n=n, **self._keywords)
            counts[verdict] = judgement.triggers[0].samples
        return counts


_NEVER: Final = rtamt.parse("1 < 0").formula
"""A false formula; an implication of the word `false` is not counted."""


class SampledState:
    """A requirement on the samples of one trace.

    Args:
        rules: How traces are judged.
        name: The requirement.
        period: Seconds between samples; None if bounds count samples.
    """

    def __init__(self, rules: StreamRules, name: str, period: Fraction | None) -> None:
        spec, keywords = rules.specs[name], rules.keywords(name, period)
        self.name, self._rules = name, rules
        self.monitor = rtamt.EpisodeMonitor(viewed(spec, rules.reading.view), **keywords)
        self.update = self.monitor.update
        self.pick = rules.picker(self.monitor.variables)
        self._places = [rules.variables.index(variable) for variable in self.monitor.variables]
        self.verdict = Verdict.UNDECIDED
        self.decided_at: int | None = None
        self.reason = ""
        self._instants: rtamt.Monitor | None = None
        self.instants = Counter[Verdict]()
        self._last_instant: Verdict | None = None
        self._tail: InstantTail | None = None
        if rules.by_step:
            pending = None
            if spec.horizon < math.inf:
                self._instants = rtamt.Monitor(spec, **keywords)
                self._pick_instant = rules.picker(self._instants.variables)
                pending = self._latency = self._instants.latency
            self._tail = InstantTail(spec, pending, keywords)
            self._pick_tail = rules.picker(spec.variables)

    def updates(self, values: Floats) -> Iterator[float]:
        """Yield the robustness after each sample; a sample is used when it is requested."""
        if not self._places:
            return (self.update() for _ in range(len(values)))
        return map(self.update, *(values[:, position].tolist() for position in self._places))

    def decide(self, sample: int, row: RowValues) -> bool:
        """Note a decision; return whether the last sample has decided the verdict."""
        verdict = self.monitor.verdict
        if verdict is self.verdict:
            return False
        self.verdict, self.decided_at = verdict, sample
        self.reason = self._rules.values_text(self.monitor.variables, row)
        return True

    def take_instant(self, sample: int, row: RowValues) -> tuple[int, float, bool] | None:
        """Judge the instant that a sample settles: its number, its robustness, and if it changes.

        None if no instant is settled, or instants are judged at the end only.
        """
        if self._tail is not None:
            self._tail.add(self._pick_tail(row))
        if self._instants is None:
            return None
        robustness = self._instants.update(*self._pick_instant(row))
        at = sample - self._latency
        if at < 0:
            return None
        verdict = Verdict.VIOLATED if math.copysign(1.0, robustness) < 0 else Verdict.SATISFIED
        self.instants[verdict] += 1
        changes = verdict is not self._last_instant
        self._last_instant = verdict
        return at, robustness, changes

    @property
    def violates(self) -> bool:
        """Whether a violation is known that ``--stop violation`` waits for."""
        if self._instants is not None:
            return self._last_instant is Verdict.VIOLATED
        return self.verdict is Verdict.VIOLATED

    def finish(self, end: End) -> None:
        """End the trace."""
        self.monitor.finish(end)
        if self.monitor.verdict is not self.verdict:
            self.verdict = self.monitor.verdict
            self.reason = f"the end of the trace ({end})"

    def counts(self, samples: int, end: End) -> Mapping[str, int] | None:
        """Return the numbers of instants by verdict; None unless lines are about instants.

        Args:
            samples: The number of samples.
            end: The end mode, which may decide instants with windows past the end.
        """
        if self._tail is None:
            return None
        pending = self._tail.counts(end)
        total = pending if self._tail.whole else self.instants + pending
        satisfied, violated = total[Verdict.SATISFIED], total[Verdict.VIOLATED]
        open_ = samples - satisfied - violated
        return {"satisfied": satisfied, "violated": violated, "undecided": open_}
