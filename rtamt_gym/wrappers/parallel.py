"""`ParallelStlMonitor` and `ParallelStlReward`: environments of PettingZoo's parallel API."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterable, Mapping
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Unpack

import gymnasium as gym
import numpy as np

from rtamt import Explanation, InputError, InputTypeError
from rtamt_gym.judging.costs import Cost
from rtamt_gym.judging.infos import step_info
from rtamt_gym.judging.monitor_set import Assessment
from rtamt_gym.judging.monitors import MonitorValues
from rtamt_gym.judging.specs import ConstantValue, SpecsLike
from rtamt_gym.options.evaluation import EvaluationKeywords, checked_options, documents_options
from rtamt_gym.shaping import Mode, Priority, least
from rtamt_gym.signals.signals import SignalLike
from rtamt_gym.signals.sources import agent_sources
from rtamt_gym.wrappers.episode_monitoring import EpisodeMonitoring
from rtamt_gym.wrappers.monitoring import MonitorOptions, OnSatisfaction, Violations
from rtamt_gym.wrappers.reward import (
    Rewarding,
    ShapingOptions,
    StlMonitorOptions,
    find_or_make,
)

if TYPE_CHECKING or find_spec("pettingzoo"):
    from pettingzoo.utils import ParallelEnv
else:

    class ParallelEnv:
        """A stand-in for PettingZoo's class if PettingZoo is not installed."""


Infos = dict[Any, dict[str, Any]]
"""The infos of agents."""


class ParallelWrapper(ParallelEnv):  # type: ignore[misc]  # it has no types
    """The base of the wrappers; other attributes come from the environment."""

    env: Any

    def __getattr__(self, name: str) -> Any:
        """Return the attribute of the environment."""
        if name.startswith("_") or name == "env":
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self.env, name)

    @property
    def agents(self) -> list[Any]:
        """The agents of the next step; none after the end of an episode."""
        agents: list[Any] = self.env.agents
        return agents

    @property
    def unwrapped(self) -> Any:
        """The environment inside of all wrappers."""
        return self.env.unwrapped

    def observation_space(self, agent: Any) -> gym.Space[Any]:
        """Return the observation space of an agent, the same object at every call."""
        space: gym.Space[Any] = self.env.observation_space(agent)
        return space

    def action_space(self, agent: Any) -> gym.Space[Any]:
        """Return the action space of an agent, the same object at every call."""
        space: gym.Space[Any] = self.env.action_space(agent)
        return space

    def state(self) -> Any:
        """Return the global state of the environment."""
        return self.env.state()

    def render(self) -> Any:
        """Render the environment."""
        return self.env.render()

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


