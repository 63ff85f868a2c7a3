"""Metrics of satisfaction during training, for any learner.

The last info of an episode has ``stl_episode``, the outcome of every requirement. `metrics_of`
computes metrics of several episodes; `Satisfaction` keeps the newest episodes and counts
violations.

To add a metric: a key of `metrics_of`, which serves all learners, and a row of the table in
``docs/learners.md``. ``shares_of`` in ``tests/support/programs.py`` counts it again by hand.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rtamt import InputError, Verdict
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_count
from rtamt_gym.checks.names import listing
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.judging.infos import key_mask
from rtamt_gym.results.intervals import clopper_pearson, median, quantiles
from rtamt_gym.results.statistics import RequirementResult

__all__ = [
    "Outcomes",
    "Satisfaction",
    "ended_episodes",
    "evaluation_metrics",
    "mean_return",
    "metrics_of",
    "no_outcomes",
    "successes",
]

Outcomes = Mapping[str, Mapping[str, Any]]
"""The outcome of every requirement in one episode: ``info["stl_episode"]`` of its last info."""

QUANTILES = {"p5": 0.05, "median": 0.5, "p95": 0.95}
"""The quantiles of robustness that are logged, by the end of their keys."""


def metrics_of(episodes: Sequence[Outcomes], period: float | None = None) -> dict[str, float]:
    """Return the metrics of some episodes, by key.

    * ``satisfied``: share of the episodes that satisfied all requirements, and
      ``satisfied_low``, ``satisfied_high``, its exact 95 % interval
    * ``NAME/satisfied``, ``NAME/violated``, ``NAME/undecided``: shares of the three verdicts, and
      ``NAME/satisfied_low``, ``NAME/satisfied_high``
    * ``NAME/progress``: mean progress in stages, from 0 to 1; absent without stages
    * ``NAME/robustness_p5``, ``_median``, ``_p95``: quantiles of robustness; absent if infinite,
      because charts cannot show it
    * ``NAME/first_violation``: median time of violations, in seconds, of the sample that decided
      each, or of the last one if only the end did; absent without a violation

    A quantile is the smallest value that this share of the values does not exceed. Without
    episodes, the result is empty.

    Args:
        episodes: ``info["stl_episode"]`` of each.
        period: Seconds between two samples; None counts samples.

    Example:
        >>> fast = {"verdict": "VIOLATED", "satisfied": False, "robustness": -2.0, "decided_at": 30}
        >>> slow = {"verdict": "SATISFIED", "satisfied": True, "robustness": 0.5, "decided_at": 99}
        >>> metrics = metrics_of([{"speed": fast}, {"speed": slow}], period=0.1)
        >>> for key, value in metrics.items():
        ...     print(key, round(value, 3))
        satisfied 0.5
        satisfied_low 0.013
        satisfied_high 0.987
        speed/satisfied 0.5
        speed/violated 0.5
        speed/undecided 0.0
        speed/satisfied_low 0.013
        speed/satisfied_high 0.987
        speed/robustness_p5 -2.0
        speed/robustness_median -2.0
        speed/robustness_p95 0.5
        speed/first_violation 3.0
    """
    if not episodes:
        return {}
    satisfied = [all(outcome["satisfied"] for outcome in episode.values()) for episode in episodes]
    metrics = {"satisfied": _share(satisfied), **_interval("", satisfied)}
    for name in episodes[0]:
        outcomes = [episode[name] for episode in episodes]
        for verdict in ("SATISFIED", "VIOLATED", "UNDECIDED"):
            there = [outcome["verdict"] == verdict for outcome in outcomes]
            metrics[f"{name}/{verdict.lower()}"] = _share(there)
        satisfied = [outcome["verdict"] == "SATISFIED" for outcome in outcomes]
        metrics |= _interval(f"{name}/", satisfied)
        progress = [float(outcome["progress"]) for outcome in outcomes if "progress" in outcome]
        if progress:
            metrics[f"{name}/progress"] = float(np.mean(progress))
        robustness = quantiles([float(outcome["robustness"]) for outcome in outcomes])
        violated = [outcome for outcome in outcomes if outcome["verdict"] == "VIOLATED"]
        samples = [
            outcome["ended_at" if "ended_at" in outcome else "decided_at"] for outcome in violated
        ]
        times = [sample * float(1 if period is None else period) for sample in samples]
        metrics.update(_measured(name, robustness, times))
    return metrics


def evaluation_metrics(evaluation: Evaluation) -> dict[str, float]:
    """Return the metrics of an evaluation, by key.

    * ``rate``, ``low``, ``high``: share of the episodes that satisfied all requirements, and its 95
      % interval
    * ``return``: mean return of the episodes without an error; absent without such episodes
    * ``NAME/rate``, ``NAME/low``, ``NAME/high``: the same for each requirement
    * ``NAME/robustness_p5``, ``_median``, ``_p95``, ``NAME/first_violation``: as in `metrics_of`
    """
    metrics = _rate("", evaluation.success)
    returns = mean_return(evaluation)
    if returns is not None:
        metrics["return"] = returns
    for name, result in evaluation.requirements.items():
        metrics.update(_rate(f"{name}/", result))
        metrics.update(_measured(name, result.quantiles, result.first_violations))
    return metrics


def successes(evaluation: Evaluation) -> list[bool]:
    """Return whether each episode satisfied all requirements; a failed one did not."""
    names = evaluation.requirements.keys()
    return [
        not row.error
        and row.outcomes.keys() == names
        and all(outcome.verdict is Verdict.SATISFIED for outcome in row.outcomes.values())
        for row in evaluation.record
    ]


def mean_return(evaluation: Evaluation) -> float | None:
    """Return the mean of the known returns, or None."""
    known = evaluation.returns[~np.isnan(evaluation.returns)]
    return float(known.mean()) if known.size else None


class Satisfaction:
    """The satisfaction of requirements over the newest episodes of a policy that learns.

    Args:
        window: The number of newest episodes for shares and quantiles.
        period: Seconds between two samples; None counts samples.

    Attributes:
        period: May be set when it is known.
        episodes: The number of episodes.
        violations: The number of episodes that violated each requirement.

    Raises:
        InputError: If the window is not a whole number above 0.

    Example:
        >>> training = Satisfaction(window=2)
        >>> for robustness in (-1.0, 2.0, 3.0):
        ...     satisfied = robustness > 0
        ...     verdict = "SATISFIED" if satisfied else "VIOLATED"
        ...     found = {"verdict": verdict, "satisfied": satisfied, "robustness": robustness}
        ...     training.add({"near": {**found, "decided_at": 9}})
        >>> found = training.metrics()
        >>> found["near/satisfied"], found["near/robustness_p5"], found["near/violations"]
        (1.0, 2.0, 1)
    """

    def __init__(self, window: int = 100, period: float | None = None) -> None:
        self.period = period
        self.episodes = 0
        self.violations: dict[str, int] = {}
        self._newest: deque[Outcomes] = deque(maxlen=check_count(Argument("window"), window))
        self._costs: deque[float] = deque(maxlen=window)

    def add(self, episode: Outcomes, cost: float | None = None) -> None:
        """Add an episode that has ended.

        Args:
            episode: The outcome of every requirement.
            cost: The sum of ``info["cost"]`` over the steps of the episode; None if it is unknown.

        Raises:
            InputError: If its requirements differ from the episodes before.
        """
        if not self.episodes:
            self.violations = dict.fromkeys(episode, 0)
        if episode.keys() != self.violations.keys():
            raise InputError(
                f"expected the requirements of the episodes before, {listing(self.violations)}, "
                f"got {listing(episode)}; give all environments the same"
            )
        self.episodes += 1
        for name, outcome in episode.items():
            self.violations[name] += outcome["verdict"] == "VIOLATED"
        self._newest.append(episode)
        if cost is not None:
            self._costs.append(cost)

    def metrics(self) -> dict[str, float]:
        """Return the metrics (`metrics_of`) of the newest episodes, and counts since the first one.

        The counts are ``episodes`` and, for each requirement, ``NAME/violations``. ``cost`` is the
        mean of the known costs of the newest episodes; absent if all are unknown.
        """
        metrics = metrics_of(self._newest, self.period)
        if self._costs:
            metrics["cost"] = float(np.mean(self._costs))
        metrics.update({f"{name}/violations": count for name, count in self.violations.items()})
        return {"episodes": self.episodes, **metrics}


def ended_episodes(infos: Mapping[str, Any], ended: ArrayLike) -> list[Outcomes]:
    """Return the outcomes of the episodes that ended in a step of a vector environment.

    Args:
        infos: The infos of the step, in the form of Gymnasium. Where a step resets an environment,
            the last info of the episode is in ``final_info``.
        ended: Whether the episode of each environment ended, ``terminated | truncated``.

    Raises:
        InputError: If the infos have no outcomes.
    """
    index = np.flatnonzero(ended)
    if not len(index):
        return []
    last = infos.get("final_info", infos)
    if "stl_episode" not in last:
        raise InputError(no_outcomes(last))
    return [
        {name: _entry(episode, int(i)) for name, episode in _named(last["stl_episode"])}
        for i in index
    ]


def no_outcomes(info: Mapping[str, Any]) -> str:
    """Return the error about a last info without outcomes."""
    keys = [key for key in info if not key.startswith("_")]
    return (
        "expected 'stl_episode' in the last info of an episode, which StlMonitor and StlReward "
        f"add, got the keys {listing(keys)}; wrap the environment in a monitor, and place time "
        "limits inside it"
    )


def _named(held: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any]]]:
    """Return the entries of a dictionary of arrays that are not masks."""
    return [(name, episode) for name, episode in held.items() if isinstance(episode, Mapping)]


def _entry(columns: Mapping[str, Any], i: int) -> Mapping[str, Any]:
    """Return the outcome of environment i."""
    outcome = {key: columns[key][i] for key in ("robustness", "verdict", "satisfied")}
    for key in ("decided_at", "ended_at", "progress"):
        if key_mask(columns, key, i + 1)[i]:
            outcome[key] = columns[key][i]
    return outcome


def _rate(prefix: str, result: RequirementResult) -> dict[str, float]:
    low, high = result.interval
    return {f"{prefix}rate": result.rate, f"{prefix}low": low, f"{prefix}high": high}


def _measured(name: str, robustness: Mapping[float, float], times: ArrayLike) -> dict[str, float]:
    """Return the metrics of robustness and of the times of violations."""
    metrics = {
        f"{name}/robustness_{end}": robustness[share]
        for end, share in QUANTILES.items()
        if math.isfinite(robustness.get(share, math.inf))
    }
    first = median(times)
    return metrics if math.isnan(first) else {**metrics, f"{name}/first_violation": first}


def _interval(prefix: str, satisfied: Sequence[bool]) -> dict[str, float]:
    """Return the interval of a share, as if all episodes were of one policy."""
    low, high = clopper_pearson(sum(satisfied), len(satisfied))
    return {f"{prefix}satisfied_low": low, f"{prefix}satisfied_high": high}


def _share(there: Sequence[bool]) -> float:
    return sum(there) / len(there)
