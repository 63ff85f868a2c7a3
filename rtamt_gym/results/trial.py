"""`Trial`: one run or trace, with the outcome of each requirement.

To add a column of a record: a row of `MEASURES` (for each requirement) or of `OF_TRIAL`, and a
field of `Outcome` or `Trial` if the value is new.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple, Self, get_args

from rtamt import Verdict
from rtamt_gym.inputs.case import Case
from rtamt_gym.results.extent import Extent
from rtamt_gym.results.outcome import (
    BY_END,
    Failure,
    Moment,
    Outcome,
    Word,
    triggers_of,
    word,
)

RunEnd = Literal[
    "violation",
    "decided",
    "known",
    "terminated",
    "truncated",
    "duration",
    "error",
    "recorded",
]
"""Why a run ended: it was stopped at a violation, when every verdict was certain, or when every
robustness was known; the system terminated or reached its own time limit; the requested duration
has passed; an error came after the last sample; or it is a recorded trace."""

STOPPED: Final = frozenset[RunEnd]({"violation", "decided", "known"})
"""The ends of runs that were stopped."""


class Measure(NamedTuple):
    """A column of a record.

    Attributes:
        name: Its name; in a column of a requirement, the requirement follows in brackets.
        of: Returns its cell for an outcome or a trial.
        kind: The type of its cells.
        optional: Whether it is left out if all its cells are empty.
    """

    name: str
    of: Callable[[Any], Any]
    kind: Literal["number", "whole", "text"] = "number"
    optional: bool = False


def _evidence(outcome: Outcome) -> str | None:
    return json.dumps(outcome.evidence) if outcome.triggers else None


def _whole(flag: bool | None) -> int | None:  # noqa: FBT001 - it is data
    return None if flag is None else int(flag)


MEASURES: Final = (
    Measure("robustness", lambda outcome: outcome.robustness),
    Measure("lower", lambda outcome: outcome.lower),
    Measure("upper", lambda outcome: outcome.upper),
    Measure("verdict", lambda outcome: outcome.verdict.name, "text"),
    Measure("decided_at", lambda outcome: outcome.decided_at),
    Measure("decided_sample", lambda outcome: outcome.decided and outcome.decided.sample, "whole"),
    Measure("ended_at", lambda outcome: outcome.ended and outcome.ended.time, optional=True),
    Measure(
        "ended_sample",
        lambda outcome: outcome.ended and outcome.ended.sample,
        "whole",
        optional=True,
    ),
    Measure("violated", lambda outcome: BY_END if outcome.by_end else None, "text", optional=True),
    Measure("asked", lambda outcome: outcome.trigger_count, "whole", optional=True),
    Measure("progress", lambda outcome: outcome.progress, optional=True),
    Measure("evidence", _evidence, "text", optional=True),
)
"""The columns of a requirement, written ``robustness(NAME)``."""

OF_TRIAL: Final = (
    Measure("seed", lambda trial: trial.seed, "whole"),
    Measure("ended", lambda trial: trial.ended, "text"),
    Measure("simulated", lambda trial: trial.simulated),
    Measure("return", lambda trial: trial.reward),
    Measure("is_success", lambda trial: _whole(trial.reported), "whole", optional=True),
    Measure("wall", lambda trial: trial.wall),
    Measure("error", lambda trial: trial.error, "text"),
)
"""The columns of a trial, in addition to the columns of its case and its requirements."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One run or trace: its inputs and outcomes. The wall time is not compared.

    Attributes:
        case: The inputs of a simulation; empty for an episode or a recorded trace.
        seed: The seed of an environment's reset; None for a system without a seed.
        outcomes: The outcome of each requirement; empty if an error came before sample 0.
        ended: The reason for its end, as in `Run`.
        simulated: Simulated time in seconds (steps without a period); 0 for a recorded trace.
        wall: Its wall time in seconds; for simulations in one batch, its share.
        error: The type and the text of the error that ended it; empty without an error.
        reward: The sum of the rewards of an environment, in the column ``return``; None for a
            system without rewards, or if an error came before sample 0.
        name: The path of a recorded trace; otherwise empty.
        described: The number of samples or events of a trace, and its times; empty if it was not
            read.
        notes: Remarks on the reading of the file, such as a resampled trace.
        failures: Why requirements have no outcome, by name, if the reasons differ.
        extent: The extent of a recorded trace; None if it was not read, and for a run.
        reported: Whether the environment itself reports a success, in ``is_success`` of the last
            info; None without a report. In the column ``is_success`` it is 1 or 0.
        outside: A text for each requirement that reads values outside declared ranges; not saved,
            because the notes have it.
    """

    case: Case
    seed: int | None
    outcomes: Mapping[str, Outcome]
    ended: RunEnd
    simulated: float
    wall: float = field(compare=False)
    error: str = ""
    reward: float | None = None
    name: str = ""
    described: str = ""
    notes: tuple[str, ...] = ()
    failures: Mapping[str, Failure] = field(default_factory=dict)
    extent: Extent | None = None
    reported: bool | None = None
    outside: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of_trace(
        cls,
        name: str,
        described: str,
        cells: Mapping[str, Outcome | Failure],
        notes: Sequence[str] = (),
        extent: Extent | None = None,
    ) -> Self:
        """Return a recorded trace with the outcome of each requirement, or the error."""
        return cls(
            Case({}),
            None,
            {key: cell for key, cell in cells.items() if isinstance(cell, Outcome)},
            "recorded",
            0.0,
            0.0,
            name=name,
            described=described,
            notes=tuple(notes),
            failures={key: cell for key, cell in cells.items() if isinstance(cell, Failure)},
            extent=extent,
        )

    @classmethod
    def read(
        cls,
        cells: Mapping[str, Any],
        case: Case,
        requirements: Iterable[str],
        *,
        timed: bool = True,
        unconditional: Collection[str] = (),
    ) -> Self:
        """Return the trial with a case and the cells of its columns.

        Args:
            cells: The cells, by name of the column.
            case: The inputs of the simulation.
            requirements: The names of the requirements.
            timed: Whether there is a period, so that times are seconds.
            unconditional: The requirements without an implication.
        """
        outcomes = {}
        for name in requirements:
            measured: dict[str, Any] = {c.name: cells.get(f"{c.name}({name})") for c in MEASURES}
            if measured["verdict"] is None:
                continue
            decided, ended = (
                None if at is None else Moment(sample, at if timed else None)
                for at, sample in (
                    (measured["decided_at"], measured["decided_sample"]),
                    (measured["ended_at"], measured["ended_sample"]),
                )
            )
            evidence = json.loads(measured["evidence"] or "{}")
            triggers = triggers_of(evidence)
            outcomes[name] = Outcome(
                measured["robustness"],
                measured["lower"],
                measured["upper"],
                Verdict[measured["verdict"]],
                decided,
                triggers=() if triggers is None and name in unconditional else triggers,
                vacuous=evidence.get("vacuous", False),
                progress=measured["progress"],
                ended=ended,
            )
        # Files of older versions have no returns.
        own: dict[str, Any] = {column.name: cells.get(column.name) for column in OF_TRIAL}
        reported = own.pop("is_success")
        return cls(
            case=case,
            outcomes=outcomes,
            reward=own.pop("return"),
            reported=None if reported is None else bool(reported),
            **own,
        )

    def columns(self) -> dict[str, float | str | None]:
        """Return the cells of the trial in a table; a verdict is its name."""
        columns: dict[str, Any] = dict(self.case.columns())
        for name, outcome in self.outcomes.items():
            columns |= {f"{column.name}({name})": column.of(outcome) for column in MEASURES}
        return columns | {column.name: column.of(self) for column in OF_TRIAL}

    def judged(self, requirement: str) -> Outcome | None:
        """Return the outcome of a requirement; None if the trial failed."""
        return None if self.error else self.outcomes.get(requirement)

    def cell(self, requirement: str) -> Outcome | Failure:
        """Return the outcome of a requirement, or the reason for a missing outcome."""
        result = self.judged(requirement)
        return result or self.failures.get(requirement) or Failure(self.error)

    @property
    def judged_extent(self) -> Extent | None:
        """The extent from the latest start of its requirements on; None as for ``extent``."""
        starts = [o.late_start.judged for o in self.outcomes.values() if o.late_start is not None]
        return self.extent.starting(max(starts)) if self.extent and starts else self.extent

    @property
    def word(self) -> Word:
        """The worst outcome of a requirement, in a word."""
        words = {word(value) for value in self.outcomes.values()}
        words |= {word(value) for value in self.failures.values()}
        if self.error or not words:
            return "failed"
        return next(item for item in get_args(Word) if item in words)


def end_note(trials: Iterable[Trial]) -> list[str]:
    """Explain violations at a robustness that holds, in two lines; may be empty."""
    if not any(value.by_end for trial in trials for value in trial.outcomes.values()):
        return []
    return [
        f"VIOLATED although the samples satisfy it: violated {BY_END}. The",
        "robustness covers only the samples (--at-termination failure).",
    ]


def open_at_stop(trials: Iterable[Trial], requirement: str) -> list[int]:
    """Return the places of trials that were stopped early and leave a requirement open.

    Their robustness counts only the samples until the stop.
    """
    return [
        index
        for index, trial in enumerate(trials)
        if trial.ended in STOPPED
        and requirement in trial.outcomes
        and trial.outcomes[requirement].verdict is Verdict.UNDECIDED
    ]
