"""Requirements for environments of Brax and of MuJoCo Playground.

The wrapper stands between the one that counts the steps of an episode and the one that resets:
`training_wrapper` puts it there, as the ``wrap_env_fn`` of Brax's learners.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Unpack

import jax
import jax.numpy as jnp
from brax.envs.base import Wrapper
from brax.envs.wrappers import training

from rtamt import InputError
from rtamt_arrays.jax.wrapping import JaxRequirements, as_period, of_one, one
from rtamt_arrays.requirements import JudgedStep, RequirementOptions
from rtamt_arrays.selectors import ArrayStep
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.observing import KEY

__all__ = ["StlWrapper", "training_wrapper"]

_STATE = "stl_state"


class StlWrapper(Wrapper):  # type: ignore[misc]  # Brax is untyped
    """Judges the episodes of a Brax or Playground environment, on the device.

    ``state.info`` gets the keys of `rtamt_gym.StlReward`: ``robustness``, ``stl_lower``,
    ``stl_upper`` and ``stl_violated`` at every step, and ``stl_success``, ``is_success``,
    ``stl_undecided`` (False before the last step of an episode) and ``stl_violated_at`` (-1 while
    nothing is violated); with a mode, ``reward`` is the environment's own; with ``cost``, ``cost``
    and those of several specifications. They are arrays of shape (lanes,). ``state.metrics`` gets
    ``robustness`` and ``is_success`` of last steps, 0 before them, so that Brax's sums over
    episodes are the means of both: ``eval/episode_is_success`` is the rate of satisfaction. The
    costs are there too, of every step: ``eval/episode_cost`` is the mean of their sums.

    The observation of a reset is sample 0, and that in which an episode ends is judged, which the
    resetting wrapper overwrites. With ``action_repeat`` there is one sample for each action. A
    violation sets ``state.done``; ``on_violation="truncate"`` sets ``info["truncation"]`` too. The
    sums of episodes that `EpisodeWrapper` keeps end with it, and have the shaped reward.

    A function that is a signal gets an `ArrayStep` of one environment; its ``state`` is Brax's
    ``State``: ``lambda step: step.state.pipeline_state.x.pos[0, 2]``.

    Args:
        env: An environment in `VmapWrapper` and `EpisodeWrapper`.
        specs: One specification, or several by name, as for `rtamt_gym.StlMonitor`.
        signals: What the variables read: see `rtamt_arrays.selectors`.
        dtype: The kind of floats of the monitors; None: that of JAX.
        **options: See `rtamt_arrays.requirements.RequirementOptions`; without ``period`` a step
            takes the environment's ``dt``, times its ``action_repeat``.

    Raises:
        SpecificationError: As `rtamt.EpisodeMonitor` does.
        InputError: If an argument is wrong, or the environment has no `EpisodeWrapper`; while JAX
            traces, if a selector does not fit what the environment gives.

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
        repeat = getattr(env, "action_repeat", 1)
        period = as_period(getattr(env, "dt", None), repeat)
        self._judge = JaxRequirements(specs, signals, period, dtype, options)

    def reset(self, rng: jax.Array) -> Any:  # noqa: ANN401 - a state of Brax or of Playground
        """Resets all environments; ``info`` has their first readings."""
        state = self.env.reset(rng)
        if "steps" not in state.info or not state.done.shape:
            raise InputError(
                "expected an environment in VmapWrapper and then EpisodeWrapper, which count the "
                "steps of many; training_wrapper(specs, signals) makes the order that Brax trains "
                "with"
            )
        lanes = state.done.shape[0]
        blank = self._judge.requirements.init(lanes)
        begun, judged = self._judge.begin(blank, _reset_of(state), jnp.ones(lanes, dtype=bool))
        return self._with(state, begun, judged)

    def step(self, state: Any, action: jax.Array) -> Any:  # noqa: ANN401 - a state of Brax or of Playground
        """Steps all environments; those that are at the begin of an episode take sample 0 first."""
        known = of_one(state.info[_STATE])
        inner = self._without(state)
        # The steps are 0 after a reset, and nothing else tells it: the resetting wrapper clears
        # `done` before this is called, and resets all, some or none of the info.
        known, _ = self._judge.begin(known, _reset_of(inner), inner.info["steps"] == 0)
        after = self.env.step(inner, action)
        truncated = after.info["truncation"] > 0
        ended = after.done > 0
        step = ArrayStep(after.obs, action, after.reward, after.info, after, after.metrics)
        known, judged = self._judge.step(known, step, ended & ~truncated, truncated)
        return self._with(self._ended(after, judged), known, judged)

    @property
    def observation_size(self) -> Any:  # noqa: ANN401 - a number, or a dictionary of them
        """That of the environment, with what ``observe="state"`` appends."""
        size = self.env.observation_size
        if not self._judge.requirements.observes:
            return size
        shown = self._judge.requirements.features.box.shape[0]
        return {**size, KEY: (shown,)} if isinstance(size, Mapping) else size + shown

    def _ended(self, state: Any, judged: JudgedStep) -> Any:  # noqa: ANN401 - a state
        """Ends the episodes that a violation ends, also in the sums over episodes."""
        kind = state.done.dtype
        over = (judged.terminated | judged.truncated).astype(kind)
        info = dict(state.info)
        cut = judged.truncated & ~judged.terminated  # as Brax counts them
        info["truncation"] = cut.astype(info["truncation"].dtype)
        if "episode_done" in info:
            info["episode_done"] = over
            sums = info["episode_metrics"]
            paid = sums["sum_reward"] + (judged.reward - state.reward)
            info["episode_metrics"] = {**sums, "sum_reward": paid}
        return state.replace(done=over, reward=judged.reward, info=info)

    def _with(self, state: Any, known: Any, judged: JudgedStep) -> Any:  # noqa: ANN401 - states
        obs = self._judge.shown(state.obs, judged.features)
        # Wrappers that reset infos take a first axis as long as there are lanes for that of lanes.
        info = {**state.info, **judged.info, _STATE: one(known)}
        metrics = {**state.metrics, **self._judge.requirements.metrics(judged)}
        return state.replace(obs=obs, info=info, metrics=metrics)

    def _without(self, state: Any) -> Any:  # noqa: ANN401 - states
        """The state as the environment inside has it: it adds up the metrics that it finds."""
        obs, requirements = state.obs, self._judge.requirements
        if requirements.observes and isinstance(obs, Mapping):
            obs = {key: value for key, value in obs.items() if key != KEY}
        elif requirements.observes:
            obs = obs[..., : -requirements.features.box.shape[0]]
        own = requirements.keys
        return state.replace(
            obs=obs,
            info={k: v for k, v in state.info.items() if k not in own and k != _STATE},
            metrics={k: v for k, v in state.metrics.items() if k not in requirements.metric_keys},
        )


