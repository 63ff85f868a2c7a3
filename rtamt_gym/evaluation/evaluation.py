"""`Evaluation`: how often a policy satisfies each requirement, with intervals."""

from __future__ import annotations

import math
import os
from base64 import b64decode, b64encode
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from rtamt import InputError, StateError
from rtamt.renamed import OldName
from rtamt_gym import markup
from rtamt_gym.checks.names import listing
from rtamt_gym.evaluation.replays import (
    HOW_TO_REPEAT,
    HOW_TO_REPLAY,
    Frame,
    played,
    replay_difference,
    warn_of_difference,
)
from rtamt_gym.play.record import Record
from rtamt_gym.play.run import Run, plain_run, run_fields
from rtamt_gym.results.codec import (
    document,
    fraction_of,
    number_of,
    plain,
    plain_results,
    read_as,
    save,
    trials_of,
)
from rtamt_gym.results.intervals import IntervalKind
from rtamt_gym.results.provenance import provenance_of
from rtamt_gym.results.statistics import SUCCESS, RequirementResult
from rtamt_gym.tables import counted

if TYPE_CHECKING:  # it is optional
    import pandas as pd

    from rtamt_gym.play.runner import Runner

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation:
    """How often a policy satisfies requirements; `evaluate_policy` returns it.

    Attributes:
        record: A row for every episode: its seed, the outcome of every requirement, its end, its
            return (`Trial.reward`), and its error if it failed.
        system: The name of the environment.
        policy: The name of the policy.
        period: Seconds between samples, or None.
        limit: The time limit of an episode in seconds (steps without a period), or None.
        seed: The seed of the first episode; episode i has ``seed + i``.
        decision: The decisions of sequential stopping by requirement; None without it.
        worst_runs: By requirement, its worst episodes played again in full, the worst first.
        frames: Pictures of the worst episodes, by their seed, for an environment with
            ``render_mode="rgb_array"``: about 12 to 24, evenly spread, at the end, and where the
            episode violated a requirement; at most 320 pixels wide and high.
        evaluation_options: The evaluation options of `evaluate_policy` by name, and under
            ``"signals"`` the source of each variable, None for a function. None if unknown, as in a
            file of an older version.
        interval: The kind of the intervals of its rates, ``"exact"`` or ``"wilson"``.
        repeats: Whether a seed repeats an episode. False if two resets with one seed differed, or
            if a worst episode had another robustness in its replay (`differing`). None if this was
            not checked, as in a file of an older version.
        interrupted: The maximum number of episodes if Ctrl-C ended the evaluation; otherwise None.
        differing: The seeds of the worst episodes whose replay differed from the record. They are
            not in `worst_runs`.
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
    evaluation_options: Mapping[str, Any] | None = None
    interval: IntervalKind = "exact"
    repeats: bool | None = None
    interrupted: int | None = None
    differing: tuple[int, ...] = ()
    _runner: Runner | None = None

    reading = OldName("evaluation_options")
    of_kept = OldName("from_saved")

    @cached_property
    def requirements(self) -> Mapping[str, RequirementResult]:
        """The result of every requirement, by name."""
        return MappingProxyType(self.record.results(self.limit, self.interval))

    @cached_property
    def success(self) -> RequirementResult:
        """The result of all requirements at once, with their minimum robustness."""
        return self.record.success(self.limit, self.interval)

    @cached_property
    def returns(self) -> Floats:
        """The sum of the environment's own rewards, by episode.

        It is nan without a return, and for a failed episode, which has only a part of its return.
        """
        failed = [bool(row.error) for row in self.record]
        return np.where(failed, math.nan, self.record.numbers("return"))

    @cached_property
    def lengths(self) -> Floats:
        """The simulated seconds of every episode (its steps without a period)."""
        return self.record.numbers("simulated")

    @cached_property
    def reported(self) -> tuple[int, int] | None:
        """The number of successes that the environment itself reports, and of its reports.

        The reports are ``is_success`` in the info at the end of an episode; None without reports,
        and for a vector environment.
        """
        result = [row.reported for row in self.record if row.reported is not None]
        return (sum(result), len(result)) if result else None

    @property
    def episodes(self) -> int:
        """The number of episodes."""
        return len(self.record)

    def replay(self, seed: int) -> Run:
        """Play an episode again, in full, and record every sample.

        Args:
            seed: The seed of the episode.

        Raises:
            InputError: If the evaluation does not have this episode.
            StateError: If the evaluation was loaded and the episode is not in `worst_runs`, or if a
                seed does not repeat an episode.
            RtamtError: As `rtamt_gym.simulate` does.

        Warns:
            UnrepeatedSeedWarning: If the episode has another robustness than the recorded one.
        """
        if not any(row.seed == seed for row in self.record):
            last = self.seed + len(self.record) - 1
            raise InputError(
                f"expected the seed of an episode, from {self.seed} to {last}, got {seed!r}"
            )
        stored = [run for runs in self.worst_runs.values() for run in runs if run.seed == seed]
        if stored:
            return stored[0]
        if self.differing:
            raise StateError(
                f"cannot play episode {seed} again: episode {self.differing[0]} differed when it "
                f"was played again; {HOW_TO_REPLAY}"
            )
        if self.repeats is False:
            raise StateError(
                f"cannot play episode {seed} again: two resets of {self.system} with one seed "
                f"begin differently; {HOW_TO_REPEAT}"
            )
        if self._runner is None:
            held = sorted({run.seed or 0 for runs in self.worst_runs.values() for run in runs})
            raise StateError(
                f"an evaluation that was loaded has neither policy nor environment to play "
                f"episode {seed} again; it holds {listing(map(str, held))}; evaluate_policy with "
                f"episodes=1, seed={seed} plays it"
            )
        run = played(self._runner, seed)
        (row,) = (row for row in self.record if row.seed == seed)
        differs = replay_difference(self._runner, row, run)
        if differs:
            warn_of_difference(self.system, seed, differs)
        return run

    def to_frame(self) -> pd.DataFrame:
        """Return a data frame of pandas: a row for every episode, columns as in `Record.columns`.

        Needs the extra ``pandas``.
        """
        return self.record.to_frame().rename_axis("episode")

    def statistics(self) -> pd.DataFrame:
        """Return a data frame of pandas: a row for each requirement, as `Record.statistics`."""
        return self.record.statistics(self.interval)

    def to_json(self) -> str:
        """Return the evaluation as strict JSON; infinities are ``"inf"`` and ``"-inf"``.

        It contains the worst runs with their samples, explanations and pictures.
        """
        return _written(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the text of `to_json` into a file.

        Raises:
            InputError: If the name does not end in ``.json``.
        """
        save(self.to_json(), path)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> Evaluation:
        """Read a file that `save` wrote.

        Raises:
            InputError: If the file does not hold an evaluation.
        """
        return read_as(path, "evaluation", Evaluation.from_saved)

    @staticmethod
    def from_saved(kept: Mapping[str, Any]) -> Evaluation:
        """Return the evaluation from the JSON of a result of the kind ``"evaluation"``."""
        return _evaluation_of(kept)

    def __eq__(self, other: object) -> bool:
        """Compare all fields except wall times and the runner."""
        if not isinstance(other, Evaluation):
            return NotImplemented
        return all(getattr(self, name) == getattr(other, name) for name in _COMPARED)

    __hash__ = None  # type: ignore[assignment]  # it is as large as its record

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without policy and environment, as `save` writes it."""
        return Evaluation, tuple(getattr(self, name) for name in _COMPARED)

    def __repr__(self) -> str:
        return (
            f"<Evaluation of {self.policy} on {self.system}: {counted(len(self.record), 'episode')}"
            f", {self.success.satisfied} satisfy {SUCCESS}>"
        )

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: each requirement with its rate, as a number and a picture."""
        results = list(self.requirements.values())
        if len(results) > 1:
            results.append(self.success)
        rows = []
        for result in results:
            low, high = result.interval
            rate, interval = f"{result.rate:.1%}", f"{low:.1%} to {high:.1%}"
            texts = result.name, f"{result.satisfied} of {result.counted}", rate, interval
            bar = markup.plain("")  # interrupted before the end of the first episode
            if result.counted:
                bar = markup.bar(result.rate, low, high, f"{rate}, in truth {interval}")
            rows.append([*map(markup.plain, texts), bar, markup.code(result.formula)])
        head = ["", "satisfied", "rate", "95 % interval", "from 0 to 1", "formula"]
        return f"{markup.plain(repr(self)[1:-1])}{markup.table(head, rows)}"

    def __str__(self) -> str:
        from rtamt_gym.evaluation.tables import evaluation_table

        return evaluation_table(self)


