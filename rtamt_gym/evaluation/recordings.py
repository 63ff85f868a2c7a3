"""`compare_recordings`: which violations are new, gone or moved between two sets of recordings.

Its arguments are two results of ``rtamt monitor --json --occurrences``.
"""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Self, get_args

from rtamt import InputError, Verdict
from rtamt.errors import Argument, shown
from rtamt.monitors import BodyOccurrences, Occurrence, RunTable
from rtamt_gym.evaluation.paired import LEVEL, compared_of, effect_of, holm
from rtamt_gym.evaluation.recording_changes import (
    ChangedRequirement,
    ComparedTimes,
    NotCompared,
    RecordingsComparison,
    RecordingSet,
    ViolationChange,
)
from rtamt_gym.evaluation.recording_pairs import RecordingPairs, pair_recordings
from rtamt_gym.results.outcome import Outcome
from rtamt_gym.results.span_matching import (
    RecordedSpans,
    SpanMatches,
    Status,
    TimeSpan,
    match_spans,
)
from rtamt_gym.results.trial import Trial
from rtamt_gym.tables import counted

_UNREAD: Final = ("sorted",)
"""Options that change no value."""

_NAMED: Final = {"signals": "--signal {}", "starts": "the default of {}", "where": "--where {}"}
"""The options with a value for each name."""

_FLAGS: Final = {"defaults": "--default"}
"""The options with another name than their attribute."""


def reading_differences(a: RecordingSet, b: RecordingSet) -> Iterator[str]:
    """Yield each option with which A and B read columns differently, with both values.

    A column or a default of a variable that only one side reads counts if a requirement of both
    sides has the variable, or if all requirements of that side are also on the other side.
    """
    one, two = (side.reading.get("columns") or {} for side in (a, b))
    for key in dict.fromkeys([*one, *two]):
        if key in _UNREAD or one.get(key) == two.get(key):
            continue
        if key in _NAMED:
            yield from _named_differences(key, one.get(key) or {}, two.get(key) or {}, a, b)
        else:
            option = _FLAGS.get(key, f"--{key.replace('_', '-')}")
            yield _difference(option, one.get(key), two.get(key))


def _named_differences(
    key: str, one: Mapping[str, Any], two: Mapping[str, Any], a: RecordingSet, b: RecordingSet
) -> Iterator[str]:
    for name in dict.fromkeys([*one, *two]):
        usual = name if key == "signals" else None
        values = one.get(name, usual), two.get(name, usual)
        alone = key != "where" and ((name in one) != (name in two))
        own = (a, b) if name in one else (b, a)
        if values[0] != values[1] and not (alone and _of_own_requirement(name, *own)):
            yield _difference(_NAMED[key].format(name), *values)


def _of_own_requirement(name: str, side: RecordingSet, other: RecordingSet) -> bool:
    """Return whether only requirements that the other side lacks can read a variable."""
    texts, others = side.matrix.requirements, other.matrix.requirements
    word = re.compile(rf"(?<![\w.]){re.escape(name)}(?!\w)")
    return not texts.keys() <= others.keys() and not any(
        word.search(text) for requirement, text in texts.items() if requirement in others
    )


def _difference(option: str, one: object, two: object) -> str:
    texts = [_text(value) for value in (one, two)]
    return f"{option} is {texts[0]} of A and {texts[1]} of B"


def _text(value: object) -> str:
    if value is None:
        return "not set"
    if isinstance(value, list | tuple):
        return " ".join(map(str, value)) or "not set"
    return f"{value:.12g}" if isinstance(value, float) else str(value)


_FREE: Final = ("columns", "min_duration")
"""Options of an evaluation that change no verdict, or that `reading_differences` compares."""


