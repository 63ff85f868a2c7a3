"""A callback of RLlib: satisfaction during training and in evaluations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from ray.rllib.callbacks.callbacks import RLlibCallback

from rtamt import InputError
from rtamt_gym.learners.metrics import Satisfaction, metrics_of, no_outcomes

__all__ = ["SatisfactionCallback"]

EPISODES: Final = "stl_episodes"
"""The key under which the env runners log outcomes, which the results do not keep."""


class SatisfactionCallback(RLlibCallback):  # type: ignore[misc]  # it has no types here
    """Add ``result["stl"]`` to the results of ``train``: metrics of satisfaction.

    The keys equal the keys of the callback for Stable-Baselines3, with ``cost``. Over the newest
    ``window`` episodes of all env runners: ``satisfied`` (all requirements), ``NAME/satisfied``,
    ``NAME/violated``, ``NAME/undecided`` (shares), ``NAME/robustness_p5``, ``_median``, ``_p95``,
    ``NAME/first_violation`` (median, in seconds, or in samples without a period). Since the start:
    ``NAME/violations`` and ``episodes``. An infinite quantile is absent.

    ``result["evaluation"]["stl"]`` and the result of ``evaluate`` have the metrics of the episodes
    of that evaluation.

    Env runners log the outcomes of episodes, and the algorithm computes the metrics, because
    quantiles of several env runners cannot be averaged. It supports one agent on the new API stack.

    Args:
        window: The number of training episodes for the shares. Set it with
            ``.callbacks(partial(SatisfactionCallback, window=200))``.

    Attributes:
        training: The episodes of training, a `Satisfaction`.

    Raises:
        InputError: If an episode ends without outcomes: no monitor, or a time limit around it.
    """

    def __init__(self, window: int = 100) -> None:
        self.training = Satisfaction(window)
        self._period: float | None = None
        self._has_period = False

    def on_episode_end(
        self,
        *,
        episode: Any,  # noqa: ANN401 - of RLlib, as the other arguments
        metrics_logger: Any = None,  # noqa: ANN401
        env: Any = None,  # noqa: ANN401
        **_kwargs: Any,  # noqa: ANN401
    ) -> None:
        """Log the outcomes of the episode, in the process of an env runner."""
        info = episode.get_infos(-1)
        if "stl_episode" not in info:
            raise InputError(no_outcomes(info))
        if not self._has_period:
            self._has_period = True
            period = env.unwrapped.get_attr("period")[0]
            self._period = None if period is None else float(period)
        result = info["stl_episode"], self._period
        metrics_logger.log_value(EPISODES, result, reduce="item_series")

    def on_train_result(self, *, result: dict[str, Any], **_kwargs: Any) -> None:  # noqa: ANN401
        """Add the metrics of training, and of the evaluation if there was one."""
        for episode, period in _taken(result):
            self.training.period = period
            self.training.add(episode)
        result["stl"] = self.training.metrics()
        if "evaluation" in result:
            _evaluated(result["evaluation"])

    def on_evaluate_end(self, *, evaluation_metrics: dict[str, Any], **_kwargs: Any) -> None:  # noqa: ANN401
        """Add the metrics of the episodes of an evaluation."""
        _evaluated(evaluation_metrics)


def _evaluated(results: dict[str, Any]) -> None:
    result = _taken(results)
    if result:
        results["stl"] = metrics_of([episode for episode, _ in result], result[0][1])


def _taken(results: Mapping[str, Any]) -> list[Any]:
    """Remove the episodes from results; return the outcomes and the period of each."""
    episodes = results.get("env_runners", {}).pop(EPISODES, [])
    return episodes if isinstance(episodes, list) else []  # RLlib stores nan without episodes
