"""The forms of vector environments: when they reset, their last results, and adapters.

Environments of EnvPool and of PufferLib are adapted to Gymnasium's `VectorEnv`. They are recognized
by their attributes, and neither package is imported. The adapters pass on the arrays of the
environments, without a copy.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium import logger, spaces
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from rtamt import InputError, InputTypeError, StateError
from rtamt_gym.checks.arguments import check_choice
from rtamt_gym.checks.names import listing
from rtamt_gym.judging.infos import key_mask
from rtamt_gym.signals.columns import Entries
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.taps import StaysOpen

_Result = tuple[Any, Any, Any, Any, dict[str, Any]]


def as_vector_env(
    env: Any, *, final_obs: Literal["held"] | None = None
) -> VectorEnv[Any, Any, Any]:
    """Return the environments as a vector environment of Gymnasium; `VectorEnv` is returned as is.

    :class:`VectorStlMonitor` and :class:`VectorStlReward` call it, so they take the environments of
    ``envpool.make_gymnasium`` and ``pufferlib.vector.make``. Observations, rewards and flags are
    the arrays of the environments, not copies.

    * EnvPool resets an environment in the step after its last, ``AutoresetMode.NEXT_STEP``. It is
      seeded where it is made, so a reset with a seed is an error, and ``batch_size`` must be
      ``num_envs``.
    * PufferLib resets environments of Gymnasium in the step after their last too. Its infos are a
      list without numbers of environments, which no signal can read: the newest is
      ``env.unwrapped.infos``.
    * Native environments of PufferLib reset in the step that ends an episode,
      ``AutoresetMode.SAME_STEP``, and return no last observation. ``final_obs="held"`` replaces it
      by the observation before it; reward and action belong to the last step.

    Args:
        env: The environments.
        final_obs: The substitute for last observations of native environments.

    Raises:
        InputTypeError: If it is not a vector environment.
        InputError: If its environments do not step together, or lack last observations.

    Example:
        >>> import gymnasium as gym
        >>> envs = gym.make_vec("CartPole-v1", 3, vectorization_mode="vector_entry_point")
        >>> as_vector_env(envs) is envs
        True
    """
    check_choice("final_obs", final_obs, (None, "held"))
    if is_pool(env):
        return _PoolVectorEnv(env)
    puffer = ("driver_env", "agent_ids", "num_agents", "emulated", "async_reset", "recv", "send")
    if isinstance(env, VectorEnv):
        return env
    if all(hasattr(env, name) for name in puffer):
        return PufferVectorEnv(env, final_obs)
    way_out = "make it with gym.make_vec, envpool.make_gymnasium or pufferlib.vector.make"
    if isinstance(env, gym.Env):
        way_out = "use StlMonitor or StlReward for one environment"
    raise InputTypeError(f"expected a vector environment of Gymnasium, got {env!r}; {way_out}")


def is_pool(env: Any) -> bool:
    """Return whether it is EnvPool's ``gym.Env``, which holds many environments."""
    base = env.unwrapped if isinstance(env, gym.Env) else None
    return all(hasattr(base, name) for name in ("all_env_ids", "is_async", "recv", "send"))


class _AdaptedVectorEnv(StaysOpen, VectorEnv[Any, Any, Any]):
    """The base of the adapters: spaces of one and of all, and a name for messages."""

    def __init__(self, env: Any, num: int, mode: AutoresetMode) -> None:
        self.adapted = env
        self.num_envs = num
        self.metadata = {"autoreset_mode": mode}
        self.observation_space = batch_space(self.single_observation_space, num)
        self.action_space = batch_space(self.single_action_space, num)

    def __str__(self) -> str:
        return f"<{type(self.adapted).__name__} of {self.num_envs} environments>"

    __repr__ = __str__

    def close_extras(self, **kwargs: Any) -> None:
        self.adapted.close(**kwargs)


