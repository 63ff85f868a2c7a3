"""The section of an evaluation: rates with intervals, robustness, the worst episodes in full."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.play.run import Run
from rtamt_gym.reports.episodes import episode_of_run, in_words_of
from rtamt_gym.reports.model import Picture, Requirement, Section, ShownEpisode
from rtamt_gym.reports.numbers import six
from rtamt_gym.reports.requirements import (
    at_stop,
    made_of,
    reuse_notes,
    trials_of,
)
from rtamt_gym.results.intervals import promise
from rtamt_gym.results.outcome import Word
from rtamt_gym.results.statistics import SUCCESS, RequirementResult
from rtamt_gym.tables import counted, number

_LETTERS: Final = 8
"""The letters of pictures for each number in the room of the page: pictures take at most as much
space as numbers."""


_ANSWERS: Final[Mapping[str, Word]] = {
    "meets": "satisfied",
    "falls short": "violated",
    "undecided": "undecided",
}
"""The meaning of an answer of sequential stopping to a target, by its first words."""


def of_evaluation(evaluation: Evaluation, room: int) -> Section:
    """Return the section of an evaluation."""
    unit = _unit(evaluation)
    names = list(evaluation.requirements)
    episodes = sum(len(runs) for runs in evaluation.worst_runs.values())
    requirements = [_requirement(evaluation, name, room, episodes) for name in names]
    if len(names) > 1:
        requirements.append(_success(evaluation))
    last = evaluation.seed + evaluation.episodes - 1
    simulated = float(evaluation.lengths.sum())
    facts = [
        ("episodes", str(evaluation.episodes)),
        ("seeds", f"{evaluation.seed} to {last}"),
        ("simulated", f"{simulated:.6g} {unit}"),
        ("95 % intervals", f"{evaluation.interval}: each {promise(evaluation.interval)}"),
    ]
    if evaluation.period is not None:
        facts.append(("period", f"{number(float(evaluation.period))} s"))
    if evaluation.limit is not None:
        facts.append(("time limit", f"{number(evaluation.limit)} {unit}"))
    return Section(
        kind="evaluation",
        title=f"{evaluation.policy} on {evaluation.system}",
        system=evaluation.system,
        policy=evaluation.policy,
        unit=unit,
        replay="evaluation.replay({seed})",
        facts=tuple(facts),
        notes=(
            *reuse_notes(evaluation.record.provenance, "episode"),
            *_decisions(evaluation),
        ),
        requirements=tuple(requirements),
        returns=tuple(sorted(six(x) for x in evaluation.returns if x == x)),  # noqa: PLR0124 - nan
        durations=tuple(sorted(map(six, evaluation.lengths))),
        **made_of(evaluation.record.provenance),
    )


def _unit(evaluation: Evaluation) -> str:
    return "s" if evaluation.period is not None else "steps"


def _decisions(evaluation: Evaluation) -> Iterator[str]:
    """Yield the decisions of sequential stopping."""
    for name, text in (evaluation.decision or {}).items():
        yield (
            f"Sequential stopping after {counted(evaluation.episodes, 'episode')}: the rate of "
            f"{name} {text if text.startswith(('meets', 'falls')) else f'is {text}'}."
        )


def _requirement(evaluation: Evaluation, name: str, room: int, episodes: int) -> Requirement:
    result = evaluation.requirements[name]
    runs = evaluation.worst_runs.get(name, ())
    unit = runs[0].histories[name].unit if runs else "s"
    step = bool(runs) and runs[0].view == "step"
    return Requirement(
        name,
        in_words_of(result.formula, evaluation.period, unit=unit, step=step),
        result.formula,
        trials_of(evaluation.record, evaluation.record.outcomes(name)),
        worst=tuple(_episode(evaluation, run, name, room, episodes) for run in runs),
        rate=result.rate,
        interval=result.interval,
        id=evaluation.record.provenance.ids.get(name),
        answer=_answer(evaluation, name),
        note=" ".join(
            filter(None, (_saved(evaluation, result), at_stop(evaluation.record, name, "episode")))
        ),
    )


def _episode(evaluation: Evaluation, run: Run, name: str, room: int, episodes: int) -> ShownEpisode:
    """Return an episode with as many pictures as fit, evenly spread."""
    episode = episode_of_run(run, name, f"seed {run.seed}", room, episodes)
    when = "at {:g} s" if run.period is not None else "at sample {:g}"
    frames = [
        Picture(
            six(frame.time),
            f"data:image/webp;base64,{b64encode(frame.webp).decode('ascii')}",
            f"The episode of seed {run.seed} {when.format(six(frame.time))}",
        )
        for frame in evaluation.frames.get(run.seed or 0, ())
    ]
    return replace(episode, frames=_fitting(frames, room * _LETTERS // episodes, episode))


def _fitting(frames: Sequence[Picture], letters: int, episode: ShownEpisode) -> tuple[Picture, ...]:
    """Return the pictures that fit into a number of letters: evenly spread, with the violation."""
    largest = max((len(frame.source) for frame in frames), default=1)
    places = np.linspace(0, len(frames) - 1, min(len(frames), letters // largest)).round()
    time = None
    if episode.verdict == "violated":
        time = episode.times[-1] if episode.decided_at is None else episode.decided_at.time
    for i, frame in enumerate(frames):
        if len(places) and frame.time == time:
            places[np.abs(places - i).argmin()] = i
    return tuple(frames[int(position)] for position in places)


def _success(evaluation: Evaluation) -> Requirement:
    """Return the requirement that stands for all requirements."""
    result = evaluation.success
    return Requirement(
        SUCCESS,
        "every requirement of this evaluation is satisfied in one and the same episode",
        result.formula,
        trials_of(evaluation.record, evaluation.record.together()),
        rate=result.rate,
        interval=result.interval,
        together=True,
    )


def _answer(evaluation: Evaluation, name: str) -> Word | None:
    """Return the answer of sequential stopping for a requirement; None without a target."""
    decisions = evaluation.decision or {}
    if any(value.startswith("known") for value in decisions.values()):  # widths, not targets
        return None
    text = decisions.get(name, "")
    return next((word for start, word in _ANSWERS.items() if text.startswith(start)), None)


def _saved(evaluation: Evaluation, result: RequirementResult) -> str:
    if not result.saved:
        return ""
    unit = "simulated seconds" if evaluation.period is not None else "steps"
    return f"Episodes that were stopped once this was decided saved {number(result.saved)} {unit}."