def compare_recordings(
    a: RecordingSet,
    b: RecordingSet,
    *,
    tolerance: float = 0.0,
    times: ComparedTimes | None = None,
    folders: Sequence[str] | None = None,
    accept_changed: bool = False,
) -> RecordingsComparison:
    """Compare the violations of two sets of recordings, as `match_spans` matches them.

    ``tolerance`` is in seconds, or in samples of recordings without times. ``times`` is None for
    recorded times, which is an error if times since the start have another result.
    ``accept_changed`` leaves out requirements with a changed text, and compares recordings although
    their columns were read with different options; otherwise, both are an error.
    """
    _check_options(a, b)
    different = list(reading_differences(a, b))
    if different and not accept_changed:
        raise InputError(
            f"cannot compare, because variables are read differently: {', '.join(different)}; "
            "evaluate both with the same options, or compare them nevertheless with ",
            Argument("accept_changed", value=True),
        )
    names = [name for name in a.matrix.requirements if name in b.matrix.requirements]
    if not names:
        raise InputError("cannot compare: A and B have no requirement with the same name")
    pairs = pair_recordings(
        [row.name for row in a.matrix.rows], [row.name for row in b.matrix.rows], folders
    )
    rows_a, rows_b = ({row.name: row for row in side.matrix.rows} for side in (a, b))
    rows = {name: (rows_a[one], rows_b[two]) for name, (one, two) in pairs.pairs.items()}
    labels = {name: name or os.path.basename(pairs.pairs[name][1]) for name in rows}  # noqa: PTH119 - a name of a trace
    changed = [name for name in names if _differs(a, b, rows.values(), name)]
    if changed and not accept_changed:
        one, two = (side.matrix.requirements[changed[0]] for side in (a, b))
        raise InputError(
            f"cannot compare: {changed[0]} is {one} of A and {two} of B; evaluate both with the "
            "same text, or leave such requirements out with ",
            Argument("accept_changed", value=True),
        )
    names = [name for name in names if name not in changed]
    if not names:
        raise InputError("cannot compare: the text of every requirement has changed")
    builder = _Builder(tolerance, times)
    for name, pair in rows.items():
        builder.add(labels[name], pair, names)
    short = builder.short()
    return RecordingsComparison(
        *(a.path, b.path, pairs.folders, tolerance, times or "recorded"),
        tuple(labels.values()),
        builder.requirements({name: a.matrix.requirements[name] for name in names}),
        tuple(builder.changes),
        pairs.only_a,
        pairs.only_b,
        tuple(name for name in a.matrix.requirements if name not in b.matrix.requirements),
        tuple(name for name in b.matrix.requirements if name not in a.matrix.requirements),
        tuple(changed),
        tuple(builder.not_compared),
        builder.shorter,
        builder.shifts,
        builder.untriggered(),
        (*_notes(different, pairs, rows, len(names)), *short),
        a.matrix.provenance.ids,
    )


def _differs(
    a: RecordingSet, b: RecordingSet, rows: Collection[tuple[Trial, Trial]], name: str
) -> bool:
    """Return whether the text of a requirement, or of a body in any pair, differs."""
    if a.matrix.requirements[name] != b.matrix.requirements[name]:
        return True
    both = [[row.outcomes[name] for row in pair if name in row.outcomes] for pair in rows]
    bodies = [[_bodies(outcome) for outcome in pair] for pair in both]
    return any(len(pair) == 2 and pair[0] != pair[1] for pair in bodies)


def _bodies(outcome: Outcome) -> list[str]:
    return [body.text for body in outcome.occurrences.bodies] if outcome.occurrences else []


def _check_options(a: RecordingSet, b: RecordingSet) -> None:
    """Raise InputError if the evaluations have options that change the meaning of a verdict."""
    keys = dict.fromkeys([*a.reading, *b.reading])
    differences = [
        f"{key} is {a.reading.get(key, 'not set')} of A and {b.reading.get(key, 'not set')} of B"
        for key in keys
        if key not in _FREE and a.reading.get(key) != b.reading.get(key)
    ]
    if differences:
        raise InputError(
            f"cannot compare, because evaluation options differ: {', '.join(differences)}; "
            "evaluate both with the same"
        )


