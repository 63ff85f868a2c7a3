"""The base of the wrappers of simulators in JAX."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from rtamt import InputError
from rtamt_arrays.jax import episode, online
from rtamt_arrays.jax.operations import JaxOperations
from rtamt_arrays.judging import RequirementOptions, RequirementState, StepJudge
from rtamt_arrays.monitor_set import ArrayLibrary
from rtamt_arrays.operations import Tensor
from rtamt_arrays.selectors import ArraySignals, ArrayStep
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.observing import KEY


class JaxRequirements:
    """Requirements and the signals that they read, on arrays of JAX.

    Args:
        specs: One specification, or several by name.
        signals: The selector of each variable.
        period: The period of the environment, if known; the default of the option.
        dtype: The dtype of the monitors.
        options: See `RequirementOptions`.
    """

    def __init__(
        self,
        specs: SpecsLike,
        signals: Mapping[str, SignalLike],
        period: Any,  # noqa: ANN401 - a `rtamt.typing.Period`, if there is one
        dtype: object,
        options: RequirementOptions,
    ) -> None:
        if options.get("period") is None:
            options = {**options, "period": period}
        library = ArrayLibrary(
            partial(episode, dtype=dtype), partial(online, dtype=dtype), JaxOperations()
        )
        self.judge = StepJudge(specs, library, options)
        self._signals = ArraySignals(signals, self.judge.variables, jax.vmap)

    def begin(self, state: RequirementState, step: ArrayStep, mask: Tensor) -> Any:  # noqa: ANN401 - a state and a judged step
        """Start episodes, as `StepJudge.begin` does."""
        return self.judge.begin(state, self._signals.reset(step), mask)

    def first(self, step: ArrayStep) -> Any:  # noqa: ANN401 - a state and a judged step
        """Start the episode of a batch of one environment."""
        return self.begin(self.judge.init(1), step, jnp.ones(1, dtype=bool))

    def step(
        self, state: RequirementState, step: ArrayStep, terminated: Tensor, truncated: Tensor
    ) -> Any:  # noqa: ANN401 - a state and a judged step
        """Judge a step, as `StepJudge.step` does; the reward keeps its dtype."""
        reward = jnp.asarray(step.reward, state.potential.dtype)
        sample = self._signals.step(step)
        following, judged = self.judge.step(state, sample, reward, terminated, truncated)
        own = jnp.asarray(step.reward).dtype
        dtype = own if jnp.issubdtype(own, jnp.floating) else reward.dtype
        return following, judged._replace(reward=judged.reward.astype(dtype))

    def observation(self, obs: Any, features: Tensor) -> Any:  # noqa: ANN401 - an array or a dictionary
        """Return the observation, with the features if the option ``observe`` is set."""
        return with_features(obs, features) if self.judge.observes else obs


def with_features(obs: Any, features: Tensor) -> Any:  # noqa: ANN401 - an array or a dictionary
    """Append features to the observations of a batch: an array or a dictionary of arrays."""
    if isinstance(obs, Mapping):
        if KEY in obs:
            raise InputError(
                f"The observation has the key {KEY!r}, which observe='state' needs. Rename the key."
            )
        return {**obs, KEY: features}
    if obs.ndim != features.ndim:
        raise InputError(
            f"observe='state' cannot extend an observation of shape {obs.shape[1:]}. It needs one "
            "dimension or a dictionary."
        )
    return jnp.concatenate([obs, features.astype(obs.dtype)], axis=-1)


def as_batch(tree: Any) -> Any:  # noqa: ANN401 - any arrays
    """Return the arrays of one environment as a batch of one."""
    return jax.tree.map(lambda x: jnp.asarray(x)[None], tree)


def only_entry(tree: Any) -> Any:  # noqa: ANN401 - any arrays
    """Return the arrays of the only environment of a batch."""
    return jax.tree.map(lambda x: x[0], tree)


def period_of(params: Any) -> float | None:  # noqa: ANN401 - of the simulator
    """Return the time of a step: the parameter ``tau`` or ``dt``; None without one."""
    return as_period(getattr(params, "tau", getattr(params, "dt", None)))


def as_period(seconds: Any, steps: int = 1) -> float | None:  # noqa: ANN401 - a number of any kind
    """Return the seconds of steps; a float32 counts as its shortest decimal number."""
    if seconds is None:
        return None
    shortest = float(str(np.asarray(seconds)[()])) if hasattr(seconds, "dtype") else float(seconds)
    return round(shortest * steps, 12)
