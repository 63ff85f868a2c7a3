"""`Results`: trials under requirements; `RequirementResult`: the statistics of a requirement.

A row of `STATISTICS` is a column on the terminal and a key in JSON, Parquet and data frames; with
``robustness=True``, it is also a line on the page.

To add a statistic of a requirement over many trials:

1. Add a row to `STATISTICS`. Set ``shown`` if not every table needs the column. A count over trials
   is a field of `RequirementResult`, which `result_of` computes.
2. A statistic of the robustness is also on the page, with ``robustness=True``. For any other, add a
   line to `rtamt_gym.reports.requirements`, as ``_progress`` does.
3. List the key under "Statistics" in ``docs/results.md``. A new column changes the tables in
   ``docs/evaluation.md`` and ``docs/commands.md``; their tests show the new lines. It also changes
   the exact keys in ``tests/rtamt_gym/recorded/test_outcome_files.py``, and the tables in
   ``docs/tutorials/environment.md``, ``test_tables.py`` (``tests/rtamt_gym/evaluation``),
   ``test_sweep.py`` (``search``) and ``test_sweep_command.py`` (``commands``). If a table of
   evaluations is then wider than 80 columns, add the key to ``_OPTIONAL`` of
   `rtamt_gym.evaluation.evaluation`.
4. Write ``examples/releases/*.json`` again; ``test_example_files_are_current`` has the command.
   ``test_statistics.py`` and ``test_codec.py`` in ``tests/rtamt_gym/results`` list the keys that
   may be "-" and the facts of the page.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt import InputError, Verdict
from rtamt.errors import nearest
from rtamt.renamed import OldName
from rtamt_gym.checks.extras import naming_extra
from rtamt_gym.checks.names import listing
from rtamt_gym.results.intervals import IntervalKind, quantiles, rate_interval
from rtamt_gym.results.outcome import Outcome, order
from rtamt_gym.results.provenance import Provenance
from rtamt_gym.results.trial import STOPPED, Trial
from rtamt_gym.tables import Coloured, counted, short

if TYPE_CHECKING:  # it is optional
    import pandas as pd

Floats = NDArray[np.float64]

SUCCESS: Final = "all requirements"
"""The name of the result of all requirements at once."""

_WORST: Final = 10
"""The number of worst episodes that a result lists."""


@dataclass(frozen=True, eq=False)
class RequirementResult:
    """The outcomes of a requirement in the episodes of an evaluation, or in other trials.

    Attributes:
        name: The name of the requirement.
        formula: Its text.
        episodes: The number of episodes: the sum of the next four numbers.
        satisfied: The number of episodes that satisfy it.
        violated: The number that violate it.
        undecided: The number that leave it open, such as an episode that was stopped early.
        failed: The number that ended with an error.
        robustness: The robustness at the end of every episode, in order; nan if it failed.
        first_violations: The times of violations in seconds (sample numbers without a period), in
            the order of the episodes: `Outcome.violated_at`, or nan.
        saved: The simulated seconds between the stop and the time limit, summed over the episodes
            that were stopped because the verdict on this requirement became certain; 0 without a
            time limit.
        worst: Seed and robustness of the ten worst episodes: first violations, then undecided
            episodes, each group with the smallest robustness first. A violation by
            ``at_termination="failure"`` may have any robustness.
        triggered: The number of trials that triggered an implication, without failures. None
            without implications, or if it was not counted.
        progress: The mean progress through the stages, from 0 to 1, without failures. None without
            stages, or if it was not counted.
        failures_excluded: Whether failed trials do not count in the rate, as in a sweep, where
            trials were chosen. A failed episode of a policy counts as not satisfied.
        kind: The kind of the interval of the rate.
    """

    name: str
    formula: str
    episodes: int
    satisfied: int
    violated: int
    undecided: int
    failed: int
    robustness: Floats
    first_violations: Floats
    saved: float
    worst: tuple[tuple[int, float], ...]
    triggered: int | None = None
    progress: float | None = None
    failures_excluded: bool = False
    kind: IntervalKind = "exact"

    asked = OldName("triggered")
    apart = OldName("failures_excluded")
    heights = OldName("robustness_values")

    @property
    def judged(self) -> int:
        """The number of episodes that did not fail."""
        return self.episodes - self.failed

    @property
    def counted(self) -> int:
        """The denominator of the rate: all episodes, or all that did not fail."""
        return self.judged if self.failures_excluded else self.episodes

    @property
    def rate(self) -> float:
        """The share of `counted` episodes that satisfy the requirement; nan without episodes."""
        return self.satisfied / self.counted if self.counted else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the rate, of `kind`."""
        return rate_interval(self.satisfied, self.counted, self.kind)

    @property
    def robustness_values(self) -> Floats:
        """The known robustness values in ascending order; -0.0 comes before 0.0."""
        known = self.robustness[~np.isnan(self.robustness)]
        return known[np.lexsort((np.copysign(1.0, known), known))]

    @property
    def quantiles(self) -> Mapping[float, float]:
        """The quantiles 0.05, 0.25, 0.5, 0.75 and 0.95 of the robustness; empty if all failed."""
        return quantiles(self.robustness_values)

    def __repr__(self) -> str:
        others = [
            f", {getattr(self, phrase)} {phrase}"
            for phrase in ("violated", "undecided", "failed")
            if getattr(self, phrase)
        ]
        episodes = counted(self.episodes, "episode")
        return f"<{self.name}: {self.satisfied} of {episodes} satisfy it{''.join(others)}>"