@dataclass(frozen=True, slots=True)
class RequirementClock:
    """The times at which a requirement was evaluated on a recording."""

    begin: float
    first: float
    last: float
    step: float

    @classmethod
    def of(cls, row: Trial, outcome: Outcome) -> Self:
        """Return the clock of a requirement on a recording."""
        extent = row.extent
        if extent is None:
            return cls(0.0, -math.inf, math.inf, 0.0)
        if extent.begin is None or extent.end is None:  # bounds count samples
            return cls(0.0, 0.0, float((extent.samples or 1) - 1), 1.0)
        late = outcome.late_start
        first = extent.begin if late is None else late.judged
        step = math.nextafter(extent.end, math.inf) - extent.end
        if extent.period is not None:
            step = float(extent.period)
        return cls(extent.begin, first, extent.end, step)

    @property
    def length(self) -> float:
        """The length of the recording."""
        return self.last - self.begin


def recorded_spans(
    body: BodyOccurrences, clock: RequirementClock, shift: float, *, satisfied: bool
) -> RecordedSpans:
    """Return the spans of a body, later by a shift.

    Each sample lasts for a period, also the last one. An instant of dense time is a span to the
    next floating-point number.
    """
    unseen = body.violations.columns["unseen"].tolist()
    return RecordedSpans(
        [*_spans(body.violations, clock, shift, unseen)],
        [*_spans(body.unknown, clock, shift)],
        _span(clock.first + shift, clock.last + clock.step + shift),
        unseen.index(True) if any(unseen) else None,
        satisfied,
    )


def _spans(
    table: RunTable[Any], clock: RequirementClock, shift: float, unseen: list[bool] | None = None
) -> Iterator[TimeSpan]:
    names = "start", "end", "to_end", "open_start", "closed_end"
    columns = (table.columns[name].tolist() for name in names)
    ahead = unseen or [False] * len(table)
    for start, end, to_end, opened, closed, after in zip(*columns, ahead, strict=True):
        censored = to_end or after
        first, stop = float(start) + shift, float(end) + shift
        if censored:
            stop += clock.step
        elif closed:
            stop = math.nextafter(stop, math.inf)
        yield _span(math.nextafter(first, math.inf) if opened else first, stop, censored=censored)


def _span(start: float, stop: float, *, censored: bool = False) -> TimeSpan:
    return TimeSpan(start, stop if stop > start else math.nextafter(start, math.inf), censored)


