"""A callback of Stable-Baselines3: satisfaction, the best model, and a reliable stop."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from copy import copy
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.utils import is_vectorized_observation
from stable_baselines3.common.vec_env import (
    VecCheckNan,
    VecEnv,
    VecEnvWrapper,
    VecExtractDictObs,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
    VecTransposeImage,
    VecVideoRecorder,
)
from stable_baselines3.common.vec_env.stacked_observations import StackedObservations

from rtamt import InputError
from rtamt.errors import Argument
from rtamt_gym.checks.arguments import check_count
from rtamt_gym.evaluation.evaluate import evaluate_policy
from rtamt_gym.evaluation.evaluation import Evaluation
from rtamt_gym.evaluation.sequential import RatioTest
from rtamt_gym.learners.best import Best, Target
from rtamt_gym.learners.metrics import Satisfaction, evaluation_metrics, no_outcomes, successes
from rtamt_gym.play.runner import Requirements
from rtamt_gym.signals.signals import SignalLike

__all__ = ["SatisfactionCallback", "as_trained"]


Layer = Any
"""The effect of a wrapper on a batch of observations: a function, or a stack with a memory."""

PASSING = (VecMonitor, VecCheckNan, VecVideoRecorder)
"""The wrappers that leave observations as they are."""


def as_trained(model: Any) -> Any:  # noqa: ANN401 - a model, or an `AsTrained`
    """Return the policy of a model, for observations of a single environment.

    ``evaluate_policy(as_trained(model), env)`` takes the environment that ``make_vec_env`` wrapped;
    it needs no `VecNormalize`. A loaded model gets its training environment from
    ``model.set_env(VecNormalize.load(path, venv))``.

    Args:
        model: A model of Stable-Baselines3 or sb3-contrib that has its training environment.

    Returns:
        The model itself, if no wrapper changes its observations.

    Raises:
        InputError: If the model has no environment, or if a wrapper is unknown.
    """
    venv = model.get_env()
    if venv is None:
        raise InputError(
            "expected a model with its training environment, which shows how it sees, got one "
            "without; write model.set_env(...)"
        )
    layers: list[Layer] = []
    while isinstance(venv, VecEnvWrapper):
        if not isinstance(venv, PASSING):
            layers.insert(0, _layer(venv))
        venv = venv.venv
    return AsTrained(model, venv, layers) if layers else model


class AsTrained:
    """A model that predicts from observations without wrappers, whose effects are ``layers``.

    Attributes:
        name: The name of the algorithm, for evaluations.
        policy: The network, with weights that identify the model, or None.
    """

    def __init__(self, model: Any, venv: VecEnv, layers: list[Layer]) -> None:  # noqa: ANN401
        self._model = model
        self._layers = layers
        self.name = type(model).__name__
        self.policy = getattr(model, "policy", None)
        self.observation_space = venv.observation_space
        self.action_space = model.action_space

    def predict(
        self,
        observation: Any,  # noqa: ANN401
        state: Any = None,  # noqa: ANN401
        episode_start: Any = None,  # noqa: ANN401
        deterministic: bool = False,  # noqa: FBT001, FBT002 - as Stable-Baselines3 has it
    ) -> tuple[Any, Any]:
        """Predict the actions for one observation or several, as ``model.predict`` does.

        The state holds the stacked observations of the episodes and the memory of a recurrent
        policy. None starts new episodes.
        """
        single = not is_vectorized_observation(observation, self.observation_space)
        if single:
            observation = _parts(observation, lambda part: np.asarray(part)[None])
        num = len(
            next(iter(observation.values())) if isinstance(observation, dict) else observation
        )
        if state is None:
            layers, memory = [_begun(layer, num) for layer in self._layers], None
            starts = np.ones(num, np.bool_)
        else:
            layers, memory = [_begun(layer) for layer in state[0]], state[1]
            starts = np.zeros(num, np.bool_) if episode_start is None else np.asarray(episode_start)
        for layer in layers:
            if isinstance(layer, StackedObservations):
                # The stack of a starting episode is cleared, as after the end of an episode.
                ends = [{"terminal_observation": _parts(observation, lambda p: p[0])}] * num
                observation, _ = layer.update(observation, starts, ends)
            else:
                observation = layer(observation)
        actions, memory = self._model.predict(
            observation, memory, starts, deterministic=deterministic
        )
        return actions[0] if single else actions, (layers, memory)


def _layer(wrapper: VecEnvWrapper) -> Layer:
    match wrapper:
        case VecNormalize():
            return wrapper.normalize_obs
        case VecFrameStack():
            return wrapper.stacked_obs
        case VecTransposeImage():
            return wrapper.transpose_observations
        case VecExtractDictObs():
            key = wrapper.key
            return lambda observation: observation[key]
        case _:
            raise InputError(
                "expected a training environment with vector wrappers of Stable-Baselines3 only, "
                f"such as VecNormalize and VecFrameStack, got {type(wrapper).__name__}; use a "
                "Gymnasium wrapper around each environment instead"
            )


def _begun(layer: Layer, num: int | None = None) -> Layer:
    """Return the layer, or a copy of a stack; ``num`` empties it for so many environments."""
    if not isinstance(layer, StackedObservations):
        return layer
    stack = copy(layer)
    if isinstance(stack.observation_space, gym.spaces.Dict):
        parts = stack.sub_stacked_observations.items()
        stack.sub_stacked_observations = {key: _begun(part, num) for key, part in parts}
    elif num is not None:
        stack.stacked_obs = np.zeros((num, *stack.stacked_shape), stack.observation_space.dtype)
    return stack


def _parts(observation: Any, change: Callable[[Any], Any]) -> Any:  # noqa: ANN401
    """Return the observation with each array changed."""
    if isinstance(observation, dict):
        return {key: change(part) for key, part in observation.items()}
    return change(observation)


class SatisfactionCallback(BaseCallback):  # type: ignore[misc]  # it has no types here
    """Log satisfaction, save the best model, and stop when a target is met.

    **During training** it logs metrics of the newest ``window`` episodes to the logger of the
    model: ``stl/satisfied`` (all requirements), ``stl/NAME/satisfied``, ``/violated``,
    ``/undecided`` (shares), ``/robustness_p5``, ``_median``, ``_p95``, ``/first_violation``
    (median, in seconds, or in samples without a period), with ``cost=`` in the monitor ``stl/cost``
    (mean sum per episode), and since the start ``stl/NAME/violations`` and ``stl/episodes``. The
    terminal shows the shares of satisfaction only.

    **With an environment to evaluate in**, every ``eval_freq`` steps and at the end it runs
    :func:`rtamt_gym.evaluate_policy` on the same ``episodes`` seeds. It logs ``eval_stl/rate``,
    ``/low``, ``/high`` (satisfaction of all requirements, its 95 % interval), ``eval_stl/return``,
    and per requirement ``eval_stl/NAME/rate``, ``/low``, ``/high``, ``/robustness_p5``,
    ``_median``, ``_p95``, ``/first_violation``. `VecNormalize`, `VecFrameStack` and similar
    wrappers are applied with their current statistics, which an evaluation does not change. With
    ``deterministic=True`` evaluations do not affect training.

    **The best model**, by satisfaction of all requirements and then by return, is saved to
    ``path``: ``best_model.zip``, its metrics to ``best_model.json``, and the statistics of a
    `VecNormalize`, which it needs, to ``best_model_vecnormalize.pkl``. Evaluate it on other seeds
    before you report its rate, because the best of many evaluations looks better than it is.

    **With a target** training stops at a policy that provably meets it. An evaluation at or above
    the target starts a sequential ratio test on new seeds. `Target` explains how all tests together
    err with probability ``alpha`` at most. The policy that passed becomes the best model.

    Args:
        env: The environment to evaluate in, as for `evaluate_policy`: a function that makes a
            monitored environment, such as the argument of ``make_vec_env``; an id or an
            environment, with ``specs`` and ``signals``; a `DummyVecEnv`, where the first
            environment is used.
            It must not be a training environment. None evaluates nothing
        specs: The requirements, if the environment has no monitor
        signals: Their signals, if the environment has no monitor
        eval_freq: Training steps between two evaluations, over all environments together
        episodes: The episodes of an evaluation
        seed: The seed of its first episode; the next ones follow. The default is far from usual
            seeds
        deterministic: Whether the evaluated policy takes its most likely action
        path: The path of the best model, with or without ``.zip``; None saves nothing
        target: The rate of satisfying all requirements that stops training; None trains to the end
        alpha: The maximum probability of a wrong stop
        margin: How far below the target a rate must be refused
        window: The number of training episodes for the shares
        **evaluation: Further arguments of `evaluate_policy`, such as ``n_envs=`` or ``timeout=``

    Attributes:
        training: The episodes of training, a `Satisfaction`.
        evaluations: The steps and the `Evaluation` of each evaluation.
        best: The `Best` of them.
        confirmed: The `RatioTest` that stopped the training, or None.

    Raises:
        InputError: If an argument does not fit, or if a training episode ends without outcomes and
            `env` is None.
    """

    def __init__(
        self,
        env: Any = None,  # noqa: ANN401 - as in evaluate_policy
        specs: Requirements | None = None,
        signals: Mapping[str, SignalLike] | None = None,
        *,
        eval_freq: int = 10_000,
        episodes: int = 100,
        seed: int = 10_000,
        deterministic: bool = True,
        path: str | os.PathLike[str] | None = "best_model",
        target: float | None = None,
        alpha: float = 0.05,
        margin: float = 0.05,
        window: int = 100,
        **evaluation: Any,  # noqa: ANN401 - as evaluate_policy takes it
    ) -> None:
        super().__init__()
        if env is None and target is not None:
            raise InputError(
                f"expected an environment to evaluate in, which target={target!r} needs, got none; "
                "give the function that makes the training environment"
            )
        self.training = Satisfaction(window)
        self.evaluations: list[tuple[int, Evaluation]] = []
        self.best = Best()
        self.confirmed: RatioTest | None = None
        self._costs: list[float | None] = []
        self._env = _single(env)
        self._freq = check_count(Argument("eval_freq"), eval_freq)
        self._episodes = check_count(Argument("episodes"), episodes)
        self._seed = seed
        self._path = None if path is None else Path(os.fspath(path).removesuffix(".zip"))
        self._target = target
        if target is not None:
            self._test = Target(target, alpha, margin, seed=seed + self._episodes)
        own = {"specs": specs, "signals": signals, "deterministic": deterministic}
        self._options: dict[str, Any] = {"keep": 0, **own, **evaluation}

    def _on_training_start(self) -> None:
        self._next = (self.num_timesteps // self._freq + 1) * self._freq
        self.confirmed = None
        num = self.training_env.num_envs
        if self.num_timesteps == 0:
            self._costs = [0.0] * num
        elif len(self._costs) != num:  # running episodes have unknown costs
            self._costs = [None] * num
        if self._env is None:
            return
        as_trained(self.model)  # raises for unknown wrappers
        trained_in = getattr(self.training_env.unwrapped, "envs", ())
        # A `VecEnv` around a vector environment has that environment here, not a list.
        if self._env is trained_in or (isinstance(trained_in, list) and self._env in trained_in):
            raise InputError(
                "expected a separate environment for evaluations, got the training environment; "
                "pass the function that makes it"
            )
        seed = self.model.seed
        if seed is not None and seed < self._seed + self._episodes and self._seed < seed + num:
            raise InputError(
                f"expected seeds that training does not use, got {self._seed} to "
                f"{self._seed + self._episodes - 1} for evaluations, and {seed} to "
                f"{seed + num - 1} for the environments of the model; give another seed="
            )

    def _on_step(self) -> bool:
        ended = False
        pairs = zip(self.locals["dones"], self.locals["infos"], strict=True)
        for i, (done, info) in enumerate(pairs):
            known = self._costs[i]
            cost = known + info["cost"] if known is not None and "cost" in info else None
            self._costs[i] = 0.0 if done else cost
            if done:
                ended = True
                self._count(info, cost)
        if ended and isinstance(self.model, OffPolicyAlgorithm):  # it writes in the midst of steps
            self._log("stl", self.training.metrics())
        if self._env is None or self.num_timesteps < self._next:
            return True
        self._next = (self.num_timesteps // self._freq + 1) * self._freq
        self._evaluate()
        return self.confirmed is None

    def _on_rollout_end(self) -> None:
        self._log("stl", self.training.metrics())

    def _on_training_end(self) -> None:
        evaluated = [steps for steps, _ in self.evaluations[-1:]] == [self.num_timesteps]
        if self._env is not None and not evaluated:
            self._evaluate()

    def _count(self, info: Mapping[str, Any], cost: float | None) -> None:
        """Count an episode of training; raise InputError for missing outcomes that are needed."""
        if "stl_episode" in info:
            if not self.training.episodes:
                self.training.period = self.training_env.get_attr("period", 0)[0]
            self.training.add(info["stl_episode"], cost)
        elif self._env is None or self.training.episodes:
            raise InputError(no_outcomes(info))

    def _evaluate(self) -> None:
        evaluation = self._run(self._seed)
        self.evaluations.append((self.num_timesteps, evaluation))
        better = self.best.add(evaluation)
        if self._target is not None and evaluation.success.rate >= self._target:
            self.confirmed = self._test.met_by(lambda seed: successes(self._run(seed)))
        if self.confirmed is not None:
            self.best.evaluation = evaluation
        if self._path is not None and (better or self.confirmed is not None):
            self._save(self._path, evaluation)
        self._log("eval_stl", evaluation_metrics(evaluation))
        self.logger.record("time/total_timesteps", self.num_timesteps, exclude="tensorboard")
        self.logger.dump(self.num_timesteps)

    def _run(self, seed: int) -> Evaluation:
        policy = as_trained(self.model)
        return evaluate_policy(
            policy, self._env, episodes=self._episodes, seed=seed, **self._options
        )

    def _save(self, path: Path, evaluation: Evaluation) -> None:
        """Write the model and its metrics; each file is complete or absent."""
        path.parent.mkdir(parents=True, exist_ok=True)
        statistics = self.model.get_vec_normalize_env()
        if statistics is not None:
            _written(path, "_vecnormalize.pkl", statistics.save)
        _written(path, ".zip", self.model.save)
        summary = {"steps": self.num_timesteps, "seed": self._seed, "episodes": evaluation.episodes}
        summary |= evaluation_metrics(evaluation)
        if self.confirmed is not None:
            test = self.confirmed
            summary["confirmed"] = f"{test.decision}: {test.satisfied} of {test.episodes} episodes"
        text = json.dumps(summary, indent=2)
        _written(path, ".json", lambda file: Path(file).write_text(f"{text}\n", encoding="utf-8"))

    def _log(self, prefix: str, metrics: Mapping[str, float]) -> None:
        for key, value in metrics.items():
            # The table in the terminal cuts long keys, and fails where two become equal.
            shown = key.rpartition("/")[2] in SHOWN and len(key) <= LONGEST
            self.logger.record(f"{prefix}/{key}", value, exclude=None if shown else "stdout")


SHOWN: Final = frozenset({"satisfied", "rate", "low", "high", "return"})
"""The ends of the keys that the table in the terminal shows."""

LONGEST: Final = 33
"""The maximum length of a key that it shows completely."""


def _single(env: Any) -> Any:  # noqa: ANN401
    """Return the environment to evaluate in: of a vector environment in this process, the first."""
    if not isinstance(env, VecEnv):
        return env
    envs = getattr(env.unwrapped, "envs", ())
    if not envs:
        raise InputError(
            f"expected an environment of this process to evaluate in, got {env.unwrapped}; give "
            "the function that makes it, and n_envs= or n_jobs= for more at a time"
        )
    return envs[0]


def _written(path: Path, end: str, write: Callable[[str], Any]) -> None:
    """Write a file under another name until it is complete."""
    file = path.with_name(f"{path.name}{end}")
    part = path.with_name(f"{path.name}.part{end}")
    write(str(part))
    part.replace(file)