def _reset_of(state: Any) -> ArrayStep:  # noqa: ANN401 - a state
    return ArrayStep(state.obs, None, None, state.info, state, state.metrics)


def training_wrapper(
    specs: SpecsLike,
    signals: Mapping[str, SignalLike],
    *,
    dtype: object = None,
    **options: Unpack[RequirementOptions],
) -> Callable[..., Any]:
    """Makes the ``wrap_env_fn`` of a learner of Brax: its own wrappers, with `StlWrapper` inside.

    Playground's environments get Playground's resets.

    Args:
        specs: As for `StlWrapper`.
        signals: As for `StlWrapper`.
        dtype: As for `StlWrapper`.
        **options: As for `StlWrapper`.

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
        of_playground = hasattr(env, "mjx_model")
        if randomization_fn is None:
            many: Any = training.VmapWrapper(env)
        elif of_playground:
            from mujoco_playground._src import wrapper as playground

            many = playground.BraxDomainRandomizationVmapWrapper(env, randomization_fn)
        else:
            many = training.DomainRandomizationVmapWrapper(env, randomization_fn)
        counted = training.EpisodeWrapper(many, episode_length, action_repeat)
        judged = StlWrapper(counted, specs, signals, dtype=dtype, **options)
        if of_playground:
            from mujoco_playground._src import wrapper as playground

            return playground.BraxAutoResetWrapper(judged, **resets)
        return training.AutoResetWrapper(judged)

    return wrap
