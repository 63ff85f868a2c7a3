"""`ParallelStlMonitor`: an environment of several agents, monitored as `StlMonitor` does one."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable, Mapping
from typing import Any, Unpack

import gymnasium as gym
import numpy as np

from rtamt import InputError, InputTypeError
from rtamt_gym.judging.constants import ConstantValue
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.infos import step_info
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.signals.agents import agent_sources
from rtamt_gym.signals.periods import read_period
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.wrappers.episode_monitoring import EpisodeMonitoring
from rtamt_gym.wrappers.monitoring import (
    OnSatisfaction,
    OwnOptions,
    Violations,
    refuse_monitored,
)
from rtamt_gym.wrappers.parallel import Infos, ParallelWrapper

__all__ = ["ParallelStlMonitor"]


class ParallelStlMonitor(EpisodeMonitoring, ParallelWrapper):
    """Monitors an environment of several agents against specifications of what they do together.

    The environment is one of PettingZoo's parallel API, and so is the wrapper. Specifications speak
    of the agents' joint signals: a selector says whose signal it reads, ``agent_0: obs[2]``,
    ``agent_1: action[0]``, ``agent_0: reward``, ``agent_1: info['speed']``; a callable gets a
    :class:`rtamt_gym.Step` with the observations, actions, rewards and infos of all agents, by
    agent. Samples, verdicts, costs and options are as for :class:`StlMonitor`, as if the agents
    were one:

    * **Infos.** Every agent of a step, or of a reset, gets the keys that :class:`StlMonitor` adds,
      all agents the same: ``robustness``, ``stl_lower``, ``stl_upper``, ``stl_violated``,
      ``stl_progress`` of requirements in stages, and ``stl`` and ``cost`` where asked for. The cost
      is one number for all agents: sum it over the steps of one agent, not over agents.
    * **A certain violation** ends the episode of all agents, unless it is only reported: each is
      terminated, or truncated, and :attr:`agents` is empty.
    * **The episode ends** when the last agents leave. The end is read by ``at_termination`` if one
      of them is terminated, else by ``at_truncation``. The agents that are there then get the last
      info, with ``stl_episode``, ``stl_success``, ``stl_undecided``, ``is_success``, and after a
      violation ``stl_violated_by`` and ``stl_violated_at``.
    * **An agent that leaves before** ends no episode, and its own last info has no verdict, for the
      others go on. Its signals have no value then: an error says so, unless ``nan="hold"`` keeps
      their last value. That nobody may leave is a requirement like others, on a callable such as
      ``lambda step: len(step.obs)``.

    ``state()``, ``render()`` and every other attribute come from the environment. PettingZoo need
    not be installed; where it is, the wrapper is one of its ``ParallelEnv``.

    Attributes:
        stl_episodes: Records of the last ``buffer_length`` episodes that ended, as
            :class:`StlMonitor` keeps them.

    Example:
        >>> import numpy as np
        >>> from gymnasium.spaces import Box, Discrete
        >>> from rtamt_gym import ParallelStlMonitor
        >>> class Chase:
        ...     "The second of two agents on a line is the faster one."
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
        ...         rewards = {name: 0.0 for name in self.agents}
        ...         return self.observed(), rewards, no, no, {name: {} for name in self.agents}
        ...
        ...     def observed(self):
        ...         return {name: np.array([self.at[name]]) for name in self.agents}
        >>> env = ParallelStlMonitor(
        ...     Chase(),
        ...     "always(x1 - x2 > 2)",
        ...     {"x1": "first: obs[0]", "x2": "second: obs[0]"},
        ... )
        >>> _, infos = env.reset(seed=1)
        >>> while env.agents:
        ...     print(env.agents, infos["first"]["robustness"])
        ...     actions = {agent: env.action_space(agent).sample() for agent in env.agents}
        ...     _, _, terminations, _, infos = env.step(actions)
        ['first', 'second'] 3.0
        ['first', 'second'] 2.0
        ['first', 'second'] 1.0
        >>> terminations, infos["second"]["is_success"], infos["second"]["stl_violated_at"]
        ({'first': True, 'second': True}, False, 3)

    Change logs:
     * v0.5.0 - Initially added
    """

    _UNPICKLED = frozenset({"_feed", "_feed_reset", "_comparing"})
    env: Any

    @documents_options("episodes")
    def __init__(
        self,
        env: Any,  # noqa: ANN401 - of PettingZoo's form
        specs: SpecsLike,
        signals: Mapping[str, SignalLike] | None = None,
        *,
        on_violation: Violations = "terminate",
        on_satisfaction: OnSatisfaction = "report",
        details: bool = False,
        cost: Cost | None = None,
        buffer_length: int = 100,
        constants: Mapping[str, ConstantValue] | None = None,
        history: bool = False,
        **reading: Unpack[EvaluationKeywords],
    ) -> None:
        """Parses the specifications, binds the signals, and refuses what cannot be monitored.

        Args:
            env: The environment to apply the wrapper, in the form of PettingZoo's parallel API
            specs: As for :class:`StlMonitor`
            signals: For every variable of the specifications a selector with its agent in front,
                such as ``"agent_0: obs[2]"`` or ``"'agent 0': info['speed']"``, or a callable of a
                :class:`rtamt_gym.Step` of all agents, or a pair of one of them and its value at
                reset, which action and reward need; or in the environment's own ``signals``
            on_violation: What a certain violation does: ``"terminate"`` or ``"truncate"`` the
                episode of all agents, or only ``"report"`` it; or a mapping with a word for every
                specification, as for :class:`StlMonitor`
            on_satisfaction: The same once every specification is certainly satisfied; by default
                it is only reported
            details: Whether to add ``info["stl"]``, the state of every specification
            cost: As for :class:`StlMonitor`
            constants: As for :class:`StlMonitor`
            buffer_length: How many records :attr:`stl_episodes` keeps
            history: Whether to keep the samples of the episode for :meth:`explain`
            **reading: How samples are judged, as for :class:`StlMonitor`, up to the end of the
                last agents: ``period``, ``view``, ``nan``, ``align``, ``semantics``, ``inputs``,
                ``outputs``, ``at_termination`` and ``at_truncation``

        Raises:
            SpecificationError: As :class:`StlMonitor` does
            InputError: As :class:`StlMonitor` does; and if a selector names no agent
            InputTypeError: If the environment has not the form of PettingZoo's parallel API
        """
        read = checked_options(reading, type(self), "episodes")
        options = OwnOptions(
            on_violation=on_violation,
            on_satisfaction=on_satisfaction,
            details=details,
            cost=cost,
            buffer_length=buffer_length,
            constants=constants,
        )
        agents = _agents(env)
        self.env = env
        sources = agent_sources(agents, hold=read.nan == "hold")
        judged = self._set_up(env, specs, signals, read, options, read_period, sources, agents)
        self.stl_episodes = deque(maxlen=buffer_length)
        self._history = history
        self._panel = self._make_panel(judged.specs)
        if self._panel.period is not None:
            self._watch = self._step_time(env, float(self._panel.period))
        self._bind_signals()
        self._over = False

    @property
    def agents(self) -> list[Any]:
        """The agents of the next step; none after the end of an episode."""
        return [] if self._over else self.env.agents

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[Any, Any], Infos]:
        """Resets the environment and the monitors; the observations are sample 0.

        ``options={"constants": {...}}`` changes constants as for :meth:`StlMonitor.reset`.

        Raises:
            InputError: If a signal is nan or cannot be read; as :attr:`constants` does.
            SpecificationError: As :attr:`constants` does.
            StateError: If the environment has changed its period since construction.
        """
        options, change = self._taken(options)
        self._warn_of_unseen_end(unended=self._abandon())
        self._over = False
        obs, infos = self.env.reset(seed=seed, options=options)
        self._adopt(change)
        self._begin_times()
        self._panel.reset()
        found = self._feed_reset(obs, None, None, infos)
        self._panel.begin()
        infos = self._inform(self.env.agents, infos, *found, period=self._told_period)
        self._running, self._lost = True, None
        return obs, infos

    def step(
        self, actions: dict[Any, Any]
    ) -> tuple[dict[Any, Any], dict[Any, float], dict[Any, bool], dict[Any, bool], Infos]:
        """Steps through the environment, feeds one sample, and ends a violated episode.

        Raises:
            StateError: Before :meth:`reset` and after the end of an episode.
            InputError: If a signal is nan or cannot be read; the episode is over then.
        """
        if not self._running:
            self._resume()
        panel, env = self._panel, self.env
        here = [*env.agents]
        obs, rewards, terminations, truncations, infos = env.step(actions)
        here += [agent for agent in env.agents if agent not in here]
        try:
            robustness, lower, upper = self._feed(obs, actions, rewards, infos)
        except BaseException:
            # A monitor that misses a sample would count wrong ever after.
            self._running = False
            raise
        how = self._how_to_end() if panel.settled else "report"
        ended = all(terminations.get(each) or truncations.get(each) for each in env.agents)
        terminated = ended and any(terminations.get(each) for each in here)
        truncated = ended and (not terminated or any(truncations.get(each) for each in here))
        if ended:
            robustness, lower, upper = self._finish(terminated)
        if how != "report" and not terminated:
            terminated = how == "terminate"
            truncated = truncated or not terminated
            ends = dict.fromkeys((each for each in here if not terminations.get(each)), True)
            if terminated:
                terminations = {**terminations, **ends}
            else:
                truncations = {**truncations, **ends}
        costs = panel.take_costs()
        infos = self._inform(here, infos, robustness, lower, upper, costs)
        if terminated or truncated:
            self._running, self._over = False, True
            self._conclude(here, infos, terminated=terminated, truncated=truncated)
            self._tell()
        return obs, rewards, terminations, truncations, infos

    def close(self) -> None:
        """Closes the environment; an episode that has not ended is recorded as truncated."""
        self._abandon()
        self.env.close()

    def _inform(
        self,
        agents: Iterable[Hashable],
        infos: Infos,
        robustness: float,
        lower: float,
        upper: float,
        costs: Mapping[str, Any] | None = None,
        period: np.float64 | None = None,
    ) -> Infos:
        """The infos with the keys that every info has, for these agents."""
        panel = self._panel
        found = np.float64(robustness), np.float64(lower), np.float64(upper)
        violated = panel.violated_by is not None
        made = {}
        for agent in agents:
            states = panel.describe() if self._details else None
            info = infos.get(agent, {})
            made[agent] = step_info(
                info,
                *found,
                violated,
                states,
                costs,
                panel.of_instant,
                panel.least_progress,
                period,
            )
        return {**infos, **made}

    def _conclude(
        self, agents: Iterable[Hashable], infos: Infos, *, terminated: bool, truncated: bool
    ) -> None:
        """Adds the keys that only last infos have, and records the episode."""
        found = self._found()
        for agent in agents:
            self._add_last(infos[agent], found)
        self._record(found, terminated=terminated, truncated=truncated)


def _agents(env: Any) -> dict[str, Hashable]:  # noqa: ANN401 - of PettingZoo's form, it is hoped
    """The agents of an environment, by the names that selectors give them.

    Raises:
        InputTypeError: If it has not the form of PettingZoo's parallel API.
        InputError: If it has a monitor already, or does not say who its agents are.
    """
    if isinstance(env, gym.Env):
        raise InputTypeError(
            f"expected a parallel environment of PettingZoo, got {env}, which has one agent; "
            "StlMonitor is for it"
        )
    if hasattr(env, "agent_iter"):
        raise InputTypeError(
            f"expected a parallel environment of PettingZoo, got {env}, whose agents take turns; "
            "convert it with pettingzoo.utils.aec_to_parallel"
        )
    within = env
    while within is not None:
        if isinstance(within, ParallelStlMonitor):
            refuse_monitored(type(within).__name__)
        within = getattr(within, "env", None)
    agents = getattr(env, "possible_agents", None)
    if not agents:
        raise InputError(
            f"expected possible_agents, which selectors name, in {env}, got {agents!r}"
        )
    return {str(agent): agent for agent in agents}