@dataclass(slots=True)
class _Builder:
    """The rows of all pairs of recordings so far."""

    tolerance: float
    times: ComparedTimes | None
    changes: list[ViolationChange] = field(default_factory=list)
    not_compared: list[NotCompared] = field(default_factory=list)
    shorter: dict[str, float] = field(default_factory=dict)
    shifts: dict[str, float] = field(default_factory=dict)
    _lengths: dict[str, list[float]] = field(default_factory=dict)
    _outcomes: dict[str, list[tuple[Outcome, Outcome]]] = field(default_factory=dict)
    _open: Counter[tuple[str, str]] = field(default_factory=Counter)

    def add(self, name: str, rows: tuple[Trial, Trial], requirements: Collection[str]) -> None:
        """Compare one recording under all requirements."""
        for requirement in requirements:
            cells = [row.cell(requirement) for row in rows]
            failures = [cell for cell in cells if not isinstance(cell, Outcome)]
            if failures:
                b_only = isinstance(cells[0], Outcome)
                sides = "A and B" if len(failures) == 2 else "B" if b_only else "A"
                reason = f"error in {sides}: {failures[-1].message}"
                self.not_compared.append(NotCompared(name, requirement, reason, b_only))
                continue
            one, two = (cell for cell in cells if isinstance(cell, Outcome))
            units = [cell.occurrences.unit for cell in (one, two) if cell.occurrences]
            if len(set(units)) > 1:
                reason = "times in {} in A, and in {} in B".format(*units)
                self.not_compared.append(NotCompared(name, requirement, reason, b_only=True))
                continue
            self._outcomes.setdefault(requirement, []).append((one, two))
            self._compare(name, requirement, rows, (one, two))

    def _compare(
        self,
        name: str,
        requirement: str,
        rows: tuple[Trial, Trial],
        outcomes: tuple[Outcome, Outcome],
    ) -> None:
        clocks = (
            RequirementClock.of(rows[0], outcomes[0]),
            RequirementClock.of(rows[1], outcomes[1]),
        )
        lengths = self._lengths.setdefault(name, [])
        lengths += [clock.length + clock.step for clock in clocks]
        lacking = clocks[0].length - clocks[1].length
        if lacking > self.tolerance + 1e-9 * clocks[0].length:
            self.shorter[name] = max(lacking, self.shorter.get(name, 0.0))
        one, two = (outcome.occurrences for outcome in outcomes)
        assert one is not None and two is not None  # noqa: PT018, S101 - `RecordingSet` checks it
        verdicts = [outcome.verdict for outcome in outcomes]
        open_before = self._open["b", requirement]
        for body_a, body_b in zip(one.bodies, two.bodies, strict=True):
            matches = self._matches(name, requirement, clocks, outcomes, (body_a, body_b))
            self._open["a", requirement] += matches.open_a
            self._open["b", requirement] += matches.open_b
            partners = dict(matches.pairs)
            taken = set(partners.values())
            rows_a, rows_b = _rows(body_a), _rows(body_b)
            for i, status in enumerate(matches.of_a):
                b = rows_b[partners[i]] if i in partners else None
                row = ViolationChange(status, name, requirement, body_a.text, rows_a[i], b)
                self.changes.append(row)
            for j, status in enumerate(matches.of_b):
                if j not in taken:
                    row = ViolationChange(status, name, requirement, body_a.text, None, rows_b[j])
                    self.changes.append(row)
        undecided = verdicts == [Verdict.SATISFIED, Verdict.UNDECIDED]
        if undecided and self._open["b", requirement] == open_before:
            self._open["b", requirement] += 1  # an instant that B lacks

    def _matches(
        self,
        name: str,
        requirement: str,
        clocks: tuple[RequirementClock, RequirementClock],
        outcomes: tuple[Outcome, Outcome],
        bodies: tuple[BodyOccurrences, BodyOccurrences],
    ) -> SpanMatches:
        def matched(offset: float) -> SpanMatches:
            shifts = 0.0, offset
            a, b = (
                recorded_spans(body, clock, shift, satisfied=outcome.verdict is Verdict.SATISFIED)
                for body, clock, shift, outcome in zip(
                    bodies, clocks, shifts, outcomes, strict=True
                )
            )
            return match_spans(a, b, self.tolerance)

        offset = clocks[0].begin - clocks[1].begin
        if self.times == "recorded" or offset == 0.0:
            return matched(0.0)
        since_start = matched(offset)
        if self.times == "start":
            self.shifts[name] = offset
            return since_start
        recorded = matched(0.0)
        if abs(offset) > self.tolerance and recorded != since_start:
            raise InputError(
                f"{shown(name)} starts at {clocks[0].begin:.12g} s in A and at "
                f"{clocks[1].begin:.12g} s in B, and the violations of {requirement} match "
                "differently on the recorded clock and since the start: set --times recorded or "
                "--times start"
            )
        return recorded

    def short(self) -> list[str]:
        """Return a note on recordings that are shorter than the tolerance."""
        longest = max(map(max, self._lengths.values()), default=math.inf)
        short = [name for name, lengths in self._lengths.items() if self.tolerance > min(lengths)]
        pairs = [pair for both in self._outcomes.values() for pair in both]
        units = {o.occurrences.unit for pair in pairs for o in pair if o.occurrences}
        unit = units.pop() if len(units) == 1 else ""
        tolerance = f"{self.tolerance:.12g} {unit}".strip()
        if self.tolerance > longest:
            without = "; a number without a unit counts seconds" if unit == "s" else ""
            raise InputError(
                f"--tolerance: expected less than the longest recording, {longest:.12g} {unit}, "
                f"got {tolerance}{without}"
            )
        if not short:
            return []
        more = f" and {len(short) - 1} more" if short[1:] else ""
        note = f"the tolerance of {tolerance} is longer than {shown(short[0])}{more}"
        return [f"{note}, where any two violations may be partners"]

    def untriggered(self) -> dict[str, int]:
        """Return the requirements that no recording of B triggers.

        The number of recordings of A that trigger each may be 0.
        """
        result = {}
        for name, pairs in self._outcomes.items():
            if any(not outcome.triggers for pair in pairs for outcome in pair):
                continue  # without an implication, or not counted
            a, b = (sum(bool(pair[side].trigger_count) for pair in pairs) for side in (0, 1))
            if not b:
                result[name] = a
        return result

    def requirements(self, formulas: Mapping[str, str]) -> dict[str, ChangedRequirement]:
        """Return the comparison of each requirement, with adjusted p-values."""
        result = {}
        counts = Counter((row.requirement, row.status) for row in self.changes)
        for name, formula in formulas.items():
            pairs = self._outcomes.get(name, [])
            if not pairs:
                continue
            verdicts = Counter(
                (a.verdict is Verdict.SATISFIED, b.verdict is Verdict.SATISFIED) for a, b in pairs
            )
            robustness = effect_of(
                [a.robustness for a, _ in pairs], [b.robustness for _, b in pairs]
            )
            compared = compared_of(name, formula, verdicts, robustness)
            units = {o.occurrences.unit for pair in pairs for o in pair if o.occurrences}
            own = [row for row in self.changes if row.requirement == name]
            result[name] = ChangedRequirement(
                compared,
                effect_of(*zip(*(map(_violated, pair) for pair in pairs), strict=True))
                if len(units) == 1
                else None,
                units.pop() if len(units) == 1 else "",
                {word: counts[name, word] for word in get_args(Status)},
                sum(row.a is not None for row in own),
                sum(row.b is not None for row in own),
                self._open["a", name],
                self._open["b", name],
            )
        adjusted = holm({name: item.compared.p for name, item in result.items()})
        return {
            name: replace(item, compared=replace(item.compared, adjusted=adjusted[name]))
            for name, item in result.items()
        }


