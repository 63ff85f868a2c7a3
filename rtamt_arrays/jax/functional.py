"""Requirements for functional environments of Gymnasium, such as `gymnasium.envs.phys2d`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple, Unpack

import gymnasium as gym
import jax
import jax.numpy as jnp
from gymnasium.experimental.functional import FuncEnv

from rtamt_arrays.jax.wrapping import JaxRequirements, as_batch, only_entry, period_of
from rtamt_arrays.judging import RequirementOptions, RequirementState
from rtamt_arrays.selectors import ArrayStep
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.observing import appended_space

__all__ = ["StlFuncEnv", "StlFuncState"]


class StlFuncState(NamedTuple):
    """The state of a functional environment and of its requirements.

    Attributes:
        env: The state of the environment.
        stl: The state of the requirements.
        features: The features of ``observe="state"``.
        reward: The shaped reward of the last step.
        terminated: Whether the environment or a violation has ended the episode.
        info: The keys of the info.
    """

    env: Any
    stl: RequirementState
    features: jax.Array
    reward: jax.Array
    terminated: jax.Array
    info: dict[str, Any]

    @property
    def at(self) -> _States:
        """The states of a batch by index, for ``state.at[which].set(others)`` of Gymnasium."""
        return _States(self)


class _States:
    """A batch of states, and an index into it."""

    def __init__(self, states: StlFuncState, which: Any = None) -> None:  # noqa: ANN401 - an index
        self._states, self._which = states, which

    def __getitem__(self, which: Any) -> _States:  # noqa: ANN401 - an index
        return _States(self._states, which)

    def set(self, others: StlFuncState) -> StlFuncState:
        """Return the batch with other states at the index."""
        replaced: StlFuncState = jax.tree.map(
            lambda x, y: x.at[self._which].set(y), self._states, others
        )
        return replaced


class StlFuncEnv(FuncEnv[Any, Any, Any, Any, Any, Any, Any]):
    """Monitor the episodes of a functional environment, on the device.

    ``initial`` takes sample 0, and ``transition`` each further sample; ``reward``, ``terminal``,
    ``state_info`` and ``transition_info`` return the results. The infos have the keys of
    `rtamt_arrays.jax.brax.StlWrapper`. The environment has no time limit, so
    ``on_violation="truncate"`` is an error. It works in `FunctionalJaxEnv`,
    `FunctionalJaxVectorEnv` and loops under ``jit``, ``vmap`` and ``scan``.

    Args:
        env: The functional environment.
        specs: One specification, or several by name, as for `rtamt_gym.StlMonitor`.
        signals: The selector of each variable; see `rtamt_arrays.selectors`.
        dtype: The dtype of the monitors; by default JAX's.
        **options: See `rtamt_arrays.judging.RequirementOptions`. The default of ``period`` is
            ``tau`` or ``dt`` of the default parameters.

    Raises:
        SpecificationError: As `rtamt.EpisodeMonitor` does.
        InputError: If an argument is wrong; while JAX traces, if a selector does not fit the
            environment.

    Example:
        >>> import jax
        >>> from gymnasium.envs.phys2d.cartpole import CartPoleFunctional
        >>> env = StlFuncEnv(CartPoleFunctional(), "always(abs(x) < 1)", {"x": "obs[0]"})
        >>> state = env.initial(jax.random.key(0))
        >>> after = env.transition(state, 1, jax.random.key(1))
        >>> bool(env.terminal(after, jax.random.key(2)))
        False
    """

    def __init__(
        self,
        env: FuncEnv[Any, Any, Any, Any, Any, Any, Any],
        specs: SpecsLike,
        signals: Mapping[str, SignalLike],
        *,
        dtype: object = None,
        **options: Unpack[RequirementOptions],
    ) -> None:
        self._env = env
        super().__init__()
        period = period_of(self.default_params)
        self._requirements = JaxRequirements(specs, signals, period, dtype, options)
        judge = self._requirements.judge
        self.action_space = env.action_space
        self.observation_space: gym.Space[Any] = env.observation_space
        if judge.observes:
            self.observation_space = appended_space(
                env.observation_space, judge.features.box, "state"
            )

    def initial(self, rng: Any, params: Any = None) -> StlFuncState:  # noqa: ANN401 - as Gymnasium has it
        """Return the initial state; its observation is sample 0."""
        more = self._params(params)
        inner = self._env.initial(rng, *more)
        obs = self._env.observation(inner, rng, *more)
        step = ArrayStep(
            as_batch(obs), None, None, self._env.state_info(inner, *more), as_batch(inner)
        )
        return _state(inner, *self._requirements.first(step))

    def transition(
        self,
        state: StlFuncState,
        action: Any,  # noqa: ANN401 - as Gymnasium has it
        rng: Any,  # noqa: ANN401
        params: Any = None,  # noqa: ANN401
    ) -> StlFuncState:
        """Return the next state, with the results of the step."""
        more = self._params(params)
        inner = self._env.transition(state.env, action, rng, *more)
        obs = self._env.observation(inner, rng, *more)
        reward = self._env.reward(state.env, action, inner, rng, *more)
        terminated = jnp.asarray(self._env.terminal(inner, rng, *more), dtype=bool)
        info = self._env.transition_info(state.env, action, inner, *more)
        step = as_batch(ArrayStep(obs, action, reward, info, inner))
        never = jnp.zeros(1, dtype=bool)
        return _state(inner, *self._requirements.step(state.stl, step, terminated[None], never))

    def observation(self, state: StlFuncState, rng: Any, params: Any = None) -> Any:  # noqa: ANN401
        """Return the environment's observation, with ``observe="state"`` appended."""
        obs = self._env.observation(state.env, rng, *self._params(params))
        return only_entry(self._requirements.observation(as_batch(obs), state.features[None]))

    def reward(
        self,
        state: StlFuncState,  # noqa: ARG002 - as Gymnasium has it
        action: Any,  # noqa: ANN401, ARG002
        next_state: StlFuncState,
        rng: Any,  # noqa: ANN401, ARG002
        params: Any = None,  # noqa: ANN401, ARG002
    ) -> jax.Array:
        """Return the shaped reward."""
        return next_state.reward

    def terminal(self, state: StlFuncState, rng: Any, params: Any = None) -> jax.Array:  # noqa: ANN401, ARG002
        """Return whether the environment or a violation has ended the episode."""
        return state.terminated

    def state_info(self, state: StlFuncState, params: Any = None) -> dict[str, Any]:  # noqa: ANN401
        """Return the environment's info, with the keys of the requirements."""
        return {**self._env.state_info(state.env, *self._params(params)), **state.info}

    def transition_info(
        self,
        state: StlFuncState,
        action: Any,  # noqa: ANN401 - as Gymnasium has it
        next_state: StlFuncState,
        params: Any = None,  # noqa: ANN401
    ) -> dict[str, Any]:
        """Return the environment's info, with the keys of the requirements."""
        own = self._env.transition_info(state.env, action, next_state.env, *self._params(params))
        return {**own, **next_state.info}

    def get_default_params(self, **kwargs: Any) -> Any:  # noqa: ANN401 - as Gymnasium has it
        """Return the environment's parameters."""
        return self._env.get_default_params(**kwargs)

    @staticmethod
    def _params(params: Any) -> tuple[Any, ...]:  # noqa: ANN401 - as Gymnasium has it
        return () if params is None else (params,)


def _state(inner: Any, stl: RequirementState, judged: Any) -> StlFuncState:  # noqa: ANN401 - states
    result = only_entry(judged)
    return StlFuncState(inner, stl, result.features, result.reward, result.terminated, result.info)
