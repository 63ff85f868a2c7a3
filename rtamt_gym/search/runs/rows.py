"""`Row`: one simulation of a record, with what each requirement has become in it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Final

from rtamt import Verdict
from rtamt_gym.inputs.case import Case
from rtamt_gym.simulation.record import STOPPED, RunEnd
from rtamt_gym.simulation.run import Run

__all__ = ["MEASURES", "OF_ROW", "Outcome", "Row", "open_at_stop", "seconds"]

MEASURES: Final = ("robustness", "lower", "upper", "verdict", "decided_at")
"""The columns of a requirement, written ``robustness(NAME)``."""

OF_ROW: Final = ("seed", "ended", "simulated", "return", "wall", "error")
"""The columns of a simulation beside those of its case and of its requirements."""

_FIELDS: Final = {"return": "reward"}
"""The fields of a row that have another name than their column, which in Python is a keyword."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What a requirement has become in one simulation.

    Attributes:
        robustness: The robustness at the end; of a run that was stopped, at the stop.
        lower: The least robustness that was still possible then.
        upper: The greatest robustness that was still possible then.
        verdict: The verdict at the end.
        decided_at: The time of the sample that made the verdict certain, in seconds (its number if
            there is no period); None if none did.
    """

    robustness: float
    lower: float
    upper: float
    verdict: Verdict
    decided_at: float | None


@dataclass(frozen=True, slots=True)
class Row:
    """One simulation: what it was given, and what came of it. The wall time is not compared.

    Attributes:
        case: What the simulation was given.
        seed: The seed of an environment's reset; None for a system without one.
        outcomes: What each requirement has become; empty if an error came before sample 0.
        ended: Why the simulation is over, as `Run` says it.
        simulated: Simulated time in seconds (steps if there is no period).
        wall: Seconds that it took; of simulations that ran side by side, its share.
        error: The type and the text of the error that ended it; empty if none did.
        reward: The sum of the rewards of an environment, in the column ``return``; None of a system
            without rewards, and where an error came before sample 0.
    """

    case: Case
    seed: int | None
    outcomes: Mapping[str, Outcome]
    ended: RunEnd
    simulated: float
    wall: float = field(compare=False)
    error: str = ""
    reward: float | None = None

    @classmethod
    def of(cls, run: Run, case: Case, error: str = "") -> Row:
        """The row of a run."""
        outcomes = {
            name: Outcome(
                course.final,
                float(course.lower[-1]),
                float(course.upper[-1]),
                course.verdict,
                None if course.decided_at is None else seconds(course.decided_at, run.period),
            )
            for name, course in run.courses.items()
        }
        wall, reward = run.wall_time, run.reward
        return cls(case, run.seed, outcomes, run.ended, run.duration, wall, error, reward)

    @classmethod
    def failed(cls, error: Exception, case: Case, seed: int | None, wall: float) -> Row:
        """The row of a simulation that an error has ended, with the samples that it carries."""
        text = f"{type(error).__name__}: {error}"
        run = getattr(error, "run", None)
        if isinstance(run, Run):
            return cls.of(run, case, text)
        return cls(case, seed, {}, "error", 0.0, wall, text)

    @classmethod
    def read(cls, cells: Mapping[str, Any], case: Case, requirements: Iterable[str]) -> Row:
        """The row whose columns, but for those of the case, are these cells."""
        outcomes = {}
        for name in requirements:
            measured = {key: cells[f"{key}({name})"] for key in MEASURES}
            if measured["verdict"] is not None:
                outcomes[name] = Outcome(**measured | {"verdict": Verdict[measured["verdict"]]})
        # Files of before have no returns.
        own: dict[str, Any] = {_FIELDS.get(key, key): cells.get(key) for key in OF_ROW}
        return cls(case=case, outcomes=outcomes, **own)

    def columns(self) -> dict[str, float | str | None]:
        """The row as it stands in a table; a verdict is the name of it."""
        columns: dict[str, Any] = {**self.case.columns(), "seed": self.seed}
        for name, outcome in self.outcomes.items():
            columns |= {f"{key}({name})": getattr(outcome, key) for key in MEASURES}
            columns[f"verdict({name})"] = outcome.verdict.name
        own = {key: getattr(self, _FIELDS.get(key, key)) for key in OF_ROW}
        return columns | own


def seconds(sample: int, period: Fraction | None) -> float:
    """The time of a sample; its number if there is no period."""
    return float(sample * (period or 1))


def open_at_stop(rows: Iterable[Row], name: str) -> list[int]:
    """The places of rows that were stopped early and leave a requirement open.

    Their robustness is that at the stop: had they gone on, it could be another.
    """
    return [
        i
        for i, row in enumerate(rows)
        if row.ended in STOPPED
        and name in row.outcomes
        and row.outcomes[name].verdict is Verdict.UNDECIDED
    ]
