"""`VectorStlReward`: rewards of a vector environment shaped with robustness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Unpack

import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorWrapper
from numpy.typing import NDArray

from rtamt_gym.judging.batch_infos import put
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.shaping import Mode, Priority, least, outcome, settle
from rtamt_gym.signals.columns import Batch, Floats
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.signals.taps import StaysOpen
from rtamt_gym.wrappers.episode_counters import put_returns
from rtamt_gym.wrappers.monitoring import MonitorOptions
from rtamt_gym.wrappers.observing import Observe
from rtamt_gym.wrappers.reward import Rewarding, ShapingOptions, find_or_make
from rtamt_gym.wrappers.vector_monitor import VectorStlMonitor


class VectorStlReward(Rewarding, StaysOpen, VectorWrapper, RecordConstructorArgs):
    """Shapes the rewards of all environments with the robustness of specifications.

    Each environment gets the reward that :class:`StlReward` around it would pay. The wrapper takes
    the arguments of :class:`VectorStlMonitor` and contains a monitor, or uses the monitor of the
    environments. The rewards are float64; the environments' own stay in ``infos["reward"]``. In the
    autoreset mode ``NEXT_STEP``, a step that resets an environment pays the vector environment's
    reward: 0. With ``SAME_STEP`` the environment's reward of the last step of an episode is in
    ``infos["final_info"]["reward"]``, and ``observe="state"`` is appended to ``final_obs``. If a
    wrapper inside counts episodes, of each environment or of all, ``infos["episode"]`` has ``r``,
    the sum of the rewards that the learner was paid, and ``r_env``, the environment's own; the
    wrapper's own statistics do not change.

    The warning about a ``clip`` that flattens counts the first 10 episodes that end, in any
    environment, and the samples of all until then.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import VectorStlReward
        >>> envs = gym.make_vec("CartPole-v1", num_envs=3, vectorization_mode="vector_entry_point")
        >>> envs = VectorStlReward(
        ...     envs, "always(abs(theta) < 0.1)", {"theta": "obs[2]"}, mode="add", weight=10.0
        ... )
        >>> _, infos = envs.reset(seed=123)
        >>> _, rewards, _, _, infos = envs.step(np.array([1, 1, 0]))
        >>> rewards.round(2), infos["reward"], infos["robustness"].round(3)
        (array([1.57, 1.78, 1.68]), array([1., 1., 1.]), array([0.057, 0.078, 0.068]))

    Change logs:
     * v0.5.0 - Initially added
    """

    _monitor: VectorStlMonitor

    def __init__(
        self,
        env: Batch,
        specs: SpecsLike | None = None,
        signals: Mapping[str, SignalLike] | None = None,
        *,
        mode: Mode,
        weight: float = 1.0,
        clip: float = 1.0,
        gamma: float = 0.99,
        temperature: float | None = None,
        weights: Mapping[str, float] | None = None,
        priorities: Mapping[str, Priority] | None = None,
        bonus: float = 0.0,
        penalty: float = 0.0,
        observe: Observe | None = None,
        **monitor: Unpack[MonitorOptions],
    ) -> None:
        """Find the monitor of the environment or make one, and check the numbers.

        It takes the arguments of :class:`StlReward`, with a vector environment, and the keyword
        arguments of :class:`VectorStlMonitor`.

        Raises:
            SpecificationError: As :class:`VectorStlMonitor` does
            InputError: As :class:`VectorStlMonitor` and :class:`StlReward` do
        """
        options = ShapingOptions(
            mode=mode,
            weight=weight,
            clip=clip,
            gamma=gamma,
            temperature=temperature,
            weights=weights,
            priorities=priorities,
            bonus=bonus,
            penalty=penalty,
        )
        RecordConstructorArgs.__init__(self, **options, observe=observe)
        env, self._monitor = find_or_make(VectorStlMonitor, env, specs, signals, monitor)
        VectorWrapper.__init__(self, env)
        self._set_up(env, options, observe, env.num_envs)
        self._robustness = np.zeros(env.num_envs)
        self._outcome = np.zeros(env.num_envs)
        self._returns = np.zeros(env.num_envs)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset environments; the sample of a reset gives the first potential."""
        mask = None if options is None else options.get("reset_mask")
        obs, infos = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]  # lists
        self._begin(mask)
        values = self._monitor.values()
        self._robustness = self._potential_of(values)
        which = slice(None) if mask is None else mask
        self._returns[which] = self._outcome[which] = 0.0
        self._watch_start(self._paying(values), mask)
        self._watch_reset(values, mask)
        return self._observed(obs, values), infos

    def step(self, actions: Any) -> tuple[Any, Floats, Any, Any, dict[str, Any]]:
        """Step the environments and shape the rewards."""
        obs, rewards, terminated, truncated, infos = self.env.step(actions)
        own = np.array(rewards, np.float64)
        ended = np.logical_or(terminated, truncated)
        now = self._monitor.values()
        last = self._monitor.terminal or now
        before, after = self._robustness, self._potential_of(last)
        shaping = self._shaping
        shaped = shaping.reward(
            own, before, after, np.array(terminated, np.float64), ended.astype(np.float64)
        )
        if self._settles:
            newest = outcome(least(last.lower), least(last.upper))
            shaped += settle(self._outcome, newest, shaping.bonus, shaping.penalty)
            self._outcome = newest
            if last is not now:
                self._outcome[ended] = 0.0
        self._returns += shaped
        infos = dict(infos)
        if last is now:
            self._robustness = after
            begun = self._monitor.begun
            if begun is not None:
                self._begin(begun)
                shaped = np.where(begun, own, shaped)
                self._returns[begun] = self._outcome[begun] = 0.0
            put(infos, "reward", own, None if begun is None else ~begun, self.num_envs)
        else:
            self._begin(ended)
            self._robustness = self._potential_of(now)
            infos["final_info"] = dict(infos["final_info"])
            put(infos["final_info"], "reward", own, ended, self.num_envs)
            put(infos, "reward", own, ~ended, self.num_envs)
            self._append_to_final(infos, last, ended)
            put_returns(infos["final_info"], self._returns, ended)
        if ended.any():
            put_returns(infos, self._returns, ended)
            self._returns[ended] = 0.0
        if self._clip_watch is not None:
            paying = self._paying(last)
            self._clip_watch.step(paying)
            if ended.any():
                self._clip_watch.end(paying, ended)
                if last is not now:
                    self._clip_watch.reset(self._paying(now), ended)
                self._warn_if_flat()
        self._watch_step(last, ended)
        if last is not now:
            self._watch_reset(now, ended)
        return self._observed(obs, now), shaped, terminated, truncated, infos

    @property
    def samples(self) -> NDArray[np.int64]:
        """The number of samples since each environment's reset, including the reset's."""
        return self._monitor.samples
