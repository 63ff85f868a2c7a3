"""Vector environments that are none of Gymnasium's by class: those of EnvPool and of PufferLib.

They are known by their form, and neither package is imported. An adapter shows each as a
`VectorEnv`; it hands on the arrays that it is given, without a copy.
"""

from __future__ import annotations

from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from rtamt import InputError, InputTypeError, StateError
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.taps import StaysOpen

__all__ = ["PufferVectorEnv", "as_vector_env", "is_pool"]

_Result = tuple[Any, Any, Any, Any, dict[str, Any]]


def as_vector_env(
    env: Any,  # noqa: ANN401 - whatever is given
    *,
    final_obs: Literal["held"] | None = None,
) -> VectorEnv[Any, Any, Any]:
    """The environments as a vector environment of Gymnasium; one of Gymnasium's is returned as is.

    :class:`VectorStlMonitor` and :class:`VectorStlReward` call it, so that they take what
    ``envpool.make_gymnasium`` and ``pufferlib.vector.make`` give. The arrays of observations,
    rewards and flags are those of the environments, not copies.

    * EnvPool resets an environment in the step after its last, ``AutoresetMode.NEXT_STEP``. It is
      seeded where it is made, so a reset with a seed is refused. It must wait for all its
      environments: ``batch_size`` is ``num_envs``.
    * PufferLib resets environments of Gymnasium in the step after their last too. Its infos are a
      list without numbers of environments, which no signal can read: the newest is
      ``env.unwrapped.infos``.
    * Native environments of PufferLib reset in the step that ends an episode,
      ``AutoresetMode.SAME_STEP``, and show no last observation. ``final_obs="held"`` says that the
      observation before it stands for it; the reward and the action are those of the last step.

    Args:
        env: The environments.
        final_obs: What stands for last observations that are not shown.

    Raises:
        InputTypeError: If it is no vector environment.
        InputError: If its environments do not step together, or some of their samples are not seen.

    Example:
        >>> import gymnasium as gym
        >>> envs = gym.make_vec("CartPole-v1", 3, vectorization_mode="vector_entry_point")
        >>> as_vector_env(envs) is envs
        True
    """
    check_choice("final_obs", final_obs, (None, "held"))
    if is_pool(env):
        return _PoolVectorEnv(env)
    if _is_puffer(env):
        return PufferVectorEnv(env, final_obs)
    if isinstance(env, VectorEnv):
        return env
    way_out = "make it with gym.make_vec, envpool.make_gymnasium or pufferlib.vector.make"
    if isinstance(env, gym.Env):
        way_out = "StlMonitor and StlReward are for one environment"
    raise InputTypeError(f"expected a vector environment of Gymnasium, got {env!r}; {way_out}")


def is_pool(env: Any) -> bool:  # noqa: ANN401 - whatever is given
    """Whether it has the form of EnvPool's environments, many in one ``gym.Env``."""
    base = env.unwrapped if isinstance(env, gym.Env) else None
    return all(hasattr(base, name) for name in ("all_env_ids", "is_async", "recv", "send"))


def _is_puffer(env: Any) -> bool:  # noqa: ANN401 - whatever is given
    """Whether it has the form of PufferLib's vector environments."""
    names = ("driver_env", "agent_ids", "num_agents", "emulated", "async_reset", "recv", "send")
    return not isinstance(env, VectorEnv) and all(hasattr(env, name) for name in names)


class _AdaptedVectorEnv(StaysOpen, VectorEnv[Any, Any, Any]):
    """What the adapters share: spaces of one and of all, and the name that errors say."""

    def __init__(self, env: Any, num: int, mode: AutoresetMode) -> None:  # noqa: ANN401
        self.adapted = env
        self.num_envs = num
        self.metadata = {"autoreset_mode": mode}
        self.observation_space = batch_space(self.single_observation_space, num)
        self.action_space = batch_space(self.single_action_space, num)

    def __str__(self) -> str:
        return f"<{type(self.adapted).__name__} of {self.num_envs} environments>"

    __repr__ = __str__

    def close_extras(self, **kwargs: Any) -> None:  # noqa: ANN401
        self.adapted.close(**kwargs)