def expected_shortfall(values: ArrayLike, share: float = 0.05) -> float:
    """Return the mean of the worst share of the robustness: its conditional value at risk.

    The values are sorted, and the last value in the share counts by its fraction: 5 % of 30 values
    are one and a half, so that the smallest counts fully and the next by half (Rockafellar and
    Uryasev 2002, "Conditional value-at-risk for general loss distributions", Journal of Banking &
    Finance 26). With fewer than 20 values, 5 % are less than one value, and the result is the
    minimum. The result is -inf if a value in the share is -inf; otherwise it is inf if a value in
    the share is inf.
    """
    ordered = np.sort(np.asarray(values, np.float64).ravel())
    # A product such as 0.05 * 60 may lie an ulp above the whole number.
    size = max(round(share * len(ordered), 9), 1.0)
    tail, weights = ordered[: math.ceil(size)], np.ones(math.ceil(size))
    weights[-1] = size - (len(tail) - 1)
    if not np.isfinite(tail).all():
        return -math.inf if tail[0] == -math.inf else math.inf
    return float(np.average(tail, weights=weights))


def mean_progress(values: Sequence[float]) -> float | None:
    """Return the mean progress, which is 1 only if all values are 1; None without values."""
    if not values:
        return None
    mean = math.fsum(values) / len(values)
    return mean if min(values) == 1 else min(mean, math.nextafter(1.0, 0.0))


def progress_text(progress: float) -> str:
    """Return two digits without rounding up: 1.00 means that every stage was reached.

    Example:
        >>> progress_text(0.9999), progress_text(1.0)
        ('0.99', '1.00')
    """
    return f"{math.floor(progress * 100) / 100:.2f}"


class Statistic(NamedTuple):
    """A statistic of a requirement over many trials.

    Attributes:
        key: Its name in JSON, Parquet and data frames.
        heading: Its column on the terminal and its name on the page.
        of: Returns its value, or None.
        text: Writes the value.
        where: The tables that show it on a terminal: ``"rates"``, for trials that differ by chance
            only; ``"counts"``, for chosen trials; or ``"all"``.
        style: The colour of its cell on a terminal if the value is not 0.
        shown: Whether a result needs the column; a table has it if any result does.
        robustness: Whether it describes the robustness; a note below tables lists these.
        judged: Whether it is a count of the trials that did not fail; tables show this total too.
    """

    key: str
    heading: str
    of: Callable[[RequirementResult], Any]
    text: Callable[[Any], str] = str
    where: Literal["rates", "counts", "all"] = "all"
    style: str = ""
    shown: Callable[[RequirementResult], bool] = lambda _: True
    robustness: bool = False
    judged: bool = False

    def cell(self, result: RequirementResult) -> str:
        """Return the value as text, in its colour; ``-`` for None."""
        value = self.of(result)
        if value is None:
            return "-"
        among = f" of {result.judged}" if self.judged else ""
        return Coloured(self.text(value) + among, self.style if value else "")


def _height(key: str, heading: str, of: Callable[[Floats], float], **more: Any) -> Statistic:  # noqa: ANN401 - fields
    """Return a statistic of the robustness of the trials that have one."""

    def value(result: RequirementResult) -> float | None:
        return of(result.robustness_values) if result.robustness_values.size else None

    return Statistic(key, heading, value, short, robustness=True, **more)


def _percents(interval: tuple[float, float]) -> str:
    return " to ".join(f"{100 * end:.1f}" for end in interval)


