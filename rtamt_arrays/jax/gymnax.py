"""Requirements for environments of gymnax 1.0 and later."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Unpack

import jax
import jax.numpy as jnp
from gymnax.environments import spaces
from gymnax.environments.environment import Environment

from rtamt import InputError
from rtamt_arrays.jax.wrapping import JaxRequirements, as_batch, only_entry, period_of
from rtamt_arrays.judging import RequirementOptions, RequirementState
from rtamt_arrays.selectors import ArrayStep
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.signals.signals import SignalLike

__all__ = ["StlEnvState", "StlEnvironment"]


class StlEnvState(NamedTuple):
    """The state of an environment and of its requirements.

    Attributes:
        env: The state of the environment.
        stl: The state of the requirements.
        truncated: Whether a violation has truncated the episode.
    """

    env: Any
    stl: RequirementState
    truncated: jax.Array


class StlEnvironment(Environment):  # type: ignore[misc]  # gymnax is untyped
    """Monitor the episodes of an environment of gymnax, on the device.

    It is an environment of gymnax: vectorize ``reset`` and ``step`` with ``jax.vmap``. The info of
    a step has the keys of `rtamt_arrays.jax.brax.StlWrapper`. At the end of an episode they belong
    to its last state, which is in ``info["final_observation"]``.

    Args:
        env: The environment.
        specs: One specification, or several by name, as for `rtamt_gym.StlMonitor`.
        signals: The selector of each variable; see `rtamt_arrays.selectors`. Infos have no value at
            a reset; a pair sets one: ``("info['discount']", 1.0)``.
        dtype: The dtype of the monitors; by default JAX's.
        **options: See `rtamt_arrays.judging.RequirementOptions`. The default of ``period`` is
            ``tau`` or ``dt`` of the default parameters.

    Raises:
        SpecificationError: As `rtamt.EpisodeMonitor` does.
        InputError: If an argument is wrong; while JAX traces, if a selector does not fit the
            environment.

    Example:
        >>> import gymnax, jax
        >>> env, params = gymnax.make("CartPole-v1")
        >>> env = StlEnvironment(env, "always(abs(theta) < 0.1)", {"theta": "obs[2]"})
        >>> obs, state = env.reset(jax.random.key(0), params)
        >>> _, _, _, terminated, _, info = env.step(jax.random.key(1), state, 1, params)
        >>> bool(terminated), bool(info["stl_violated"])
        (False, False)
    """

    def __init__(
        self,
        env: Any,  # noqa: ANN401 - gymnax is untyped
        specs: SpecsLike,
        signals: Mapping[str, SignalLike],
        *,
        dtype: object = None,
        **options: Unpack[RequirementOptions],
    ) -> None:
        self._env = env
        period = period_of(env.default_params)
        self._requirements = JaxRequirements(specs, signals, period, dtype, options)

    @property
    def default_params(self) -> Any:  # noqa: ANN401 - gymnax is untyped
        """The parameters of the environment."""
        return self._env.default_params

    def reset_env(self, key: jax.Array, params: Any) -> tuple[Any, StlEnvState]:  # noqa: ANN401
        """Reset the environment; its observation is sample 0."""
        obs, inner = self._env.reset_env(key, params)
        step = ArrayStep(as_batch(obs), None, None, {}, as_batch(inner))
        stl, judged = self._requirements.first(step)
        extended = only_entry(self._requirements.observation(as_batch(obs), judged.features))
        return extended, StlEnvState(inner, stl, jnp.zeros((), dtype=bool))

    def step_env(self, key: jax.Array, state: StlEnvState, action: Any, params: Any) -> Any:  # noqa: ANN401
        """Step the environment and judge the step."""
        obs, inner, reward, terminated, info = self._env.step_env(key, state.env, action, params)
        truncated = self._env.is_truncated(inner, params)
        step = as_batch(ArrayStep(obs, action, reward, info, inner))
        stl, judged = self._requirements.step(state.stl, step, *as_batch((terminated, truncated)))
        result = only_entry(judged)
        following = StlEnvState(inner, stl, result.truncated)
        extended = only_entry(self._requirements.observation(as_batch(obs), judged.features))
        return extended, following, result.reward, result.terminated, {**info, **result.info}

    def is_truncated(self, state: StlEnvState, params: Any) -> jax.Array:  # noqa: ANN401
        """Return whether a time limit or a violation has truncated the episode."""
        truncated: jax.Array = state.truncated | self._env.is_truncated(state.env, params)
        return truncated

    def is_terminated(self, state: StlEnvState, params: Any) -> jax.Array:  # noqa: ANN401
        """Return whether the environment itself has terminated the episode."""
        terminated: jax.Array = self._env.is_terminated(state.env, params)
        return terminated

    @property
    def name(self) -> str:
        """The name of the environment."""
        return str(self._env.name)

    @property
    def num_actions(self) -> int:
        """The number of actions of the environment."""
        return int(self._env.num_actions)

    def action_space(self, params: Any = None) -> Any:  # noqa: ANN401 - gymnax is untyped
        """Return the action space of the environment."""
        return self._env.action_space(params)

    def observation_space(self, params: Any) -> Any:  # noqa: ANN401 - gymnax is untyped
        """Return the environment's space, with ``observe="state"`` appended."""
        space = self._env.observation_space(params)
        if not self._requirements.judge.observes:
            return space
        if not isinstance(space, spaces.Box) or len(space.shape) != 1:
            raise InputError(
                "observe='state' needs observations as a Box of one dimension, got "
                f"{type(space).__name__} of shape {space.shape}."
            )
        box = self._requirements.judge.features.box
        low, high = (
            jnp.concatenate([jnp.broadcast_to(own, space.shape), added])
            for own, added in ((space.low, box.low), (space.high, box.high))
        )
        return spaces.Box(low, high, low.shape, dtype=space.dtype)