def _rows(body: BodyOccurrences) -> list[Occurrence]:
    """Return the violations of a body; this is faster than iteration over the table."""
    columns = body.violations.columns
    ordered = (columns[name].tolist() for name in Occurrence._fields)
    return [Occurrence(*cells) for cells in zip(*ordered, strict=True)]


def _violated(outcome: Outcome) -> float:
    """Return the violated time of a recording, summed over the bodies."""
    bodies = outcome.occurrences.bodies if outcome.occurrences else ()
    return math.fsum(body.violated for body in bodies)


def _notes(
    different: Sequence[str],
    pairs: RecordingPairs,
    rows: Mapping[str, tuple[Trial, Trial]],
    requirements: int,
) -> Iterator[str]:
    """Yield remarks on the comparison."""
    if [*pairs.pairs] == [""]:
        both = pairs.pairs[""]
        differ = len({os.path.basename(name) for name in both}) > 1  # noqa: PTH119 - as above
        yield "{} is compared with {}".format(*map(shown, both)) + (
            ", the only recordings, although their names differ" * differ
        )
    elif pairs.folders[0] != pairs.folders[1]:
        yield "recordings are paired by their names below {} and {}".format(
            *map(shown, pairs.folders)
        )
    if all(one == two for one, two in pairs.pairs.values()):
        equal = all(one.outcomes == two.outcomes for one, two in rows.values())
        yield "A and B have recordings of the same paths" + (
            " and the same outcomes, so they may be the same recordings" * equal
        )
    if different:
        yield f"variables are read differently: {', '.join(different)}"
    periods = {
        name: [row.extent.period for row in pair if row.extent is not None]
        for name, pair in rows.items()
    }
    differing = [name for name, values in periods.items() if len(set(values)) > 1]
    if differing:
        yield (
            f"the periods of A and B differ in {counted(len(differing), 'recording')}, so times of "
            "violations may differ by a period"
        )
    if any("[" in name for name in pairs.pairs):
        yield (
            "recordings of one file may depend on each other; p-values and intervals take them "
            "as independent"
        )
    if 2 * 0.5 ** len(rows) * requirements > LEVEL:
        yield f"{counted(len(rows), 'recording')} cannot show a difference of rates"
