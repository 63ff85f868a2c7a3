"""What the wrappers of simulators of JAX share."""

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
from rtamt_arrays.monitor_set import ArrayMonitors
from rtamt_arrays.operations import Tensor
from rtamt_arrays.requirements import RequirementOptions, RequirementState, StepJudge
from rtamt_arrays.selectors import ArraySignals, ArrayStep
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.observing import KEY


class JaxRequirements:
    """Requirements and the signals that they read, on arrays of JAX.

    Args:
        specs: One specification, or several by name.
        signals: What the variables read.
        period: What the environment says of it; None where it says nothing.
        dtype: The kind of floats of the monitors.
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
        said = options if options.get("period") is not None else {**options, "period": period}
        made = ArrayMonitors(partial(episode, dtype=dtype), partial(online, dtype=dtype))
        self.requirements = StepJudge(specs, made, JaxOperations(), said)
        self._signals = ArraySignals(signals, self.requirements.variables, jax.vmap)

    def begin(self, state: RequirementState, step: ArrayStep, mask: Tensor) -> Any:  # noqa: ANN401 - a state and what is judged
        """See `StepJudge.begin`."""
        return self.requirements.begin(state, self._signals.reset(step), mask)

    def step(
        self, state: RequirementState, step: ArrayStep, terminated: Tensor, truncated: Tensor
    ) -> Any:  # noqa: ANN401 - a state and what is judged
        """See `StepJudge.step`; the reward is paid in the kind of the environment's own."""
        reward = jnp.asarray(step.reward, state.potential.dtype)
        sample = self._signals.step(step)
        following, judged = self.requirements.step(state, sample, reward, terminated, truncated)
        own = jnp.asarray(step.reward).dtype
        return following, judged._replace(
            reward=judged.reward.astype(own if jnp.issubdtype(own, jnp.floating) else reward.dtype)
        )

    def shown(self, obs: Any, features: Tensor) -> Any:  # noqa: ANN401 - an array or a dictionary
        """The observation as the wrapper gives it."""
        return with_features(obs, features) if self.requirements.observes else obs


def with_features(obs: Any, features: Tensor) -> Any:  # noqa: ANN401 - an array or a dictionary
    """Appends features to observations: an array of many, or a dictionary of such."""
    if isinstance(obs, Mapping):
        if KEY in obs:
            raise InputError(
                f"expected observations without the key {KEY!r}, which the monitor's state takes"
            )
        return {**obs, KEY: features}
    if obs.ndim != features.ndim:
        raise InputError(
            "expected an observation of one dimension or a dictionary for observe='state', got "
            f"one of shape {obs.shape[1:]}"
        )
    return jnp.concatenate([obs, features.astype(obs.dtype)], axis=-1)


def one(tree: Any) -> Any:  # noqa: ANN401 - any arrays
    """The arrays of one environment, as of a batch of one."""
    return jax.tree.map(lambda x: jnp.asarray(x)[None], tree)


def of_one(tree: Any) -> Any:  # noqa: ANN401 - any arrays
    """The arrays of the only environment of a batch."""
    return jax.tree.map(lambda x: x[0], tree)


def as_period(seconds: Any, steps: int = 1) -> float | None:  # noqa: ANN401 - a number of any kind
    """Seconds of some steps; a float32 counts as the shortest decimal number that it is."""
    if seconds is None:
        return None
    shortest = float(str(np.asarray(seconds)[()])) if hasattr(seconds, "dtype") else float(seconds)
    return round(shortest * steps, 12)
