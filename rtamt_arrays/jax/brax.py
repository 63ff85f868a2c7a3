"""Requirements for environments of Brax and MuJoCo Playground.

`StlWrapper` belongs between the wrapper that counts the steps of an episode and the wrapper that
resets. `training_wrapper` puts it there, as the ``wrap_env_fn`` of Brax's learners.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Unpack

import jax
import jax.numpy as jnp
from brax.envs.base import Wrapper
from brax.envs.wrappers import training

from rtamt import InputError
from rtamt_arrays.jax.wrapping import JaxRequirements, as_batch, as_period, only_entry
from rtamt_arrays.judging import JudgedStep, RequirementOptions
from rtamt_arrays.selectors import ArrayStep
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.observing import KEY

__all__ = ["StlWrapper", "training_wrapper"]

_STATE = "stl_state"


class StlWrapper(Wrapper):  # type: ignore[misc]  # Brax is untyped
    """Monitor the episodes of a Brax or Playground environment, on the device.

    ``state.info`` has the keys of `rtamt_gym.StlReward`, as arrays of shape (environments,). Keys
    of episode ends are always there: ``stl_success``, ``is_success`` and ``stl_undecided`` are
    False, and ``stl_violated_at`` is -1, until they apply. ``state.metrics`` has ``robustness`` and
    ``is_success`` of last steps and 0 before, so Brax's sums over episodes are the means of both:
    ``eval/episode_is_success`` is the rate of satisfaction. Costs of every step are there too.

    The observation of a reset is sample 0. The last observation of an episode counts, although the
    resetting wrapper overwrites it. With ``action_repeat`` there is one sample per action. A
    violation sets ``state.done``, and with ``on_violation="truncate"`` also ``info["truncation"]``.
    The sums of `EpisodeWrapper` end with the episode and contain the shaped reward.

    A signal function gets an `ArrayStep` of one environment, whose ``state`` is Brax's ``State``:
    ``lambda step: step.state.pipeline_state.x.pos[0, 2]``.

    Args:
        env: An environment in `VmapWrapper` and `EpisodeWrapper`.
        specs: One specification, or several by name, as for `rtamt_gym.StlMonitor`.
        signals: The selector of each variable; see `rtamt_arrays.selectors`.
        dtype: The dtype of the monitors; by default JAX's.
        **options: See `rtamt_arrays.judging.RequirementOptions`. The default of ``period`` is
            the environment's ``dt`` times its ``action_repeat``.

    Raises:
        SpecificationError: As `rtamt.EpisodeMonitor` does.
        InputError: If an argument is wrong, or the environment has no `EpisodeWrapper`; while JAX
            traces, if a selector does not fit the environment.

    Example:
        >>> import jax
        >>> from brax import envs
        >>> from brax.envs.wrappers.training import AutoResetWrapper, EpisodeWrapper, VmapWrapper
        >>> env = EpisodeWrapper(VmapWrapper(envs.get_environment("fast")), 100, action_repeat=1)
        >>> env = StlWrapper(env, "always(x > -1)", {"x": "obs[0]"}, on_violation="report")
        >>> env = AutoResetWrapper(env)
        >>> state = env.reset(jax.random.split(jax.random.PRNGKey(0), 2))
        >>> for _ in range(4):
        ...     state = env.step(state, jax.numpy.zeros((2, 1)))
        >>> state.info["robustness"].tolist(), state.info["stl_violated_at"].tolist()
        ([1.0, 1.0], [-1, -1])
    """

    def __init__(
        self,
        env: Any,  # noqa: ANN401 - of Brax or of Playground
        specs: SpecsLike,
        signals: Mapping[str, SignalLike],
        *,
        dtype: object = None,
        **options: Unpack[RequirementOptions],
    ) -> None:
        super().__init__(env)
        period = as_period(getattr(env, "dt", None), getattr(env, "action_repeat", 1))
        self._requirements = JaxRequirements(specs, signals, period, dtype, options)
        self._judge = self._requirements.judge

    def reset(self, rng: jax.Array) -> Any:  # noqa: ANN401 - a state of Brax or of Playground
        """Reset all environments; ``info`` has their first readings."""
        state = self.env.reset(rng)
        if "steps" not in state.info or not state.done.shape:
            raise InputError(
                "StlWrapper needs an environment in VmapWrapper and then EpisodeWrapper. "
                "training_wrapper(specs, signals) builds the order that Brax trains with."
            )
        count = state.done.shape[0]
        stl, judged = self._requirements.begin(
            self._judge.init(count), _reset_step(state), jnp.ones(count, dtype=bool)
        )
        return self._with(state, stl, judged)

    def step(self, state: Any, action: jax.Array) -> Any:  # noqa: ANN401 - a state of Brax or of Playground
        """Step all environments; where an episode starts, take sample 0 first."""
        inner = self._without(state)
        # Only the number of steps shows a reset: the resetting wrapper has cleared `done`, and may
        # have reset all, some or no keys of the info.
        first = inner.info["steps"] == 0
        stl, _ = self._requirements.begin(only_entry(state.info[_STATE]), _reset_step(inner), first)
        after = self.env.step(inner, action)
        truncated = after.info["truncation"] > 0
        ended = after.done > 0
        step = ArrayStep(after.obs, action, after.reward, after.info, after, after.metrics)
        stl, judged = self._requirements.step(stl, step, ended & ~truncated, truncated)
        return self._with(self._ended(after, judged), stl, judged)

    @property
    def observation_size(self) -> Any:  # noqa: ANN401 - a number, or a dictionary of them
        """The size of the environment's observation, with ``observe="state"`` appended."""
        size = self.env.observation_size
        if not self._judge.observes:
            return size
        width = self._judge.features.box.shape[0]
        return {**size, KEY: (width,)} if isinstance(size, Mapping) else size + width

    def _ended(self, state: Any, judged: JudgedStep) -> Any:  # noqa: ANN401 - a state
        """End episodes after a violation, also in the sums over episodes."""
        kind = state.done.dtype
        over = (judged.terminated | judged.truncated).astype(kind)
        info = dict(state.info)
        cut = judged.truncated & ~judged.terminated  # Brax counts only these as truncated
        info["truncation"] = cut.astype(info["truncation"].dtype)
        if "episode_done" in info:
            info["episode_done"] = over
            sums = info["episode_metrics"]
            paid = sums["sum_reward"] + (judged.reward - state.reward)
            info["episode_metrics"] = {**sums, "sum_reward": paid}
        return state.replace(done=over, reward=judged.reward, info=info)

    def _with(self, state: Any, stl: Any, judged: JudgedStep) -> Any:  # noqa: ANN401 - states
        obs = self._requirements.observation(state.obs, judged.features)
        # A first axis of length 1: wrappers that reset infos treat a first axis of the length of
        # the batch as the batch.
        info = {**state.info, **judged.info, _STATE: as_batch(stl)}
        metrics = {**state.metrics, **self._judge.metrics(judged)}
        return state.replace(obs=obs, info=info, metrics=metrics)

    def _without(self, state: Any) -> Any:  # noqa: ANN401 - states
        """Return the inner state; the environment would add up metrics that are not its own."""
        obs, judge = state.obs, self._judge
        if judge.observes and isinstance(obs, Mapping):
            obs = {key: value for key, value in obs.items() if key != KEY}
        elif judge.observes:
            obs = obs[..., : -judge.features.box.shape[0]]
        return state.replace(
            obs=obs,
            info={k: v for k, v in state.info.items() if k not in judge.keys and k != _STATE},
            metrics={k: v for k, v in state.metrics.items() if k not in judge.metric_keys},
        )