_COMPARED: Final = (
    *("record", "system", "policy", "period", "limit", "seed", "decision", "worst_runs", "frames"),
    *("evaluation_options", "interval", "repeats", "interrupted", "differing"),
)


_PLAIN = ("policy", "period", "limit", "seed", "decision")
"""The fields of an evaluation that JSON contains unchanged."""


def _written(evaluation: Evaluation) -> str:
    """Return an evaluation as a result of the kind ``"evaluation"``; `_evaluation_of` reads it.

    Derived values are for other programs; ``_evaluation_of`` computes them again.
    """
    runs: list[Run] = []
    places: dict[str, list[int]] = {}
    for name, worst in evaluation.worst_runs.items():
        for run in worst:
            if all(run is not item for item in runs):
                runs.append(run)
        places[name] = [next(i for i, value in enumerate(runs) if value is run) for run in worst]
    result = plain_results(evaluation.record)
    every = {**evaluation.requirements, evaluation.success.name: evaluation.success}
    return document(
        "evaluation",
        {
            **{name: getattr(evaluation, name) for name in _PLAIN},
            "reading": evaluation.evaluation_options,
            "repeats": evaluation.repeats,
            "differing": evaluation.differing,
            **({} if evaluation.interrupted is None else {"interrupted": evaluation.interrupted}),
            **result,
            "results": every,
            "runs": [
                _run(run) | {"frames": _frames(evaluation.frames.get(run.seed or 0, ()))}
                for run in runs
            ],
            "worst_runs": places,
        },
    )


