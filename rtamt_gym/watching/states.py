"""The monitors of one requirement on the trace of one group, and its lines."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from operator import itemgetter
from typing import Any, Final, Literal

import numpy as np

import rtamt
from rtamt import InputError, Verdict
from rtamt.typing import End
from rtamt_gym.judging.monitors import EXACT
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.judge import viewed
from rtamt_gym.recorded.names import take_default
from rtamt_gym.recorded.recording import Floats, RawTimes
from rtamt_gym.recorded.times import same_as_before
from rtamt_gym.tables import number
from rtamt_gym.watching.clock import ClockRules, StreamClock, plain_times
from rtamt_gym.watching.groups import GroupPeriods
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.notes import StreamEvidence, StreamNotes
from rtamt_gym.watching.rows import RowFault

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


def instant_verdict(robustness: float) -> Verdict:
    """Return the verdict on an instant, by the sign of its robustness."""
    return Verdict.VIOLATED if math.copysign(1.0, robustness) < 0 else Verdict.SATISFIED


class VerdictState:
    """The verdict of a requirement on a trace so far, and why it is decided."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.verdict, self.reason = Verdict.UNDECIDED, ""
        self.last_instant: Verdict | None = None
        self._by_instant = False
        """Whether the verdicts of instants are known before the end."""

    @property
    def violates(self) -> bool:
        """Whether a violation is known that ``--stop violation`` waits for."""
        verdict = self.last_instant if self._by_instant else self.verdict
        return verdict is Verdict.VIOLATED


class GroupTrace:
    """The trace of one group.

    Attributes:
        group: The name of the group; None without groups.
        samples: The number of samples or events so far.
        stopped: Whether ``--stop`` has ended the stream.
        stop_line: The line of the row at which it did.
    """

    def __init__(
        self, rules: StreamRules, columns: Columns, clock: ClockRules | None, group: str | None
    ) -> None:
        self._rules, self._columns, self._clock_rules, self.group = rules, columns, clock, group
        self._clock: StreamClock | None = None
        self._gap = False
        """Whether a line was left out after the last row."""
        self._missing = Counter[str]()
        """The number of empty cells of each variable."""
        self.samples = self.stop_line = 0
        self.stopped = False
        rules.undecided += len(rules.specs)
        rules.evidence.begin()

    def _check_back(self, before: RawTimes, raw: RawTimes) -> bool:
        """Return whether a row has the time of the row before it; raise RowFault if it is less."""
        both = plain_times(np.concatenate([before, raw]))
        same = bool(same_as_before(both)[0])
        if both[1] < both[0] and not same:
            raise RowFault(
                0, f"expected times that increase, got {raw[0]} after {before[0]}", skippable=False
            )
        return same

    def _two_values(self, name: str, old: float, new: float) -> RowFault:
        """Return the fault of two values of a variable at one time."""
        hint = "" if self.group is not None else "; give --by COLUMN if rows are of several objects"
        return RowFault(
            0,
            f"expected one value of '{name}' at one time, got {number(old)} and "
            f"{number(new)}{hint}",
            skippable=False,
        )

    def _default_note(self, name: str, why: str) -> str:
        """Return the note on a default; raise InputError without a place if it is refused."""
        try:
            return take_default(self._rules.source, name, self._columns, why)
        except InputError as error:
            raise InputError(str(error).removeprefix(f"{self._rules.source}: ")) from None

    def _end_row(self, row: RowValues, states: Sequence[VerdictState]) -> None:
        """Show a row whose lines are emitted, and note whether the stream stops."""
        rules = self._rules
        if rules.show is not None:
            rules.show(self, row)
        if rules.stop == "violation":
            self.stopped = any(state.violates for state in states)
        elif rules.stop == "decided":
            self.stopped = not rules.undecided

    def _missing_of(self, variables: Sequence[str]) -> dict[str, int]:
        """Return the number of empty cells of the variables that have some."""
        return {name: count for name in variables if (count := self._missing[name])}


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
        """Return the numbers of decided instants among the kept samples."""
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


class SampledState(VerdictState):
    """A requirement on the samples of one trace."""

    def __init__(self, rules: StreamRules, name: str, period: Fraction | None) -> None:
        spec, keywords = rules.specs[name], rules.keywords(name, period)
        super().__init__(name)
        self._rules = rules
        self.monitor = rtamt.EpisodeMonitor(viewed(spec, rules.reading.view), **keywords)
        self.update = self.monitor.update
        self.pick = rules.picker(self.monitor.variables)
        self._places = [rules.variables.index(variable) for variable in self.monitor.variables]
        self.decided_at: int | None = None
        self._instants: rtamt.Monitor | None = None
        self.instants = Counter[Verdict]()
        self._tail: InstantTail | None = None
        if rules.by_step:
            pending = None
            if spec.horizon < math.inf:
                self._instants = rtamt.Monitor(spec, **keywords)
                self._by_instant = True
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
        verdict = instant_verdict(robustness)
        self.instants[verdict] += 1
        changes = verdict is not self.last_instant
        self.last_instant = verdict
        return at, robustness, changes

    def finish(self, end: End) -> None:
        """End the trace."""
        self.monitor.finish(end)
        if self.monitor.verdict is not self.verdict:
            self.verdict = self.monitor.verdict
            self.reason = f"the end of the trace ({end})"

    def counts(self, samples: int, end: End) -> Mapping[str, int] | None:
        """Return the numbers of instants by verdict; None unless lines are about instants."""
        if self._tail is None:
            return None
        pending = self._tail.counts(end)
        total = pending if self._tail.whole else self.instants + pending
        satisfied, violated = total[Verdict.SATISFIED], total[Verdict.VIOLATED]
        open_ = samples - satisfied - violated
        return {"satisfied": satisfied, "violated": violated, "undecided": open_}
