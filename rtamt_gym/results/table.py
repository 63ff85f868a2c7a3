"""`Results`: the table of trials under requirements, with counts, rates and statistics."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self, overload

from rtamt import InputError, Verdict
from rtamt.errors import nearest
from rtamt.renamed import OldName
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.results.intervals import IntervalKind
from rtamt_gym.results.outcome import Outcome, order
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.statistics import STATISTICS, SUCCESS, RequirementResult, result_of
from rtamt_gym.results.trial import Trial

if TYPE_CHECKING:  # it is optional
    import pandas as pd


class Results(Sequence[Trial]):
    """Trials under the same requirements: a sequence of `Trial`, in the order of their cases.

    Args:
        rows: The trials.
        requirements: The text of each requirement, by name.
        system: The name of the system; empty for recorded traces.
        provenance: Their inputs and versions; not compared.
    """

    of_files = OldName("with_files")
    chosen = OldName("has_cases")

    def __init__(
        self,
        rows: Iterable[Trial],
        requirements: Mapping[str, str],
        system: str = "",
        provenance: Provenance = Provenance(),  # noqa: B008 - it cannot be changed
    ) -> None:
        self.rows = tuple(rows)
        self.requirements = MappingProxyType(dict(requirements))
        self.system = system
        self.provenance = provenance

    @overload
    def __getitem__(self, index: int) -> Trial: ...
    @overload
    def __getitem__(self, index: slice) -> Self: ...
    def __getitem__(self, index: int | slice) -> Trial | Self:
        if isinstance(index, slice):
            return self._of(self.rows[index])
        return self.rows[index]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Trial]:
        return iter(self.rows)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Results):
            return NotImplemented
        return (self.rows, self.requirements, self.system) == (
            other.rows,
            other.requirements,
            other.system,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.rows, dict(self.requirements), self.system, self.provenance)

    __hash__ = None  # type: ignore[assignment]  # it is as large as its rows

    def with_files(self, paths: Iterable[str]) -> Self:
        """Return the results with the hashes of files that they were made of."""
        return type(self)(
            self.rows, self.requirements, self.system, self.provenance.with_files(paths)
        )

    def violated(self, requirement: str | None = None) -> Self:
        """Return the trials that violate a requirement; None: any requirement.

        Raises:
            InputError: If the requirement is unknown; the error names the nearest.
        """
        names = self.requirements if requirement is None else [self.name(requirement)]
        return self._of(
            row
            for row in self.rows
            if any(
                name in row.outcomes and row.outcomes[name].verdict is Verdict.VIOLATED
                for name in names
            )
        )

    def failed(self) -> Self:
        """Return the trials that ended with an error."""
        return self._of(row for row in self.rows if row.error)

    def name(self, requirement: str | None) -> str:
        """Return the name of a requirement; None: of the only requirement.

        Raises:
            InputError: If the requirement is unknown, or the name is None and there are several.
        """
        names = self.requirements
        if requirement is None:
            if len(names) == 1:
                return next(iter(names))
            raise InputError(f"expected the name of a requirement ({listing(names)})")
        if requirement not in names:
            raise InputError(
                f"unknown requirement {requirement!r}; the requirements are "
                f"{listing(names)}{nearest(requirement, names)}"
            )
        return requirement

    def results(
        self, limit: float | None = None, kind: IntervalKind = "exact"
    ) -> dict[str, RequirementResult]:
        """Return the result of every requirement, by name.

        Args:
            limit: The time limit of a trial in seconds (steps without a period), or None.
            kind: The kind of the intervals of rates.
        """
        result = {}
        for name, text in self.requirements.items():
            outcomes = [row.judged(name) for row in self.rows]
            result[name] = result_of(
                *(name, text, self.rows, outcomes, limit),
                failures_excluded=self.has_cases,
                kind=kind,
            )
        return result

    def success(
        self, limit: float | None = None, kind: IntervalKind = "exact"
    ) -> RequirementResult:
        """Return the result of all requirements at once, with their minimum robustness."""
        formulas = list(self.requirements.values())
        text = formulas[0]
        if len(formulas) > 1:
            text = " and ".join(f"({formula})" for formula in formulas)
        return result_of(
            *(SUCCESS, text, self.rows, self.together(), limit),
            failures_excluded=self.has_cases,
            kind=kind,
        )

    @property
    def has_cases(self) -> bool:
        """Whether the trials were chosen, as the points of a sweep, and do not differ by chance.

        Rates are then shares of the judged trials; otherwise, a failed trial counts as not
        satisfied.
        """
        return False

    def together(self) -> list[Outcome | None]:
        """Return the outcome of all requirements together in each trial; None after a failure."""
        names = set(self.requirements)
        return [
            together(row.outcomes.values())
            if set(row.outcomes) == names and not row.error
            else None
            for row in self.rows
        ]

    def statistics(self, kind: IntervalKind = "exact") -> pd.DataFrame:
        """Return a data frame of pandas: a row for each requirement, a column for each statistic.

        These are ``rate`` with its 95 % interval ``low`` to ``high``, the counts ``violated``,
        ``undecided`` and ``failed``, and for the robustness ``least``, ``cvar``, ``median`` and
        ``greatest``. Needs the extra ``search``.

        Args:
            kind: The kind of the intervals of rates.
        """
        try:
            import pandas as pd
        except ModuleNotFoundError as error:
            raise naming_extra(error, "statistics") from error
        rows = []
        for result in self.results(kind=kind).values():
            row = [(statistic.key, statistic.of(result)) for statistic in STATISTICS]
            low, high = result.interval
            index = [key for key, _ in row].index("interval")
            rows.append(dict([*row[:index], ("low", low), ("high", high), *row[index + 1 :]]))
        return pd.DataFrame(rows, index=pd.Index(list(self.requirements), name="requirement"))

    def _of(self, rows: Iterable[Trial]) -> Self:
        return type(self)(rows, self.requirements, self.system, self.provenance)


def together(outcomes: Iterable[Outcome]) -> Outcome:
    """Return the outcome of all requirements at once, with their minimum robustness."""
    outcomes = list(outcomes)
    verdict = min(outcome.verdict for outcome in outcomes)
    settled = [outcome for outcome in outcomes if outcome.verdict is verdict]
    robustness, lower, upper = (
        min((getattr(outcome, key) for outcome in outcomes), key=order)
        for key in ("robustness", "lower", "upper")
    )
    # The first decided violation violates all; the last decision satisfies all.
    if verdict is Verdict.VIOLATED:
        decided = min((item for item in settled if item.decided), key=_time, default=None)
    else:
        decided = max(settled, key=_time) if all(item.decided for item in settled) else None
    if decided is not None:
        return Outcome(robustness, lower, upper, verdict, decided.decided)
    ended = next((item.ended for item in settled if item.ended), None)
    return Outcome(robustness, lower, upper, verdict, ended=ended)


def _time(outcome: Outcome) -> float:
    return outcome.decided_at or 0.0
