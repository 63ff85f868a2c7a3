"""Two sets of recordings, and the violations that are new, gone or moved between them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Final, Literal, Self

from rtamt import InputError
from rtamt.errors import shown
from rtamt.language import RequirementId
from rtamt.monitors import Occurrence
from rtamt_gym.evaluation.paired import Compared, Effect, effect_sentence
from rtamt_gym.results.codec import (
    SavedResult,
    build,
    document,
    plain,
    provenance_of,
    read_fields,
    trials_of,
)
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.outcome import Word
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.span_matching import Status
from rtamt_gym.results.warnings import VerdictWarning
from rtamt_gym.tables import counted, number, shorten, table, wrapped

ComparedTimes = Literal["recorded", "start"]
"""The clock on which violations are compared: the recorded times, or since the start."""


@dataclass(frozen=True, slots=True)
class RecordingSet:
    """The verdicts and occurrences of recordings, as ``rtamt monitor --json`` writes them."""

    path: str
    matrix: Matrix
    reading: Mapping[str, Any]

    @classmethod
    def of(cls, path: str | os.PathLike[str], kept: Mapping[str, Any]) -> Self:
        """Return the recordings of a result of the kind ``"traces"``."""

        def read_matrix(stored: Mapping[str, Any]) -> Matrix:
            return Matrix(
                trials_of(stored), stored["requirements"], provenance=provenance_of(stored)
            )

        result = cls(os.fspath(path), build(path, kept, read_matrix), kept.get("reading", {}))
        outcomes = [outcome for row in result.matrix.rows for outcome in row.outcomes.values()]
        if any(outcome.occurrences is None for outcome in outcomes):
            raise InputError(
                f"{os.fspath(path)} has no occurrences: write it with rtamt monitor --json "
                "--occurrences"
            )
        return result

    @property
    def units(self) -> set[str]:
        """The units of times: ``"s"``, ``"samples"`` or both."""
        outcomes = (outcome for row in self.matrix.rows for outcome in row.outcomes.values())
        return {outcome.occurrences.unit for outcome in outcomes if outcome.occurrences}


@dataclass(frozen=True, slots=True)
class ViolationChange:
    """A violation of A, of B, or of both.

    Attributes:
        status: The status, such as ``"new"``.
        recording: The name of the recording below its folder.
        requirement: The name of the requirement.
        body: The part of the requirement that is violated.
        a: The violation in A, at the recorded times; None if it is new.
        b: The violation in B, at the recorded times; None if it is gone.
    """

    status: Status
    recording: str
    requirement: str
    body: str
    a: Occurrence | None
    b: Occurrence | None


@dataclass(frozen=True, slots=True)
class ChangedRequirement:
    """One requirement on the recordings that A and B have."""

    compared: Compared
    violated_time: Effect | None
    unit: str
    statuses: Mapping[str, int]
    count_a: int
    count_b: int
    open_a: int
    open_b: int


@dataclass(frozen=True, slots=True)
class NotCompared:
    """A requirement on a recording that was not compared."""

    recording: str
    requirement: str
    reason: str
    b_only: bool


@dataclass(frozen=True, slots=True)
class RecordingsComparison(SavedResult):
    """Two sets of recordings under the same requirements; `compare_recordings` makes it.

    Attributes:
        a: The file of A.
        b: The file of B.
        folders: The folders of A and B below which the recordings have equal names.
        tolerance: Times that differ by at most this much are equal, in the unit of the times.
        times: The clock of the comparison.
        recordings: The names of the recordings in both, below the folders.
        requirements: The comparison for each requirement, by name.
        changes: A row for each violation, in the order of A, then violations of B alone.
        only_a: The recordings that only A has.
        only_b: The recordings that only B has.
        requirements_a: The requirements that only A has.
        requirements_b: The requirements that only B has.
        changed: The requirements with a changed text; they are not compared.
        not_compared: Requirements on recordings without a verdict on one side.
        shorter: The missing time in B, for recordings that are shorter in B.
        shifts: The time that was added to the times of B, where it is not 0, by recording.
        untriggered: The requirements that no recording of B triggers, with the number of recordings
            of A that trigger them.
        notes: Remarks, each a sentence.
        ids: The ids of requirements with an id, by name.
    """

    a: str
    b: str
    folders: tuple[str, str]
    tolerance: float
    times: ComparedTimes
    recordings: tuple[str, ...]
    requirements: Mapping[str, ChangedRequirement]
    changes: tuple[ViolationChange, ...]
    only_a: tuple[str, ...] = ()
    only_b: tuple[str, ...] = ()
    requirements_a: tuple[str, ...] = ()
    requirements_b: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    not_compared: tuple[NotCompared, ...] = ()
    shorter: Mapping[str, float] = field(default_factory=dict)
    shifts: Mapping[str, float] = field(default_factory=dict)
    untriggered: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    ids: Mapping[str, RequirementId] = field(default_factory=dict)

    kind: ClassVar = "recordings"

    def rows(self, *statuses: Status) -> list[ViolationChange]:
        """Return the violations with one of the statuses."""
        return [row for row in self.changes if row.status in statuses]

    @property
    def words(self) -> set[Word]:
        """``violated`` if B is worse, ``undecided`` if it may be worse; otherwise neither.

        B is worse if it has a new or a longer violation, or satisfies a requirement in
        significantly fewer recordings. It may be worse if A does not decide a violation of B, if B
        is undecided where A satisfies a requirement, or if nothing was compared.
        """
        result = set[Word]()
        if not self.requirements:
            result.add("undecided")
        every = self.requirements.values()
        if self.rows("new", "longer") or any(
            item.compared.shown and item.compared.difference < 0 for item in every
        ):
            result.add("violated")
        maybe = any(row.b is not None for row in self.rows("undecided"))
        if maybe or any(item.open_b for item in every) or any(n.b_only for n in self.not_compared):
            result.add("undecided")
        return result

    def to_json(self) -> str:
        """Return the comparison as strict JSON."""
        stored = {item.name: getattr(self, item.name) for item in fields(self)}
        del stored["ids"]
        stored["requirements"] = {
            name: item.compared.formula for name, item in self.requirements.items()
        }
        stored["compared"] = [plain(item) for item in self.requirements.values()]
        stored["changes"] = [
            {item.name: _plain_violation(getattr(row, item.name)) for item in fields(row)}
            for row in self.changes
        ]
        return document("recordings", {**stored, **plain(Provenance(self.ids))}, rows="changes")

    @classmethod
    def from_saved(cls, kept: Mapping[str, Any]) -> Self:
        """Return the comparison from the JSON of a result of the kind ``"recordings"``."""
        requirements = [read_fields(ChangedRequirement, item) for item in kept["compared"]]
        own = {**kept, "requirements": {}, "changes": [], "ids": {}}
        return replace(
            read_fields(cls, own),
            requirements={item.compared.name: item for item in requirements},
            changes=tuple(
                ViolationChange(**{**row, "a": _violation(row["a"]), "b": _violation(row["b"])})
                for row in kept["changes"]
            ),
            ids=provenance_of(kept).ids,
        )


def _plain_violation(value: Any) -> Any:  # noqa: ANN401 - a field of a row
    return plain(value._asdict() if isinstance(value, Occurrence) else value)


def _violation(kept: Mapping[str, Any] | None) -> Occurrence | None:
    if kept is None:
        return None
    return Occurrence(**{**kept, "robustness": float(kept["robustness"])})


_NAMED: Final = 3
"""The number of recordings that a warning names."""

_LISTED: Final = 10
"""The number of violations that are listed for each status."""

HEADINGS: Final[dict[Status, str]] = {
    "new": "new in B",
    "longer": "longer in B",
    "undecided": "undecided in the other",
    "gone": "gone in B",
    "shorter": "shorter in B",
    "moved": "moved in B",
    "part": "part of a violation of the other",
    "same": "the same",
}
"""The meaning of each status, the worst first."""

_COLUMNS: Final[tuple[Status, ...]] = (
    *("same", "moved", "longer", "shorter", "new", "gone", "part", "undecided"),
)
_ALWAYS: Final = ("same", "moved", "new", "gone")


def columns_of(comparison: RecordingsComparison) -> list[Status]:
    """Return the statuses that a table shows: the usual ones, and others that occur."""
    every = comparison.requirements.values()
    return [
        word for word in _COLUMNS if word in _ALWAYS or any(item.statuses[word] for item in every)
    ]


def clock_text(comparison: RecordingsComparison) -> str:
    """Return the recordings, the tolerance and the clock of a comparison in words."""
    unit = _unit(comparison)
    clock = "recorded times" if comparison.times == "recorded" else "times since the start"
    pairs = counted(len(comparison.recordings), "recording")
    return f"{pairs} in both, tolerance {number(comparison.tolerance)}{unit}, {clock}"


def _unit(comparison: RecordingsComparison) -> str:
    """Return the unit of all times with a space before it; empty if there are two."""
    units = {item.unit for item in comparison.requirements.values()}
    return {"s": " s", "samples": " samples"}.get(units.pop() if len(units) == 1 else "", "")


def recordings_lines(comparison: RecordingsComparison) -> Iterator[str]:
    """Yield the lines of a comparison, at most 80 columns wide but for long names."""
    yield f"A: {shown(comparison.a)}"
    yield f"B: {shown(comparison.b)}"
    yield clock_text(comparison)
    yield ""
    columns = columns_of(comparison)
    rows = [
        [
            shorten(name, 24),
            *(str(count) for count in (item.count_a, item.count_b)),
            *(str(item.statuses[word]) for word in columns),
        ]
        for name, item in comparison.requirements.items()
    ]
    head = ["violations", "A", "B", *columns]
    yield from table([head, *rows], "<" + ">" * (len(head) - 1))
    for word, heading in HEADINGS.items():
        changes = comparison.rows(word)
        if word == "same" or not changes:
            continue
        yield ""
        yield f"{heading}:"
        for row in changes[:_LISTED]:
            yield from wrapped(f"  {_row(comparison, row)}")
        if len(changes) > _LISTED:
            yield f"  and {len(changes) - _LISTED} more"
    yield ""
    for text in sentences(comparison):
        yield from wrapped(text)
    for note in comparison.notes:
        yield from wrapped(f"note: {note}")


def _row(comparison: RecordingsComparison, row: ViolationChange) -> str:
    """Return a violation in words."""
    unit = comparison.requirements[row.requirement].unit
    spans = [
        f"{side} {interval_text(span, unit)}"
        for side, span in (("A", row.a), ("B", row.b))
        if span is not None
    ]
    bodies = {r.body for r in comparison.changes if r.requirement == row.requirement}
    body = f" ({shorten(row.body, 50)})" if len(bodies) > 1 else ""
    return f"{row.requirement}{body} in {shown(row.recording)}: {'; '.join(spans)}"


def interval_text(span: Occurrence, unit: str) -> str:
    """Return the time of a violation and its worst robustness in words."""
    s = " s" if unit == "s" else ""
    sample = "sample " if unit == "samples" else ""
    text = f"{sample}{span.start:.12g}{s}"
    if span.end != span.start:
        text += f" to {span.end:.12g}{s}"
    text += ", up to the end" * span.to_end + " (after the recording)" * span.unseen
    return f"{text}, robustness {number(span.robustness + 0.0)}"


def sentences(comparison: RecordingsComparison) -> Iterator[str]:
    """Yield the paired statistics of each requirement in words."""
    for name, item in comparison.requirements.items():
        yield item.compared.sentence_of("recording")
        if item.violated_time is not None and item.count_a + item.count_b:
            what = f"the violated time of `{name}`"
            unit = "seconds" if item.unit == "s" else "samples"
            yield f"{effect_sentence(item.violated_time, what)[:-1]}, in {unit} per recording."
        if item.open_b:
            stretches = counted(item.open_b, "stretch").replace("stretchs", "stretches")
            yield f"B does not decide `{name}` in {stretches} that A satisfies."


def comparison_warnings(
    comparison: RecordingsComparison, *, require_all: bool = False
) -> list[VerdictWarning]:
    """Return the warnings on recordings and requirements that were not compared."""
    unit, total = _unit(comparison), len(comparison.recordings)
    groups: list[tuple[str, Sequence[str], bool]] = [
        ("only in A", comparison.only_a, True),
        ("only in B", comparison.only_b, False),
        ("requirements only in A", comparison.requirements_a, True),
        ("requirements only in B", comparison.requirements_b, False),
        ("requirements with another text in B", comparison.changed, True),
        (
            "B covers less time",
            [f"{name} ({number(time)}{unit} less)" for name, time in comparison.shorter.items()],
            True,
        ),
        (
            "never triggered in B",
            [
                f"{name} ({count} of {counted(total, 'recording')} of A)"
                for name, count in comparison.untriggered.items()
                if count
            ],
            True,
        ),
        (
            "never triggered in A and B",
            [name for name, count in comparison.untriggered.items() if not count],
            False,
        ),
    ]
    missing = comparison.not_compared
    texts = [
        f"not compared: {shown(n.requirement)} in {shown(n.recording)} ({n.reason})"
        for n in missing[:_NAMED]
    ]
    if len(missing) > _NAMED:
        texts.append(f"not compared: {len(missing) - _NAMED} more")
    nothing = [] if comparison.requirements else ["nothing was compared: no verdict in both"]
    return [
        *(VerdictWarning(text, fails=True) for text in nothing),
        *(
            VerdictWarning(f"{phrase}: {_listed(names)}", fails=require_all and lacking)
            for phrase, names, lacking in groups
            if names
        ),
        *(VerdictWarning(text, fails=require_all) for text in texts),
    ]


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(shown(shorten(name, 160)) for name in names[:_NAMED]) + more