STATISTICS: Final = (
    Statistic("episodes", "trials", lambda r: r.episodes, shown=lambda _: False),
    Statistic("satisfied", "satisfied", lambda r: r.satisfied, where="counts"),
    Statistic("rate", "satisfied", lambda r: r.rate, "{:.1%}".format, "rates"),
    Statistic("interval", "95% interval", lambda r: r.interval, _percents, "rates"),
    Statistic("violated", "violated", lambda r: r.violated, style="red"),
    Statistic(
        *("undecided", "open", lambda r: r.undecided),
        style="yellow",
        shown=lambda r: r.undecided > 0,
    ),
    Statistic(
        "failed",
        "failed",
        lambda r: r.failed,
        style="red",
        shown=lambda r: r.failed > 0,
    ),
    Statistic(
        *("asked", "triggered", lambda r: r.triggered),
        shown=lambda r: r.triggered is not None,
        judged=True,
    ),
    Statistic(
        *("progress", "progress", lambda r: r.progress, progress_text),
        shown=lambda r: r.progress is not None,
    ),
    _height("least", "minimum", lambda heights: float(heights[0])),
    # With fewer than 20 values it equals the minimum.
    _height(
        "cvar",
        "CVaR 5%",
        expected_shortfall,
        shown=lambda r: len(r.robustness_values) >= 20,
    ),
    _height("median", "median", lambda heights: float(heights[(len(heights) - 1) // 2])),
    _height("greatest", "maximum", lambda heights: float(heights[-1]), where="counts"),
)
"""The statistics of a requirement over many trials, in the order of the columns."""


def columns_of(results: Sequence[RequirementResult], *, rates: bool) -> list[Statistic]:
    """Return the statistics in a table on a terminal, for rates or for counts."""
    where = "rates" if rates else "counts"
    return [
        statistic
        for statistic in STATISTICS
        if statistic.where in {where, "all"} and any(map(statistic.shown, results))
    ]


def result_of(
    name: str,
    formula: str,
    trials: Sequence[Trial],
    outcomes: Sequence[Outcome | None],
    limit: float | None = None,
    *,
    failures_excluded: bool = False,
    kind: IntervalKind = "exact",
) -> RequirementResult:
    """Return the result of a requirement."""
    judged = [
        (trial, outcome)
        for trial, outcome in zip(trials, outcomes, strict=True)
        if outcome is not None
    ]
    verdicts = [outcome.verdict for _, outcome in judged]
    heights = [math.nan if outcome is None else outcome.robustness for outcome in outcomes]
    ranked = sorted(
        (rank(outcome, trial.seed), trial.seed or 0, outcome.robustness)
        for trial, outcome in judged
    )
    violations = [value.violated_at for _, value in judged if value.verdict is Verdict.VIOLATED]
    return RequirementResult(
        name,
        formula,
        episodes=len(trials),
        satisfied=verdicts.count(Verdict.SATISFIED),
        violated=verdicts.count(Verdict.VIOLATED),
        undecided=verdicts.count(Verdict.UNDECIDED),
        failed=len(trials) - len(judged),
        robustness=np.array(heights, np.float64),
        first_violations=np.array(violations, np.float64),
        saved=math.fsum(_saved(*item, limit) for item in judged),
        worst=tuple((seed, height) for _, seed, height in ranked[:_WORST]),
        triggered=sum(bool(value.trigger_count) for _, value in judged)
        if any(value.triggers for _, value in judged)
        else None,
        progress=mean_progress(
            [value.progress for _, value in judged if value.progress is not None]
        ),
        failures_excluded=failures_excluded,
        kind=kind,
    )


def _saved(trial: Trial, outcome: Outcome, limit: float | None) -> float:
    """Return the seconds between the stop of a trial and the limit; 0 without such a stop."""
    if limit is None or trial.ended not in STOPPED:
        return 0.0
    if trial.ended != "known" and outcome.decided_at != trial.simulated:
        return 0.0
    return limit - trial.simulated


def rank(outcome: Outcome, seed: int | None) -> tuple[Any, ...]:
    """Order trials by their outcome of a requirement, the worst first."""
    return outcome.verdict, *order(outcome.robustness), seed or 0


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

    def outcomes(self, requirement: str) -> list[Outcome | None]:
        """Return the outcome of a requirement in each trial; None after a failure."""
        return [row.judged(requirement) for row in self.rows]

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
            result[name] = result_of(
                *(name, text, self.rows, self.outcomes(name), limit),
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