class _PoolVectorEnv(_AdaptedVectorEnv):
    """Environments of EnvPool."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        pool: Any = env.unwrapped
        if pool.is_async:
            raise InputError(
                "expected environments that step together, got an EnvPool with "
                f"num_envs={pool.config['num_envs']} and batch_size={pool.config['batch_size']}, "
                "which steps only the environments that are ready; omit batch_size="
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
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        if seed is not None:
            raise InputError(
                f"expected reset() of EnvPool without a seed, got seed={seed!r}; it is seeded "
                "where it is made: envpool.make_gymnasium(..., seed=1)"
            )
        _refuse_options("EnvPool", options)
        result: tuple[Any, dict[str, Any]] = self.adapted.reset()
        return result

    def step(self, actions: Any) -> _Result:
        result: _Result = self.adapted.step(actions)
        return result


class PufferVectorEnv(_AdaptedVectorEnv):
    """Environments of PufferLib, which write into arrays that they share with the learner.

    Attributes:
        adapted: PufferLib's vector environment.
        infos: The newest list of infos.
        one: The first environment of Gymnasium; None if they are native.
    """

    rewards: Any
    terminated: Any
    truncated: Any

    def __init__(self, env: Any, final_obs: Literal["held"] | None = None) -> None:
        native, driver, num = env.emulated is False, env.driver_env, int(env.num_agents)
        batch = getattr(env, "agents_per_batch", num)
        if batch != num:
            raise InputError(
                f"expected environments that step together, got {num} of PufferLib in batches of "
                f"{batch}; leave batch_size= out"
            )
        if not native and driver.num_agents > 1:
            raise InputError(
                f"expected environments of one agent, got {driver} with {driver.num_agents} "
                "agents, and their episodes end together; put ParallelStlMonitor around the "
                "environment in it"
            )
        if native and final_obs is None:
            raise InputError(
                f"expected environments that show the last observation of an episode, got {driver} "
                "of PufferLib, which replaces it by the first observation of the next episode; "
                "as_vector_env(env, final_obs='held') uses the observation before it instead"
            )
        self._holds = native
        self.infos: list[Any] = []
        self.one: Any = None if native else driver.env
        self.dt = read_period(self.one) if self.one is not None else None
        self.single_observation_space = env.single_observation_space
        self.single_action_space = env.single_action_space
        super().__init__(env, num, AutoresetMode.SAME_STEP if native else AutoresetMode.NEXT_STEP)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset all; without a seed, PufferLib's own default applies."""
        _refuse_options("PufferLib", options)
        self.adapted.async_reset(*(() if seed is None else (seed,)))
        return self._receive()[0], {}

    def step(self, actions: Any) -> _Result:
        """Step all; the infos hold last observations only, for native environments."""
        self.adapted.send(np.asarray(actions))
        before = self._held if self._holds else None
        obs, rewards, terminated, truncated = self._receive()
        ended = np.logical_or(terminated, truncated)
        has_ends = before is not None and ended.any()
        infos = {"final_obs": before, "_final_obs": ended} if has_ends else {}
        return obs, rewards, terminated, truncated, infos

    def _receive(self) -> tuple[Any, Any, Any, Any]:
        """Return the shared arrays, after the environments have written them."""
        obs, rewards, terminated, truncated, infos, _, masks = self.adapted.recv()
        if not np.all(masks):
            raise StateError(
                f"expected all agents of {self} at every step, got none for agent "
                f"{np.flatnonzero(np.logical_not(masks))[0]}"
            )
        self.rewards, self.terminated, self.truncated = rewards, terminated, truncated
        self.infos = infos
        if self._holds:
            self._held = np.array(obs)  # the next step overwrites it
        return obs, rewards, terminated, truncated


def _refuse_options(library: str, options: dict[str, Any] | None) -> None:
    if options is not None:
        raise InputError(f"expected reset() of {library} without options, got {options!r}")


