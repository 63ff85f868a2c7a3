"""Policies of Stable-Baselines3 with the observation wrappers of their training.

A policy that learned below `VecNormalize` or `VecFrameStack` knows only their observations.
`as_trained` applies them to the observations of a single environment, with the statistics of the
training, which an evaluation does not change.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any

import gymnasium as gym
import numpy as np
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

Layer = Any
"""What one wrapper does to a batch of observations: a function, or a stack that remembers."""

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
    """A model that predicts from observations without wrappers.

    Args:
        model: The model.
        venv: The innermost vector environment of its training.
        layers: The effects of the wrappers, the innermost first.

    Attributes:
        name: The name of the algorithm, for evaluations.
        policy: The network, with weights that identify the model, or None.
        observation_space: The observations of an environment without the wrappers.
        action_space: The actions of the model.
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
                # The stack of an episode that starts is cleared as it is where one has ended.
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
