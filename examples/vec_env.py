"""Vector environments of Gymnasium for learners of Stable-Baselines3.

Stable-Baselines3 has its own interface for vectors of environments. Here the steps stay arrays, so
a fast vector environment stays fast.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import VecEnv

__all__ = ["GymnasiumVecEnv"]


class GymnasiumVecEnv(VecEnv):  # type: ignore[misc]  # it has no types here
    """A vector environment of Gymnasium as a `VecEnv`.

    Its autoreset mode must be ``AutoresetMode.DISABLED``, as in monitors that end episodes.
    Environments with an ended episode are reset here, and have ``"terminal_observation"`` and
    ``"TimeLimit.truncated"`` in their infos; other infos are empty.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any], seed: int | None = None) -> None:
        """Set the environments, and the seed of their first reset."""
        if envs.metadata.get("autoreset_mode") is not AutoresetMode.DISABLED:
            mode = envs.metadata.get("autoreset_mode")
            raise ValueError(f"expected environments of AutoresetMode.DISABLED, got {mode}")
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self._seed = seed
        self._actions: Any = None

    def reset(self) -> Any:
        """Start an episode in every environment."""
        obs, _ = self.envs.reset(seed=self._seed)
        self._seed = None
        return obs

    def step_async(self, actions: Any) -> None:
        """Store the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, Any, Any, list[dict[str, Any]]]:
        """Step all environments, and reset those with an ended episode."""
        obs, rewards, terminated, truncated, _ = self.envs.step(self._actions)
        ended = np.logical_or(terminated, truncated)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if ended.any():
            for k in np.flatnonzero(ended):
                cut = bool(truncated[k] and not terminated[k])
                infos[k] = {"terminal_observation": obs[k], "TimeLimit.truncated": cut}
            obs, _ = self.envs.reset(options={"reset_mask": ended})
        return obs, np.asarray(rewards, np.float32), ended, infos

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return the attribute of the vector environment, once for each index."""
        return [getattr(self.envs, attr_name)] * len(self._indices(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise NotImplementedError: there are no single environments."""
        raise NotImplementedError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> Any:
        """Raise NotImplementedError: there are no single environments."""
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:  # noqa: ARG002
        """Return False for each index: environments have no wrappers of their own."""
        return [False] * len(self._indices(indices))

    def _indices(self, indices: Any) -> Sequence[int]:
        return list(self._get_indices(indices))
