"""`ParallelStlReward`: rewards of several agents shaped with the robustness of what they do."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Unpack

import numpy as np

from rtamt import Explanation
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.judging.values import MonitorValues
from rtamt_gym.shaping import Mode, Priority, outcome, settle
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.monitoring import MonitorOptions
from rtamt_gym.wrappers.parallel import Infos, ParallelWrapper
from rtamt_gym.wrappers.parallel_monitor import ParallelStlMonitor
from rtamt_gym.wrappers.rewarding import Rewarding, ShapingOptions, find_or_make

__all__ = ["ParallelMonitorOptions", "ParallelStlReward"]


class ParallelMonitorOptions(MonitorOptions, total=False):
    """The keyword arguments of `ParallelStlMonitor`."""

    history: bool


class ParallelStlReward(Rewarding, ParallelWrapper):
    """Shapes the reward of each agent with the robustness of specifications of all of them.

    The wrapper takes the arguments of :class:`ParallelStlMonitor` and contains one, or uses the one
    that the environment has already: episodes end and infos are filled as that class describes.
    Each agent of a step gets the reward that :class:`StlReward` would make of its own reward r,
    with the robustness of what the agents do together, and with its own end:

    * the modes are those of :class:`StlReward`. ``"replace"`` and ``"hierarchical"`` pay all agents
      the same, the others pay each its own r beside it; which agent is to blame is not asked
    * an agent that leaves before the others is paid as at an end: ``"potential"`` counts 0 after
      its termination, ``"terminal"`` pays it the robustness so far
    * ``bonus`` and ``penalty`` are paid to each agent of the step that decides, so that an agent
      that has left before gets neither

    The environment's own reward stays in ``infos[agent]["reward"]``. Observations stay as they are.

    Example:
        >>> import numpy as np
        >>> from gymnasium.spaces import Box, Discrete
        >>> from rtamt_gym import ParallelStlReward
        >>> class Chase:
        ...     "The second of two agents on a line is the faster one, and each is paid its place."
        ...
        ...     possible_agents = ["first", "second"]
        ...
        ...     def __init__(self):
        ...         self.unwrapped = self
        ...         self.spaces = {name: Box(0, 99, (1,)) for name in self.possible_agents}
        ...
        ...     def observation_space(self, agent):
        ...         return self.spaces[agent]
        ...
        ...     def action_space(self, agent):
        ...         return Discrete(1)
        ...
        ...     def reset(self, seed=None, options=None):
        ...         self.agents = [*self.possible_agents]
        ...         self.at = {"first": 5.0, "second": 0.0}
        ...         return self.observed(), {name: {} for name in self.agents}
        ...
        ...     def step(self, actions):
        ...         self.at = {"first": self.at["first"] + 1, "second": self.at["second"] + 2}
        ...         no = {name: False for name in self.agents}
        ...         return (
        ...             self.observed(),
        ...             dict(self.at),
        ...             no,
        ...             no,
        ...             {name: {} for name in self.agents},
        ...         )
        ...
        ...     def observed(self):
        ...         return {name: np.array([self.at[name]]) for name in self.agents}
        >>> env = ParallelStlReward(
        ...     Chase(),
        ...     "always(x1 - x2 > 2)",
        ...     {"x1": "first: obs[0]", "x2": "second: obs[0]"},
        ...     mode="add",
        ...     clip=9.0,
        ... )
        >>> _, infos = env.reset(seed=1)
        >>> _, rewards, _, _, infos = env.step({"first": 0, "second": 0})
        >>> print(infos["first"]["robustness"], *rewards.values(), infos["second"]["reward"])
        2.0 8.0 4.0 2.0

    Change logs:
     * v0.5.0 - Initially added
    """

    _monitor: ParallelStlMonitor
    env: Any

    def __init__(
        self,
        env: Any,  # noqa: ANN401 - of PettingZoo's form
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
        **monitor: Unpack[ParallelMonitorOptions],
    ) -> None:
        """Finds the monitor of the environment or makes one, and checks the numbers.

        Args:
            env: The environment to apply the wrapper, in the form of PettingZoo's parallel API
            specs: As for :class:`ParallelStlMonitor`; ``None`` if the environment has one
            signals: As for :class:`ParallelStlMonitor`; ``None`` if the environment has one, or has
                ``signals`` of its own
            mode: How robustness becomes reward, as for :class:`StlReward`
            weight: As for :class:`StlReward`
            clip: As for :class:`StlReward`
            gamma: As for :class:`StlReward`
            temperature: As for :class:`StlReward`
            weights: As for :class:`StlReward`
            priorities: As for :class:`StlReward`
            bonus: As for :class:`StlReward`, for each agent
            penalty: As for :class:`StlReward`, for each agent
            **monitor: The keyword arguments of :class:`ParallelStlMonitor`

        Raises:
            SpecificationError: As :class:`ParallelStlMonitor` does
            InputError: As :class:`ParallelStlMonitor` does; and as :class:`StlReward` does
            InputTypeError: As :class:`ParallelStlMonitor` does
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
        self.env, self._monitor = find_or_make(ParallelStlMonitor, env, specs, signals, monitor)
        self._set_up(self.env, self._monitor.monitors, options, None, 1)
        self._potential = self._outcome = 0.0

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[Any, Any], Infos]:
        """Resets the environment; the sample of the reset gives the first potential."""
        obs, infos = self.env.reset(seed=seed, options=options)
        if self._followed != self._monitor.constant_changes:
            self._follow()
        self._require_known_start()
        self._potential, self._outcome = self._read(), 0.0
        if self._watch is not None:
            self._watch.reset(self._values())
            self._warn_if_flat()
        return obs, infos

    def step(
        self, actions: dict[Any, Any]
    ) -> tuple[dict[Any, Any], dict[Any, Any], dict[Any, bool], dict[Any, bool], Infos]:
        """Steps through the environment and shapes the rewards."""
        obs, rewards, terminations, truncations, infos = self.env.step(actions)
        before, after = self._potential, self._read()
        self._potential = after
        settled = self._settled()
        shaped: dict[Any, Any] = {}
        told = dict(infos)
        for agent, reward in rewards.items():
            terminated = bool(terminations.get(agent))
            ended = terminated or bool(truncations.get(agent))
            paid = self._shaping.reward(float(reward), before, after, terminated, ended)
            shaped[agent] = np.float64(paid + settled if self._settles else paid)
            told[agent] = {**infos.get(agent, {}), "reward": np.float64(reward)}
        if self._watch is not None:
            values = self._values()
            self._watch.step(values)
            if not self._monitor.agents:
                self._watch.end(values)
                self._warn_if_flat()
        return obs, shaped, terminations, truncations, told

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

    def _settled(self) -> float:
        """What bonus and penalty pay for the newest sample."""
        if not self._settles:
            return 0.0
        lower, upper = self._monitor.bounds
        before, self._outcome = self._outcome, outcome(lower, upper)
        return settle(before, self._outcome, self._shaping.bonus, self._shaping.penalty)

    def _read(self) -> float:
        """What the reward of a step depends on, before it and after it."""
        if self._shaping.mode == "progress":
            now: MonitorValues[float] = self._monitor.values()
            return self._shaping.middle(now.lower, now.upper)
        return self._shaping.robustness(self._values())

    def _values(self) -> list[float]:
        """For each specification the robustness that the reward is computed from."""
        pairs = self._monitor.monitors.values()
        return [(judge if self._whole else source).robustness for source, judge in pairs]
