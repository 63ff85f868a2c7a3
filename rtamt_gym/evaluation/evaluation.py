"""`Evaluation`: how often a policy satisfies each requirement, with intervals."""

from __future__ import annotations

import math
from base64 import b64decode, b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Final, Self

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
from rtamt_gym.play.summaries import failures
from rtamt_gym.results.codec import (
    SavedResult,
    document,
    fraction_of,
    number_of,
    plain,
    plain_results,
    provenance_of,
    trials_of,
)
from rtamt_gym.results.intervals import IntervalKind, promise, rate_interval
from rtamt_gym.results.provenance import reuse_lines
from rtamt_gym.results.statistics import SUCCESS, RequirementResult, Statistic, columns_of
from rtamt_gym.results.trial import end_note, open_at_stop
from rtamt_gym.results.warnings import evidence_lines
from rtamt_gym.tables import Terminal, counted, short

if TYPE_CHECKING:  # it is optional
    import pandas as pd

    from rtamt_gym.play.runner import Runner

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(SavedResult):
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

    kind: ClassVar = "evaluation"

    reading = OldName("evaluation_options")

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

        It contains the worst runs with their samples, explanations and pictures, and derived values
        for other programs.
        """
        runs: list[Run] = []
        places: dict[str, list[int]] = {}
        for name, worst in self.worst_runs.items():
            for run in worst:
                if all(run is not item for item in runs):
                    runs.append(run)
            places[name] = [
                next(i for i, value in enumerate(runs) if value is run) for run in worst
            ]
        return document(
            "evaluation",
            {
                **{name: getattr(self, name) for name in _PLAIN},
                "reading": self.evaluation_options,
                "repeats": self.repeats,
                "differing": self.differing,
                **({} if self.interrupted is None else {"interrupted": self.interrupted}),
                **plain_results(self.record),
                "results": {**self.requirements, self.success.name: self.success},
                "runs": [
                    _run(run) | {"frames": _frames(self.frames.get(run.seed or 0, ()))}
                    for run in runs
                ],
                "worst_runs": places,
            },
        )

    @classmethod
    def from_saved(cls, kept: Mapping[str, Any]) -> Self:
        """Return the evaluation from the JSON of a result of the kind ``"evaluation"``."""
        runs = [Run(**run_fields(item)) for item in kept["runs"]]
        frames = {
            item["seed"]: tuple(
                Frame(number_of(frame["time"]), b64decode(frame["webp"]))
                for frame in item["frames"]
            )
            for item in kept["runs"]
            if item.get("frames")
        }
        worst = kept["worst_runs"]
        return cls(
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
        return evaluation_table(self)


_COMPARED: Final = (
    *("record", "system", "policy", "period", "limit", "seed", "decision", "worst_runs", "frames"),
    *("evaluation_options", "interval", "repeats", "interrupted", "differing"),
)


_PLAIN = ("policy", "period", "limit", "seed", "decision")
"""The fields of an evaluation that JSON contains unchanged."""


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


_NAMED: Final = 3
"""The number of worst episodes that a table names."""

_OPTIONAL: Final = ("cvar", "least")
"""The columns that a table leaves out if it is too wide; the worst episodes are named below it."""

_NAME_WIDTH: Final = 11
"""The minimum width of the names of requirements."""


def evaluation_table(evaluation: Evaluation) -> str:
    """Return the table of an evaluation as plain text of 80 columns."""
    lines = _of_evaluation(evaluation, Terminal())
    return "\n".join([*lines, *evidence_lines(evaluation.record, "episode")])


def show(evaluation: Evaluation) -> None:
    """Print the table of an evaluation, on a terminal with colours and in its full width.

    The command reports requirements that were never triggered by itself, at its end.
    """
    print(*_of_evaluation(evaluation, Terminal.present()), sep="\n")  # noqa: T201 - of the command line


def _of_evaluation(evaluation: Evaluation, terminal: Terminal) -> Iterator[str]:
    results = list(evaluation.requirements.values())
    if len(results) > 1:
        results.append(evaluation.success)
    seeds = [row.seed for row in evaluation.record if row.seed is not None]
    yield from map(terminal.cut, _heading(evaluation))
    yield terminal.cut(
        f"{counted(len(evaluation.record), 'episode')}"
        + (f", seeds {min(seeds)} to {max(seeds)}" if seeds else "")
    )
    yield ""
    columns = columns_of(results, rates=True)
    for optional in _OPTIONAL:
        if _total_width(columns, results) + _NAME_WIDTH > terminal.width:
            columns = [column for column in columns if column.key != optional]
    # The name for all at once is short, so that it is never cut.
    names = ["all" if result is evaluation.success else result.name for result in results]
    rows = [
        [name, *(column.cell(value) for column in columns)]
        for name, value in zip(names, results, strict=True)
    ]
    head = ["requirement", *(column.heading for column in columns)]
    yield from terminal.table([head, *rows], "<" + ">" * len(columns))
    stopped = {i for name in evaluation.requirements for i in open_at_stop(evaluation.record, name)}
    at_stop = f" (at the stop in {counted(len(stopped), 'open episode')})" if stopped else ""
    of_robustness = ", ".join(column.heading for column in columns if column.robustness)
    yield terminal.cut(f"{of_robustness}: of the robustness{at_stop}")
    yield terminal.cut(f"95% interval: {promise(evaluation.interval)}")
    yield from map(terminal.cut, end_note(evaluation.record))
    yield ""
    for value in evaluation.requirements.values():
        name = evaluation.record.provenance.called(value.name)
        yield terminal.cut(f"{name}: {value.formula}")
    yield ""
    unit = "s" if evaluation.period is not None else "steps"
    lines = [
        line for value in evaluation.requirements.values() for line in _worst_lines(value, unit)
    ]
    yield from map(terminal.cut, (*lines, _around(evaluation)))
    if evaluation.reported is not None:
        count, total = evaluation.reported
        low, high = (100 * end for end in rate_interval(count, total, evaluation.interval))
        yield from terminal.wrapped(
            f"is_success of the environment itself: {100 * count / total:.1f}% of "
            f"{counted(total, 'episode')}, 95% interval {low:.1f} to {high:.1f}"
        )
    if evaluation.repeats is False:
        yield from terminal.wrapped(_unrepeated(evaluation))
    if evaluation.decision is not None:
        yield ""
        for name, decision in evaluation.decision.items():
            yield from terminal.wrapped(f"{name}: {decision}", _style_of(decision))
    if lines := failures(evaluation.record):
        yield ""
        yield from (line for item in lines for line in terminal.wrapped(item, "red"))
    reused = reuse_lines(evaluation.record.provenance, "episode")
    yield from ["", *reused] if reused else []


def _unrepeated(evaluation: Evaluation) -> str:
    """Return why a seed does not repeat an episode."""
    if evaluation.differing:
        return (
            f"note: episode {evaluation.differing[0]} differed when it was played again: the same "
            "call may give other numbers"
        )
    return (
        "note: two resets with one seed begin differently: the same call plays other episodes, and "
        "none is played again"
    )


def _heading(evaluation: Evaluation) -> list[str]:
    lines = [f"{evaluation.system} under {evaluation.policy}"]
    if evaluation.interrupted is not None:
        planned = counted(evaluation.interrupted, "episode")
        lines.append(f"interrupted after {len(evaluation.record)} of {planned}")
    return lines


def _total_width(columns: Sequence[Statistic], results: Sequence[RequirementResult]) -> int:
    """Return the widths of the columns next to the names."""
    return sum(
        2 + max(len(column.heading), *(len(column.cell(result)) for result in results))
        for column in columns
    )


def _worst_lines(result: RequirementResult, unit: str) -> Iterator[str]:
    """Yield the worst episodes of a requirement, and when it is violated."""
    if result.satisfied == result.episodes or not result.worst:
        return
    worst = ", ".join(f"{seed} ({short(height)})" for seed, height in result.worst[:_NAMED])
    yield f"worst seeds of {result.name}: {worst}"
    times = result.first_violations[~np.isnan(result.first_violations)]
    if times.size:
        first, last = short(float(times.min())), short(float(times.max()))
        if first == last:
            yield f"  violated at {first} {unit}"
            return
        half = short(float(np.median(times)))
        yield f"  violated from {first} {unit} to {last} {unit}, half of them by {half} {unit}"


def _around(evaluation: Evaluation) -> str:
    """Return a line with the returns, the lengths, and the time that stopping saved."""
    unit = "s" if evaluation.period is not None else "steps"
    parts = [f"length {short(float(np.mean(evaluation.lengths)))} {unit} on average"]
    known = evaluation.returns[~np.isnan(evaluation.returns)]
    if known.size:
        parts.insert(0, f"return {short(float(np.mean(known)))} on average")
    if saved := max(value.saved for value in evaluation.requirements.values()):
        parts.append(f"{short(saved)} {unit} saved by stopping")
    return ", ".join(parts)


def _style_of(decision: str) -> str:
    for start, style in (("meets", "green"), ("falls short", "red"), ("undecided", "yellow")):
        if decision.startswith(start):
            return style
    return ""