class ParallelStlMonitor(EpisodeMonitoring, ParallelWrapper):
    """Monitors an environment of several agents against specifications of their joint signals.

    Environment and wrapper have PettingZoo's parallel API. A selector starts with its agent,
    ``agent_0: obs[2]``, ``agent_1: action[0]``, ``agent_0: reward``; a function gets a
    :class:`rtamt_gym.Step` with observations, actions, rewards and infos by agent. Samples,
    verdicts, costs and options are as for :class:`StlMonitor`:

    * **Infos.** Every agent of a step or a reset gets the same keys. The cost is one number for all
      agents: sum it over the steps of one agent, not over agents.
    * **A certain violation** ends the episode of all agents, unless it is only reported: each is
      terminated, or truncated, and :attr:`agents` is empty.
    * **The episode ends** when the last agents leave: with ``at_termination`` if one of them is
      terminated; otherwise, with ``at_truncation``. These agents get the last info.
    * **An agent that leaves before** ends no episode, and gets no verdict. Its signals have no
      value then, which is an error unless ``nan="hold"`` keeps their last value. To require that
      nobody leaves, use a function such as ``lambda step: len(step.obs)``.

    PettingZoo need not be installed; if it is, the wrapper is one of its ``ParallelEnv``.

    Attributes:
        stl_episodes: Records of the last ``buffer_length`` episodes that ended, as
            :class:`StlMonitor` keeps them.

    Example:
        >>> from rtamt_envs.two_service_robots import parallel_env
        >>> from rtamt_gym import ParallelStlMonitor
        >>> signals = {"x1": "robot_1: obs[0]", "x2": "robot_2: obs[0]"}
        >>> env = ParallelStlMonitor(parallel_env(), "always(x1 - x2 > 100)", signals)
        >>> _, infos = env.reset(seed=1)
        >>> infos["robot_1"]["stl_violated"], infos["robot_2"]["stl_violated"]
        (True, True)

    Change logs:
     * v0.5.0 - Initially added
    """

    _UNPICKLED = frozenset({"_feed", "_feed_reset", "_comparing"})
    env: Any

    @documents_options("episodes")
    def __init__(
        self,
        env: Any,
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
        """Parse the specifications and bind the signals.

        It takes the arguments of :class:`StlMonitor` except ``observe``, ``clip`` and ``substeps``.

        Args:
            env: The environment to apply the wrapper, with PettingZoo's parallel API
            specs: As for :class:`StlMonitor`
            signals: For every variable of the specifications a selector with its agent in front,
                such as ``"agent_0: obs[2]"`` or ``"'agent 0': info['speed']"``, or a function of a
                :class:`rtamt_gym.Step` of all agents. A pair adds the value at reset, which action
                and reward need. Other variables read the environment's own ``signals``
            on_violation: As for :class:`StlMonitor`, for the episode of all agents
            on_satisfaction: As for :class:`StlMonitor`, for the episode of all agents
            details: As for :class:`StlMonitor`
            cost: As for :class:`StlMonitor`
            buffer_length: The number of records in :attr:`stl_episodes`
            constants: As for :class:`StlMonitor`
            history: Whether to keep the samples of the episode for :meth:`explain`
            **reading: The evaluation options of :class:`rtamt_gym.EvaluationOptions`

        Raises:
            SpecificationError: As :class:`StlMonitor` does
            InputError: As :class:`StlMonitor` does; and if a selector names no agent
            InputTypeError: If the environment does not have PettingZoo's parallel API
        """
        read = checked_options(reading, type(self), "episodes")
        options = MonitorOptions(
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
        loaded = self._set_up(env, specs, signals, read, options, sources=sources, agents=agents)
        self.stl_episodes = deque(maxlen=buffer_length)
        self._history = history
        self._monitor_set = self._make_monitor_set(loaded)
        if self._monitor_set.period is not None:
            self._time = self._step_time(env, float(self._monitor_set.period))
        self._bind_signals()
        self._over = False

    @property
    def agents(self) -> list[Any]:
        """The agents of the next step; none after the end of an episode."""
        return [] if self._over else self.env.agents

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[Any, Any], Infos]:
        """Reset the environment and the monitors; the observations are sample 0.

        ``options={"constants": {...}}`` changes constants as for :meth:`StlMonitor.reset`.

        Raises:
            InputError: If a signal is nan or cannot be read; as :attr:`constants` does.
            SpecificationError: As :attr:`constants` does.
            StateError: If the environment has changed its period since construction.
        """
        options, change = self._split_options(options)
        self._warn_of_unseen_end(unended=self._abandon())
        self._over = False
        obs, infos = self.env.reset(seed=seed, options=options)
        self._apply(change)
        self._begin_times()
        self._monitor_set.reset()
        assessment = self._feed_reset(obs, None, None, infos)
        self._monitor_set.begin()
        infos = self._report(
            self.env.agents, infos, assessment, period=self._monitor_set.period_number
        )
        self._running, self._lost = True, None
        return obs, infos

    def step(
        self, actions: dict[Any, Any]
    ) -> tuple[dict[Any, Any], dict[Any, float], dict[Any, bool], dict[Any, bool], Infos]:
        """Step the environment, update the monitors, and end a violated episode.

        Raises:
            StateError: Before :meth:`reset` and after the end of an episode.
            InputError: If a signal is nan or cannot be read; the episode is over then.
        """
        if not self._running:
            self._resume()
        monitor_set, env = self._monitor_set, self.env
        here = [*env.agents]
        obs, rewards, terminations, truncations, infos = env.step(actions)
        here += [agent for agent in env.agents if agent not in here]
        try:
            assessment = self._feed(obs, actions, rewards, infos)
        except BaseException:
            # After a missed sample the monitor would count wrong.
            self._running = False
            raise
        how = self._how_to_end() if monitor_set.settled else "report"
        ended = all(terminations.get(agent) or truncations.get(agent) for agent in env.agents)
        terminated = ended and any(terminations.get(agent) for agent in here)
        truncated = ended and (not terminated or any(truncations.get(agent) for agent in here))
        if ended:
            assessment = self._finish(terminated)
        if how != "report" and not terminated:
            terminated = how == "terminate"
            truncated = truncated or not terminated
            ends = dict.fromkeys((agent for agent in here if not terminations.get(agent)), True)
            if terminated:
                terminations = {**terminations, **ends}
            else:
                truncations = {**truncations, **ends}
        infos = self._report(here, infos, assessment, monitor_set.take_costs())
        if terminated or truncated:
            self._running, self._over = False, True
            self._conclude([infos[agent] for agent in here], terminated, truncated)
            self._warn_of_ends()
        return obs, rewards, terminations, truncations, infos

    def close(self) -> None:
        """Close the environment; an episode that has not ended is recorded as truncated."""
        self._abandon()
        self.env.close()

    def _report(
        self,
        agents: Iterable[Hashable],
        infos: Infos,
        assessment: Assessment,
        costs: Mapping[str, Any] | None = None,
        period: np.float64 | None = None,
    ) -> Infos:
        """Return the infos, with the keys of every info for these agents."""
        monitor_set = self._monitor_set
        robustness, lower, upper = map(np.float64, assessment)
        reported = {}
        for agent in agents:
            reported[agent] = step_info(
                infos.get(agent, {}),
                robustness,
                lower,
                upper,
                monitor_set.violated_by is not None,
                monitor_set,
                monitor_set.describe() if self._details else None,
                costs,
                period,
            )
        return {**infos, **reported}


def _agents(env: Any) -> dict[str, Hashable]:
    """Return the agents of an environment, by the names that selectors use; refuse others."""
    if isinstance(env, gym.Env):
        raise InputTypeError(
            f"expected a parallel environment of PettingZoo, got {env}, which has one agent; "
            "use StlMonitor"
        )
    if hasattr(env, "agent_iter"):
        raise InputTypeError(
            f"expected a parallel environment of PettingZoo, got {env}, in which agents take "
            "turns; convert it with pettingzoo.utils.aec_to_parallel"
        )
    agents = getattr(env, "possible_agents", None)
    if not agents:
        raise InputError(
            f"expected possible_agents, which selectors name, in {env}, got {agents!r}"
        )
    return {str(agent): agent for agent in agents}


class ParallelStlReward(Rewarding, ParallelWrapper):
    """A wrapper that shapes the reward of each agent with the joint robustness.

    The wrapper takes the arguments of :class:`ParallelStlMonitor` and contains a monitor, or uses
    the monitor of the environment. Each agent of a step gets the reward of :class:`StlReward`
    from its own reward r, the joint robustness, and its own end:

    * ``"replace"`` and ``"hierarchical"`` pay all agents the same, ``"verdict"`` pays only bonus
      and penalty, and the other modes add to each r; no mode looks for the agent to blame
    * an agent that leaves before the others is paid as at an end: ``"potential"`` counts 0 after
      its termination, ``"terminal"`` pays it the robustness so far
    * ``bonus`` and ``penalty`` are paid to each agent of the step that decides, so an agent that
      has left before gets neither

    The environment's own reward stays in ``infos[agent]["reward"]``. Observations do not change.

    Change logs:
     * v0.5.0 - Initially added
    """

    _monitor: ParallelStlMonitor
    env: Any

    def __init__(
        self,
        env: Any,
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
        **monitor: Unpack[StlMonitorOptions],
    ) -> None:
        """Find the monitor of the environment or make one, and check the numbers.

        It takes the arguments of :class:`StlReward` except ``observe``, with an environment that
        has PettingZoo's parallel API, and the keyword arguments of :class:`ParallelStlMonitor`.
        ``bonus`` and ``penalty`` are for each agent.

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
        self._set_up(self.env, options)
        self._potential = self._outcome = 0.0

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[Any, Any], Infos]:
        """Reset the environment; the sample of the reset gives the first potential."""
        obs, infos = self.env.reset(seed=seed, options=options)
        self._begin()
        values = self._monitor.values()
        self._potential, self._outcome = self._potential_of(values), 0.0
        self._watch_start(self._paying(values))
        return obs, infos

    def step(
        self, actions: dict[Any, Any]
    ) -> tuple[dict[Any, Any], dict[Any, Any], dict[Any, bool], dict[Any, bool], Infos]:
        """Step the environment and shape the rewards."""
        obs, rewards, terminations, truncations, infos = self.env.step(actions)
        values: MonitorValues[float] = self._monitor.values()
        before, after = self._potential, self._potential_of(values)
        self._potential = after
        shaping, settled = self._shaping, 0.0
        if self._settles:
            settled = self._settle(least(values.lower), least(values.upper))
        shaped: dict[Any, Any] = {}
        infos = dict(infos)
        for agent, reward in rewards.items():
            terminated = bool(terminations.get(agent))
            ended = terminated or bool(truncations.get(agent))
            paid = shaping.reward(float(reward), before, after, terminated, ended)
            shaped[agent] = np.float64(paid + settled if self._settles else paid)
            infos[agent] = {**infos.get(agent, {}), "reward": np.float64(reward)}
        if self._clip_watch is not None:
            paying = self._paying(values)
            self._clip_watch.step(paying)
            if not self._monitor.agents:
                self._clip_watch.end(paying)
                self._warn_if_flat()
        return obs, shaped, terminations, truncations, infos

    @property
    def samples(self) -> int:
        """The number of samples since :meth:`reset`, including the sample of the reset."""
        return self._monitor.samples

    def explain(self, name: str | None = None) -> Explanation:
        """Explain the robustness of the episode, as :meth:`StlMonitor.explain` does."""
        return self._monitor.explain(name)
