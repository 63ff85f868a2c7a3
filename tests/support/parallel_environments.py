"""An environment of several agents in the form of PettingZoo, and the same for Gymnasium."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from rtamt_gym import ParallelStlMonitor, StlMonitor

INF = np.inf
Five = tuple[
    dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]
]


class Crew:
    """A crew: every agent observes its numbers in order, and leaves after the last one.

    It has the form of PettingZoo's ``ParallelEnv`` and needs no PettingZoo. An observation is a
    number and the count of earlier samples; a reward is the number plus the action.

    Args:
        numbers: The numbers of every agent.
        ends: How the agents leave, ``"terminated"`` or ``"truncated"``; by default terminated.
        tau: Seconds between two samples, as an attribute for monitors; None for no attribute.
    """

    def __init__(
        self,
        numbers: Mapping[str, Sequence[float]],
        ends: Mapping[str, str] | None = None,
        tau: float | None = None,
    ) -> None:
        self.metadata = {"name": "crew_v0", "render_modes": []}
        self.render_mode = None
        self.control_timestep = tau
        self.possible_agents = list(numbers)
        self.agents: list[str] = []
        self.numbers = numbers
        self.ends = ends or {}
        self.seeds: list[int | None] = []
        self.closed = False
        self._seen = {each: spaces.Box(-INF, INF, (2,), np.float64) for each in numbers}
        self._done = {each: spaces.Box(-1.0, 1.0, (1,), np.float64) for each in numbers}
        self._at = 0

    @property
    def unwrapped(self) -> Crew:
        return self

    def observation_space(self, agent: str) -> spaces.Box:
        return self._seen[agent]

    def action_space(self, agent: str) -> spaces.Box:
        return self._done[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        self.seeds.append(seed)
        self._at = 0
        self.agents = list(self.possible_agents)
        return self._observed(), {agent: {"own": -1.0} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> Five:
        assert actions.keys() == set(self.agents)
        self._at += 1
        here = self.agents
        seen = self._observed()
        last = {agent: self._at == len(self.numbers[agent]) - 1 for agent in here}
        end = {agent: self.ends.get(agent, "terminated") if last[agent] else "" for agent in here}
        self.agents = [agent for agent in here if not last[agent]]
        return (
            seen,
            {agent: float(seen[agent][0] + actions[agent][0]) for agent in here},
            {agent: end[agent] == "terminated" for agent in here},
            {agent: end[agent] == "truncated" for agent in here},
            {agent: {"own": float(self._at)} for agent in here},
        )

    def state(self) -> Any:  # noqa: ANN401
        return np.array([self._at], np.float64)

    def render(self) -> str:
        return f"sample {self._at}"

    def close(self) -> None:
        self.closed = True

    def _observed(self) -> dict[str, Any]:
        return {
            agent: np.array([self.numbers[agent][self._at], self._at], np.float64)
            for agent in self.agents
        }


class OneOf(gym.Env[Any, Any]):
    """A crew as an environment of Gymnasium; agents that left keep their last values.

    The episode ends when the last agents leave; it is terminated if one of them is.
    """

    def __init__(self, crew: Crew) -> None:
        self.crew = crew
        agents = crew.possible_agents
        self.observation_space = spaces.Dict(
            {each: crew.observation_space(each) for each in agents}
        )
        self.action_space = spaces.Dict({each: crew.action_space(each) for each in agents})

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self._seen, infos = self.crew.reset(seed, options)
        self._info: dict[str, Any] = {"infos": infos, "rewards": {}}
        return dict(self._seen), self._info

    def step(self, action: dict[str, Any]) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        here = list(self.crew.agents)
        seen, rewards, terminated, truncated, infos = self.crew.step(
            {agent: action[agent] for agent in here}
        )
        self._seen = {**self._seen, **seen}
        self._info = {
            "infos": {**self._info["infos"], **infos},
            "rewards": {**self._info["rewards"], **rewards},
        }
        over = not self.crew.agents
        ends = over and any(terminated.values()), over and any(truncated.values())
        return dict(self._seen), 0.0, *ends, self._info


def selector_of_one(selector: Any) -> Any:  # noqa: ANN401
    """Return the selector in `OneOf` for a selector of an agent, such as ``agent: obs[1]``."""
    if isinstance(selector, tuple):
        return selector_of_one(selector[0]), selector[1]
    agent, rest = selector.split(": ")
    word, bracket, path = rest.partition("[")
    place = {
        "obs": f"obs['{agent}']",
        "action": f"action['{agent}']",
        "reward": f"info['rewards']['{agent}']",
        "info": f"info['infos']['{agent}']",
    }[word]
    return place + bracket + path


def assert_as_one(
    make: Callable[[], Any],
    specs: Any,  # noqa: ANN401
    signals: Mapping[str, Any],
    act: Callable[[str, int], Any],
    **options: Any,  # noqa: ANN401
) -> None:
    """Check that monitors of several agents equal `StlMonitor` of the combined environment.

    Args:
        make: Makes the environment of several agents.
        specs: The specifications.
        signals: Their signals, with an agent before every selector.
        act: The action of an agent at a step. **options: Other arguments of the monitors.
    """
    bare = make()
    env = ParallelStlMonitor(make(), specs, signals, **options)
    of_one = {name: selector_of_one(value) for name, value in signals.items()}
    one = StlMonitor(OneOf(make()), specs, of_one, **options)
    bare.reset(seed=5)
    seen, infos = env.reset(seed=5)
    seen_of_one, info = one.reset(seed=5)
    assert env.agents == bare.agents
    _same(seen, {agent: seen_of_one[agent] for agent in bare.agents})
    _same_infos(infos, bare.agents, info)
    actions: dict[str, Any] = {}
    ended = False
    steps = 0
    while not ended:
        steps += 1
        here = bare.agents[:]
        given = {agent: act(agent, steps) for agent in here}
        actions = {**actions, **given}
        _, rewards_bare, terminated_bare, truncated_bare, _ = bare.step(given)
        seen, rewards, terminated, truncated, infos = env.step(given)
        seen_of_one, _, terminated_one, truncated_one, info = one.step(actions)
        _same(seen, {agent: seen_of_one[agent] for agent in here})
        _same(rewards, rewards_bare)
        _same_infos(infos, here, info)
        ended = terminated_one or truncated_one
        # Only the monitor ends an episode that would continue, or that a time limit ends.
        left = not bare.agents
        by_itself = left and any(terminated_bare.values())
        for agent in here:
            ours = not by_itself and not terminated_bare[agent]
            by_time = not left and not terminated_bare[agent]
            assert terminated[agent] is (terminated_bare[agent] or (ours and terminated_one))
            assert truncated[agent] is (truncated_bare[agent] or (by_time and truncated_one))
        assert env.agents == ([] if ended else bare.agents)
    assert repr(env.stl_episodes) == repr(one.stl_episodes)
    assert env.samples == one.samples == steps + 1


def _same(given: Mapping[str, Any], expected: Mapping[str, Any]) -> None:
    assert given.keys() == expected.keys()
    assert all(np.array_equal(given[agent], expected[agent]) for agent in expected)


def _same_infos(infos: Mapping[str, Any], agents: Sequence[str], info: Mapping[str, Any]) -> None:
    """Compare the keys of the monitor for every agent; texts distinguish zeros and types."""
    assert infos.keys() == set(agents)
    theirs = info["infos"]
    expected = {key: value for key, value in info.items() if key not in ("infos", "rewards")}
    for agent in agents:
        assert repr(infos[agent]) == repr({**theirs[agent], **expected})