def _reset_step(state: Any) -> ArrayStep:  # noqa: ANN401 - a state
    return ArrayStep(state.obs, None, None, state.info, state, state.metrics)


def training_wrapper(
    specs: SpecsLike,
    signals: Mapping[str, SignalLike],
    *,
    dtype: object = None,
    **options: Unpack[RequirementOptions],
) -> Callable[..., Any]:
    """Return the ``wrap_env_fn`` of a learner of Brax: its own wrappers, with `StlWrapper` inside.

    The arguments are the same as for `StlWrapper`. Environments of Playground get its resets.

    Example:
        >>> from brax.training.agents.ppo import train as ppo
        >>> wrap = training_wrapper("always(abs(angle) < 0.1)", {"angle": "obs[1]"})
        >>> train = lambda env: ppo.train(env, wrap_env_fn=wrap, num_timesteps=100_000)
    """

    def wrap(
        env: Any,  # noqa: ANN401 - of Brax or of Playground
        episode_length: int = 1000,
        action_repeat: int = 1,
        randomization_fn: Callable[..., Any] | None = None,
        **resets: bool,
    ) -> Any:  # noqa: ANN401 - of Brax or of Playground
        is_playground = hasattr(env, "mjx_model")
        if randomization_fn is None:
            batch: Any = training.VmapWrapper(env)
        elif is_playground:
            from mujoco_playground._src import wrapper as playground

            batch = playground.BraxDomainRandomizationVmapWrapper(env, randomization_fn)
        else:
            batch = training.DomainRandomizationVmapWrapper(env, randomization_fn)
        counted = training.EpisodeWrapper(batch, episode_length, action_repeat)
        judged = StlWrapper(counted, specs, signals, dtype=dtype, **options)
        if is_playground:
            from mujoco_playground._src import wrapper as playground

            return playground.BraxAutoResetWrapper(judged, **resets)
        return training.AutoResetWrapper(judged)

    return wrap