class SharedBuffers:
    """Presents monitored environments of PufferLib as a vector environment of PufferLib.

    PufferLib's environments write observations, rewards and flags into arrays that the learner
    reads. The monitor reads these arrays and writes its changes into them: the rewards of
    :class:`VectorStlReward` replace the environments' own. Nothing is copied. The learner's calls,
    ``async_reset``, ``recv`` and ``send``, and ``reset`` and ``step``, return the types of
    PufferLib. Every other attribute comes from PufferLib's vector environment.

    At steps that end episodes, the list of infos has one more dictionary of lists, with a number
    for each ended episode: ``stl/satisfied`` (0 or 1) and ``stl/robustness`` of all requirements,
    and ``stl/NAME/satisfied`` and ``stl/NAME/robustness`` of each. PufferLib's learner logs their
    means. ``send`` waits until the environments have stepped.

    Args:
        envs: A :class:`VectorStlMonitor` or :class:`VectorStlReward` around the environments of
            ``pufferlib.vector.make``; other wrappers may be around it.

    Raises:
        InputError: If the environments are not of PufferLib, or if the observations differ from
            the shared array, as with ``observe=``.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        shared = getattr(envs, "unwrapped", None)
        if not isinstance(shared, PufferVectorEnv):
            raise InputError(
                f"expected a VectorStlMonitor or VectorStlReward around environments of PufferLib, "
                f"got {envs!r}"
            )
        if envs.single_observation_space != shared.single_observation_space:
            raise InputError(
                "expected the observations of the shared array, of "
                f"{shared.single_observation_space}, got {envs.single_observation_space}; leave "
                "observe= out, or put StlReward around each environment"
            )
        self.envs = envs
        self._shared = shared
        self._newest: tuple[Any, ...] | None = None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "_shared":  # a protocol asks for it
            raise AttributeError(name)
        return getattr(self._shared.adapted, name)

    def async_reset(self, seed: int | list[int] | None = None) -> None:
        """Reset all environments; `recv` returns the observations."""
        any_seed: Any = seed
        obs, _ = self.envs.reset(seed=any_seed)
        self._keep(obs, self._shared.infos)

    def send(self, actions: Any) -> None:
        """Step all environments; `recv` returns the result."""
        obs, rewards, terminated, truncated, infos = self.envs.step(actions)
        shared = self._shared
        for array, new in (
            (shared.rewards, rewards),
            (shared.terminated, terminated),
            (shared.truncated, truncated),
        ):
            if new is not array:
                array[...] = new
        ended = np.logical_or(terminated, truncated)
        self._keep(obs, [*shared.infos, *_last_infos(infos, ended)])

    def recv(self) -> tuple[Any, ...]:
        """Return observations, rewards, terminals, truncations, infos, numbers of agents, masks.

        Raises:
            StateError: Before the first reset.
        """
        if self._newest is None:
            raise StateError("expected running episodes, got recv() before a reset")
        return self._newest

    def reset(self, seed: int | list[int] | None = None) -> tuple[Any, list[Any]]:
        """Reset all environments; return observations and infos."""
        self.async_reset(seed)
        obs, *_, infos, _, _ = self.recv()
        return obs, infos

    def step(self, actions: Any) -> tuple[Any, ...]:
        """Step all environments; return the first five results of `recv`."""
        self.send(actions)
        return self.recv()[:5]

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def _keep(self, obs: Any, infos: list[Any]) -> None:
        shared, num = self._shared, self._shared.num_envs
        flags = shared.terminated, shared.truncated
        self._newest = obs, shared.rewards, *flags, infos, np.arange(num), np.ones(num, np.bool_)


def _last_infos(infos: dict[str, Any], ended: Any) -> list[dict[str, list[float]]]:
    """Return the dictionary about the episodes that have ended, if there are any."""
    if not ended.any():
        return []
    last = infos.get("final_info", infos)
    columns = {"satisfied": last["stl_success"], "robustness": last["robustness"]}
    for name, outcome in last["stl_episode"].items():
        if not name.startswith("_"):
            columns |= {f"{name}/{key}": outcome[key] for key in ("satisfied", "robustness")}
    return [{f"stl/{key}": column[ended].astype(float).tolist() for key, column in columns.items()}]


def final_observations(
    space: spaces.Space[Any],
    obs: Any,
    infos: Mapping[str, Any],
    ended: Entries,
) -> Any:
    """Return the observations from before the resets in a step, in environments that ended.

    ``final_obs`` has them: an array with one object for each environment, as Gymnasium makes it, or
    a batch.

    Raises:
        InputError: If ``final_obs`` is missing.
    """
    if "final_obs" not in infos:
        raise InputError(
            "expected the observations at the ends of episodes in infos['final_obs'], as "
            f"AutoresetMode.SAME_STEP has them, got the keys {listing(infos)}"
        )
    final = infos["final_obs"]
    if isinstance(final, np.ndarray) and final.dtype == object:
        final = list(final[ended])
    return _replaced(space, obs, final, ended)


def _replaced(
    space: spaces.Space[Any],
    obs: Any,
    final: Any,
    ended: Entries,
) -> Any:
    """Replace the observations that ended, by a list with one for each or a batch like ``obs``."""

    def part(key: Any) -> Any:
        return [single[key] for single in final] if isinstance(final, list) else final[key]

    match space:
        case spaces.Dict():
            return {
                key: _replaced(inner, obs[key], part(key), ended)
                for key, inner in space.spaces.items()
            }
        case spaces.Tuple():
            return tuple(
                _replaced(inner, obs[i], part(i), ended) for i, inner in enumerate(space.spaces)
            )
        case spaces.Box() | spaces.Discrete() | spaces.MultiDiscrete() | spaces.MultiBinary():
            batch = np.array(obs)
            batch[ended] = final if isinstance(final, list) else np.asarray(final)[ended]
            return batch
        case _:  # no array, and no signal
            return obs


def final_infos(infos: dict[str, Any], ended: Entries) -> dict[str, Any]:
    """Return the infos from before the resets in a step: ``final_info`` where episodes ended."""
    before = {k: v for k, v in infos.items() if k not in _FINAL}
    return _merged(before, infos.get("final_info", {}), ended)


_FINAL = frozenset({"final_info", "_final_info", "final_obs", "_final_obs"})


def _merged(infos: Mapping[str, Any], final: Mapping[str, Any], ended: Entries) -> dict[str, Any]:
    merged: dict[str, Any] = {}
    keys = {**infos, **final}
    for key in keys:
        if key.startswith("_") and key[1:] in keys:
            continue
        old, new = infos.get(key), final.get(key)
        if isinstance(old, Mapping) or isinstance(new, Mapping):
            merged[key] = _merged(old or {}, new or {}, ended)
        elif old is None or new is None:
            merged[key] = new if old is None else old
        else:
            column = np.array(old, np.result_type(old, new))
            column[ended] = np.asarray(new)[ended]
            merged[key] = column
        num = len(ended)
        merged[f"_{key}"] = np.where(ended, key_mask(final, key, num), key_mask(infos, key, num))
    return merged


def autoreset_mode(env: VectorEnv[Any, Any, Any]) -> AutoresetMode:
    """Return when a vector environment resets an environment after the end of its episode."""
    mode, inner = env.metadata.get("autoreset_mode"), env.unwrapped
    if isinstance(inner, SyncVectorEnv | AsyncVectorEnv) and env.metadata is inner.metadata:
        # Before 1.4, vector environments of one class share their metadata.
        mode = mode and inner.autoreset_mode
    if isinstance(mode, AutoresetMode):
        return mode
    if mode is not None:
        raise InputError(
            f"expected an AutoresetMode as metadata['autoreset_mode'] of {env}, got {mode!r}"
        )
    # Gymnasium's own wrappers also assume this mode.
    logger.warn(
        f"{env} has no metadata['autoreset_mode']; VectorStlMonitor assumes AutoresetMode.NEXT_STEP"
    )
    return AutoresetMode.NEXT_STEP


def checked_mask(mask: Any, num: int) -> NDArray[np.bool_]:
    """Return ``options["reset_mask"]``; raise for a value that Gymnasium would not take."""
    if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_:
        raise InputTypeError(
            f"expected options['reset_mask'] as an array of booleans, got {mask!r}"
        )
    if mask.shape != (num,) or not mask.any():
        raise InputError(
            f"expected options['reset_mask'] of shape ({num},), true for one environment or more, "
            f"got {mask!r}"
        )
    return mask
