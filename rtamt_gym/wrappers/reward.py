"""`StlReward`: the reward of an environment shaped with robustness."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, SupportsFloat, Unpack

import gymnasium as gym
import numpy as np
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs

from rtamt import Explanation
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.judging.values import MonitorValues
from rtamt_gym.shaping import Mode, Priority, clip, outcome, settle
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.books import Books
from rtamt_gym.wrappers.monitor import StlMonitor
from rtamt_gym.wrappers.monitoring import MonitorOptions
from rtamt_gym.wrappers.observing import Observe
from rtamt_gym.wrappers.returns import put_return
from rtamt_gym.wrappers.rewarding import Rewarding, ShapingOptions, find_or_make

__all__ = ["StlMonitorOptions", "StlReward"]


class StlMonitorOptions(MonitorOptions, total=False):
    """The keyword arguments of `StlMonitor`."""

    substeps: bool
    history: bool


class StlReward(Rewarding, gym.Wrapper[Any, ActType, ObsType, ActType], RecordConstructorArgs):
    """Shapes the reward with the robustness of specifications.

    The wrapper takes the arguments of :class:`StlMonitor` and contains one, or uses the one that
    the environment has already: episodes end and ``info`` is filled as that class describes. The
    environment's own reward stays in ``info["reward"]`` (``np.float64``, as the reward is).

    Where a wrapper inside counts episodes, such as the ``Monitor`` of Stable-Baselines3 or the
    ``RecordEpisodeStatistics`` of Gymnasium, ``info["episode"]["r"]`` becomes the sum of the
    rewards that the learner was paid, and so does the return of the episode in the wrapper;
    ``info["episode"]["r_env"]`` is the sum of the environment's own. A file that the ``Monitor``
    writes holds the environment's own.

    Let r be that reward, x' the robustness of the episode so far, ``info["robustness"]``, clipped
    to [-clip, clip], and x the same before the step. The new reward is

    * ``mode="add"``: r + weight * x'
    * ``mode="replace"``: x'
    * ``mode="potential"``: r + weight * (gamma * x' - x), with x' = 0 if the step terminates the
      episode, but not if it truncates it; with ``gamma`` the learner's discount, and the state
      observed, this leaves the optimal policies as they are
    * ``mode="terminal"``: r, and weight * x' more at the end of the episode, be it terminated or
      truncated
    * ``mode="progress"``: r + weight * (m' - m), with m the middle of the lower and the upper bound
      of the robustness, each clipped: over an episode the gains sum to weight times its change
    * ``mode="hierarchical"``: safety before target before comfort; ``priorities`` names the level
      of every specification. The first level that is violated pays its own x', raised by ``clip``
      for every level before it; if none is violated, the last level does. A step that violates a
      level pays less than any step that violates only later ones. r is not part of it.
    * ``mode="verdict"``: 0. Only ``bonus`` and ``penalty`` are paid, and r is not part of it

    Beside it ``bonus`` is paid once when all specifications are certainly satisfied, ``penalty``
    taken once when one is certainly violated, so that over an episode they sum to ``bonus`` if it
    is satisfied and to -``penalty`` if it is violated, whatever the mode.

    :mod:`rtamt_gym.shaping` explains what each is for.

    With several specifications x is the least of them, each times its entry in ``weights``; with a
    ``temperature`` T it is the smooth minimum -T * log(sum(exp(-x / T))), which depends on all
    specifications. Within a formula minima and maxima stay exact.

    The reward depends on the past through the monitor. ``observe="state"`` appends the state of the
    monitor to the observation, so that the reward depends on state and action alone again, for
    formulas such as ``always(p)``, ``eventually(p)`` and their Boolean combinations (one
    specification for each); a window inside another keeps more, which ``observe="obligations"``
    shows as :class:`StlMonitor` describes, times weight too. There are five
    numbers for every specification, in their order: robustness, lower and upper bound (times
    weight, clipped to [-clip, clip]), the fraction of its horizon that is left (1 without a
    horizon), and the verdict (1 certainly satisfied, -1 certainly violated, 0 undecided). A ``Box``
    of one dimension grows by them; a ``Dict`` gets the key ``"stl"``.

    With ``view="step"`` x is the robustness of the newest instant whose horizon has passed, but
    ``mode="terminal"`` pays the robustness of the whole episode, ``always(formula)``.

    The ``compute_reward`` of a goal environment is not shaped: goals cannot be exchanged in
    hindsight where the reward depends on the whole past.

    The vector version of the wrapper is :class:`VectorStlReward`.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import StlReward
        >>> env = gym.make("CartPole-v1")
        >>> env = StlReward(
        ...     env, "always(abs(theta) < 0.1)", {"theta": "obs[2]"}, mode="add", weight=10.0
        ... )
        >>> _, info = env.reset(seed=123)
        >>> print(f"{info['robustness']:.3f}")
        0.072
        >>> _, reward, _, _, info = env.step(1)
        >>> print(f"{reward:.2f} {info['reward']} {info['robustness']:.3f}")
        1.71 1.0 0.071

    Example with the state of the monitor in the observation:
        >>> env = StlReward(
        ...     gym.make("CartPole-v1"),
        ...     {
        ...         "upright": "always(abs(theta) < 0.1)",
        ...         "early": "eventually[0:0.2](abs(x) < 0.01)",
        ...     },
        ...     {"theta": "obs[2]", "x": "obs[0]"},
        ...     mode="potential",
        ...     observe="state",
        ... )
        >>> env.observation_space.shape
        (14,)
        >>> obs, info = env.reset(seed=123)
        >>> obs[4:].round(3).tolist()
        [0.07..., -1.0, 0.07..., 1.0, 0.0, -0.00..., -0.00..., 1.0, 1.0, 0.0]

    Change logs:
     * v0.5.0 - Initially added
    """

    _monitor: StlMonitor[Any, Any]

    def __init__(
        self,
        env: gym.Env[ObsType, ActType],
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
        **monitor: Unpack[StlMonitorOptions],
    ) -> None:
        """Finds the monitor of the environment or makes one, and checks the numbers.

        Args:
            env: The environment to apply the wrapper
            specs: As for :class:`StlMonitor`; ``None`` if the environment has one
            signals: As for :class:`StlMonitor`; ``None`` if the environment has one, or has
                ``signals`` of its own
            mode: How robustness becomes reward, see above
            weight: Factor of the robustness beside the reward of the environment; not for
                ``"replace"``, ``"hierarchical"`` and ``"verdict"``. 0 leaves the reward of the
                environment with ``bonus`` and ``penalty``, without shaping
            clip: Bound of the robustness; the interesting margins of every specification should
                lie inside (``weights`` help). If the robustness that decides the reward is outside
                at more than 9 of 10 samples of the first 10 episodes, or below -clip at more than
                half, a ``UserWarning`` at the end of the tenth says so, with its range. An infinite
                robustness does not count; of ``"terminal"``, which pays no other, the last samples
                count alone. It is not taken from the first episodes: the spaces of observations
                need it before, and every copy of an environment must pay the same
            gamma: The discount of the learner, for ``"potential"``
            temperature: Makes the minimum over the specifications a smooth one; ``None`` takes the
                exact one
            weights: Factor of the robustness of a specification, 1 where absent, so that margins
                in different units compare
            priorities: For ``"hierarchical"``, which needs them: ``"safety"``, ``"target"`` or
                ``"comfort"`` of every specification, such as ``{"upright": "safety", "near":
                "target"}``; a level counts as the minimum over its specifications
            bonus: Paid once an episode, beside the reward of every mode, when all specifications
                are certainly satisfied: at the step that shows it, or at the last one if only the
                end decides, as ``at_termination`` and ``at_truncation`` read it; 0 or more. What
                the sample of the reset decides is paid at the first step
            penalty: Taken once in the same way when one is certainly violated; 0 or more
            observe: ``"state"`` appends the state of the monitor to the observation;
                ``"obligations"`` what temporal operators owe too
            **monitor: The keyword arguments of :class:`StlMonitor`

        Raises:
            SpecificationError: As :class:`StlMonitor` does
            InputError: As :class:`StlMonitor` does; and if the environment has no monitor and none
                is described, or has one and another is described; if an argument is none of its
                choices, out of its range or names no specification; or if nothing can be appended
                to the observation
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
        # Not the arguments of the monitor: it is a wrapper of its own in the specification of the
        # environment, and is found when the environment is made again.
        RecordConstructorArgs.__init__(self, **options, observe=observe)
        env, self._monitor = find_or_make(StlMonitor, env, specs, signals, monitor)
        gym.Wrapper.__init__(self, env)
        monitors = self._monitor.monitors
        self._set_up(env, monitors, options, observe, 1)
        self._paying = self._payers()
        self._fresh = env is self._monitor  # whose infos are new at every step
        self._factor = self._shaping.factor
        if not self._fresh or (self._whole and self._monitor.judging.reading.view == "step"):
            self._factor = None  # another may have changed the info, or it is of an instant
        self._robustness = 0.0
        self._outcome = 0.0
        self._return = 0.0
        self._books = Books(env)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Resets the environment; the sample of the reset gives the first potential."""
        obs, info = self.env.reset(seed=seed, options=options)
        if self._followed != self._monitor.constant_changes:
            self._follow()
            self._paying = self._payers()
        self._require_known_start()
        self._robustness = self._potential(info)
        self._outcome = self._return = 0.0
        if self._watch is not None:
            self._watch.reset(self._values())
            self._warn_if_flat()
        if self._state is not None:
            shown: MonitorValues[float] = self._monitor.values()
            obs = self._observed(obs, shown)
            self._look_at_reset(shown)
        return obs, info

    def step(self, action: ActType) -> tuple[Any, SupportsFloat, bool, bool, dict[str, Any]]:
        """Steps through the environment and shapes the reward."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        paid = float(reward)
        before = self._robustness
        after = self._robustness = self._potential(info)
        ended = terminated or truncated
        shaping = self._shaping
        shaped = shaping.reward(paid, before, after, terminated, ended)
        if self._settles:
            now = outcome(float(info["stl_lower"]), float(info["stl_upper"]))
            shaped += settle(self._outcome, now, shaping.bonus, shaping.penalty)
            self._outcome = now
        self._return += shaped
        if self._fresh:
            info["reward"] = np.float64(paid)
        else:
            info = {**info, "reward": np.float64(paid)}
        if ended and put_return(info, np.float64(self._return)):
            self._books.pay(self._return)
        if self._watch is not None:
            values = self._values()
            self._watch.step(values)
            if ended:
                self._watch.end(values)
                self._warn_if_flat()
        if self._state is not None:
            shown: MonitorValues[float] = self._monitor.values()
            obs = self._observed(obs, shown)
            self._look(shown, ended)
        return obs, np.float64(shaped), terminated, truncated, info

    @property
    def samples(self) -> int:
        """Samples fed since :meth:`reset`, counting the sample of the reset."""
        return self._monitor.samples

    def explain(self, name: str | None = None) -> Explanation:
        """Which sub-formulas and samples decided the episode, as :meth:`StlMonitor.explain` says.

        Raises:
            InputError: If there is no such specification.
            StateError: Without ``history=True``, or before the first :meth:`reset`.
        """
        return self._monitor.explain(name)

    def _payers(self) -> list[Any]:
        """For each specification what has the robustness that the reward is computed from."""
        pairs = self._monitor.monitors.values()
        return [judge if self._whole else source for source, judge in pairs]

    def _values(self) -> list[float]:
        """For each specification the robustness that the reward is computed from."""
        return [paying.robustness for paying in self._paying]

    def _potential(self, info: Mapping[str, Any]) -> float:
        """What the reward of a step depends on, before it and after it."""
        shaping, factor = self._shaping, self._factor
        if factor is None:
            if shaping.mode != "progress":
                return shaping.robustness(self._values())
            now: MonitorValues[float] = self._monitor.values()
            return shaping.middle(now.lower, now.upper)
        if shaping.mode != "progress":
            return clip(factor * float(info["robustness"]), shaping.clip)
        lower = clip(factor * float(info["stl_lower"]), shaping.clip)
        upper = clip(factor * float(info["stl_upper"]), shaping.clip)
        return 0.5 * (lower + upper)