class _PoolVectorEnv(_AdaptedVectorEnv):
    """Environments of EnvPool."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        pool: Any = env.unwrapped
        if pool.is_async:
            raise InputError(
                "expected environments that step together, got an EnvPool with num_envs="
                f"{pool.config['num_envs']} and batch_size={pool.config['batch_size']}, which "
                "gives those that are ready; leave batch_size= out"
            )
        if pool.config.get("max_num_players", 1) > 1:
            raise InputError(
                "expected an EnvPool with one player in each environment, got max_num_players="
                f"{pool.config['max_num_players']}"
            )
        self.single_observation_space = env.observation_space
        self.single_action_space = env.action_space
        super().__init__(env, len(pool.all_env_ids), AutoresetMode.NEXT_STEP)

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        if seed is not None:
            raise InputError(
                f"expected reset() of EnvPool without a seed, got seed={seed!r}; it is seeded "
                "where it is made: envpool.make_gymnasium(..., seed=1)"
            )
        _refuse_options("EnvPool", options)
        shown: tuple[Any, dict[str, Any]] = self.adapted.reset()
        return shown

    def step(self, actions: Any) -> _Result:  # noqa: ANN401
        result: _Result = self.adapted.step(actions)
        return result


class PufferVectorEnv(_AdaptedVectorEnv):
    """Environments of PufferLib, which write into arrays that they share with the learner.

    Attributes:
        adapted: PufferLib's vector environment.
        infos: The newest list of infos.
        rewards: The shared array of rewards, from the first reset on.
        terminated: The shared array of terminations.
        truncated: The shared array of truncations.
        one: The environment of Gymnasium that is first of all; None if they are native.
    """

    rewards: Any
    terminated: Any
    truncated: Any

    def __init__(self, env: Any, final_obs: Literal["held"] | None = None) -> None:  # noqa: ANN401
        native, driver, num = env.emulated is False, env.driver_env, int(env.num_agents)
        batch = getattr(env, "agents_per_batch", num)
        if batch != num:
            raise InputError(
                f"expected environments that step together, got {num} of PufferLib in batches of "
                f"{batch}; leave batch_size= out"
            )
        if not native and driver.num_agents > 1:
            raise InputError(
                f"expected environments of one agent, got {driver} with {driver.num_agents}, whose "
                "episodes end together; put ParallelStlMonitor around the environment in it"
            )
        if native and final_obs is None:
            raise InputError(
                f"expected environments that show the last observation of an episode, got {driver} "
                "of PufferLib, which shows the first of the next in its place; "
                "as_vector_env(env, final_obs='held') takes the one before it for the last"
            )
        self._holds = native
        self.infos: list[Any] = []
        self.one: Any = None if native else driver.env
        self.dt = read_period(self.one) if self.one is not None else None
        self.single_observation_space = env.single_observation_space
        self.single_action_space = env.single_action_space
        mode = AutoresetMode.SAME_STEP if native else AutoresetMode.NEXT_STEP
        super().__init__(env, num, mode)

    def reset(
        self,
        *,
        seed: int | list[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Resets all; without a seed as PufferLib does, whose own default may be one."""
        _refuse_options("PufferLib", options)
        self.adapted.async_reset(*(() if seed is None else (seed,)))
        return self._receive()[0], {}

    def step(self, actions: Any) -> _Result:  # noqa: ANN401
        """Steps all; the infos have last observations alone, where one is held."""
        self.adapted.send(np.asarray(actions))
        before = self._held if self._holds else None
        obs, rewards, terminated, truncated = self._receive()
        if before is None:
            return obs, rewards, terminated, truncated, {}
        ended = np.logical_or(terminated, truncated)
        infos = {"final_obs": before, "_final_obs": ended} if ended.any() else {}
        return obs, rewards, terminated, truncated, infos

    def _receive(self) -> tuple[Any, Any, Any, Any]:
        """The shared arrays, after the environments have written them."""
        obs, rewards, terminated, truncated, infos, _, masks = self.adapted.recv()
        if not np.all(masks):
            raise StateError(
                f"expected all agents of {self} at every step, got none for agent "
                f"{np.flatnonzero(np.logical_not(masks))[0]}"
            )
        self.rewards, self.terminated, self.truncated = rewards, terminated, truncated
        self.infos = infos
        if self._holds:
            self._held = np.array(obs)  # the next step writes over it
        return obs, rewards, terminated, truncated


def _refuse_options(of: str, options: dict[str, Any] | None) -> None:
    if options is not None:
        raise InputError(f"expected reset() of {of} without options, got {options!r}")
