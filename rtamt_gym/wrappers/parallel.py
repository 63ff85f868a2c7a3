"""Wrappers of environments of several agents, in the form of PettingZoo's parallel API."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import gymnasium as gym

if TYPE_CHECKING or find_spec("pettingzoo"):
    from pettingzoo.utils import ParallelEnv
else:

    class ParallelEnv:
        """Stands for the class of PettingZoo, whose form is enough where it is not installed."""


__all__ = ["Infos", "ParallelEnv", "ParallelWrapper"]

Infos = dict[Any, dict[str, Any]]
"""The infos of agents."""


class ParallelWrapper(ParallelEnv):  # type: ignore[misc]  # it has no types
    """The base of the wrappers: what they do not change comes from the environment."""

    env: Any

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - whatever the environment has
        """What the environment has."""
        if name.startswith("_") or name == "env":
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        return getattr(self.env, name)

    @property
    def agents(self) -> list[Any]:
        """The agents of the next step; none after the end of an episode."""
        agents: list[Any] = self.env.agents
        return agents

    @property
    def unwrapped(self) -> Any:  # noqa: ANN401 - the environment inside of all wrappers
        """The environment inside of all wrappers."""
        return self.env.unwrapped

    def observation_space(self, agent: Any) -> gym.Space[Any]:  # noqa: ANN401 - as PettingZoo names them
        """What an agent observes, the same object at every call."""
        space: gym.Space[Any] = self.env.observation_space(agent)
        return space

    def action_space(self, agent: Any) -> gym.Space[Any]:  # noqa: ANN401 - as PettingZoo names them
        """What an agent does, the same object at every call."""
        space: gym.Space[Any] = self.env.action_space(agent)
        return space

    def state(self) -> Any:  # noqa: ANN401 - an array, for most environments
        """The state of the environment as a whole, as it gives it."""
        return self.env.state()

    def render(self) -> Any:  # noqa: ANN401 - as its mode says
        """Renders the environment."""
        return self.env.render()

    def close(self) -> None:
        """Closes the environment."""
        self.env.close()
