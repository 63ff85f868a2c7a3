"""`Evaluation`: how often a policy has satisfied each requirement, and how sure that is."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError, StateError, Verdict
from rtamt_gym.checks.names import listing
from rtamt_gym.evaluation.frames import Frame, played
from rtamt_gym.evaluation.intervals import quantiles, wilson
from rtamt_gym.evaluation.json_files import write_text
from rtamt_gym.evaluation.sentences import SUCCESS
from rtamt_gym.search.runs.record import Record
from rtamt_gym.search.runs.rows import Outcome, Row
from rtamt_gym.simulation.record import STOPPED
from rtamt_gym.simulation.run import Run
from rtamt_gym.tables import counted

if TYPE_CHECKING:  # it is optional
    import pandas as pd

    from rtamt_gym.search.runs.runner import Runner

__all__ = ["Evaluation", "RequirementResult", "rank"]

Floats = NDArray[np.float64]

_WORST: Final = 10
"""How many of the worst episodes a result names."""


@dataclass(frozen=True, eq=False)
class RequirementResult:
    """How often the episodes of an evaluation have satisfied a requirement.

    Attributes:
        name: The name of the requirement.
        formula: Its text.
        episodes: The number of episodes: the sum of the next four.
        satisfied: How many satisfy it.
        violated: How many violate it.
        undecided: How many leave it open, as one does that was stopped or cut short before.
        failed: How many an error has ended; they count as not satisfied.
        robustness: The robustness at the end of every episode, in their order; nan where it failed.
        first_violations: The times at which violations became certain, in seconds (the numbers of
            samples if there is no period), in the order of the episodes.
        saved: The simulated seconds from there to the time limit, of the episodes that were stopped
            when the verdict on this requirement became certain; 0 without a time limit.
        worst: Seed and robustness of the ten worst episodes: those that violate the requirement
            before those that leave it open, of each the least robustness first. A fall that
            ``at_termination="failure"`` makes a violation may have any robustness.
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

    @property
    def rate(self) -> float:
        """The share of the episodes that satisfy the requirement."""
        return self.satisfied / self.episodes

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of Wilson for the rate. Needs the extra ``search``."""
        return wilson(self.satisfied, self.episodes)

    @property
    def quantiles(self) -> Mapping[float, float]:
        """The quantiles 0.05, 0.25, 0.5, 0.75 and 0.95 of the robustness; empty if all failed."""
        return quantiles(self.robustness[~np.isnan(self.robustness)])

    def __repr__(self) -> str:
        others = [
            f", {getattr(self, what)} {what}"
            for what in ("violated", "undecided", "failed")
            if getattr(self, what)
        ]
        episodes = counted(self.episodes, "episode")
        return f"<{self.name}: {self.satisfied} of {episodes} satisfy it{''.join(others)}>"


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """How a policy has done under requirements; `evaluate_policy` makes it.

    Attributes:
        record: A row for every episode: its seed, what every requirement has become, how it ended,
            its return (`Row.reward`), and the error if one ended it.
        system: The name of the environment.
        policy: What the policy is called.
        period: Seconds between samples, or None.
        limit: The time limit of an episode in seconds (steps without a period), or None.
        seed: The seed of the first episode; each further one has one more.
        decision: By requirement, what sequential stopping has decided; None without it.
        worst_runs: By requirement, its worst episodes played again in full, the worst first.
        frames: Pictures of the worst episodes, by their seed: of an environment with
            ``render_mode="rgb_array"`` about 12 to 24, evenly spread, at the end, and where the
            episode had violated a requirement; they are at most 320 pixels wide and high.
        reading: How the episodes were read and judged: the options of `evaluate_policy` for that,
            by name, and under ``"signals"`` what each variable reads, None for a function. None:
            it is not known, as of a file that an older version has written.
    """

    record: Record
    system: str
    policy: str
    period: Fraction | None
    limit: float | None
    seed: int
    decision: Mapping[str, str] | None = None
    worst_runs: Mapping[str, tuple[Run, ...]] = field(default_factory=dict)
    frames: Mapping[int, tuple[Frame, ...]] = field(default_factory=dict)
    reading: Mapping[str, Any] | None = None
    _runner: Runner | None = None

    @cached_property
    def requirements(self) -> Mapping[str, RequirementResult]:
        """The result of every requirement, by name."""
        formulas = self.record.requirements
        return MappingProxyType(
            {
                name: self._result(name, formula, [row.outcomes.get(name) for row in self.record])
                for name, formula in formulas.items()
            }
        )

    @cached_property
    def success(self) -> RequirementResult:
        """The result of all requirements at once; its robustness is the least of theirs."""
        formulas = self.record.requirements
        text = next(iter(formulas.values()))
        if len(formulas) > 1:
            text = " and ".join(f"({formula})" for formula in formulas.values())
        names = set(formulas)
        every = [
            _together(row.outcomes.values()) if set(row.outcomes) == names else None
            for row in self.record
        ]
        return self._result(SUCCESS, text, every)

    @cached_property
    def returns(self) -> Floats:
        """The sum of the environment's own rewards, by episode.

        It is nan where there is none, and where an error ended the episode: that is a part.
        """
        failed = [bool(row.error) for row in self.record]
        return np.where(failed, math.nan, self.record.numbers("return"))

    @cached_property
    def lengths(self) -> Floats:
        """The simulated seconds of every episode (its steps if there is no period)."""
        return self.record.numbers("simulated")

    @property
    def episodes(self) -> int:
        """The number of episodes."""
        return len(self.record)

    def replay(self, seed: int) -> Run:
        """Plays an episode again, in full, and keeps every sample.

        Args:
            seed: The seed of the episode.

        Raises:
            InputError: If the evaluation has no such episode.
            StateError: If it was loaded, and the episode is none of `worst_runs`.
            RtamtError: As `rtamt_gym.simulate` does.
        """
        if not any(row.seed == seed for row in self.record):
            last = self.seed + len(self.record) - 1
            raise InputError(
                f"expected the seed of an episode, from {self.seed} to {last}, got {seed!r}"
            )
        kept = [run for runs in self.worst_runs.values() for run in runs if run.seed == seed]
        if kept:
            return kept[0]
        if self._runner is None:
            held = sorted({run.seed or 0 for runs in self.worst_runs.values() for run in runs})
            raise StateError(
                f"an evaluation that was loaded has neither policy nor environment to play "
                f"episode {seed} again; it holds {listing(map(str, held))}; evaluate_policy with "
                f"episodes=1, seed={seed} plays it"
            )
        return played(self._runner, seed)

    def to_frame(self) -> pd.DataFrame:
        """A data frame of pandas: a row for every episode, the columns as in `Record.columns`.

        Needs the extra ``pandas``.
        """
        return self.record.to_frame().rename_axis("episode")

    def to_json(self) -> str:
        """Strict JSON that holds all of the evaluation; infinities are ``"inf"`` and ``"-inf"``.

        The worst runs are in it with their samples, those that explain their robustness, and their
        pictures.
        """
        from rtamt_gym.evaluation.storage import written

        return written(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the text of `to_json` into a file.

        Raises:
            InputError: If the name does not end in ``.json``.
        """
        write_text(self.to_json(), path)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Evaluation:
        """Reads a file that `save` has written.

        Raises:
            InputError: If the file does not hold an evaluation.
        """
        from rtamt_gym.evaluation.storage import read

        return Evaluation(**read(Path(path)))

    def __eq__(self, other: object) -> bool:
        """Whether all is equal but the wall times, and whether episodes can be played again."""
        if not isinstance(other, Evaluation):
            return NotImplemented
        return all(getattr(self, name) == getattr(other, name) for name in _COMPARED)

    __hash__ = None  # type: ignore[assignment]  # it is as large as its record

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles without policy and environment, as `save` writes it."""
        return Evaluation, tuple(getattr(self, name) for name in _COMPARED)

    def __repr__(self) -> str:
        return (
            f"<Evaluation of {self.policy} on {self.system}: {counted(len(self.record), 'episode')}"
            f", {self.success.satisfied} satisfy {SUCCESS}>"
        )

    def __str__(self) -> str:
        from rtamt_gym.evaluation.tables import evaluation_table

        return evaluation_table(self)

    def _result(
        self, name: str, formula: str, outcomes: Sequence[Outcome | None]
    ) -> RequirementResult:
        rows = self.record.rows
        judged = [
            None if row.error else outcome for row, outcome in zip(rows, outcomes, strict=True)
        ]
        verdicts = [outcome.verdict for outcome in judged if outcome is not None]
        heights = [math.nan if outcome is None else outcome.robustness for outcome in judged]
        ranked = sorted(
            (rank(outcome, row.seed), row.seed or 0, outcome.robustness)
            for outcome, row in zip(judged, rows, strict=True)
            if outcome is not None
        )
        violations = [
            outcome.decided_at
            for outcome in judged
            if outcome is not None and outcome.verdict is Verdict.VIOLATED
        ]
        return RequirementResult(
            name,
            formula,
            episodes=len(rows),
            satisfied=verdicts.count(Verdict.SATISFIED),
            violated=verdicts.count(Verdict.VIOLATED),
            undecided=verdicts.count(Verdict.UNDECIDED),
            failed=judged.count(None),
            robustness=np.array(heights, np.float64),
            first_violations=np.array(violations, np.float64),
            saved=math.fsum(map(self._saved, rows, judged)),
            worst=tuple((seed, height) for _, seed, height in ranked[:_WORST]),
        )

    def _saved(self, row: Row, outcome: Outcome | None) -> float:
        """The seconds that a row was stopped short of the limit by this outcome."""
        if outcome is None or self.limit is None or row.ended not in STOPPED:
            return 0.0
        if row.ended != "known" and outcome.decided_at != row.simulated:
            return 0.0
        return self.limit - row.simulated


_COMPARED: Final = (
    *("record", "system", "policy", "period", "limit", "seed", "decision", "worst_runs", "frames"),
    "reading",
)


def _together(outcomes: Any) -> Outcome:  # noqa: ANN401 - a view of a mapping
    """The outcome of all requirements at once."""
    outcomes = list(outcomes)
    verdict = min(each.verdict for each in outcomes)
    times = [
        each.decided_at
        for each in outcomes
        if each.verdict is verdict and each.decided_at is not None
    ]
    when = {Verdict.VIOLATED: min, Verdict.SATISFIED: max}.get(verdict)
    robustness, lower, upper = (
        min((getattr(each, key) for each in outcomes), key=_order)
        for key in ("robustness", "lower", "upper")
    )
    decided_at = when(times) if when is not None and times else None
    return Outcome(robustness, lower, upper, verdict, decided_at)


def rank(outcome: Outcome, seed: int | None) -> tuple[Any, ...]:
    """Orders episodes by what a requirement has become in them, the worst first."""
    return outcome.verdict, *_order(outcome.robustness), seed or 0


def _order(robustness: float) -> tuple[float, float]:
    """Orders robustness; -0.0, which violates, comes before 0.0."""
    return robustness, math.copysign(1.0, robustness)
