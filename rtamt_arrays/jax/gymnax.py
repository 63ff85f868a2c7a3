"""Requirements for environments of gymnax, from its version 1.0 on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Unpack

import jax
import jax.numpy as jnp
from gymnax.environments import spaces
from gymnax.environments.environment import Environment

from rtamt import InputError
from rtamt_arrays.jax.wrapping import JaxRequirements, as_period, of_one, one
from rtamt_arrays.requirements import RequirementOptions, RequirementState
from rtamt_arrays.selectors import ArrayStep
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.signals.signals import SignalLike

__all__ = ["StlEnvState", "StlEnvironment"]


class StlEnvState(NamedTuple):
    """The state of an environment and of its requirements.

    Attributes:
        env: The state of the environment.
        stl: What is known of the episode.
        truncated: Whether a violation has truncated the episode.
    """

    env: Any
    stl: RequirementState
    truncated: jax.Array


class StlEnvironment(Environment):  # type: ignore[misc]  # gymnax is untyped
    """Judges the episodes of an environment of gymnax, on the device.

    It is an environment of gymnax: vectorize ``reset`` and ``step`` with ``jax.vmap``. The info of
    a step has the keys of `rtamt_arrays.jax.brax.StlWrapper`; of a step that ends an episode, they
    are those of its last state, which is in ``info["final_observation"]``.

    Args:
        env: The environment.
        specs: One specification, or several by name, as for `rtamt_gym.StlMonitor`.
        signals: What the variables read: see `rtamt_arrays.selectors`. Infos have no value at a
            reset: give one, ``("info['discount']", 1.0)``.
        dtype: The kind of floats of the monitors; None: that of JAX.
        **options: See `rtamt_arrays.requirements.RequirementOptions`; without ``period`` a step
            takes what the default parameters call ``tau`` or ``dt``.

    Raises:
        SpecificationError: As `rtamt.EpisodeMonitor` does.
        InputError: If an argument is wrong; while JAX traces, if a selector does not fit what the
            environment gives.

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
        params = env.default_params
        period = as_period(getattr(params, "tau", getattr(params, "dt", None)))
        self._judge = JaxRequirements(specs, signals, period, dtype, options)

    @property
    def default_params(self) -> Any:  # noqa: ANN401 - gymnax is untyped
        """Those of the environment."""
        return self._env.default_params

    def reset_env(self, key: jax.Array, params: Any) -> tuple[Any, StlEnvState]:  # noqa: ANN401
        """Resets the environment; its observation is sample 0."""
        obs, inner = self._env.reset_env(key, params)
        step = ArrayStep(one(obs), None, None, {}, one(inner))
        known, judged = self._judge.begin(
            self._judge.requirements.init(1), step, jnp.ones(1, dtype=bool)
        )
        shown = of_one(self._judge.shown(one(obs), judged.features))
        return shown, StlEnvState(inner, known, jnp.zeros((), dtype=bool))

    def step_env(self, key: jax.Array, state: StlEnvState, action: Any, params: Any) -> Any:  # noqa: ANN401
        """Steps the environment and judges the step."""
        obs, inner, reward, terminated, info = self._env.step_env(key, state.env, action, params)
        truncated = self._env.is_truncated(inner, params)
        step = one(ArrayStep(obs, action, reward, info, inner))
        known, judged = self._judge.step(state.stl, step, *one((terminated, truncated)))
        result = of_one(judged)
        # What the environment itself has truncated, `step` asks of it again.
        following = StlEnvState(inner, known, result.truncated)
        shown = of_one(self._judge.shown(one(obs), judged.features))
        return shown, following, result.reward, result.terminated, {**info, **result.info}

    def is_truncated(self, state: StlEnvState, params: Any) -> jax.Array:  # noqa: ANN401
        """Whether a limit of time or a violation has truncated the episode."""
        truncated: jax.Array = state.truncated | self._env.is_truncated(state.env, params)
        return truncated

    def is_terminated(self, state: StlEnvState, params: Any) -> jax.Array:  # noqa: ANN401
        """Whether the environment itself terminates there."""
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
        """That of the environment."""
        return self._env.action_space(params)

    def observation_space(self, params: Any) -> Any:  # noqa: ANN401 - gymnax is untyped
        """That of the environment, with what ``observe="state"`` appends."""
        space = self._env.observation_space(params)
        if not self._judge.requirements.observes:
            return space
        if not isinstance(space, spaces.Box) or len(space.shape) != 1:
            raise InputError(
                "expected observations as a Box of one dimension for observe='state', got "
                f"{type(space).__name__} of shape {space.shape}"
            )
        box = self._judge.requirements.features.box
        low, high = (
            jnp.concatenate([jnp.broadcast_to(own, space.shape), ours])
            for own, ours in ((space.low, box.low), (space.high, box.high))
        )
        return spaces.Box(low, high, low.shape, dtype=space.dtype)
