"""`evaluate_policy`: plays episodes of a policy and counts how many satisfy each requirement."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from rtamt import InputError
from rtamt_gym.checks.arguments import check_count
from rtamt_gym.evaluation.episodes import Episodes
from rtamt_gym.evaluation.evaluation import Evaluation, played
from rtamt_gym.search.campaigns.campaign import run_campaign
from rtamt_gym.search.runs.options import Options
from rtamt_gym.search.runs.record import Record
from rtamt_gym.search.runs.requirements import Requirements
from rtamt_gym.search.sweeps.sweep import tell_failures
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.simulation.record import Stop
from rtamt_gym.simulation.run import Run

if TYPE_CHECKING:  # joblib is optional
    from rtamt_gym.search.campaigns.workers import Backend

__all__ = ["evaluate_policy"]


def evaluate_policy(
    policy: Any,  # noqa: ANN401 - a model of a package that is optional
    env: Any,  # noqa: ANN401
    specs: Requirements | None = None,
    signals: Mapping[str, SignalLike] | None = None,
    *,
    episodes: int = 100,
    seed: int = 0,
    n_envs: int = 1,
    n_jobs: int | None = None,
    backend: Backend | None = None,
    timeout: float | None = None,
    folder: str | os.PathLike[str] | None = None,
    stop: Stop = "end",
    deterministic: bool = True,
    keep: int = 1,
    progress: bool = False,
    **reading: Unpack[Options],
) -> Evaluation:
    """Plays episodes of a policy and counts how many satisfy each requirement.

    Args:
        policy: Who acts.
        env: The environment.
        specs: What is required.
        signals: As for `simulate`.
        episodes: How many episodes are played.
        seed: The seed of the first episode; each further one has one more.
        n_envs: How many episodes run side by side in a process.
        n_jobs: How many processes play episodes.
        backend: Where the processes run.
        timeout: Seconds that an episode may take.
        folder: A folder for finished episodes.
        stop: When to stop an episode, as for `simulate`.
        deterministic: Whether a model gives the action that it holds for best, or draws one.
        keep: How many of the worst episodes of each requirement are kept in full.
        progress: Whether to show a bar.
        **reading: How episodes are judged.

    Returns:
        What the episodes have become.
    """
    check_count("episodes=", episodes)
    check_count("n_envs=", n_envs)
    given: dict[str, object] = {"keep": keep, "seed": seed}
    for name, value in given.items():
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
            raise InputError(f"expected {name}= as a whole number, 0 or more, got {value!r}")
    runner = Episodes.of(
        policy,
        env,
        specs,
        signals=signals,
        deterministic=deterministic,
        n_envs=n_envs,
        stop=stop,
        **reading,
    )
    record = run_campaign(
        runner,
        [({}, each) for each in range(seed, seed + episodes)],
        n_jobs=n_jobs,
        backend=backend,
        timeout=timeout,
        folder=folder,
        about={"policy": runner.evaluated.identity},
        what=f"evaluation of {runner.evaluated.name}",
        progress=progress,
    )
    tell_failures(record)
    return Evaluation(
        record,
        runner.name,
        runner.evaluated.name,
        runner.period,
        runner.duration,
        int(seed),
        None,
        _worst_runs(runner, record, keep),
        runner,
    )


def _worst_runs(runner: Episodes, record: Record, keep: int) -> dict[str, tuple[Run, ...]]:
    """The worst episodes of each requirement, played again in full."""
    runs: dict[int, Run] = {}
    found = {}
    for name in record.requirements:
        ranked = sorted(
            (row for row in record if name in row.outcomes and not row.error),
            key=lambda row: (row.outcomes[name].robustness, row.seed),
        )
        for row in ranked[:keep]:
            number = row.seed or 0
            if number not in runs:
                runs[number] = played(runner, number)
        found[name] = tuple(runs[row.seed or 0] for row in ranked[:keep])
    return found