def _evaluation_of(kept: Mapping[str, Any]) -> Evaluation:
    """Read the result of `_written`."""
    runs = [Run(**run_fields(item)) for item in kept["runs"]]
    frames = {
        item["seed"]: tuple(
            Frame(number_of(frame["time"]), b64decode(frame["webp"])) for frame in item["frames"]
        )
        for item in kept["runs"]
        if item.get("frames")
    }
    worst = kept["worst_runs"]
    return Evaluation(
        Record(trials_of(kept), kept["requirements"], kept["system"], provenance_of(kept)),
        kept["system"],
        kept["policy"],
        fraction_of(kept["period"]),
        number_of(kept["limit"]),
        kept["seed"],
        kept["decision"],
        worst_runs={name: tuple(runs[i] for i in places) for name, places in worst.items()},
        frames=frames,
        evaluation_options=kept.get("reading"),  # missing in files of older versions
        interval=_kind_of(kept),
        repeats=kept.get("repeats"),
        interrupted=kept.get("interrupted"),
        differing=tuple(kept.get("differing", ())),
    )


def _kind_of(kept: Mapping[str, Any]) -> IntervalKind:
    """Return the kind of the intervals; files without a kind have Wilson intervals."""
    kinds = {value.get("interval_kind", "wilson") for value in kept.get("results", {}).values()}
    return "exact" if kinds == {"exact"} else "wilson"


def _run(run: Run) -> dict[str, Any]:
    """Return a run in full, with the predicate that decided each robustness."""
    stored = plain_run(run)
    for name, history in stored["courses"].items():
        history["deciding"] = _deciding(run, name)
    return stored


def _frames(frames: Sequence[Frame]) -> list[dict[str, Any]]:
    return [{"time": frame.time, "webp": b64encode(frame.webp).decode("ascii")} for frame in frames]


def _deciding(run: Run, name: str) -> dict[str, Any] | None:
    """Return the deciding predicate, its sample and its values; None if none decided.

    No predicate decides if a window outside the run does.
    """
    explanation = run.explain(name)
    if explanation.predicate is None:
        return None
    last = explanation.steps[-1]
    values = {cause.variable: cause.value for cause in explanation.causes}
    stored: dict[str, Any] = plain(
        {"predicate": last.text, "sample": last.sample, "time": last.time, "values": values}
    )
    return stored
