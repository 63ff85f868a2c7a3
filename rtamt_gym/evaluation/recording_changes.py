"""Two sets of recordings, and the violations that are new, gone or moved between them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, Self

from rtamt import InputError
from rtamt.language import RequirementId
from rtamt.monitors import Occurrence
from rtamt_gym.evaluation.paired import Compared, Effect
from rtamt_gym.results.codec import build, document, plain, read_as, read_fields, save, trials_of
from rtamt_gym.results.matrix import Matrix
from rtamt_gym.results.outcome import Word
from rtamt_gym.results.provenance import Provenance, plain_provenance, provenance_of
from rtamt_gym.results.span_matching import Status

ComparedTimes = Literal["recorded", "start"]
"""The clock on which violations are compared: the recorded times, or since the start."""


@dataclass(frozen=True, slots=True)
class RecordingSet:
    """The verdicts and occurrences of recordings, as ``rtamt monitor --json`` writes them.

    Attributes:
        path: The file.
        matrix: The recordings under the requirements.
        reading: The options of the evaluation.
    """

    path: str
    matrix: Matrix
    reading: Mapping[str, Any]

    @classmethod
    def of(cls, path: str | os.PathLike[str], kept: Mapping[str, Any]) -> Self:
        """Return the recordings of a result of the kind ``"traces"``.

        Raises:
            InputError: If the result has no occurrences.
        """

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
    """One requirement on the recordings that A and B have.

    Attributes:
        compared: How many recordings satisfy it, with the paired statistics.
        violated_time: The violated time in a recording, of B minus A; None if times have two
            units, or without a recording.
        unit: The unit of times: ``"s"``, ``"samples"``, or empty if there are two.
        statuses: The number of rows with each status; a violation of both is one row.
        count_a: The number of violations in A.
        count_b: The number of violations in B.
        open_a: The number of undecided stretches of A at times that B satisfies.
        open_b: The number of undecided stretches of B at times that A satisfies.
    """

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
    """A requirement on a recording that was not compared.

    Attributes:
        recording: The name of the recording below its folder.
        requirement: The name of the requirement.
        reason: The reason.
        b_only: Whether A has a verdict, so that B lacks one.
    """

    recording: str
    requirement: str
    reason: str
    b_only: bool


@dataclass(frozen=True, slots=True)
class RecordingsComparison:
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
        return document(
            "recordings", {**stored, **plain_provenance(Provenance(self.ids))}, rows="changes"
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the text of `to_json` into a file, whose name ends in ``.json``."""
        save(self.to_json(), path)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> RecordingsComparison:
        """Read a file that `save` wrote."""
        return read_as(path, "recordings", RecordingsComparison.from_saved)

    @staticmethod
    def from_saved(kept: Mapping[str, Any]) -> RecordingsComparison:
        """Return the comparison from the JSON of a result of the kind ``"recordings"``."""
        requirements = [read_fields(ChangedRequirement, item) for item in kept["compared"]]
        own = {**kept, "requirements": {}, "changes": [], "ids": {}}
        return replace(
            read_fields(RecordingsComparison, own),
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
